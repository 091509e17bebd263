"""Arches of a study file: one block, whose keys follow from its profile, and what varies of it."""

import math
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    TypeVar,
)

import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    model_validator,
)
from scipy import stats

from archfrag import arch
from archfrag.arch.checks import LARGEST, MOST, MOST_VOUSSOIRS, SMALLEST
from archfrag.arch.drawing import read_drawing
from archfrag.arch.facts import no_unit_warnings
from archfrag.arch.polygons import polygon_ring
from archfrag.arch.uncertain import Marginal
from archfrag.simulation.joints import SOFTEST, crushed, jointed
from archfrag.simulation.springings import move_springing
from archfrag.study.keys import PathText, Section, at, refuse

if TYPE_CHECKING:
    from archfrag.arch import Arch

RINGS = ("circular", "segmental", "pointed", "elliptic", "catenary")
PROFILES = (*RINGS, "from_joints", "block", "polygons")
_ALL = (*PROFILES, "drawing")
_DRAWN = ("polygons", "drawing")
_LOADED = (*RINGS, "from_joints", *_DRAWN)


class Key(NamedTuple):
    """Which entries need a key of an arch, or may have it, and its unit if it may vary."""

    needed: tuple[str, ...] = ()  # by profiles, or by a drawing
    taken: tuple[str, ...] = ()
    unit: str | None = None  # as the cube states it


def _coefficient(given: Any) -> Any:
    if isinstance(given, int | float) and 1e6 < given < math.inf:
        raise refuse("must be at most 1e+06, or inf for no sliding")
    return math.inf if given == "inf" else given


_T = TypeVar("_T")
List = Annotated[list[_T], Field(max_length=MOST_VOUSSOIRS + 1)]
OneOrList = Annotated[
    Annotated[_T, Tag("one")] | Annotated[List[_T], Tag("list")],
    Discriminator(lambda given: "list" if isinstance(given, list) else "one"),
]
# Bounds that `arch` checks, with messages of its own, are here for the schema only.
Length = Annotated[
    float, Field(json_schema_extra={"minimum": SMALLEST, "maximum": LARGEST})
]
Angle = Annotated[
    float, Field(json_schema_extra={"exclusiveMinimum": 0, "maximum": 360})
]
Count = Annotated[
    int, Field(json_schema_extra={"minimum": 2, "maximum": MOST_VOUSSOIRS})
]
# Upper bounds of what `arch` itself does not bound; beyond them units were mistaken.
Density = Annotated[float, Field(le=1e6, json_schema_extra={"exclusiveMinimum": 0})]
UnitWeight = Annotated[float, Field(json_schema_extra={"minimum": 0, "maximum": 1e6})]
Load = Annotated[float, Field(le=1e12, json_schema_extra={"minimum": 0})]
Depth = Annotated[float, Field(ge=0.0, le=LARGEST)]
Shift = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Friction = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(_coefficient),
    WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, {"const": "inf"}]}),
]
Stiffness = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda given: math.inf if given == "inf" else given),
    WithJsonSchema(
        {"anyOf": [{"type": "number", "minimum": SOFTEST}, {"const": "inf"}]}
    ),
]
Value = Annotated[float, Field(ge=-MOST["Pa/m"], le=MOST["Pa/m"])]
Positive = Annotated[float, Field(gt=0.0, le=MOST["Pa/m"])]
Dispersion = Annotated[float, Field(gt=0.0, le=5.0)]
Point = Annotated[list[float], Field(min_length=2, max_length=2)]
Line = Annotated[list[Point], Field(min_length=2, max_length=2)]
Corner = Annotated[list[float], Field(min_length=2, max_length=3)]
Grounds = Annotated[list[Line], Field(max_length=2)]
DrawingUnit = Literal["m", "dm", "cm", "mm", "in", "ft"]
Factor = Annotated[float, Field(gt=0.0, le=100.0)]
Strength = Annotated[float, Field(ge=1.0, le=1e12)]
Identifier = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=80)
]


class Recess(Section):
    """Joints that transmit nothing near their ends: mortar lost, edges spalled."""

    intrados: OneOrList[Depth] = 0.0
    """Depth from the intrados along the joint, one for all joints or one for each [m]."""
    extrados: OneOrList[Depth] = 0.0
    """Depth from the extrados along the joint, one for all joints or one for each [m]."""


