"""Intensity measures compared: in which of them the collapses of a study scatter least.

The motion of every run is known in all measures, (value of the unscaled motion) x (scale factor)
** exponent, so one study has a curve in each of them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr

from archfrag.errors import FitError
from archfrag.files import Named
from archfrag.fragility.curve import FloatArray, IntArray, Pair, log_intensity
from archfrag.fragility.probit import inverse_mills, normal_lines
from archfrag.fragility.verdicts import Brackets, numbered

SIGNIFICANCE = 0.05
_LEAST = 5  # earthquakes (of magnitude) or records (of distance) that a test needs
_COLUMNS = (
    "theta",
    "beta",
    "slope_magnitude",
    "slope_distance",
    "p_magnitude",
    "p_distance",
)
Row = Named  # of a measure
# Which records have a covariate, their values, and the group of each of these.
_Covariates = dict[str, tuple[NDArray, FloatArray, IntArray]]
_OF = {
    True: "the sufficient measures",
    False: "the measures, none of which is sufficient,",
    None: "the measures, whose sufficiency could not be tested,",
}


def compare_measures(
    brackets: Brackets,
    values: Mapping[str, ArrayLike],
    exponent: Mapping[str, float],
    own: str,
    *,
    magnitude: ArrayLike | None = None,
    distance: ArrayLike | None = None,
    event: ArrayLike | None = None,
) -> Row:
    """Compare intensity measures by the runs of one arch.

    Efficiency and sufficiency are those of Luco and Cornell (2007, Earthquake Spectra 23(2)). A
    measure is sufficient if, by t tests at 5 %, ln capacity depends neither on magnitude (means of
    events) nor on ln distance. The capacity of a record is the middle of its bracket in
    logarithms. A record that collapses at its lowest level, or at none, enters as a bound.

    `brackets` are in the measure `own`, by which the study was scaled. `values` are those of the
    unscaled motions in each measure, > 0; `exponent` is the power of the scale factor in each.
    `magnitude`, `distance` and `event` are those of the records, nan where not known. All are
    (n_record,) each.

    Returns a dictionary. ``rows`` has a row for each measure, with nan where a value is not known:
    ``efficiency`` is beta / exponent, ``sufficient`` is None without a test, ``none`` says why
    there is no curve. ``best`` is the measure of least efficiency, among the sufficient ones if
    there are any. ``ratio`` is its efficiency over that of `own`. ``p_value`` is the probability
    that chance explains the difference (`scatter_by_chance`), times the number of measures it was
    chosen from (Bonferroni). ``n_test`` is the number of tests that were made, ``message`` the
    result in words. FitError if no measure has a curve, or if the records have single runs.
    """
    names = list(values)
    if brackets.verdict.shape[1] == 1:
        raise FitError(
            "measures are compared by capacities, which single runs do not show"
        )
    mine = names.index(own)
    keep = brackets.run
    known = brackets.of_records()
    log_value = np.log([np.asarray(each)[keep] for each in values.values()])
    power = np.array([[exponent[name]] for name in names], float)
    group = numbered(
        (np.arange(keep.size) if event is None else np.asarray(event))[keep]
    )
    covariates: _Covariates = {}
    for name, given, owner in (
        ("magnitude", magnitude, group),
        ("distance", distance, np.arange(group.size)),
    ):
        if given is None:
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.asarray(given, float)[keep]
            value = np.log(value) if name == "distance" else value
            used = np.isfinite(value)
            place = numbered(owner[used])
            if place.max(initial=-1) + 1 >= _LEAST and np.ptp(value[used]) > 0.0:
                covariates[name] = used, value[used], place

    exact = known.bracketed
    ends = np.where(exact, known.middle, (known.lower, known.upper))
    low, high = (
        log_value + power * ((end - log_value[mine]) / power[mine])
        for end in log_intensity(ends)
    )
    ends = np.where(exact, (known.lower, known.upper), 1.0)
    width = power / power[mine] * np.log(ends[1] / ends[0])
    columns, expected = _compare_records((low, high), width**2 / 12.0, covariates)
    table = pd.DataFrame({"measure": names, **columns})
    table["efficiency"] = table["beta"] / power[:, 0]
    fitted = np.isfinite(table["beta"])
    table["none"] = np.where(fitted, "", "fewer than two different capacities")
    p_values = table[["p_magnitude", "p_distance"]]
    tested = fitted & p_values.notna().any(axis=1)
    sufficient = (p_values.min(axis=1) >= SIGNIFICANCE).astype(object)
    table["sufficient"] = sufficient.where(tested, None)
    table = table.assign(n_records=int(keep.sum()), n_bracketed=int(exact.sum()))
    rows: list[Any] = table.to_dict("records")
    best = _best(rows, rows[mine], expected / power, group)
    return {"rows": rows, "own": own, **best}


def _best(rows: list[Row], own: Row, logs: FloatArray, event: IntArray) -> Row:
    """Return the best measure, and compare it with the study's own.

    `logs` are ln capacity / exponent, (n_measure, n_record).
    """
    known = [row for row in rows if not row["none"]]
    if not known:
        raise FitError("no measure has a curve from these runs: " + own["none"])
    sufficient = [row for row in known if row["sufficient"]]
    chosen = sufficient or [row for row in known if row["sufficient"] is None] or known
    best = min(chosen, key=lambda row: row["efficiency"])
    p_value = 1.0
    ratio = 1.0
    start = f"Of {_OF[best['sufficient']]} {best['measure']} is the most efficient"
    message = f"{start} (beta {best['beta']:.2f})"
    if best is own:
        message += ", and it is the one that the study was scaled by."
    elif own["none"]:
        message += f"; in {own['measure']} there is no curve to compare it with."
    else:
        mine, other = logs[[rows.index(own), rows.index(best)]]
        by_chance = scatter_by_chance(mine, other, event)
        p_value = min(1.0, by_chance * (len(chosen) - (own in chosen)))
        ratio = best["efficiency"] / own["efficiency"]
        can = "which chance and the choice among them can explain"
        if p_value < SIGNIFICANCE:
            can = "more than chance and the choice among them explain"
        times = f"{ratio:.2f} times that of {own['measure']}"
        message += f": its dispersion is {times}, {can} (p = {p_value:.2g})."
    tests = [(row["p_magnitude"], row["p_distance"]) for row in rows]
    return {
        "best": best["measure"],
        "p_value": p_value,
        "ratio": ratio,
        "n_test": int(np.isfinite(tests).sum()),
        "message": message,
    }


def _sums(values: FloatArray, place: IntArray) -> FloatArray:
    """Return the sums of values by group, (..., n_place).

    `values` are (..., n); `place`, (n,), numbers their groups from 0.
    """
    return values @ (place[:, None] == np.arange(place.max() + 1)).astype(float)


def _compare_records(
    bounds: Pair, rounding: FloatArray, covariates: _Covariates
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the values of `_COLUMNS` by measure, and ln capacities without bounds.

    `bounds` are the lower and the upper bounds of ln capacities, (n_measure, n_record) each; they
    are equal where a capacity is known. In the returned ln capacities a bound is replaced by the
    value expected beyond it. `rounding` is the variance that the width of a bracket adds
    (Sheppard's correction).
    """
    low, high = bounds
    exact = low[0] == high[0]
    n = exact.size
    n_exact = int(exact.sum())
    mean, square = np.full((2, len(low)), np.nan)
    # Where known values do not differ the likelihood has no maximum.
    varies = low[:, exact].var(axis=1) > 1e-18 if n_exact > 1 else square > 0.0
    sound = np.flatnonzero(varies)
    if n_exact == n:
        mean[sound] = low[sound].mean(axis=1)
        square[sound] = low[sound].var(axis=1)
    elif sound.size:
        line, deviation, *_ = normal_lines(np.ones((n, 1)), low[sound], high[sound])
        mean[sound] = line[:, 0]
        square[sound] = deviation**2
    with np.errstate(invalid="ignore"):
        square = square * n / max(n - 1.0, 1.0)
        added = rounding.sum(axis=1) / max(n_exact, 1)
        deviation = np.sqrt(np.where(square > added, square - added, square))
        # In the place of a bound what is expected beyond it.
        centre = mean[:, None]
        spread = deviation[:, None]
        beyond = np.where(
            np.isfinite(low),
            inverse_mills(-(low - centre) / spread),
            -inverse_mills((high - centre) / spread),
        )
        expected = np.where(exact, low, centre + spread * beyond)
    columns = dict.fromkeys(_COLUMNS, np.full(len(low), np.nan))
    columns |= {"theta": np.exp(mean), "beta": deviation}
    for name, (used, value, place) in covariates.items():
        if exact[used].sum() >= 4:
            part = np.stack([low, high, expected])[..., used]
            test = _slope_test(part, value, place)
            columns[f"slope_{name}"], columns[f"p_{name}"] = test
    return columns, expected


