"""Curves from the runs of a cube: collapse, limit states, other shapes and parts of dispersion."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import FitError, attempt
from archfrag.files import Named
from archfrag.fragility.curve import BoolArray, Curve, FloatArray, IntArray
from archfrag.fragility.damage import fit_state_posterior
from archfrag.fragility.efficiency import compare_measures
from archfrag.fragility.fit import fit_cloud
from archfrag.fragility.quoted import (
    check_lognormal,
    isotonic_curve,
    quoted_band,
    shared_events,
)
from archfrag.fragility.risk import mean_of
from archfrag.fragility.several import (
    crossing_words,
    split_capacities,
    split_curves,
)
from archfrag.fragility.verdicts import (
    DECIDED,
    NOTHING,
    Brackets,
    Verdict,
    find_brackets,
)
from archfrag.study.designs import Design, design_of

POINTS = 120  # of a band
MOST_LACKING = (
    0.5  # missing fraction of runs below capacities; above it, a search chose levels
)
MISFIT = 0.05  # p-value below which the lognormal curve does not describe the collapses
MOST_BELOW = 0.01  # probability of a limit state at the onset of motion
_COLLAPSE = (
    "a loss of contact that cannot be regained",
    "the severest that the table states",
)
_OF_BAND = (
    "im",
    "lower",
    "upper",
    "density",
    "method",
    "assumptions",
    "n_independent",
    "n_non_monotone",
)
Names = NDArray[np.str_]  # by row
Worded = Callable[
    [FitError], str
]  # text of an error, with its levels in the study's unit


@dataclass(frozen=True)
class ArchRuns:
    """Runs of one arch, or of all arches of a class.

    The runs of a class are the rows of its arches below each other: n_record counts all of them.
    """

    name: str
    design: Design
    verdict: IntArray  # (n_record, n_level)
    level: FloatArray  # (n_level,) or (n_record, n_level) [SI]
    # By what makes rows alike, such as the event: the name of each row's group, (n_record,).
    groups: Mapping[str, Names] = field(default_factory=dict)
    worded: Worded = str
    whole: Any = None  # cube of the study
    arches: Sequence[int] = ()  # places in it

    @cached_property
    def cube(self):
        """Cube of these arches; of neighbours it is a view, since the whole may be large."""
        first, last = self.arches[0], self.arches[-1]
        near = last - first < len(self.arches)
        return self.whole.isel(arch=slice(first, last + 1) if near else self.arches)

    @property
    def group(self) -> Names | None:
        """The grouping with the fewest groups, (n_record,); None if there is none."""
        return min(self.groups.values(), key=lambda each: len({*each}), default=None)

    @property
    def alike(self) -> Names | None:
        """Groups of rows for `quoted_band`; None if there are none.

        They are all groupings, (n_way, n_record), if there are several and some record has several
        runs. Else they are `group`, (n_record,).
        """
        several = len(self.groups) > 1 and not self.brackets.single
        return np.array([*self.groups.values()]) if several else self.group

    @property
    def collapsed(self) -> BoolArray:
        """Whether each run collapsed, (n_record, n_level)."""
        return self.verdict == Verdict.COLLAPSED

    @property
    def survived(self) -> BoolArray:
        """Whether each run survived, (n_record, n_level)."""
        return self.verdict == Verdict.SURVIVED

    @property
    def decided(self) -> BoolArray:
        """Whether each run collapsed or survived, (n_record, n_level)."""
        return np.isin(self.verdict, DECIDED)

    @cached_property
    def brackets(self) -> Brackets:
        """The brackets of the records' capacities [SI]."""
        found = find_brackets(self.verdict, self.level)
        return found.packed if self.by_level else found

    @property
    def by_level(self) -> bool:
        """Whether an index gave records their levels: those run at a level are its sample."""
        return self.whole is not None and "archfrag_levels" in self.whole.attrs

    @property
    def intact(self) -> bool:
        """Whether no first shock shook the arches before their records."""
        return "first_shock" not in self.cube or not self.cube["first_shock"].any()

    @property
    def moving(self) -> int:
        """Number of decided runs that still moved from a first shock when the record began."""
        if self.whole is None or "moving_before" not in self.cube:
            return 0
        return int(
            (
                self.cube["verdict"].isin(DECIDED) & (self.cube["moving_before"] == 1)
            ).sum()
        )

    @property
    def filled(self) -> IntArray:
        """Verdicts of all runs, (n_record, n_level).

        If `gaps`, runs that were not made have the verdicts that the capacities imply.
        """
        return self.brackets.filled if self.gaps else self.verdict

    @property
    def gaps(self) -> bool:
        """Whether the runs made at a level are no sample of the records."""
        return self.design.adaptive or (self.brackets.gaps and not self.by_level)

    @property
    def searched(self) -> bool:
        """Whether a search chose the levels of runs, or most runs below capacities are missing."""
        found = self.brackets
        made = found.verdict != Verdict.NOT_RUN
        below = (found.levels < found.lower[:, None]) & made.any(axis=0)
        lacking = int((below & ~made).sum())
        return self.design.adaptive or lacking > MOST_LACKING * below.sum()

    def onset(self, curve: Curve) -> FloatArray:
        """Return the least levels at which the arches can move [SI], 0 if they are not known.

        If the curve is a mean over several arches, there is one level for each arch; else there is
        one for all. They are known if the measure is PGA, the mechanism at onset does not slide,
        no first shock came before the records, and the arches are not a sample of a stock. If the
        mechanism slides, its onset is only an upper bound.
        """
        least = np.zeros(len(self.arches))
        if "static_limit" in self.cube:  # else runs of another program
            known = np.isfinite(self.cube["static_limit"].values)
            known &= str(self.cube["intensity"].attrs["measure"]) == "PGA"
            # Others of a stock may move earlier.
            known &= self.intact and "row" not in self.groups
            least = np.where(known, _onset_peaks(self.cube), 0.0)
        return least if curve.members is not None else np.asarray(least.min())


