#!/usr/bin/env python3
"""The checks of the pages see what is wrong: one small broken page for each kind of mistake, and its repaired twin.

    broken_pages_test.py ROOT ORBID
"""

import sys
import tempfile
import unittest
from pathlib import Path

import commented_json
from check_code_blocks import Commands, check_json, check_pages
from check_messages import unknown
from check_links import broken_links
from compare_output import difference
from markdown_page import Block, read_page, slug
from run_pages import run_group

ROOT, ORBID = Path(sys.argv[1]).resolve(), str(Path(sys.argv[2]).resolve())
sys.path[:0] = [str(ROOT / "docs" / "site"), str(ROOT / "docs")]
import gallery  # noqa: E402
from build import broken  # noqa: E402
from gallery_page import flowing, shown  # noqa: E402

JOB = """{ "model": { "name": "henon" }, "data": { "simulate": { "sections": 100 } } }"""


class Folder(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name).resolve()

    def page(self, text, name="page.md"):
        (self.folder / name).write_text(text, encoding="utf-8")
        return self.folder / name


class Pages(Folder):
    def test_anchors_are_those_of_github(self):
        self.assertEqual(slug("Cycles, links & `code`: what-now_2?"), "cycles-links--code-what-now_2")
        page = read_page(self.page("# A\n\n## B [c](d.md)\n\n## B c\n"))
        self.assertEqual([heading.anchor for heading in page.headings], ["a", "b-c", "b-c-1"])

    def test_code_is_neither_heading_nor_link(self):
        page = read_page(self.page("```sh\n# comment\n[a](b)\n```\n\n    [c](d)\n\n`[e](f)` and [g\nh](i.md)\n"))
        self.assertEqual([(link.target, link.line) for link in page.links], [("i.md", 9)])
        self.assertEqual(page.headings, [])
        self.assertEqual((page.blocks[0].language, page.blocks[0].line), ("sh", 2))

    def test_pictures_that_are_links(self):
        page = read_page(self.page("[![a](b.svg)](c.md)<br>d [e](f.md) ![g](h.png)\n"))
        self.assertEqual([(link.target, link.picture) for link in page.links],
                         [("c.md", False), ("b.svg", True), ("f.md", False), ("h.png", True)])

    def test_open_blocks(self):
        self.assertEqual(read_page(self.page("a\n```sh\nls\n")).problems, [(2, "this block of code is not closed")])


class Links(Folder):
    def check(self, text, expected):
        self.page("# There\n", "other.md")
        self.page("# Here\n\n" + text + "\n")
        found, count = broken_links(self.folder)
        self.assertEqual(count, 1)
        self.assertEqual(len(found), 1 if expected else 0, found)
        if expected:
            self.assertIn("page.md:3: ", found[0])
            self.assertIn(expected, found[0])

    def test_good(self):
        for text in ("[a](other.md)", "[a](other.md#there)", "[a](#here)", "[a](https://example.org/x)"):
            self.check(text, None)

    def test_broken(self):
        self.check("[a](none.md)", "no such file")
        self.check("[a](other.md#their)", "no such heading; near: there")
        self.check("[a](#there)", "no such heading")
        self.check("![a](none.svg)", "picture none.svg: there is no such file")
        self.check("![a](other.md)", "not a picture")
        self.check("[a](../../../../etc/passwd)", "leads out of the project")
        self.check("[a](htps://example.org)", "not an address")
        self.check("[a](other.md#a#b)", "no such heading")


class Site(Folder):
    def check(self, text, expected):
        (self.folder / "api").mkdir(exist_ok=True)
        self.page('<h1 id="there"></h1>', "api/other.html")
        self.page(f'<h1 id="here"></h1>{text}', "page.html")
        found, pages, _ = broken(self.folder)
        self.assertEqual((pages, len(found)), (2, 1 if expected else 0), found)
        if expected:
            self.assertIn(expected, found[0])

    def test_good(self):
        for text in ('<a href="api/other.html#there">', '<a href="#here">', '<a href="https://example.org">', '<img src="page.html">',
                     '<script>var x = "https://example.org";</script>'):
            self.check(text, None)

    def test_broken(self):
        self.check('<a href="none.html">', "page.html: none.html: no such file")
        self.check('<a href="api/other.html#here">', "no such anchor")
        self.check('<a href="#there">', "no such anchor")
        for text in ('<script src="https://example.org/x.js">', '<link href="//example.org/x.css">', '<img src="http://example.org/x.png">'):
            self.check(text, "fetched from the network")