class JointEntry(Section):
    """Joints that give: their stiffness lets a hinge bear on a strip inside the edge."""

    stiffness: OneOrList[Stiffness] | None = None
    """Normal stiffness of an area of the joints, one for all or one for each, those of piers and
    bases included [Pa/m]; inf: rigid. It may be left out if vary.of.joints or a table gives it."""
    shear: OneOrList[Stiffness] | None = None
    """Shear stiffness [Pa/m]; if not given, as the normal one. Only model: face uses it."""
    damping: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05
    """Over the critical one, of the first mode with all joints closed; model: face uses it."""
    model: Literal["inset", "face"] = "inset"
    """inset: rigid joints with contact points as far inside their ends as the strip asks for;
    face: elastic faces without tension, by time stepping, without ties and strength."""
    points: Literal[2, 3] | None = None
    """Points at which a face bears: its ends (2), or these and its middle (3); if not given, it
    bears all along."""
    positions: List[float] | None = None
    """Joints of a ring, as the list joints has them."""


class Piers(Section):
    """Two piers or buttresses under the ring, bodies of the same chain, cut to its springing
    joints; every key is one for both or a pair [left, right]."""

    height: OneOrList[Length]
    """From the base to the intrados of the springing joint [m]."""
    width: OneOrList[Length]
    """From the inner face, which is upright, to the outer one at the top [m]."""
    base_width: OneOrList[Length] | None = None
    """The same at the base; if not given, as at the top [m]."""
    courses: OneOrList[Annotated[int, Field(ge=1)]] = 1
    """Bodies of a pier, equally high but for the top one; the joints between them are level."""
    above: OneOrList[Depth] = 0.0
    """Height of the top above the extrados of the springing joint, as of a buttress [m]."""
    friction: OneOrList[Friction] | None = None
    """Coulomb coefficient of its level joints; if not given, as of the ring's springing joint."""
    density: OneOrList[Density] | None = None
    """Density of its masonry; if not given, as of the ring's first or last voussoir [kg/m3]."""
    depth: OneOrList[Length] | None = None
    """Width across the plane; if not given, as of the ring's first or last voussoir [m]."""


class Fill(Section):
    """Fill and backing as weight and mass on the extrados, of the columns above it up to a level
    surface. The soil neither resists nor pushes: passive pressure is not modelled."""

    height_over_crown: Depth
    """Height of the surface over the highest point of the ring [m]."""
    unit_weight: UnitWeight
    """Weight of the fill [N/m3]."""
    backing_height: Depth = 0.0
    """Height of the backing, masonry or concrete over the haunches, above the middle of the lower
    springing joint; 0: none [m]."""
    backing_unit_weight: UnitWeight | None = None
    """Weight of the backing, in place of that of the fill [N/m3]."""
    inertia: Annotated[float, Field(json_schema_extra={"const": 1.0})] = 1.0
    """Part of the mass of fill and backing that moves horizontally with the ring. It can only be
    1: a body has one mass, so that all that weighs on it also moves with it."""


class Springings(Section):
    """A springing that has moved before the record; the arch has followed in equilibrium."""

    spread: Shift = 0.0
    """Movement away from the other springing [m]; negative towards it."""
    settlement: Shift = 0.0
    """Movement downwards [m]."""
    rotation: Annotated[float, Field(ge=-45.0, le=45.0)] = 0.0
    """About the middle of its joint, positive if its extrados goes down [degrees]."""
    springing: Literal["left", "right"] = "right"
    """Which one has moved."""


class TieEntry(Section):
    """A bar that only pulls, in the arch as it stands: after its springings have moved."""

    level: Shift
    """Height at which it goes through the arch, from outer face to outer face [m]."""
    area: Annotated[float, Field(gt=0.0, le=10.0)]
    """Area of its cross-section [m2]."""
    modulus: Annotated[float, Field(gt=0.0, le=1e13)] = 2.0e11
    """Young's modulus [N/m2]."""
    prestress: Load = 0.0
    """Tension at rest [N]."""
    strength: Annotated[float, Field(gt=0.0, le=1e12)] | None = None
    """Tension at which it yields [N]; if not given, it stays elastic."""
    rupture: Annotated[float, Field(gt=0.0, le=1e3)] | None = None
    """Elongation at which it breaks [m]; if not given, it never does."""