def runs_of_cube(
    cube: xr.Dataset, names: Iterable[str] | None = None, worded: Worded = str
) -> dict[str, ArchRuns]:
    """Return the runs of arches or classes of a cube, by name.

    If `names` is None, they are those of all arches. `worded` turns a FitError into text.
    """
    design = design_of(json.loads(cube.attrs["archfrag_design"]))
    ordered = cube.transpose("arch", "record", "level", ...)
    verdict = ordered["verdict"].values.astype(np.int64)
    levels = ordered["intensity"].values
    n_level = verdict.shape[-1]
    record = cube["record"].values.astype(str)
    rows = cube.get("stock_row", cube["arch"]).values
    event, *shocks = (
        shared_events(cube[name].values) if name in cube else None
        for name in ("event", "first_event", "first_record")
    )
    first = next((each for each in shocks if each is not None), None)
    of_class = arch_classes(cube)
    places = dict[str, list[int]]()
    for place, both in enumerate(of_class.items()):
        for name in {*both}:
            places.setdefault(name, []).append(place)
    runs = dict[str, ArchRuns]()
    for name in of_class if names is None else names:
        own = places[name]
        several = len(own) > 1
        stock = several and "stock_row" in cube and all(rows[own])
        alike = {"event": event}
        if several and (event is None or not stock):
            alike = {"record": record}
        if "first_shock" in cube and cube["first_shock"].values[own].any():
            alike["first shock"] = first
        groups = {
            what: np.tile(each, len(own))
            for what, each in alike.items()
            if each is not None
        }
        if stock:
            groups["row"] = np.repeat(rows[own].astype(str), record.size)
        runs[name] = ArchRuns(
            name,
            design,
            verdict[own].reshape(-1, n_level),
            levels[own].reshape(-1, n_level) if levels.ndim == 3 else levels,
            groups,
            worded,
            ordered,
            own,
        )
    return runs


def arch_classes(cube: xr.Dataset) -> dict[str, str]:
    """Return the class of each arch of a cube; an arch's own name if the cube has no classes."""
    names = ("arch", "arch_class" if "arch_class" in cube else "arch")
    return dict(zip(*(cube[name].values.astype(str).tolist() for name in names)))


