"""What kernels read and write, found in their syntax trees, as their docstrings tell it.

An effect is a path from an argument: ``state.clock``, or the argument where it is an array. What a
kernel hands to another counts as what that does with it.
``python -m tests.physics.kernels.effects`` writes the two lines into the docstrings of kernels.
"""

import ast
import re
import sys
from pathlib import Path

import archfrag

PACKAGE = Path(archfrag.__file__).parent
FOLDERS = ("physics", "motions")
LINES = re.compile(r"\n+ *Reads:.*?(?=\s*$)", re.DOTALL)
MOST = 6  # fields of one argument that are named; of more the argument is


def kernels():
    """Functions decorated by `kernel` or `inlined`, by name: file, node, whether inlined."""
    found = {}
    for folder in FOLDERS:
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                marks = {
                    getattr(mark, "id", "")
                    for mark in getattr(node, "decorator_list", [])
                }
                if marks & {"kernel", "inlined"}:
                    found.setdefault(node.name, []).append(
                        (path, node, "inlined" in marks)
                    )
    return found


class Effects(ast.NodeVisitor):
    """Paths that a kernel reads and writes; `known` are those of the others by name.

    `settled` are these after a first pass: what they neither read nor write there is a number.
    """

    def __init__(self, node, known, settled):
        self.known = known
        self.settled = settled
        self.reads = set()
        self.writes = set()
        self.paths = {each.arg: each.arg for each in node.args.args}
        for statement in node.body:
            self.visit(statement)

    def path(self, node):
        """Path of an expression from an argument; None if it is none."""
        if isinstance(node, ast.Name):
            return self.paths.get(node.id)
        if isinstance(node, ast.Attribute):
            if node.attr in ("shape", "size"):
                return None
            before = self.path(node.value)
            return before and f"{before}.{node.attr}"
        if isinstance(node, ast.Subscript):
            return self.path(node.value)
        return None

    def visit_Assign(self, node):
        self.visit(node.value)
        for target in node.targets:
            self.assign(target, node.value)

    def assign(self, target, value):
        if isinstance(target, ast.Tuple):
            parts = (
                value.elts
                if isinstance(value, ast.Tuple)
                else len(target.elts) * [None]
            )
            for one, part in zip(target.elts, parts, strict=False):
                self.assign(one, part)
        elif isinstance(target, ast.Name):
            self.paths.pop(target.id, None)
            if value is not None and (found := self.path(value)) is not None:
                self.paths[target.id] = found
        else:
            self.store(target)

    def store(self, target):
        if (found := self.path(target)) is not None:
            self.writes.add(found)
        if isinstance(target, ast.Subscript):
            self.visit(target.slice)

    def visit_AugAssign(self, node):
        self.visit(node.value)
        if not isinstance(node.target, ast.Name):
            self.visit(node.target)
            self.store(node.target)

    def visit_Subscript(self, node):
        if isinstance(node.ctx, ast.Load) and (found := self.path(node)) is not None:
            self.reads.add(found)
        self.visit(node.slice)
        if not isinstance(node.value, ast.Name | ast.Attribute):
            self.visit(node.value)

    def visit_Attribute(self, node):
        found = self.path(node)
        if found is not None and isinstance(node.ctx, ast.Load):
            self.reads.add(
                found
            )  # a number of a struct, or an array that is handed on whole
        elif found is None:
            self.visit(node.value)

    def visit_Call(self, node):
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        given = [self.path(each) for each in node.args]
        if name in self.known:
            names, reads, writes = self.known[name]
            places = dict(zip(names, given, strict=False))
            for own, theirs in ((self.reads, reads), (self.writes, writes)):
                for path in theirs:
                    root, dot, rest = path.partition(".")
                    if places.get(root):
                        own.add(f"{places[root]}{dot}{rest}")
            _, reads, writes = self.settled.get(name, ((), set(names), set()))
            used = {path.partition(".")[0] for path in reads | writes}
            numbers = {
                each
                for each, root in zip(node.args, names, strict=False)
                if root not in used
            }
            others = [
                each
                for each, path in zip(node.args, given, strict=True)
                if path is None or (isinstance(each, ast.Subscript) and each in numbers)
            ]
        else:
            others = node.args
        for each in others:
            self.visit(each)


def all_effects():
    """Effects of all kernels by name: arguments, what is read, what is written."""
    return _effects(_effects({}))


def _effects(settled):
    trees = kernels()
    known = {
        name: ([each.arg for each in found[0][1].args.args], set(), set())
        for name, found in trees.items()
    }
    changed = True
    while changed:
        changed = False
        for name, found in trees.items():
            for _, node, _ in found:
                effects = Effects(node, known, settled)
                names, reads, writes = known[name]
                if not (effects.reads <= reads and effects.writes <= writes):
                    known[name] = names, reads | effects.reads, writes | effects.writes
                    changed = True
    return known


def told(paths, names):
    """Tell paths by argument, all of whose fields are named if they are few."""
    parts = []
    for name in names:
        own = sorted(
            {path.partition(".")[2] for path in paths if path.split(".")[0] == name}
        )
        if own == [""] or len(own) > MOST:
            parts.append(name)
        elif own:
            own = [each for each in own if each]
            parts.append(
                f"{name}.{own[0]}" if len(own) == 1 else f"{name} ({', '.join(own)})"
            )
    return ", ".join(parts)


def lines_of(name, known):
    """Return the two lines of a kernel; of one that has no effect, none."""
    names, reads, writes = known[name]
    structs = {path.split(".")[0] for path in reads | writes}
    if not structs:
        return []
    found = []
    for word, paths in (("Reads", reads), ("Writes", writes)):
        text = f"{word}: {told(paths, names) or 'nothing'}."
        if len(text) > 94:
            roots = {path.split(".")[0] for path in paths}
            text = f"{word}: {', '.join(each for each in names if each in roots)}."
        found.append(text)
    return found


def write():
    """Write the lines into the docstrings."""
    known = all_effects()
    for path in sorted(
        p for folder in FOLDERS for p in (PACKAGE / folder).rglob("*.py")
    ):
        text = path.read_text(encoding="utf-8")
        lines = text.split("\n")
        edits = []
        for node in ast.parse(text).body:
            marks = {
                getattr(mark, "id", "") for mark in getattr(node, "decorator_list", [])
            }
            if "kernel" in marks and ast.get_docstring(node) is not None:
                edits.append((node.body[0].value, lines_of(node.name, known)))
        for doc, told_lines in reversed(edits):
            body = LINES.sub("", doc.value).rstrip()
            if told_lines:
                body += (
                    "\n\n" + "\n".join(f"    {each}" for each in told_lines) + "\n    "
                )
            elif "\n" in body:
                body += "\n    "
            new = f'    """{body}"""'.split("\n")
            lines[doc.lineno - 1 : doc.end_lineno] = new
        path.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(write())
