"""Print how large the code is; exit with 1 where a row is over its limit.

Tokens are names, operators, numbers and strings outside comments and docstrings, so that layout
gains nothing. A room may exceed its limit by what the table "What the sizes paid for" of
pipeline/METHOD.md grants it, each line for a capability that it names.
"""

import ast
import io
import re
import statistics
import sys
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PIPELINE = ROOT / "pipeline"
TOKENS = {
    "archfrag": 266_000,
    "arch": 20_500,
    "simulation": 13_000,
    "physics": 80_000,
    "motions": 37_000,
    "fragility": 20_500,
    "study": 43_500,
    "report": 29_500,
    "api, cli, export": 20_500,
    "archbench": 62_974,
    "tests": 268_306,
}
OTHERS = {
    "modules": 175,
    "tokens a line": 9.5,
    "names a function": 14.5,
    "fmt: skip": 20,
    "conditional expressions inside another": 0,
    "walruses outside a loop's condition": 0,
    "packages at the top": 10,
    "imports inside functions": 40,
    "names of classes that stand twice": 0,
    "names of files that stand twice": 0,
    "files that name ties": 25,
    "files that name joints that give": 16,
    "files that name first shocks": 10,
}
# What is still allowed of rows whose limit is not reached yet; a row only ever goes down.
UNTIL_REACHED = {
    "archfrag": 286_000,
    "arch": 21_000,
    "simulation": 14_500,
    "motions": 38_800,
    "fragility": 24_500,
    "study": 48_100,
    "report": 30_100,
    "api, cli, export": 21_600,
    "names a function": 15.3,
}
CONCEPTS = {
    "ties": r"(^|_)ties?(_|$)|Ties?($|[A-Z])",
    "joints that give": r"stiffness|jointed|joint_keys|^soft$|(^|_)inset(_|$)|^Faces$",
    "first shocks": r"(?i)shock|^shaken$|^begins$",
}
KINDS = (tokenize.NAME, tokenize.OP, tokenize.NUMBER, tokenize.STRING)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)