@dataclass(frozen=True)
class Fitted:
    """Curves of the arches of a study and of its classes of several arches, and the cube."""

    arches: dict[str, Curve]  # theta in SI units, here and in `classes`
    classes: dict[str, Curve]
    cube: xr.Dataset

    @cached_property
    def runs(self) -> dict[str, ArchRuns]:
        """Runs of all arches and classes by name. They are found once, as are their brackets."""
        return runs_of_cube(self.cube, [*self.arches, *self.classes])

    @property
    def curves(self) -> dict[str, Curve]:
        """Curves of classes, then of all arches."""
        return self.classes | self.arches

    def quoted(self, members: bool = False) -> dict[str, Curve]:
        """Return the curves of classes, and of arches that are in no class.

        If `members` is true, those of all arches are returned too.
        """
        of_class = arch_classes(self.cube)
        return self.classes | {
            name: curve
            for name, curve in self.arches.items()
            if members or of_class.get(name) not in self.classes
        }

    def capacities(self, factor: float) -> pd.DataFrame:
        """Tabulate capacities as `archfrag.Results.capacities` does, all times `factor`."""
        brackets = {name: self.runs[name].brackets for name in self.arches}
        tables = [
            pd.DataFrame(
                {
                    "arch": name,
                    "record": self.cube["record"].values.astype(str),
                    "lower": factor * own.lower,
                    "upper": factor * own.upper,
                    "capacity": factor * own.middle,
                }
            )
            for name, own in brackets.items()
        ]
        return pd.concat(tables, ignore_index=True)


def curve_of(runs: ArchRuns, confidence: float) -> Curve:
    """Return the curve of some runs with the band and the intervals that are quoted.

    If there is none, its `reason` says why.
    """
    if not runs.decided.any():
        none = Curve(reason=NOTHING, confidence=confidence, name=runs.name)
        return replace(none, likelihood=none)
    try:
        likelihood = runs.design.likelihood(runs.brackets)
    except FitError as error:
        likelihood = Curve(reason=runs.worded(error))
    try:
        if len(runs.verdict) < 2:
            raise FitError("there is only one record, from which no curve follows")
        curve = quoted_band(
            runs.brackets,
            band_points(runs),
            confidence=confidence,
            groups=runs.alike,
            unit="s and ".join(runs.groups) or "event",
        )
    except FitError as error:
        curve = Curve(reason=runs.worded(error), confidence=confidence)
    return replace(curve, likelihood=likelihood, name=runs.name)


def band_points(runs: ArchRuns) -> FloatArray:
    """Return the intensities of a band [SI], from 0 to beyond the highest level."""
    return np.linspace(0.0, 1.05 * float(np.nanmax(runs.level)), POINTS)


def class_curve(pooled: Curve, members: Sequence[Curve], stock: bool = False) -> Curve:
    """Return the curve of a class of arches.

    `pooled` is the lognormal curve of all its runs together; `members` are the curves of its
    arches. The curve of the class is the mean of `members`. If one of these has no curve, or if
    the arches are a sample of a `stock`, it is `pooled`. Band and intervals are those of `pooled`
    in any case. The class has no curve by maximum likelihood.
    """
    pooled = replace(pooled, likelihood=None)
    if not pooled.fitted:
        return pooled
    fits = [each for each in members if each.fitted]
    count = len(members)
    lacking = count - len(fits)
    made = (
        f"The curve is the mean of the curves of its {count} arches; theta and beta are those of "
        "the lognormal curve with the same mean and standard deviation of ln capacity."
    )
    if stock:
        made = (
            f"Its {count} arches are a sample of a larger stock, whose curve is the lognormal one "
            "of all runs of the sample."
        )
    elif lacking:
        made = (
            f"{lacking} of its {count} arches have no curve, so the curve is the lognormal one of "
            "all runs of the class."
        )
    curve = pooled
    if not (lacking or stock):
        curve = mean_of(pooled, np.vstack([fit.parts for fit in fits]), "mixture")
    text = f"{made} Band and intervals: {pooled.assumptions}"
    return replace(curve, assumptions=text)


