"""Numbers of the page as rows of text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.fragility.counts import Verdict, clopper_pearson
from archfrag.fragility.curve import Fragility
from archfrag.report.picture import FloatArray, digits
from archfrag.report.summary import ArchResults, Scale

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.motions.motion import Motion
    from archfrag.study.curves import Answer

_UNITS = {
    **dict.fromkeys(("radius", "thickness", "span", "rise", "width", "height", "depth"), " [m]"),
    **dict.fromkeys(("intrados", "extrados"), " [m]"),
    "embrace": " [deg]", "density": " [kg/m³]", "dead_load": " [N]",
}  # fmt: skip
MOST_ROWS = 200  # arches of the table of answers


@dataclass(frozen=True)
class Table:
    """Heads and rows of text; `numeric_from` is the first column aligned as numbers."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numeric_from: int = 1


def percent_of(confidence: float) -> str:
    """A confidence in percent."""
    return f"{100 * confidence:.0f} %"


def answer(given: "Answer", scale: Scale) -> dict[str, str]:
    """The curve in words: keys theta, theta_interval, beta and more, or `none` why not."""
    if isinstance(given.curve, str):
        return {"none": given.curve}
    low, high = map(scale.digits, given.theta)
    fit = given.likelihood if isinstance(given.likelihood, Fragility) else None
    return {
        "theta": scale.text(given.curve.theta),
        "theta_interval": f"{low} to {high} {scale.unit}",
        "beta": f"{given.curve.beta:#.3g}",
        "beta_interval": f"{given.beta[0]:#.3g} to {given.beta[1]:#.3g}",
        "n_independent": f"{given.n_independent:.3g}",
        "n_islands": str(given.n_islands),
        "theta_likelihood": scale.text(fit.theta) if fit else "no maximum",
        "beta_likelihood": f"{fit.beta:#.3g}" if fit else "no maximum",
    }


def answers(given: Mapping[str, "Answer"], scale: Scale, at: float | None) -> Table:
    """One row for each arch or class: probability at the level asked for, theta and beta.

    With their intervals, and beside them theta and beta by maximum likelihood.
    """
    percent = percent_of(next(iter(given.values())).confidence)
    asked = [f"P(collapse) at {digits(at)} {scale.unit}"] if at is not None else []
    rows = []
    for name, each in list(given.items())[:MOST_ROWS]:
        if isinstance(each.curve, str):
            rows.append([name, *("–" for _ in asked), "no curve", "–", "–"])
            continue
        row = [name]
        if at is not None:
            value, *ends = map(_chance, each.probability(at / scale.factor))
            row.append(f"{value} {_together(' to '.join(dict.fromkeys(ends)))}")
        low, high = map(scale.digits, each.theta)
        beta = _together(f"{each.beta[0]:.2f}–{each.beta[1]:.2f}")
        row.append(f"{scale.digits(each.curve.theta)} {_together(f'{low}–{high}')}")
        row.append(f"{each.curve.beta:.2f} {beta}")
        fit = each.likelihood
        row.append("–" if isinstance(fit, str) else f"{scale.digits(fit.theta)}, {fit.beta:.2f}")
        rows.append(row)
    heads = ["arch", *asked, f"θ [{scale.unit}] ({percent})", f"β ({percent})"]
    return Table([*heads, "θ, β by maximum likelihood"], rows)


def levels(results: ArchResults, given: "Answer") -> Table:
    """One row for each level: runs by verdict, observed fraction with its interval, the curve.

    Where levels were bisected the fraction is of all records whose capacity is known to lie below
    or above the level.
    """
    counts, known, fit = results.counts, results.known, given.curve
    low, high = clopper_pearson(known.collapsed, known.n, given.confidence)
    kinds = (
        counts.runs, counts.collapsed, counts.standing, counts.unfinished, counts.solver_failures,
    )  # fmt: skip
    rows = []
    for i, level in enumerate(results.levels):
        fraction, ends, fitted = "–", "–", "–"
        if known.n[i]:
            fraction = f"{known.collapsed[i] / known.n[i]:.3f}"
            ends = f"{low[i]:.3f} – {high[i]:.3f}"
        if isinstance(fit, Fragility):
            fitted = f"{fit.probability(level / results.scale.factor):.3f}"
        rows.append([digits(level), *(str(kind[i]) for kind in kinds), fraction, ends, fitted])
    heads = [
        results.scale.label, "runs", "collapsed", "standing", "unfinished", "solver failures",
        "records with capacity below" if results.bisected else "fraction",
        f"exact {percent_of(given.confidence)} interval", "curve",
    ]  # fmt: skip
    return Table(heads, rows, numeric_from=0)


