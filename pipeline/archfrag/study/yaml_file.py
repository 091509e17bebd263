"""YAML with floats as people write them, doubled keys refused, and errors in one sentence."""

import re
from pathlib import Path
from typing import Any

import yaml

from archfrag.errors import StudyError


class _Loader(yaml.SafeLoader):
    """Safe YAML; 1e-6 is a number (YAML 1.2), a key given twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"the key {key} is given twice", problem_mark=key_node.start_mark
                )
            seen.add(key if isinstance(key, str) else None)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def _problem(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        return f"line {error.problem_mark.line + 1}: {error.problem}"
    return " ".join(str(error).split())


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file.

    Raises
    ------
    StudyError
        If it cannot be read, is no YAML (with the line), or holds no mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise StudyError(f"the study file {path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StudyError(f"the study file {path} is no text in UTF-8") from error
    try:
        given = yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise StudyError(f"{path}: {_problem(error)}") from error
    if not isinstance(given, dict):
        raise StudyError(f"{path}: must hold keys with values, such as id, arches and motions")
    return given


def parse_value(text: str, place: str) -> Any:
    """A value in YAML.

    Raises
    ------
    StudyError
        Naming `place`.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise StudyError(f"{place}: {_problem(error)}") from error


class _Dumper(yaml.SafeDumper):
    """Tuples as lists."""


_Dumper.add_representer(tuple, lambda dumper, value: dumper.represent_list(value))


def dump_yaml(value: Any) -> str:
    """Text of plain values, keys in their order."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=99)