class Gallery(Folder):
    def test_digits_are_those_of_the_sd(self):
        for value, sd, text in ((64.0485085, 0.0023, "64.0485"), (186015.7, 30.6, "186016"), (2.9993e-6, 2.6e-6, "3e-06"),
                                (-0.00143869, 0.000166, "-0.00144"), (0.5447, 0.06, "0.545"), (0.0, None, "0")):
            self.assertEqual(shown(value, sd), text)

    def test_paragraphs_flow_and_blocks_stay(self):
        text = "# A\n\na {}\nb `c d`\n\n| a |\n|---|\n\n```text\na\nb\n```\n\n    c\n    d\n\n* e\n* f\n"
        self.assertEqual(flowing(text), text.replace("{}\n", "{} "))
        self.assertTrue(all(len(line) <= 120 for line in flowing("word " * 60).split("\n")))

    def test_what_is_wrong_with_a_page(self):
        system = gallery.SYSTEMS[0]
        good = (ROOT / f"docs/gallery/{system.page}.md").read_text()
        for folder in (gallery, sys.modules["gallery_page"]):
            self.addCleanup(setattr, folder, "GALLERY", folder.GALLERY)
            folder.GALLERY = self.folder
        for file in (ROOT / "docs/gallery").iterdir():
            (self.folder / file.name).write_bytes(file.read_bytes())
        name = f"{system.page}.md"
        for text, expected in ((good, None), (good.replace("## Result", "## Results"), "headings"), (good.replace("circuit", "cirquit"), "prose"),
                               (good.replace(gallery.picture_of(system), "silverbox_residuals.svg"), "two pictures"),
                               (good.replace("(silverbox_residuals.svg)", "(none.svg)"), "none.svg has 0 bytes")):
            self.page(text, name)
            found = gallery.problems_of(system)
            self.assertEqual(len(found) > 0, expected is not None, found)
            self.assertIn(expected or "", " ".join(found))


class CodeBlocks(Folder):
    def json(self, text):
        return check_json(Block("json", {}, text, 1), ORBID, self.folder, False)

    def test_whole_jobs_are_checked(self):
        self.assertEqual(self.json(JOB), ([], True))
        messages, whole = self.json(JOB.replace("sections", "sectoins"))
        self.assertTrue(whole and "sectoins" in messages[0][1])

    def test_pieces(self):
        for text in ('"a": 1, "b": { "c": [1, 2] } // rest', '"a": 1\n"a": 2', '{ "type": "series", ... }', '"a": ...', "[1, 2]",
                     '{ "x": "// no comment /* here" }'):
            self.assertEqual(self.json(text), ([], False), text)
        for text, line in (('"a": 1,\n"b": {', 2), ('{ "a": 1, "a": 2 }', 1), ('"a": tru', 1), ('{\n"a" 1 }', 2), ('"a": "b', 1)):
            messages, _ = self.json(text)
            self.assertEqual([place for place, _ in messages], [line], text)

    def test_comments_keep_lines_and_columns(self):
        self.assertEqual(commented_json.without_comments('/* a\nb */ 1 // c\n"//"'), '    \n     1     \n"//"')

    def test_programs_commands_and_jobs(self):
        commands = Commands(ORBID, ROOT / "dev")
        for line in ("orbid run job.json --out there", "build/release/bin/orbid models    prose", "./dev test", "orbid --version",
                     "orbid new henon | less --wild"):
            self.assertEqual(commands.problems("    " + line), [], line)
        for line, word in (("orbid walk job.json", "no command walk"), ("orbid run a.json --outt b", "no option --outt"),
                           ("./dev tset", "no command tset")):
            self.assertIn(word, commands.problems("    " + line)[0])

    def test_a_whole_folder(self):
        (self.folder / "configs").mkdir()
        (self.folder / "dev").symlink_to(ROOT / "dev")
        self.page("# A\n\n```jsonc\n{ \"a\": }\n```\n\n    orbid walk configs/none.json\n\n```cpp\nint main() { return x; }\n```\n"
                  "\n```sh\nls\n```\n")
        found, counts = check_pages(self.folder, ORBID, ["c++"], set())
        text = "\n".join(found)
        for expected in ("page.md:4: not JSON", "page.md:7: orbid has no command walk", "page.md:7: there is no configs/none.json",
                         "page.md:10: does not compile", "page.md:14: a page with blocks that can be run"):
            self.assertIn(expected, text)
        self.assertEqual(len(found), 5, text)
        self.assertEqual((counts["pieces"], counts["programs"], counts["commands"]), (1, 1, 1))


