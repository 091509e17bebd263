"""The lognormal fragility curve, a band about a curve, and checks for all modules."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from archfrag.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


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
        Of (ln theta, beta): inverse of the observed Fisher information, or as `kind` implies.
    log_likelihood : float
        At the maximum; of stripes with the binomial coefficients, of capacities the density of
        their logarithms.
    n_levels : int
        Levels (stripes), distinct observed capacities (IDA) or ends of brackets that were used.
    n_total : int
        Runs (stripes) or records (IDA) that were used.
    kind : str
        ``"stripes"``, ``"ida"`` (moments), ``"ida_truncated"``, ``"brackets"`` or
        ``"posterior"`` (medians), or of a `Mixture` ``"mixture"``.
    """

    theta: float
    beta: float
    covariance: FloatArray = field(compare=False)
    log_likelihood: float
    n_levels: int
    n_total: int
    kind: str

    @property
    def parts(self) -> FloatArray:
        """theta and beta of the lognormal curves that this one is the mean of, (n, 2)."""
        return np.array([[self.theta, self.beta]])

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
        theta, beta = self.parts.T
        return ndtr((log_intensity(im)[..., None] - np.log(theta)) / beta).mean(axis=-1)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and strings, for JSON."""
        return {
            "kind": self.kind, "theta": self.theta, "beta": self.beta,
            "covariance_ln_theta_beta": self.covariance.tolist(),
            "log_likelihood": self.log_likelihood,
            "n_levels": self.n_levels, "n_total": self.n_total,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "Fragility":
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            If a key is missing.
        """
        try:
            kind = partial(Mixture, members=np.array(v)) if (v := values.get("members")) else cls
            return kind(
                theta=float(values["theta"]),
                beta=float(values["beta"]),
                covariance=np.array(values["covariance_ln_theta_beta"], dtype=float),
                # JSON has no nan: of what is no maximum of a likelihood it holds null.
                log_likelihood=float("nan" if (v := values["log_likelihood"]) is None else v),
                n_levels=int(values["n_levels"]),
                n_total=int(values["n_total"]),
                kind=str(values["kind"]),
            )
        except KeyError as error:
            raise InputError(f"a stored fragility lacks the key {error}") from error


@dataclass(frozen=True)
class Mixture(Fragility):
    """Curve of a class of arches: the mean of the curves of its arches.

    It is the probability that an arch collapses of which only its class is known. `theta` and
    `beta` are those of the lognormal curve with the same mean and standard deviation of ln
    capacity, the law of total variance on the curves of the arches.
    """

    members: FloatArray = field(compare=False)  #: theta and beta of each arch, (n_arch, 2)

    @property
    def parts(self) -> FloatArray:
        """theta and beta of each arch, (n_arch, 2)."""
        return self.members

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and strings, for JSON."""
        return super().to_dict() | {"members": self.members.tolist()}


def mixture(pooled: Fragility, members: Sequence[Fragility]) -> Mixture:
    """The mean of some curves; covariance and sizes are those of the curve of all their runs."""
    theta, beta = np.array([[fit.theta, fit.beta] for fit in members]).T
    plain = {each.name: getattr(pooled, each.name) for each in fields(Fragility)}
    plain |= {
        "theta": float(np.exp(np.log(theta).mean())),
        "beta": float(np.sqrt((beta**2).mean() + np.log(theta).var())),
        "kind": "mixture",
    }
    return Mixture(**plain, members=np.stack([theta, beta], axis=1))


@dataclass(frozen=True)
class Band:
    """Pointwise confidence band of a curve."""

    lower: FloatArray  #: probabilities of collapse, shape of the intensities asked for
    upper: FloatArray
    confidence: float  #: two-sided, at each intensity


def log_intensity(im: ArrayLike) -> FloatArray:
    """ln of intensities at which a curve is asked for, -inf at 0; InputError if one is < 0."""
    im = np.asarray(im, dtype=float)
    bad = im[~(im >= 0.0)]
    if bad.size:
        raise InputError(f"im holds {bad[0]:g}; an intensity is a number from 0 upwards")
    with np.errstate(divide="ignore"):
        return np.log(im)


def positive(values: ArrayLike, name: str, unknown: bool = False) -> FloatArray:
    """Values as floats, > 0 and finite, nan only where `unknown` is allowed; else InputError."""
    given = np.asarray(values, dtype=float)
    bad = given[~((given > 0.0) & np.isfinite(given) | (unknown & np.isnan(given)))]
    if bad.size:
        allowed = "positive finite numbers" + (", or nan where not known" if unknown else "")
        raise InputError(f"{name} holds {bad[0]:g}; only {allowed} are allowed")
    return given


def shaped(values: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray[Any]:
    """Values as an array of the shape that others imply; else InputError."""
    given = np.asarray(values)
    if given.shape != shape:
        raise InputError(f"{name} has shape {given.shape}; {shape} is needed")
    return given


def rising(values: ArrayLike, name: str) -> FloatArray:
    """A list of positive finite numbers that increase; else InputError."""
    given = positive(values, name)
    if given.ndim != 1:
        raise InputError(f"{name} has shape {given.shape}; a list is needed")
    for i in np.flatnonzero(np.diff(given) <= 0.0)[:1]:
        raise InputError(f"{name} has {given[i + 1]:g} after {given[i]:g}; it must increase")
    return given


def tails(confidence: float) -> list[float]:
    """Probabilities below the ends of a central interval; InputError unless within 0 and 1."""
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}; it lies between 0 and 1, such as 0.9")
    return [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]
