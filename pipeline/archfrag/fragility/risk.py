"""Mean annual frequency of collapse: a fragility curve weighted by a hazard curve.

rate = integral of P(collapse | im) |d lambda(im)| (Cornell, Jalayer, Hamburger and Foutch 2002,
J. Struct. Eng. 128(4)), with lambda a power of im between the points of the hazard curve. On each
such piece the integral has a closed form, so that nothing is lost by quadrature.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtr

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.fragility.hazard_curve import HazardCurve

__all__ = ["CollapseRate", "TabulatedCurve", "collapse_rate", "rate_by_level"]

# A steep first slope of the hazard and a wide curve overflow; such a rate stays finite, and all
# of it is seen to be from below the hazard curve.
_LARGEST_LOG = 600.0


@dataclass(frozen=True)
class TabulatedCurve:
    """Probabilities of collapse at several intensities, linear in ln im between them.

    Below the first point the probability is 0, above the last one that of the last.

    Attributes
    ----------
    im : ndarray, (n,)
        Increasing, > 0.
    probability_of_collapse : ndarray, (n,)
        From 0 to 1, not falling.

    Raises
    ------
    InputError
        If the arrays are none of this.
    """

    im: FloatArray
    probability_of_collapse: FloatArray

    def __post_init__(self) -> None:
        im = np.asarray(self.im, dtype=float)
        p = np.asarray(self.probability_of_collapse, dtype=float)
        if im.ndim != 1 or im.shape != p.shape or im.size == 0:
            raise InputError(
                f"the curve's im has shape {im.shape}, its probabilities {p.shape}; two lists of "
                "one number per point are needed"
            )
        if not (np.all(im > 0.0) and np.all(np.isfinite(im)) and np.all(np.diff(im) > 0.0)):
            raise InputError("the curve's im must be positive finite numbers that increase")
        if not (np.all(p >= 0.0) and np.all(p <= 1.0) and np.all(np.diff(p) >= 0.0)):
            raise InputError("the curve's probabilities must lie from 0 to 1 and never fall")
        object.__setattr__(self, "im", im)
        object.__setattr__(self, "probability_of_collapse", p)

    def probability(self, im: ArrayLike) -> FloatArray:
        """Probability of collapse at intensities of any shape."""
        with np.errstate(divide="ignore"):
            x = np.log(np.asarray(im, dtype=float))
        return np.interp(x, np.log(self.im), self.probability_of_collapse, left=0.0)


@dataclass(frozen=True)
class CollapseRate:
    """Mean annual frequency of collapse and its band.

    Attributes
    ----------
    rate : float
        [1/year], of the curve as fitted.
    lower, upper : float
        Ends of the band [1/year]; nan where no draws were given. Only the uncertainty of the
        fragility curve's parameters is in it, none of the hazard.
    confidence : float
    below, above : float
        Fraction of `rate` from intensities below the first and above the last point of the hazard
        curve, where its extension is an assumption.
    """

    rate: float
    lower: float
    upper: float
    confidence: float
    below: float
    above: float

    @property
    def outside(self) -> float:
        """Fraction of the rate from outside the range of the hazard curve."""
        return self.below + self.above

    @property
    def return_period(self) -> float:
        """[year]"""
        return 1.0 / self.rate if self.rate > 0.0 else np.inf

    def probability_in(self, years: float) -> tuple[float, float, float]:
        """Probability of a collapse in a time, with its band: 1 - exp(-rate years).

        Collapses are a Poisson process: the arch is put up again at once each time.

        Raises
        ------
        InputError
            If `years` is not positive.
        """
        if not 0.0 < years < np.inf:
            raise InputError(f"years is {years:g}; a positive finite time is needed")
        value, low, high = -np.expm1(-years * np.array([self.rate, self.lower, self.upper]))
        return float(value), float(low), float(high)


def collapse_rate(
    hazard: HazardCurve,
    curve: Fragility | TabulatedCurve,
    draws: tuple[ArrayLike, ArrayLike] | None = None,
    confidence: float = 0.9,
) -> CollapseRate:
    """Mean annual frequency of collapse.

    Parameters
    ----------
    hazard : HazardCurve
        Intensity in the unit of the curve.
    curve : Fragility or TabulatedCurve
    draws : (array_like, array_like), each (n_draw,), optional
        theta and beta as uncertain as they are, from
        `archfrag.fragility.parameters.parameter_draws` or a bootstrap; the band runs between the
        quantiles of their rates.
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
    if not 0.0 < confidence < 1.0:
        raise InputError(f"confidence is {confidence:g}; it lies between 0 and 1, such as 0.9")
    parts = rate_by_level(hazard, curve, hazard.im[[0, -1]])
    rate = float(parts.sum())
    lower = upper = np.nan
    if draws is not None:
        pieces = _pieces(hazard, np.empty(0))
        rates = _lognormal(pieces, *_parameters(*draws)).sum(axis=-1)
        tail = 0.5 - 0.5 * confidence
        lower, upper = map(float, np.quantile(rates, [tail, 1.0 - tail]))
    below, _, above = parts / rate if rate > 0.0 else (0.0, 0.0, 0.0)
    return CollapseRate(rate, lower, upper, confidence, float(below), float(above))