def completed(
    runs: ArchRuns,
    curve: Curve,
    keys: Mapping[str, float],
    detailed: bool = True,
    members: Sequence[Curve] = (),
) -> Curve:
    """Return a curve completed by what its runs show besides, such as limit states.

    `members` are the completed curves of the arches of a class; it is empty for an arch. Limit
    states, other shapes and other measures are found only if `detailed`. `keys` are the
    ``limit_states`` of a study.
    """

    def part(make: Callable[..., Named], *arguments) -> Named:
        """Return a part of the results, or the reason why it cannot be made, under ``none``."""
        made = attempt(partial(make, runs, *arguments), runs.worded)
        return {"none": made} if isinstance(made, str) else made

    known = {*runs.cube}
    parts: Named = {}
    if members:
        split = part(dispersion_split, members, curve) if curve.fitted else {}
        parts["dispersion"] = split
    elif detailed:
        parts["free"] = part(free_shapes, curve.confidence)
        if "record_measure" in known:
            parts["measures"] = part(measures_compared)
        if not runs.design.on_levels:
            parts["cloud"] = {"logistic": part(cloud_curves, curve.confidence)}
    if detailed and known & {"openings", "damage"}:
        made = attempt(partial(limit_states, runs, keys, curve), runs.worded)
        both = ((), made) if isinstance(made, str) else made
        parts["states"], parts["crossings"] = both
    lost = np.isin(runs.verdict, (Verdict.UNFINISHED, Verdict.FAILED))
    if lost.any():
        parts["n_undecided"] = int(lost.sum())
        ends = list[Curve]()
        for place, verdict in enumerate((Verdict.COLLAPSED, Verdict.SURVIVED)):
            decided = replace(runs, verdict=np.where(lost, verdict, runs.verdict))
            end = curve_of(decided, curve.confidence)
            if members:
                own = [(each.extremes or (each, each))[place] for each in members]
                end = class_curve(end, own)
            ends.append(end)
        parts["extremes"] = tuple(ends)
    return replace(curve, **parts)


def free_shapes(runs: ArchRuns, confidence: float) -> Named:
    """Return the isotonic curve, and whether the lognormal one describes the runs."""
    parts: Named = {}
    given = runs.brackets, runs.group
    try:
        curve = isotonic_curve(*given, confidence=confidence)
        parts["isotonic"] = {name: values.tolist() for name, values in curve.items()}
        p_value, _ = check_lognormal(runs.brackets)
    except FitError as error:
        return parts | {"none": runs.worded(error)}
    message = (
        f"Nothing here contradicts a lognormal curve (p = {p_value:.2g}); with a small number of "
        "records only a large misfit would show."
    )
    if p_value < MISFIT:
        message = (
            f"The lognormal curve does not describe these collapses (p = {p_value:.3g}): quote "
            "the isotonic curve too."
        )
    return parts | {"test_of_fit": {"p_value": p_value, "message": message}}


def cloud_curves(runs: ArchRuns, confidence: float) -> Named:
    """Return the curve of a cloud of runs by logistic regression, with its intervals."""
    found = runs.brackets  # one run a record
    event = None if runs.group is None else runs.group[found.run]
    return fit_cloud(*found.single_runs(), event, confidence=confidence)


def measures_compared(runs: ArchRuns) -> Named:
    """Compare the study's measure with the other measures that are known, and return the table."""
    cube = runs.cube
    known, exponent, units = known_measures(cube)
    table = compare_measures(
        runs.brackets,
        known,
        exponent,
        str(cube["intensity"].attrs["measure"]),
        magnitude=cube["magnitude"].values,
        distance=cube["distance"].values,
        event=runs.group,
    )
    for row in table["rows"]:
        row["unit"] = units[row["measure"]]
    return table


def known_measures(
    cube: xr.Dataset,
) -> tuple[dict[str, FloatArray], dict[str, float], dict]:
    """Return the measures that grow with the factor: values of records, exponents, and SI units.

    Each of these is a mapping by the name of the measure. FitError if the cube has no measures.
    """
    if "measure" not in cube:
        raise FitError(
            "a table of verdicts has one measure of its motions, so there is no other"
        )
    names = cube["measure"].values.astype(str).tolist()
    exponent, units = (
        dict(zip(names, cube[f"measure_{about}"].values.tolist()))
        for about in ("exponent", "unit")
    )
    known = {
        name: value
        for name, value in zip(names, _measures(cube))
        if exponent[name] > 0.0 and (value > 0.0).all()
    }
    return known, exponent, units