def _slope_test(bounded: FloatArray, covariate: FloatArray, place: IntArray) -> Pair:
    """Return the slope of ln capacity on a covariate, and the p-value of a t test of means.

    `bounded`, (3, n_measure, n_record), holds lower bounds, upper bounds and expected values of ln
    capacity. `place` numbers the group of each record, over which means are taken.
    """
    low, high, expected = bounded
    count = np.bincount(place)
    off = _sums(covariate, place) / count
    y = _sums(expected, place) / count
    off = off - off.mean()
    y = y - y.mean(axis=1, keepdims=True)
    slope = y @ off / (off @ off)
    freedom = off.size - 2
    residual = ((y - slope[:, None] * off) ** 2).sum(axis=1) / freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        p_value = 2.0 * stdtr(freedom, -np.abs(slope) / np.sqrt(residual / (off @ off)))
    sound = np.flatnonzero(np.isfinite(slope))
    if sound.size and not np.array_equal(low, high):
        centred = covariate - covariate.mean()
        design = np.column_stack([np.ones(covariate.size), centred])
        slope[sound] = normal_lines(design, low[sound], high[sound])[0][:, 1]
    return slope, p_value


def scatter_by_chance(one: FloatArray, other: FloatArray, place: IntArray) -> float:
    """Return the p-value of the scatter of `one` being larger than that of `other`.

    The hypothesis is that both scatter alike. Both hold a value for each record, (n_record,);
    `place` numbers the events of the records from 0. Under the hypothesis sum and difference of
    the two are not correlated (Pitman 1939, Morgan 1939, Biometrika 31).
    """
    difference, total = (part - part.mean() for part in (one - other, one + other))
    squares = (difference @ difference) * (total @ total)
    n = one.size
    pairs = max(int((np.bincount(place) ** 2).sum()) - n, 1)
    alike = [
        max(0.0, (_sums(x, place) ** 2).sum() / (x @ x or 1.0) - 1.0)
        for x in (difference, total)
    ]
    freedom = n / (1.0 + alike[0] * alike[1] * n / pairs) - 2.0
    if squares == 0.0 or freedom <= 0.0:
        return 1.0
    correlation = difference @ total / np.sqrt(squares)
    t = correlation * np.sqrt(freedom / (1.0 - correlation**2))
    return float(stdtr(freedom, -t))
