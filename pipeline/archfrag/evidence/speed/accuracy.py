"""Speed against accuracy: every method and setting on every scene, against references."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from archfrag.errors import ArchfragError
from archfrag.evidence.part import Frames, Section, Setup
from archfrag.evidence.run import Way, at_hand
from archfrag.evidence.scene import Scene, load_scene, scene_names
from archfrag.evidence.speed.charts import chart, spread_chart
from archfrag.evidence.speed.horizon import spread_of_peaks
from archfrag.evidence.speed.peers import try_peers
from archfrag.evidence.speed.quantities import QUANTITIES
from archfrag.evidence.speed.reference import Reference, find_reference
from archfrag.evidence.speed.runs import POINT, try_lines
from archfrag.evidence.speed.section import lead_of, notes_of
from archfrag.evidence.speed.tables import (
    against_peers,
    auto_table,
    exponents,
    limits_table,
)
from archfrag.evidence.ways import ladders

QUICK_SCENES = (
    "arch7_pulse", "block_sine", "column_pulse", "arch7_slides", "arch27_pulse",
    "arch7_shipped_m65_r010",
)  # fmt: skip
REFERENCE_COLUMNS = (
    "scene", "quantity", "value", "error", "way", "coarser_way", "second_method", "second_away",
    "second_doubt", "charted", "why_not",
)  # fmt: skip
HORIZON_COLUMNS = (
    "scene", "exponent", "low", "high", "horizon", "largest_difference", "onset", "first_impact",
    "peak_at", "end",
)  # fmt: skip
SPREAD_COLUMNS = ("scene", "line", "way", "difference", "peak", "collapsed")
SPREAD_WAYS = (
    ("event_driven", Way("event_driven", "rtol", 1e-6)),
    ("auto", Way("auto", "rtol", 1e-3)),
    ("time_stepping", Way("time_stepping", "dt", 5e-4)),
)


def chart_scenes(quick: bool) -> list[Scene]:
    """Scenes marked "chart" in their files; of these the quick set."""
    scenes = [load_scene(name) for name in scene_names()]
    marked = [each for each in scenes if "chart" in each.source.split(", ")]
    if not quick:
        return marked
    return [load_scene(name) for name in QUICK_SCENES]


def measure(setup: Setup) -> dict[str, pd.DataFrame]:
    """Measure cost and errors of all methods, and of peers, on all scenes.

    Parameters
    ----------
    setup : Setup

    Returns
    -------
    dict of str to DataFrame
        "points": a row for each scene, quantity and setting; cost is the median of wall times of
        the integration [s]. "references", "horizons", "spreads"; "auto", "exponents",
        "limits" and "against" as in `archfrag.evidence.speed.tables`; "left_out": sentences.
    """
    lines, left_out = ladders(setup.quick)
    scenes, missing = at_hand(chart_scenes(setup.quick), setup.places)
    left_out += missing
    points: list[dict[str, Any]] = []
    spreads: list[tuple[Any, ...]] = []
    references: list[Reference] = []
    for scene in scenes:
        setup.say(f"speed: {scene.name}")
        try:
            reference = find_reference(scene, setup.quick)
        except ArchfragError as reason:
            left_out.append(str(reason))
            continue
        found, skipped = try_lines(reference, lines, setup.quick)
        points += found
        left_out += skipped
        references.append(reference)
        if reference.why_not("peak") and not reference.seen.collapsed:
            spreads += _spreads(reference)
    if setup.peers:
        found, skipped = try_peers(setup.peers, references, setup.quick, setup.say)
        points += found
        left_out += skipped
    frame = pd.DataFrame(points, columns=list(POINT))
    return {
        "points": frame,
        "references": pd.DataFrame(_reference_rows(references), columns=list(REFERENCE_COLUMNS)),
        "horizons": pd.DataFrame(_horizon_rows(references), columns=list(HORIZON_COLUMNS)),
        "spreads": pd.DataFrame(spreads, columns=list(SPREAD_COLUMNS)),
        "auto": auto_table(frame),
        "exponents": exponents(frame),
        "limits": limits_table(frame),
        "against": against_peers(frame),
        "left_out": pd.DataFrame({"sentence": left_out}, dtype=object),
    }


def _spreads(reference: Reference) -> list[tuple[Any, ...]]:
    return [
        (reference.scene.name, line, str(way), *row)
        for line, way in SPREAD_WAYS
        for row in spread_of_peaks(reference.scene, way)
    ]


def _reference_rows(references: list[Reference]) -> list[tuple[Any, ...]]:
    rows = []
    for each in references:
        values = {
            "amplitude": each.amplitude,
            "peak": each.seen.peak,
            "energy_gain": each.seen.energy_gain,
            "energy_error": each.seen.energy_error,
            "overlap": each.seen.overlap,
            "verdicts": float(each.grid.size),
            "position": each.marks.position,
            "reactions": float(each.marks.reactions.size),
        }
        for quantity in QUANTITIES:
            away, doubt = each.second.get(quantity, (math.nan, math.nan))
            second = "time_stepping, extrapolated" if quantity in each.second else ""
            why_not = each.why_not(quantity)
            rows.append(
                (
                    each.scene.name, quantity, values[quantity],
                    each.error.get(quantity, math.nan), str(each.tight), str(each.loose), second,
                    away, doubt, not why_not, why_not,
                )
            )  # fmt: skip
    return rows


def _horizon_rows(references: list[Reference]) -> list[tuple[Any, ...]]:
    return [
        (
            each.scene.name, each.growth.exponent, each.growth.low, each.growth.high,
            each.growth.horizon, each.growth.largest, each.marks.onset, each.marks.impact,
            each.marks.peak, each.response.end_time,
        )
        for each in references
    ]  # fmt: skip


def show(frames: Frames) -> Section:
    """Charts, counts and worst cases, made from the tables alone.

    Parameters
    ----------
    frames : mapping of str to DataFrame

    Returns
    -------
    Section
    """
    pictures = {}
    for quantity in QUANTITIES:
        drawn = chart(frames["points"], frames["references"], quantity)
        if drawn is not None:
            pictures[f"speed-{quantity.replace('_', '-')}"] = drawn
    drawn = spread_chart(frames["spreads"], frames["horizons"])
    if drawn is not None:
        pictures["speed-spreads"] = drawn
    return Section("Speed against accuracy", lead_of(frames), pictures, notes_of(frames))
