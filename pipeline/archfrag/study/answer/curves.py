"""Answers from the runs of a cube: curves, other shapes, measures, limit states, dispersion."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import FitError
from archfrag.fragility.counts import NOTHING, Brackets, Verdict, find_brackets
from archfrag.fragility.curve import FloatArray, Fragility, mixture, split_capacities, split_curves
from archfrag.fragility.efficiency import compare_measures
from archfrag.fragility.fit import fit_cloud
from archfrag.fragility.limit_states import state_to_dict, told_order
from archfrag.fragility.quoted import (
    Answer,
    check_lognormal,
    curve_to_dict,
    isotonic_curve,
    shared_events,
)
from archfrag.study.designs import Design, design_of

POINTS = 120  # of a band
MISFIT = 0.05  # p-value below which the lognormal curve does not describe the collapses
MOST_BELOW = 0.01  # probability of a limit state at the onset of motion
_DRAWN: dict[str, Any] = {"seed": 1, "resamples": 300}
Worded = Callable[[FitError], str]  # text of an error, with its levels in the unit people read


@dataclass(frozen=True)
class Runs:
    """Runs of one arch, or of all arches of a class under each other."""

    name: str
    design: Design
    verdict: NDArray[np.int64]  # (n_record, n_level)
    level: FloatArray  # (n_level,) or (n_record, n_level) [SI]
    # (n_record,): what rows have in common: an earthquake, or for a class the record.
    group: NDArray[np.str_] | None = None
    unit: str = "event"  # which of the two
    worded: Worded = str
    whole: Any = None  # cube of the study
    arches: Sequence[int] = ()  # places in it

    @cached_property
    def cube(self) -> Any:
        """Cube of these arches."""
        return self.whole.isel(arch=self.arches)

    @property
    def decided(self) -> NDArray[np.bool_]:
        """Runs that collapsed or survived."""
        return (self.verdict == Verdict.COLLAPSED) | (self.verdict == Verdict.STANDING)

    @cached_property
    def brackets(self) -> Brackets:
        """Between which levels the capacity of each record lies [SI]."""
        return find_brackets(self.verdict, self.level)


def runs_of_cube(
    cube: xr.Dataset, names: Iterable[str] | None = None, worded: Worded = str
) -> list[Runs]:
    """Runs of arches or classes of a cube; of each of its arches if no names are given."""
    design = design_of(json.loads(cube.attrs["archfrag_design"]))
    record, event = cube["record"].values.astype(str), shared_events(cube["event"].values)
    of_class, places = arch_classes(cube), dict[str, list[int]]()
    for place, both in enumerate(of_class.items()):
        for name in set(both):
            places.setdefault(name, []).append(place)
    found, ordered = [], cube.transpose("arch", "record", "level", ...)
    verdict, levels = ordered["verdict"].values.astype(np.int64), ordered["intensity"].values
    n_level = verdict.shape[-1]
    for name in of_class if names is None else names:
        own = places[name]
        level = levels[own].reshape(-1, n_level) if levels.ndim == 3 else levels
        group, unit = (event, "event") if len(own) == 1 else (np.tile(record, len(own)), "record")
        rows = verdict[own].reshape(-1, n_level)
        found.append(Runs(name, design, rows, level, group, unit, worded, ordered, own))
    return found


def capacities(cube: xr.Dataset, factor: float) -> pd.DataFrame:
    """Tabulate capacities as `archfrag.Results.capacities` does, all times `factor`."""
    records = cube["record"].values.astype(str)
    tables = [
        pd.DataFrame({
            "arch": runs.name, "record": records, "lower": factor * known.lower,
            "upper": factor * known.upper, "capacity": factor * known.middle,
        })
        for runs in runs_of_cube(cube) for known in [runs.brackets]
    ]  # fmt: skip
    return pd.concat(tables, ignore_index=True)


def answer(runs: Runs, confidence: float) -> Answer:
    """Curve of some runs with the band and the intervals that are quoted."""
    if not runs.decided.any():
        return Answer(NOTHING, NOTHING, confidence=confidence)
    try:
        likelihood: Fragility | str = runs.design.likelihood(runs.brackets)
    except FitError as error:
        likelihood = runs.worded(error)
    im = np.linspace(0.0, 1.05 * float(np.nanmax(runs.level)), POINTS)
    options = {"confidence": confidence, "groups": runs.group, "unit": runs.unit}
    try:
        if len(runs.verdict) < 2:
            raise FitError("there is only one record, from which no curve follows")
        found = runs.design.estimate(runs.brackets, im, **options)
    except FitError as error:
        return Answer(runs.worded(error), likelihood, confidence=confidence)
    return replace(found, likelihood=likelihood)


def of_class(pooled: Answer, members: Sequence[Answer]) -> Answer:
    """Answer of a class, from that of all its runs together and those of its arches.

    Its curve is the mean of those of its arches; if one of these has none, the lognormal curve of
    all runs. Band and intervals are of the latter. The class has no other curve, and one beta.
    """
    if isinstance(curve := pooled.curve, str):
        return replace(pooled, likelihood="")
    fits = [each.curve for each in members if isinstance(each.curve, Fragility)]
    count, lacking = len(members), len(members) - len(fits)
    made = (
        f"The curve is the mean of the curves of its {count} arches; theta and beta are those of "
        "the lognormal curve with the same mean and standard deviation of ln capacity."
    )
    if lacking:
        made = (
            f"{lacking} of its {count} arches have no curve, so the curve is the lognormal one of "
            "all runs of the class."
        )
    text = f"{made} Band and intervals: {pooled.assumptions}"
    whole = curve if lacking else mixture(curve, fits)
    return replace(pooled, curve=whole, likelihood="", assumptions=text)


def without_verdict(runs: Runs, confidence: float) -> dict[str, Any]:
    """Number of runs that no method decided, and the curves if all collapse and if all stand."""
    lost = np.isin(runs.verdict, (Verdict.UNFINISHED, Verdict.SOLVER_FAILURE))
    if not lost.any():
        return {}
    found: dict[str, Any] = {"runs": int(lost.sum())}
    for name, verdict in (("collapsed", Verdict.COLLAPSED), ("standing", Verdict.STANDING)):
        filled = replace(runs, verdict=np.where(lost, verdict, runs.verdict))
        found[name] = curve_to_dict(answer(filled, confidence).curve)
    return found


def arch_classes(cube: xr.Dataset) -> dict[str, str]:
    """Class of each arch of a cube; its own name where the cube holds none."""
    classes = cube["arch_class" if "arch_class" in cube else "arch"]
    return dict(zip(cube["arch"].values.astype(str).tolist(), classes.values.astype(str).tolist()))


def quoted(
    cube: xr.Dataset, answers: Mapping[str, Answer], classes: Mapping[str, Answer],
    members: bool = False,
) -> dict[str, Answer]:  # fmt: skip
    """Answers of classes and of arches that are of none; with `members` of all arches."""
    of_class = arch_classes(cube)
    alone = {k: a for k, a in answers.items() if members or of_class.get(k) not in classes}
    return {**classes, **alone}


def free_shapes(runs: Runs, confidence: float) -> dict[str, Any]:
    """Curves without a shape given beforehand, and whether the lognormal one fits the runs."""
    found: dict[str, Any] = {}
    try:
        curve = isotonic_curve(runs.brackets, runs.group, confidence=confidence, **_DRAWN)
        found["isotonic"] = {name: values.tolist() for name, values in curve.items()}
        p_value, _ = check_lognormal(runs.brackets, **_DRAWN)
    except FitError as error:
        return found | {"none": runs.worded(error)}
    message = (
        f"Nothing here contradicts a lognormal curve (p = {p_value:.2g}); with a small number of "
        "records only a large misfit would show."
    )
    if p_value < MISFIT:
        message = (
            f"The lognormal curve does not describe these collapses (p = {p_value:.3g}): quote "
            "the isotonic curve too."
        )
    return found | {"test_of_fit": {"p_value": p_value, "message": message}}


def cloud_curves(runs: Runs, confidence: float) -> dict[str, Any]:
    """Curve of a cloud by logistic regression."""
    decided = runs.decided  # each record has one run
    event = None if runs.group is None else runs.group[decided.any(axis=1)]
    collapsed = runs.verdict[decided] == Verdict.COLLAPSED
    return fit_cloud(runs.level[decided], collapsed, event, confidence=confidence, **_DRAWN)


def measures_compared(runs: Runs) -> dict[str, Any]:
    """The study's measure compared with others in which its motions are known."""
    cube = runs.cube
    names = cube["measure"].values.astype(str).tolist()
    value = cube["record_measure"].transpose("measure", "record").values
    exponent = dict(zip(names, cube["measure_exponent"].values.tolist()))
    known = {k: v for k, v in zip(names, value) if exponent[k] > 0.0 and (v > 0.0).all()}
    table = compare_measures(
        runs.brackets, known, exponent, str(cube["intensity"].attrs["measure"]),
        magnitude=cube["magnitude"].values, distance=cube["distance"].values,
        event=runs.group,
    )  # fmt: skip
    units = dict(zip(names, cube["measure_unit"].values.astype(str).tolist()))
    return {**table, "rows": [{**row, "unit": units[row["measure"]]} for row in table["rows"]]}


