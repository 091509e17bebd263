"""One span or three: what a bridge that is taken as single spans leaves out.

Onset of motion, borders of half sines, and theta under the shipped motions, by number of spans.
"""

import time

import pandas as pd

import archfrag as af
from archbench.joints import SETS, border_under, half_sine, levels_of, studies_of
from archbench.runner import Bench, Row

RADIUS, THICKNESS, FRICTION = 2.5, 0.5, 0.6
# Height and width of piers [m].
PIERS = ((4.0, 1.0), (6.0, 1.5), (8.0, 2.0), (2.0, 1.0), (4.0, 1.5))
MANY = (1, 2, 3, 4, 5, 8)
SPANS = (1, 2, 3)  # of borders and of theta
PULSES = (0.25, 0.5, 1.0)  # [s]


def bridge_of(
    spans: int, height: float, width: float, voussoirs: int, courses: int
) -> af.Arch:
    """Semicircles on equal piers, the outer springings on the ground."""
    ring = af.Arch.circular(RADIUS, THICKNESS, 180.0, voussoirs, FRICTION)
    if spans == 1:
        return ring
    return af.Bridge(
        [ring] * spans, {"height": height, "width": width, "courses": courses}
    )


def onset_of(spans: int, height: float, width: float) -> list[Row]:
    """Onset of one bridge, whose rings have 17 voussoirs."""
    onset = af.onset(bridge_of(spans, height, width, 17, 4))
    head = {"spans": spans, "height": height, "width": width}
    return [{**head, "onset": min(onset.plus, onset.minus)}]


def border_of(spans: int, pulse: float) -> list[Row]:
    """Border of a half sine of one bridge on the slenderest piers; CPU time of the search."""
    bridge = bridge_of(spans, *PIERS[0], 9, 2)
    began = time.process_time()
    border = border_under(bridge, half_sine(pulse), af.onset(bridge).plus)
    spent = time.process_time() - began
    return [{"spans": spans, "pulse": pulse, "border": border, "seconds": spent}]


def theta_of(part: int, quick: bool) -> list[Row]:
    """Fit theta of bridges under the shipped motions at one set of levels."""
    bridges = {spans: bridge_of(spans, *PIERS[0], 9, 2) for spans in SPANS}
    levels = levels_of(bridges[1], part, quick)
    ways: dict[str, tuple[af.Arch, Row]]
    ways = {f"{spans}": (each, {}) for spans, each in bridges.items()}
    return studies_of(ways, levels, {"set": part})


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Onset, borders and theta, with what one span has over three."""
    piers = PIERS[:: 4 if bench.quick else 1]
    tasks: dict[tuple, tuple] = {(n, *each): (n, *each) for each in piers for n in MANY}
    onset = bench.rows("spans_onset", onset_of, tasks, 0.2)
    tasks = {(n, pulse): (n, pulse) for pulse in PULSES for n in SPANS}
    borders = bench.rows("spans_borders", border_of, tasks, 0.5)
    tasks = {(part,): (part, bench.quick) for part in range(SETS)}
    theta = bench.rows("spans_theta", theta_of, tasks)
    if len(theta):
        theta = theta.assign(spans=theta.pop("model").astype(int))
        theta = over_most(theta, ["set"], "theta", max(SPANS))
        sets = theta.groupby("spans")
        error = sets["over_most"].sem()
        theta = sets.mean().drop(columns="set").assign(standard_error=error)
        theta = theta.reset_index()
    return {
        "onset": over_most(onset, ["height", "width"], "onset", max(MANY)),
        "borders": over_most(borders, ["pulse"], "border", max(SPANS)),
        "theta": theta,
    }


def over_most(
    table: pd.DataFrame, keys: list[str], name: str, most: int
) -> pd.DataFrame:
    """The table with how much larger a value is than that of the most spans, in parts."""
    if table.empty:
        return table
    known = table.loc[table["spans"] == most, [*keys, name]]
    joined = table.merge(known, "left", keys, suffixes=("", "_most"))
    return joined.assign(over_most=joined[name] / joined.pop(f"{name}_most") - 1.0)
