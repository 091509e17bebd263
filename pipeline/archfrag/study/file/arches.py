"""Arches of a study file: a block whose keys depend on its profile, and how keys vary."""

import math
from collections.abc import Mapping
from contextvars import copy_context
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
import scipy  # whose parts are loaded when they are used
from numpy.typing import ArrayLike
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    WithJsonSchema,
    create_model,
    field_validator,
    model_validator,
)

from archfrag import arch
from archfrag.arch.checks import FloatArray
from archfrag.arch.drawing import read_drawing
from archfrag.arch.facts import quiet
from archfrag.arch.polygons import polygon_ring
from archfrag.errors import InputError
from archfrag.files import Named
from archfrag.properties import (
    DRAWN,
    LARGEST,
    LATER,
    MOST_VOUSSOIRS,
    PROFILES,
    PROPERTIES,
    SMALLEST,
    VARIABLE,
)
from archfrag.simulation.joints import jointed
from archfrag.simulation.rest import onset
from archfrag.simulation.springings import move_springing
from archfrag.study.keys import PathText, Section, at, refuse
from archfrag.system import DEVICES

if TYPE_CHECKING:
    from archfrag.arch import Arch

# Probability that truncation has to leave; below it the bounds were mistaken.
LEAST_KEPT = 1e-6
_LARGEST_VALUE = PROPERTIES["joints.stiffness"].most

_T = TypeVar("_T")
List = Annotated[list[_T], Field(max_length=MOST_VOUSSOIRS + 1)]
_ONE_OR_LIST = Discriminator(lambda given: "list" if isinstance(given, list) else "one")
OneOrList = Annotated[
    Annotated[_T, Tag("one")] | Annotated[List[_T], Tag("list")], _ONE_OR_LIST
]
Length = Annotated[float, Field(ge=SMALLEST, le=LARGEST)]
Depth = Annotated[float, Field(ge=0.0, le=LARGEST)]
Shift = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
UnitWeight = Annotated[float, Field(ge=0.0, le=1e6)]
# Bounds of these are those of their key, which `arch` checks.
OrInfinite = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda given: math.inf if given == "inf" else given),
    WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, {"const": "inf"}]}),
]
Value = Annotated[float, Field(ge=-_LARGEST_VALUE, le=_LARGEST_VALUE)]
Positive = Annotated[float, Field(gt=0.0, le=_LARGEST_VALUE)]
Dispersion = Annotated[float, Field(gt=0.0, le=5.0)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Line = Annotated[list[Pair], Field(min_length=2, max_length=2)]
Corner = Annotated[list[float], Field(min_length=2, max_length=3)]
Points = List[Pair]


def _portable(name: str) -> str:
    """Return a name by which files are named on every system; refuse one of a device."""
    if name.endswith(".") or name.split(".")[0].casefold() in DEVICES:
        raise refuse(
            "cannot name a file on Windows (devices such as con and nul, or a point at the end); "
            "choose another"
        )
    return name


Identifier = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$", max_length=80),
    AfterValidator(_portable),
]


class Recess(Section):
    """Joints that transmit nothing near their ends: mortar lost, edges spalled."""

    intrados: OneOrList[Depth] = 0.0
    """Depth from the intrados along the joint, one for all joints or one for each [m]."""
    extrados: OneOrList[Depth] = 0.0
    """Depth from the extrados along the joint, one for all joints or one for each [m]."""


class JointEntry(Section):
    """Joints that give: their stiffness lets a hinge bear on a strip inside the edge."""

    stiffness: OneOrList[OrInfinite] | None = None
    """Normal stiffness of an area of the joints, one for all or one for each, those of piers and
    bases included [Pa/m]; inf: rigid. It may be left out if vary.of or a table gives
    joints.stiffness."""
    shear: OneOrList[OrInfinite] | None = None
    """Shear stiffness [Pa/m]; if not given, as the normal one. Only model: face uses it."""
    damping: float = Field(0.05, ge=0.0, le=1.0)
    """Over the critical one, of the first mode with all joints closed; model: face uses it."""
    model: Literal["inset", "face"] = "inset"
    """inset: rigid joints with contact points as far inside their ends as the strip asks for;
    face: elastic faces without tension, by time stepping, without ties and strength."""
    points: Literal[2, 3] | None = None
    """Points at which a face bears: its ends (2), or these and its middle (3); if not given, it
    bears all along."""