def limit_states(runs: Runs, keys: Mapping[str, float], collapse: Answer) -> dict[str, Any]:
    """Answers of damage short of collapse, from light to severe, and of `collapse`.

    A run exceeds a state if it does or collapses. `keys` are the ``limit_states`` of a study.
    """
    cube, collapsed = runs.cube, runs.verdict == Verdict.COLLAPSED
    limits, residual, rotation = cube["static_limit"], keys["residual"], keys["rotation"]
    rad = f", {limits.values[0]:.3g} rad" if limits.size == 1 else ""
    exceeded = {
        "motion": ("a joint opens or slides",
                   cube["openings"] + cube["slides"] + cube["impacts"] > 0),
        "impact": ("a joint closes by an impact", cube["impacts"] > 0),
        "residual": (f"a displacement of {residual:g} of a joint's length is left",
                     cube["residual_displacement"] >= residual * cube["joint_length"]),
        "rotation": (f"rotation by {rotation:g} of the static limit{rad}",
                     cube["peak_rotation"] >= rotation * limits),
        "contact lost": ("a joint opens at both corners, regained or not",
                         np.isfinite(cube["lost_contact_time"])),
    }  # fmt: skip
    if not np.isfinite(limits).all():
        del exceeded["rotation"]
    onset, found = _onset(cube), []
    for name, (meaning, condition) in exceeded.items():
        holds = runs.decided & condition.values.reshape(runs.verdict.shape)
        why = "no run exceeds it short of collapse, so it has no curve of its own"
        if runs.design.adaptive:
            # Measured: theta 9 to 34 % too low at 0.6 to 0.8 of that of collapse.
            why = f"{runs.design.kind} chose the levels of the runs by collapse, which biases it"
        own = Answer(why, why, confidence=collapse.confidence)
        if not runs.design.adaptive and (holds & ~collapsed).any():
            codes = np.where(holds | collapsed, Verdict.COLLAPSED, Verdict.STANDING)
            codes = np.where(runs.decided, codes, runs.verdict)
            own = answer(replace(runs, verdict=codes), collapse.confidence)
            if isinstance(own.curve, str):
                own = replace(own, curve=f"to collapse means to exceed it, and {own.curve}")
            elif onset > 0.0 and (below := float(own.curve.probability(onset))) > MOST_BELOW:
                own = replace(own, curve=(
                    f"it would give a probability of {below:.2f} at the onset of motion, below "
                    "which nothing moves; levels near the onset may show it"
                ))  # fmt: skip
        found.append((name, meaning, own))
    # The lightest first; what has no curve before them.
    found.sort(key=lambda each: getattr(each[2].curve, "theta", 0.0))
    curves = [(name, own.curve) for name, _, own in found] + [("collapse", collapse.curve)]
    known = [(name, fit) for name, fit in curves if isinstance(fit, Fragility)]
    last = Answer(collapse.curve, collapse.likelihood, collapse.theta, collapse.beta)
    found.append(("collapse", "a loss of contact that cannot be regained", last))
    states = [{"name": name, "meaning": words, **state_to_dict(own)} for name, words, own in found]
    return {"message": told_order(known), "states": states}


