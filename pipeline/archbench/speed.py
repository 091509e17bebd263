"""Speed against accuracy: every method and solver at every setting on every scene."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from pydantic import TypeAdapter

from archbench.quantities import OF_A_RUN, QUANTITIES, errors_of, observe
from archbench.reference import MARGIN, Reference, find_reference
from archbench.runner import Bench, Row
from archbench.scene import Scene, load_scene, scene_names
from archbench.settings import COLUMNS, Setting, ladders
from archbench.solve import (
    Solution,
    collapses,
    nearest_change,
    solve,
    solve_many,
    with_samples,
)
from archfrag.errors import ArchfragError
from archfrag.physics.methods.registry import AUTO, known_methods

NEAR = 0.9  # of the reference's amplitude: where the cost of a search's runs is taken
REACH = 0.5
STUDY = tuple(1.0 + 1e-5 * k for k in range(8))  # runs of a study, all but equal
SHORT = 0.1  # short runs are repeated up to so much [s], up to so many times
MOST = 15
LONGEST = (
    0.3,
    2.0,
)  # no finer setting where a run takes longer [CPU s]: ours, other solvers
FALL = 4.0  # other solvers need so long after our collapse to move two thicknesses [s]
LIMIT = {True: 120.0, False: 480.0}
# After so much of a ladder's limit no finer setting is begun; a search takes so many runs.
ENOUGH = 0.25
SEARCH = 16.0
POINTS = (
    "scene",
    "quantity",
    *COLUMNS,
    "seconds",
    "error",
    "floor",
    "drawn",
    "at_floor",
    "status",
)
LEVELS = tuple(10.0 ** (-k / 2) for k in range(1, 10))


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Cost and errors of all methods, and of other solvers, on all scenes."""
    quick = bench.quick
    place = (bench.quick, (bench.records, bench.real))
    requested = "quick" if quick else "chart"
    names = [
        name
        for name in scene_names()
        if requested in load_scene(name).source.split(", ")
    ]
    tasks = {(name, quick): (name, *place) for name in names}
    left_out: list[tuple[str, str, str]] = []
    references = {}
    for (name, _), content in bench.run(
        "references", reference_of, tasks, LIMIT[quick]
    ).items():
        if isinstance(content, str):
            left_out.append((name, "all", content))
        else:
            references[name] = TypeAdapter(Reference).validate_python(content)
    runs = {
        (scene, method, quick): (reference, settings, *place)
        for scene, reference in references.items()
        for method, settings in ladders(
            "quick" if quick else "values", bench.solvers
        ).items()
    }
    points: list[Row] = []
    for (scene, method, _), result in bench.run(
        "speed", points_of, runs, LIMIT[quick]
    ).items():
        if isinstance(result, str):
            result = {"points": [], "left_out": [result]}
        points += result["points"]
        left_out += [(scene, method, reason) for reason in result["left_out"]]
    table = pd.DataFrame(points, columns=list(POINTS))
    known = [row for each in references.values() for row in _reference_rows(each)]
    left = pd.DataFrame(left_out, columns=["scene", "method", "reason"])
    return {
        "points": table,
        "references": pd.DataFrame(known),
        "levels": levels_table(table),
        "left_out": left,
    }


def reference_of(name: str, quick: bool, folders: Sequence[Path | None]) -> Row | str:
    """Reference of a scene as plain types, or why there is none."""
    try:
        return asdict(find_reference(with_samples(load_scene(name), folders), quick))
    except ArchfragError as reason:
        return str(reason)


def points_of(
    reference: Reference,
    settings: Sequence[Setting],
    quick: bool,
    folders: Sequence[Path | None],
) -> dict[str, list]:
    """Rows of a ladder of settings on a scene, and what was left out of it."""
    scene = with_samples(load_scene(reference.scene), folders)
    ours = settings[0].ours
    if not ours:  # they go on where ours stop at rest: cut to 10 ms just after
        end = 0.01 * math.ceil(reference.end_time / 0.01)
        scene = replace(scene, duration=min(scene.duration, end))
    points: list[Row] = []
    began = time.perf_counter()
    why = ""
    for setting in settings:
        try:
            run = solve(scene, setting, history=True)
            spent = solve(scene, setting).seconds if ours else run.seconds
        except ArchfragError as reason:
            why = str(reason)
            break
        if not run.frames.time.size:
            why = run.status
            break
        points += _rows(reference, scene, setting, run, spent, quick)
        passed = time.perf_counter() - began
        slow = spent > LONGEST[0 if ours else 1] or (
            not ours and passed > ENOUGH * LIMIT[quick]
        )
        if slow and setting is not settings[-1]:
            why = f"finer than {setting.value:g}: a run took {spent:.2g} s of CPU"
            break
    return {"points": points, "left_out": [why] if why else []}


