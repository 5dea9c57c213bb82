"""The wheel: what it holds, that its records are true, that it works where nothing else of orbid is; installing."""

import base64
import csv
import hashlib
import io
import os
import pathlib
import subprocess
import sys
import zipfile

import orbid
import pytest


def packed(folder):
    script = os.path.join(os.environ["ORBID_BUILD"], "python", "wheel.cmake")
    done = subprocess.run(["cmake", f"-DTO={folder}", "-P", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    return packed(folder)


def test_names_and_content(wheel):
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    assert wheel.name == f"orbid-{orbid.__version__}-{tag}-{tag}-linux_{os.uname().machine}.whl"
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        package = pathlib.Path(orbid.__file__).parent
        for file in ["__init__.py", "job.py", "equation.py", "_orbid.pyi", "py.typed"]:
            assert archive.read(f"orbid/{file}") == (package / file).read_bytes()
        assert sum(name.startswith("orbid/_orbid.") and name.endswith(".so") for name in names) == 1
        assert sum(name.startswith("orbid/liborbid.so.") for name in names) == 1
        info = f"orbid-{orbid.__version__}.dist-info"
        metadata = archive.read(f"{info}/METADATA").decode()
        assert "Name: orbid\n" in metadata and f"Version: {orbid.__version__}\n" in metadata
        assert "Requires-Dist: numpy" in metadata
        assert f"{info}/LICENSE" in names
        assert f"Tag: {tag}-{tag}-linux_" in archive.read(f"{info}/WHEEL").decode()
        rows = list(csv.reader(io.StringIO(archive.read(f"{info}/RECORD").decode())))
        assert {row[0] for row in rows} == set(names)
        for name, digest, size in rows:
            if name.endswith("RECORD"):
                assert (digest, size) == ("", "")
                continue
            data = archive.read(name)
            expected = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            assert (digest, size) == (f"sha256={expected}", str(len(data)))


def test_installed_in_a_clean_place(wheel, tmp_path):
    pip = subprocess.run([sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target",
                          str(tmp_path), str(wheel)], capture_output=True, text=True)
    if pip.returncode != 0:
        # Debian's python3 comes without pip: a wheel is a zip of what is to be there.
        assert "No module named pip" in pip.stderr, pip.stderr
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(tmp_path)
    code = ("import orbid, os; x = orbid.model('henon').rhs([0.0, 0.0]); print(orbid.__file__, x.tolist());"
            "print([line.split()[-1] for line in open('/proc/self/maps') if 'liborbid' in line][0])")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd="/",
                          env={"PYTHONPATH": str(tmp_path), "PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == f"{tmp_path}/orbid/__init__.py [1.0, 0.0]"
    assert second.startswith(f"{tmp_path}/orbid/liborbid.so.")


def test_packing_twice_gives_the_same_bytes(wheel, tmp_path):
    assert packed(tmp_path).read_bytes() == wheel.read_bytes()


def test_installed_under_a_prefix(tmp_path):
    for component in ("runtime", "python"):
        subprocess.run(["cmake", "--install", os.environ["ORBID_BUILD"], "--component", component,
                        "--prefix", tmp_path], check=True, capture_output=True)
    code = ("import orbid; print(orbid.__file__);"
            "print([line.split()[-1] for line in open('/proc/self/maps') if 'liborbid' in line][0])")
    packages = tmp_path / "lib" / "python3" / "dist-packages"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd="/",
                          env={"PYTHONPATH": str(packages), "PATH": "/usr/bin:/bin"})
    assert done.returncode == 0, done.stderr
    module, library = done.stdout.splitlines()
    assert module == str(packages / "orbid" / "__init__.py")
    assert library.startswith(f"{tmp_path}/lib") and not library.startswith(str(packages))
