"""Rates of collapse from the cube, its curves and a hazard, and who contributes to them."""

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
from archfrag.study.file.schema import Study
from archfrag.study.provenance import finite

SEED = 15
NOTED = 0.05  # fraction of a rate from where nothing is known that is worth a message
MOST_CATEGORIES = 8
MAGNITUDES = (5.5, 6.0, 6.5, 7.0, 7.5)
DISTANCES = (10.0, 20.0, 40.0, 80.0, 160.0)  # [km]
OTHER = "others"
ASSUMPTIONS = (
    "hazard: ln rate linear in ln intensity between its points, the first and the last slope "
    "beyond them",
    "band: of the fragility curve's parameters only, from draws; none of the hazard, whose curves "
    "are listed one by one",
    "mean rate: over the same draws; what the hazard's extension below its first point adds to "
    "each is at most the hazard's rate at that point",
    "collapses: a Poisson process, the arch being put up again each time",
    "a class: the mean of the rates of its arches, if all of them have a curve",
    "by mechanism, magnitude and distance: as the collapses of this set of records, level by "
    "level; this is no deaggregation of the hazard",
)
_SPLITS = ("by_mechanism", "by_magnitude", "by_distance")
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
    levels, collapsed, code, ends = _runs_of(part)
    rate = collapse_rate(hazard.main, fit, parameter_draws(fit, SEED), confidence)
    edges = level_edges(levels)
    level_rate = rate_by_level(hazard.main, fit, edges)
    outer = rate_by_level(hazard.main, fit, np.unique(ends)) / (rate.rate or 1.0)
    event = shared_events(part["event"].values) if "event" in part else None

    def split(category: NDArray, names: tuple[str, ...]) -> Contributions:
        return contributions(
            level_rate, collapsed, np.broadcast_to(category, collapsed.shape), names,
            event=event, seed=SEED, confidence=confidence,
        )  # fmt: skip

    def split_by(key: str, bins: tuple[float, ...], unit: str = "") -> Contributions:
        unknown = np.full(part.sizes["record"], np.nan)
        values = part[key].values.astype(float) if key in part else unknown
        category, names = value_bins(values, bins, unit)
        return split(category[:, None], names)

    mechanism = split(*_mechanisms(code, collapsed))
    return ArchRisk(
        name, fit, rate, {key: collapse_rate(c, fit).rate for key, c in hazard.curves.items()},
        levels, edges, level_rate, float(outer[0]), float(outer[-1]), mechanism,
        by_magnitude=split_by("magnitude", MAGNITUDES),
        by_distance=split_by("distance", DISTANCES, "km"),
        cautions=_cautions(rate, outer, mechanism),
    )  # fmt: skip


def _runs_of(part: xr.Dataset) -> tuple[FloatArray, NDArray[np.bool_], NDArray, FloatArray]:
    """Runs on a grid of intensity; those with an intensity of their own in bins of equal ratio.

    Returned are levels (n_level,), what collapsed and the code of its mechanism (n_record,
    n_level), and the least and the greatest level.
    """
    names = ("verdict", "collapse_joint", "collapse_mode")
    if missing := [name for name in names if name not in part]:
        text = f"the cube lacks {', '.join(missing)}; is it of this version of archfrag?"
        raise InputError(text)
    verdict, joint, mode = (
        part[name].transpose("record", "level").values.astype(np.int64) for name in names
    )
    collapsed, code = verdict == Verdict.COLLAPSED, joint * len(CollapseMode) + mode
    simulated = verdict != Verdict.NOT_SIMULATED
    levels = part["intensity"].values.astype(float)
    if part["intensity"].dims == ("level",):
        if not simulated.all():
            collapsed, code = implied_collapses(collapsed, simulated, code)
        return levels, collapsed, code, levels[[0, -1]]
    at = part["intensity"].transpose("record", "level").values.astype(float)
    done = simulated & (at > 0.0)
    ends = np.array([at[done].min(), at[done].max()])
    edges = np.geomspace(ends[0], ends[1], 1 + (_SCATTERED_BINS if ends[1] > ends[0] else 1))
    levels = np.sqrt(edges[1:] * edges[:-1])
    row, place = np.nonzero(done)
    column = np.searchsorted(level_edges(levels), at[row, place], side="right")
    grid = np.zeros((len(at), levels.size), dtype=bool)
    codes = np.full(grid.shape, -len(CollapseMode))
    grid[row, column], codes[row, column] = collapsed[row, place], code[row, place]
    return levels, grid, codes, ends


def _mechanisms(code: NDArray, collapsed: NDArray[np.bool_]) -> tuple[NDArray, tuple[str, ...]]:
    """Category of each run by joint and mode; the rare ones together."""
    kinds, counts = np.unique(code[collapsed], return_counts=True)
    kept = np.sort(kinds[np.argsort(-counts, kind="stable")][:MOST_CATEGORIES])
    names = [
        f"joint {joint}, {CollapseMode(mode).name.lower().replace('_', '-')}"
        for joint, mode in (divmod(int(kind), len(CollapseMode)) for kind in kept)
    ]
    category = np.where(np.isin(code, kept), np.searchsorted(kept, code), kept.size)
    return category, (*names, OTHER)


