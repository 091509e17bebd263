"""What blocks of a study file are made of, and the messages that refuse a value."""

import difflib
import os
import re
import reprlib
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

LONGEST_NAME, LONGEST_PATH = 255, 3900  # [bytes] of file systems; results add to a path


class Section(BaseModel):
    """A block of a study file: no unknown keys, no conversions, no changes once read."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False,
        use_attribute_docstrings=True,
    )  # fmt: skip

    called: ClassVar[str] = "key"  # what its keys are to a user

    @model_validator(mode="before")
    @classmethod
    def _know_every_key(cls, given: Any) -> Any:
        for key in given if isinstance(given, dict) else ():
            if key not in cls.model_fields:
                allowed = list(cls.model_fields)
                facts = {"key": str(key), "allowed": allowed, "called": cls.called}
                raise PydanticCustomError("unknown_key", "unknown key", facts)
        return given


def refuse(text: str) -> PydanticCustomError:
    """A refusal in words: what must be, to follow the key and its value."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def refuse_key(key: str, text: str) -> PydanticCustomError:
    """A refusal of what stands under a key of the present block, by its own message."""
    return PydanticCustomError("refused_key", "", {"key": key, "text": text})


class Rising(Section):
    """A block with two ends."""

    @model_validator(mode="after")
    def _rise(self) -> Self:
        start, stop = (getattr(self, name) for name in ("start", "stop"))
        if stop <= start:
            raise refuse(f"must have stop above start = {start:g}, not {stop:g}")
        return self


def _usable_path(value: str) -> str:
    if value.startswith("~"):
        raise refuse("begins with the home folder of a user that there is not")
    if max(map(len, os.fsencode(value).split(b"/"))) > LONGEST_NAME:
        raise refuse(f"must have names of at most {LONGEST_NAME} bytes between its slashes")
    if len(os.fsencode(value)) > LONGEST_PATH:
        raise refuse(f"must have at most {LONGEST_PATH} bytes with the folders above it")
    return value


PathText = Annotated[str, Field(min_length=1), AfterValidator(_usable_path)]


# Our words for kinds of error in pydantic's list; of others its own, from "should" on.
_KINDS = {
    "string_unicode": "must be text in UTF-8",
    "less_than_equal": "must be less than or equal to {le:g}",
    "too_long": "must have at most {max_length} entries, not {actual_length}",
    "too_short": "must have {min_length} or more entries, not {actual_length}",
    "dict_type": "must be a mapping of keys to values",
    "refused": "{text}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be an integer",
    "int_from_float": "must be an integer",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "tuple_type": "must be a list",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "string_too_short": "must not be empty",
    "string_pattern_mismatch": (
        "must begin with a letter or a digit and hold only letters, digits and _ . + -"
    ),
}


_SHOWN = 80  # characters of a value


def key_path(parts: list[Any]) -> str:
    """Keys and indices as people write them: ``arches[0].radius``."""
    text = ""
    for part in parts:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else str(part)
    return text


def first_message(error: ValidationError, given: Any) -> str:
    """Message about the first thing that is wrong; about all that is missing if something is."""
    problems = error.errors(include_url=False)
    if problems[0]["type"] != "missing":
        return _message(problems[0], given)
    missing = [p for p in problems if p["type"] == "missing"]
    keys = [key_path(_place(p["loc"], "missing", given)) for p in missing]
    return f"{', '.join(dict.fromkeys(keys))} {'is' if len(keys) == 1 else 'are'} missing"


def option_message(error: ValidationError, given: Any) -> str:
    """The same with the options of a command in the place of keys."""
    message = first_message(error, given)
    keys = re.match(r"\w+(, \w+)*", message)
    assert keys is not None
    options = ", ".join(f"--{key.replace('_', '-')}" for key in keys[0].split(", "))
    return options + message[keys.end() :]


def _place(location: tuple[Any, ...], kind: str, given: Any) -> list[Any]:
    """The parts of a location that are keys of the file, without names of union members."""
    parts: list[Any] = []
    here = given
    for i, part in enumerate(location):
        last = i == len(location) - 1
        if (isinstance(here, Mapping) and part in here) or (
            isinstance(here, list | tuple) and isinstance(part, int) and part < len(here)
        ):
            here = here[part]
        elif not (last and kind == "missing"):
            continue
        parts.append(part)
    return parts


def _message(problem: Any, given: Any) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    parts = _place(problem["loc"], kind, given)
    if kind == "unknown_key":
        return _unknown(key_path([*parts, context["key"]]), **context)
    if kind == "refused_key":
        return f"{key_path([*parts, context['key']])}: {context['text']}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        name = context["discriminator"].strip("'")
        key = key_path([*parts, name])
        if kind == "union_tag_not_found":
            return f"{key} is missing"
        allowed = context["expected_tags"].replace("'", "")
        return f"{key} = {context['tag']} must be one of {allowed}"
    key = key_path(parts) or "the file"
    rule = re.sub("^.*? should ", "must ", _KINDS.get(kind, problem["msg"]).format(**context))
    value = problem["input"]
    if kind in ("int_type", "float_type") and isinstance(value, str) and _is_number(value):
        return f"{key} = {value!r} {rule} without quotes"
    shown = "" if isinstance(value, Mapping) else f" = {_shown(value)}"
    return f"{key}{shown} {rule}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _shown(value: Any) -> str:
    if isinstance(value, str) and not value.isprintable():
        return reprlib.repr(value)
    if isinstance(value, str):
        return value if len(value) <= _SHOWN else f"{value[:_SHOWN]}…"
    return "empty" if value is None else reprlib.repr(value)


def _unknown(path: str, key: str, allowed: list[str], called: str) -> str:
    if len(key) > _SHOWN or not key.isprintable():
        return f"{path[: -len(key)]}{_shown(key)} is no known {called}"
    close = difflib.get_close_matches(key, allowed, n=1, cutoff=0.6)
    hint = f"did you mean {close[0]}?" if close else f"allowed are {', '.join(allowed)}"
    return f"{path} is no known {called}; {hint}"
