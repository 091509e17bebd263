"""Speed against accuracy: every method and solver at every setting on every scene."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial

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
SHORT = 0.02  # short runs are repeated up to so much [s], up to so many times
MOST = 15
LONG = 0.05  # of studies of longer runs a part is enough [s]
ONCE = 1.0  # runs of other solvers that took longer are not timed again [s]
REPEATS = {True: 3, False: 5}
LONGEST = (
    0.3,
    2.0,
)  # no finer setting where a run takes longer [CPU s]: ours, other solvers
FALL = 4.0  # other solvers need so long after our collapse to move two thicknesses [s]
LIMIT = {True: 60.0, False: 240.0}
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
    """Cost and errors of all methods, and of other solvers, on all scenes.

    Costs are measured last: in each round all methods take turns in a scene.
    """
    quick = bench.quick
    requested = "quick" if quick else "chart"
    names = [
        name
        for name in scene_names()
        if requested in load_scene(name).source.split(", ")
    ]
    limit = LIMIT[quick]
    known = bench.run(
        "references",
        reference_of,
        {(name,): (name, quick) for name in names},
        limit,
        0.25,
    )
    references = {
        name: TypeAdapter(Reference).validate_python(content)
        for (name,), content in known.items()
        if isinstance(content, dict)
    }
    rows = ladders("quick" if quick else "values", bench.solvers)
    tasks: dict[tuple, tuple] = {
        (scene, method): (reference, settings, quick)
        for scene, reference in references.items()
        for method, settings in rows.items()
    }
    points: list[Row] = []
    for (scene, method), result in bench.run(
        "errors", points_of, tasks, limit, 0.75
    ).items():
        if isinstance(result, dict):
            points += result["points"]
            for reason in result["left_out"]:
                bench.leave_out(f"{scene}, {method}", reason)
    table = pd.DataFrame(points, columns=list(POINTS))
    if table.empty:
        return {}
    costs = _costs(bench, references, table)
    return {
        "points": table.assign(seconds=costs),
        "references": pd.DataFrame(
            [row for each in references.values() for row in _reference_rows(each)]
        ),
        "levels": levels_table(table.assign(seconds=costs)),
    }


def _costs(
    bench: Bench, references: dict[str, Reference], points: pd.DataFrame
) -> pd.Series:
    """Median over rounds of what each point's run takes; what it took once, without a round."""
    tasks: dict[tuple, tuple] = {}
    for k in range(REPEATS[bench.quick]):
        for scene, own in points.groupby("scene", sort=False):
            near = own["quantity"] == "amplitude"
            chosen = own[own["seconds"] < ONCE].drop_duplicates(["method", "value"])
            settings = [
                (Setting(*row[:3]), seconds)
                for *row, seconds in chosen[[*COLUMNS[:3], "seconds"]].values.tolist()
            ]
            names = ",".join(chosen["method"].unique())
            key = k, scene, names, len(settings)
            tasks[key] = (references[str(scene)], settings, bool(near.any()))
    found = bench.run("costs", costs_of, tasks, LIMIT[bench.quick])
    rows = [
        (scene, *row)
        for (_, scene, *_), own in found.items()
        if isinstance(own, list)
        for row in own
    ]
    keys = ["scene", "method", "value"]
    measured = pd.DataFrame(rows, columns=[*keys, "study", "near"])
    medians = measured.groupby(keys).median().reset_index()
    both = points[[*keys, "quantity", "seconds"]].merge(medians, "left", keys)
    cost = np.where(both["quantity"] == "amplitude", both["near"], both["study"])
    seconds = np.where(np.isfinite(cost), cost, both["seconds"])
    return pd.Series(seconds, points.index)


def reference_of(name: str, quick: bool) -> Row | str:
    """Reference of a scene as plain types, or why there is none."""
    try:
        return asdict(find_reference(with_samples(load_scene(name)), quick))
    except ArchfragError as reason:
        return str(reason)


def points_of(
    reference: Reference, settings: Sequence[Setting], quick: bool
) -> dict[str, list]:
    """Rows of a ladder of settings on a scene, and what was left out of it."""
    scene = _scene_of(reference, settings[0])
    ours = settings[0].ours
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


def _scene_of(reference: Reference, setting: Setting) -> Scene:
    """A reference's scene; for others, who go on where ours stop at rest, to 10 ms after it."""
    scene = with_samples(load_scene(reference.scene))
    end = 0.01 * math.ceil(reference.end_time / 0.01)
    return scene if setting.ours else replace(scene, duration=min(scene.duration, end))


def _rows(
    reference: Reference,
    scene: Scene,
    setting: Setting,
    run: Solution,
    spent: float,
    quick: bool,
) -> list[Row]:
    errors = errors_of(
        observe(scene, run, reference.marks), reference.seen, scene.thickness
    )

    def row(quantity: str, error: float, status: str = "") -> Row:
        floor = reference.floor(quantity)
        drawn = not reference.why_not(quantity) and math.isfinite(error)
        return {
            "scene": reference.scene,
            "quantity": quantity,
            **setting.columns,
            "seconds": spent,
            "error": error,
            "floor": floor,
            "drawn": drawn,
            "at_floor": bool(drawn and error <= floor),
            "status": status,
        }

    known = [name for name in OF_A_RUN if setting.ours or math.isfinite(errors[name])]
    rows = [row(name, errors[name], run.status) for name in known]
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
        rows.append(row("amplitude", abs(found.offset), status))
    return rows


def costs_of(
    reference: Reference, settings: Sequence[tuple[Setting, float]], near: bool
) -> list[tuple]:
    """CPU time [s] of one run as part of a study by each setting in turn.

    A row has the method, its value, and the time in the scene and, if asked for, near collapse.
    """
    rows = []
    for setting, spent in settings:
        scene = _scene_of(reference, setting)
        scenes = [scene, scene.at(NEAR * reference.amplitude)][: 1 + near]
        times = [_cost(each, setting, spent) for each in scenes]
        rows.append((setting.method, setting.value, times[0], times[-1]))
    return rows


def _cost(scene: Scene, setting: Setting, spent: float) -> float:
    if not setting.ours:
        return solve(scene, setting).seconds
    factors = STUDY if known_methods()[setting.method].load("run_many") else STUDY[:1]
    if spent > LONG:
        factors = factors[:4]  # one for each lane
    times: list[float] = []
    while sum(times) * len(factors) < SHORT and len(times) < MOST:
        runs = solve_many(scene, setting, factors)
        times.append(float(np.mean([run.seconds for run in runs])))
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


def cost_over(points: pd.DataFrame, methods: Sequence[str]) -> pd.Series:
    """Cost of each point over the least of methods in its scene whose error is no larger."""
    own = points[points["method"].isin(methods)]
    both = points.reset_index().merge(own, on=["scene", "quantity"])
    enough = both[both["error_y"] <= both["error_x"]]
    least = enough.groupby("index")["seconds_y"].min()
    return points["seconds"] / least.reindex(points.index)


def lost_table(points: pd.DataFrame) -> pd.DataFrame:
    """Points of others whose error `auto` reaches in that scene at more cost, or not at all."""
    kept = kept_errors(points)
    kept = kept.assign(error=kept["kept"])
    ours = (kept["seconds"] / cost_over(kept, [AUTO])).fillna(math.inf)
    lost = kept.assign(auto_seconds=ours)[ours > kept["seconds"]]
    columns = ["scene", "quantity", *COLUMNS[:3], "seconds", "error", "auto_seconds"]
    return lost.loc[lost["method"] != AUTO, columns]
