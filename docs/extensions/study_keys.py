"""Tables of a study file's keys, from the schema of archfrag, at the marks of a page.

``<!-- keys: study -->`` stands for the top of the file, ``<!-- keys: Circular Segmental -->`` for
definitions of the schema, ``<!-- keys: * -->`` for all that no other mark of the page names.
"""

import json
import re
from collections.abc import Iterable

from sphinx.application import Sphinx

MARK = re.compile(r"<!-- keys: (.+?) -->")

WORDS = {"number": "number", "integer": "integer", "string": "text", "boolean": "true, false"}
# Keys that come first; all others follow in the order of the model.
FIRST = {
    "StudyKeys": "id title arches motions intensity design report risk output method limit_states",
    "ArchEntry": "id profile drawing table span rise radius embrace thickness voussoirs friction "
    "density dead_load recess vary",
    "Motions": "files index",
}
BOUNDS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}


def anchor(name: str) -> str:
    """Name of a definition that pages link to."""
    return f"study-{name.lower()}"


def values(schema: dict) -> str:
    """What a key may hold, as MyST."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[-1]
        return f"[{name}](#{anchor(name)})"
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    for several in ("oneOf", "anyOf"):
        if several in schema:
            parts = [values(one) for one in schema[several] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(parts))
    kind = schema.get("type")
    if kind == "array":
        inner = schema.get("items") or schema.get("prefixItems", [{}])[0]
        return f"list of {values(inner)}"
    if kind == "object":
        inner = schema.get("additionalProperties")
        of = f" of {values(inner)}" if isinstance(inner, dict) and inner else ""
        return f"mapping{of}"
    # Bounds beyond a million are against mistaken units; nobody reads them.
    shown = {key: sign for key, sign in BOUNDS.items() if 1e-6 < abs(schema.get(key, 1e9)) < 1e6
             or schema.get(key) == 0}  # fmt: skip
    bounds = ", ".join(f"{sign} {schema[key]:g}" for key, sign in shown.items())
    return " ".join(filter(None, (WORDS.get(kind, kind or "any"), bounds)))


def default(schema: dict, required: bool) -> str:
    """What holds if the key is not given."""
    if required:
        return "**required**"
    if "if not given" in schema.get("description", ""):
        return "see meaning"
    value = schema.get("default")
    if value is None or value == {} or "default" not in schema:
        return ""
    return "see there" if isinstance(value, dict) else f"`{json.dumps(value)}`"


def cell(text: str) -> str:
    """Text that may stand in a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|").replace("$", "\\$")


def ordered(name: str, keys: Iterable[str]) -> list[str]:
    """Keys of a definition in their order of importance."""
    from archfrag.study.file.schema import StudyKeys

    model = StudyKeys.model_json_schema()
    name = {"study": "StudyKeys"}.get(name, name)
    declared = [*FIRST.get(name, "").split(), *model["$defs"].get(name, model)["properties"]]
    return sorted(keys, key=declared.index)


def table(schema: dict, name: str, one: dict) -> list[str]:
    """Lines of a table of all keys of one definition."""
    required, lines = one.get("required", []), ["| key | values | if not given | meaning |"]
    lines.append("|---|---|---|---|")
    for key in ordered(name, one["properties"]):
        held = one["properties"][key]
        link = re.fullmatch(r"\[\w+\]\(#study-(\w+)\)", values(held))
        named = {each.lower(): each for each in schema["$defs"]}
        block = schema["$defs"][named[link[1]]] if link else {}
        meaning = held.get("description") or block.get("description", "")
        row = f"`{key}`", values(held), default(held, key in required), meaning
        lines.append("| " + " | ".join(cell(part) for part in row) + " |")
    return lines


def section(schema: dict, name: str) -> str:
    """Heading, description and keys of one definition."""
    one = schema if name == "study" else schema["$defs"][name]
    lines = table(schema, name, one) if one.get("properties") else []
    if name != "study":
        lines = [
            f"({anchor(name)})=",
            f"### {name}",
            "",
            cell(one.get("description", "")),
            "",
            *lines,
        ]
    return "\n".join(lines)


def write_tables(app: Sphinx, page: str, source: list[str]) -> None:
    """Replace the marks of a page; a mark that names no definition is an error."""
    if not MARK.search(source[0]):
        return
    from archfrag.study.file.schema import study_schema

    schema = json.loads(study_schema())
    named = {name for marked in MARK.findall(source[0]) for name in marked.split()}
    left = [name for name in sorted(schema["$defs"]) if name not in named]

    def tables(mark: re.Match) -> str:
        names = left if mark[1] == "*" else mark[1].split()
        return "\n\n".join(section(schema, name) for name in names)

    source[0] = MARK.sub(tables, source[0])


def setup(app: Sphinx) -> dict:
    app.connect("source-read", write_tables)
    return {"version": "4", "parallel_read_safe": True, "parallel_write_safe": True}
