#!/usr/bin/env python3
"""The comparison of public names sees what is gone, and what CHANGELOG.md says of it."""

import contextlib
import io
import tempfile
import unittest
from pathlib import Path

from public_surface import RECORDS, announced, check, compare, keys_of, named_by, read_record, readable, write_record

CHANGELOG = """# Changelog

## Unreleased

* `/new/key`.

### Removed

* `/model/variant` and the function `orbid::models::flow`: see `docs`.

### Fixed

* `/seed` is read.

## 0.1.0

### Removed

* `/title`.
"""


class Surface(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)

    def checked(self, present, changelog=CHANGELOG, write=False):
        """Whether nothing is wrong, and what is printed."""
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            return check({"job_keys": present}, self.folder, changelog, write), out.getvalue()

    def test_only_the_newest_version_and_its_two_sections_announce(self):
        self.assertEqual(announced(CHANGELOG), {"/model/variant", "orbid::models::flow", "docs"})

    def test_what_stands_for_what(self):
        self.assertTrue(named_by("job_keys", "/model/variant", "/model/variant"))
        self.assertTrue(named_by("job_keys", "/model/variant/x", "/model/variant"))
        self.assertTrue(named_by("job_keys", '/model/kind = "map"', "/model/kind"))
        self.assertTrue(named_by("commands", "run --out", "orbid run"))
        self.assertTrue(named_by("commands", "run --out", "orbid run --out"))
        self.assertTrue(named_by("symbols", "orbid::models::flow(int)", "orbid::models::flow"))
        self.assertTrue(named_by("symbols", "orbid::orbits::BoxTree::near(int) const", "orbid::orbits::BoxTree"))
        self.assertTrue(named_by("headers", "orbid/models/flow.hpp", "orbid/models/flow.hpp"))
        self.assertFalse(named_by("job_keys", "/model/variants", "/model/variant"))
        self.assertFalse(named_by("symbols", "orbid::models::flows(int)", "orbid::models::flow"))
        self.assertFalse(named_by("job_keys", "/model", "/model/variant"))

    def test_words_of_any_sentence_announce_nothing(self):
        for kind in ("symbols", "job_keys", "commands", "headers"):
            recorded = read_record(RECORDS, kind)
            for word in ("orbid", "orbid::models", "orbid/models", "models", "run", "model", "/"):
                silenced = [name for name in recorded if named_by(kind, name, word)]
                self.assertEqual(silenced, [], f"{kind}: {word}")

    def test_a_name_that_is_gone_fails_until_it_is_announced(self):
        write_record(self.folder, "job_keys", {"/seed", "/title", "/model/variant"})
        self.assertTrue(self.checked({"/seed", "/title", "/model/variant"})[0])
        right, told = self.checked({"/seed", "/model/variant"})
        self.assertFalse(right)
        self.assertIn("gone: /title", told)
        self.assertTrue(self.checked({"/seed", "/title"})[0])
        # Named in another section only.
        self.assertFalse(self.checked({"/title", "/model/variant"})[0])

    def test_a_new_name_fails_in_a_release_alone(self):
        write_record(self.folder, "job_keys", {"/seed"})
        right, told = self.checked({"/seed", "/new"})
        self.assertTrue(right)
        self.assertIn("1 new, not recorded yet: /new", told)
        self.assertFalse(self.checked({"/seed", "/new"}, CHANGELOG.replace("Unreleased", "0.2.0"))[0])

    def test_writing_takes_out_only_what_is_announced(self):
        write_record(self.folder, "job_keys", {"/seed", "/title", "/model/variant"})
        self.assertTrue(self.checked({"/seed", "/title", "/new"}, write=True)[0])
        self.assertEqual(read_record(self.folder, "job_keys"), {"/seed", "/title", "/new"})
        self.assertFalse(self.checked({"/seed"}, write=True)[0])
        self.assertEqual(read_record(self.folder, "job_keys"), {"/seed", "/title", "/new"})

    def test_a_broken_search_is_no_empty_surface(self):
        write_record(self.folder, "job_keys", set())
        self.assertFalse(self.checked(set())[0])

    def test_each_record_of_the_project_would_be_missed(self):
        """A line taken out of what is there fails, whichever it is, with a changelog that says nothing."""
        silent = "## Unreleased\n"
        for kind in ("symbols", "job_keys", "commands", "headers"):
            recorded = read_record(RECORDS, kind)
            self.assertGreater(len(recorded), 10, kind)
            for name in recorded:
                self.assertEqual(compare(kind, recorded, recorded - {name}, silent), ([name], [], []))

    def test_keys_are_found_behind_references_choices_and_conditions(self):
        schema = {
            "properties": {"a": {"$ref": "#/$defs/part"}, "list": {"type": "array", "items": {"enum": ["x", 1]}},
                           "gone": False},
            "if": {"properties": {"condition": {"const": 1}}}, "then": {"properties": {"then": {}}},
            "$defs": {"part": {"oneOf": [{"type": "number"}, {"properties": {"b": {"const": True},
                                                                            "again": {"$ref": "#/$defs/part"}}},
                                         {"additionalProperties": {"type": "string"}}]}},
        }
        self.assertEqual(keys_of(schema), {"/a", "/a/b", "/a/b = true", "/a/again", "/a/NAME", "/list", '/list/[] = "x"',
                                           "/list/[] = 1", "/then"})

    def test_names_read_the_same_from_any_compiler(self):
        string = "std::__cxx11::basic_string<char, std::char_traits<char>, std::allocator<char> >"
        vector = f"std::vector<{string}, std::allocator<{string} > >"
        self.assertEqual(readable(f"orbid::f({vector} const&, Eigen::Matrix<double, -1, 1, 0, -1, 1>)"),
                         "orbid::f(std::vector<std::string> const&, Eigen::VectorXd)")
        self.assertEqual(readable("orbid::version[abi:cxx11]()"), "orbid::version()")
        self.assertEqual(readable("orbid::f(std::span<long const, 18446744073709551615ul>)"), "orbid::f(std::span<long const>)")
        self.assertEqual(readable("orbid::f(std::span<long const, (unsigned long)18446744073709551615>)"),
                         "orbid::f(std::span<long const>)")


if __name__ == "__main__":
    unittest.main()
