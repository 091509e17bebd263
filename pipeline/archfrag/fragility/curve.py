"""The lognormal fragility curve, its band and its parts in a class; checks for all modules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import FitError, InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, repr=False)
class Fragility:
    """A lognormal fragility curve; bands and intervals are from the covariance.

    Examples
    --------
    >>> import archfrag as af
    >>> curve = af.fit_ida([0.5, 0.7, 0.9, 1.3])
    >>> curve
    <Fragility theta 0.8, beta 0.403: ida, 4 runs or records>
    >>> curve.probability([0.4, 0.8]).round(3).tolist()
    [0.043, 0.5]
    >>> curve.quantile([0.1, 0.5]).round(3).tolist()
    [0.477, 0.8]
    """

    theta: float  #: median capacity, in the unit of the intensity it was fitted to
    beta: float  #: dispersion: standard deviation of the logarithm of capacity [1]
    #: (2, 2), of (ln theta, beta): inverse of the observed information, or as `kind` implies
    covariance: FloatArray = field(compare=False)
    log_likelihood: float  #: with binomial coefficients, or the density of ln capacity
    n_levels: int  #: levels, distinct observed capacities or ends of brackets that were used
    n_total: int  #: runs (stripes) or records that were used
    #: "stripes", "ida", "ida_truncated", "brackets", "adjusted", "posterior", "mixture"
    kind: str
    #: (n_arch, 2), theta and beta of each arch of a class: the curve is the mean of theirs.
    members: FloatArray | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        about = f"{self.kind}, {self.n_total} runs or records"
        return f"<Fragility theta {self.theta:.3g}, beta {self.beta:.3g}: {about}>"

    @property
    def parts(self) -> FloatArray:
        """theta and beta of the lognormal curves whose mean this curve is, (n, 2)."""
        return np.array([[self.theta, self.beta]]) if self.members is None else self.members

    @property
    def standard_errors(self) -> FloatArray:
        """Standard errors of (ln theta, beta), (2,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> float:
        """Correlation of the estimates of ln theta and beta."""
        return float(self.covariance[0, 1] / np.prod(self.standard_errors))

    def probability(self, im: ArrayLike) -> FloatArray:
        """Probability of collapse at intensities >= 0 (else InputError), same shape."""
        theta, beta = self.parts.T
        deviation = (log_intensity(im)[..., None] - np.log(theta)) / beta
        return scipy.special.ndtr(deviation).mean(axis=-1)

    __call__ = probability

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Intensities at which the curve has probabilities, of the same shape.

        InputError unless they lie between 0 and 1.
        """
        p = np.asarray(probability, dtype=float)
        if not np.all((p > 0.0) & (p < 1.0)):
            raise InputError(f"quantile: {p.tolist()} must lie between 0 and 1")
        theta, beta = self.parts.T
        if len(theta) == 1:
            return np.asarray(theta[0] * np.exp(beta[0] * scipy.special.ndtri(p)))

        from scipy.optimize import brentq  # which takes a tenth of a second to import

        def of(one: float) -> float:
            ends = np.log(theta) + beta * scipy.special.ndtri(one)
            low, high = ends.min() - 1e-9, ends.max() + 1e-9
            return float(np.exp(brentq(lambda x: self.probability(np.exp(x)) - one, low, high)))

        return np.vectorize(of, otypes=[float])(p)

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the curve with its 90 % band on axes of matplotlib, new ones if none are given."""
        from archfrag.plots import axes_of

        ax, im = axes_of(ax), np.linspace(0.0, float(self.quantile(0.99)), 200)
        (line,) = ax.plot(im, self(im), **style)
        ax.fill_between(im, *self.band(im), color=line.get_color(), alpha=0.2, linewidth=0.0)
        ax.set(xlabel="intensity", ylabel="probability", xlim=(0.0, im[-1]), ylim=(0.0, 1.0))
        return ax

    def band(self, im: ArrayLike, confidence: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Pointwise band of the curve at intensities >= 0, by the delta method."""
        quantile = scipy.special.ndtri(tails(confidence)[1])
        z = (log_intensity(im) - np.log(self.theta)) / self.beta
        # var z = g C g with g = -(1, z) / beta.
        (var_theta, cov), (_, var_beta) = self.covariance
        with np.errstate(invalid="ignore"):
            reach = quantile * np.sqrt(var_theta + 2.0 * cov * z + var_beta * z * z) / self.beta
            ends = scipy.special.ndtr([z - reach, z + reach])
            lower, upper = np.where(np.isneginf(z), 0.0, ends)
        return lower, upper

    def theta_interval(self, confidence: float = 0.9) -> tuple[float, float]:
        """Interval of the median from the covariance, normal in ln theta."""
        reach = np.exp(scipy.special.ndtri(tails(confidence)[1]) * self.standard_errors[0])
        return float(self.theta / reach), float(self.theta * reach)

    def beta_interval(self, confidence: float = 0.9) -> tuple[float, float]:
        """Interval of the dispersion from the covariance, normal in ln beta."""
        z = scipy.special.ndtri(tails(confidence)[1])
        reach = np.exp(z * self.standard_errors[1] / self.beta)
        return float(self.beta / reach), float(self.beta * reach)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and strings, for JSON."""
        plain = vars(self) | {"covariance_ln_theta_beta": self.covariance.tolist()}
        del plain["covariance"], plain["members"]
        return plain if self.members is None else plain | {"members": self.members.tolist()}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Fragility:
        """Inverse of `to_dict`."""
        given = dict(values)
        given["covariance"] = np.array(given.pop("covariance_ln_theta_beta"), dtype=float)
        if "members" in given:
            given["members"] = np.array(given["members"], dtype=float)
        return cls(**given)


def mixture(pooled: Fragility, curves: Sequence[Fragility]) -> Fragility:
    """Curve of a class of arches: the mean of the curves of its arches.

    `theta` and `beta` are those of the lognormal curve with the same mean and standard deviation
    of ln capacity; covariance and sizes are those of the `pooled` curve of all runs.
    """
    members = np.array([[fit.theta, fit.beta] for fit in curves])
    logs = np.log(members[:, 0])
    theta, beta = float(np.exp(logs.mean())), np.sqrt((members[:, 1] ** 2).mean() + logs.var())
    return replace(pooled, theta=theta, beta=float(beta), kind="mixture", members=members)


def split_capacities(capacity: ArrayLike) -> tuple[float, float]:
    """Divide the dispersion of capacities, (n_arch, n_record), into two betas.

    With A the arch, var ln C = E[var(ln C | A)] + var(E[ln C | A]): beta_record_to_record^2, with
    what records do to some arches only, and beta_model^2; by analysis of variance with two factors
    (Searle, Casella and McCulloch 1992, *Variance Components*, chapters 3 and 4). A negative
    estimate counts as 0. Records with an unknown capacity (nan) are left out. FitError if fewer
    than two arches, or two records of each, remain.
    """
    logs = np.log(capacity)
    logs = logs[:, ~np.isnan(logs).any(axis=0)]
    a, r = logs.shape
    if a < 2 or r < 2:
        known = f"{a} arches with {r} records of known capacity remain"
        raise FitError(f"{known}; two of each are needed to separate modelling from records")
    arch, record = logs.mean(axis=1), logs.mean(axis=0)
    residual = logs - arch[:, None] - record + logs.mean()
    interaction = float((residual**2).sum()) / ((a - 1) * (r - 1))
    # var(ln C | arch) is that of the records and of the interaction together.
    within = record.var(ddof=1) + (a - 1) / a * interaction
    return _roots(within, arch.var(ddof=1) - interaction / r)


def split_curves(
    theta: ArrayLike, beta: ArrayLike, standard_error: ArrayLike, *, shared: float = 0.0
) -> tuple[float, float]:
    """Divide the dispersion as `split_capacities`, from the curve of each arch, (n_arch,).

    beta_model^2 is the variance of ln theta over the arches less the mean square of its standard
    errors (DerSimonian and Laird 1986, Control. Clin. Trials 7, with equal weights);
    beta_record_to_record^2 is the mean of beta^2. `shared`, 0 to below 1, is the correlation of
    the errors of ln theta between arches.
    """
    logs = np.log(theta)
    if logs.size < 2:
        raise FitError("one arch has no modelling dispersion; sample several")
    sampling = np.mean(np.square(standard_error)) * (1.0 - shared)
    return _roots(float(np.mean(np.square(beta))), logs.var(ddof=1) - sampling)


def _roots(within: float, between: float) -> tuple[float, float]:
    return float(np.sqrt(max(within, 0.0))), float(np.sqrt(max(between, 0.0)))


def log_intensity(im: ArrayLike) -> FloatArray:
    """ln of intensities, -inf at 0; InputError if one is < 0."""
    im = np.asarray(im, dtype=float)
    bad = im[~(im >= 0.0)]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; an intensity is a number from 0 upwards")
    with np.errstate(divide="ignore"):
        return np.log(im)


def positive(values: ArrayLike, name: str) -> FloatArray:
    """Values as floats; InputError unless all are > 0 and finite."""
    given = np.asarray(values, dtype=float)
    bad = given[~((given > 0.0) & np.isfinite(given))]
    if bad.size:
        raise InputError(f"{name} holds {bad[0]:g}; only positive finite numbers are allowed")
    return given


def rising(values: ArrayLike, name: str) -> FloatArray:
    """A list of positive finite numbers; InputError unless they increase."""
    given = positive(values, name)
    for i in np.flatnonzero(np.diff(given) <= 0.0)[:1]:
        raise InputError(f"{name} has {given[i + 1]:g} after {given[i]:g}; it must increase")
    return given


def tails(confidence: float) -> list[float]:
    """Probabilities below the ends of a central interval; InputError unless within 0 and 1."""
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}; it lies between 0 and 1, such as 0.9")
    return [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]