def _measures(cube: xr.Dataset):
    """Return the values of records in each measure, (n_measure, n_record)."""
    return cube["record_measure"].transpose("measure", "record").values


def limit_states(
    runs: ArchRuns, keys: Mapping[str, float], collapse: Curve
) -> tuple[tuple[Curve, ...], str]:
    """Return the curves of limit states, from light to severe, and a text on whether they cross.

    A run that collapses exceeds every state. `keys` are the ``limit_states`` of a study.
    `collapse` is the curve of collapse; for one arch it is returned last, without its band.
    """
    onset = _onset_in_measure(runs.cube)
    states = list[Curve]()
    known = dict[bytes, Curve]()
    for name, (meaning, condition) in _damage(runs.cube, keys).items():
        short = runs.decided & condition.values.reshape(runs.verdict.shape)
        exceeds = short | runs.collapsed
        key = exceeds.tobytes()  # states often coincide
        if key not in known:
            known[key] = _state_curve(runs, exceeds, collapse)
        curve = known[key]
        below = float(curve(onset)) if curve.fitted and onset > 0.0 else 0.0
        if below > MOST_BELOW:
            curve = Curve(
                reason=f"it would give a probability of {below:.2f} at the onset of motion, below "
                "which nothing moves; levels near the onset may show it"
            )
        states.append(replace(curve, name=runs.name, state=name, meaning=meaning))
    # The lightest first; what has no curve before them.
    states.sort(key=lambda each: each.theta if each.fitted else 0.0)
    bare = Curve()
    without = {name: getattr(bare, name) for name in _OF_BAND}
    meaning = _COLLAPSE["damage" in runs.cube]
    every = *states, replace(collapse, **without, meaning=meaning)
    shown = every if len(runs.arches) == 1 else every[:-1]
    return shown, crossing_words([each for each in every if each.fitted])


def _damage(cube: xr.Dataset, keys: Mapping[str, float]) -> dict[str, tuple[str, Any]]:
    """Return by limit state what it means, and which runs exceed it."""
    if "damage" in cube:
        names = json.loads(cube["damage"].attrs["states"])
        return {
            name: ("damage that the table states", cube["damage"] >= n)
            for n, name in enumerate(names[:-1])
            if n
        }
    limits = cube["static_limit"]
    residual = keys["residual"]
    rotation = keys["rotation"]
    rad = f", {limits.values[0]:.3g} rad" if limits.size == 1 else ""
    exceeded = {
        "motion": (
            "a joint opens or slides",
            cube["openings"] + cube["slides"] + cube["impacts"] > 0,
        ),
        "impact": ("a joint closes by an impact", cube["impacts"] > 0),
        "residual": (
            f"a displacement of {residual:g} of a joint's length is left",
            cube["residual_displacement"] >= residual * cube["joint_length"],
        ),
        "rotation": (
            f"rotation by {rotation:g} of the static limit{rad}",
            cube["peak_rotation"] >= rotation * limits,
        ),
        "contact lost": (
            "a joint opens at both corners, regained or not",
            np.isfinite(cube["lost_contact_time"]),
        ),
    }
    if not np.isfinite(limits).all():
        del exceeded["rotation"]
    # Corners of joints that give open in any motion.
    if np.isnan(cube["onset_plus"]).any():
        del exceeded["motion"], exceeded["impact"]
    return exceeded


def _state_curve(runs: ArchRuns, exceeds: BoolArray, collapse: Curve) -> Curve:
    """Return the curve of a limit state; its `reason` says why if there is none.

    `exceeds` says which runs exceed the state; `collapse` is the curve of collapse.
    """
    if not runs.intact:
        return Curve(
            reason="its measure is of the first shock too, so it has no curve after one"
        )
    if not (exceeds & ~runs.collapsed).any():
        return Curve(
            reason="no run exceeds it short of collapse, so it has no curve of its own"
        )
    codes = np.where(exceeds, Verdict.COLLAPSED, Verdict.SURVIVED)
    codes = np.where(runs.decided, codes, runs.verdict)
    if runs.searched:
        codes[runs.collapsed] = Verdict.NOT_RUN
        return _searched_curve(runs, codes, collapse)
    curve = curve_of(replace(runs, verdict=codes), collapse.confidence)
    if curve.fitted:
        return curve
    return Curve(reason=f"to collapse means to exceed it, and {curve.reason}")