def _rows(
    reference: Reference,
    scene: Scene,
    setting: Setting,
    run: Solution,
    spent: float,
    quick: bool,
) -> list[Row]:
    cost = _cost(scene, setting, spent, quick)
    errors = errors_of(
        observe(scene, run, reference.marks), reference.seen, scene.thickness
    )

    def row(quantity: str, seconds: float, error: float, status: str = "") -> Row:
        floor = reference.floor(quantity)
        drawn = not reference.why_not(quantity) and math.isfinite(error)
        return {
            "scene": reference.scene,
            "quantity": quantity,
            **setting.columns,
            "seconds": seconds,
            "error": error,
            "floor": floor,
            "drawn": drawn,
            "at_floor": bool(drawn and error <= floor),
            "status": status,
        }

    known = [name for name in OF_A_RUN if setting.ours or math.isfinite(errors[name])]
    rows = [row(name, cost, errors[name], run.status) for name in known]
    loaded = scene if setting.ours else replace(scene, duration=scene.duration + FALL)
    uncertainty = reference.error["amplitude"]
    if not math.isnan(uncertainty) and (
        setting.ours or spent <= ENOUGH * LIMIT[quick] / SEARCH
    ):
        least = max(MARGIN * uncertainty, 0.0 if setting.ours else 1e-4)
        asked = partial(collapses, loaded, setting)
        found = nearest_change(asked, reference.amplitude, least, REACH)
        status = (
            "failed"
            if found.failed
            else "no change"
            if math.isnan(found.offset)
            else ""
        )
        near = _cost(scene.at(NEAR * reference.amplitude), setting, spent, quick)
        rows.append(row("amplitude", near, abs(found.offset), status))
    return rows


def _cost(scene: Scene, setting: Setting, spent: float, quick: bool) -> float:
    """Median CPU time of a run as part of a study [s]."""
    if not setting.ours:
        again = 0 if spent > 1.0 else 1 if quick else 3
        return float(
            np.median([spent, *(solve(scene, setting).seconds for _ in range(again))])
        )
    enough = 3 if quick or spent > LONGEST[0] else 5
    factors = STUDY if known_methods()[setting.method].load("run_many") else STUDY[:1]
    times: list[float] = []
    while len(times) < enough or (
        len(factors) * sum(times) < SHORT and len(times) < MOST
    ):
        times.append(
            float(np.mean([run.seconds for run in solve_many(scene, setting, factors)]))
        )
    return float(np.median(times))


def _reference_rows(each: Reference) -> list[Row]:
    values = {
        "amplitude": each.amplitude,
        "peak": each.seen.peak,
        "position": each.marks.position,
    }
    rows = []
    for quantity in QUANTITIES:
        away, uncertainty = each.second.get(quantity, (math.nan, math.nan))
        rows.append(
            {
                "scene": each.scene,
                "quantity": quantity,
                "value": values.get(quantity, math.nan),
                "error": each.error.get(quantity, math.nan),
                "rtol": each.tight,
                "coarser_rtol": each.loose,
                "second_away": away,
                "second_uncertainty": uncertainty,
                "exponent": each.growth["exponent"],
                "horizon": each.growth["horizon"],
                "not_drawn_because": each.why_not(quantity),
            }
        )
    return rows


def kept_errors(points: pd.DataFrame) -> pd.DataFrame:
    """Drawn points with the error that a ladder keeps: the largest at this or a finer setting.

    A coarse setting that is right by chance does not count as accurate. Errors below the floor
    stand at the floor.
    """
    frame = points[points["drawn"].astype(bool)].reset_index(drop=True)
    frame = frame.assign(kept=np.maximum(frame["error"], frame["floor"]))
    finer = (
        frame.iloc[::-1]
        .groupby(["scene", "quantity", "method"], sort=False)["kept"]
        .cummax()
    )
    return frame.assign(kept=finer.iloc[::-1])


def levels_table(points: pd.DataFrame, quantity: str = "amplitude") -> pd.DataFrame:
    """The cheapest method at each error, over the scenes that reach it."""
    kept = kept_errors(points)
    kept = kept[kept["quantity"] == quantity]
    rows = []
    for level in LEVELS:
        enough = kept[kept["kept"] <= level * (1.0 + 1e-9)]
        own = enough.loc[enough.groupby(["scene", "method"])["seconds"].idxmin()]
        best = own.groupby("scene")["seconds"].transform("min")
        own = own.assign(over_cheapest=own["seconds"] / best)
        for method, group in own.groupby("method", sort=False):
            rows.append(
                {
                    "error": level,
                    "method": method,
                    "parameter": group["parameter"].iloc[0],
                    "value": group["value"].median(),
                    "scenes": len(group),
                    "cheapest_in": int((group["over_cheapest"] == 1.0).sum()),
                    "seconds": group["seconds"].median(),
                    "over_cheapest": group["over_cheapest"].median(),
                }
            )
    return pd.DataFrame(rows)


def lost_table(points: pd.DataFrame) -> pd.DataFrame:
    """Points of others whose error `auto` reaches in that scene at more cost, or not at all."""
    kept = kept_errors(points)
    auto = kept[kept["method"] == AUTO]
    rows = []
    for _, point in kept[kept["method"] != AUTO].iterrows():
        same = auto["scene"].eq(point["scene"]) & auto["quantity"].eq(point["quantity"])
        enough = auto[same & (auto["kept"] <= point["kept"])]
        ours = float(enough["seconds"].min()) if len(enough) else math.inf
        if ours > point["seconds"]:
            rows.append(
                {
                    **point[
                        ["scene", "quantity", "method", "parameter", "value", "seconds"]
                    ],
                    "error": point["kept"],
                    "auto_seconds": ours,
                }
            )
    return pd.DataFrame(rows)
