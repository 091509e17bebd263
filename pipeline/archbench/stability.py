"""Stability: what goes wrong where, over step or tolerance and scene."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from archbench.exact import largest_load
from archbench.facts import DEEPEST_OVERLAP, MOST_ENERGY_GAIN, NOTHING, energy_made
from archbench.measures import joint_faces, kinetic_energy, overlap
from archbench.runner import Bench, Row
from archbench.scene import STANDARD_GRAVITY, Scene, load_scene
from archbench.settings import Setting, available_methods
from archbench.solve import Frames, arch_of, solve
from archfrag.errors import ArchfragError
from archfrag.physics.methods.registry import known_methods
from archfrag.simulation.arguments import default_of

# Kinds of failure from the worst to the mildest.
FAILURES = (
    "not ended",
    "diverged",
    "unconverged",
    "drifted at rest",
    "penetrated",
    "gained energy",
    "false collapse",
    "missed collapse",
)
RIGHT = "right"
UNDECIDED = "undecided"
NOT_FOR_IT = "does not apply"
MOST_DRIFT = 1e-6  # what must rest may move so far [m]
# Steps in parts of a method's default; tolerances as they are; parts of the largest stable step
# for the methods that choose their own.
STEPS = {True: (60.0, 20.0, 6.0, 2.0, 0.6), False: (60.0, 20.0, 6.0, 2.0, 0.6, 0.2)}
TOLERANCES = {
    True: (3e-1, 1e-1, 1e-2, 1e-3, 1e-5),
    False: (3e-1, 1e-1, 1e-2, 1e-3, 1e-5, 1e-7),
}
FRACTIONS = {
    True: (4.0, 2.0, 1.0, 0.5, 0.25),
    False: (4.0, 3.0, 2.0, 1.5, 1.0, 0.5, 0.25),
}
# Of other solvers: the quick set only, most take a hundred times as long [s].
OTHER_STEPS = (3e-2, 1e-2, 3e-3, 1e-3)
# Longest that one run may take [s]: a hundred times what most need.
LIMIT = {True: 10.0, False: 20.0}
# Two methods with integrators of their own, which must agree at three levels.
REFERENCES = {
    True: (Setting("event_driven", "rtol", 1e-7), Setting("time_stepping", "dt", 1e-4)),
    False: (
        Setting("event_driven", "rtol", 1e-8),
        Setting("time_stepping", "dt", 5e-5),
    ),
}
NUDGES = (0.99, 1.0, 1.01)
# What differs in each plane, quick and in full; of `stiffness` in parts of a method's default.
PLANES = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
SET = {True: "quick", False: "values"}


class Case(NamedTuple):
    """A scene of a plane, by its value there; the own parameter of methods that differs, or ""."""

    plane: str
    value: float
    scene: Scene
    parameter: str = ""


def cases(quick: bool) -> list[Case]:
    """Scenes of the quick or of the full set."""
    arch = replace(load_scene("arch7_pulse"), duration=6.0)
    values = {name: map(float, row[SET[quick]]) for name, row in PLANES.items()}
    found = [Case("level", value, arch.at(value)) for value in values["level"]]
    changes: dict[str, list[tuple[float, Row]]] = {
        "friction": [
            (each, {"friction": each, "thickness": 2.0}) for each in values["friction"]
        ],
        "slenderness": [
            (each, {"thickness": 10.0 * each}) for each in values["slenderness"]
        ],
        "voussoirs": [(each, {"voussoirs": int(each)}) for each in values["voussoirs"]],
    }
    for plane, rows in changes.items():
        for value, changed in rows:
            scene = replace(arch, chain={**arch.chain, **changed})
            found.append(Case(plane, value, scene.at(2.1 * largest_load(scene))))
    return [*found, Case("stiffness", 1.0, arch.at(0.6), "stiffness")]


def settings_of(method: str, quick: bool, **own: float) -> list[Setting]:
    """A method at all steps, at all tolerances if it controls its error, or parts of its step."""
    info = known_methods().get(method)
    if info is None:
        return [Setting(method, "dt", step) for step in OTHER_STEPS]
    names = {parameter.name for parameter in info.parameters}
    if "rtol" in names:
        return [Setting(method, "rtol", value, own) for value in TOLERANCES[quick]]
    if "step_fraction" in names:
        return [
            Setting(method, "step_fraction", part, own) for part in FRACTIONS[quick]
        ]
    return [
        Setting(method, "dt", part * default_of(info, "dt"), own)
        for part in STEPS[quick]
    ]


def reference_of(scene: Scene, quick: bool) -> bool | None:
    """Whether it collapses, where two methods agree on it at three levels; else None."""
    seen = {
        solve(scene.at(nudge * scene.motion["amplitude"]), setting).collapsed
        for setting in REFERENCES[quick]
        for nudge in NUDGES
    }
    return seen.pop() if len(seen) == 1 else None


def elastic(scene: Scene, setting: Setting, frames: Frames) -> tuple[float, float]:
    """What springs in the joints hold in a run: depth over length, and energy over kinetic energy.

    A corner of stiffness k that bears N is overlapped by N / k and holds N² / (2 k); both shear
    springs of a joint together hold at least T² / (4 r k) for a ratio r of stiffnesses. So much
    follows from the stiffness; what is beyond is made by the method. Both 0 for rigid joints.
    """
    own = {
        each.name: each.default for each in known_methods()[setting.method].parameters
    }
    if "stiffness" not in own:
        return 0.0, 0.0
    own |= setting.own
    arch = arch_of(scene)
    before, after = joint_faces(arch, frames.displacement, frames.rotation)
    along = np.diff(0.5 * (before + after), axis=2)[:, :, 0]
    length = np.linalg.norm(along, axis=2)
    normal_of = np.stack([along[..., 1], -along[..., 0]], axis=2)
    force = frames.resultant[..., :2]
    normal, shear = ((force * side).sum(axis=2) / length for side in (normal_of, along))
    lever = 2.0 * frames.resultant[..., 2] / length
    corners = np.maximum(0.5 * np.stack([normal + lever, normal - lever], axis=2), 0.0)
    spring = 0.5 * own["stiffness"] * length
    energy = (corners**2).sum(axis=2) / (2.0 * spring)
    energy += shear**2 / (4.0 * own["shear_ratio"] * spring)
    kinetic = kinetic_energy(arch.chain, frames.velocity, frames.angular_velocity).max()
    depth = (corners / (spring * length)[..., None]).max()
    return float(depth), float(energy.sum(axis=1).max() / kinetic)


def judge_cell(
    scene: Scene, setting: Setting, expected: bool | None, must_rest: bool
) -> Row:
    """One run, and all that is wrong with it."""
    try:
        run = solve(scene, setting, history=setting.ours)
    except ArchfragError:
        return {"status": "refused", "kind": NOT_FOR_IT}
    if run.status == "not_applicable":
        return {"status": run.status, "kind": NOT_FOR_IT}
    moved = run.frames.displacement
    finite = run.status != "not_finite" and bool(
        np.isfinite(np.append(moved, run.peak)).all()
    )
    gain = math.nan
    deepest = math.nan
    drift = run.peak
    settlement = 0.0
    if run.response is not None and finite:
        gain = energy_made(scene, run.response) if run.peak > NOTHING else 0.0
        deepest = overlap(arch_of(scene), moved, run.frames.rotation)
        settlement = float(np.abs(moved[0]).max(initial=0.0))
        if settlement:  # under the own weight, before the record: soft joints only
            depth, held = elastic(scene, setting, run.frames)
            gain = max(gain - held, 0.0)
            deepest = max(deepest - depth, 0.0)
            drift = float(np.abs(moved[-1] - moved[0]).max())
    found = {
        "not ended": run.status == "work_bound" or "no answer" in run.status,
        "diverged": not finite,
        "unconverged": run.unconverged,
        "drifted at rest": must_rest and drift > max(MOST_DRIFT, settlement),
        "penetrated": deepest > DEEPEST_OVERLAP,
        "gained energy": gain > MOST_ENERGY_GAIN,
        "false collapse": run.collapsed is True and expected is False,
        "missed collapse": run.collapsed is False and expected is True,
    }
    kind = next((name for name in FAILURES if found[name]), RIGHT)
    return {
        "status": run.status,
        "kind": UNDECIDED if kind == RIGHT and expected is None else kind,
        "failures": "; ".join(name for name in FAILURES if found[name]),
        "drift": drift if must_rest else math.nan,
        "energy_gain": gain,
        "overlap": deepest,
        "seconds": run.seconds,
    }


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """All planes by all methods and other solvers."""
    limit = LIMIT[bench.quick]
    chosen = cases(bench.quick)
    expected = bench.run(
        "stability_references",
        reference_of,
        {(case.plane, case.value): (case.scene, bench.quick) for case in chosen},
        6.0 * limit,
        0.3,
    )
    tasks: dict[tuple, tuple] = {}
    heads: dict[tuple, Row] = {}
    for case in chosen:
        known = expected.get((case.plane, case.value))
        known = None if isinstance(known, str) else known
        peak = np.max(np.abs(case.scene.ground_acceleration()[0])) / STANDARD_GRAVITY
        must_rest = bool(peak <= largest_load(case.scene))
        for row, setting in _settings(case, bench):
            key = case.plane, row, *setting.columns.values()
            tasks[key] = (case.scene, setting, known, must_rest)
            heads[key] = {
                "plane": case.plane,
                "axis": PLANES[case.plane]["axis"],
                "row": row,
                **setting.columns,
                "expected": known,
                "must_rest": must_rest,
            }
    late = {"kind": FAILURES[0], "failures": FAILURES[0]}
    results = bench.run("stability", judge_cell, tasks, limit)
    cells = pd.DataFrame(
        [
            heads[key] | ({"status": own} | late if isinstance(own, str) else own)
            for key, own in results.items()
        ]
    )
    if cells.empty:
        return {}
    counts = cells.groupby(["method", "kind"], sort=False).size().unstack(fill_value=0)
    kinds = [
        kind for kind in (RIGHT, UNDECIDED, NOT_FOR_IT, *FAILURES) if kind in counts
    ]
    return {"cells": cells, "counts": counts[kinds].reset_index()}


def _settings(case: Case, bench: Bench) -> Iterator[tuple[float, Setting]]:
    """Row and setting of each cell of a scene; other solvers in those of the quick set only."""
    plane = PLANES[case.plane]
    quick = bench.quick
    if not case.parameter:
        others = (
            tuple(bench.solvers) if case.value in map(float, plane["quick"]) else ()
        )
        for method in (*available_methods(), *others):
            yield from ((case.value, each) for each in settings_of(method, quick))
        return
    for method in available_methods():
        for own in known_methods()[method].parameters:
            for part in plane[SET[quick]] if own.name == case.parameter else ():
                if own.least <= part * own.default <= own.most:
                    given = {case.parameter: part * own.default}
                    yield from (
                        (part, each) for each in settings_of(method, quick, **given)
                    )
