"""Blocks of a study file, and the one message that says what is wrong with a value."""

import difflib
import os
import re
import reprlib
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

LONGEST_NAME, LONGEST_PATH = 255, 3900  # [bytes] of file systems; results add to a path
_SHOWN = 80  # characters of a value


class Section(BaseModel):
    """A block of a study file: no unknown keys, no conversions, no changes once read."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False,
        use_attribute_docstrings=True,
    )  # fmt: skip

    called: ClassVar[str] = "key"  # what its keys are to a user
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
                raise refuse_key(key, f"is gone; {cls.gone[key]}")
            if key not in allowed:
                close = difflib.get_close_matches(str(key), allowed, n=1)
                names = f"allowed are {', '.join(allowed)}"
                hint = f"did you mean {close[0]}?" if close else names
                raise refuse_key(_shown(str(key)), f"is no known {cls.called}; {hint}")
        return given


def refuse(text: str) -> PydanticCustomError:
    """A refusal in words: what must be, to follow the key and its value."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def refuse_key(key: str, text: str) -> PydanticCustomError:
    """A refusal of a key of the present block: what it must be, or that it may not be there."""
    return PydanticCustomError("refused_key", "{text}", {"keys": [key], "text": text})


def refuse_missing(keys: Iterable[str]) -> PydanticCustomError:
    """A refusal of a block in which keys are missing."""
    return PydanticCustomError("missing", "missing", {"keys": list(keys)})


def _usable_path(value: str) -> str:
    if value.startswith("~"):
        raise refuse("begins with the home folder of a user that there is not")
    if max(map(len, os.fsencode(value).split(b"/"))) > LONGEST_NAME:
        raise refuse(f"must have names of at most {LONGEST_NAME} bytes between its slashes")
    if len(os.fsencode(value)) > LONGEST_PATH:
        raise refuse(f"must have at most {LONGEST_PATH} bytes with the folders above it")
    return value


PathText = Annotated[str, Field(min_length=1), AfterValidator(_usable_path)]

# Where pydantic's own words name its classes or a regular expression.
_KINDS = {
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "dict_type": "must be a mapping of keys to values",
    "tuple_type": "must be a list",
    "string_unicode": "must be text in UTF-8",
    "string_pattern_mismatch": (
        "must begin with a letter or a digit and hold only letters, digits and _ . + -"
    ),
}


def first_message(error: ValidationError, given: Any, written: Any = None) -> str:
    """Message about the first thing that is wrong: key, value and rule; all keys that are missing.

    Parameters
    ----------
    error : ValidationError
    given : object
        What was validated.
    written : callable, optional
        How a list of keys and numbers is written; ``arches[0].radius`` if not given.
    """
    path = written or key_path
    found = [(_place(p["loc"], given), p) for p in error.errors(include_url=False)]
    first = found[0][0]
    # Of the members of a union the one that the value comes nearest to.
    alike = [each for each in found if each[0][: len(first)] == first]
    place, problem = max(alike, key=lambda f: (len(f[0]), not f[1]["type"].endswith("_type")))
    kind, context = problem["type"], problem.get("ctx", {})
    if kind == "missing":
        lost = [[*p, k] for p, e in found if e["type"] == kind
                for k in e.get("ctx", {}).get("keys", e["loc"][-1:])]  # fmt: skip
        return f"{', '.join(map(path, lost))} {'are' if lost[1:] else 'is'} missing"
    if kind.startswith("union_tag"):
        tags = context.get("expected_tags", "").replace("'", "")
        key = path([*place, context["discriminator"].strip("'")])
        return f"{key} = {context['tag']} must be one of {tags}" if tags else f"{key} is missing"
    if kind == "refused_key":
        return f"{path([*place, *context['keys']])} {context['text']}"
    rule = re.sub("^.*? should ", "must ", _KINDS.get(kind, problem["msg"]))
    given, quotes = problem["input"], kind.endswith("_type")
    value = "" if isinstance(given, Mapping) else f" = {_shown(given, quotes)}"
    return f"{path(place) or 'the file'}{value} {rule.replace(' after validation', '')}"


def key_path(parts: list[Any]) -> str:
    """Keys and indices as people write them: ``arches[0].radius``."""
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in parts).removeprefix(".")


def option_path(parts: list[Any]) -> str:
    """The same as an option of a command: ``--dead-load``."""
    return f"--{parts[0].replace('_', '-')}"


def _place(location: tuple[Any, ...], given: Any) -> list[Any]:
    """The parts of a location that are keys of the file, without names of union members."""
    parts: list[Any] = []
    for part in location:
        if (isinstance(given, Mapping) and part in given) or (
            isinstance(given, list | tuple) and isinstance(part, int) and part < len(given)
        ):
            given = given[part]
            parts.append(part)
    return parts


def _shown(value: Any, quotes: bool = False) -> str:
    plain = isinstance(value, str) and value.isprintable() and not quotes
    text = value if plain else "empty" if value is None else reprlib.repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
