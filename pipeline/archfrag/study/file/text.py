"""Files of text that a study consists of: YAML with the scalars of version 1.2, and CSV."""

import csv
import io
import re
from pathlib import Path
from typing import Any

import yaml

from archfrag.errors import InputError, StudyError
from archfrag.files import read_text

LARGEST_FILE = 500_000  # [bytes] read in about three seconds
# Scalars of YAML 1.2's core schema; version 1.1 of PyYAML takes 2e-3 for text and no for false.
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
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        if isinstance(node, yaml.ScalarNode) and _CONTROL.search(node.value):
            raise _marked("text must hold no control characters", node)
        return super().construct_scalar(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in seen:
                raise _marked(f"the key {key.value[:40]} is given twice", key)
            if isinstance(key, yaml.ScalarNode):
                seen.add(key.value)
        return super().construct_mapping(node, deep)


for _kind, (_pattern, _first) in _PLAIN.items():
    _tag = f"tag:yaml.org,2002:{_kind}"
    _Loader.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})$"), _first)


def _marked(problem: str, node: yaml.Node) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)


def parse_value(text: str, place: str) -> Any:
    """A value in YAML.

    Raises
    ------
    StudyError
        With the `place` and the line.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = "" if mark is None else f"line {mark.line + 1}: "
        text = f"{line}{error.problem}; check indentation, colons and quotes"
        raise StudyError(f"{place}: {text}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise StudyError(f"{place}: is no YAML ({' '.join(str(error).split())[:200]})") from error


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file; errors are those of `parse_value`."""
    given = parse_value(read_text(path, LARGEST_FILE, StudyError, "the study file"), str(path))
    if not isinstance(given, dict):
        raise StudyError(f"{path}: must hold keys with values, such as id, arches and motions")
    return given


def read_cells(text: str) -> list[tuple[int, list[str]]]:
    """Rows of a table in CSV, stripped, each with the number of its line.

    Empty lines and those that begin with # are passed over. `InputError` if it is no CSV.
    """
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise InputError(f"is no table in CSV ({error})") from None
    return [(line, row) for line, row in rows if any(row) and not row[0].startswith("#")]
