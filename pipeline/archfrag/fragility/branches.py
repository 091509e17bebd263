"""The mean of a curve over uncertain theta and beta, and branches of a logic tree for them.

Both are of the draws of theta and beta over which the mean rate of collapse is taken.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from archfrag.fragility.curve import Curve, FloatArray

Draws = tuple[FloatArray, FloatArray]
_BETAS, _THETAS = 5, 3  # branches each way
_MOST_PARTS = 40000  # of the mean of the curve of a class: of more, fewer draws are taken


def branches_of(curve: Curve, draws: Draws) -> tuple[list[Curve], FloatArray]:
    """Return 15 curves that stand for all that theta and beta may be, and their weights of sum 1.

    `draws` are theta and beta, (n,) each, from `Curve.draws`. Branches are the nodes of Gauss'
    quadrature over the draws: five of ln beta, and for each three of what is left of ln theta
    after its regression on ln beta. So they have means, variances and covariance of the draws, and
    nine moments of ln beta: rates hang on the widest curves.
    """
    log_theta, log_beta = np.log(draws)
    middle = log_theta.mean(), log_beta.mean()
    slope = np.cov(log_theta, log_beta, ddof=0)[0, 1] / log_beta.var()
    wider, weight = _gauss(log_beta - middle[1], _BETAS)
    off, share = _gauss(log_theta - middle[0] - slope * (log_beta - middle[1]), _THETAS)
    thetas = np.exp(middle[0] + slope * wider[:, None] + off)
    betas = np.exp(middle[1] + wider)
    curves = [
        Curve(t, b, n_total=curve.n_total, kind="branch",
              members=None if curve.members is None else _parts(curve, t, b))
        for row, b in zip(thetas.tolist(), betas.tolist()) for t in row
    ]  # fmt: skip
    return curves, np.outer(weight, share).ravel()


def predictive(curve: Curve, draws: Draws) -> Curve:
    """Return the mean of the curve over `draws`, at each intensity; band and intervals stay.

    `theta` and `beta` are those of the lognormal curve with the same mean and standard deviation
    of ln capacity.
    """
    step = 1 + (len(curve.parts) * len(draws[0]) - 1) // _MOST_PARTS
    parts = _parts(curve, draws[0][::step], draws[1][::step])
    logs = np.log(parts[:, 0])
    theta, beta = np.exp(logs.mean()), np.sqrt((parts[:, 1] ** 2).mean() + logs.var())
    return replace(curve, theta=float(theta), beta=float(beta), members=parts, kind="predictive")


def _gauss(values: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights, (n,) each, with the first 2 n - 1 moments of `values` about 0.

    They are of the matrix of multiplication by the values among polynomials of degree < n that
    are orthogonal on them (Golub and Welsch 1969, Math. Comp. 23).
    """
    basis = np.linalg.qr(np.vander(values, n, increasing=True))[0]
    nodes, vectors = np.linalg.eigh(basis.T @ (values[:, None] * basis))
    return nodes, vectors[0] ** 2


def _parts(curve: Curve, theta: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Return the parts of a curve with other parameters, (n,) each, one below the other.

    ln capacity is moved and stretched: the arches of a class move and widen together.
    """
    theta, beta = (np.reshape(each, (-1, 1)) for each in (theta, beta))
    wider, (own, width) = beta / curve.beta, curve.parts.T
    moved = theta * (own / curve.theta) ** wider, wider * width
    return np.stack([each.ravel() for each in moved], axis=1)