class Pier(Section):
    """A pier, a body or several of the same chain, cut to the springing joints of the rings on
    it."""

    height: Length
    """From the base to the intrados of the springing joint [m]."""
    width: Length
    """Of an inner pier between the rings' intrados; of an outer one from its upright inner face
    to the outer one at the top [m]."""
    base_width: Length | None = None
    """The same at the base; if not given, as at the top [m]."""
    courses: Annotated[int, Field(ge=1, le=MOST_VOUSSOIRS)] = 1
    """Its bodies, equally high but for the top one; the joints between them are level."""
    above: Depth = 0.0
    """Height of the top above the extrados of the springing joint, as of a buttress [m]."""
    friction: OrInfinite | None = None
    """Coulomb coefficient of its level joints; if not given, as of the springing joint."""
    density: Annotated[float, Field(ge=SMALLEST, le=1e6)] | None = None
    """Density of its masonry; if not given, as of the voussoir at the springing [kg/m3]."""
    depth: Length | None = None
    """Width across the plane; if not given, as of the voussoir at the springing [m]."""


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
    inertia: float = Field(1.0, json_schema_extra={"const": 1.0})
    """Part of the mass of fill and backing that moves horizontally with the ring. It can only be
    1: a body has one mass, so that all that weighs on it also moves with it."""


class Springings(Section):
    """A springing that has moved before the record; the arch has followed in equilibrium."""

    spread: Shift = 0.0
    """Movement away from the other springing [m]; negative towards it."""
    settlement: Shift = 0.0
    """Movement downwards [m]."""
    rotation: float = Field(0.0, ge=-45.0, le=45.0)
    """About the middle of its joint, positive if its extrados goes down [degrees]."""
    springing: str = "right"
    """Which one has moved; of a bridge the base: left, "pier 1" and so on, or right."""

    @property
    def moves(self) -> bool:
        """Whether the springing has moved at all."""
        return any((self.spread, self.settlement, self.rotation))