def motions(
    cube: "xr.Dataset", items: Sequence["Motion"], measures: Mapping[str, Mapping[str, float]]
) -> Table:
    """One row for each record: origin, length, measures as recorded, range of scale factors."""
    names = [str(name) for name in cube["record"].values]
    rows = []
    for motion in items:
        place, values = names.index(motion.id), measures[motion.id]
        factor = cube["scale_factor"].isel(record=place).values
        factor = factor[np.isfinite(factor)]
        rows.append([
            motion.id,
            _optional(cube, "magnitude", place, "{:.2f}"),
            _optional(cube, "distance", place, "{:.1f}"),
            f"{motion.duration:.1f}", f"{motion.dt:g}",
            f"{values['PGA'] / STANDARD_GRAVITY:.4f}", f"{100 * values['PGV']:.2f}",
            f"{values['Arias']:#.3g}", f"{values['D5_95']:.1f}",
            "yes" if motion.vertical is not None else "no",
            f"{factor.min():.2f} – {factor.max():.2f}" if factor.size else "not run",
        ])  # fmt: skip
    heads = [
        "record", "M", "distance [km]", "duration [s]", "dt [s]", "PGA [g]", "PGV [cm/s]",
        "Arias [m/s]", "D5\u2060–\u206095 [s]", "vertical", "scale factors",
    ]  # fmt: skip
    return Table(heads, rows)


def quality(results: ArchResults, wall: Sequence[float] | None) -> Table:
    """Speed and energy figures of one arch."""
    simulated = float(np.nansum(results["end_time"]))
    runs = int(results.counts.runs.sum())
    rows = {"simulated time": f"{simulated:,.0f} s in {runs:,} runs"}
    times = np.array([] if wall is None else wall, dtype=float)
    if times.sum() > 0.0 and simulated > 0.0:
        rows["wall time of the simulations, summed over workers"] = f"{times.sum():,.2f} s"
        per_second = 1e3 * times.sum() / simulated
        rows["wall time for one simulated second"] = f"{per_second:#.3g} ms"
    if times.size == runs:
        middle, tail = np.quantile(times, [0.5, 0.95])
        rows["wall time of a run, median and 95 %"] = f"{middle:#.3g} s, {tail:#.3g} s"
    rows["steps of integration"] = f"{results['steps'].sum():,}"
    failed, residual = results.verdict == Verdict.SOLVER_FAILURE, results["contact_residual"]
    good = results.simulated & ~failed
    rows["energy error, median and largest"] = _median_and_largest(results["energy_error"][good])
    rows["contact residual, median and largest"] = _median_and_largest(residual[good])
    if failed.any():
        words = "contact residual of solver failures, median and largest"
        rows[words] = _median_and_largest(residual[failed])
    fallbacks = results["fallbacks"].sum()
    rows["steps solved only with slightly compliant joints"] = f"{fallbacks:,}"
    rows["runs that lost all contact at a joint and stand"] = f"{results.stood_after_loss:,}"
    rows["records that collapse at a level and stand at a higher one"] = str(results.resurrections)
    return Table(["figure", "value"], list(rows.items()))


def geometry(parameters: Mapping[str, Any]) -> Table:
    """What an arch was built from; long lists shortened to their range."""
    rows = [
        [name.replace("_", " ") + _UNITS.get(name, ""), _short(value)]
        for name, value in parameters.items()
        if value is not None
    ]
    if parameters.get("dead_load", 0.0) is None:
        rows.append(["dead load", "none: the ring alone, without fill and spandrels"])
    return Table(["parameter", "value"], rows)


def _optional(cube: "xr.Dataset", name: str, place: int, form: str) -> str:
    value = float(cube[name].values[place]) if name in cube else np.nan
    return form.format(value) if np.isfinite(value) else "–"


def _median_and_largest(values: FloatArray) -> str:
    values = np.abs(values[np.isfinite(values)])
    if values.size == 0:
        return "not known"
    return f"{np.median(values):.1e}, {values.max():.1e}"


def signed(text: str) -> str:
    """A number with a proper minus."""
    return text.replace("-", "−")


def _together(words: str) -> str:
    """Words in parentheses that a line does not part."""
    return f"({words})".replace(" ", "\u00a0").replace("–", "\u2060–\u2060")


def _chance(value: float) -> str:
    """A probability with two digits, three where it is small or large."""
    if not np.isfinite(value):
        return "–"
    if not 0.001 <= value <= 0.999:
        return "< 0.001" if value < 0.001 else "> 0.999"
    return f"{value:.2f}" if 0.1 <= value <= 0.9 else f"{value:.3f}"


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        flat = np.ravel(np.array(value, dtype=object))
        return f"{flat.size} values" if flat.size > 6 else ", ".join(map(_short, flat))
    return f"{value:g}" if isinstance(value, float) else str(value)
