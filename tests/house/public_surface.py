#!/usr/bin/env python3
"""What users of orbid rely on does not disappear silently: symbols of the library, keys and values of jobs, commands and
their options, installed headers, as recorded in tests/house/surface/.

    public_surface.py --build FOLDER              compares the build with the records
    public_surface.py --build FOLDER --write      records what is new, and takes out what CHANGELOG.md says is gone

A name that is recorded and no longer there is an error unless the newest version of CHANGELOG.md has it, in backticks, in
a line of its section "### Removed" or "### Changed": a symbol with all its namespaces, a key by its JSON Pointer, a
command as it is typed (`orbid run`), a header by its path. A line may name more at once: a class stands for its members,
a key for the keys and values below it, a command for its options. A new name is told and no error while the newest
version is "Unreleased"; a release has all of them recorded.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RECORDS = Path(__file__).resolve().parent / "surface"
sys.path.insert(0, str(ROOT / "tests" / "docs"))
from check_api import public_headers  # noqa: E402


# ---------------------------------------------------------------- what there is

def readable(symbol):
    """A demangled name with the usual words for std and Eigen types, the same from GCC and Clang and any binutils."""
    text = symbol.replace("__cxx11::", "").replace("[abi:cxx11]", "").replace("> >", ">>").replace("> >", ">>")
    for long, short in (("std::basic_string<char, std::char_traits<char>, std::allocator<char>>", "std::string"),
                        ("std::basic_string_view<char, std::char_traits<char>>", "std::string_view"),
                        ("Eigen::Matrix<double, -1, 1, 0, -1, 1>", "Eigen::VectorXd"),
                        ("Eigen::Matrix<double, -1, -1, 0, -1, -1>", "Eigen::MatrixXd")):
        text = text.replace(long, short)
    text = re.sub(r", (18446744073709551615ul|\(unsigned long\)18446744073709551615)(?=>)", "", text)
    # Allocators and deleters, the defaults of their containers, from the inside out.
    element = r"[^<>]*(?:<[^<>]*(?:<[^<>]*(?:<[^<>]*>[^<>]*)*>[^<>]*)*>[^<>]*)*"
    return re.sub(rf", std::(?:allocator|default_delete)<{element}>", "", text)


def symbols_of(library):
    """Strong symbols of namespace orbid, those in its namespaces detail left out, that the library defines for others.
    Weak ones, of templates and functions in headers, come and go with the optimiser."""
    listed = subprocess.run(["nm", "-D", "-C", "--defined-only", str(library)], check=True, capture_output=True, text=True)
    found = re.findall(r"^[0-9a-f]+ [TDBR] (orbid::.*)$", listed.stdout, re.MULTILINE)
    return {readable(name) for name in found if not re.match(r"[a-z0-9_:]*::detail::", name)}


def keys_of(schema):
    """JSON Pointers of all keys of jobs, NAME for a name of the user's and [] for an item, and "pointer = value" for
    each value of a list of them."""
    keys = set()

    def walk(node, path, inside):
        if not isinstance(node, dict):
            return
        if "$ref" in node:
            name = node["$ref"].rsplit("/", 1)[-1]
            if name not in inside:
                walk(schema["$defs"][name], path, inside + (name,))
        for key, value in node.get("properties", {}).items():
            if value is not False:
                keys.add(f"{path}/{key}")
                walk(value, f"{path}/{key}", inside)
        if isinstance(node.get("additionalProperties"), dict):
            keys.add(f"{path}/NAME")
            walk(node["additionalProperties"], f"{path}/NAME", inside)
        walk(node.get("items"), f"{path}/[]", inside)
        for word in ("oneOf", "anyOf", "allOf"):
            for part in node.get(word, []):
                walk(part, path, inside)
        for part in (node.get("then"), node.get("else"), *node.get("dependentSchemas", {}).values()):
            walk(part, path, inside)
        for value in [*node.get("enum", []), *([node["const"]] if "const" in node else [])]:
            keys.add(f"{path} = {json.dumps(value)}")

    walk(schema, "", ())
    return keys


def commands_of(program):
    """Commands and their options, as their help lists them."""
    def lines(*words):
        return subprocess.run([program, *words], check=True, capture_output=True, text=True).stdout

    overview = lines("help").split("usage:", 1)[1].split("first steps:", 1)[0]
    commands = re.findall(r"^  ([a-z]+)  ", overview, re.MULTILINE)
    options = {command: re.findall(r"^  (--[a-z-]+)", lines("help", command), re.MULTILINE) for command in commands}
    return set(commands) | {f"{command} {option}" for command in commands for option in options[command]}


def headers_of(build):
    """Installed headers that users include, by installing them; not those that docs/api.md says are for templates alone."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["cmake", "--install", str(build), "--prefix", folder, "--component", "development"], check=True,
                       capture_output=True)
        include = Path(folder) / "include"
        installed = {str(path.relative_to(include / "orbid")) for path in include.rglob("*.hpp")}
        return {f"orbid/{header}" for header in public_headers(ROOT, installed)}


