"""What kernels read and write, found in their syntax trees, as their docstrings tell it.

An effect is a path from an argument: ``state.clock``, or the argument where it is an array. What a
kernel hands to another counts as what that does with it; kernels are known by module and import.
A docstring names the fields. A line of more than eight would tell nobody anything: it is left out.
``python -m tests.physics.kernels.effects`` writes the lines into the docstrings of kernels.
"""

import ast
import re
import sys
from pathlib import Path

import archfrag

PACKAGE = Path(archfrag.__file__).parent
FOLDERS = ("physics", "motions")
LINES = re.compile(r"\n+ *(Reads|Writes):.*?(?=\s*$)", re.DOTALL)
MOST = 8  # fields that one line names
WIDTH = 94


def sources():
    """Return the text of all modules that may hold kernels, by their dotted names."""
    paths = [
        path for name in FOLDERS for path in sorted((PACKAGE / name).rglob("*.py"))
    ]
    parts = {
        path: path.relative_to(PACKAGE.parent).with_suffix("").parts for path in paths
    }
    return {".".join(parts[path]): path.read_text(encoding="utf-8") for path in paths}


def kernels(texts):
    """Return the kernels by module and name: node, imported names, whether inlined."""
    found = {}
    for module, text in texts.items():
        tree = ast.parse(text)
        imported = {
            each.asname or each.name: (node.module, each.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for each in node.names
        }
        for node in tree.body:
            marks = {
                getattr(mark, "id", "") for mark in getattr(node, "decorator_list", [])
            }
            if marks & {"kernel", "inlined"}:
                found[module, node.name] = node, imported, "inlined" in marks
    return found


def laws(texts, trees):
    """Return the kernels that laws bind to their fields, as ``RIGID = Law(pose=...)``."""
    found = {}
    for module, text in texts.items():
        for node in ast.parse(text).body:
            call = getattr(node, "value", None)
            if getattr(getattr(call, "func", None), "id", "") == "Law":
                imported = next(
                    each for key, (_, each, _) in trees.items() if key[0] == module
                )
                for bound in call.keywords:
                    key = kernel_of(bound.value, module, imported)
                    found.setdefault(bound.arg, []).append(key)
    return found


def kernel_of(node, module, imported):
    """Return module and name of a function that a module names."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return ".".join(imported.get(node.value.id, ())), node.attr
    name = getattr(node, "id", "")
    return imported.get(name, (module, name))


class Effects(ast.NodeVisitor):
    """Paths that a kernel reads and writes.

    `known` are those of all kernels by module and name: arguments, reads, writes. `settled` are
    these after a first pass: what they neither read nor write there is a number. `bound` are the
    kernels of laws by field.
    """

    def __init__(self, key, trees, bound, known, settled):
        node, self.imported, _ = trees[key]
        self.module = key[0]
        self.laws = bound
        self.known = known
        self.settled = settled
        self.reads = set()
        self.writes = set()
        self.paths = {each.arg: each.arg for each in node.args.args}
        for statement in node.body:
            self.visit(statement)

    def path(self, node):
        """Return the path of an expression from an argument; None without one."""
        if isinstance(node, ast.Name):
            return self.paths.get(node.id)
        if isinstance(node, ast.Attribute):
            if node.attr in ("shape", "size"):
                return None
            before = self.path(node.value)
            return before and f"{before}.{node.attr}"
        return self.path(node.value) if isinstance(node, ast.Subscript) else None

    def visit_Assign(self, node):
        self.visit(node.value)
        for target in node.targets:
            self.assign(target, node.value)

    def assign(self, target, value):
        if isinstance(target, ast.Tuple):
            parts = getattr(value, "elts", len(target.elts) * [None])
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
        func = node.func
        keys = [kernel_of(func, self.module, self.imported)]
        if isinstance(func, ast.Attribute) and getattr(func.value, "attr", "") == "law":
            keys = self.laws.get(func.attr, [])
        keys = [key for key in keys if key in self.known]
        for key in keys:
            self.call(key, node.args)
        for each in node.args if not keys else ():
            self.visit(each)

    def call(self, key, args):
        names, *effects = self.known[key]
        given = dict(zip(names, map(self.path, args), strict=False))
        for own, theirs in zip((self.reads, self.writes), effects, strict=True):
            for path in theirs:
                root, dot, rest = path.partition(".")
                if given.get(root):
                    own.add(f"{given[root]}{dot}{rest}")
        _, reads, writes = self.settled.get(key, ((), set(names), set()))
        used = {path.partition(".")[0] for path in reads | writes}
        for each, root in zip(args, names, strict=False):
            number = isinstance(each, ast.Subscript) and root not in used
            if number or self.path(each) is None:
                self.visit(each)


def all_effects(texts):
    """Return the effects of all kernels: arguments, what is read, what is written."""
    trees = kernels(texts)
    bound = laws(texts, trees)
    return _effects(trees, bound, _effects(trees, bound, {}))


def _effects(trees, bound, settled):
    known = {
        key: ([each.arg for each in node.args.args], set(), set())
        for key, (node, *_) in trees.items()
    }
    changed = True
    while changed:
        changed = False
        for key in trees:
            found = Effects(key, trees, bound, known, settled)
            _, reads, writes = known[key]
            changed |= not (found.reads <= reads and found.writes <= writes)
            reads |= found.reads
            writes |= found.writes
    return known


def lines_of(names, reads, writes):
    """Return the lines of a kernel: fields by argument, none where there are too many."""
    lines = []
    for word, paths in (("Reads", reads), ("Writes", writes)):
        parts = []
        for name in names:
            fields = sorted(
                path.partition(".")[2] for path in paths if path.split(".")[0] == name
            )
            fields = [each for each in fields if each]
            several = f"{name} ({', '.join(fields)})" if fields else name
            if name in paths or fields:
                parts.append(f"{name}.{fields[0]}" if len(fields) == 1 else several)
        text = f"{word}: {', '.join(parts)}."
        if parts and len(paths) <= MOST and len(text) <= WIDTH:
            lines.append(text)
    return lines


def write():
    """Write the lines into the docstrings."""
    texts = sources()
    trees = kernels(texts)
    known = all_effects(texts)
    for module, text in texts.items():
        lines = text.split("\n")
        own = [(*trees[key], key) for key in trees if key[0] == module]
        for node, _, inlined, key in sorted(own, key=lambda each: -each[0].lineno):
            if inlined or ast.get_docstring(node) is None:
                continue
            doc = node.body[0].value
            body = LINES.sub("", doc.value).rstrip()
            told = "".join(f"\n    {each}" for each in lines_of(*known[key]))
            body += f"\n{told}" if told else ""
            end = "\n    " if "\n" in body else ""
            lines[doc.lineno - 1 : doc.end_lineno] = f'    """{body}{end}"""'.split(
                "\n"
            )
        path = PACKAGE.parent.joinpath(*module.split(".")).with_suffix(".py")
        path.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(write())
