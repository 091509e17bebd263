"""Lognormal fragility curves by maximum likelihood, from stripes and from capacities.

A curve is P(collapse | im) = Phi((ln im - ln theta) / beta). On the probit scale it is the
straight line Phi^-1(P) = intercept + slope ln im with slope = 1 / beta, in which the binomial
likelihood is concave: it has one maximum, and none exactly where the data are separated.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.special import gammaln, log_ndtr, ndtr

from archfrag.errors import FitError, InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FLAT_SLOPE = 1e-9


class Verdict(IntEnum):
    """What one run says about collapse; only the first two say anything."""

    STANDING = 0
    COLLAPSED = 1
    UNFINISHED = 2
    SOLVER_FAILURE = 3


@dataclass(frozen=True)
class VerdictCounts:
    """Runs of each verdict at each level, all arrays of shape (n_level,)."""

    standing: IntArray
    collapsed: IntArray
    unfinished: IntArray
    solver_failures: IntArray

    @property
    def n(self) -> IntArray:
        """Runs that decide: standing and collapsed only, (n_level,)."""
        return self.standing + self.collapsed

    @property
    def runs(self) -> IntArray:
        """All runs whatever their verdict, (n_level,)."""
        return self.n + self.unfinished + self.solver_failures


@dataclass(frozen=True)
class Fragility:
    """A lognormal fragility curve and how well the data determine it.

    Attributes
    ----------
    theta : float
        Median capacity, in the unit of the intensity it was fitted to.
    beta : float
        Dispersion: standard deviation of the logarithm of capacity [1].
    covariance : ndarray, (2, 2)
        Of (ln theta, beta): inverse of the observed Fisher information.
    log_likelihood : float
        At the maximum; of stripes with the binomial coefficients, of capacities the density of
        their logarithms.
    n_levels : int
        Levels (stripes) or distinct observed capacities (IDA) that were used.
    n_total : int
        Runs (stripes) or records (IDA) that were used.
    kind : str
        ``"stripes"``, ``"ida"`` or ``"ida_truncated"``.
    """

    theta: float
    beta: float
    covariance: FloatArray = field(compare=False)
    log_likelihood: float
    n_levels: int
    n_total: int
    kind: str

    @property
    def standard_errors(self) -> FloatArray:
        """Standard errors of (ln theta, beta), (2,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> float:
        """Correlation of the estimates of ln theta and beta."""
        return float(self.covariance[0, 1] / np.prod(self.standard_errors))

    def probability(self, im: ArrayLike) -> FloatArray:
        """Probability of collapse at intensity `im`, same shape; zero at im = 0.

        Raises
        ------
        InputError
            If an intensity is negative or not a number.
        """
        return ndtr((log_intensity(im) - np.log(self.theta)) / self.beta)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and strings, for JSON."""
        return {
            "kind": self.kind,
            "theta": self.theta,
            "beta": self.beta,
            "covariance_ln_theta_beta": self.covariance.tolist(),
            "log_likelihood": self.log_likelihood,
            "n_levels": self.n_levels,
            "n_total": self.n_total,
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Fragility":
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            If a key is missing.
        """
        try:
            return cls(
                theta=float(values["theta"]),
                beta=float(values["beta"]),
                covariance=np.array(values["covariance_ln_theta_beta"], dtype=float),
                log_likelihood=float(values["log_likelihood"]),
                n_levels=int(values["n_levels"]),
                n_total=int(values["n_total"]),
                kind=str(values["kind"]),
            )
        except KeyError as error:
            raise InputError(f"a stored fragility lacks the key {error}") from error


def log_intensity(im: ArrayLike) -> FloatArray:
    """Natural logarithm of intensities at which a curve is asked for; -inf at zero.

    Raises
    ------
    InputError
        If an intensity is negative or not a number.
    """
    im = np.asarray(im, dtype=float)
    bad = im[~(im >= 0.0)]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; an intensity is a number from 0 upwards")
    with np.errstate(divide="ignore"):
        return np.log(im)


def count_verdicts(verdict: ArrayLike) -> VerdictCounts:
    """Count the verdicts of all records at each level.

    Parameters
    ----------
    verdict : array_like of int, (..., n_level)
        Codes of `Verdict`; all axes but the last are counted together.

    Raises
    ------
    InputError
        If there is a code that is no verdict: a run that is missing must be told, not counted.
    """
    codes = np.asarray(verdict)
    if codes.ndim == 0:
        raise InputError("verdict is a single value; an array with levels last is needed")
    foreign = codes[~np.isin(codes, [int(v) for v in Verdict])]
    if foreign.size:
        raise InputError(
            f"verdict holds {foreign.flat[0]!s}, which is none of "
            + ", ".join(f"{v.value} ({v.name.lower()})" for v in Verdict)
        )
    codes = codes.reshape(-1, codes.shape[-1])
    standing, collapsed, unfinished, failures = (
        np.count_nonzero(codes == v, axis=0).astype(np.int64) for v in Verdict
    )
    return VerdictCounts(standing, collapsed, unfinished, failures)


def fit_stripes(im: ArrayLike, collapses: ArrayLike, n: ArrayLike) -> Fragility:
    """Fit a lognormal curve to collapse counts at several intensity levels.

    Binomial maximum likelihood (Baker 2015, Earthquake Spectra 31(1), 579-599, Eq 11); runs at
    one level count as independent. The covariance is the inverse of the observed information.

    Parameters
    ----------
    im : array_like, (n_level,)
        Intensity of each level, any unit, > 0.
    collapses : array_like of int, (n_level,)
        Runs that collapsed.
    n : int or array_like of int, (n_level,)
        Runs that collapsed or stood. Unfinished runs and solver failures belong to neither.
        Levels with n = 0 are left out.

    Raises
    ------
    InputError
        If an argument has the wrong shape or a value that cannot be.
    FitError
        If the likelihood has no maximum with beta > 0; the sentence says what is known instead.
    """
    im, collapses, n = _checked_stripes(im, collapses, n)
    used = n > 0
    im, collapses, n = im[used], collapses[used], n[used]
    _require_overlap(im, collapses, n)
    log_im = np.log(im)
    centre, width = log_im.mean(), log_im.std()
    line, information = _probit_line((log_im - centre) / width, collapses, n - collapses)
    if line[1] <= _FLAT_SLOPE:
        raise FitError(
            f"the share of collapses does not rise with intensity over the levels from "
            f"{im.min():g} to {im.max():g}, so no lognormal curve fits; add levels or records"
        )
    scale = width / line[1]
    jacobian = np.array([[-scale, scale * line[0] / line[1]], [0.0, -scale / line[1]]])
    theta = np.exp(centre - scale * line[0])
    coefficients = gammaln(n + 1) - gammaln(collapses + 1) - gammaln(n - collapses + 1)
    z = line[0] + line[1] * (log_im - centre) / width
    return Fragility(
        theta=float(theta),
        beta=float(scale),
        covariance=jacobian @ np.linalg.inv(information) @ jacobian.T,
        log_likelihood=float(np.sum(coefficients) - _loss(z, collapses, n - collapses)),
        n_levels=int(np.unique(im).size),
        n_total=int(n.sum()),
        kind="stripes",
    )


def fit_ida(capacities: ArrayLike, truncate_at: float | None = None) -> Fragility:
    """Fit a lognormal curve to the intensities at which records cause collapse.

    Complete data: mean and standard deviation of the logarithms (Baker 2015, Eqs 4 and 5), the
    latter with n - 1, as is usual for IDA: dividing by n, as maximum likelihood would, makes
    beta too small by 1 - 1/(2n) and the curve unsafe in its lower tail. Truncated data: maximum
    likelihood with the records above `truncate_at` censored (Baker 2015, Eq 7).

    Parameters
    ----------
    capacities : array_like, (n_record,)
        Least intensity at which each record causes collapse, any unit, > 0. With `truncate_at`
        it may be inf where no collapse was seen.
    truncate_at : float, optional
        Highest intensity that was tried. A capacity above it counts as 'higher than this', one
        equal to it as a collapse.

    Raises
    ------
    InputError
        If a capacity or the limit is not a positive number.
    FitError
        If the data do not determine a dispersion > 0.
    """
    capacities = np.asarray(capacities, dtype=float)
    if capacities.ndim != 1 or capacities.size == 0:
        raise InputError(
            f"capacities has shape {capacities.shape}; a list of one number per record is needed"
        )
    if truncate_at is not None and not 0.0 < truncate_at < np.inf:
        raise InputError(f"truncate_at is {truncate_at:g}; a positive finite number is needed")
    allowed = capacities > 0.0
    if truncate_at is None:
        allowed &= np.isfinite(capacities)
    if not allowed.all():
        raise InputError(
            f"capacities holds {capacities[~allowed][0]:g}; they are positive numbers"
            + (", and infinite only where truncate_at is given" if truncate_at is None else "")
        )
    if truncate_at is None or np.all(capacities <= truncate_at):
        return _fit_complete(np.log(capacities))
    return _fit_censored(np.log(capacities), float(np.log(truncate_at)))


def _checked_stripes(im, collapses, n) -> tuple[FloatArray, FloatArray, FloatArray]:
    im = np.asarray(im, dtype=float)
    collapses = np.asarray(collapses, dtype=float)
    n = np.asarray(n, dtype=float)
    if im.ndim != 1 or im.size == 0:
        raise InputError(f"im has shape {im.shape}; a list of one intensity per level is needed")
    if n.ndim == 0:
        n = np.full(im.shape, n)
    for name, values in (("collapses", collapses), ("n", n)):
        if values.shape != im.shape:
            raise InputError(
                f"{name} has shape {values.shape}, im {im.shape}; one number per level is needed"
            )
        bad = values[~((values >= 0.0) & (values == np.floor(values)) & np.isfinite(values))]
        if bad.size:
            raise InputError(f"{name} holds {bad[0]:g}; counts are whole numbers from 0 upwards")
    bad = im[~((im > 0.0) & np.isfinite(im))]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; intensities are positive finite numbers")
    if np.any(collapses > n):
        i = int(np.argmax(collapses > n))
        raise InputError(
            f"collapses is {collapses[i]:g} at im = {im[i]:g}, more than the n = {n[i]:g} runs"
        )
    return im, collapses, n


def _require_overlap(im: FloatArray, collapses: FloatArray, n: FloatArray) -> None:
    """Raise FitError unless the likelihood has a maximum (Albert and Anderson 1984)."""
    if im.size == 0:
        raise FitError("no level has a run that collapsed or stood, so there is nothing to fit")
    if not collapses.any():
        raise FitError(
            f"no run collapsed at any level: theta lies above {im.max():g}, the highest level "
            "tried; add higher levels"
        )
    if np.array_equal(collapses, n):
        raise FitError(
            f"every run collapsed at every level: theta lies below {im.min():g}, the lowest "
            "level tried; add lower levels"
        )
    if np.all(im == im[0]):
        raise FitError(
            f"all runs are at one level, im = {im[0]:g}, which cannot tell theta from beta; "
            "add levels"
        )
    first_collapse = im[collapses > 0].min()
    last_standing = im[collapses < n].max()
    if first_collapse > last_standing:
        raise FitError(
            f"all runs stand up to {last_standing:g} and all collapse from {first_collapse:g} "
            "(perfect separation), so beta tends to 0: theta lies between "
            f"{last_standing:g} and {first_collapse:g}; add levels between them"
        )
    if first_collapse == last_standing:
        raise FitError(
            f"only the level {first_collapse:g} has both collapses and standing runs (perfect "
            f"separation), so beta tends to 0 and theta to {first_collapse:g}; add levels close "
            "to it"
        )


def _loss(z: FloatArray, collapses: FloatArray, standing: FloatArray) -> float:
    """Negative log-likelihood without binomial coefficients, `z` on the probit scale."""
    return float(-np.sum(collapses * log_ndtr(z) + standing * log_ndtr(-z)))


def _mills(z: FloatArray) -> FloatArray:
    """phi(z) / Phi(z), also far in the lower tail."""
    return np.exp(-0.5 * z * z - 0.5 * np.log(2.0 * np.pi) - log_ndtr(z))


def _probit_line(
    x: FloatArray, collapses: FloatArray, standing: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Intercept and slope of the likeliest probit line, and the observed information there."""
    design = np.stack([np.ones_like(x), x])

    def gradient(line):
        z = line @ design
        return design @ (standing * _mills(-z) - collapses * _mills(z))

    def hessian(line):
        z = line @ design
        up, down = _mills(z), _mills(-z)
        weight = collapses * up * (z + up) + standing * down * (down - z)
        return (design * weight) @ design.T

    result = minimize(
        lambda line: _loss(line @ design, collapses, standing),
        np.zeros(2),
        method="trust-exact",
        jac=gradient,
        hess=hessian,
        options={"gtol": 1e-6},
    )
    # Newton's last step costs nothing and squares what error the stopping rule has left.
    line = result.x - np.linalg.solve(hessian(result.x), gradient(result.x))
    return line, hessian(line)


def _fit_complete(logs: FloatArray) -> Fragility:
    if np.all(logs == logs[0]):
        raise FitError(
            f"all {logs.size} capacities are {np.exp(logs[0]):g}, so beta tends to 0 and no "
            "dispersion can be estimated; add records"
        )
    n = logs.size
    mean, deviation = float(logs.mean()), float(logs.std(ddof=1))
    z = (logs - mean) / deviation
    return Fragility(
        theta=float(np.exp(mean)),
        beta=deviation,
        covariance=deviation**2 * np.diag([1.0 / n, 0.5 / (n - 1)]),
        log_likelihood=float(
            -0.5 * np.sum(z * z) - n * np.log(deviation) - 0.5 * n * np.log(2.0 * np.pi)
        ),
        n_levels=int(np.unique(logs).size),
        n_total=n,
        kind="ida",
    )


def _fit_censored(logs: FloatArray, limit: float) -> Fragility:
    observed = logs[logs <= limit]
    n_censored = logs.size - observed.size
    if observed.size == 0:
        raise FitError(
            f"no capacity lies at or below truncate_at = {np.exp(limit):g}: theta lies above "
            "it; try higher intensities"
        )
    if np.all(observed == limit):
        raise FitError(
            f"all observed capacities equal truncate_at = {np.exp(limit):g}, so beta tends to "
            "0; resolve the capacities more finely"
        )

    # Olsen (1978): in (mean / deviation, 1 / deviation) the censored likelihood is concave.
    def loss(p):
        z = p[1] * observed - p[0]
        return (
            0.5 * np.sum(z * z)
            - observed.size * np.log(p[1])
            - n_censored * log_ndtr(p[0] - p[1] * limit)
        )

    def gradient(p):
        z = p[1] * observed - p[0]
        hazard = n_censored * _mills(p[0] - p[1] * limit)
        return np.array([-z.sum() - hazard, z @ observed - observed.size / p[1] + hazard * limit])

    def hessian(p):
        tail = p[0] - p[1] * limit
        hazard = _mills(tail)
        weight = n_censored * hazard * (tail + hazard)
        diagonal = observed @ observed + observed.size / p[1] ** 2 + weight * limit**2
        off = -observed.sum() - weight * limit
        return np.array([[observed.size + weight, off], [off, diagonal]])
