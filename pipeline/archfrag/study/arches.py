"""Arches as a study file gives them: one model for each profile, told apart by `profile`."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

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


def _one_or_each(given: Any) -> str:
    return "each" if isinstance(given, list | tuple) else "one"


Numbers = Annotated[tuple[float, ...], Field(strict=False)]
NumberOrEach = Annotated[
    Annotated[float, Tag("one")] | Annotated[Numbers, Tag("each")],
    Discriminator(_one_or_each),
]
_Coefficient = Annotated[float, Field(allow_inf_nan=True)]
_Coefficients = Annotated[tuple[_Coefficient, ...], Field(strict=False)]
Friction = Annotated[
    Annotated[_Coefficient, Tag("one")] | Annotated[_Coefficients, Tag("each")],
    Discriminator(_one_or_each),
]
_Point = Annotated[tuple[float, float], Field(strict=False)]
Points = Annotated[tuple[_Point, ...], Field(strict=False)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=80)]


class Chain(Section):
    """What all profiles share."""

    id: Identifier
    """Name of the arch in results: letters, digits and _ . + - only."""
    friction: Friction
    """Coulomb coefficient of all joints, or a list with one for each; .inf: the limit of large friction."""
    density: float = 2000.0
    """Of the masonry [kg/m3]."""
    depth: float = 1.0
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

    thickness: float
    """Of the ring, measured along its joints [m]."""
    voussoirs: int
    """Number of voussoirs, at least 2."""
    joints: Numbers | None = None
    """Joints from the left springing: degrees (circular) or parts of the centre line."""
    dead_load: NumberOrEach | None = None
    """Weight on the back of all voussoirs, or a list with one for each [N]."""


class Circular(Ring):
    """Circular arch by its mid-thickness radius and angle of embrace."""

    profile: Literal["circular"]
    radius: float
    """Mid-thickness radius [m]."""
    embrace: float
    """Angle between the springings [degrees]."""
    sector: bool = True
    """Exact annular sectors; false: straight-sided voussoirs."""


class Segmental(Ring):
    """Circular arch of at most a semicircle by span and rise."""

    profile: Literal["segmental"]
    span: float
    """Of the centre line [m]."""
    rise: float
    """Of the centre line [m]; at most half the span."""
    sector: bool = True
    """Exact annular sectors; false: straight-sided voussoirs."""


class Pointed(Ring):
    """Two circular arcs that meet at the crown."""

    profile: Literal["pointed"]
    span: float
    """Of the centre line [m]."""
    rise: float
    """Of the centre line [m]; at least half the span."""


class Elliptic(Ring):
    """Upper half of an ellipse."""

    profile: Literal["elliptic"]
    span: float
    """Of the centre line [m]."""
    rise: float
    """Of the centre line [m]."""


class Catenary(Ring):
    """Hanging chain turned upside down."""

    profile: Literal["catenary"]
    span: float
    """Of the centre line [m]."""
    rise: float
    """Of the centre line [m]."""


class FromJoints(Chain):
    """Any profile, by the ends of its joints."""

    profile: Literal["from_joints"]
    intrados: Points
    """Inner ends of the joints, in order [m]."""
    extrados: Points
    """Outer ends of the joints, in order [m]."""
    dead_load: NumberOrEach | None = None
    """Weight on the back of all voussoirs, or a list with one for each [N]."""
    free_end: bool = False
    """The last voussoir touches no ground, as in a column or a wall."""


class Block(Chain):
    """A single rectangular block on the ground."""

    profile: Literal["block"]
    width: float
    """[m]"""
    height: float
    """[m]"""


ArchEntry = Annotated[
    Circular | Segmental | Pointed | Elliptic | Catenary | FromJoints | Block,
    Field(discriminator="profile"),
]
