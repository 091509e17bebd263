"""Ticks of axes, and how their numbers are written."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def digits(value: float) -> str:
    """A level with three digits, or all before the point: 0.500, 12.0, 1250."""
    return f"{value:.0f}" if 99.95 <= abs(value) < 1e6 else f"{value:#.3g}"


def even_ticks(low: float, high: float, most: int = 6) -> FloatArray:
    """Round numbers from low to high, at most about so many."""
    span = max(high - low, 1e-300)
    step = 10.0 ** np.floor(np.log10(span / most))
    step *= next(k for k in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0) if k * step * most >= span)
    first = np.ceil(low / step - 1e-9)
    ticks = step * np.arange(first, np.floor(high / step + 1e-9) + 1)
    return np.asarray(ticks + 0.0, dtype=float)  # no -0


def integer_ticks(high: float, most: int = 5) -> FloatArray:
    """Integers from 0 to high."""
    ticks = even_ticks(0.0, max(high, 1.0), most)
    return np.unique(np.round(ticks))


def log_ticks(low: float, high: float, subs: Sequence[float] = (1.0, 2.0, 5.0)) -> FloatArray:
    """1, 2, 5 in each decade from low to high."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = np.unique(np.outer(decades, subs).ravel())
    return np.asarray(ticks[(ticks >= low * 0.999) & (ticks <= high * 1.001)], dtype=float)
