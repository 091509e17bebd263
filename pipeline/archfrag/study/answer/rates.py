"""Rates of collapse from curves and a hazard, and what contributes to them."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from jinja2 import Template
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import FitError, attempt
from archfrag.files import Named, counted
from archfrag.fragility import risk as rates
from archfrag.fragility.curve import BoolArray, Curve, FloatArray
from archfrag.fragility.several import (
    average_annual_loss,
    checked_ratios,
    loss_steps,
    vulnerability,
)
from archfrag.fragility.verdicts import Verdict
from archfrag.physics.status import CollapseMode
from archfrag.study.answer.curves import ArchRuns, Fitted, runs_of_cube
from archfrag.study.answer.fits import fit_lines
from archfrag.study.file.members import SHOWN
from archfrag.study.file.schema import StudyKeys
from archfrag.study.hazard import Hazard, load_hazard
from archfrag.study.provenance import finite

SEED = 15
NOTED = (
    0.05  # fraction of a rate from beyond what is known; above it there is a caution
)
MOST_MEAN = 2.0  # mean rate over that of the median curve; above it there is a caution
MOST_UNSEEN = 0.25  # fraction of a rate from below the lowest collapse; above it too
MOST_CATEGORIES = 4
OTHER = "others"
ASSUMPTIONS = tuple(
    Path(__file__).with_name("assumptions.txt").read_text("utf-8").splitlines()
)
_SCATTERED_BINS = 10


@dataclass(frozen=True)
class ArchRisk:
    """Rate of collapse of one arch or class, and its parts by level and mechanism."""

    arch: str
    fit: Curve
    rate: rates.CollapseRate  # with the first curve of the hazard
    by_curve: dict[
        str, float
    ]  # rate with each curve of the hazard [1/year]: its own uncertainty
    levels: FloatArray  # (n_level,): intensities that stand for ranges, from 0 to infinity [SI]
    level_rate: FloatArray  # (n_level,) [1/year]
    # Fractions of the rate from intensities below the least and above the greatest level that was
    # simulated, where the fitted curve is extrapolated.
    beyond: tuple[float, float]
    below_collapse: (
        float  # fraction of the rate from below the lowest level with a collapse
    )
    by_mechanism: rates.Contributions
    by_part: rates.Contributions | None  # by span and pier of a bridge
    onset: float | FloatArray = (
        0.0  # at or below it nothing moves; one value for each arch of a class [SI]
    )

    @property
    def cautions(self) -> tuple[str, ...]:
        """Messages on parts of the rate of which little is known."""
        level = "level that was simulated, where the fragility curve is extrapolated"
        unseen = self.below_collapse * (self.below_collapse > MOST_UNSEEN)
        parts = {
            "below the first point of the hazard curve, whose first slope goes "
            "on there": self.rate.below,
            "above the last point of the hazard curve, whose last slope goes on "
            "there": self.rate.above,
            f"below the least {level}": self.beyond[0],
            f"above the greatest {level}": self.beyond[1],
            "below the lowest level at which a run collapsed, where it follows from the shape of "
            "the fitted curve alone; add records": unseen,
        }
        found = [
            f"{100 * fraction:.0f} % of the rate is from intensities {where}"
            for where, fraction in parts.items()
            if fraction > NOTED
        ]
        more = self.rate.mean / (self.rate.rate or np.nan)
        if more > MOST_MEAN:
            found.insert(
                0,
                f"the mean rate over uncertain theta and beta, {self.rate.mean:.2g} a year, is "
                f"{more:.2g} times that of the median curve: a small number of runs leaves wide "
                "curves possible, which decide it; add records",
            )
        if self.rate.is_bound:
            found.insert(
                0,
                "most of the rate is from outside the hazard curve, so the part within it is "
                "quoted, as a lower bound and without a band; use a hazard curve that reaches "
                "farther",
            )
        return tuple(found)


@dataclass(frozen=True)
class StudyRisk:
    """Rates of collapse of arches and classes.

    If an arch has no curve, the reason is in the place of its rate.
    """

    hazard: Hazard
    years: float
    arches: dict[str, ArchRisk | str]  # classes as well
    classes: dict[str, int]  # number of arches of each class in `arches`


def risk_of(
    cube: xr.Dataset,
    curves: Mapping[str, Curve],
    hazard: Hazard,
    years: float = 50.0,
    confidence: float = 0.9,
) -> StudyRisk:
    """Find the rates of collapse at a site for all arches and classes of `curves`.

    `cube` has their runs. `years` is the period of the probabilities that are reported;
    `confidence` is that of the bands.
    """
    arches = dict[str, ArchRisk | str]()
    runs = runs_of_cube(cube, curves)
    for name, fit in curves.items():
        arches[name] = fit.reason
        if fit.fitted:
            arches[name] = _arch_risk(runs[name], fit, hazard, confidence)
    sizes = {name: len(own.arches) for name, own in runs.items() if own.arches[1:]}
    return StudyRisk(hazard, years, arches, sizes)


def risk_of_study(study: StudyKeys, fitted: Fitted) -> StudyRisk | None:
    """Find the rates of collapse at the site of a study; None if the study has no hazard.

    They are those of its classes, and of its arches that are in no class.
    """
    given = study.risk
    if given is None:
        return None
    hazard = load_hazard(
        [Path(given.hazard)], study.intensity.measure, given.unit, given.site
    )
    return risk_of(
        fitted.cube, fitted.quoted(), hazard, given.years, study.report.confidence
    )


def answer_lines(study: StudyKeys, fitted: Fitted) -> tuple[list[str], list[str]]:
    """Return aligned lines on the curves and rates of a study, and all cautions on them."""
    lines, cautions = fit_lines(study, fitted)
    risk = attempt(lambda: risk_of_study(study, fitted))
    if isinstance(risk, str):
        cautions.append(f"no rates of collapse: {risk}")
    if not isinstance(risk, StudyRisk):  # else of a study that has a hazard
        return lines, cautions
    first = max(map(len, ("report", *list(risk.arches)[:SHOWN])))
    for name, arch in list(risk.arches.items())[:SHOWN]:
        if isinstance(arch, str):
            lines.append(f"{name:{first}}  no rate of collapse: {arch}")
            continue
        rate = arch.rate
        words = f"rate {'at least ' * rate.is_bound}{rate.quoted:#.2g} a year"
        if not rate.is_bound:
            band = f"{rate.lower:#.2g}–{rate.upper:#.2g}"
            words += f" ({100 * rate.confidence:g} %: {band})"
        if rate.quoted > 0.0:
            words += f"  return period {float(f'{rate.return_period:.2g}'):,.0f} years"
        lines.append(f"{name:{first}}  {words}")
        cautions += [f"{name}: {each}" for each in arch.cautions]
    return lines, [*cautions, *risk.hazard.messages]


def _arch_risk(
    runs: ArchRuns, fit: Curve, hazard: Hazard, confidence: float
) -> ArchRisk:
    """Find the rate of an arch or class, and divide it by level and mechanism."""
    levels, collapsed, code, ends, mechanisms = mechanisms_of(runs)
    onset = runs.onset(fit)
    rate = rates.collapse_rate(hazard.main, fit, fit.draws(SEED), confidence, onset)

    def rate_between(edges: ArrayLike) -> FloatArray:
        return rates.rate_by_level(hazard.main, fit, edges, onset)

    level_rate = rate_between(rates.level_edges(levels))
    lowest = np.broadcast_to(runs.level, runs.verdict.shape)[runs.collapsed].min(
        initial=ends[-1]
    )
    whole = rate.rate or 1.0
    outer = (rate_between(np.unique(ends)) / whole).tolist()
    kinds, counts = np.unique(code[collapsed], return_counts=True)
    kept = np.sort(kinds[np.argsort(-counts, kind="stable")][:MOST_CATEGORIES])
    labels = [mechanisms[each][0] for each in kept]
    category = np.where(np.isin(code, kept), np.searchsorted(kept, code), kept.size)
    return ArchRisk(
        runs.name,
        fit,
        rate,
        by_curve={
            key: rates.collapse_rate(each, fit, onset=onset).rate
            for key, each in hazard.curves.items()
        },
        levels=levels,
        level_rate=level_rate,
        beyond=(outer[0], outer[-1]),
        below_collapse=float(rate_between([lowest])[0] / whole),
        by_mechanism=rates.contributions(
            collapsed, category, (*labels, OTHER), level_rate, groups=runs.group
        ),
        by_part=parts_of(runs, level_rate),
        onset=onset,
    )


def mechanisms_of(runs: ArchRuns) -> tuple[Any, ...]:
    """Return what `_on_levels` does, and words and part of each mechanism.

    A mechanism is a joint and the mode in which it lost contact. Its part is the span or pier in
    which the joint lies.
    """
    cube = runs.cube
    keys = ("collapse_joint", "collapse_mode")
    joint, mode = (cube[key].values.ravel().astype(int) for key in keys)
    place = np.array([""] * joint.size)
    if "collapse_place" in cube:
        place = cube["collapse_place"].values.ravel().astype(str)
    rows = pd.MultiIndex.from_arrays([joint, mode, place])
    # Each mechanism has a number, which rises with joint and mode.
    code, own = rows.factorize(sort=True)
    words = [
        (
            f"{at or f'joint {joint}'}, {CollapseMode(mode).name.lower().replace('_', '-')}"
            if joint >= 0
            else "not known",  # of runs of another program
            at.rpartition(", ")[0] or "arch",
        )
        for joint, mode, at in own
    ]
    return *_on_levels(runs, code.reshape(runs.verdict.shape)), words


def parts_of(
    runs: ArchRuns, level_rate: FloatArray | None = None
) -> rates.Contributions | None:
    """Divide the collapses of bridges, or their rate, by the part in which contact was lost.

    Parts are spans and piers, from left to right. Return None for arches of one part.
    """
    if "collapse_place" not in runs.cube:
        return None
    _, collapsed, code, _, mechanisms = mechanisms_of(runs)
    names = np.array([part for _, part in mechanisms])[code]
    parts = sorted({*names[collapsed].tolist()}, key=_order)
    if not {*parts} - {"arch"}:
        return None
    kind = np.argmax(names == np.reshape(parts, (-1, 1, 1)), axis=0)
    return rates.contributions(collapsed, kind, parts, level_rate, groups=runs.group)


def _order(part: str) -> tuple[float, str]:
    """Return a key that sorts parts from left to right."""
    number = re.search(r"\d+", part)
    outer = math.inf if part.startswith("right") else 0.0
    return (int(number[0]) if number else outer), part[::-1]


def losses_of(
    cube: xr.Dataset,
    curves: Mapping[str, Curve],
    hazard: Hazard,
    consequence: Mapping[str, float],
    confidence: float = 0.9,
) -> dict[str, Named]:
    """Return by arch or class the average annual loss and a table of mean loss [SI].

    `consequence` has the cost of each limit state as a fraction of the arch's value. An arch or
    class without a loss has the reason under the key ``none``. InputError if `consequence` cannot
    be used.
    """
    ratios = checked_ratios(consequence)
    found = dict[str, Named]()
    for name, runs in runs_of_cube(cube, curves).items():
        curve = curves[name]
        try:
            if not curve.fitted:
                raise FitError(curve.reason)
            steps = loss_steps(curve, ratios)
        except FitError as error:
            found[name] = {"none": str(error)}
            continue
        im = np.array(curve.im)
        if not curve.im:  # as of a curve that was put into fits.json
            im = np.linspace(0.0, 1.05 * np.nanmax(runs.level))
        columns = ("im", "loss_ratio", "loss_ratio_lower", "loss_ratio_upper")
        rows = np.array([im, *vulnerability(steps, im)]).tolist()
        loss = average_annual_loss(hazard.main, steps, SEED, confidence, runs.onset)
        found[name] = loss | {"vulnerability": dict(zip(columns, rows))}
    return found


def vulnerability_table(
    found: Mapping[str, Mapping[str, Any]], study: StudyKeys
) -> pd.DataFrame:
    """Return a table of mean loss against intensity in the study's unit.

    `found` is what `losses_of` returned. FitError if no arch has a loss.
    """
    given = study.intensity
    own = {"measure": given.measure, "unit": given.unit}
    frames = [
        pd.DataFrame({"arch": name, **own, **each["vulnerability"]})
        for name, each in found.items()
        if "none" not in each
    ]
    if not frames:
        why = "; ".join(f"{name}: {each['none']}" for name, each in found.items())
        raise FitError(
            f"no arch has the curves of all consequences, so there is no loss: {why}"
        )
    table = pd.concat(frames, ignore_index=True)
    table["im"] /= given.factor
    return table


def _on_levels(
    runs: ArchRuns, code: NDArray
) -> tuple[FloatArray, BoolArray, NDArray, FloatArray]:
    """Put runs on a grid of levels; runs with a level of their own go into bins of equal ratio.

    `code` is the mechanism of each run. Returned are the levels, (n_level,), whether runs
    collapsed and their mechanisms, both (n_record, n_level), and the least and the greatest level.
    """
    at = runs.level
    collapsed = runs.collapsed
    made = runs.verdict != Verdict.NOT_RUN
    if at.ndim == 1:
        # What a bisection left out is as the nearest lower level of the record that was run.
        made = made | runs.by_level
        source = np.maximum.accumulate(np.where(made, np.arange(at.size), -1), axis=1)
        filled = (source >= 0) & np.take_along_axis(collapsed, source, axis=1)
        codes = np.take_along_axis(code, source, axis=1)
        return at, filled, np.where(filled, codes, code), at[[0, -1]]
    row, place = np.nonzero(made & (at > 0.0))
    own = at[row, place]
    ends = np.array([own.min(), own.max()])
    count = _SCATTERED_BINS if ends[1] > ends[0] else 1
    edges = np.geomspace(ends[0], ends[1], count + 1)
    levels = np.sqrt(edges[1:] * edges[:-1])
    column = np.searchsorted(rates.level_edges(levels), own, side="right")
    grid = np.zeros((len(at), levels.size), bool)
    codes = np.full(grid.shape, -1)
    grid[row, column] = collapsed[row, place]
    codes[row, column] = code[row, place]
    return levels, grid, codes, ends


def risk_facts(risk: StudyRisk, study: StudyKeys) -> Named:
    """Return rates and their parts as plain numbers, with intensities in the study's unit."""
    factor = study.intensity.factor
    hazard = risk.hazard
    arches: Named = {}
    for name, arch in risk.arches.items():
        if isinstance(arch, str):
            arches[name] = {"none": arch}
            continue
        rate = arch.rate
        probability, *band = rate.probability_in(risk.years)
        arches[name] = {
            "theta": arch.fit.theta / factor,
            "beta": arch.fit.beta,
            "of_mean_curve": arch.fit.members is not None,
            "rate": rate.quoted,
            "rate_is_lower_bound": rate.is_bound,
            "rate_mean": rate.mean,
            "rate_band": [rate.lower, rate.upper],
            "confidence": rate.confidence,
            "return_period": rate.return_period if rate.quoted > 0.0 else None,
            "probability": probability,
            "probability_band": band,
            "below_hazard_curve": rate.below,
            "above_hazard_curve": rate.above,
            "below_levels": arch.beyond[0],
            "above_levels": arch.beyond[1],
            "below_lowest_collapse": arch.below_collapse,
            "onset": float(np.min(arch.onset)) / factor or None,
            "rate_below_onset_left_out": rate.below_onset,
            "rate_by_hazard_curve": arch.by_curve,
            "levels": (arch.levels / factor).tolist(),
            "edges": (rates.level_edges(arch.levels) / factor).tolist(),
            "rate_by_level": arch.level_rate.tolist(),
            "by_mechanism": _parts(arch.by_mechanism),
            **({"by_part": _parts(arch.by_part)} if arch.by_part else {}),
            "cautions": list(arch.cautions),
        }
    curves = {
        name: {"im": (curve.im / factor).tolist(), "rate": curve.rate.tolist()}
        for name, curve in hazard.curves.items()
    }
    facts: Named = {
        "study": study.id,
        "measure": hazard.measure,
        "unit": study.intensity.unit,
        "years": risk.years,
        "hazard": {
            "source": hazard.source,
            "notes": list(hazard.messages),
            "curves": curves,
        },
        "assumptions": list(ASSUMPTIONS),
        "arches": arches,
        "classes": risk.classes,
    }
    return dict(finite(facts, None))


def _parts(split: rates.Contributions) -> list[Named]:
    """Return the categories that have a part of a rate, as plain numbers."""
    return [
        {
            "category": label,
            "collapses": int(split.counts[i].sum()),
            "fraction": float(split.fraction[i]),
            "rate_by_level": split.rate[i].tolist(),
        }
        for i, label in enumerate(split.categories)
        if split.shown[i]
    ]


def risk_text(facts: Named) -> str:
    """Return `risk_facts` as text for a terminal, without the parts by level."""
    source = Path(__file__).with_name("risk.txt.j2").read_text("utf-8")
    template = Template(source, trim_blocks=True, lstrip_blocks=True)
    helpers = {"counted": counted, "repr": repr, "most_mean": MOST_MEAN}
    return template.render(facts, **helpers).rstrip()
