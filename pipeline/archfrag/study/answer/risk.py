"""From the cube, the curves and a hazard to rates of collapse, and who contributes to them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.fragility.contributions import (
    Contributions,
    contributions,
    implied_collapses,
    level_edges,
    value_bins,
)
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.quoted import shared_events
from archfrag.fragility.risk import CollapseRate, collapse_rate, parameter_draws, rate_by_level
from archfrag.mechanics.status import CollapseMode
from archfrag.study.answer.curves import arch_classes
from archfrag.study.file.hazard import Hazard

SEED = 15
NOTED = 0.05  # fraction of a rate from where nothing is known that is worth a message
MOST_CATEGORIES = 8
MAGNITUDES = (5.5, 6.0, 6.5, 7.0, 7.5)
DISTANCES = (10.0, 20.0, 40.0, 80.0, 160.0)  # [km]
OTHER = "others"
_SCATTERED_BINS = 10
_USED = (
    "verdict", "collapse_joint", "collapse_mode", "intensity", "magnitude", "distance", "event",
)  # fmt: skip


@dataclass(frozen=True)
class ArchRisk:
    """Rate of collapse of one arch and its parts."""

    arch: str
    fit: Fragility
    rate: CollapseRate  # with the first curve of the hazard
    by_curve: dict[str, float]  # rate with each curve of the hazard [1/year]: its own uncertainty
    levels: FloatArray  # (n_level,): intensities that stand for the ranges [SI]
    edges: FloatArray  # (n_level - 1,): between ranges; the first begins at 0, the last has no end
    level_rate: FloatArray  # (n_level,) [1/year]
    # Fractions of the rate from intensities below the least and above the greatest level that was
    # simulated, where the fitted curve is extrapolated.
    below_levels: float
    above_levels: float
    by_mechanism: Contributions
    by_magnitude: Contributions
    by_distance: Contributions
    cautions: tuple[str, ...]


@dataclass(frozen=True)
class StudyRisk:
    """Rates of collapse of arches and classes; one without a curve has its message."""

    study: str
    hazard: Hazard
    years: float
    arches: dict[str, ArchRisk | str]  # classes as well
    classes: dict[str, int]  # number of arches of each class among them


@dataclass(frozen=True)
class _Runs:
    """Runs of one arch on a grid of intensity, arrays (n_record, n_level)."""

    levels: FloatArray  # (n_level,)
    collapsed: NDArray[np.bool_]
    joint: NDArray
    mode: NDArray
    least: float
    greatest: float


def risk_of(
    cube: xr.Dataset,
    fits: Mapping[str, Fragility | str],
    hazard: Hazard,
    years: float = 50.0,
    confidence: float = 0.9,
) -> StudyRisk:
    """Rates of collapse of arches and classes of a study at a site.

    Parameters
    ----------
    cube : xarray.Dataset
    fits : mapping of str to Fragility or str
        By arch or class, theta in the SI unit of the measure, or why there is no curve. The rate
        of a class is the mean of the rates of its arches.
    hazard : Hazard
        From `archfrag.study.file.hazard.load_hazard`, for the study's measure.
    years : float
        Time for probabilities of collapse.
    confidence : float
        Two-sided, of all bands.

    Raises
    ------
    InputError
        If the cube's levels are of another measure, `years` or `confidence` cannot be, or the cube
        lacks a variable.
    """
    measure = cube["intensity"].attrs.get("measure", hazard.measure)
    if measure != hazard.measure:
        kinds = f"is a hazard for levels of {hazard.measure}, but the cube's are of {measure}"
        raise InputError(f"{hazard.source}: {kinds}")
    if not 0.0 < years < np.inf:
        raise InputError(f"years is {years:g}; a positive finite time is needed")
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}; it must be between 0 and 1")
    arches: dict[str, Any] = {}
    places: dict[str, list[int]] = {}
    for number, (name, of_class) in enumerate(arch_classes(cube).items()):
        places[name] = [number]
        if of_class != name:
            places.setdefault(of_class, []).append(number)
    counts = {name: n for name in fits if (n := len(places[name])) > 1}
    for name, fit in fits.items():
        arches[name] = fit
        if not isinstance(fit, str):
            part = _together(cube, places[name])
            arches[name] = _arch_risk(name, part, fit, hazard, confidence)
    return StudyRisk(str(cube.attrs.get("archfrag_study", "")), hazard, years, arches, counts)


def _together(cube: xr.Dataset, places: list[int]) -> xr.Dataset:
    """Runs of several arches under each other: a record for each arch and record with runs."""
    kept = [name for name in _USED if name in cube]
    part = cube.reset_coords()[kept].isel(arch=places)
    if "event" in part:
        names = xr.DataArray(cube["record"].values.astype(str), dims="record")
        part["event"] = part["event"].astype(str).where(part["event"] != "", names)
    part = part.stack(row=("arch", "record"), create_index=False).drop_vars(["arch", "record"])
    made = (part["verdict"] != Verdict.NOT_SIMULATED).any("level")
    return part.rename(row="record").isel(record=np.flatnonzero(made.values))


def _arch_risk(
    name: str, part: xr.Dataset, fit: Fragility, hazard: Hazard, confidence: float
) -> ArchRisk:
    runs = _runs_of(part)
    draws = parameter_draws(fit, SEED)
    rate, edges = collapse_rate(hazard.main, fit, draws, confidence), level_edges(runs.levels)
    level_rate = rate_by_level(hazard.main, fit, edges)
    ends = np.unique([runs.least, runs.greatest])
    outer = rate_by_level(hazard.main, fit, ends) / (rate.rate or 1.0)

    event = shared_events(part["event"].values) if "event" in part else None

    def split(category: NDArray, names: tuple[str, ...]) -> Contributions:
        return contributions(
            level_rate, runs.collapsed, np.broadcast_to(category, runs.collapsed.shape), names,
            event=event, seed=SEED, confidence=confidence,
        )  # fmt: skip

    def facts(key: str) -> FloatArray:
        unknown = np.full(part.sizes["record"], np.nan)
        return part[key].values.astype(float) if key in part else unknown

    magnitude, magnitudes = value_bins(facts("magnitude"), MAGNITUDES)
    distance, distances = value_bins(facts("distance"), DISTANCES, "km")
    mechanism = split(*_mechanisms(runs))
    return ArchRisk(
        name, fit, rate, {key: collapse_rate(c, fit).rate for key, c in hazard.curves.items()},
        runs.levels, edges, level_rate, float(outer[0]), float(outer[-1]), mechanism,
        by_magnitude=split(magnitude[:, None], magnitudes),
        by_distance=split(distance[:, None], distances),
        cautions=_cautions(rate, outer, mechanism),
    )  # fmt: skip


def _runs_of(part: xr.Dataset) -> _Runs:
    """Runs as a grid; runs each at an intensity of its own are put into bins of equal ratio."""
    names = ("verdict", "collapse_joint", "collapse_mode")
    if missing := [name for name in names if name not in part]:
        raise InputError(
            f"the cube lacks {', '.join(missing)}; is it of this version of archfrag?"
        )
    verdict, joint, mode = (
        part[name].transpose("record", "level").values.astype(np.int64) for name in names
    )
    fell = verdict == Verdict.COLLAPSED
    intensity = part["intensity"]
    if intensity.dims == ("level",):
        levels = intensity.values.astype(float)
        simulated = verdict != Verdict.NOT_SIMULATED
        if not simulated.all():
            code = joint * len(CollapseMode) + mode
            fell, code = implied_collapses(fell, simulated, code)
            joint, mode = np.divmod(code, len(CollapseMode))
        return _Runs(levels, fell, joint, mode, levels[0], levels[-1])
    at = intensity.transpose("record", "level").values.astype(float)
    done = (verdict != Verdict.NOT_SIMULATED) & (at > 0.0)
    least, greatest = float(at[done].min()), float(at[done].max())
    count = _SCATTERED_BINS if greatest > least else 1
    edges = np.geomspace(least, greatest, count + 1)
    levels = np.sqrt(edges[1:] * edges[:-1])
    row, place = np.nonzero(done)
    column = np.searchsorted(level_edges(levels), at[row, place], side="right")
    shape = (at.shape[0], count)
    grid = np.zeros(shape, dtype=bool)
    joints, modes = np.full(shape, -1), np.zeros(shape, dtype=np.int64)
    for array, values in ((grid, fell), (joints, joint), (modes, mode)):
        array[row, column] = values[row, place]
    return _Runs(levels, grid, joints, modes, least, greatest)


def _mechanisms(runs: _Runs) -> tuple[NDArray, tuple[str, ...]]:
    """Category of each run by joint and mode; the rare ones together."""
    pair = runs.joint * len(CollapseMode) + runs.mode
    kinds, counts = np.unique(pair[runs.collapsed], return_counts=True)
    kept = np.sort(kinds[np.argsort(-counts, kind="stable")][:MOST_CATEGORIES])
    codes = [divmod(int(kind), len(CollapseMode)) for kind in kept]
    names = [f"joint {i}, {CollapseMode(m).name.lower().replace('_', '-')}" for i, m in codes]
    category = np.where(np.isin(pair, kept), np.searchsorted(kept, pair), kept.size)
    return category, (*names, OTHER)


def _cautions(rate: CollapseRate, outer: FloatArray, mechanism: Contributions) -> tuple[str, ...]:
    parts = (
        (rate.below, "below the first point of the hazard curve, whose first slope goes on there"),
        (rate.above, "above the last point of the hazard curve, whose last slope goes on there"),
        (outer[0], "below the least level that was simulated, where the fragility curve is "
         "extrapolated"),
        (outer[-1], "above the greatest level that was simulated, where the fragility curve is "
         "extrapolated"),
        (mechanism.unassigned.sum() / (rate.rate or 1.0),
         "at which no run collapsed, so that it is of no known mechanism; fractions by category "
         "are of what is left"),
    )  # fmt: skip
    bound = (
        "most of the rate is from outside the hazard curve, so the part within it is quoted, as a "
        "lower bound and without a band; use a hazard curve that reaches farther",
    )  # fmt: skip
    return (bound if rate.is_bound else ()) + tuple(
        f"{100 * fraction:.0f} % of the rate is from intensities {where}"
        for fraction, where in parts if fraction > NOTED
    )  # fmt: skip
