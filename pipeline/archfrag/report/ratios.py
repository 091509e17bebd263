"""Answers of two arches or classes that met the same motions: before and after a remedy."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.fit import common_draws
from archfrag.fragility.quoted import shared_events
from archfrag.fragility.risk import lognormal_rates
from archfrag.report.html import rounded
from archfrag.report.inputs import ReportInputs
from archfrag.study.answer.curves import quoted, runs_of_cube
from archfrag.study.answer.risk import StudyRisk

_MOST, _FEWEST_DRAWS = 8, 100  # arches whose ratios are told, and draws of a band
_SEEN = 0.001  # difference of probabilities that matters


class Ratio(NamedTuple):
    """A number of one arch or class over that of the first one, with its band."""

    name: str
    value: float
    lower: float
    upper: float

    def text(self, percent: str) -> str:
        value, *ends = (rounded(each, 3) for each in self[1:])
        return f"{value} ({percent}: {' to '.join(ends)})"


def known_answers(inputs: ReportInputs) -> dict[str, Fragility]:
    """Curves of classes and of arches of none, in the order of the study."""
    answers = quoted(inputs.cube, inputs.answers, inputs.classes)
    return {k: each.curve for k, each in answers.items() if isinstance(each.curve, Fragility)}


def ratios(inputs: ReportInputs) -> dict[str, list[Ratio]]:
    """Ratios to the first arch or class, by what they are of; empty if there are none.

    They are medians and quantiles over draws of the common motions.
    """
    names = list(known_answers(inputs))
    draws = _draws(inputs.cube, names) if 1 < len(names) <= _MOST else np.zeros((0, 1, 2))
    if len(draws) < _FEWEST_DRAWS:
        return {}
    numbers = {"median capacity": draws[..., 0]}
    if isinstance(inputs.risk, StudyRisk):
        hazard = inputs.risk.hazard.main
        numbers["annual rate of collapse"] = lognormal_rates(hazard, draws[..., 0], draws[..., 1])
    ends = 0.5, 0.5 - 0.5 * inputs.confidence, 0.5 + 0.5 * inputs.confidence
    return {
        what: [Ratio(name, *np.quantile(own / values[:, 0], ends).tolist())
               for name, own in zip(names[1:], values.T[1:])]
        for what, values in numbers.items()
    }  # fmt: skip


def _draws(cube: xr.Dataset, names: Sequence[str]) -> FloatArray:
    """theta and beta, (n_draw, n_name, 2), in a bootstrap of the common motions; maybe no draw."""
    runs = runs_of_cube(cube, names)
    if len({len(each.verdict) for each in runs}) > 1:  # classes of different sizes
        return np.zeros((0, len(names), 2))
    events = shared_events(cube["event"].values)
    group = cube["record"].values.astype(str) if events is None else events
    count = len(runs[0].verdict) // len(group)
    known = [(each.brackets.lower, each.brackets.upper) for each in runs]
    return common_draws(known, np.tile(group, count) if count > 1 else events)


def before_and_after(inputs: ReportInputs) -> list[str]:
    """Sentences on two arches or classes of a study; empty if it has another number of them."""
    known, found = known_answers(inputs), ratios(inputs)
    if len(known) != 2 or not found:
        return []
    first, second = known
    (median,), *rates = found.values()
    words = f"The median capacity of {second} is {median.text(inputs.percent)} times "
    words += f"that of {first}"
    for (rate,) in rates:
        words += f", its annual rate of collapse {rate.text(inputs.percent)} times"
    return [f"{words}.", *_crossing(inputs, known)]


def _crossing(inputs: ReportInputs, known: dict[str, Fragility]) -> list[str]:
    """Which of two curves is higher below the level at which they cross, if they do."""
    levels, scale = inputs.cube["intensity"].values, inputs.scale
    im = np.geomspace(np.nanmin(levels), np.nanmax(levels), 400)
    one, two = (fit.probability(im) for fit in known.values())
    sign = np.where(np.abs(two - one) > _SEEN, np.sign(two - one), 0.0)
    seen = np.flatnonzero(sign)
    changes = np.flatnonzero(np.diff(sign[seen]))
    if changes.size != 1:
        return []
    start, end = seen[changes[0]], seen[changes[0] + 1]
    at = scale.factor * float(im[start + np.abs(two - one)[start : end + 1].argmin()])
    name, level = (
        list(known)[int(sign[start] > 0.0)],
        f"{scale.measure} {rounded(at)} {scale.unit}",
    )
    return [f"Below {level} the curve of {name} is the higher one, because its β is larger."]
