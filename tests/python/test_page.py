"""docs/python.md says what is true: its blocks run in order, and print what stands below them."""

import contextlib
import importlib.util
import io
import os
import pathlib
import re
import subprocess
import sys

import pytest

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "python.md"


def test_blocks_run_in_order(tmp_path):
    text = PAGE.read_text()
    blocks = re.findall(r"```python\n(.*?)```(?:\n\n?```text\n(.*?)```)?", text, re.DOTALL)
    assert len(blocks) >= 4
    names: dict[str, object] = {}
    before = os.getcwd()
    os.chdir(tmp_path)
    try:
        for code, expected in blocks:
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(code, str(PAGE), "exec"), names)
            if expected:
                assert printed.getvalue() == expected, code
    finally:
        os.chdir(before)


@pytest.mark.skipif(importlib.util.find_spec("mypy") is None, reason="mypy is not installed")
def test_blocks_have_the_right_types(tmp_path):
    (tmp_path / "page.py").write_text("\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)))
    done = subprocess.run([sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"),
                           str(tmp_path / "page.py")], capture_output=True, text=True, cwd=PAGE.parents[1] / "python")
    assert done.returncode == 0, done.stdout


def test_every_public_name_is_on_the_page():
    import orbid

    text = PAGE.read_text()
    missing = [name for name in orbid.__all__ if not re.search(rf"\b{re.escape(name)}\b", text)]
    assert missing == []
