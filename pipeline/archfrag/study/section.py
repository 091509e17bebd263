"""What every block of a study file is made of, and how one refuses a value in words."""

from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic_core import PydanticCustomError


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
