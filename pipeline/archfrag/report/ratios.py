"""Answers of two arches or classes that met the same motions: before and after a remedy."""

from collections.abc import Mapping

import numpy as np

from archfrag.report.html import rounded
from archfrag.report.inputs import ReportInputs

_SEEN = 0.001  # difference of probabilities that matters


def before_and_after(inputs: ReportInputs) -> list[str]:
    """Sentences on two arches or classes of a study; empty if it has another number of them."""
    found = inputs.ratios
    if isinstance(found, str) or len(found) != 1:
        return []
    first, second = inputs.known
    median, *rates = (ratio_text(row, inputs.percent) for row in found[second].values())
    words = f"The median capacity of {second} is {median} times that of {first}"
    words += "".join(f", its annual rate of collapse {rate} times" for rate in rates)
    return [f"{words}.", *_crossing(inputs)]


def ratio_text(row: Mapping[str, float], percent: str) -> str:
    """A ratio with its interval."""
    return f"{row['ratio']:.2f} ({percent}: {row['lower']:.2f} to {row['upper']:.2f})"


def _crossing(inputs: ReportInputs) -> list[str]:
    """Which of two curves is higher below the level at which they cross, if they do."""
    levels, scale = inputs.cube["intensity"].values, inputs.scale
    im = np.geomspace(np.nanmin(levels), np.nanmax(levels), 400)
    one, two = (fit.probability(im) for fit in inputs.known.values())
    sign = np.where(np.abs(two - one) > _SEEN, np.sign(two - one), 0.0)
    seen = np.flatnonzero(sign)
    changes = np.flatnonzero(np.diff(sign[seen]))
    if changes.size != 1:
        return []
    start, end = seen[changes[0]], seen[changes[0] + 1]
    at = scale.factor * float(im[start + np.abs(two - one)[start : end + 1].argmin()])
    name, level = list(inputs.known)[int(sign[start] > 0.0)], rounded(at)
    where = f"Below {scale.measure} {level} {scale.unit} the curve of {name} is the higher one"
    return [f"{where}, because its β is larger."]