def rate_by_level(
    hazard: HazardCurve, curve: Fragility | TabulatedCurve, edges: ArrayLike
) -> FloatArray:
    """Rate of collapse by motions of each range of intensity.

    Parameters
    ----------
    hazard : HazardCurve
    curve : Fragility or TabulatedCurve
    edges : array_like, (n_edge,)
        Increasing, > 0.

    Returns
    -------
    ndarray, (n_edge + 1,)
        [1/year], from 0 to the first edge, between edges, and from the last edge on; they add up
        to the rate of collapse.

    Raises
    ------
    InputError
        If the edges are not positive and increasing.
    """
    edges = np.asarray(edges, dtype=float)
    if edges.ndim != 1 or not np.all(edges > 0.0) or not np.all(np.diff(edges) > 0.0):
        raise InputError("edges must be a list of positive intensities that increase")
    if isinstance(curve, TabulatedCurve):
        pieces = _pieces(hazard, np.concatenate([edges, curve.im]))
        rates = _tabulated(pieces, curve)
    else:
        pieces = _pieces(hazard, edges)
        rates = _lognormal(pieces, *_parameters(curve.theta, curve.beta))
    level = np.searchsorted(np.log(edges), pieces.left, side="right")
    return np.bincount(level, weights=rates, minlength=edges.size + 1).astype(float)


@dataclass(frozen=True)
class _Pieces:
    """Where the hazard is one power: ln im from `left` to `right`, all arrays (n_piece,)."""

    left: FloatArray
    right: FloatArray
    anchor: FloatArray  # ln im at which the rate is exp(log_rate)
    log_rate: FloatArray
    slope: FloatArray

    def rate_at(self, x: FloatArray) -> FloatArray:
        """Rates at one ln im of each piece, 0 at +inf; at -inf not asked for."""
        with np.errstate(invalid="ignore"):
            fall = np.where(self.slope > 0.0, self.slope * (x - self.anchor), 0.0)
        return np.exp(self.log_rate - fall)


def _pieces(hazard: HazardCurve, edges: FloatArray) -> _Pieces:
    """The hazard's own pieces, cut at `edges`, from im = 0 to infinity."""
    knots = np.log(hazard.im)
    cuts = np.union1d(knots, np.log(edges))
    left, right = np.concatenate([[-np.inf], cuts]), np.concatenate([cuts, [np.inf]])
    place = np.searchsorted(knots, left, side="right")
    anchor = np.maximum(place - 1, 0)
    return _Pieces(
        left, right, knots[anchor], np.log(hazard.rate[anchor]), hazard.slopes[place]
    )  # fmt: skip


def _parameters(theta: ArrayLike, beta: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """ln theta and beta with an axis for the pieces."""
    theta, beta = np.asarray(theta, dtype=float), np.asarray(beta, dtype=float)
    for name, values in (("theta", theta), ("beta", beta)):
        bad = values[~((values > 0.0) & np.isfinite(values))]
        if bad.size:
            raise InputError(f"{name} holds {bad.flat[0]:g}; positive finite numbers are needed")
    return np.log(theta)[..., None], beta[..., None]


def _lognormal(pieces: _Pieces, log_theta: FloatArray, beta: FloatArray) -> FloatArray:
    """Rates of a lognormal curve on each piece, (..., n_piece).

    By parts: [-Phi lambda] + integral of lambda dPhi, and the latter with lambda = c e^(-k x) is
    lambda(theta) e^(k^2 beta^2 / 2) [Phi(z + k beta)], z = (x - ln theta) / beta.
    """
    k = pieces.slope
    a, b = (pieces.left - log_theta) / beta, (pieces.right - log_theta) / beta
    log_centre = pieces.log_rate - k * (log_theta - pieces.anchor) + 0.5 * (k * beta) ** 2
    log_moved = log_centre + _log_difference(a + k * beta, b + k * beta)
    moved = np.exp(np.minimum(log_moved, _LARGEST_LOG))
    lower = np.where(np.isneginf(pieces.left), 0.0, ndtr(a) * _finite_rate(pieces, pieces.left))
    upper = np.where(np.isposinf(pieces.right), 0.0, ndtr(b) * _finite_rate(pieces, pieces.right))
    # A piece without a fall of the rate has no motions; elsewhere rounding must not go below 0.
    return np.where(k > 0.0, np.maximum(lower - upper + moved, 0.0), 0.0)


def _finite_rate(pieces: _Pieces, x: FloatArray) -> FloatArray:
    return pieces.rate_at(np.where(np.isfinite(x), x, pieces.anchor))


def _log_difference(a: FloatArray, b: FloatArray) -> FloatArray:
    """ln(Phi(b) - Phi(a)) for a < b, without cancellation in either tail."""
    swap = a > 0.0
    a, b = np.where(swap, -b, a), np.where(swap, -a, b)
    upper = log_ndtr(b)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(np.isneginf(upper), 0.0, np.exp(log_ndtr(a) - upper))
        return upper + np.log1p(-ratio)


def _tabulated(pieces: _Pieces, curve: TabulatedCurve) -> FloatArray:
    """Rates of a tabulated curve on each piece, (n_piece,); its points are cuts.

    P = p0 + q (x - x0) and lambda = c e^(-k x) give p0 lambda0 - p1 lambda1 + q (lambda0 -
    lambda1) / k.
    """
    knots = np.log(curve.im)
    inside = (pieces.left >= knots[0]) & (pieces.slope > 0.0)
    left = np.where(inside, pieces.left, pieces.anchor)
    first, last = pieces.rate_at(left), np.zeros(left.size)
    bounded = inside & np.isfinite(pieces.right)
    right = np.where(bounded, pieces.right, left)
    last[bounded] = pieces.rate_at(right)[bounded]
    p0 = np.interp(left, knots, curve.probability_of_collapse)
    p1 = np.interp(right, knots, curve.probability_of_collapse)
    width = np.where(bounded, right - left, 1.0)
    k = np.where(pieces.slope > 0.0, pieces.slope, 1.0)
    rates = p0 * first - p1 * last + (p1 - p0) / width * (first - last) / k
    return np.where(inside, np.maximum(rates, 0.0), 0.0)
