"""The text of a study file: YAML with rules of its own, and keys that a command overrides."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from archfrag.errors import InputError
from archfrag.files import REAL, WHOLE, Named, read_text, relative_path

LARGEST_FILE = 500_000  # [bytes] read in about three seconds
PATHS = (
    "output",
    "table",
    "drawing",
    "index",
    "path",
    "inventory",
    "hazard",
)  # keys of paths
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


class _Loader(yaml.SafeLoader):
    """Loader of YAML with the words and numbers of version 1.2.

    A key that is given twice in a block is an error, and so are control characters.
    """

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode):
        if isinstance(node, yaml.ScalarNode) and CONTROL.search(node.value):
            problem = "text must hold no control characters"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        return super().construct_scalar(node)

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Any, Any]:
        seen = set[str]()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                problem = f"the key {key.value[:40]} is given twice"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


class _Dumper(yaml.SafeDumper):
    """Dumper of YAML that `_Loader` reads back unchanged: text such as 1e3 is quoted."""


_Loader.yaml_implicit_resolvers = {}  # of YAML 1.1, where 010 is 8, 1:30 is 90 and no is false
for _tag, _form, _first in (
    ("null", "~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", "true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", WHOLE, "-+0123456789"),
    ("float", rf"{REAL}|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+.0123456789"),
    ("merge", "<<", "<"),
):
    for _of in (_Loader, _Dumper):
        _pattern = re.compile(rf"(?:{_form})\Z")
        _of.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", _pattern, list(_first))


def yaml_of(keys) -> str:
    """Write keys of a study file as YAML, in their order."""
    return yaml.dump(keys, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def parse_value(text: str, place: str):
    """Read a value in YAML; InputError with the `place` and the line if it is not valid."""
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        why = " ".join(str(getattr(error, "problem", None) or error).split())[:200]
        mark = getattr(error, "problem_mark", None)
        line = "is not valid YAML" if mark is None else f"line {mark.line + 1}"
        raise InputError(
            f"{place}: {line}: {why}; check indentation and quotes"
        ) from error


def relative(value, folder: Path, key: str = ""):
    """Return a value of a study file with its paths made relative to a folder.

    `key` is the key of the value. Texts of the keys `PATHS` are paths.
    """
    if isinstance(value, dict):
        return {name: relative(inner, folder, name) for name, inner in value.items()}
    if isinstance(value, list):
        return [relative(inner, folder, key) for inner in value]
    return (
        relative_path(value, folder)
        if key in PATHS and isinstance(value, str)
        else value
    )


def read_keys(path: Path, overrides: Sequence[str] = ()) -> tuple[Named, Path]:
    """Read the keys of a study file as they are written; return them and the file's folder.

    Each of `overrides` is a text ``key.key=value`` that sets a key. InputError names the file or
    the override, and why.
    """
    folder = Path(os.path.realpath(path)).parent
    given = parse_value(
        read_text(path, LARGEST_FILE, InputError, "the study file"), str(path)
    )
    if not isinstance(given, dict):
        raise InputError(
            f"{path}: must hold keys with values, such as id, arches and motions"
        )
    seen = list[list[str]]()
    for text in overrides:
        key, equals, value_text = text.partition("=")
        parts = key.strip().split(".")
        if any(before[: len(parts)] == parts for before in seen):
            raise InputError(f"--set {text}: this place is set twice; set it once")
        seen.append(parts)
        if not equals or not all(parts):
            raise InputError(
                f"--set {text}: must be key=value, for example method.dt=0.0005"
            )
        block: Any = given
        place: Any = parts[0]
        value = parse_value(value_text, f"--set {key}")
        try:
            for part in parts[1:]:
                if isinstance(block, dict):
                    block.setdefault(place, {})
                block = block[place]
                place = int(part) if isinstance(block, list) else part
            block[place] = value
        except (LookupError, TypeError, ValueError):
            raise InputError(
                f"--set {text}: the study has no such place; only a block has keys, and a list "
                "items, numbered from 0"
            ) from None
    return given, folder
