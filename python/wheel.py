"""Packs an installed package into a wheel: wheel.py FOLDER VERSION LICENCE TO

FOLDER holds orbid/ as it is to be imported. The standard library alone; the same files give the same bytes.
"""

import base64
import hashlib
import pathlib
import platform
import sys
import sysconfig
import zipfile

METADATA = """\
Metadata-Version: 2.1
Name: orbid
Version: {version}
Summary: Identification of nonlinear dynamical systems from chaotic data
License: BSD-3-Clause
Requires-Python: >=3.9
Requires-Dist: numpy
"""
WHEEL = """\
Wheel-Version: 1.0
Generator: orbid
Root-Is-Purelib: false
Tag: {tag}
"""


def digest(data: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


def main() -> None:
    folder, version, licence, to = map(pathlib.Path, sys.argv[1:])
    python = "cp{}{}".format(*sys.version_info)
    tag = f"{python}-{python}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
    files = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    if not any(name.startswith("orbid/_orbid.") and name.endswith(".so") for name in files):
        sys.exit(f"{folder}: no orbid/_orbid.*.so, nothing to pack")
    info = f"orbid-{version}.dist-info"
    files[f"{info}/METADATA"] = METADATA.format(version=version).encode()
    files[f"{info}/WHEEL"] = WHEEL.format(tag=tag).encode()
    files[f"{info}/LICENSE"] = licence.read_bytes()
    record = [f"{name},sha256={digest(data)},{len(data)}" for name, data in files.items()]
    files[f"{info}/RECORD"] = "\n".join([*record, f"{info}/RECORD,,", ""]).encode()
    to.mkdir(parents=True, exist_ok=True)
    wheel = to / f"orbid-{version}-{tag}.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            # The earliest time that a zip knows, on every machine.
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.endswith(".so") or ".so." in name else 0o644) << 16
            archive.writestr(entry, data)
    print(wheel)


if platform.system() != "Linux":
    sys.exit("wheels are made on Linux")
main()
