"""YAML as study files hold it: version 1.2's numbers, bounds on size, one message for errors."""

import re
from pathlib import Path
from typing import Any

import yaml

from archfrag.errors import StudyError
from archfrag.files import read_text

LARGEST_FILE = 500_000  # [bytes] read in about three seconds
DEEPEST = 20  # lists in lists
# Scalars of YAML 1.2's core schema; whatever else is not in quotes is text.
_PLAIN = {
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    "bool": (r"true|True|TRUE|false|False|FALSE", list("tTfF")),
    # More digits than an integer of the machine holds are a float: inf in the end, no error.
    "int": (r"[-+]?[0-9]{1,18}", list("-+0123456789")),
    "float": (
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        list("-+.0123456789"),
    ),
}
_UNFIT = (
    "does not fit the lines before it; check its indentation (spaces, no tabs), and the colons, "
    "quotes and brackets up to there"
)
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


class _Loader(yaml.SafeLoader):
    """Safe YAML that raises nothing but `yaml.YAMLError`, whatever the text."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            alias = _short(str(event.anchor))
            raise _marked(f"aliases such as *{alias} have no place in a study file", event)
        tag = getattr(event, "tag", None)
        if tag is not None and tag != "!":
            raise _marked(f"tags such as {_short(tag)} have no place in a study file", event)
        self._depth += 1
        if self._depth > DEEPEST:
            raise _marked(f"more than {DEEPEST} levels of nesting", event)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(node, yaml.ScalarNode) and _CONTROL.search(node.value):
            raise _marked("text must hold no control characters", event)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise _marked(f"the key {_short(key)} is given twice", key_node)
            seen.add(key if isinstance(key, str) else None)
        return super().construct_mapping(node, deep)


for _kind, (_pattern, _first) in _PLAIN.items():
    _Loader.add_implicit_resolver(
        f"tag:yaml.org,2002:{_kind}", re.compile(rf"^(?:{_pattern})$"), _first
    )


def _marked(problem: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:40]}…"


def _problem(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        syntax = isinstance(error, yaml.scanner.ScannerError | yaml.parser.ParserError)
        return f"line {error.problem_mark.line + 1}: {_UNFIT if syntax else error.problem}"
    return " ".join(str(error).split())


def parse_value(text: str, place: str) -> Any:
    """A value in YAML; `place` is named where it is none."""
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise StudyError(f"{place}: {_problem(error)}") from error


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file."""
    text = read_text(path, LARGEST_FILE, StudyError, "the study file")
    given = parse_value(text, str(path))
    if not isinstance(given, dict):
        raise StudyError(f"{path}: must hold keys with values, such as id, arches and motions")
    return given


class _Dumper(yaml.SafeDumper):
    """Tuples as lists; in quotes what version 1.1 or 1.2 of YAML would not read as text."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


_Dumper.add_representer(tuple, lambda dumper, value: dumper.represent_list(value))
_Dumper.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(rf"^(?:{_PLAIN['float'][0]})$"), _PLAIN["float"][1]
)


def dump_yaml(value: Any) -> str:
    """Text of plain values, keys in their order."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=99)
