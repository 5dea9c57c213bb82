"""docs/python.md says what is true: its blocks run in order, and print what stands below them."""

import contextlib
import io
import os
import pathlib
import re

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


def test_every_public_name_is_on_the_page():
    import orbid

    text = PAGE.read_text()
    missing = [name for name in orbid.__all__ if not re.search(rf"\b{re.escape(name)}\b", text)]
    assert missing == []