def onsets(cube: xr.Dataset) -> FloatArray:
    """Least PGA at which each arch can move, (n_arch,), 0 where that is not known [m/s2].

    It is known where all points of the ground have one horizontal motion and no vertical one.
    """
    least = np.minimum(cube["onset_plus"].values, cube["onset_minus"].values)
    least = STANDARD_GRAVITY * np.where(np.isfinite(least), least, 0.0)
    method = json.loads(cube.attrs.get("archfrag_config", "{}")).get("method", {})
    unknown = bool(cube["record_vertical"].any()) or method.get("delay") is not None
    return 0.0 * least if unknown else least


def onsets_in_measure(cube: xr.Dataset) -> FloatArray:
    """Least levels at which arches can move, (n_arch,), 0 where that is not known [SI].

    It is known in PGA, if the mechanism at onset does not slide: else its onset is an upper bound.
    """
    known = np.isfinite(cube["static_limit"].values)
    known &= str(cube["intensity"].attrs["measure"]) == "PGA"
    return np.where(known, onsets(cube), 0.0)


def _onset(cube: xr.Dataset) -> float:
    """Least level at which an arch can move under its records, 0 where that is not known [SI]."""
    own, names = cube["intensity"].attrs["measure"], cube["measure"].values.astype(str).tolist()
    if not {own, "PGA"} <= set(names):
        return 0.0
    value = dict(zip(names, cube["record_measure"].transpose("measure", "record").values))
    power = float(cube["measure_exponent"].values[names.index(own)])
    return float(np.min(value[own] * (onsets(cube).min() / value["PGA"]) ** power))


