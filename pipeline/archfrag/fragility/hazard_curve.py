"""A hazard curve: how often a year an intensity is exceeded."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray, log_intensity, positive, rising


@dataclass(frozen=True)
class HazardCurve:
    """Annual frequency of exceedance at several intensities, and a rule between and beyond.

    Between two points ln rate is linear in ln im: the rate is a power of the intensity there.
    Below the first point the first power goes on, above the last one the last power that falls.
    A hazard curve that bends downwards in these scales is overestimated by both extensions.

    Attributes
    ----------
    im : ndarray, (n,)
        Intensities, increasing, > 0.
    rate : ndarray, (n,)
        Annual frequency of exceedance [1/year], > 0, not increasing, and not constant.

    Raises
    ------
    InputError
        If the arrays are none of this.

    Examples
    --------
    >>> from archfrag.fragility.hazard_curve import HazardCurve
    >>> curve = HazardCurve([0.1, 0.4], [1e-2, 1e-4])
    >>> [float(f"{rate:.3g}") for rate in curve.rate_at([0.1, 0.2, 0.8])]
    [0.01, 0.001, 1e-05]
    """

    im: FloatArray
    rate: FloatArray

    def __post_init__(self) -> None:
        for name, check in (("im", rising), ("rate", positive)):
            values = check(getattr(self, name), f"the hazard curve's {name}")
            object.__setattr__(self, name, values)
        if self.im.shape != self.rate.shape or self.im.size < 2:
            raise InputError(
                f"the hazard curve's im has shape {self.im.shape}, its rate {self.rate.shape}; "
                "two lists of at least two points are needed"
            )
        for i in np.flatnonzero(np.diff(self.rate) > 0.0)[:1]:
            raise InputError(
                f"the hazard curve's rate of exceedance rises from {self.rate[i]:g} to "
                f"{self.rate[i + 1]:g} at im = {self.im[i + 1]:g}; it never rises with intensity"
            )
        if self.rate[0] == self.rate[-1]:
            raise InputError(
                f"the hazard curve's rate is {self.rate[0]:g} at all its points, so it holds "
                "nothing of how often stronger motions occur"
            )

    @classmethod
    def from_exceedance(cls, im: ArrayLike, probability: ArrayLike, years: float) -> "HazardCurve":
        """Curve from probabilities of exceedance in a time, motions being a Poisson process.

        rate = -ln(1 - probability) / years.  Points with a probability of 1, whose rate is not
        known, or of 0 are left out; the rules of the class stand in for them.

        Raises
        ------
        InputError
            If a probability is outside [0, 1], `years` is not positive, or what is left is no
            curve.
        """
        probability = np.asarray(probability, dtype=float)
        bad = probability[~((probability >= 0.0) & (probability <= 1.0))]
        if bad.size:
            raise InputError(f"the hazard curve's probability holds {bad[0]:g}; from 0 to 1")
        if not 0.0 < years < np.inf:
            raise InputError(f"the hazard curve is for {years:g} years; a positive time is needed")
        with np.errstate(divide="ignore"):
            return cls.from_rates(im, -np.log1p(-probability) / years)

    @classmethod
    def from_rates(cls, im: ArrayLike, rate: ArrayLike) -> "HazardCurve":
        """Curve from its points, those with a rate of 0 or infinity left out."""
        im, rate = np.asarray(im, dtype=float), np.asarray(rate, dtype=float)
        if im.shape != rate.shape:
            return cls(im, rate)  # which refuses it
        known = ~((rate == 0.0) | (rate == np.inf))
        if (n := np.count_nonzero(known)) < 2:
            raise InputError(
                f"the hazard curve has {n} of {rate.size} points with a rate above 0 that is "
                "known; at least two are needed"
            )
        return cls(im[known], rate[known])

    @property
    def slopes(self) -> FloatArray:
        """Power with which the rate falls, below the points, between them and above, (n + 1,)."""
        between = -np.diff(np.log(self.rate)) / np.diff(np.log(self.im))
        return np.concatenate([between[:1], between, between[between > 0.0][-1:]])

    def rate_at(self, im: ArrayLike) -> FloatArray:
        """Annual frequency of exceedance at intensities of any shape [1/year].

        At im = 0 it is infinite where the first power is above 0.
        """
        x = log_intensity(im)
        return self.pieces(x).rate_at(x)

    def pieces(self, x: FloatArray) -> "Pieces":
        """The pieces that hold each ln im, or begin there."""
        knots = np.log(self.im)
        place = np.searchsorted(knots, x, side="right")
        anchor = np.maximum(place - 1, 0)
        return Pieces(knots[anchor], np.log(self.rate[anchor]), self.slopes[place])


class Pieces(NamedTuple):
    """Where the hazard is one power, arrays of one shape."""

    anchor: FloatArray  #: ln im at which the rate is exp(log_rate)
    log_rate: FloatArray
    slope: FloatArray

    def rate_at(self, x: FloatArray) -> FloatArray:
        """Rates at one ln im of each piece."""
        with np.errstate(invalid="ignore"):
            fall = np.where(self.slope > 0.0, self.slope * (x - self.anchor), 0.0)
        return np.exp(self.log_rate - fall)
