"""Arches as a study file gives them: one model for each profile, told apart by `profile`."""

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from archfrag.arch.checks import LARGEST, MOST_VOUSSOIRS, SMALLEST

if TYPE_CHECKING:
    from archfrag.arch import Arch


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


# Upper bounds of what `arch` itself does not bound; beyond them units were mistaken.
MOST_FRICTION, MOST_DENSITY, MOST_LOAD = 1e6, 1e6, 1e12


def refuse(text: str) -> PydanticCustomError:
    """A refusal in words: what must be, to follow the key and its value."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def _infinite(given: Any) -> Any:
    return math.inf if given == "inf" else given


def _coefficient(value: float) -> float:
    if MOST_FRICTION < value < math.inf:
        raise refuse(f"must be at most {MOST_FRICTION:g}, or inf for no sliding")
    return value


def _one_or_each(given: Any) -> str:
    return "each" if isinstance(given, list | tuple) else "one"


# Bounds that `arch` checks, with sentences of its own, are here for the schema only.
Length = Annotated[float, Field(json_schema_extra={"minimum": SMALLEST, "maximum": LARGEST})]
Angle = Annotated[float, Field(json_schema_extra={"exclusiveMinimum": 0, "maximum": 360})]
Count = Annotated[int, Field(json_schema_extra={"minimum": 2, "maximum": MOST_VOUSSOIRS})]
Numbers = Annotated[tuple[float, ...], Field(strict=False, max_length=MOST_VOUSSOIRS + 1)]
_Load = Annotated[float, Field(le=MOST_LOAD, json_schema_extra={"minimum": 0})]
_Loads = Annotated[tuple[_Load, ...], Field(strict=False, max_length=MOST_VOUSSOIRS)]
LoadOrEach = Annotated[
    Annotated[_Load, Tag("one")] | Annotated[_Loads, Tag("each")],
    Discriminator(_one_or_each),
]
_Coefficient = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(_infinite),
    AfterValidator(_coefficient),
    WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, {"const": "inf"}]}),
]
_Coefficients = Annotated[
    tuple[_Coefficient, ...], Field(strict=False, max_length=MOST_VOUSSOIRS + 1)
]
Friction = Annotated[
    Annotated[_Coefficient, Tag("one")] | Annotated[_Coefficients, Tag("each")],
    Discriminator(_one_or_each),
]
_Point = Annotated[tuple[float, float], Field(strict=False)]
Points = Annotated[tuple[_Point, ...], Field(strict=False, max_length=MOST_VOUSSOIRS + 1)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=80)]


class Chain(Section):
    """What all profiles share."""

    id: Identifier
    """Name of the arch in results: letters, digits and _ . + - only."""
    friction: Friction
    """Coulomb coefficient of all joints, or one for each; inf: the limit of large friction."""
    density: Annotated[
        float, Field(le=MOST_DENSITY, json_schema_extra={"exclusiveMinimum": 0})
    ] = 2000.0
    """Of the masonry [kg/m3]."""
    depth: Length = 1.0
    """Width of the arch across its plane [m]."""

    def build(self) -> "Arch":
        """The arch of this entry.

        Raises
        ------
        GeometryError
            If it cannot exist.
        """
        from archfrag import arch

        given = self.model_dump(exclude={"id", "profile"})
        profile = getattr(self, "profile")  # noqa: B009
        if profile == "block":
            return arch.Block(**given)
        return getattr(arch.Arch, profile)(**given)


class Ring(Chain):
    """What the ready-made profiles share."""

    thickness: Length
    """Of the ring, measured along its joints [m]."""
    voussoirs: Count
    """Number of voussoirs."""
    joints: Numbers | None = None
    """Joints from the left springing: degrees (circular) or parts of the centre line."""
    dead_load: LoadOrEach | None = None
    """Weight on the back of all voussoirs, or a list with one for each [N]."""


class Circular(Ring):
    """Circular arch by its mid-thickness radius and angle of embrace."""

    profile: Literal["circular"]
    radius: Length
    """Mid-thickness radius [m]."""
    embrace: Angle
    """Angle between the springings [degrees]."""
    sector: bool = True
    """Exact annular sectors; false: straight-sided voussoirs."""


class Segmental(Ring):
    """Circular arch of at most a semicircle by span and rise."""

    profile: Literal["segmental"]
    span: Length
    """Of the centre line [m]."""
    rise: Length
    """Of the centre line [m]; at most half the span."""
    sector: bool = True
    """Exact annular sectors; false: straight-sided voussoirs."""


class Pointed(Ring):
    """Two circular arcs that meet at the crown."""

    profile: Literal["pointed"]
    span: Length
    """Of the centre line [m]."""
    rise: Length
    """Of the centre line [m]; at least half the span."""


class Elliptic(Ring):
    """Upper half of an ellipse."""

    profile: Literal["elliptic"]
    span: Length
    """Of the centre line [m]."""
    rise: Length
    """Of the centre line [m]."""


class Catenary(Ring):
    """Hanging chain turned upside down."""

    profile: Literal["catenary"]
    span: Length
    """Of the centre line [m]."""
    rise: Length
    """Of the centre line [m]."""


class FromJoints(Chain):
    """Any profile, by the ends of its joints."""

    profile: Literal["from_joints"]
    intrados: Points
    """Inner ends of the joints, in order [m]."""
    extrados: Points
    """Outer ends of the joints, in order [m]."""
    dead_load: LoadOrEach | None = None
    """Weight on the back of all voussoirs, or a list with one for each [N]."""
    free_end: bool = False
    """The last voussoir touches no ground, as in a column or a wall."""


class Block(Chain):
    """A single rectangular block on the ground."""

    profile: Literal["block"]
    width: Length
    """[m]"""
    height: Length
    """[m]"""


ArchEntry = Annotated[
    Circular | Segmental | Pointed | Elliptic | Catenary | FromJoints | Block,
    Field(discriminator="profile"),
]
