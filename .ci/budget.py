"""Print what the code may be, and is, in size; exit with 1 where a row is exceeded.

Code is counted in tokens: names, operators, numbers and strings outside docstrings and comments. A
row that has to grow names in pipeline/METHOD.md the capability that it paid for.
"""

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pipeline" / "archfrag"
# By row: what is aimed at, and what is allowed until then. A row that shrinks lowers its limit.
LIMITS = {
    "tokens": (266000, 313000),
    "tokens of arch": (20500, 22700),
    "tokens of api, cli and export": (20500, 24000),
    "tokens of fragility": (20500, 25600),
    "tokens of motions": (37000, 43000),
    "tokens of physics": (80000, 87200),
    "tokens of report": (29500, 34500),
    "tokens of simulation": (13000, 16400),
    "tokens of study": (43500, 52800),
    "tokens of archbench": (62972, 63100),
    "modules": (175, 191),
    "imports inside functions": (40, 40),
    "names of classes that stand twice": (0, 0),
    "names of files that stand twice": (0, 0),
    "packages at the top": (10, 10),
}
ROOMS = {
    row: row.removeprefix("tokens of ").replace(" and ", ", ").split(", ")
    for row in LIMITS
    if row.startswith("tokens of ") and row != "tokens of archbench"
}
COUNTED = (tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING)


def docstring_lines(tree: ast.AST) -> set[int]:
    """Return the lines of all docstrings of a module."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    owners = [node for node in ast.walk(tree) if isinstance(node, documented) and node.body]
    firsts = [node.body[0] for node in owners]
    texts = [
        first
        for first in firsts
        if isinstance(first, ast.Expr)
        and isinstance(first.value, ast.Constant)
        and isinstance(first.value.value, str)
    ]
    return {line for text in texts for line in range(text.lineno, (text.end_lineno or 0) + 1)}


def tokens_of(folder: Path) -> int:
    """Return the code tokens of all modules of a folder."""
    count = 0
    for path in folder.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        documented = docstring_lines(ast.parse(text))
        count += sum(
            token.type in COUNTED and token.start[0] not in documented
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
        )
    return count


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
    return {
        "tokens": tokens_of(PACKAGE),
        "modules": len(trees),
        "imports inside functions": len(inside),
        "names of classes that stand twice": len(twice["classes"]),
        "names of files that stand twice": len(twice["files"]),
        "packages at the top": sum(path.is_dir() for path in PACKAGE.glob("[a-z]*")),
        "tokens of archbench": tokens_of(ROOT / "pipeline" / "archbench"),
        **{
            row: sum(tokens_of(PACKAGE / room) for room in rooms) for row, rooms in ROOMS.items()
        },
    }


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
