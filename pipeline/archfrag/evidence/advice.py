"""Which method for which scene at which error, in words: read off what was measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from archfrag.evidence.part import Frames, Note, Section
from archfrag.evidence.scene import load_scene, scene_names
from archfrag.evidence.speed.reference import MARGIN
from archfrag.evidence.speed.section import rows_of
from archfrag.evidence.speed.tables import ALLOWED, OWN, cheapest_at, kept_errors, own_points
from archfrag.evidence.stability.maps import failing
from archfrag.methods.registry import AUTO, METHODS
from archfrag.simulation.checks import default_of

LEVELS = (0.1, 0.01, 1e-3, 1e-4)
ASKED: Mapping[str, str] = {
    "amplitude": "least amplitude that collapses",
    "peak": "peak displacement",
    "position": "position at the first impact, over the thickness",
}
CHOICES = ("quantity", "scene", "level", "way", "cost", "auto", "auto_cost")
# Costs that differ by less come out either way on another day; auto is then the simpler advice.
TIE = 1.1


def choices(points: pd.DataFrame) -> pd.DataFrame:
    """Cheapest of our ways to each error on each scene, and auto's.

    Parameters
    ----------
    points : DataFrame
        Of `archfrag.evidence.speed.accuracy.measure`.

    Returns
    -------
    DataFrame
        A row for each of `ASKED`, scene and level of `LEVELS` that a way reaches and the chart
        resolves; costs in seconds a run, infinite where no setting of auto gets there. A way is
        auto's if that costs no more than `TIE` times the least.
    """
    ours = kept_errors(own_points(points))
    rows = []
    for quantity in ASKED:
        asked = ours[ours["quantity"] == quantity]
        for scene, group in asked.groupby("scene", sort=False):
            for level in LEVELS:
                way, cost = cheapest_at(group, level)
                if math.isinf(cost):
                    continue
                auto, auto_cost = cheapest_at(group[group["method"] == AUTO], level)
                if auto_cost <= TIE * cost:
                    way, cost = auto, auto_cost
                name, automatic = (each.rpartition(": ")[2] for each in (way, auto))
                rows.append((quantity, scene, level, name, cost, automatic, auto_cost))
    return pd.DataFrame(rows, columns=list(CHOICES))


def advise(found: Mapping[str, Frames]) -> Section | None:
    """First section of the guide; None if neither speed nor fragility was measured.

    Parameters
    ----------
    found : mapping of part to tables
    """
    lead: list[str] = []
    notes: list[Note] = []
    if "fragility" in found:
        curves = found["fragility"]["curves"]
        for study in dict.fromkeys(curves["study"]):
            table = curves[curves["study"] == study]
            lead.append(_of_a_curve(str(study), table))
            notes.append(_curve_note(str(study), table))
    if "speed" in found:
        chosen = choices(found["speed"]["points"])
        lead += [_of_single_runs(chosen, level) for level in LEVELS]
        lead.append(_of_auto(chosen))
        notes += [_scene_note(chosen, quantity) for quantity in dict.fromkeys(chosen["quantity"])]
    if not notes:
        return None
    if {"stability", "corner_cases", "growth"} & set(found):
        notes.append(_where_it_breaks(found))
    return Section("Which method for which scene", [each for each in lead if each], {}, notes)


def _seconds(cost: float) -> str:
    if math.isinf(cost):
        return "none gets there"
    return f"{1e3 * cost:.2g} ms" if cost < 0.0995 else f"{cost:.2g} s"


def _of_single_runs(chosen: pd.DataFrame, level: float) -> str:
    part = chosen[(chosen["quantity"] == "amplitude") & (chosen["level"] == level)]
    if part.empty:
        return ""
    named = [
        f"{way} on {', '.join(group['scene'])}"
        for way, group in sorted(
            part.groupby("way", sort=False), key=lambda each: len(each[1]), reverse=True
        )
    ]
    return (
        f"To {100.0 * level:g} % of the amplitude that collapses a scene, cheapest is "
        f"{'; '.join(named)}. A run there costs {_seconds(part['cost'].min())} to "
        f"{_seconds(part['cost'].max())}."
    )


def _of_auto(chosen: pd.DataFrame) -> str:
    ratio = chosen["auto_cost"] / chosen["cost"]
    dear = chosen[ratio > ALLOWED]
    text = (
        f"Who does not want to choose takes auto: at {len(chosen) - len(dear)} of {len(chosen)} "
        f"of these errors it costs no more than {ALLOWED:g} times the cheapest"
    )
    finite = ratio[~np.isinf(ratio)]
    if len(finite):
        text += f", {finite.median():.2g} times in the median, {finite.max():.2g} at most"
    if len(dear):
        text += f"; not on {', '.join(sorted(set(dear['scene'])))}"
    return text + "."


def _scene_note(chosen: pd.DataFrame, quantity: str) -> Note:
    part = chosen[chosen["quantity"] == quantity]
    known = set(scene_names())
    rows = []
    for scene, group in part.groupby("scene", sort=False):
        by_level: dict[float, Any] = {row.level: row for row in rows_of(group)}
        title = load_scene(str(scene)).title if scene in known else str(scene)
        cells = [_cell(by_level.get(level)) for level in LEVELS]
        rows.append((f"{scene}: {title}", *cells))
    return Note(
        f"By scene: {ASKED[quantity]}",
        "Cheapest of our ways that keeps the error at this and all finer settings of its line, "
        "and what a run costs; a step stands behind time_stepping, a tolerance behind the others. "
        f"auto is named where it costs no more than {TIE:g} times the least, else in brackets. A "
        "dash: no setting gets there, or it is below "
        f"{MARGIN:g} times the error of the scene's reference.",
        ("scene", *(f"{100.0 * level:g} %" for level in LEVELS)),
        tuple(rows),
        words=True,
    )


def _cell(row: Any) -> str:
    if row is None:
        return "–"
    text = f"{row.way}, {_seconds(row.cost)}"
    if not str(row.way).startswith(AUTO):
        automatic = f"{row.auto}, " if row.auto else "auto: "
        text += f" ({automatic}{_seconds(row.auto_cost)})"
    return text


def _errors(table: pd.DataFrame) -> pd.DataFrame:
    """Ways of ours, cheap ones first, with the error of ln theta; at the floor if below it."""
    ways = table[(table["role"] == "way") & table["method"].isin(OWN)].copy()
    floor = MARGIN * table["reference_ln_theta_error"].iloc[0]
    ways["ln_theta"] = np.maximum(ways["ln_theta_difference"].abs(), floor)
    return ways.sort_values("cpu_seconds")


def _of_a_curve(study: str, table: pd.DataFrame) -> str:
    ways, first = _errors(table), table.iloc[0]
    good = ways[ways["ln_theta"] <= first["sampling_ln_theta"]]
    if good.empty:
        return (
            f"For a fragility curve ({study} records) no way is shown to be as good as the sample "
            f"of records, which leaves theta open by {100.0 * first['sampling_ln_theta']:.1f} %: "
            f"the reference is known to {100.0 * first['reference_ln_theta_error']:.1f} %, and "
            f"errors below {MARGIN:g} times that are not told apart."
        )
    best, auto = good.iloc[0], good[good["method"] == AUTO]
    text = (
        f"For a fragility curve ({study} records): {best['way']} is the cheapest way whose theta "
        f"is off by no more than the {100.0 * first['sampling_ln_theta']:.1f} % that the sample "
        f"of records leaves open ({100.0 * best['ln_theta']:.1f} % at most, "
        f"{best['cpu_seconds']:.1f} s of CPU for {int(best['runs'])} runs)"
    )
    if len(auto) and best["method"] != AUTO:
        text += f"; auto does it at {auto.iloc[0]['way'].split(' ')[1]} for "
        text += f"{auto.iloc[0]['cpu_seconds']:.1f} s"
    usual = ways[ways["way"] == f"{AUTO} {default_of(METHODS[AUTO], 'rtol'):g}"]
    if len(usual):
        row = usual.iloc[0]
        text += (
            f". At its default tolerance auto takes {row['cpu_seconds']:.1f} s, with an error "
            f"of {100.0 * row['ln_theta']:.1f} % at most"
        )
    return text + "."


def _curve_note(study: str, table: pd.DataFrame) -> Note:
    ways, rows = _errors(table), []
    least = ways["ln_theta"].min()
    for level in (*(each for each in (0.2, 0.1, 0.05, 0.02, 0.01) if each > least), least):
        good = ways[ways["ln_theta"] <= level * (1.0 + 1e-9)]
        auto = good[good["method"] == AUTO]
        if good.empty:
            continue
        best = good.iloc[0]
        rows.append(
            (
                f"{100.0 * level:.2g} %", str(best["way"]), f"{best['cpu_seconds']:.1f}",
                str(auto.iloc[0]["way"]) if len(auto) else "–",
                f"{auto.iloc[0]['cpu_seconds']:.1f}" if len(auto) else "–",
            )
        )  # fmt: skip
    return Note(
        f"For a fragility curve, {study} records",
        f"Cheapest way to each error of theta. The last row is {MARGIN:g} times what the "
        "reference is known to, beyond which ways are not told apart.",
        ("error of theta", "cheapest", "CPU (s)", "auto", "CPU (s)"),
        tuple(rows),
        words=True,
    )


def _where_it_breaks(found: Mapping[str, Frames]) -> Note:
    cells = found["stability"]["cells"] if "stability" in found else None
    cases = found["corner_cases"]["runs"] if "corner_cases" in found else None
    grown = found["growth"]["exponents"] if "growth" in found else None
    rows = []
    for method in METHODS:
        broken, corner, growth = "–", "–", "–"
        if cells is not None and method in set(cells["method"]):
            broken = failing(cells[cells["method"] == method])
        if cases is not None and method in set(cases["method"]):
            corner = _corner(cases[cases["method"] == method])
        if grown is not None and method in set(grown["method"]):
            row = grown[grown["method"] == method].iloc[0]
            growth = f"n^{row['exponent']:.2g}"
        if {broken, corner, growth} != {"–"}:
            rows.append((method, broken, corner, growth))
    return Note(
        "Where each breaks",
        "Runs of the maps of stability and of the corner cases that fail, by how; and how the "
        "cost of a simulated second grows with the number of voussoirs.",
        ("method", "maps of stability", "corner cases", "cost"),
        tuple(rows),
        words=True,
    )


def _corner(runs: pd.DataFrame) -> str:
    counted = runs["result"].value_counts()
    named: Sequence[str] = sorted(
        {str(case).replace("_", " ") for case in runs.loc[runs["result"] == "broke", "case"]}
    )
    text = ", ".join(f"{count} {result}" for result, count in counted.items())
    return f"{text}: {'; '.join(named)}" if named else text
