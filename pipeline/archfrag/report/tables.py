"""Numbers of the page as rows of text; every rounding of the report is here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from archfrag.arch import STANDARD_GRAVITY
from archfrag.fragility.bands import (
    RecordBand,
    beta_interval,
    clopper_pearson,
    theta_interval,
)
from archfrag.fragility.counts import Verdict
from archfrag.fragility.fit import Fragility
from archfrag.report.summary import ArchResults, digits

if TYPE_CHECKING:
    import pandas as pd

    from archfrag.motions.motion import Motion


_UNITS = {
    **dict.fromkeys(("radius", "thickness", "span", "rise", "width", "height", "depth"), " [m]"),
    "intrados": " [m]",
    "extrados": " [m]",
    "embrace": " [deg]",
    "density": " [kg/m³]",
    "dead_load": " [N]",
}


@dataclass(frozen=True)
class Table:
    """Heads and rows of text; `numeric_from` is the first column aligned as numbers."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric_from: int = 1


def answer(
    results: ArchResults, fit: Fragility | str, confidence: float, resampled: RecordBand | None
) -> dict[str, str]:
    """The curve in words: keys theta, theta_interval, beta, beta_interval, or `none` why not.

    `fit` is in the cube's unit, `resampled` in the reader's.
    """
    if isinstance(fit, str):
        return {"none": fit}
    scale = results.scale
    low, high = (value * scale.factor for value in theta_interval(fit, confidence))
    beta_low, beta_high = beta_interval(fit, confidence)
    return {
        "theta": scale.text(fit.theta),
        "theta_interval": f"{digits(low)} to {digits(high)} {scale.unit}",
        "beta": f"{fit.beta:#.3g}",
        "beta_interval": f"{beta_low:#.3g} to {beta_high:#.3g}",
        "theta_resampled": _between(resampled.theta if resampled else None, scale.unit),
        "beta_resampled": _between(resampled.beta if resampled else None, ""),
        "correlation": signed(f"{fit.correlation:.2f}"),
        "n_total": str(fit.n_total),
        "n_levels": str(fit.n_levels),
        "log_likelihood": signed(f"{fit.log_likelihood:.3f}"),
    }


def levels(results: ArchResults, fit: Fragility | None, confidence: float) -> Table:
    """One row for each level: counts, observed fraction with its interval, fitted probability."""
    counts = results.counts
    low, high = clopper_pearson(counts.collapsed, counts.n, confidence)
    rows = []
    for i, level in enumerate(results.levels):
        n = counts.n[i]
        fitted = "–" if fit is None else f"{fit.probability(level / results.scale.factor):.3f}"
        rows.append(
            [
                digits(level),
                *(
                    str(value[i])
                    for value in (
                        counts.runs,
                        counts.collapsed,
                        counts.standing,
                        counts.unfinished,
                        counts.solver_failures,
                    )
                ),
                f"{counts.collapsed[i] / n:.3f}" if n else "–",
                f"{low[i]:.3f} – {high[i]:.3f}" if n else "–",
                fitted,
            ]
        )
    percent = f"{100 * confidence:.0f} %"
    heads = [
        results.scale.label, "runs", "collapsed", "standing", "unfinished", "solver failures",
        "fraction", f"exact {percent} interval", "fitted",
    ]  # fmt: skip
    return Table(heads, rows, numeric_from=0)


def motions(
    cube: xr.Dataset, items: Sequence["Motion"], measures: Mapping[str, Mapping[str, float]]
) -> Table:
    """One row for each record: origin, length, measures as recorded, range of scale factors.

    Parameters
    ----------
    cube : xarray.Dataset
    items : sequence of Motion
    measures : mapping of record to mapping of measure to value in SI
    """
    names = [str(name) for name in cube["record"].values]
    rows = []
    for motion in items:
        place = names.index(motion.id)
        factor = cube["scale_factor"].isel(record=place).values
        values = measures[motion.id]
        rows.append(
            [
                motion.id,
                _optional(cube, "magnitude", place, "{:.2f}"),
                _optional(cube, "distance", place, "{:.1f}"),
                f"{motion.duration:.1f}",
                f"{motion.dt:g}",
                f"{values['PGA'] / STANDARD_GRAVITY:.4f}",
                f"{100 * values['PGV']:.2f}",
                f"{values['Arias']:#.3g}",
                f"{values['D5_95']:.1f}",
                "yes" if motion.vertical is not None else "no",
                f"{np.nanmin(factor):.2f} – {np.nanmax(factor):.2f}",
            ]
        )
    heads = [
        "record", "M", "distance [km]", "duration [s]", "dt [s]", "PGA [g]", "PGV [cm/s]",
        "Arias [m/s]", "D5\u2060–\u206095 [s]", "vertical", "scale factors",
    ]  # fmt: skip
    return Table(heads, rows)


