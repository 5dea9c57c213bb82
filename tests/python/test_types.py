"""Stubs: what is typed exists and the reverse; mypy reads package and page, where it is installed."""

import ast
import importlib.util
import inspect
import pathlib
import subprocess
import sys

import orbid
import pytest
from orbid import _orbid

SOURCE = pathlib.Path(__file__).parents[2]
PACKAGE = SOURCE / "python" / "orbid"
needs_mypy = pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed")


def test_stub_and_module_have_the_same_names():
    stub = ast.parse((PACKAGE / "_orbid.pyi").read_text())
    typed = {}
    for node in stub.body:
        if isinstance(node, ast.ClassDef):
            typed[node.name] = {item.name for item in node.body if isinstance(item, ast.FunctionDef)} | {
                item.target.id for item in node.body if isinstance(item, ast.AnnAssign)}
        elif isinstance(node, ast.FunctionDef):
            typed[node.name] = None
    built = {name: value for name, value in vars(_orbid).items() if not name.startswith("__")}
    assert set(built) == set(typed)
    for name, value in built.items():
        if inspect.isclass(value) and not issubclass(value, Exception):
            members = {member for member in vars(value) if not member.startswith("_")}
            assert members == {member for member in typed[name] if not member.startswith("_")}, name


def test_every_name_is_exported_and_told():
    for name in orbid.__all__:
        value = getattr(orbid, name)
        if name != "__version__" and not name.startswith("_"):
            assert value.__doc__, name


@needs_mypy
def test_mypy_reads_the_package(tmp_path):
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), str(PACKAGE)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@needs_mypy
def test_mypy_knows_the_types_of_results(tmp_path):
    (tmp_path / "use.py").write_text("""
import numpy as np
import orbid

lorenz = orbid.model("lorenz")
flow = lorenz.flow([1.0, 1.0, 1.0], np.linspace(0.0, 1.0, 5), {"rho": 28.0}, sensitivities=["rho"])
reveal_type(flow.states)
reveal_type(orbid.run({"model": {}}).parameters["l"].value)
x: str = flow.steps
lorenz.flow([1.0, 1.0, 1.0], 1.0, tolerance=1e-3)
""")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"),
                           str(tmp_path / "use.py")], capture_output=True, text=True, cwd=PACKAGE.parent)
    assert "numpy.ndarray" in done.stdout and "builtins.float" in done.stdout, done.stdout
    errors = [line for line in done.stdout.splitlines() if "error:" in line]
    assert len(errors) == 2, done.stdout
    assert '"int"' in errors[0] and "tolerance" in errors[1]