class Messages(Folder):
    def test_messages_that_no_source_says(self):
        (self.folder / "apps").mkdir()
        (self.folder / "apps" / "a.cpp").write_text('x("there is no {} in "\n  "{}: \\"{}\\""); y = "the limit of " + n + " steps";\n  // "gone"')
        page = self.page("| key | x |\n|---|---|\n| `other` | |\n\n| message | cause |\n|---|---|\n| `there is no … in …: \"…\"` | `no message` |\n"
                         "| `the limit of … steps`, `gone` | |\n| `there is a …` | |\n")
        missing, count = unknown(page, self.folder)
        self.assertEqual(count, 4)
        self.assertEqual([(line, piece) for line, _, piece in missing], [(8, "gone"), (9, "there is a")])


class Output(unittest.TestCase):
    def same(self, shown, printed, **options):
        self.assertIsNone(difference(shown, printed, options))

    def other(self, shown, printed, **options):
        self.assertIsNotNone(difference(shown, printed, options), f"{shown} | {printed}")

    def test_words_blanks_and_dots(self):
        self.same("a  b\nc", "a b\nc\n")
        self.same("a\n...\nd", "a\nb\nc\nd")
        self.same("...\nb", "a\nb\n")
        self.other("a", "a\nb")
        self.other("a\nb", "a")
        self.other("a\n...\nd", "a\nb\nc")
        self.other("k2 is m", "k3 is m")
        self.same("ended: … (25 steps, …)", "ended: 2e-4 is left (25 steps, 3 s)")
        self.other("ended: … (25 steps)", "ended: 2e-4 is left (26 steps)")
        self.other("ended: … (25 steps)", "begun: 2e-4 is left (25 steps)")

    def test_numbers(self):
        self.same("12 of 3.14", "12 of 3.15")
        self.other("12 of 3.14", "13 of 3.14")
        self.other("3.14", "3.16")
        self.same("1.2e-9", "1.3e-9")
        self.other("1.2e-9", "1.2e-8")
        self.same("100 points", "120 points", relative=0.2)
        self.other("100 points", "121 points", relative=0.2)
        self.other("0.5", "nan")

    def test_estimates(self):
        shown = "l m 0.377 0.3170 0.0002 [0.3166, 0.3174] t"
        self.same(shown, "l m 0.377 0.3176 0.0003 [0.3172, 0.3180] t", sd=4)
        self.other(shown, "l m 0.377 0.3179 0.0002 [0.3175, 0.3183] t", sd=4)
        self.other(shown, "l m 0.377 0.3170 0.0005 [0.3166, 0.3174] t", sd=4)
        self.other(shown, "m m 0.377 0.3170 0.0002 [0.3166, 0.3174] t", sd=4)
        known = "\nl 0.317 0.3170 +18.9 % +0.01 % +0.1"
        self.same(shown + known, shown + "\nl 0.317 0.3165 +18.9 % -0.2 % -2.5", sd=4)
        self.other(shown + known, shown + "\nl 0.317 0.3165 +18.9 % -0.2 % -4.1", sd=4)


class Running(Folder):
    def run_page(self, text):
        self.page(text)
        return run_group(self.folder, ORBID, ["page.md"], self.folder)

    def test_a_good_page(self):
        job = "```jsonc\n// job.json: a test\n" + JOB + "\n```\n"
        self.assertEqual(self.run_page(job + "```sh\norbid check job.json > out\nwc -l < job.json\n```\n```text\n2\n```\n"), [])

    def test_what_goes_wrong(self):
        for text, expected in (("```sh\necho 1\n```\n```text\n2\n```\n", "page.md:5: page:   2"),
                               ("```sh\nfalse\necho 1\n```\n", "page.md:2: exit code 1"),
                               ("```sh\nfalse | true\n```\n", "page.md:2: exit code 1"),
                               ("```json\n// a.json\n{}\n```\n```sh\ncat b.json\n```\n", "page.md:6: exit code 1"),
                               ("text\n", "nothing in this page is run"),
                               ("```sh\ntrue\n```\n\n![a](a.svg)\n", "page.md:5: no block of this page makes the picture a.svg")):
            found = self.run_page(text)
            self.assertEqual(len(found), 1, found)
            self.assertIn(expected, found[0])

    def test_pictures_are_those_of_the_commands(self):
        (self.folder / "docs").mkdir()
        (self.folder / "docs" / "a.svg").write_text("x" * 1000)
        self.page("```sh\nprintf x > a.svg\n```\n\n![a](a.svg)\n", "docs/page.md")
        found = run_group(self.folder, ORBID, ["docs/page.md"], self.folder)
        self.assertIn("docs/page.md:5: a.svg is not what the page's commands make", found[0])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
