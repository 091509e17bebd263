"""The study file: what its blocks have in common, its text, and the message on what is wrong."""

import contextlib
import difflib
import io
import os
import re
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import pandas as pd
import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

from archfrag.errors import InputError, StudyError

_SHOWN = 80  # characters of a value
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")
# Rules where pydantic's own words name its classes or a regular expression.
_RULES = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"),
                    "must be a mapping of keys to values"),
    "list_type": "must be a list",
    "string_type": "must be text; put it in quotes",
    "string_unicode": "must be text in UTF-8",
    "string_pattern_mismatch": (
        "must begin with a letter or a digit and hold only letters, digits and _ . + -"
    ),
}  # fmt: skip


class Section(BaseModel):
    """A block of a study file: no unknown keys, no conversions, no changes once read."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False,
        use_attribute_docstrings=True,
    )  # fmt: skip

    gone: ClassVar[dict[str, str]] = {}  # keys of earlier versions, with what to write instead

    @classmethod
    def allowed_keys(cls, given: Mapping[str, Any]) -> Iterable[str]:
        """Keys that a block may have; they may depend on what stands in it."""
        return cls.model_fields

    @model_validator(mode="before")
    @classmethod
    def _know_every_key(cls, given: Any) -> Any:
        allowed = list(cls.allowed_keys(given)) if isinstance(given, dict) else []
        for key in given if isinstance(given, dict) else ():
            if key in cls.gone:
                raise refuse(f"no longer exists; {cls.gone[key]}", key)
            if key not in allowed:
                hint = meant(str(key), allowed) or f"allowed are {', '.join(allowed)}"
                raise refuse(f"is not a known key; {hint}", _shown(str(key)))
        return given


def meant(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Ask whether the known name nearest to a wrong one was meant; empty if none is near."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"did you mean {close[0]}?" if close else ""


def refuse(text: str, *keys: str) -> PydanticCustomError:
    """An error of a value, or of keys in a block: `text` follows the value or the keys."""
    return PydanticCustomError("refused", "{text}", {"text": text, "keys": list(keys)})


def _absolute(value: str, info: ValidationInfo) -> str:
    """Make a path absolute: relative ones are below the folder in the validation's context."""
    path = os.path.expanduser(value)
    if path.startswith("~"):
        raise refuse("names the home folder of a user who does not exist")
    return os.path.abspath(os.path.join(info.context["folder"], path)) if info.context else path


PathText = Annotated[str, Field(min_length=1), AfterValidator(_absolute)]


def key_path(parts: Sequence[Any]) -> str:
    """Keys and indices as people write them: ``arches[0].radius``."""
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in parts).removeprefix(".")


def first_message(
    error: ValidationError, given: Any, written: Callable[[Sequence[Any]], str] = key_path
) -> str:
    """Message on the first thing that is wrong: key, value and rule; all keys that are missing.

    `given` is what was validated; `written` tells how a list of keys and numbers is written.
    """
    problems = error.errors()
    kind, value, context = problems[0]["type"], problems[0]["input"], problems[0].get("ctx", {})
    place = _place(problems[0]["loc"], given)
    keys, text = context.get("keys"), context.get("text", "must be given")
    if keys:
        return f"{', '.join(written([*place, key]) for key in keys)} {text}"
    if kind == "missing":
        locations = [problem["loc"] for problem in problems if problem["type"] == kind]
        lost = [written([*_place(location, given), location[-1]]) for location in locations]
        return f"{', '.join(lost)} {text}"
    if kind.startswith("union_tag"):
        key = written([*place, context["discriminator"].strip("'")])
        tags = context.get("expected_tags", "").replace("'", "")
        return f"{key} = {context['tag']} must be one of {tags}" if tags else f"{key} {text}"
    rule = re.sub("^.*? should ", "must ", _RULES.get(kind, problems[0]["msg"]))
    shown = "" if isinstance(value, Mapping) else f" = {_shown(value, kind.endswith('_type'))}"
    return f"{written(place) or 'the file'}{shown} {rule.replace(' after validation', '')}"


def _place(location: tuple[Any, ...], given: Any) -> list[Any]:
    """The parts of a location that are keys of the file, without names of union members."""
    parts = []
    for part in location:
        with contextlib.suppress(LookupError, TypeError):
            given = given[part]
            parts.append(part)
    return parts


def _shown(value: Any, quotes: bool = False) -> str:
    plain = isinstance(value, str) and value.isprintable() and not quotes
    text = value if plain else "empty" if value is None else reprlib.repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


class _Loader(yaml.SafeLoader):
    """YAML in which no key is given twice, and a number may be written as 2e-3."""

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        if isinstance(node, yaml.ScalarNode) and _CONTROL.search(node.value):
            problem = "text must hold no control characters"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
        return super().construct_scalar(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set[str]()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                problem = f"the key {key.value[:40]} is given twice"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)  # fmt: skip


def parse_value(text: str, place: str) -> Any:
    """Read a value in YAML; StudyError with the `place` and the line if it is not valid."""
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = "" if mark is None else f"line {mark.line + 1}: "
        what = f"{line}{error.problem}; check indentation, colons and quotes"
        raise StudyError(f"{place}: {what}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        why = " ".join(str(error).split())[:200]
        raise StudyError(f"{place}: is not valid YAML ({why})") from error


def read_csv(text: str) -> pd.DataFrame:
    """Text in CSV as a table of text; lines that begin with # are comments.

    InputError if it is not CSV.
    """
    content = io.StringIO(re.sub(r"^#.*$", "", text, flags=re.MULTILINE))
    try:
        table = pd.read_csv(content, dtype=str, keep_default_na=False)
        if not isinstance(table.index, pd.RangeIndex):
            raise pd.errors.ParserError("its rows have more cells than its first line")
    except (pd.errors.EmptyDataError, pd.errors.ParserError) as error:
        raise InputError(f"is not a table in CSV ({' '.join(str(error).split())})") from None
    return table.fillna("").apply(lambda column: column.str.strip()).rename(columns=str.strip)
