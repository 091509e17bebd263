"""Mean annual frequency of collapse: a fragility curve weighted by a hazard curve.

rate = integral of P(collapse | im) |d lambda(im)| (Cornell, Jalayer, Hamburger and Foutch 2002,
J. Struct. Eng. 128(4)), with lambda a power of im between the points of the hazard curve. On each
such piece the integral has a closed form, so that nothing is lost by quadrature.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray, Fragility, Mixture, positive, rising, tails
from archfrag.fragility.hazard_curve import HazardCurve
from archfrag.fragility.lines import log_between

MOST_OUTSIDE = 0.5  # fraction of a rate from outside the hazard curve; of more it is a bound
# A steep first slope of the hazard and a wide curve overflow; such a rate stays finite, and all
# of it is seen to be from below the hazard curve.
_LARGEST_LOG = 600.0


@dataclass(frozen=True)
class CollapseRate:
    """Mean annual frequency of collapse and its band.

    Only the uncertainty of the fragility curve's parameters is in the band, none of the hazard.
    """

    rate: float  #: of the medians of theta and beta, the hazard curve extended [1/year]
    #: Over theta and beta as uncertain as they are [1/year]; nan without draws or of a bound.
    mean: float
    lower: float  #: ends of the band [1/year]; nan as `mean`
    upper: float
    confidence: float
    #: Fraction of `rate` from intensities below the first and above the last point of the hazard
    #: curve, where its extension is an assumption.
    below: float
    above: float

    @property
    def outside(self) -> float:
        """Fraction of the rate from outside the range of the hazard curve."""
        return self.below + self.above

    @property
    def is_bound(self) -> bool:
        """Whether most of the rate is from outside the hazard curve."""
        return self.outside > MOST_OUTSIDE

    @property
    def quoted(self) -> float:
        """The rate, or its part within the hazard curve where only that is known [1/year]."""
        return self.rate * max(1.0 - self.outside, 0.0) if self.is_bound else self.rate

    @property
    def return_period(self) -> float:
        """Of the quoted rate [year]; the longest possible one where that is a bound."""
        return 1.0 / self.quoted if self.quoted > 0.0 else np.inf

    def probability_in(self, years: float) -> tuple[float, float, float]:
        """Probability of a collapse in some years, with its band: 1 - exp(-rate years).

        Collapses are a Poisson process: the arch is put up again at once each time.
        """
        positive(years, "years")
        value, low, high = -np.expm1(-years * np.array([self.quoted, self.lower, self.upper]))
        return float(value), float(low), float(high)


def collapse_rate(
    hazard: HazardCurve, curve: Fragility, draws: tuple[ArrayLike, ArrayLike] | None = None,
    confidence: float = 0.9,
) -> CollapseRate:  # fmt: skip
    """Mean annual frequency of collapse.

    Parameters
    ----------
    hazard : HazardCurve
        Intensity in the unit of the curve.
    curve : Fragility
    draws : (array_like, array_like), each (n_draw,), optional
        theta and beta as uncertain as they are, from `parameter_draws` or a bootstrap; the band
        runs between the quantiles of their rates. What the extension below the first point of
        the hazard curve adds to each is at most the hazard's rate at this point. Of a `Mixture`
        they are those of its lognormal curve, and their rates are taken in proportion to its rate.
    confidence : float
        Two-sided, between 0 and 1.

    Raises
    ------
    InputError
        If an argument cannot be.

    Examples
    --------
    A hazard that is one power, k0 im^-k, has rate k0 theta^-k exp(k^2 beta^2 / 2).

    >>> import numpy as np
    >>> from archfrag.fragility.curve import Fragility
    >>> from archfrag.fragility.hazard_curve import HazardCurve
    >>> from archfrag.fragility.risk import collapse_rate
    >>> im = np.array([0.1, 0.3, 1.0])
    >>> fit = Fragility(0.5, 0.4, np.eye(2), 0.0, 1, 1, "ida")
    >>> found = collapse_rate(HazardCurve(im, 1e-4 * im**-2.5), fit)
    >>> round(float(found.rate / (1e-4 * 0.5**-2.5 * np.exp(0.5))), 12)
    1.0
    """
    ends = tails(confidence)
    parts = rate_by_level(hazard, curve, hazard.im[[0, -1]])
    rate = float(parts.sum())
    below, _, above = parts / rate if rate > 0.0 else (0.0, 0.0, 0.0)
    mean = lower = upper = np.nan
    if draws is not None:
        each = _lognormal(hazard, np.log(hazard.im), *draws)
        each[..., 0] = np.minimum(each[..., 0], hazard.rate[0])
        rates = each.sum(axis=-1)
        if isinstance(curve, Mixture):
            at = np.log(hazard.im)
            rates *= rate / float(_lognormal(hazard, at, curve.theta, curve.beta).sum())
        if below + above <= MOST_OUTSIDE:
            mean, (lower, upper) = float(rates.mean()), map(float, np.quantile(rates, ends))
    return CollapseRate(rate, mean, lower, upper, confidence, float(below), float(above))


def rate_by_level(hazard: HazardCurve, curve: Fragility, edges: ArrayLike) -> FloatArray:
    """Rate of collapse by motions of each range of intensity.

    Parameters
    ----------
    hazard, curve
        As of `collapse_rate`.
    edges : array_like, (n_edge,)
        Increasing, > 0; else InputError.

    Returns
    -------
    ndarray, (n_edge + 1,)
        [1/year], from 0 to the first edge, between edges, and from the last edge on; they add up
        to the rate of collapse.
    """
    edges = np.log(rising(edges, "edges"))
    cuts = np.union1d(np.log(hazard.im), edges)
    rates = _lognormal(hazard, cuts, *curve.parts.T).mean(axis=0)
    level = np.searchsorted(edges, np.append(-np.inf, cuts), side="right")
    return np.bincount(level, weights=rates, minlength=edges.size + 1).astype(float)


def parameter_draws(
    fit: Fragility, seed: int, n_record: int | None = None, draws: int = 4000
) -> tuple[FloatArray, FloatArray]:
    """theta and beta, (draws,) each, as uncertain as the data leave them.

    Where the data are the capacities of n records, or n records serve at all levels (which hold
    no more than their n capacities do): from the distributions of mean and variance of a normal
    sample, (n - 1) s^2 / sigma^2 being chi-squared and the mean normal about the true one by
    sigma / sqrt(n) (the reference posterior; Box and Tiao 1973, section 2.4). Otherwise (ln theta,
    ln beta) are normal with the covariance of the fit, as they also are where that is the wider
    one, for instance as the levels end below the median.

    Parameters
    ----------
    fit : Fragility
        Of kind ``"posterior"`` or ``"mixture"``: its covariance is that of the posterior, which
        already knows what the data are worth, and nothing is widened.
    seed : int
        Of numpy's default generator.
    n_record : int, optional
        Records that served at all levels; None if every run had a record of its own.
    draws : int

    Raises
    ------
    InputError
        If the covariance is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from archfrag.fragility.curve import Fragility
    >>> from archfrag.fragility.risk import parameter_draws
    >>> fit = Fragility(0.5, 0.4, np.eye(2) * 1e-4, 0.0, 1, 1, "stripes")
    >>> [round(float(np.median(draws)), 2) for draws in parameter_draws(fit, seed=1)]
    [0.5, 0.4]
    """
    generator = np.random.default_rng(seed)
    count = {"ida": fit.n_total, "posterior": None, "mixture": None}.get(fit.kind, n_record)
    variances = np.diag(fit.covariance)
    scale = np.ones(2)
    if count is not None and count > 1:
        of_sample = fit.beta**2 * np.array([1.0 / count, 0.5 / (count - 1)])
        if fit.kind == "ida" or np.all(variances <= of_sample):
            beta = fit.beta * np.sqrt((count - 1) / generator.chisquare(count - 1, draws))
            noise = generator.standard_normal(draws) / np.sqrt(count)
            return fit.theta * np.exp(beta * noise), beta
        scale = np.sqrt(np.maximum(of_sample / variances, 1.0))
    jacobian = np.diag(scale / np.array([1.0, fit.beta]))
    covariance = jacobian @ fit.covariance @ jacobian.T
    if not np.isfinite(covariance).all():
        raise InputError("the fit's covariance is not finite, so its rate has no band")
    shift = generator.multivariate_normal(np.zeros(2), covariance, draws, method="eigh")
    return fit.theta * np.exp(shift[:, 0]), fit.beta * np.exp(shift[:, 1])


def _lognormal(
    hazard: HazardCurve, cuts: FloatArray, theta: ArrayLike, beta: ArrayLike
) -> FloatArray:
    """Rates of lognormal curves (...) from im = 0 to infinity, cut at ln im, (..., n_cut + 1).

    By parts: [-Phi lambda] + integral of lambda dPhi, and the latter with lambda = c e^(-k x) is
    lambda(theta) e^(k^2 beta^2 / 2) [Phi(z + k beta)], z = (x - ln theta) / beta.
    """
    theta, beta = (positive(v, n)[..., None] for v, n in ((theta, "theta"), (beta, "beta")))
    log_theta = np.log(theta)
    left, right = np.append(-np.inf, cuts), np.append(cuts, np.inf)
    pieces = hazard.pieces(left)
    k = pieces.slope
    a, b = (left - log_theta) / beta, (right - log_theta) / beta
    log_centre = pieces.log_rate - k * (log_theta - pieces.anchor) + 0.5 * (k * beta) ** 2
    log_moved = log_centre + log_between(a + k * beta, b + k * beta)
    moved = np.exp(np.minimum(log_moved, _LARGEST_LOG))
    lower, upper = (
        np.where(known, ndtr(z) * pieces.rate_at(np.where(known, x, pieces.anchor)), 0.0)
        for x, z, known in ((left, a, left > -np.inf), (right, b, right < np.inf))
    )
    # A piece without a fall of the rate has no motions; elsewhere rounding must not go below 0.
    return np.where(k > 0.0, np.maximum(lower - upper + moved, 0.0), 0.0)
