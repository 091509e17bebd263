"""How the page writes numbers and words: filters of its template, by their names."""

from typing import Any

import numpy as np

from archfrag.report.arch_figure import onset_text
from archfrag.report.picture import FloatArray, digits


def percent_of(confidence: float) -> str:
    """A confidence in percent."""
    return f"{100 * confidence:.0f} %"


def measured(value: float | str | None, form: str = "{:#.3g}") -> str:
    """A number, with three digits by default, which may be null where it is not known."""
    number = np.nan if value is None else float(value)
    return form.format(number).removesuffix(".") if np.isfinite(number) else "–"


def median_and_largest(values: FloatArray) -> str:
    """Of magnitudes, with a power of ten."""
    values = np.abs(values[np.isfinite(values)])
    if values.size == 0:
        return "not known"
    return f"{np.median(values):.1e}, {values.max():.1e}"


def together(words: str) -> str:
    """Words in parentheses that a line does not part."""
    return f"({words})".replace(" ", "\u00a0").replace("–", "\u2060–\u2060")


def chance(value: float) -> str:
    """A probability with two digits, three where it is small or large."""
    if not np.isfinite(value):
        return "–"
    if not 0.001 <= value <= 0.999:
        return "< 0.001" if value < 0.001 else "> 0.999"
    return f"{value:.2f}" if 0.1 <= value <= 0.9 else f"{value:.3f}"


def short(value: Any) -> str:
    """A parameter of an arch; a long list shortened to its size."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        flat = np.ravel(np.array(value, dtype=object))
        return f"{flat.size} values" if flat.size > 6 else ", ".join(map(short, flat))
    return f"{value:g}" if isinstance(value, float) else str(value)


def years(period: float) -> str:
    """Three digits, never as a power of ten."""
    if period > 1e9:
        return "more than 1e9"
    return f"{float(f'{period:.3g}'):,.{0 if period >= 100.0 else 1}f}"


FILTERS = {
    each.__name__: each
    for each in (
        chance, digits, measured, median_and_largest, onset_text, percent_of, short, together,
        years,
    )
}  # fmt: skip