Ties = Annotated[list[TieEntry], Field(max_length=16)]


class Distribution(Section):
    """Distribution of one key, in the unit of the key."""

    kind_key = "distribution"
    common = ("relative",)
    kinds: ClassVar = {
        "normal": (("mean",), ("cov", "sd", "lower", "upper")),
        "lognormal": (("median", "beta"), ("lower", "upper")),
        "uniform": (("start", "stop"), ()),
        "triangular": (("start", "mode", "stop"), ()),
    }

    distribution: Literal["normal", "lognormal", "uniform", "triangular"]
    mean: Value | None = None
    """Mean of a normal distribution before truncation."""
    cov: Dispersion | None = None
    """Coefficient of variation of a normal distribution: standard deviation over mean; or sd."""
    sd: Positive | None = None
    """Standard deviation of a normal distribution before truncation; or cov."""
    median: Positive | None = None
    """Median of a lognormal distribution before truncation."""
    beta: Dispersion | None = None
    """Standard deviation of the natural logarithm of a lognormal distribution."""
    start: Value | None = None
    """Least value of a uniform or triangular distribution."""
    mode: Value | None = None
    """Most likely value of a triangular distribution."""
    stop: Value | None = None
    """Largest value of a uniform or triangular distribution."""
    lower: Value | None = None
    """Lower bound; the rest of a normal or lognormal distribution is scaled up."""
    upper: Value | None = None
    """Upper bound."""
    relative: bool = False
    """Whether values are factors on the key of the arch, which may be a list."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if self.distribution == "normal" and (self.cov is None) == (self.sd is None):
            raise refuse("must have one of cov and sd")
        if self.cov is not None and self.mean is not None and self.mean <= 0.0:
            raise refuse(f"must have sd in the place of cov with mean = {self.mean:g}")
        ends = [
            value for value in (self.start, self.mode, self.stop) if value is not None
        ]
        if ends and (ends != sorted(ends) or ends[0] == ends[-1]):
            values = ", ".join(f"{end:g}" for end in ends)
            raise refuse(f"must increase from start to stop, not {values}")
        with at("is cut too far", kind=refuse):
            self.marginal().quantile(0.5)
        return self

    def marginal(self) -> "Marginal":
        """Return the distribution to draw from."""
        keys: Any = self
        if self.distribution == "normal":
            law = stats.norm(keys.mean, keys.sd or keys.cov * keys.mean)
        elif self.distribution == "lognormal":
            law = stats.lognorm(keys.beta, 0.0, keys.median)
        elif self.distribution == "uniform":
            law = stats.uniform(keys.start, keys.stop - keys.start)
        else:
            width = keys.stop - keys.start
            law = stats.triang((keys.mode - keys.start) / width, keys.start, width)
        return Marginal(
            law, **self.model_dump(include={"lower", "upper"}, exclude_none=True)
        )


class JointScatter(Section):
    """Differences between the joints of one arch, sampled independently."""

    recess_intrados: Distribution | None = None
    """Depth over which a joint transmits nothing at its intrados (lost mortar) [m]."""
    recess_extrados: Distribution | None = None
    """Depth over which a joint transmits nothing at its extrados [m]."""
    position: Distribution | None = None
    """Shift of the joints between the springings along the ring, in lengths of a voussoir."""
    friction: Distribution | None = None
    """Factor on the arch's friction."""


