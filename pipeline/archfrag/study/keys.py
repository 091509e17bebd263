"""Blocks of a study file: what they have in common, and the message on what is wrong in one."""

import ast
import contextlib
import difflib
import inspect
import os
import re
import reprlib
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from archfrag.errors import InputError, StabilityError
from archfrag.files import Named, absolute
from archfrag.study.yaml_text import CONTROL

# Rules where pydantic's own words name its classes or a regular expression.
_RULES = {
    "union_tag_not_found": "must be given",
    "dict_type": "must be a block of keys with their values",
    "string_type": "must be text; put it in quotes",
    "string_unicode": "must be text in UTF-8",
    "string_pattern_mismatch": "must begin with a letter or a digit and hold only letters, digits "
    "and _ . + -",
}


class Section(BaseModel):
    """A block of a study file: no unknown keys, no conversions, no changes once read."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True
    )

    # Allowed keys may depend on the value of the key `kind_key`, or on which key of `kinds` is
    # there. Those of `common` are always allowed. By that value or that key, `kinds` has the keys
    # that must be there, and those that may.
    kind_key: ClassVar[str] = ""
    common: ClassVar[tuple[str, ...]] = ()
    kinds: ClassVar[dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {}

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, given):
        if not isinstance(given, dict):
            return check_block(given, next(iter(cls.model_fields), ""))
        by_key = next((key for key in cls.kinds if key in given), None)
        own = (cls.kind_key,) if cls.kinds and by_key is None else ()
        kind = by_key or str(given.get(cls.kind_key))
        needs, may = cls.kinds.get(kind, (own, tuple(cls.model_fields)))
        allowed = dict.fromkeys((*own, *cls.common, *needs, *may))
        required = [
            name for name, about in cls.model_fields.items() if about.is_required()
        ]
        for key in given:
            if key not in allowed:
                hint = meant(str(key), allowed) or f"allowed are {', '.join(allowed)}"
                raise refuse(f"is not a known key; {hint}", _shown(str(key)))
        needed = dict.fromkeys((*required, *needs))
        missing = [key for key in needed if given.get(key) is None]
        if missing:
            raise refuse("must be given", *missing)
        return given

    @classmethod
    def __get_pydantic_json_schema__(cls, core, handler) -> Named:
        """Return the JSON schema of a block; the text below each key is its description.

        pydantic could read these texts itself, but would do so at every start.
        """
        found: Named = handler(core)
        keys = handler.resolve_ref_schema(found).get("properties", {})
        with contextlib.suppress(OSError):  # of a class that is made from a table
            own: Any = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
            for key, text in pairwise(own.body):
                if isinstance(key, ast.AnnAssign) and isinstance(text, ast.Expr):
                    keys[ast.unparse(key.target)]["description"] = inspect.cleandoc(
                        ast.literal_eval(text.value)
                    )
        return found


def meant(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return the question whether the nearest known name was meant; empty if none is near.

    `name` is the wrong name; `cutoff` is the least similarity, from 0 to 1.
    """
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"did you mean {close[0]}?" if close else ""


def check_block(given, key: str):
    """Return a block as it is given, or refuse a value that is no block.

    `key` is a key of such a block, for the message; empty if it has none.
    """
    if isinstance(given, dict | Section):
        return given
    raise refuse("must be a block of keys" + f", such as {{{key}: ...}}" * bool(key))


def refuse(text: str, *keys: str) -> PydanticCustomError:
    """Return the error that refuses a value, or `keys` of a block.

    Its message is the value or the keys, followed by `text`.
    """
    return PydanticCustomError("refused", "{text}", {"text": text, "keys": list(keys)})


def _absolute(value: str, info) -> str:
    """Return a path as an absolute one.

    A relative path is below ``info.context["folder"]``; without a context it stays relative. `~`
    is expanded, and refused if that user does not exist.
    """
    path = os.path.expanduser(value)
    if path.startswith("~"):
        raise refuse("names the home folder of a user who does not exist")
    return absolute(path, info.context["folder"]) if info.context else path


PathText = Annotated[str, Field(min_length=1), AfterValidator(_absolute)]


def key_path(parts: Sequence[Any]) -> str:
    """Return the keys and indices as people write them: ``arches[0].radius``."""
    written = (f"[{p}]" if isinstance(p, int) else f".{p}" for p in parts)
    return "".join(written).removeprefix(".")


def first_message(
    error: ValidationError,
    given,
    written: Callable[[Sequence[Any]], str] = key_path,
) -> str:
    """Return the message on the first thing that is wrong: key, value and rule.

    `given` is what was validated; `written` turns a list of keys and numbers into text.
    """
    first = error.errors()[0]
    kind = first["type"]
    value = first["input"]
    context = first.get("ctx", {})
    place: list[Any] = []
    # Without names of union members, which are no keys of the file.
    for part in first["loc"]:
        with contextlib.suppress(LookupError, TypeError):
            given = given[part]
            place.append(part)
    keys = [written([*place, key]) for key in context.get("keys", ())]
    if keys:
        return f"{', '.join(keys)} {context['text']}"
    shown = f" = {_shown(value, kind.endswith('_type'))}"
    if isinstance(value, Mapping):
        shown = ""
    rule = re.sub("^.*? should ", "must ", _RULES.get(kind, first["msg"]))
    if kind.startswith("union_tag"):
        place.append(context["discriminator"].strip("'"))
        if "tag" in context:
            shown = f" = {context['tag']}"
            rule = f"must be one of {context['expected_tags']}".replace("'", "")
    return (
        f"{written(place) or 'the file'}{shown} {rule.replace(' after validation', '')}"
    )


def _shown(value, quotes: bool = False) -> str:
    text = "empty" if value is None else reprlib.repr(value)
    if isinstance(value, str) and value.isprintable() and not quotes:
        text = value
    return text if len(text) <= 80 else f"{text[:80]}…"


@contextlib.contextmanager
def at(
    place, given=None, kind: Callable[[str], Exception] = InputError
) -> Iterator[None]:
    """Name the place of what is wrong: errors in the block get `place` before their message.

    An InputError or ValidationError becomes an error of class `kind`; a StabilityError stays one.
    `given` is what was validated.
    """
    try:
        yield
    except StabilityError as error:
        raise StabilityError(f"{place}: {error}") from error
    except (InputError, ValidationError) as error:
        why = (
            first_message(error, given) if isinstance(error, ValidationError) else error
        )
        raise kind(f"{place}: {why}") from error


def check_text(value, key: str) -> None:
    """Raise InputError if a text in a value has control characters, as the loader of files does.

    `key` is the key of the value.
    """
    if isinstance(value, Mapping):
        for name, inner in value.items():
            check_text(inner, f"{key}.{name}")
    elif isinstance(value, list):
        for inner in value:
            check_text(inner, key)
    elif isinstance(value, str) and CONTROL.search(value):
        raise InputError(f"{key} = {value!r} must hold no control characters")