class Source:
    """A Python file: its syntax tree, its tokens and the lines that have one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text)
        self.nodes = list(ast.walk(self.tree))
        documented = {
            line
            for node in self.nodes
            if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False)
            for line in range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)
        }
        tokens = tokenize.generate_tokens(io.StringIO(self.text).readline)
        rows = [token.start[0] for token in tokens if token.type in KINDS]
        self.lines = {row for row in rows if row not in documented}
        self.tokens = sum(row not in documented for row in rows)
        self.functions = self.of(ast.FunctionDef)

    def of(self, *kinds: type) -> list:
        """Return the nodes of some kinds."""
        return [node for node in self.nodes if isinstance(node, kinds)]

    def words(self) -> set[str]:
        """Return the names and short texts of the code."""
        names = [
            getattr(node, key, None)
            for key in ("id", "attr", "name", "arg")
            for node in self.of(
                ast.Name,
                ast.Attribute,
                ast.FunctionDef,
                ast.ClassDef,
                ast.arg,
                ast.keyword,
            )
        ]
        texts = [node.value for node in self.of(ast.Constant)]
        return {
            each for each in names + texts if isinstance(each, str) and len(each) < 40
        }


def names_of(function: ast.AST) -> int:
    """Return how many names a function uses."""
    nodes = list(ast.walk(function))
    arguments = {node.arg for node in nodes if isinstance(node, ast.arg)}
    return len(arguments | {node.id for node in nodes if isinstance(node, ast.Name)})


def twice(names: list[str]) -> int:
    """Return how many names stand more than once, and print them."""
    found = sorted(name for name, count in Counter(names).items() if count > 1)
    print(*found, sep="\n", end="\n" if found else "")
    return len(found)


def inside(sources: list[Source], outer: type, *inner: type) -> int:
    """Return how many nodes of some kinds stand below one of another kind."""
    return len(
        {
            id(node)
            for source in sources
            for above in source.of(outer)
            for node in ast.walk(above)
            if node is not above and isinstance(node, inner)
        }
    )


def free_walruses(source: Source) -> int:
    """Return how many assignments in an expression are in no condition of a loop."""
    conditions = [node.test for node in source.of(ast.While)]
    conditions += [test for node in source.of(ast.comprehension) for test in node.ifs]
    allowed = {id(node) for test in conditions for node in ast.walk(test)}
    return sum(id(node) not in allowed for node in source.of(ast.NamedExpr))


def measure() -> dict[str, float]:
    """Return each row's figure."""
    sources = [Source(path) for path in sorted((PIPELINE / "archfrag").rglob("*.py"))]
    top = [
        source.path.relative_to(PIPELINE / "archfrag").parts[0] for source in sources
    ]
    files = [
        source.path.name for source in sources if not source.path.name.startswith("__")
    ]
    classes = [node.name for source in sources for node in source.of(ast.ClassDef)]
    functions = [node for source in sources for node in source.functions]
    found: dict[str, float] = {"archfrag": sum(source.tokens for source in sources)}
    for row in list(TOKENS)[1:-2]:
        rooms = row.split(", ")
        own = (source.tokens for source, room in zip(sources, top) if room in rooms)
        found[row] = sum(own)
    for row, folder in (
        ("archbench", PIPELINE / "archbench"),
        ("tests", ROOT / "tests"),
    ):
        found[row] = sum(Source(path).tokens for path in folder.rglob("*.py"))
    lines = sum(len(source.lines) for source in sources)
    skips = sum(
        len(re.findall("# fmt: (?:skip|off)", source.text)) for source in sources
    )
    found |= {
        "modules": len(sources),
        "tokens a line": round(found["archfrag"] / lines, 1),
        "names a function": round(statistics.mean(map(names_of, functions)), 1),
        "fmt: skip": skips,
        "conditional expressions inside another": inside(sources, ast.IfExp, ast.IfExp),
        "walruses outside a loop's condition": sum(map(free_walruses, sources)),
        "packages at the top": len({each for each in top if not each.endswith(".py")}),
        "imports inside functions": inside(
            sources, ast.FunctionDef, ast.Import, ast.ImportFrom
        ),
        "names of classes that stand twice": twice(classes),
        "names of files that stand twice": twice(files),
    }
    words = [source.words() for source in sources]
    for concept, pattern in CONCEPTS.items():
        named = sum(any(re.search(pattern, word) for word in each) for each in words)
        found[f"files that name {concept}"] = named
    return found


def granted() -> Counter[str]:
    """Return the tokens that METHOD.md grants to rooms, and to the package for all of them."""
    text = (PIPELINE / "METHOD.md").read_text(encoding="utf-8")
    section = text.partition("## What the sizes paid for")[2].partition("\n## ")[0]
    found: Counter[str] = Counter()
    for room, tokens, capability in re.findall(
        r"\| `(.+?)` \| ([\d,]+) \| (.+?) \|", section
    ):
        if room not in TOKENS or not capability.strip():
            raise SystemExit(
                f"METHOD.md: {room} is no row of .ci/budget.py, or names nothing"
            )
        found[room] += int(tokens.replace(",", ""))
    found["archfrag"] += sum(found[room] for room in list(TOKENS)[1:-2])
    return found


def main() -> int:
    """Print all rows; return 1 if one is over its limit."""
    extra = granted()
    limits = {row: most + extra[row] for row, most in TOKENS.items()} | OTHERS
    over = 0
    for row, is_now in measure().items():
        most = limits[row]
        if row in UNTIL_REACHED:
            most = max(most, UNTIL_REACHED[row] + extra[row])
        exceeded = is_now > most
        over += exceeded
        kind = "tokens of " if row in TOKENS else ""
        later = f"  (until then {most})" if most > limits[row] else ""
        print(
            f"{kind + row:40} {is_now:8} {limits[row]:8}{later}{'  exceeded' * exceeded}"
        )
    return int(over > 0)


if __name__ == "__main__":
    sys.exit(main())
