"""Arches as a study file gives them: one model for each profile, distinguished by `profile`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    create_model,
    model_validator,
)

from archfrag.arch.checks import LARGEST, MOST_VOUSSOIRS, SMALLEST
from archfrag.errors import StudyError
from archfrag.study.section import PathText, Section, refuse, refuse_key
from archfrag.study.vary import VARIABLE, Vary

if TYPE_CHECKING:
    from archfrag.arch import Arch


# Upper bounds of what `arch` itself does not bound; beyond them units were mistaken.
MOST_FRICTION, MOST_DENSITY, MOST_LOAD = 1e6, 1e6, 1e12


def _infinite(given: Any) -> Any:
    return math.inf if given == "inf" else given


def _coefficient(value: float) -> float:
    if MOST_FRICTION < value < math.inf:
        raise refuse(f"must be at most {MOST_FRICTION:g}, or inf for no sliding")
    return value


def _finite(given: Any) -> bool:
    """Whether a key has a value, and no value of it is infinite."""
    if given is None:
        return False
    return all(map(math.isfinite, given if isinstance(given, tuple) else (given,)))


def _one_or_each(given: Any) -> str:
    return "each" if isinstance(given, list | tuple) else "one"


# Bounds that `arch` checks, with messages of its own, are here for the schema only.
Length = Annotated[float, Field(json_schema_extra={"minimum": SMALLEST, "maximum": LARGEST})]
Angle = Annotated[float, Field(json_schema_extra={"exclusiveMinimum": 0, "maximum": 360})]
Count = Annotated[int, Field(json_schema_extra={"minimum": 2, "maximum": MOST_VOUSSOIRS})]
Numbers = Annotated[tuple[float, ...], Field(strict=False, max_length=MOST_VOUSSOIRS + 1)]
_T = TypeVar("_T")
OneOrEach = Annotated[
    Annotated[_T, Tag("one")]
    | Annotated[tuple[_T, ...], Field(strict=False, max_length=MOST_VOUSSOIRS + 1), Tag("each")],
    Discriminator(_one_or_each),
]
LoadOrEach = OneOrEach[Annotated[float, Field(le=MOST_LOAD, json_schema_extra={"minimum": 0})]]
Friction = OneOrEach[
    Annotated[
        float,
        Field(allow_inf_nan=True),
        BeforeValidator(_infinite),
        AfterValidator(_coefficient),
        WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, {"const": "inf"}]}),
    ]
]
_Point = Annotated[tuple[float, float], Field(strict=False)]
_Corner = Annotated[
    Annotated[tuple[float, float], Field(strict=False)]
    | Annotated[tuple[float, float, float], Field(strict=False)],
    Field(union_mode="left_to_right"),
]
Points = Annotated[tuple[_Point, ...], Field(strict=False, max_length=MOST_VOUSSOIRS + 1)]
DepthOrEach = OneOrEach[Annotated[float, Field(ge=0.0, le=LARGEST)]]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=80)]


_MAKER = {"polygons": "from_polygons"}  # of profiles whose class method has another name


class Recess(Section):
    """Joints that bear nothing near their ends: mortar lost, edges spalled."""

    intrados: DepthOrEach = 0.0
    """Depth from the intrados, along the joint, of all joints or one for each [m]."""
    extrados: DepthOrEach = 0.0
    """Depth from the extrados, along the joint, of all joints or one for each [m]."""


class Chain(Section):
    """What all profiles have in common."""

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
    recess: Recess | None = None
    """How far the joints bear nothing near their ends."""
    vary: Vary | None = None
    """What of the arch is not known exactly: in its place stand the arches drawn for it."""

    @model_validator(mode="after")
    def _can_vary(self) -> Self:
        if self.vary is None:
            return self
        own = type(self).model_fields
        profile = getattr(self, "profile")  # noqa: B009
        for key, distribution in self.vary.of.items():
            if key not in own or key not in VARIABLE:
                names = ", ".join(name for name in VARIABLE if name in own)
                text = f"is nothing that varies of the profile {profile}; allowed are {names}"
                raise refuse_key(f"vary.of.{key}", text)
            if distribution.relative and not _finite(getattr(self, key)):
                text = f"must have a finite {key} of the arch to multiply"
                raise refuse_key(f"vary.of.{key}.relative", text)
        joints = self.vary.joints
        if joints is not None and joints.position is not None and "joints" not in own:
            raise refuse_key("vary.joints.position", f"has no place in the profile {profile}")
        if joints is not None and joints.friction is not None and not _finite(self.friction):
            raise refuse_key("vary.joints.friction", "must have a finite friction to multiply")
        return self

    def build(self) -> "Arch":
        """The arch of this entry; of one that varies, that of its own values."""
        from archfrag import arch

        given = self.model_dump(exclude={"id", "profile", "recess", "vary"})
        profile = getattr(self, "profile")  # noqa: B009
        if profile == "block":
            built: Arch = arch.Block(**given)
        else:
            built = getattr(arch.Arch, _MAKER.get(profile, profile))(**given)
        if self.recess is None:
            return built
        from archfrag.arch.recess import recessed

        return recessed(built, self.recess.intrados, self.recess.extrados)


class Ring(Chain):
    """What the ready-made profiles have in common."""

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


class Spanned(Ring):
    """What profiles by span and rise have in common."""

    span: Length
    """Of the centre line [m]."""
    rise: Length
    """Of the centre line [m]; segmental: at most half the span, pointed: at least."""


class Segmental(Spanned):
    """Circular arch of at most a semicircle by span and rise."""

    profile: Literal["segmental"]
    sector: bool = True
    """Exact annular sectors; false: straight-sided voussoirs."""


class Pointed(Spanned):
    """Two circular arcs that meet at the crown."""

    profile: Literal["pointed"]


class Elliptic(Spanned):
    """Upper half of an ellipse."""

    profile: Literal["elliptic"]


class Catenary(Spanned):
    """Hanging chain upside down."""

    profile: Literal["catenary"]


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


class Drawn(Chain):
    """What blocks of any shape have in common, from a file or from the study."""

    dead_load: LoadOrEach | None = None
    """Weight on the back of all voussoirs, or a list with one for each from the left [N]."""
    thickness_factor: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """Joints are longer by it about their middles, and the sides between them follow."""
    tolerance: Length | None = None
    """Within which edges of neighbours agree [m]; 1e-5 of the size of all if not given."""


class Polygons(Drawn):
    """Blocks of any shape, which form a chain by their common edges."""

    profile: Literal["polygons"]
    outlines: Annotated[
        tuple[Annotated[tuple[_Corner, ...], Field(strict=False)], ...],
        Field(strict=False, max_length=MOST_VOUSSOIRS),
    ]
    """Corners of each block: x, y [m] and the bulge of the side to the next one, 0 if straight."""
    ground: Annotated[
        tuple[Annotated[tuple[_Point, _Point], Field(strict=False)], ...],
        Field(strict=False, max_length=2),
    ] = ()
    """Lines on which ends stand; without any the sides opposite to the joints of the two ends."""


class FromDrawing(Drawn):
    """Blocks of a DXF drawing, which form a chain by their common edges."""

    profile: Literal["drawing"] = "drawing"
    drawing: PathText
    """DXF file, relative to the study file, with blocks as closed polylines on one layer and
    lines where they stand on the ground."""
    layer: str | None = None
    """Of the blocks; the only one with polylines if not given."""
    unit: Literal["m", "dm", "cm", "mm", "in", "ft"] | None = None
    """Of the drawing, over what it states."""

    def read(self) -> Polygons:
        """The same with what the drawing holds in its place; `GeometryError` if that is none."""
        from archfrag.arch.drawing import read_drawing
        from archfrag.arch.polygons import polygon_ring

        drawn = read_drawing(self.drawing, self.layer, self.unit)
        polygon_ring(drawn, self.tolerance)
        given = self.model_dump(exclude={"profile", "drawing", "layer", "unit"})
        blocks = {"outlines": drawn.outlines, "ground": drawn.ground}
        listed = {name: [each.tolist() for each in value] for name, value in blocks.items()}
        return Polygons.model_validate({**given, **listed, "profile": "polygons"})

    def build(self) -> "Arch":
        """The arch of the drawing; see `Chain.build`."""
        return self.read().build()


ArchEntry = Annotated[
    Circular | Segmental | Pointed | Elliptic | Catenary | FromJoints | Block | Polygons,
    Field(discriminator="profile"),
]


_PROFILES = (Circular, Segmental, Pointed, Elliptic, Catenary, FromJoints, Block)
# Keys that an arch may have, whatever its profile, with those that are one number each.
ARCH_KEYS = tuple(dict.fromkeys(key for model in _PROFILES for key in model.model_fields))
NUMBER_KEYS = ("voussoirs", *VARIABLE)


class Table(Section):
    """Many arches, one in each row of a table; other keys hold for rows that do not give them."""

    id: Identifier
    """Name of the class that the arches of the table make."""
    table: PathText
    """CSV, relative to the study file: a column id, columns named like the keys of an arch, and
    attributes, which are text."""
    profile: Literal[
        "circular", "segmental", "pointed", "elliptic", "catenary", "from_joints", "block"
    ] | None = None  # fmt: skip
    """Of the rows that do not give it."""
    vary: Vary | None = None
    """What of each arch is not known exactly, drawn independently from row to row."""

    def defaults(self) -> dict[str, Any]:
        """What rows have that do not state otherwise, as a study file gives it."""
        return self.model_dump(exclude={"id", "table"}, exclude_none=True, exclude_unset=True)

    def build(self) -> "Arch":
        """Refuses: a table has no one arch."""
        raise StudyError(f"{self.id}: is a table of arches, of which one must be chosen")


def file_of(entry: Any) -> Path | None:
    """File of which an entry's arches follow: a table or a drawing; None for others."""
    name = getattr(entry, "table", None) or getattr(entry, "drawing", None)
    return None if name is None else Path(name)


def _defaults() -> dict[str, Any]:
    """Keys of all profiles, none of which a table must have."""
    fields: dict[str, Any] = {}
    for model in _PROFILES:
        for name, info in model.model_fields.items():
            if name not in Table.model_fields:
                kind = info.rebuild_annotation()
                about = Field(default=None, description=info.description)
                fields.setdefault(name, (kind | None, about))
    return fields


if TYPE_CHECKING:
    Fleet = Table
else:
    Fleet = create_model(
        "Fleet", __base__=Table, __module__=__name__, __doc__=Table.__doc__, **_defaults()
    )


def _kind_of(given: Any) -> str:
    for key, kind, tag in (("table", Table, "many"), ("drawing", FromDrawing, "drawn")):
        if key in given if isinstance(given, dict) else isinstance(given, kind):
            return tag
    return "single"


StudyArch = Annotated[
    Annotated[ArchEntry, Tag("single")]
    | Annotated[Fleet, Tag("many")]
    | Annotated[FromDrawing, Tag("drawn")],
    Discriminator(_kind_of),
]
