"""What every block of a study file is made of, and how one refuses a value in words."""

import os
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

LONGEST_NAME, LONGEST_PATH = 255, 3900  # [bytes] of file systems; results add to a path


class Section(BaseModel):
    """A block of a study file: no unknown keys, no conversions, no changes once read."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )

    @model_validator(mode="before")
    @classmethod
    def _know_every_key(cls, given: Any) -> Any:
        if isinstance(given, dict):
            for key in given:
                if key not in cls.model_fields:
                    raise PydanticCustomError(
                        "unknown_key",
                        "unknown key",
                        {"key": str(key), "allowed": list(cls.model_fields)},
                    )
        return given


def refuse(text: str) -> PydanticCustomError:
    """A refusal in words: what must be, to follow the key and its value."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def refuse_key(key: str, text: str) -> PydanticCustomError:
    """A refusal of what stands under a key of the block at hand, by a sentence of its own."""
    return PydanticCustomError("refused_key", "", {"key": key, "text": text})


def _usable_path(value: str) -> str:
    if value.startswith("~"):
        raise refuse("begins with the home folder of a user that there is not")
    if max(map(len, os.fsencode(value).split(b"/"))) > LONGEST_NAME:
        raise refuse(f"must have names of at most {LONGEST_NAME} bytes between its slashes")
    if len(os.fsencode(value)) > LONGEST_PATH:
        raise refuse(f"must have at most {LONGEST_PATH} bytes with the folders above it")
    return value


PathText = Annotated[str, Field(min_length=1), AfterValidator(_usable_path)]
