"""Sentences and tables about speed and accuracy, from the tables that were measured."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from archfrag.evidence.part import Frames, Note
from archfrag.evidence.speed.quantities import QUANTITIES
from archfrag.evidence.speed.reference import MARGIN
from archfrag.evidence.speed.tables import ALLOWED
from archfrag.methods.registry import AUTO, METHODS
from archfrag.simulation.checks import default_of


def number(value: float, digits: int = 3) -> str:
    """A figure for a table; a dash where there is none.

    Examples
    --------
    >>> from archfrag.evidence.speed.section import number
    >>> number(0.00123456), number(float("nan")), number(float("inf"))
    ('0.00123', '–', 'none')
    """
    if math.isnan(value):
        return "–"
    return "none" if math.isinf(value) else f"{value:.{digits}g}"


def rows_of(frame: pd.DataFrame) -> list[Any]:
    """Rows of a table by the names of its columns."""
    return list(frame.itertuples())


def lead_of(frames: Frames) -> list[str]:
    """The answers, first thing on the page."""
    auto, references = frames["auto"], frames["references"]
    charted = references[references["charted"].astype(bool)]
    sentences = [_auto_sentence(auto), *_limit_sentences(frames["limits"])]
    second = charted[charted["second_away"].notna()]
    # An error that had to be raised is the distance itself.
    agree = second[second["error"] != second["second_away"]]
    sentences.append(
        f"References: {len(charted)} of {len(references)} pairs of scene and quantity are "
        f"charted; nothing is plotted below {MARGIN:g} times the reference's own error. A second "
        f"method, time stepping extrapolated from its four finest steps, was compared in "
        f"{len(second)} of them and agrees within its own uncertainty in "
        f"{len(agree)}; where "
        "it does not, its distance is taken as the reference's error."
    )
    horizons = frames["horizons"]
    short = horizons[horizons["peak_at"] > horizons["horizon"]]
    sentences.append(
        f"Of {len(horizons)} scenes {len(short)} reach their peak displacement beyond the "
        "predictability horizon"
        + (f" ({', '.join(short['scene'])}): spreads are shown for these." if len(short) else ".")
    )
    fastest = horizons[horizons["exponent"].notna()]
    if not fastest.empty:
        worst = fastest.iloc[int(fastest["exponent"].to_numpy().argmax())]
        sentences[-1] += (
            f" The largest Lyapunov exponent is {number(worst['exponent'])}/s, of "
            f"{worst['scene']} (90 % interval {number(worst['low'])} to {number(worst['high'])})."
        )
    sentences += _peer_sentences(frames["against"])
    return sentences


def _auto_sentence(auto: pd.DataFrame) -> str:
    if auto.empty:
        return "No error level was reached by any method."
    above = auto[auto["flag"].astype(bool)]
    never = int(auto["ratio"].map(math.isinf).sum())
    text = (
        f"auto is within {ALLOWED:g} times the cheapest of our methods (the baselines apart) at "
        f"{len(auto) - len(above)} of {len(auto)} error levels"
    )
    if never:
        text += f"; at {never} it has no setting here that gets there"
    finite = auto[~auto["ratio"].map(math.isinf)]
    if not finite.empty:
        worst = finite.iloc[int(finite["ratio"].to_numpy().argmax())]
        text += (
            f"; the dearest is {worst['ratio']:.3g} times, {worst['quantity']} of "
            f"{worst['scene']} at {worst['level']:.0e}, where {worst['cheapest']} is cheapest"
        )
    return text + "."


def _limit_sentences(limits: pd.DataFrame) -> list[str]:
    """What the limits of auto are worth for the collapse amplitude."""
    rows = limits[limits["quantity"] == "amplitude"]
    handed = rows[rows["way"].str.contains("hand_over")]
    sentences = []
    if not handed.empty:
        values = [float(way.rpartition(" ")[2]) for way in handed["way"]]
        sentences.append(
            f"hand_over at {number(min(values))} to {number(max(values))} instead of its default "
            f"makes auto at the default tolerance cost {number(handed['cost_ratio'].min(), 2)} to "
            f"{number(handed['cost_ratio'].max(), 2)} times as much, with "
            f"{number(handed['error_ratio'].min(), 2)} to "
            f"{number(handed['error_ratio'].max(), 2)} times the error of the amplitude that "
            "collapses (geometric means over the scenes)."
        )
    for row in rows_of(rows[~rows["way"].str.contains("hand_over")]):
        tolerance = str(row.way).split(",")[0].split(" ")[1]
        what = "Stepping throughout" if str(row.way).endswith(" 0") else "Locating events"
        sentences.append(
            f"{what} at a tolerance of {tolerance} too would cost {number(row.cost_ratio, 2)} "
            f"times as much ({number(row.cost_least, 2)} to {number(row.cost_most, 2)}) for "
            f"{number(row.error_ratio, 2)} times that error."
        )
    return sentences


def _peer_sentences(against: pd.DataFrame) -> list[str]:
    if against.empty:
        return []
    sentences = []
    for ours, column in (
        ("our cheapest method", "peer_over_cheapest"),
        ("auto", "peer_over_auto"),
    ):
        slower = against[against[column] < 1.0]
        text = (
            f"Against peers, at equal error, {ours} is faster at {len(against) - len(slower)} of "
            f"{len(against)} levels"
        )
        if len(slower):
            named = sorted({f"{r.peer} on {r.scene} ({r.quantity})" for r in rows_of(slower)})
            text += f"; not against {', '.join(named)}"
        sentences.append(text + ".")
    return sentences


def notes_of(frames: Frames) -> list[Note]:
    """Tables of the page."""
    notes = [
        _auto_note(frames["auto"]), _limits_note(frames["limits"]),
        _exponent_note(frames["exponents"]),
        _horizon_note(frames["horizons"]), _reference_note(frames["references"]),
    ]  # fmt: skip
    if not frames["against"].empty:
        notes.append(_against_note(frames["against"]))
    if not frames["spreads"].empty:
        notes.append(_spread_note(frames["spreads"]))
    sentences = [str(each) for each in frames["left_out"]["sentence"]]
    if sentences:
        notes.append(Note("What was left out", " ".join(f"{each}." for each in sentences)))
    return notes


def _auto_note(auto: pd.DataFrame) -> Note:
    rows = [
        (
            f"{row.scene}, {row.quantity}", f"{row.level:.0e}", str(row.cheapest),
            number(row.cheapest_cost), number(row.auto_cost), number(row.ratio),
            number(row.least_ratio),
        )
        for row in rows_of(auto[auto["flag"].astype(bool)])
    ]  # fmt: skip
    return Note(
        f"Where auto costs more than {ALLOWED:g} times the cheapest",
        "Error levels are decades; a setting reaches one if neither its own error nor that of any "
        "finer setting on its line is above it. All levels are in the table auto.csv.",
        (
            "scene, quantity",
            "error",
            "cheapest",
            "its cost (s)",
            "auto (s)",
            "ratio",
            "ratio of least times",
        ),
        tuple(rows),
    )


def _limits_note(limits: pd.DataFrame) -> Note:
    def ratio(row: Any, name: str) -> str:
        low, high = getattr(row, f"{name}_least"), getattr(row, f"{name}_most")
        return f"{number(getattr(row, f'{name}_ratio'))} ({number(low)} to {number(high)})"

    rows = [
        (str(row.way), str(row.quantity), str(row.scenes), ratio(row, "cost"), ratio(row, "error"))
        for row in rows_of(limits)
    ]
    return Note(
        "The limits of auto, each changed alone",
        "Cost and error over those with the default limits at the same tolerance: geometric mean "
        "over the scenes, least and largest in brackets. hand_over is the mean time between "
        "events, in time steps, below which all voussoirs are stepped "
        f"({default_of(METHODS[AUTO], 'hand_over'):g} by default); above the tolerance coarse "
        f"they are stepped throughout ({default_of(METHODS[AUTO], 'coarse'):g} by default; 1: "
        "never, 0: always).",
        ("limit", "quantity", "scenes", "cost", "error"),
        tuple(rows),
    )


def _exponent_note(exponents: pd.DataFrame) -> Note:
    rows = [
        (
            f"{row.method}, {row.quantity}", number(row.exponent),
            f"{number(row.low)} to {number(row.high)}", str(row.scenes), str(row.points),
            str(row.at_floor),
        )
        for row in rows_of(exponents)
    ]  # fmt: skip
    return Note(
        "Growth of cost with 1/error",
        "Exponent p of cost = C / error^p, least squares on logarithms with a constant for each "
        "scene, and its 90 % interval by Student's t. Small is good: a method of order q that "
        "converges cleanly has p = 1/q. Where the interval spans zero the setting "
        "does not govern the error; where no point is left the method is at the floor throughout.",
        ("method, quantity", "p", "90 % interval", "scenes", "points", "at the floor"),
        tuple(rows),
    )


def _horizon_note(horizons: pd.DataFrame) -> Note:
    rows = [
        (
            str(row.scene), number(row.exponent), f"{number(row.low)} to {number(row.high)}",
            "beyond the run" if math.isinf(row.horizon) else number(row.horizon),
            number(row.largest_difference, 2), number(row.peak_at), number(row.end),
        )
        for row in rows_of(horizons)
    ]  # fmt: skip
    return Note(
        "Predictability",
        "Largest Lyapunov exponent over the motion, from event-driven runs whose ground motion "
        "differs by 1e-9; the horizon is when that difference has become 1e-2 of the thickness.",
        ("scene", "exponent (1/s)", "90 % interval", "horizon (s)", "largest / thickness",
         "peak at (s)", "end (s)"),
        tuple(rows),
    )  # fmt: skip


def _reference_note(references: pd.DataFrame) -> Note:
    rows = [
        (
            f"{row.scene}, {row.quantity}", str(row.way), number(row.value, 8),
            number(row.error, 2), number(row.second_away, 2), number(row.second_doubt, 2),
            "yes" if row.charted else str(row.why_not),
        )
        for row in rows_of(references)
    ]  # fmt: skip
    return Note(
        "References",
        "Values: amplitude [g], peak [m], shares; of position the instant [s], of reactions the "
        "number of instants, of verdicts the number of amplitudes. Errors as the quantity's: "
        + "; ".join(f"{name}: {each.label}" for name, each in QUANTITIES.items())
        + ".",
        ("scene, quantity", "by", "value", "own error", "second method's distance",
         "its uncertainty", "charted"),
        tuple(rows),
    )  # fmt: skip


def _against_note(against: pd.DataFrame) -> Note:
    rows = []
    for (scene, quantity, peer), part in against.groupby(
        ["scene", "quantity", "peer"], sort=False
    ):
        worst = part.iloc[int(part["peer_over_cheapest"].to_numpy().argmin())]
        rows.append(
            (
                f"{scene}, {quantity}, {peer}", str(len(part)), number(worst["level"], 2),
                number(worst["peer_cost"]), str(worst["cheapest"]),
                number(worst["peer_over_cheapest"]), number(part["peer_over_auto"].min()),
            )
        )  # fmt: skip
    return Note(
        "Against peers",
        "For each error that a peer reaches, its cost over that of the cheapest of ours that "
        "reaches it too; the row shows the level at which the peer comes out best. Zero: none of "
        "ours reaches it here.",
        ("scene, quantity, peer", "levels", "error", "peer (s)", "our cheapest",
         "peer / our cheapest", "peer / auto, least"),
        tuple(rows),
    )  # fmt: skip


def _spread_note(spreads: pd.DataFrame) -> Note:
    rows = []
    for (scene, way), part in spreads.groupby(["scene", "way"], sort=False):
        standing = part[~part["collapsed"].astype(bool)]["peak"]
        rows.append(
            (
                f"{scene}, {way}", number(standing.min()), number(standing.median()),
                number(standing.max()), f"{len(part) - len(standing)} of {len(part)}",
            )
        )  # fmt: skip
    return Note(
        "Spread of the peak displacement under differences of 1e-9 to 1e-6",
        "Scenes whose peak is not charted: beyond the horizon, or not sure in the reference.",
        ("scene, way", "least (m)", "median (m)", "largest (m)", "collapsed"),
        tuple(rows),
    )