def _searched_curve(runs: ArchRuns, short: IntArray, collapse: Curve) -> Curve:
    """Return the curve of a limit state if a search for collapse chose the levels of the runs.

    `short` has the verdicts of runs that did not collapse: COLLAPSED if they exceed the state,
    SURVIVED if not. `collapse` is the curve of collapse.
    """
    number = collapse.n_independent
    kind = runs.design.kind if runs.design.adaptive else "a search"
    chose = f"{kind} chose the levels"
    try:
        if not collapse.fitted:
            raise FitError(f"its curve needs one of collapse, and {collapse.reason}")
        found = fit_state_posterior(
            runs.brackets, find_brackets(short, runs.level), number
        )
    except FitError as error:
        return Curve(reason=f"{chose} of the runs by collapse: {runs.worded(error)}")
    return replace(
        found.with_band(band_points(runs), collapse.confidence),
        n_independent=number,
        method="posterior of the capacities for it and for collapse together",
        assumptions=f"Capacities for it and for collapse are lognormal together, as {chose} by "
        f"collapse; {number:.3g} records are independent.",
    )


def _onset_peaks(cube: xr.Dataset) -> FloatArray:
    """Return the least PGA at which each arch can move, (n_arch,) [m/s2]; 0 if it is not known.

    It is known if all points of the ground have one horizontal motion and no vertical one.
    """
    least = np.minimum(cube["onset_plus"].values, cube["onset_minus"].values)
    method = json.loads(cube.attrs.get("archfrag_config", "{}")).get("method", {})
    alike = method.get("wave_speed") is None and not method.get("bases")
    known = not cube["record_vertical"].any() and alike
    return STANDARD_GRAVITY * np.where(np.isfinite(least) & known, least, 0.0)


def _onset_in_measure(cube: xr.Dataset) -> float:
    """Return the least level at which an arch can move under its records [SI]; 0 if not known."""
    own = cube["intensity"].attrs["measure"]
    names = cube["measure"].values.tolist() if "measure" in cube else ()
    if not {own, "PGA"} <= {*names}:
        return 0.0
    known = dict(zip(names, _measures(cube)))
    power = float(cube["measure_exponent"].values[names.index(own)])
    return float(
        np.min(known[own] * (_onset_peaks(cube).min() / known["PGA"]) ** power)
    )


def dispersion_split(runs: ArchRuns, curves: Sequence[Curve], whole: Curve) -> Named:
    """Divide the dispersion of a class into that from records and that from its arches.

    `curves` are those of its arches, and `whole` is that of the class. The division follows from
    the capacities of all runs. If some records cause no collapse up to the highest level, it
    follows from the curves of maximum likelihood of the arches: without these records, the
    mildest, the capacities left would differ less. The result is empty if runs are not at the
    study's levels, or records have levels of their own.
    """
    if runs.by_level or not runs.design.on_levels:
        return {}
    capacity = runs.brackets.middle.reshape(len(curves), -1)
    known = ~np.isnan(capacity).any(axis=0)
    if known.all():
        split = split_capacities(capacity)
    else:
        # Mean correlation of ln capacities between arches, by the records known for all.
        logs = np.log(capacity[:, known])
        shared = 0.0
        if logs.shape[1] >= 3 and (np.ptp(logs, axis=1) > 0.0).all():
            shared = float(
                np.clip(
                    np.corrcoef(logs)[np.triu_indices(len(logs), k=1)].mean(), 0.0, 0.99
                )
            )
        fits = [each.likelihood for each in curves]
        numbers = [
            (fit.theta, fit.beta, fit.standard_errors[0])
            for fit in fits
            if fit is not None and fit.fitted
        ]
        split = split_curves(*np.reshape(numbers, (-1, 3)).T, shared=shared)
    if not any(split):
        return {"none": "all capacities lie between the same two levels"}
    scale = whole.beta / np.hypot(*split)
    return {"beta_record_to_record": scale * split[0], "beta_model": scale * split[1]}