class Vary(Section):
    """Uncertain keys of an arch, and how arches are sampled."""

    samples: Annotated[int, Field(ge=1, le=8192)]
    """Number of sampled arches, each of which meets every record."""
    scheme: Literal["sobol", "latin_hypercube"] = "sobol"
    """sobol keeps its first samples when you add samples; latin_hypercube suits any number."""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 1
    """Seed of the random numbers; the same seed gives the same arches."""
    of: Annotated[
        dict[str, Distribution],
        Field(
            json_schema_extra=lambda schema: schema.update(
                propertyNames={"enum": VARIABLE}
            )
        ),
    ] = Field(default_factory=dict)
    """Distribution of each uncertain key, in the unit of the key."""
    joints: JointScatter | None = None
    """Differences between the joints of one arch."""

    @model_validator(mode="before")
    @classmethod
    def _keys_are_in_of(cls, given: Any) -> Any:
        for key in given if isinstance(given, dict) else ():
            if key in VARIABLE and key not in cls.model_fields:
                raise refuse(f"must stand in of: {{of: {{{key}: ...}}}}", key)
        return given

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if not self.of and (self.joints is None or not self.joints.model_fields_set):
            raise refuse("must have a key of or joints: nothing varies")
        for name, distribution in self.joints or ():
            if distribution is not None and distribution.relative:
                raise refuse("cannot be used for joints", f"joints.{name}.relative")
        if self.scheme == "sobol" and self.samples & (self.samples - 1):
            text = "must be a power of two with scheme sobol; latin_hypercube takes any number"
            raise refuse(f"= {self.samples} {text}", "samples")
        return self