def _cautions(rate: CollapseRate, outer: FloatArray, mechanism: Contributions) -> tuple[str, ...]:
    beyond = "level that was simulated, where the fragility curve is extrapolated"
    parts = (
        (rate.below, "below the first point of the hazard curve, whose first slope goes on there"),
        (rate.above, "above the last point of the hazard curve, whose last slope goes on there"),
        (outer[0], f"below the least {beyond}"),
        (outer[-1], f"above the greatest {beyond}"),
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


def risk_facts(risk: StudyRisk, study: Study) -> dict[str, Any]:
    """All of a result in plain numbers; intensities in the unit of the study.

    ``arches`` holds classes too; ``classes`` is the number of arches of each.
    """
    factor = study.intensity.factor
    curves = {
        name: {"im": (curve.im / factor).tolist(), "rate": curve.rate.tolist()}
        for name, curve in risk.hazard.curves.items()
    }
    facts: dict[str, Any] = finite({
        "study": risk.study, "measure": risk.hazard.measure, "unit": study.intensity.unit,
        "years": risk.years,
        "hazard": {
            "source": risk.hazard.source, "notes": list(risk.hazard.notes), "curves": curves,
        },
        "assumptions": list(ASSUMPTIONS),
        "arches": {
            name: {"none": arch} if isinstance(arch, str) else _facts(arch, risk.years, factor)
            for name, arch in risk.arches.items()
        },
        "classes": risk.classes,
    }, None)  # fmt: skip
    return facts


def _facts(arch: ArchRisk, years: float, factor: float) -> dict[str, Any]:
    rate = arch.rate
    probability, *band = rate.probability_in(years)
    facts = {
        "theta": arch.fit.theta / factor, "beta": arch.fit.beta,
        "rate": rate.quoted, "rate_is_lower_bound": rate.is_bound, "rate_mean": rate.mean,
        "rate_band": [rate.lower, rate.upper], "confidence": rate.confidence,
        "return_period": rate.return_period if rate.quoted > 0.0 else None,
        "probability": probability, "probability_band": band,
        "below_hazard_curve": rate.below, "above_hazard_curve": rate.above,
        "below_levels": arch.below_levels, "above_levels": arch.above_levels,
        "rate_by_hazard_curve": arch.by_curve,
        "levels": (arch.levels / factor).tolist(), "edges": (arch.edges / factor).tolist(),
        "rate_by_level": arch.level_rate.tolist(),
    }  # fmt: skip
    for key in _SPLITS:
        found: Contributions = getattr(arch, key)
        facts[key] = [
            {
                "category": name, "collapses": int(found.counts[i].sum()),
                "fraction": float(found.fraction[i]),
                "band": [float(found.lower[i]), float(found.upper[i])],
                "rate_by_level": found.rate[i].tolist(),
            }
            for i, name in enumerate(found.categories) if found.shown[i]
        ]  # fmt: skip
    return facts | {"cautions": list(arch.cautions)}


def risk_text(facts: dict[str, Any]) -> str:
    """What `risk_facts` gives, as lines for a terminal."""
    hazard = facts["hazard"]
    lines = [f"hazard: {hazard['source']}, curve {next(iter(hazard['curves']))!r}"]
    lines += [f"note: {note}" for note in hazard["notes"]]
    for name, arch in facts["arches"].items():
        lines += ["", *_lines(name, arch, facts)]
    return "\n".join([*lines, "", *(f"assumed: {each}" for each in facts["assumptions"])])


def _lines(name: str, arch: dict[str, Any], facts: dict[str, Any]) -> list[str]:
    title = f"class {name}, {facts['classes'][name]} arches" if name in facts["classes"] else name
    if "none" in arch:
        return [f"{title}: no rate, since there is no curve: {arch['none']}"]
    percent, unit = f"{100 * arch['confidence']:.0f} %", facts["unit"]
    period, bound = arch["return_period"], arch["rate_is_lower_bound"]
    least, most = ("at least ", "at most ") if bound else ("", "")
    bands = [f" ({percent}: {arch[key][0]:.3g} to {arch[key][1]:.3g})"
             for key in ("rate_band", "probability_band")]  # fmt: skip
    band, likely = (" (within the hazard curve)", "") if bound else bands
    lines = [
        f"{title}: median {arch['theta']:.4g} {unit} of {facts['measure']}, dispersion "
        f"{arch['beta']:.3g}",
        f"  rate of collapse of these medians {least}{arch['rate']:.3g} a year{band}, "
        + ("never" if period is None else f"return period {most}{period:.4g} years"),
    ]
    if not bound:
        mean = f"{arch['rate_mean']:.3g} a year"
        lines.append(f"  mean over theta and beta as uncertain as they are {mean}")
    chance = f"{arch['probability']:.3g}{likely}"
    lines.append(f"  probability in {facts['years']:g} years {least}{chance}")
    others = list(arch["rate_by_hazard_curve"].items())[1:]
    lines += [f"  with the hazard {key!r}: {value:.3g} a year" for key, value in others]
    lines.append(f"  {'from ' + unit:>14s} {'rate':>10s} {'fraction':>9s}")
    total = sum(arch["rate_by_level"]) or 1.0
    lines += [
        f"  {start:14.3g} {rate:10.2e} {rate / total:9.3f}"
        for start, rate in zip([0.0, *arch["edges"]], arch["rate_by_level"])
    ]
    for key in _SPLITS:
        lines.append(f"  {key.replace('_', ' ')}")
        for part in arch[key]:
            count = ", 1 collapse"
            if part["collapses"] > 1:  # else there is no band
                a, b = part["band"]
                count = f" ({percent}: {a:.3f} to {b:.3f}), {part['collapses']} collapses"
            lines.append(f"    {part['category']:24s} {part['fraction']:6.3f}{count}")
    return lines + [f"  caution: {caution}" for caution in arch["cautions"]]