def dispersion_split(runs: Runs, answers: Sequence[Answer], beta: float) -> dict[str, Any]:
    """Parts of the dispersion `beta` of a class: from record to record, and between its arches.

    By the capacities of all runs; by the likeliest curve of each arch, whose `answers` are given,
    where records withstand the largest level, since without these, the mildest, what is left would
    differ less.
    """
    if not runs.design.on_levels:
        return {}
    capacity = runs.brackets.middle.reshape(len(answers), -1)
    known = ~np.isnan(capacity).any(axis=0)
    if known.all():
        split = split_capacities(capacity)
    else:
        # Mean correlation of ln capacities between arches, by the records known for all.
        logs, shared = np.log(capacity[:, known]), 0.0
        if logs.shape[1] >= 3 and (np.ptp(logs, axis=1) > 0.0).all():
            pairs = np.triu_indices(len(logs), k=1)
            shared = float(np.clip(np.corrcoef(logs)[pairs].mean(), 0.0, 0.99))
        fits = [a.likelihood for a in answers if isinstance(a.likelihood, Fragility)]
        split = split_curves(
            [fit.theta for fit in fits], [fit.beta for fit in fits],
            [fit.standard_errors[0] for fit in fits], shared=shared,
        )  # fmt: skip
    scale = beta / np.hypot(*split)
    return {"beta_record_to_record": scale * split[0], "beta_model": scale * split[1]}
