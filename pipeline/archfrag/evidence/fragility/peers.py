"""The same fragility study by other people's solvers and by ours, of one straight-sided arch."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from archfrag.errors import FitError
from archfrag.evidence.fragility.reference import reference_ways, scatter
from archfrag.evidence.fragility.studies import Records
from archfrag.evidence.part import Note, Setup
from archfrag.evidence.peers.client import Peer, PeerFailed, PeerMissing
from archfrag.evidence.run import Way, run_scene, verdict
from archfrag.evidence.scene import Scene, load_scene
from archfrag.fragility.fit import fit_stripes

# Every second record, and of the full set every second level, as the quick one has already: peers
# step through the whole of each motion.
PART = 2
LEVELS = 8
STEPS = (4e-3, 2e-3, 1e-3)
# A way of a peer is left out where its study would take longer than this [s of CPU].
LONGEST = {True: 200.0, False: 600.0}
# After a record, for what has lost its contact to fall by two thicknesses [s].
FALL = 4.0
OURS = (
    *(Way("time_stepping", "dt", step) for step in (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)),
    *(Way("auto", "rtol", tolerance) for tolerance in (1e-1, 3e-2, 1e-2, 1e-3)),
)
COLUMNS = (
    "way", "who", "theta_g", "beta", "ln_theta_difference", "beta_difference", "differ",
    "scatter_ln_theta", "scatter_beta", "failures", "cpu_seconds", "cheapest_of_ours",
    "cheapest_seconds", "auto_seconds",
)  # fmt: skip


def scenes_of(records: Records) -> list[list[Scene]]:
    """The study as scenes: a row for each record, a scene for each level."""
    base = load_scene("arch7_pulse")
    rows = []
    for motion in records.motions[::PART]:
        peak = float(np.max(np.abs(motion.acceleration)))
        shaking = {
            "kind": "samples", "amplitude": 1.0, "sample_step": motion.dt,
            "values": (motion.acceleration / peak).tolist(),
        }  # fmt: skip
        duration = math.ceil(motion.dt * motion.acceleration.size + FALL)
        scene = replace(base, name=motion.id, motion=shaking, duration=float(duration))
        rows.append([scene.at(level) for level in levels_of(records)])
    return rows


def levels_of(records: Records) -> list[float]:
    """Levels that are run: all, or every second one of many [g]."""
    return list(records.levels[:: 1 if len(records.levels) <= LEVELS else 2])


def compare_peers(
    setup: Setup, records: Records
) -> tuple[pd.DataFrame, list[tuple[str, str, str]]]:
    """The study by ours and by every peer that is asked for and installed.

    Parameters
    ----------
    setup : Setup
    records : Records

    Returns
    -------
    DataFrame
        Columns `COLUMNS`: differences are from the pooled references; the last three say which of
        our ways is the cheapest with errors of theta and beta no larger, and what it costs.
    list of (study, way, reason)
        What was left out.
    """
    scenes = scenes_of(records)
    groups = reference_ways(setup.quick)
    tables = {str(way): (_ours(way, scenes), "ours") for way in (*groups[0], *groups[1], *OURS)}
    left_out: list[tuple[str, str, str]] = []
    for name in setup.peers:
        try:
            peer = Peer(name, 120.0)
        except PeerMissing as missing:
            left_out.append((records.study, name, f"not installed: {missing}"))
            continue
        for step in STEPS:
            way = f"{name} {1e3 * step:g} ms"
            setup.say(f"fragility: {way}")
            try:
                predicted = _predicted(peer, scenes, step)
            except PeerFailed as failure:
                left_out.append((records.study, way, str(failure)))
                continue
            if predicted > LONGEST[setup.quick]:
                reason = f"the study would take about {predicted:.0f} s"
                left_out.append((records.study, way, reason))
                break
            tables[way] = (_peer(peer, scenes, step), "peer")
        peer.close()
    names = tuple(tuple(map(str, ways)) for ways in groups)
    return _table(tables, names, np.array(levels_of(records))), left_out


def _collect(scenes: list[list[Scene]], run: Callable[[Scene], tuple[float, float]]) -> Any:
    """Verdicts (1, 0 or nan) and CPU seconds, (n_record, n_level) each."""
    return np.array([[run(scene) for scene in row] for row in scenes]).transpose(2, 0, 1)


def _ours(way: Way, scenes: list[list[Scene]]) -> Any:
    def run(scene: Scene) -> tuple[float, float]:
        began = time.process_time()
        response = run_scene(scene, way)
        fell = verdict(response)
        return math.nan if fell is None else float(fell), time.process_time() - began

    run(scenes[0][0])
    return _collect(scenes, run)


def _peer(peer: Peer, scenes: list[list[Scene]], step: float) -> Any:
    def run(scene: Scene) -> tuple[float, float]:
        try:
            outcome = peer.run(scene, step)
        except PeerFailed:
            return math.nan, 0.0
        return float(outcome.collapsed), outcome.cpu_seconds

    return _collect(scenes, run)


def _predicted(peer: Peer, scenes: list[list[Scene]], step: float) -> float:
    row = scenes[len(scenes) // 2]
    spent = peer.run(row[len(row) // 2], step).cpu_seconds
    return spent * len(scenes) * len(row)


def _curve(levels: np.ndarray, verdicts: np.ndarray) -> tuple[float, float]:
    known = ~np.isnan(verdicts)
    try:
        fit = fit_stripes(levels, np.nansum(verdicts, axis=0), known.sum(axis=0))
    except FitError:
        return math.nan, math.nan
    return float(np.log(fit.theta)), fit.beta


def _table(
    tables: dict[str, tuple[Any, str]], groups: Sequence[Sequence[str]], levels: np.ndarray
) -> pd.DataFrame:
    verdicts = {way: found[0] for way, (found, _) in tables.items()}
    pooled = [np.concatenate([verdicts[name] for name in names]) for names in groups]
    centre = np.array(_curve(levels, np.concatenate(pooled)))
    luck = scatter([[_curve(levels, verdicts[name]) for name in names] for names in groups])
    members = [name for names in groups for name in names]
    first = verdicts[members[0]]
    same = np.all([verdicts[name] == first for name in members], axis=0)
    rows = []
    for way, ((each, seconds), who) in tables.items():
        curve = np.array(_curve(levels, each))
        differ = same & ~np.isnan(each) & (each != first)
        away = curve - centre
        rows.append((
            way, "reference" if way in members else who, float(np.exp(curve[0])), curve[1],
            away[0], away[1], int(differ.sum()), luck[0], luck[1], int(np.isnan(each).sum()),
            float(seconds.sum()), "", math.nan, math.nan,
        ))  # fmt: skip
    return choose(pd.DataFrame(rows, columns=list(COLUMNS)))


def choose(frame: pd.DataFrame) -> pd.DataFrame:
    """Fill in, for each way of a peer, the cheapest of ours whose errors are no larger.

    Errors smaller than single studies of one method scatter by count as that.

    Parameters
    ----------
    frame : DataFrame
        With columns `COLUMNS`; changed and returned.
    """
    for i in frame.index[frame["who"] == "peer"]:
        as_good = frame[frame["who"] == "ours"]
        for name in ("ln_theta", "beta"):
            error = f"{name}_difference"
            allowed = frame.loc[i, [error, f"scatter_{name}"]].abs().max()
            as_good = as_good[as_good[error].abs() <= allowed]
        for name, choice in (("cheapest", as_good), ("auto", _of_auto(as_good))):
            if len(choice):
                best = choice.iloc[int(choice["cpu_seconds"].to_numpy().argmin())]
                frame.loc[i, f"{name}_seconds"] = best["cpu_seconds"]
                if name == "cheapest":
                    frame.loc[i, "cheapest_of_ours"] = best["way"]
    return frame


def _of_auto(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["way"].str.startswith("auto ")]


def peers_note(frame: pd.DataFrame) -> Note:
    """The table for the page, and whether a peer is anywhere cheaper at its own error."""
    heads = (
        "way", "theta (g)", "ln theta off (%)", "beta off", "verdicts that differ",
        "CPU (s)", "ours at no larger error", "CPU (s)",
    )  # fmt: skip
    rows = tuple(_cells(frame))
    peers = frame[frame["who"] == "peer"]
    slower = peers[~(peers["cheapest_seconds"] < peers["cpu_seconds"])]
    ratio = (peers["cpu_seconds"] / peers["cheapest_seconds"]).min()
    text = (
        "Straight-sided arch of the main job, every second record. Single studies of one method "
        f"scatter by {100.0 * frame['scatter_ln_theta'].iloc[0]:.1f} % in theta and "
        f"{frame['scatter_beta'].iloc[0]:.3f} in beta; smaller errors are not told apart. "
    )
    if len(slower):
        text += "Not faster than " + ", ".join(slower["way"]) + " at its error."
    elif len(peers):
        text += f"At equal error ours is faster than every peer, by {ratio:.1f} times at least."
    unmatched = [str(row["way"]) for _, row in peers.iterrows() if not _matched(row, frame)]
    if unmatched:
        text += (
            " Taken at face value, luck and all, no study of ours came out as close in both theta "
            f"and beta as {', '.join(unmatched)}."
        )
    return Note("Other solvers", text, heads, rows)


def _matched(row: pd.Series, frame: pd.DataFrame) -> bool:
    """Whether a study of ours has both errors no larger than a peer's."""
    names = ["ln_theta_difference", "beta_difference"]
    ours = frame.loc[frame["who"] == "ours", names].abs()
    return bool((ours <= row[names].abs()).all(axis=1).any())


def _cells(frame: pd.DataFrame) -> Iterator[tuple[str, ...]]:
    for _, row in frame.iterrows():
        known = isinstance(row.cheapest_of_ours, str) and row.cheapest_of_ours
        ours = (row.cheapest_of_ours, f"{row.cheapest_seconds:.1f}") if known else ("none", "")
        yield (
            f"{row.way} (reference)" if row.who == "reference" else str(row.way),
            f"{row.theta_g:.3f}", f"{100.0 * row.ln_theta_difference:+.1f}",
            f"{row.beta_difference:+.3f}", str(row.differ), f"{row.cpu_seconds:.1f}",
            *(ours if row.who == "peer" else ("", "")),
        )  # fmt: skip
