"""Print what the code may be, and is, in size; exit with 1 where a row is exceeded.

A row that has to grow names in its commit what leaves.
"""

import ast
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pipeline" / "archfrag"
# By row: what is aimed at, and what is allowed until then. A row that shrinks lowers its limit.
LIMITS = {
    "lines": (26000, 35679), "modules": (130, 186), "functions": (1300, 1792),
    "classes": (120, 164),
    "imports inside functions": (40, 38), "names of classes that stand twice": (0, 0),
    "names of files that stand twice": (0, 0), "files of more than 400 lines": (0, 4),
    "packages at the top": (10, 10),
    "lines of arch": (1900, 2714), "lines of api and cli": (2100, 2177),
    "lines of export": (680, 798), "lines of fragility": (2500, 2408),
    "lines of motions": (4000, 4680), "lines of physics": (9000, 10251),
    "lines of report": (2600, 3687), "lines of simulation": (1600, 2010),
    "lines of study": (4300, 6148),
    "lines of archbench": (5900, 7039), "lines of tests": (17000, 23840),
}  # fmt: skip
ROOMS = {
    row.removeprefix("lines of "): row.removeprefix("lines of ").split(" and ")
    for row in LIMITS
    if row.startswith("lines of ") and row not in ("lines of archbench", "lines of tests")
}


def lines_of(folder: Path, *suffixes: str) -> int:
    """Return the lines of all files of a folder with one of some suffixes."""
    files = (path for path in folder.rglob("*") if path.suffix in suffixes)
    return sum(path.read_bytes().count(b"\n") for path in files)


def names_twice(names: list[str]) -> list[str]:
    """Return the names that stand more than once."""
    return sorted(name for name, count in Counter(names).items() if count > 1)


def measure() -> dict[str, int]:
    """Return each row's figure."""
    trees = {path: ast.parse(path.read_bytes()) for path in PACKAGE.rglob("*.py")}
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
    inside = {
        id(node)
        for function in functions
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    classes = [node.name for node in nodes if isinstance(node, ast.ClassDef)]
    files = [path.name for path in trees if not path.name.startswith("__")]
    twice = {"classes": names_twice(classes), "files": names_twice(files)}
    for kind, names in twice.items():
        if names:
            print(f"{kind} that stand twice: {', '.join(names)}")
    code = (".py", ".j2", ".css", ".js")
    return {
        "lines": lines_of(PACKAGE, *code),
        "modules": len(trees),
        "functions": len(functions),
        "classes": len(classes),
        "imports inside functions": len(inside),
        "names of classes that stand twice": len(twice["classes"]),
        "names of files that stand twice": len(twice["files"]),
        "files of more than 400 lines": sum(lines_of_file(path) > 400 for path in trees),
        "packages at the top": sum(path.is_dir() for path in PACKAGE.glob("[a-z]*")),
        "lines of archbench": lines_of(ROOT / "pipeline" / "archbench", *code),
        "lines of tests": lines_of(ROOT / "tests", ".py"),
        **{
            f"lines of {name}": sum(lines_of(PACKAGE / room, *code) for room in rooms)
            for name, rooms in ROOMS.items()
        },
    }


def lines_of_file(path: Path) -> int:
    """Return the lines of a file."""
    return path.read_bytes().count(b"\n")


def main() -> int:
    """Print all rows; return 1 if one is exceeded."""
    found = measure()
    print(f"{'':34} {'is':>6} {'most':>6} {'aim':>6}")
    for row, (aim, most) in LIMITS.items():
        exceeded = "  exceeded" if found[row] > most else ""
        print(f"{row:34} {found[row]:6} {most:6} {aim:6}{exceeded}")
    return int(any(found[row] > most for row, (_, most) in LIMITS.items()))


if __name__ == "__main__":
    sys.exit(main())
