"""The mean of a curve over uncertain theta and beta, and branches of a logic tree for them.

Both are of the draws of theta and beta over which the mean rate of collapse is taken.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from archfrag.fragility.curve import Curve, FloatArray, IntArray
from archfrag.fragility.risk import HazardCurve, lognormal_rates

Draws = tuple[FloatArray, FloatArray]
# Probabilities of parts of beta, the widest a small one on which rates hang, and of theta in each.
_BETAS = np.array([0.3, 0.3, 0.25, 0.12, 0.03])
_THETAS = np.array([0.25, 0.5, 0.25])
_TRIED = 200  # values of beta
_MOST_PARTS = (
    40000  # of the mean of the curve of a class: of more, fewer draws are taken
)


def branches_of(curve: Curve, draws: Draws) -> tuple[list[Curve], FloatArray]:
    """Return 15 curves that stand for all that theta and beta may be, and their weights of sum 1.

    `draws` are theta and beta, (n,) each, from `Curve.draws`. They are divided into five parts by
    beta, and each of these into three by theta. Theta of a branch is the geometric mean of its
    part; beta is that with the mean rate of collapse of its part, for a usual hazard, which falls
    with the power 2.5 of the intensity from 0.05 times the median of theta on.
    """
    middle = np.median(draws[0]) * np.array([0.01, 0.05, 10.0])
    usual = HazardCurve(middle, np.array([0.05, 0.05, 10.0]) ** -2.5)
    rates = lognormal_rates(usual, *draws)
    curves = list[Curve]()
    weights = list[float]()
    tried = np.geomspace(draws[1].min(), draws[1].max(), _TRIED)
    for of_beta in _parted(np.argsort(draws[1], kind="stable"), _BETAS):
        order = of_beta[np.argsort(draws[0][of_beta], kind="stable")]
        for part in _parted(order, _THETAS):
            t = float(np.exp(np.log(draws[0][part]).mean()))
            rising = lognormal_rates(usual, np.full(_TRIED, t), tried)
            rising = rising[: rising.argmax() + 1]
            b = float(np.interp(rates[part].mean(), rising, tried[: rising.size]))
            members = None if curve.members is None else _parts(curve, t, b)
            curves.append(
                Curve(t, b, n_total=curve.n_total, kind="branch", members=members)
            )
            weights.append(part.size / rates.size)
    return curves, np.array(weights)


def _parted(values: IntArray, probability: FloatArray) -> list[IntArray]:
    """Divide values in parts of these probabilities."""
    ends = np.round(np.cumsum(probability)[:-1] * values.size).astype(int)
    return np.split(values, ends)


def predictive(curve: Curve, draws: Draws) -> Curve:
    """Return the mean of the curve over `draws`, at each intensity; band and intervals stay.

    `theta` and `beta` are those of the lognormal curve with the same mean and standard deviation
    of ln capacity.
    """
    step = 1 + (len(curve.parts) * len(draws[0]) - 1) // _MOST_PARTS
    parts = _parts(curve, draws[0][::step], draws[1][::step])
    logs = np.log(parts[:, 0])
    theta = np.exp(logs.mean())
    beta = np.sqrt((parts[:, 1] ** 2).mean() + logs.var())
    return replace(
        curve, theta=float(theta), beta=float(beta), members=parts, kind="predictive"
    )


def _parts(curve: Curve, theta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the parts of a curve with other parameters, (n,) each, one below the other.

    ln capacity is moved and stretched: the arches of a class move and widen together.
    """
    theta, beta = (np.reshape(each, (-1, 1)) for each in (theta, beta))
    wider, (own, width) = beta / curve.beta, curve.parts.T
    moved = theta * (own / curve.theta) ** wider, wider * width
    return np.stack([each.ravel() for each in moved], axis=1)