class TieEntry(Section):
    """A bar that only pulls, in the arch as it stands: after its springings have moved."""

    level: Shift
    """Height at which it goes through the arch, from outer face to outer face [m]."""
    span: Annotated[int, Field(ge=1)] | None = None
    """Span of a bridge in which it is, from 1; if not given, there is one in each span."""
    area: float = Field(gt=0.0, le=10.0)
    """Area of its cross-section [m2]."""
    modulus: float = Field(2.0e11, gt=0.0, le=1e13)
    """Young's modulus [N/m2]."""
    prestress: float = Field(0.0, ge=0.0, le=1e12)
    """Tension at rest [N]."""
    strength: float | None = Field(None, gt=0.0, le=1e12)
    """Tension at which it yields [N]; if not given, it stays elastic."""
    rupture: float | None = Field(None, gt=0.0, le=1e3)
    """Elongation at which it breaks [m]; if not given, it never does."""


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
            self.quantile(0.5)
        return self

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the quantiles of the distribution at some probabilities, in the same shape.

        InputError if less than `LEAST_KEPT` of the distribution lies between its bounds.
        """
        keys: Any = self
        if self.distribution == "normal":
            law = scipy.stats.norm(keys.mean, keys.sd or keys.cov * keys.mean)
        elif self.distribution == "lognormal":
            law = scipy.stats.lognorm(keys.beta, 0.0, keys.median)
        else:
            width = keys.stop - keys.start
            law = scipy.stats.uniform(keys.start, width)
            if self.distribution == "triangular":
                law = scipy.stats.triang(
                    (keys.mode - keys.start) / width, keys.start, width
                )
        lower = -math.inf if self.lower is None else self.lower
        upper = math.inf if self.upper is None else self.upper
        low, high = law.cdf([lower, upper]).tolist()
        if high - low < LEAST_KEPT:
            raise InputError(
                f"only {max(high - low, 0.0):.1g} of the distribution lies between "
                f"lower = {lower:g} and upper = {upper:g}; it must be at least "
                f"{LEAST_KEPT:g}"
            )
        inside = low + np.asarray(probability, dtype=float) * (high - low)
        return np.clip(law.ppf(inside), lower, upper)


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

    samples: int = Field(ge=1, le=8192)
    """Number of sampled arches, each of which meets every record."""
    scheme: Literal["sobol", "latin_hypercube"] = "sobol"
    """sobol keeps its first samples when you add samples; latin_hypercube suits any number."""
    seed: int = Field(1, ge=0, le=2**32 - 1)
    """Seed of the random numbers; the same seed gives the same arches."""
    of: Annotated[
        dict[str, Distribution],
        Field(
            json_schema_extra=lambda schema: schema.update(
                propertyNames={"enum": [*VARIABLE]}
            )
        ),
    ] = Field(default_factory=dict)
    """Distribution of each uncertain key, in the unit of the key."""
    each_joint: JointScatter | None = None
    """Differences between the joints of one arch."""

    @field_validator("of", mode="before")
    @classmethod
    def _has_joint_keys(cls, given):
        if isinstance(given, dict) and "joints" in given:
            raise refuse("is joints.stiffness", "joints")
        return given

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        scatter = self.each_joint
        if not self.of and (scatter is None or not scatter.model_fields_set):
            raise refuse("must have a key of or each_joint: nothing varies")
        for name, distribution in scatter or ():
            if distribution is not None and distribution.relative:
                raise refuse(
                    "cannot be used for each_joint", f"each_joint.{name}.relative"
                )
        if self.scheme == "sobol" and self.samples & (self.samples - 1):
            raise refuse(
                f"= {self.samples} must be a power of two with scheme sobol; latin_hypercube "
                "takes any number",
                "samples",
            )
        return self


def _plain_key(row) -> tuple[Any, Any]:
    """Return the type and the field of a key that is a number or a flag.

    `row` is the `Property` of the key.
    """
    of: Any = row.kind
    if row.infinite:
        of = OrInfinite
    elif row.unit is not None:
        of = Annotated[row.kind, Field(ge=row.least, le=row.most)]
    if row.each:
        of = OneOrList[of]  # type: ignore[misc, valid-type]
    return (
        of if row.default else of | None,
        Field(default=row.default, description=row.text),
    )


_plain: Named = {
    "id": (
        Identifier,
        Field(
            description="Name of the arch or class of arches in results: letters, digits and "
            "_ . + - only."
        ),
    ),
    **{key: _plain_key(row) for key, row in PROPERTIES.items() if row.text},
}
_PlainKeys: Any = create_model("_PlainKeys", __base__=Section, **_plain)
_COMMON = ("id", "friction", "density", "depth", "recess", "joints", "vary")
_ROWS = PROPERTIES.items()
# Columns of a table that are keys of its arches.
_KEYS = [key for key, row in _ROWS if {*row.needed, *row.taken} - {*DRAWN}]
_KEYS = ["profile", *dict.fromkeys((*_COMMON, *_KEYS))]
COLUMNS = (
    *_KEYS,
    *(key for key in VARIABLE if "." in key),
    "piers.courses",
    "ends.courses",
)
# Keys of a whole bridge; others are those of its rings.
_OF_ALL = ("id", "spans", "piers", "ends", "transverse", "fill", "vary", *LATER)
_OF_RINGS = [key for key, row in _ROWS if {*row.needed, *row.taken} & {*PROFILES}]
_OF_RINGS = [
    "profile",
    *(key for key in _OF_RINGS if key not in _OF_ALL),
    "density",
    "depth",
]


class ArchEntry(_PlainKeys):  # type: ignore[misc]
    """An arch, column or block from a profile or a drawing, or many from the rows of a table.

    Keys that are one number are rows of `archfrag.properties`.
    """

    kind_key = "profile"
    common = _COMMON
    kinds: ClassVar = {
        "table": ((), ("table", "rows", *_KEYS)),
        "spans": ((), tuple(dict.fromkeys((*_OF_RINGS, *_OF_ALL)))),
        **{
            kind: (
                tuple(key for key, row in _ROWS if kind in row.needed),
                tuple(key for key, row in _ROWS if kind in row.taken),
            )
            for kind in ("drawing", *PROFILES)
        },
    }

    profile: Literal[PROFILES] | None = None  # type: ignore[valid-type]
    """Shape of the arch; not with drawing, and with table only if its rows do not give it."""
    table: PathText | None = None
    """Table (CSV) with an arch in each row: a column id, columns named like the keys here, and
    attributes, which are text. Keys of this entry hold where a cell is empty."""
    rows: Literal["all", "sample"] | None = None
    """sample: the rows of the table are a random sample of a larger stock of arches, for which
    curve and band then are. all, or not given: they are all arches of the class."""
    drawing: PathText | None = None
    """DXF file: blocks as closed polylines, and lines where they stand on ground."""
    layer: OneOrList[str] | None = None
    """Layer of the blocks of a drawing, or a list of layers; the only one with polylines if not
    given."""
    unit: Literal["m", "dm", "cm", "mm", "in", "ft"] | None = None
    """Unit of a drawing; overrides what it states."""
    joint_positions: List[float] | None = None
    """Positions of the joints of a ring from the left springing: degrees (circular) or fractions
    of the centre line."""
    intrados: Points | None = None
    """Inner ends of the joints, in order [m]."""
    extrados: Points | None = None
    """Outer ends of the joints, in order [m]."""
    outlines: List[list[Corner]] | None = None
    """Corners of each block: x, y [m] and the bulge of the side to the next one, 0 if straight."""
    ground: List[Line] | None = None
    """Lines on which ends stand; if none, the sides opposite to the joints of both ends."""
    spans: (
        Annotated[
            Annotated[int, Field(ge=1, le=MOST_VOUSSOIRS), Tag("one")]
            | Annotated[
                Annotated[list[Named], Field(min_length=1, max_length=MOST_VOUSSOIRS)],
                Tag("list"),
            ],
            _ONE_OR_LIST,
        ]
        | None
    ) = None
    """Number of equal rings of a bridge; or a list with the keys in which each differs."""
    piers: OneOrList[Pier] | None = None
    """Piers between the rings: one block for all, or a list one shorter than spans."""
    ends: OneOrList[Pier | None] | None = None
    """Outer piers or buttresses: one block for both, or a list [left, right], empty for one whose
    springing is on the ground."""
    transverse: bool | str | None = None
    """A pier, such as "pier 1" or "left pier": the arch is its column across the bridge, with its
    share of rings and fill; true: of the pier that moves first. Depths are then those of the
    real bridge, and recess and joints those of the column's joints, from the base up."""
    fill: Fill | None = None
    """Fill and backing, as weight and mass."""
    recess: Recess | None = None
    """Depths near the ends of joints over which they transmit nothing."""
    joints: JointEntry | None = None
    """Joints that give, by their stiffness."""
    springings: Springings | None = None
    """A springing that has moved before the record."""
    ties: list[TieEntry] | None = Field(None, max_length=16)
    """Ties, one or several."""
    vary: Vary | None = None
    """Distributions of uncertain keys; the study then has sampled arches in place of this one."""

    @model_validator(mode="before")
    @classmethod
    def _is_drawn_whole(cls, given):
        drawn = isinstance(given, dict) and "drawing" in given
        for key in ("spans", "piers"):
            if drawn and key in given:
                text = "is given with a drawing, which shows all spans; leave it out"
                raise refuse(text, key)
        return given

    @field_validator("joints", mode="before")
    @classmethod
    def _are_a_block(cls, given):
        if isinstance(given, list) or (
            isinstance(given, dict) and "positions" in given
        ):
            raise refuse(
                "is a block with stiffness; positions are joint_positions: [...]"
            )
        return given

    @model_validator(mode="after")
    def _have_what_varies(self) -> Self:
        of = self.vary.of if self.vary else {}
        if (
            self.joints
            and self.joints.stiffness is None
            and not (self.table or "joints.stiffness" in of)
        ):
            raise refuse("must be given", "joints.stiffness")
        for key, distribution in () if self.table else of.items():
            if distribution.relative and self.value(key) is None:
                text = f"needs a key {key} of the arch, which it multiplies"
                raise refuse(text, f"vary.of.{key}.relative")
            if not distribution.relative and isinstance(self.value(key), list):
                text = f"would replace the list {key}; give factors on it, with relative: true"
                raise refuse(text, f"vary.of.{key}")
        for number, ring in enumerate(
            self.spans if isinstance(self.spans, list) else ()
        ):
            for key in ring.keys() & of.keys():
                text = f"would not change spans[{number}], which has its own"
                raise refuse(text, f"vary.of.{key}")
        scatter = self.vary.each_joint if self.vary else None
        if self.transverse and scatter and (scatter.position or scatter.friction):
            raise refuse("with transverse can only have recesses", "vary.each_joint")
        scatter = scatter if self.is_bridge else None
        keys = ("piers.friction", "ends.friction")
        many = isinstance(self.friction, list | None) or any(
            self.value(key) is not None for key in keys
        )
        if scatter and (scatter.position or (scatter.friction and many)):
            text = "with piers cannot have position, or friction unless all joints share one"
            raise refuse(text, "vary.each_joint")
        return self

    @model_validator(mode="after")
    def _stand_together(self) -> Self:
        if self.table:
            return self
        for key in ("springings", "ties") if self.transverse else ():
            if getattr(self, key) is not None:
                raise refuse(
                    "is of the whole bridge; transverse takes a pier alone", key
                )
        count = len(self.spans) if isinstance(self.spans, list) else self.spans or 1
        if self.piers and self.spans is None:
            text = "stand between spans; those of a single span are ends: {height: ...}"
            raise refuse(text, "piers")
        if count > 1 and (
            self.piers is None
            or (isinstance(self.piers, list) and len(self.piers) != count - 1)
        ):
            text = (
                f"must be given: one block for all, or a list of {count - 1}, one fewer"
            )
            raise refuse(text, "piers")
        if isinstance(self.ends, list) and len(self.ends) != 2:
            raise refuse("must be one block for both or a list [left, right]", "ends")
        if self.spans is not None:
            self.rings()
        return self

    def __hash__(self) -> int:
        return hash(repr(self))

    @property
    def is_bridge(self) -> bool:
        """Whether the entry has several spans, or piers."""
        return self.spans is not None or self.ends is not None

    def rings(self) -> list[Self]:
        """Return the entry of each ring of a bridge, without what belongs to the whole.

        A ring has the keys of the bridge that its profile can have, and its own. The error of
        pydantic if a ring cannot be, or if no ring has a key.
        """
        shared = self.model_dump(exclude_none=True, include={*_OF_RINGS})
        many = isinstance(self.spans, list)
        owns: list[Named] = self.spans if isinstance(self.spans, list) else [{}]
        found = []
        used = set[str]()
        for number, own in enumerate(owns):
            kind = str(own.get("profile", self.profile))
            can = {"profile", *_COMMON, *sum(self.kinds.get(kind, ((), ())), ())}
            keys = {
                key: value for key, value in shared.items() if key in can or not many
            }
            used |= keys.keys()
            place = f"cannot have spans[{number}]" if many else "cannot have such spans"
            given = {"id": "arch", **keys, **own}
            with at(place, given, kind=refuse):
                for name in {*map(str, own)} - {*_OF_RINGS}:
                    raise InputError(f"{name} is not a key of a span")
                found.append(type(self).model_validate(given))
        for unused in shared.keys() - used:
            raise refuse("is a key that no profile of spans has", unused)
        return found if many else found * (self.spans or 1)  # type: ignore[operator]

    @property
    def parameters(self) -> Named:
        """Keys that have a value, with defaults, as a study file gives them."""
        return self.model_dump(exclude_none=True)

    def value(self, key: str):
        """Return the value of a key, such as radius or joints.stiffness; None if it has none.

        Of a list of piers it is the list of their values.
        """
        block, _, name = key.partition(".")
        value: Any = getattr(self, block, None)
        if name and isinstance(value, list):
            every = [getattr(each, name, None) for each in value]
            return [each for each in every if each is not None] or None
        return getattr(value, name, None) if name else value

    def number(self, key: str) -> float:
        """Return the value of a key as one number: the mean of a list, nan if it has none."""
        value = self.value(key)
        return math.nan if value is None else float(np.mean(value))

    def varied(self, values: Mapping[str, Any], place: str, *without: str) -> Self:
        """Return the entry with other values of some keys, and without the keys `without`.

        A key of `values` may be in a block, such as joints.stiffness. InputError, which names
        `place`, if the new values are not allowed.
        """
        given = self.model_dump(exclude_none=True, exclude={*without})
        for key, value in values.items():
            block, _, name = key.rpartition(".")
            into = given.setdefault(block, {}) if block else given
            if isinstance(into, list):
                into = [each for each in into if each]
                for each, own in zip(into, np.broadcast_to(value, len(into)).tolist()):
                    each[name] = own
            else:
                into[name] = value
        with at(place, given):
            return type(self).model_validate(given)

    def read(self) -> Self:
        """Return the entry with the blocks of its drawing; the entry itself if it has no drawing.

        GeometryError if the blocks cannot be an arch.
        """
        if self.drawing is None:
            return self
        drawn = read_drawing(self.drawing, self.layer, self.unit)
        polygon_ring(drawn, self.tolerance)
        values: Named = {
            name: [each.tolist() for each in getattr(drawn, name)]
            for name in ("outlines", "ground")
        }
        values["profile"] = "polygons"
        return self.varied(values, self.drawing, "drawing", "layer", "unit")

    def build(self) -> "Arch":
        """Build the arch of the entry; if it varies, from the entry's own values.

        GeometryError if the arch cannot exist, StabilityError if it does not stand with its joints
        or after its springings have moved.
        """
        entry = self.read().model_copy(update={"id": "arch", "vary": None})
        context = copy_context()
        context.run(quiet.set, True)
        return context.run(_built, entry)


