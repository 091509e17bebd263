"""Properties of arches and motions: a row for each key of a study, with its unit and its bounds.

The schema, checks, cautions, `vary.of`, columns of tables, the cube and the report follow from the
rows of arches.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

# Lengths [m] between which nothing overflows; beyond them units were mistaken.
SMALLEST = 1e-6
LARGEST = 1e6
# Most voussoirs of an arch: with more, even the onset takes longer than a check of a study should.
MOST_VOUSSOIRS = 2000
RINGS = ("circular", "segmental", "pointed", "elliptic", "catenary")
PROFILES = (*RINGS, "from_joints", "block", "polygons")
DRAWN = ("polygons", "drawing")
_LOADED = (*RINGS, "from_joints", *DRAWN)


class Property(NamedTuple):
    """Unit, bounds and description of a key."""

    unit: str | None = None  # as people write it; None: not a number
    least: float = 0.0
    most: float = math.inf
    usual: tuple[float, float] = (
        -math.inf,
        math.inf,
    )  # outside this range the user is asked the question
    question: str = "is that its unit?"
    text: str = ""  # description in the schema of study files
    needed: tuple[str, ...] = ()  # profiles that must have the key; also "drawing"
    taken: tuple[str, ...] = ()  # profiles that may have the key; also "drawing"
    kind: type = float
    default: float | None = None
    each: bool = (
        False  # whether it may be a list, with a value for each voussoir or joint
    )
    infinite: str = ""  # what inf means; if this is empty, inf is refused


def _length(text: str = "", **about) -> Property:
    return Property("m", SMALLEST, LARGEST, text=text, **about)


# Keys that may vary from arch to arch.
VARIABLE = {
    "radius": _length("Mid-thickness radius (circular) [m].", needed=RINGS[:1]),
    "embrace": Property(
        "degrees",
        most=360.0,
        text="Angle between the springings (circular) [degrees].",
        needed=RINGS[:1],
    ),
    "span": _length(
        "Span of the centre line [m].", usual=(0.3, 200.0), needed=RINGS[1:]
    ),
    "rise": _length(
        "Rise of the centre line [m]; at most half the span (segmental), at least (pointed).",
        needed=RINGS[1:],
    ),
    "thickness": _length(
        "Thickness of the ring, measured along its joints [m].",
        usual=(0.01, 10.0),
        needed=RINGS,
    ),
    "width": _length("Width of a block [m].", needed=("block",)),
    "height": _length(  # also that of a column or a wall
        "Height of a block [m].", usual=(0.3, 200.0), needed=("block",)
    ),
    "thickness_factor": Property(
        "",
        most=100.0,
        usual=(0.4, 2.5),
        question="is it the factor on the thickness that is drawn?",
        text="Factor on the length of the joints of drawn blocks; the sides between joints "
        "follow.",
        taken=DRAWN,
    ),
    "dead_load": Property(
        "N",
        most=1e12,
        text="Weight on the back of all voussoirs, or a list with one for each [N].",
        taken=_LOADED,
        each=True,
    ),
    "friction": Property(
        "",
        most=1e6,
        usual=(0.0, 2.0),
        question="was an angle meant?",
        text="Coulomb coefficient of all joints, or one for each; inf: the limit of large "
        "friction. On piers a list is for the joints of each ring, or for all of the bridge.",
        needed=(*PROFILES, "drawing"),
        each=True,
        infinite="the limit of large friction",
    ),
    "density": Property(
        "kg/m3",
        SMALLEST,
        1e6,
        (1000.0, 3500.0),
        text="Density of the masonry, or of each voussoir of the ring [kg/m3].",
        default=2000.0,
        each=True,
    ),
    "depth": _length(
        "Width of the arch across its plane, or of each voussoir of the ring [m].",
        usual=(0.05, 100.0),
        default=1.0,
        each=True,
    ),
    **{
        f"{where}.{key}": row
        for where in ("piers", "ends")
        for key, row in {
            "height": _length(usual=(0.1, 200.0)),
            "width": _length(usual=(0.05, 50.0)),
            "base_width": _length(usual=(0.05, 50.0)),
            "above": Property("m", most=LARGEST),
            "friction": Property(
                "",
                most=1e6,
                usual=(0.0, 2.0),
                question="was an angle meant?",
                infinite="the limit of large friction",
            ),
            "density": Property("kg/m3", SMALLEST, 1e6, (1000.0, 3500.0)),
            "depth": _length(usual=(0.05, 100.0)),
        }.items()
    },
    "springings.spread": Property("m", -LARGEST, LARGEST),
    "springings.settlement": Property("m", -LARGEST, LARGEST),
    "springings.rotation": Property("degrees", -45.0, 45.0),
    # Usual from thick lime mortar to dry joints of hard stone.
    "joints.stiffness": Property(
        "Pa/m", 1e6, 1e15, (1e8, 1e13), each=True, infinite="rigid"
    ),
}
# Keys that change an arch after its ring, piers and fill are built.
LATER = ("recess", "joints", "strength", "springings", "ties")
PROPERTIES = VARIABLE | {
    **dict.fromkeys(("drawing", "layer", "unit"), Property(taken=("drawing",))),
    "voussoirs": Property(
        "", 2, MOST_VOUSSOIRS, text="Number of voussoirs.", needed=RINGS, kind=int
    ),
    "sector": Property(
        text="Exact annular sectors (circular, segmental); false: straight-sided voussoirs.",
        taken=RINGS[:2],
        kind=bool,
    ),
    "joint_positions": Property(taken=RINGS),
    "intrados": Property("m", needed=("from_joints",)),
    "extrados": Property("m", needed=("from_joints",)),
    "free_end": Property(
        text="Whether the last voussoir touches no ground, as in a column or a wall.",
        taken=("from_joints",),
        kind=bool,
    ),
    "outlines": Property(needed=("polygons",)),
    "ground": Property(taken=("polygons",)),
    "tolerance": _length(
        "Distance within which edges of drawn neighbours agree [m]; 1e-5 of the size by default.",
        taken=DRAWN,
    ),
    **dict.fromkeys(
        ("ends", "transverse", "fill", "springings", "ties"), Property(taken=_LOADED)
    ),
    **dict.fromkeys(
        ("spans", "piers"), Property(taken=_LOADED[:-1])
    ),  # not with a drawing
    "strength": Property(
        "N/m2",
        1.0,
        1e12,
        (2e5, 3e8),  # from adobe to granite
        text="Compressive strength of the masonry: joints lose the thickness that would crush "
        "under self-weight [N/m2]. If not given, nothing crushes.",
        taken=_LOADED,
    ),
    "joints.shear": Property("Pa/m", 1e6, 1e15, each=True, infinite="rigid"),
    "recess.intrados": Property("m", most=LARGEST),
    "recess.extrados": Property("m", most=LARGEST),
    **dict.fromkeys(("piers.courses", "ends.courses"), Property("", 1.0)),
    "fill.height_over_crown": Property("m", most=LARGEST, usual=(0.0, 20.0)),
    "fill.unit_weight": Property("N/m3", most=1e6, usual=(5e3, 4e4)),
    "fill.backing_height": Property("m", most=LARGEST),
    "fill.backing_unit_weight": Property("N/m3", most=1e6, usual=(5e3, 4e4)),
    "ties.area": Property("m2", usual=(1e-6, 0.1)),
    "ties.modulus": Property("N/m2", usual=(1e9, 1e12)),  # from timber to carbon fibre
    "ties.prestress": Property("N"),
    # Largest level of a study or of a hazard curve, by the kind of intensity measure.
    "PGA": Property("m/s2", usual=(0.3, 100.0)),
    **dict.fromkeys(
        ("Sa", "AvgSA", "Sa_avg2", "Sa_avg3"), Property("m/s2", usual=(0.03, 200.0))
    ),
    **dict.fromkeys(("PGV", "FIV3"), Property("m/s", usual=(0.02, 20.0))),
    "PGD": Property("m", usual=(0.005, 20.0)),
    "Arias": Property("m/s", usual=(0.02, 2000.0)),
    "CAV": Property("m/s", usual=(0.2, 2000.0)),
    "HI": Property("m", usual=(0.02, 100.0)),
    "rate": Property("1/year", usual=(1e-6, 20.0), question="is it a number a year?"),
    # Of an earthquake and of a record.
    "Mw": Property("", usual=(3.0, 9.6), question="is it a moment magnitude?"),
    "distance_km": Property("km", usual=(0.0, 1000.0)),
    "Vs30_mps": Property("m/s", usual=(80.0, 3000.0)),
}
# By unit: its spelling in the cube, and the spellings that columns of tables may have.
SPELLED = {
    "m": ("m", "m"),
    "degrees": ("degree", "degrees degree deg °"),
    "kg/m3": ("kg m-3", "kg/m3 kg/m³"),
    "N": ("N", "N"),
    "N/m2": ("Pa", "N/m2 N/m² Pa"),
    "Pa/m": ("Pa m-1", "Pa/m N/m3 N/m³"),
    "": ("1", "1 -"),
}
UNITS = {key: SPELLED[str(row.unit)][0] for key, row in VARIABLE.items()}


def value_of(given: Mapping[str, Any], key: str):
    """Return the value of a key in `given`; None if it is missing.

    A key may be in a block, such as ``joints.stiffness``; of a list of blocks it is the list of
    their values.
    """
    value: Any = given
    for name in key.split("."):
        if isinstance(value, list):
            value = [
                each[name] for each in value if each and each.get(name) is not None
            ]
        else:
            value = value.get(name) if isinstance(value, Mapping) else None
    return value


def unusual(key: str, value, name: str = "") -> Iterator[str]:
    """Yield a question on the first value outside the usual range of a key, if there is one.

    `value` is a number, an array or None. A `key` that is not in `PROPERTIES` has no range. If
    `name` is given, the question shows it in the place of `key`.
    """
    row = PROPERTIES.get(key, Property())
    if value is None or row.unit is None:
        return
    least, most = row.usual
    for one in np.ravel(np.array(value, float)).tolist():
        if not (least <= one <= most or math.isinf(one)):
            stated = f"{name or key} = {one:.4g} {row.unit}".rstrip()
            usual = f"usual are {least:g} to {f'{most:g} {row.unit}'.rstrip()}"
            yield f"{stated}: {usual}; {row.question}"
            return
