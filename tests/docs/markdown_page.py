"""A Markdown page as the tests and the site see it: headings with their anchors, links, and blocks of code with their lines."""

import re
import subprocess
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Block:
    """A fenced block of code. `line` is that of its first line of content, counted from 1."""

    language: str
    options: dict
    text: str
    line: int


@dataclass
class Link:
    target: str
    line: int
    picture: bool
    words: str = ""


@dataclass
class Heading:
    level: int
    title: str
    anchor: str
    line: int


@dataclass
class Page:
    path: Path
    headings: list = field(default_factory=list)
    links: list = field(default_factory=list)
    blocks: list = field(default_factory=list)
    problems: list = field(default_factory=list)  # (line, text)

    def anchors(self):
        return {heading.anchor for heading in self.headings}


def plain(title):
    """A heading without its markup: links keep their text, code its words."""
    title = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", title)
    return title.replace("`", "").replace("**", "")


def slug(title):
    """The anchor that GitHub gives a heading: lower case, blanks to hyphens, everything else but letters, digits, - and _ dropped."""
    kept = [c for c in plain(title).strip().lower() if c.isalnum() or c in " -_"]
    return "".join(kept).replace(" ", "-")


# A target ends at the first parenthesis or blank: no file here has one in its name.
LINK = re.compile(r"(!?)\[[^\[\]]*(?:\[[^\[\]]*\][^\[\]]*)*\]\(<?([^)\s>]+)>?[^)]*\)")
FENCE = re.compile(r"^( *)(`{3,}|~{3,}) *([^`]*)$")


def options_of(words):
    """`name=value` words behind the language of a block; a word alone is true."""
    options = {}
    for word in words:
        name, _, value = word.partition("=")
        options[name] = value if value else True
    return options


def read_page(path):
    """Reads a page. Unclosed blocks are problems; links in code are none."""
    page = Page(Path(path))
    lines = Path(path).read_text(encoding="utf-8").split("\n")
    seen = {}
    fence = None
    prose = [""] * len(lines)  # without blocks of code
    for number, line in enumerate(lines, 1):
        match = FENCE.match(line)
        if fence:
            indent, mark, block = fence
            if match and match[2].startswith(mark) and not match[3].strip():
                page.blocks.append(block)
                fence = None
            else:
                block.text += (line[len(indent):] if line.startswith(indent) else line.lstrip(" ")) + "\n"
            continue
        if match:
            words = match[3].split()
            fence = (match[1], match[2], Block(words[0] if words else "", options_of(words[1:]), "", number + 1))
            continue
        heading = re.match(r"^(#{1,6}) +(.*?) *#*$", line)
        if heading:
            anchor = slug(heading[2])
            seen[anchor] = seen.get(anchor, -1) + 1
            if seen[anchor]:
                anchor += f"-{seen[anchor]}"
            page.headings.append(Heading(len(heading[1]), plain(heading[2]), anchor, number))
        if line.startswith("    ") and (number == 1 or not lines[number - 2].strip() or lines[number - 2].startswith("    ")):
            continue  # indented code
        prose[number - 1] = line
    if fence:
        page.problems.append((fence[2].line - 1, "this block of code is not closed"))
    find_links(page, "\n".join(prose))
    return page


def find_links(page, prose):
    """Links and pictures of the text, those broken over two lines too; what stands in `code` is none."""
    text = re.sub(r"`[^`\n]*`", lambda code: "`" + "x" * (len(code[0]) - 2) + "`", prose)
    for link in LINK.finditer(text):
        words = prose[link.start() + 1:text.rindex("](", link.start(), link.end())]
        page.links.append(Link(link[2], text.count("\n", 0, link.start(2)) + 1, bool(link[1]), words))
        # A picture that is a link itself.
        for picture in LINK.finditer(text, link.end(1) + 1, link.end()):
            page.links.append(Link(picture[2], text.count("\n", 0, picture.start(2)) + 1, True))


def pages_of(root):
    """All Markdown files that git knows or would add, in order of their names; all there are where git is not at hand."""
    try:
        listed = subprocess.run(["git", "-C", str(root), "ls-files", "-co", "--exclude-standard", "--", "*.md"],
                                capture_output=True, text=True, check=True).stdout.splitlines()
    except (OSError, subprocess.CalledProcessError):
        listed = [str(path.relative_to(root)) for path in Path(root).rglob("*.md")
                  if not {"build", "out", "node_modules"} & set(path.relative_to(root).parts)]
    return [Path(root) / name for name in sorted(listed) if (Path(root) / name).exists()]