class ArchEntry(Section):
    """An arch, column or block from a profile or a drawing, or many from the rows of a table."""

    kind_key = "profile"
    common = ("id", "friction", "density", "depth", "recess", "joints", "vary")

    id: Identifier
    """Name of the arch or class of arches in results: letters, digits and _ . + - only."""
    profile: Literal[PROFILES] | None = None  # type: ignore[valid-type]
    """Shape of the arch; not with drawing, and with table only if its rows do not give it."""
    table: PathText | None = None
    """Table (CSV) with an arch in each row: a column id, columns named like the keys here, and
    attributes, which are text. Keys of this entry hold where a cell is empty."""
    rows: Literal["all", "sample"] | None = None
    """sample: the rows of the table are a random sample of a larger stock of arches, for which
    curve and band then are. all, or not given: they are all arches of the class."""
    drawing: Annotated[PathText | None, Key(taken=("drawing",))] = None
    """DXF file: blocks as closed polylines, and lines where they stand on ground."""
    layer: Annotated[OneOrList[str] | None, Key(taken=("drawing",))] = None
    """Layer of the blocks of a drawing, or a list of layers; the only one with polylines if not
    given."""
    unit: Annotated[DrawingUnit | None, Key(taken=("drawing",))] = None
    """Unit of a drawing; overrides what it states."""
    radius: Annotated[Length | None, Key(needed=("circular",), unit="m")] = None
    """Mid-thickness radius (circular) [m]."""
    embrace: Annotated[Angle | None, Key(needed=("circular",), unit="degree")] = None
    """Angle between the springings (circular) [degrees]."""
    span: Annotated[Length | None, Key(needed=RINGS[1:], unit="m")] = None
    """Span of the centre line [m]."""
    rise: Annotated[Length | None, Key(needed=RINGS[1:], unit="m")] = None
    """Rise of the centre line [m]; at most half the span (segmental), at least (pointed)."""
    thickness: Annotated[Length | None, Key(needed=RINGS, unit="m")] = None
    """Thickness of the ring, measured along its joints [m]."""
    voussoirs: Annotated[Count | None, Key(needed=RINGS)] = None
    """Number of voussoirs."""
    sector: Annotated[bool | None, Key(taken=RINGS[:2])] = None
    """Exact annular sectors (circular, segmental); false: straight-sided voussoirs."""
    joints: Annotated[
        Annotated[
            Annotated[List[float], Tag("list")] | Annotated[JointEntry, Tag("block")],
            Discriminator(lambda given: "list" if isinstance(given, list) else "block"),
        ]
        | None,
        Key(unit="Pa m-1"),
    ] = None
    """Positions of the joints of a ring from the left springing: degrees (circular) or fractions
    of the centre line; or a block with their stiffness, of any profile."""
    intrados: Annotated[List[Point] | None, Key(needed=("from_joints",))] = None
    """Inner ends of the joints, in order [m]."""
    extrados: Annotated[List[Point] | None, Key(needed=("from_joints",))] = None
    """Outer ends of the joints, in order [m]."""
    free_end: Annotated[bool | None, Key(taken=("from_joints",))] = None
    """Whether the last voussoir touches no ground, as in a column or a wall."""
    width: Annotated[Length | None, Key(needed=("block",), unit="m")] = None
    """Width of a block [m]."""
    height: Annotated[Length | None, Key(needed=("block",), unit="m")] = None
    """Height of a block [m]."""
    outlines: Annotated[List[list[Corner]] | None, Key(needed=("polygons",))] = None
    """Corners of each block: x, y [m] and the bulge of the side to the next one, 0 if straight."""
    ground: Annotated[
        Annotated[list[Line], Field(max_length=2)] | None, Key(taken=("polygons",))
    ] = None
    """Lines on which ends stand; if none, the sides opposite to the joints of both ends."""
    thickness_factor: Annotated[
        Annotated[float, Field(gt=0.0, le=100.0)] | None,
        Key(taken=("polygons", "drawing"), unit="1"),
    ] = None
    """Factor on the length of the joints of drawn blocks; the sides between joints follow."""
    tolerance: Annotated[Length | None, Key(taken=_DRAWN)] = None
    """Distance within which edges of drawn neighbours agree [m]; 1e-5 of the size by default."""
    dead_load: Annotated[OneOrList[Load] | None, Key(taken=_LOADED, unit="N")] = None
    """Weight on the back of all voussoirs, or a list with one for each [N]."""
    fill: Annotated[Fill | None, Key(taken=_LOADED)] = None
    """Fill and backing, as weight and mass."""
    piers: Annotated[Piers | None, Key(taken=_LOADED)] = None
    """Piers or buttresses on which the ring stands."""
    strength: Annotated[Strength | None, Key(taken=_LOADED)] = None
    """Compressive strength of the masonry: joints lose the thickness that would crush under
    self-weight [N/m2]. If not given, nothing crushes."""
    springings: Annotated[Springings | None, Key(taken=_LOADED)] = None
    """A springing that has moved before the record."""
    ties: Annotated[Ties | None, Key(taken=_LOADED)] = None
    """Ties, one or several."""
    friction: Annotated[OneOrList[Friction] | None, Key(needed=_ALL, unit="1")] = None
    """Coulomb coefficient of all joints, or one for each; inf: the limit of large friction. On
    piers a list is for the joints of the ring alone, or for all of the arch."""
    density: Annotated[OneOrList[Density], Key(unit="kg m-3")] = 2000.0
    """Density of the masonry, or of each voussoir of the ring [kg/m3]."""
    depth: Annotated[OneOrList[Length], Key(unit="m")] = 1.0
    """Width of the arch across its plane, or of each voussoir of the ring [m]."""
    recess: Recess | None = None
    """Depths near the ends of joints over which they transmit nothing."""
    vary: Vary | None = None
    """Distributions of uncertain keys; the study then has sampled arches in place of this one."""

    @model_validator(mode="after")
    def _have_what_varies(self) -> Self:
        if (
            self.soft.positions is not None
            and not self.table
            and self.profile not in RINGS
        ):
            rule = (
                f"has positions, which only {', '.join(RINGS)} take; give a "
                f"block with stiffness"
            )
            raise refuse(rule, "joints")
        later = self.table or (self.vary is not None and "joints" in self.vary.of)
        if (
            isinstance(self.joints, JointEntry)
            and self.soft.stiffness is None
            and not later
        ):
            raise refuse("must be given", "joints.stiffness")
        for key, distribution in (
            self.vary.of.items() if self.vary and not self.table else ()
        ):
            if distribution.relative and self.value(key) is None:
                text = f"needs a key {key} of the arch, which it multiplies"
                raise refuse(text, f"vary.of.{key}.relative")
            if not distribution.relative and isinstance(self.value(key), list):
                text = f"would replace the list {key}; give factors on it, with relative: true"
                raise refuse(text, f"vary.of.{key}")
        joints = self.vary.joints if self.vary and self.piers else None
        many = isinstance(self.friction, list) or (
            self.piers and self.piers.friction is not None
        )
        if joints and (joints.position or (joints.friction and many)):
            text = "with piers cannot have position, or friction unless all joints share one"
            raise refuse(text, "vary.joints")
        return self

    @property
    def parameters(self) -> dict[str, Any]:
        """Keys that have a value, with defaults, as a study file gives them."""
        return self.model_dump(exclude_none=True)

    def value(self, key: str) -> Any:
        """Return the value of a key that may vary, of joints their stiffness; None without one."""
        return self.soft.stiffness if key == "joints" else getattr(self, key, None)

    def number(self, key: str) -> float:
        """Return the value of a key, the mean of a list; nan without one."""
        value = self.value(key)
        return math.nan if value is None else float(np.mean(value))

    @property
    def soft(self) -> JointEntry:
        """The key joints as a block; without stiffness where only positions are given."""
        if isinstance(self.joints, JointEntry):
            return self.joints
        return JointEntry(positions=self.joints)

    def read(self) -> "ArchEntry":
        """Return the arch with what its drawing holds; GeometryError if that cannot be an arch."""
        if self.drawing is None:
            return self
        drawn = read_drawing(self.drawing, self.layer, self.unit)
        polygon_ring(drawn, self.tolerance)
        given = self.model_dump(exclude_none=True, exclude={"drawing", "layer", "unit"})
        blocks = {
            name: [each.tolist() for each in getattr(drawn, name)]
            for name in ("outlines", "ground")
        }
        return ArchEntry.model_validate({**given, **blocks, "profile": "polygons"})

    def build(self) -> "Arch":
        """Return arch, of one that varies by its own values; GeometryError if it cannot exist."""
        entry = self.read()
        key = repr(entry.model_dump(exclude={"id", "vary"}))
        if key not in _BUILT:
            if len(_BUILT) >= _MOST_KEPT:
                _BUILT.clear()
            with no_unit_warnings():
                _BUILT[key] = _built(entry)
        return _BUILT[key]