def surface_of(build):
    program = str(build / "bin" / "orbid")
    schema = json.loads(subprocess.run([program, "schema"], check=True, capture_output=True, text=True).stdout)
    return {"symbols": symbols_of(build / "lib" / "liborbid.so"), "job_keys": keys_of(schema),
            "commands": commands_of(program), "headers": headers_of(build)}


# ---------------------------------------------------------------- what is said of it

def newest_version(changelog):
    """Title and text of the first version in CHANGELOG.md."""
    versions = re.split(r"^## +", changelog, flags=re.MULTILINE)
    if len(versions) < 2:
        raise SystemExit("CHANGELOG.md: no version (## ...)")
    title, _, text = versions[1].partition("\n")
    return title.strip(), text


def announced(changelog):
    """Names in backticks in the sections Removed and Changed of the newest version."""
    sections = re.split(r"^### +", newest_version(changelog)[1], flags=re.MULTILINE)[1:]
    said = [section for section in sections if re.match(r"(Removed|Changed)\s*$", section.partition("\n")[0])]
    return {name for section in said for name in re.findall(r"`([^`\n]+)`", section.partition("\n")[2])}


def named_by(kind, name, announcement):
    """Whether the announcement stands for the name: it is it, or what follows it there begins a member, a parameter list,
    a key below, a value or an option. A word that may stand in any sentence, or a whole namespace, announces nothing."""
    if kind == "headers":
        return name == announcement
    if kind == "commands":
        name = f"orbid {name}"
    if announcement.count("::") < 2 and kind == "symbols" or announcement == "orbid":
        return False
    return name.startswith(announcement) and (
        name == announcement or name[len(announcement):].startswith(("::", "(", "<", "/", " ")))


def compare(kind, recorded, present, changelog):
    """(gone without a word, gone as announced, new) as sorted lists of names."""
    names = announced(changelog)
    gone = recorded - present
    said = {name for name in gone if any(named_by(kind, name, announcement) for announcement in names)}
    return sorted(gone - said), sorted(said), sorted(present - recorded)


def read_record(folder, kind):
    path = folder / f"{kind}.txt"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {line for line in lines if line and not line.startswith("#")}


def write_record(folder, kind, names):
    text = "# Written by tests/house/public_surface.py --write\n" + "".join(f"{name}\n" for name in sorted(names))
    (folder / f"{kind}.txt").write_text(text, encoding="utf-8")


def check(surface, folder, changelog, write):
    """Prints what differs; returns whether nothing is wrong."""
    released = not newest_version(changelog)[0].startswith("Unreleased")
    right = True
    for kind, present in surface.items():
        if not present:
            print(f"public surface: {kind}: nothing found, the search is broken", file=sys.stderr)
            return False
        missing, said, new = compare(kind, read_record(folder, kind), present, changelog)
        for name in missing:
            print(f"public surface: {kind}: gone: {name}\n    name it in backticks under \"### Removed\" or "
                  f"\"### Changed\" of the newest version in CHANGELOG.md, or bring it back", file=sys.stderr)
        if new and not write:
            print(f"public surface: {kind}: {len(new)} new, not recorded yet: {', '.join(new[:5])}"
                  f"{', ...' if len(new) > 5 else ''}\n    record: tests/house/public_surface.py --build FOLDER --write",
                  file=sys.stderr if released else sys.stdout)
        right = right and not missing and (write or not released or not new)
        if write and not missing:
            write_record(folder, kind, present)
        print(f"public surface: {kind}: {len(present)} names, {len(missing)} gone without a word, {len(said)} as announced, "
              f"{len(new)} new")
    return right


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, required=True, help="build folder with liborbid and orbid built")
    parser.add_argument("--write", action="store_true", help="write the records anew")
    arguments = parser.parse_args()
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    return 0 if check(surface_of(arguments.build), RECORDS, changelog, arguments.write) else 1


if __name__ == "__main__":
    sys.exit(main())