def quality(results: ArchResults, timings: "pd.DataFrame | None") -> Table:
    """Speed and energy figures of one arch.

    Parameters
    ----------
    results : ArchResults
    timings : DataFrame or None
        One row for each run or group of runs: column `wall_time` [s] and, if it holds more than
        one arch, `arch`.
    """
    simulated = float(np.nansum(results.end_time))
    runs = int(results.counts.runs.sum())
    rows = [["simulated time", f"{simulated:,.0f} s in {runs:,} runs"]]
    if timings is not None and "wall_time" in timings:
        own = timings[timings["arch"] == results.arch] if "arch" in timings else timings
        wall = float(own["wall_time"].sum())
        if wall > 0.0 and simulated > 0.0:
            rows += [
                ["wall time of the simulations, summed over workers", f"{wall:,.2f} s"],
                ["wall time for one simulated second", f"{1e3 * wall / simulated:#.3g} ms"],
            ]
        if len(own) == runs:
            middle, tail = own["wall_time"].quantile([0.5, 0.95])
            rows.append(["wall time of a run, median and 95 %", f"{middle:#.3g} s, {tail:#.3g} s"])
    rows.append(["steps of integration", f"{results.steps.sum():,}"])
    failed = results.verdict == Verdict.SOLVER_FAILURE
    good = results.simulated & ~failed
    rows += [
        ["energy error, median and largest", _median_and_largest(results.energy_error[good])],
        ["contact residual, median and largest", _median_and_largest(results.residual[good])],
    ]
    if failed.any():
        rows.append(
            [
                "contact residual of solver failures, median and largest",
                _median_and_largest(results.residual[failed]),
            ]
        )
    rows.append(
        ["steps solved only with slightly compliant joints", f"{results.fallbacks.sum():,}"]
    )
    if results.stood_after_loss is not None:
        rows.append(
            ["runs that lost all contact at a joint and stand", f"{results.stood_after_loss:,}"]
        )
    return Table(["figure", "value"], rows)


def geometry(parameters: Mapping[str, Any]) -> Table:
    """What the user gave to build the arch; long lists shortened to their range."""
    return Table(
        ["parameter", "value"],
        [
            [name.replace("_", " ") + _UNITS.get(name, ""), _short(value)]
            for name, value in parameters.items()
        ],
    )


def _optional(cube: xr.Dataset, name: str, place: int, form: str) -> str:
    if name not in cube:
        return "–"
    value = float(cube[name].values[place])
    return form.format(value) if np.isfinite(value) else "–"


def _median_and_largest(values: np.ndarray) -> str:
    values = np.abs(values[np.isfinite(values)])
    if values.size == 0:
        return "not known"
    return f"{np.median(values):.1e}, {values.max():.1e}"


def _between(ends: tuple[float, float] | None, unit: str) -> str:
    if ends is None or not np.all(np.isfinite(ends)):
        return "not known"
    return f"{digits(ends[0])} to {digits(ends[1])} {unit}".strip()


def signed(text: str) -> str:
    """A number with a proper minus."""
    return text.replace("-", "−")


def _short(value: Any) -> str:
    if value is None:
        return "not given"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        flat = np.ravel(np.array(value, dtype=object))
        if flat.size > 6:
            return f"{flat.size} values"
        return ", ".join(_short(item) for item in flat)
    return f"{value:g}" if isinstance(value, float) else str(value)