_KEYS = {
    name: about
    for name, field in ArchEntry.model_fields.items()
    for about in field.metadata
    if isinstance(about, Key)
}
UNITS = {name: about.unit for name, about in _KEYS.items() if about.unit}
# As columns of a table state them, by the unit of the cube.
_SPELLED = {
    "m": "m",
    "degree": "degrees degree deg °",
    "kg m-3": "kg/m3 kg/m³",
    "N": "N",
    "Pa m-1": "Pa/m N/m3 N/m³",
    "1": "1 -",
}
COLUMN_UNITS = {name: _SPELLED[unit] for name, unit in UNITS.items()}
COLUMN_UNITS |= {"strength": "N/m2 N/m² Pa", "tolerance": "m"}
VARIABLE = tuple(UNITS)  # keys that may vary, of all profiles
# Columns of a table that are keys of its arches.
COLUMNS = tuple(
    dict.fromkeys(
        (
            "profile",
            *ArchEntry.common,
            *(
                name
                for name, about in _KEYS.items()
                if {*about.needed, *about.taken} - {*_DRAWN}
            ),
        )
    )
)
ArchEntry.kinds = {
    "table": ((), ("table", "rows", *COLUMNS)),
    **{
        kind: (
            tuple(name for name, about in _KEYS.items() if kind in about.needed),
            tuple(name for name, about in _KEYS.items() if kind in about.taken),
        )
        for kind in ("drawing", *PROFILES)
    },
}
# A study asks for each of its arches some ten times; drawings and moved springings take long.
_BUILT: dict[str, "Arch"] = {}
_MOST_KEPT = 256


def _built(entry: ArchEntry) -> "Arch":
    """Return the arch of an entry, which is read from its drawing already."""
    name = str(entry.profile)
    makers = {"block": arch.Block, "polygons": arch.Arch.from_polygons}
    make: Any = makers.get(name) or getattr(arch.Arch, name)
    later = {
        "joints",
        "strength",
        "springings",
        "ties",
        "recess",
        "vary",
        "id",
        "profile",
        "rows",
    }
    given = entry.model_dump(exclude=later, exclude_none=True)
    soft = entry.soft.model_dump(exclude_none=True)
    if (positions := soft.pop("positions", None)) is not None:
        given["joints"] = positions
    built: Arch = make(**given)
    if entry.recess is not None:
        built = built.recessed(entry.recess.intrados, entry.recess.extrados)
    strength = math.inf if entry.strength is None else entry.strength
    if "stiffness" in soft:
        built = jointed(built, **soft, strength=strength)
    else:
        built = crushed(built, strength)
    if entry.springings is not None:
        built = move_springing(built, **entry.springings.model_dump())
    for tie in entry.ties or ():
        built = built.tied(**tie.model_dump(exclude_none=True))
    return built
