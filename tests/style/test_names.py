"""Names in docstrings, comments and METHOD.md, and files that any page names, exist."""

import ast
import builtins
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PIPELINE = ROOT / "pipeline"
SOURCES = sorted(
    path
    for folder in ("archfrag", "archbench")
    for path in (PIPELINE / folder).rglob("*.py")
)
PAGES = [
    PIPELINE / "METHOD.md",
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
SUFFIXES = "(?:py|md|csv|toml|ya?ml|smk|json|js|css|j2|html|txt|svg|dxf)"
FILE = re.compile(rf"[\w./-]*\w\.{SUFFIXES}")
OURS = re.compile(
    rf"(?<![\w./-])(?:tests|pipeline|docs|configs|records)/[\w./-]+\.{SUFFIXES}\b"
)
NAME = re.compile(r"([A-Za-z_]\w*(?:\.\w+)*)(?:\(.*\))?")
# Symbols of formulas, files of other people, and examples of what files have in them.
EXAMPLES = {
    "r_k",
    "k_sin.c",
    "k_cos.c",
    "poe_50",
    "poe_50_NAME",
    "rate_NAME",
    "NET.STA.xml",
    "EW1",
    "S45E",
    "T0.100S",
    "records/notes.txt",
}
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef


def prose(source):
    """Docstrings and comments of a module."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and (
            text := ast.get_docstring(node, clean=False)
        ):
            yield text
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def code(source):
    """Nodes of a module without its docstrings, which must not vouch for themselves."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return list(ast.walk(tree))


@cache
def known():
    """Names that code uses, words of its short texts and tables, and members of classes."""
    names = set(dir(builtins))
    members = {}
    for path in SOURCES:
        names.update(path.relative_to(PIPELINE).with_suffix("").parts)
        for node in code(path.read_text("utf-8")):
            for field in ("id", "attr", "arg", "name", "asname", "module"):
                if isinstance(text := getattr(node, field, None), str):
                    names.update(text.split("."))
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                names.update(
                    re.findall(r"\w+", node.value) if len(node.value) < 100 else ()
                )
            if isinstance(node, ast.ClassDef):
                inside = list(ast.walk(node))
                members.setdefault(node.name, set()).update(
                    *(
                        [getattr(n, field, "")]
                        for n in inside
                        for field in ("id", "attr", "name")
                    ),
                    [base.id for base in node.bases if isinstance(base, ast.Name)],
                )
    for suffix in ("toml", "csv"):
        for path in (PIPELINE / "archfrag").rglob(f"*.{suffix}"):
            names.update(re.findall(r"\w+", path.read_text("utf-8")))
    return names, members


@cache
def files():
    """Files of the project, and names of files that its code writes."""
    places = [
        ROOT / name for name in ("configs", "docs", "pipeline", "records", "tests")
    ]
    found = {
        path.relative_to(ROOT).as_posix()
        for place in places
        for path in place.rglob("*.*")
    }
    written = "\n".join(path.read_text("utf-8") for path in SOURCES)
    texts = re.findall(r'"([^"\n]*)"', written)
    found |= {name for text in texts for name in FILE.findall(text)}
    return found | {path.name for path in ROOT.glob("*.*")}


def members_of(name):
    """Members of a class of ours and of its bases."""
    found = set()
    waiting = [name]
    while waiting:
        own = known()[1].get(waiting.pop(), set()) - found
        waiting += own & known()[1].keys()
        found |= own
    return found


def is_known(name):
    names, members = known()
    first, *rest = name.split(".")
    if rest and first in members and rest[0] not in members_of(first):
        return False
    return {first, *rest} <= names


def is_file(name):
    return any(f"/{each}".endswith(f"/{name.removeprefix('./')}") for each in files())


def unknown(text, quoted=True):
    """Names in backticks, and files of the project with or without them, that do not exist."""
    for name in re.findall(r"`{1,2}([^`\n]+)`{1,2}", text) if quoted else ():
        if FILE.fullmatch(name):
            found = is_file(name)
        elif match := NAME.fullmatch(name):
            found = is_known(match[1])
        else:
            continue
        if not found and name not in EXAMPLES:
            yield name
    yield from (
        name
        for name in OURS.findall(text)
        if name not in EXAMPLES and not is_file(name)
    )


def test_names_that_do_not_exist_are_noticed():
    text = (
        "`Arch.from_dxf`, ``Arch.of_nothing``, `archfrag.arch.model` and `arch.nowhere_at_all` in "
        "`lost_file.py`, tests/lost/test_lost.py, tests/style/test_names.py, `onset(arch)`, "
        "`absent(x)`"
    )
    assert list(unknown(text)) == [
        "Arch.of_nothing",
        "arch.nowhere_at_all",
        "lost_file.py",
        "absent(x)",
        "tests/lost/test_lost.py",
    ]


@pytest.mark.parametrize("package", ["archfrag", "archbench"])
def test_docstrings_and_comments_name_what_exists(package):
    found = {
        str(path.relative_to(PIPELINE)): lost
        for path in SOURCES
        if path.is_relative_to(PIPELINE / package)
        if (
            lost := [
                n for text in prose(path.read_text("utf-8")) for n in unknown(text)
            ]
        )
    }
    assert found == {}


def test_pages_name_files_that_exist_and_the_method_names_too():
    found = {
        str(page.relative_to(ROOT)): lost
        for page in PAGES
        if (lost := list(unknown(page.read_text("utf-8"), page.name == "METHOD.md")))
    }
    assert found == {}