# A study asks for each of its arches some ten times; drawings and moved springings take long.
@lru_cache(maxsize=256)
def _built(entry: ArchEntry) -> "Arch":
    """Build the arch of an entry whose drawing, if any, has been read."""
    built = _rings(entry) if entry.is_bridge else _ring(entry)
    if entry.fill is not None:
        built = built.filled(**entry.fill.model_dump())
    if entry.transverse:
        first = onset(built).transverse or ("true",)
        built = built.transverse(
            first[0] if entry.transverse is True else entry.transverse
        )
    if entry.recess is not None:
        built = built.recessed(**entry.recess.model_dump())
    joints: Named = {"stiffness": math.inf, "strength": entry.strength or math.inf}
    if entry.joints is not None:
        joints |= entry.joints.model_dump(exclude_none=True)
    built = jointed(built, **joints)
    if entry.springings and entry.springings.moves:
        built = move_springing(built, **entry.springings.model_dump())
    for tie in entry.ties or ():
        built = built.tied(**tie.model_dump(exclude_none=True))
    return built


def _ring(entry: ArchEntry, **more) -> "Arch":
    """Build a ring, or any arch without piers; `more` replaces keys."""
    name = str(entry.profile)
    makers = {"block": arch.Block, "polygons": arch.Arch.from_polygons}
    make: Any = makers.get(name) or getattr(arch.Arch, name)
    given = entry.model_dump(exclude={"profile", *_OF_ALL}, exclude_none=True)
    return make(**given | more)


def _rings(entry: ArchEntry) -> "Arch":
    """Build rings on their piers; a list of friction is for each joint of a ring, or of all."""
    entries = entry.rings()
    dump = entry.model_dump(include={"piers", "ends"})
    rings = [_ring(each, friction=0.0) for each in entries]
    built = arch.Bridge(rings, dump["piers"] or (), dump["ends"])
    friction: list[Any] = [each.friction for each in entries]
    if isinstance(entry.friction, list) and len(entry.friction) == built.n_joint:
        friction = [entry.friction] * len(rings)
    others = zip(friction[1:], built.given.spans)
    spans = tuple(given._replace(friction=own) for own, given in others)
    return built.rebuilt(friction=friction[0], spans=spans)
