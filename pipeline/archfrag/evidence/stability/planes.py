"""Stability where methods fail: maps of what goes wrong, over step or tolerance and scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from archfrag.errors import ArchfragError
from archfrag.evidence.cases.facts import DEEPEST_OVERLAP, MOST_ENERGY_GAIN, NOTHING, energy_made
from archfrag.evidence.cases.statics import largest_load
from archfrag.evidence.judge import overlap
from archfrag.evidence.part import Frames, Note, Section, Setup
from archfrag.evidence.peers.client import Peer, PeerFailed, PeerMissing
from archfrag.evidence.run import Way, arch_of, compile_seconds, peak_acceleration, run_scene
from archfrag.evidence.run import verdict as verdict_of
from archfrag.evidence.scene import Scene, load_scene
from archfrag.evidence.stability.maps import draw_maps, lead_sentences
from archfrag.evidence.stability.watch import in_watched_processes
from archfrag.mechanics.status import Status
from archfrag.methods.registry import METHODS
from archfrag.simulation.checks import available_methods, default_of

# What must rest may move so far [m].
MOST_DRIFT = 1e-6
# Steps in parts of a method's default; tolerances as they are.
STEPS = {True: (60.0, 20.0, 6.0, 2.0, 0.6), False: (60.0, 20.0, 6.0, 2.0, 0.6, 0.2)}
TOLERANCES = {True: (3e-1, 1e-1, 1e-2, 1e-3, 1e-5), False: (3e-1, 1e-1, 1e-2, 1e-3, 1e-5, 1e-7)}
# Of the largest stable step, for the methods that choose their own.
FRACTIONS = {True: (4.0, 2.0, 1.0, 0.5, 0.25), False: (4.0, 3.0, 2.0, 1.5, 1.0, 0.5, 0.25)}
PEER_STEP = 5e-4
# Longest that one run may take [s]: a hundred times what most need.
LIMIT = {True: 10.0, False: 60.0}
# References: two methods with integrators of their own, which must agree at three levels.
REFERENCES = {
    True: (Way("event_driven", "rtol", 1e-7), Way("time_stepping", "dt", 1e-4)),
    False: (Way("event_driven", "rtol", 1e-8), Way("time_stepping", "dt", 5e-5)),
}
NUDGES = (0.99, 1.0, 1.01)
_WORDS = {True: "falls", False: "stands", None: "no answer"}
Row = dict[str, Any]


@dataclass(frozen=True)
class Plane:
    """One map's axis across the methods' own: scenes that differ in one thing.

    Attributes
    ----------
    name, title, axis : str
        `axis` is what differs, with its unit.
    scenes : tuple of (str, Scene)
        With the label of each row.
    setting : str
        The methods' own parameter that differs instead, for those that have it; else empty.
    parts : tuple of float
        Of that parameter's default.
    """

    name: str
    title: str
    axis: str
    scenes: tuple[tuple[str, Scene], ...]
    setting: str = ""
    parts: tuple[float, ...] = ()


def planes(quick: bool) -> list[Plane]:
    """Maps of the quick or of the full set."""
    arch = load_scene("arch7_pulse")
    arch = replace(arch, duration=6.0)

    def of(values: Sequence[float], scene_of: Any, text: str = "{:g}") -> tuple:
        return tuple((text.format(value), scene_of(value)) for value in values)

    def beyond_onset(chain: dict[str, Any], times: float) -> Scene:
        scene = replace(arch, chain={**arch.chain, **chain})
        return scene.at(times * largest_load(scene))

    if quick:
        levels: tuple[float, ...] = (0.2, 0.36, 0.45, 0.6, 0.75, 0.9, 1.5)
        frictions: tuple[float, ...] = (0.35, 0.4, 0.5, 0.7, math.inf)
        slender: tuple[float, ...] = (0.12, 0.15, 0.2, 0.3)
        counts: tuple[int, ...] = (3, 7, 15, 27)
    else:
        levels = (0.1, 0.2, 0.3, 0.36, 0.39, 0.45, 0.5, 0.6, 0.65, 0.75, 0.8, 1.0, 1.5)
        frictions = (0.33, 0.36, 0.4, 0.45, 0.5, 0.6, 0.7, 1.0, 1.5, math.inf)
        slender = (0.11, 0.12, 0.13, 0.15, 0.18, 0.2, 0.25, 0.3)
        counts = (2, 3, 5, 7, 11, 15, 21, 27, 41)
    strong = arch.at(0.6)
    return [
        Plane(
            "level", "Level of the motion (onset is at 0.374 g)", "peak acceleration [g]",
            of(levels, arch.at),
        ),
        Plane(
            "friction", "Friction, arch of t/R 0.2 at 2.1 times its onset", "friction",
            of(frictions, lambda mu: beyond_onset({"friction": mu, "thickness": 2.0}, 2.1)),
        ),
        Plane(
            "slenderness", "Slenderness, at 2.1 times the onset", "t/R",
            of(slender, lambda t: beyond_onset({"thickness": 10.0 * t}, 2.1)),
        ),
        Plane(
            "voussoirs", "Number of voussoirs, at 2.1 times the onset", "voussoirs",
            of(counts, lambda n: beyond_onset({"voussoirs": n}, 2.1)),
        ),
        Plane(
            "stiffness", "Joint stiffness in parts of the default, at 0.6 g", "stiffness",
            (("", strong),), "stiffness",
            (0.01, 0.1, 1.0, 10.0) if quick else (0.001, 0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0),
        ),
    ]  # fmt: skip


def ways(method: str, quick: bool, settings: dict[str, float] | None = None) -> list[Way]:
    """A method at all steps, or at all tolerances if it controls its error.

    A method that divides its step by itself is varied by the part of the critical step.
    """
    info, own = METHODS[method], settings or {}
    names = {parameter.name for parameter in info.parameters}
    if "rtol" in names:
        return [Way(method, "rtol", value, own) for value in TOLERANCES[quick]]
    default = default_of(info, "dt")
    if "step_fraction" in names:
        return [
            Way(method, "dt", default, {**own, "step_fraction": part}) for part in FRACTIONS[quick]
        ]
    return [Way(method, "dt", part * default, own) for part in STEPS[quick]]


def knob_of(way: Way) -> tuple[str, float]:
    """What differs across a map, and its value."""
    if "step_fraction" in way.settings:
        return "step_fraction", way.settings["step_fraction"]
    return way.knob, way.value


def reference(scene: Scene, quick: bool) -> str:
    """ "falls" or "stands" if two methods agree on it at three levels; else "undecided"."""
    said = set()
    for way in REFERENCES[quick]:
        for nudge in NUDGES:
            response = run_scene(scene.at(nudge * scene.motion["amplitude"]), way)
            said.add(_WORDS[verdict_of(response)])
            if len(said) > 1 or "no answer" in said:
                return "undecided"
    return said.pop()


def judge_cell(scene: Scene, way: Way, expected: str, must_rest: bool) -> Row:
    """One run, and all that is wrong with it.

    Parameters
    ----------
    scene : Scene
    way : Way
    expected : str
        As `reference` says.
    must_rest : bool
        Whether the motion stays inside the rest range.

    Returns
    -------
    dict
        A flag for each kind of failure, and the figures: `drift` [m], `energy_gain`, `overlap`,
        `status`, `verdict`, `seconds`.
    """
    try:
        response = run_scene(scene, way, history=True)
    except ArchfragError as reason:
        return {"status": "refused", "reason": str(reason), "does not apply": True}
    fell = verdict_of(response)
    status, history = response.status, response.history
    if status is Status.NOT_APPLICABLE:
        return {"status": status.name.lower(), "does not apply": True}
    assert history is not None
    moved = response.peak_displacement
    positions = history.displacement.values
    finite = status is not Status.NOT_FINITE and bool(np.isfinite(positions).all())
    finite = finite and math.isfinite(moved)
    row: Row = {
        "status": status.name.lower(), "verdict": _WORDS[fell], "reason": "",
        "seconds": response.wall_time, "drift": moved if must_rest else math.nan,
    }  # fmt: skip
    row |= {"diverged": not finite, "hung": status is Status.WORK_BOUND}
    row["unconverged"] = status is Status.NO_CONTACT_SOLUTION or bool(
        response.work.get("unconverged", 0)
    )
    gain = deepest = math.nan
    if finite:
        gain = energy_made(scene, response) if moved > NOTHING else 0.0
        deepest = overlap(arch_of(scene), positions, history.rotation.values)
    row |= {"energy_gain": gain, "overlap": deepest}
    row["drifted at rest"] = must_rest and moved > MOST_DRIFT
    row["gained energy"] = gain > MOST_ENERGY_GAIN
    row["penetrated"] = deepest > DEEPEST_OVERLAP
    return row | _against(expected, fell)


def measure(setup: Setup) -> dict[str, pd.DataFrame]:
    """All planes by all registered methods, and by the peers asked for.

    Returns
    -------
    dict
        `cells`: a row for each run; `references`: the verdict that each scene is judged by.
    """
    chosen = planes(setup.quick)
    prepare = partial(compile_seconds, available_methods())
    watched = partial(
        in_watched_processes, workers=setup.workers, limit=LIMIT[setup.quick], prepare=prepare
    )
    scenes = [(plane, label, scene) for plane in chosen for label, scene in plane.scenes]
    said = in_watched_processes(
        reference, [(scene, setup.quick) for _, _, scene in scenes], setup.workers,
        6.0 * LIMIT[setup.quick], prepare,
    )  # fmt: skip
    rest = [peak_acceleration(scene) <= largest_load(scene) for _, _, scene in scenes]
    heads: list[Row] = []
    tasks = []
    for (plane, label, scene), expected, must_rest in zip(scenes, said, rest):
        for method in available_methods():
            for row_label, settings in _rows_of(plane, label, method):
                for way in ways(method, setup.quick, settings):
                    heads.append(_head(plane, row_label, method, *knob_of(way)))
                    tasks.append((scene, way, expected or "undecided", must_rest))
    setup.say(f"stability: {len(tasks)} runs of {len(available_methods())} methods")
    found = watched(judge_cell, tasks)
    rows = [head | _finished(row) for head, row in zip(heads, found)]
    for name in setup.peers:
        rows += _peer_rows(name, scenes, said, rest, setup)
    references = [
        {"plane": plane.name, "row": label, "reference": expected or "undecided",
         "must_rest": still, "amplitude": scene.motion["amplitude"]}
        for (plane, label, scene), expected, still in zip(scenes, said, rest)
    ]  # fmt: skip
    return {"cells": pd.DataFrame(rows), "references": pd.DataFrame(references)}


def show(frames: Frames) -> Section:
    """Maps of each plane, and how often each method fails in which way."""
    cells, references = frames["cells"], frames["references"]
    titles = {plane.name: plane for plane in planes(True)}
    undecided = int((references["reference"] == "undecided").sum())
    lead = [
        f"{len(cells)} runs of {len(references)} scenes, each judged from outside. Verdicts are "
        "judged where a tight event_driven and a fine time_stepping agree, at the level itself "
        f"and 1 % to either side: in all but {undecided} of the scenes.",
        *lead_sentences(cells),
    ]
    pictures = {
        f"stability-{name}": draw_maps(
            f"stability-{name}", titles[name].title, titles[name].axis,
            cells[cells["plane"] == name],
        )
        for name in titles
        if (cells["plane"] == name).any()
    }  # fmt: skip
    notes = [
        Note(
            "How a run is judged",
            "Hung: no answer in the time or the work allowed. Diverged: not finite. Unconverged: "
            "the contact problem was given up. Drifted at rest: moved by more than "
            f"{MOST_DRIFT:g} m where the motion stays inside the rest range. Penetrated: overlap "
            f"above {DEEPEST_OVERLAP:g} of a joint's length. Gained energy: more than "
            f"{MOST_ENERGY_GAIN:g} of the largest kinetic energy that the ground did not give. "
            "False and missed collapse: against the verdict of the reference. A map shows the "
            "first of these in this order; the table has all.",
        )
    ]
    return Section("Stability: where methods fail", lead, pictures, notes)


def _rows_of(plane: Plane, label: str, method: str) -> list[tuple[str, dict[str, float]]]:
    """Labels and settings of a scene's rows for a method; none if it lacks the plane's setting."""
    if not plane.setting:
        return [(label, {})]
    for parameter in METHODS[method].parameters:
        if parameter.name == plane.setting:
            values = [(part, part * parameter.default) for part in plane.parts]
            return [
                (f"{part:g}", {plane.setting: value})
                for part, value in values
                if parameter.least <= value <= parameter.most
            ]
    return []


def _head(plane: Plane, label: str, method: str, knob: str, value: float) -> Row:
    return {"plane": plane.name, "row": label, "method": method, "knob": knob, "value": value}


def _finished(row: Row | None) -> Row:
    return {"status": "out of time", "hung": True} if row is None else row


def _against(expected: str, fell: bool | None) -> Row:
    return {
        "expected": expected,
        "false collapse": fell is True and expected == "stands",
        "missed collapse": fell is False and expected == "falls",
        "undecided": expected == "undecided",
    }


def _peer_rows(
    name: str, scenes: Sequence[tuple[Plane, str, Scene]], said: Sequence[str | None],
    rest: Sequence[bool], setup: Setup,
) -> list[Row]:  # fmt: skip
    """The same cells by a peer, by what can be seen of it: centroids, and what it says."""
    try:
        peer = Peer(name, LIMIT[setup.quick])
    except PeerMissing as reason:
        setup.say(f"stability: {name} is skipped: {reason}")
        return []
    rows = []
    for (plane, label, scene), expected, must_rest in zip(scenes, said, rest):
        if plane.setting:
            continue
        for part in STEPS[setup.quick]:
            dt = part * PEER_STEP
            row = _head(plane, label, name, "dt", dt)
            rows.append(row)
            try:
                outcome = peer.run(scene, dt)
            except PeerFailed as failure:
                out_of_time = "no answer" in str(failure)
                row |= {"status": str(failure), "hung": out_of_time, "diverged": not out_of_time}
                continue
            moved = outcome.peak_displacement
            row |= {
                "status": "ended", "verdict": _WORDS[outcome.collapsed],
                "seconds": outcome.wall_seconds, "drift": moved if must_rest else math.nan,
                "diverged": not math.isfinite(moved), "unconverged": bool(outcome.unconverged),
                "drifted at rest": must_rest and moved > MOST_DRIFT,
            } | _against(expected or "undecided", outcome.collapsed)  # fmt: skip
    peer.close()
    return rows
