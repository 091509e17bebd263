"""The probability of the damage that one earthquake did, over what its shaking has in common.

P(state k or worse | x) = Phi((x + r - ln theta_k) / s) of an arch at ln intensity x. What arches
share is not counted twice: r, the record-to-record part of beta, and x are normal over the places
of an earthquake with the covariance tau tau' + (phi phi' + beta_record^2) rho, where rho =
exp(-3 h / length) at a distance h. s^2 = beta_model^2 + the variance of x that is an arch's own.

x + r is integrated about its likeliest value, in one dimension by Gauss and Hermite, in more by
importance sampling (Naylor and Smith 1982, J. R. Stat. Soc. C 31; Pinheiro and Bates 1995, J.
Comput. Graph. Stat. 4).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy  # whose parts are loaded when they are used
from scipy.special import logsumexp

from archfrag.fragility.curve import FloatArray, Pair
from archfrag.fragility.observed import Damage
from archfrag.fragility.probit import interval_terms, log_between

_NODES = 41  # of Gauss and Hermite
_FIELDS = 64  # draws of intensities
_ITERATIONS = 30
_CLOSE = 1e-5
_KNOWN = 1e-8  # variance of ln intensity that is added to each place
_MEMORY = 1_000_000  # numbers in an array
_NEGLIGIBLE = 0.05  # variance of a direction, over that of an arch's own


def evidence(
    damage: Damage, log_theta: FloatArray, beta: FloatArray, own: float
) -> FloatArray:
    """Return ln of the probability of the damage that one earthquake did, (n_draw,).

    `log_theta`, (n_draw, n_state), rises from state to state. `own` is the part of beta^2, of beta
    (n_draw,), that is an arch's own.
    """
    record = (1.0 - own) * beta**2
    basis, left = _directions(damage, np.median(record), own * np.median(beta) ** 2)
    shared, likeness = (
        basis.T @ each @ basis for each in (damage.shared, damage.likeness)
    )
    rule = _rule(basis.shape[1])
    basis = basis[damage.place]
    step = max(1, _MEMORY // (len(basis) * max(basis.shape[1], _FIELDS)))
    parts = []
    for i in range(0, beta.size, step):
        at = slice(i, i + step)
        both = shared + record[at, None, None] * likeness
        root = basis @ np.linalg.cholesky(both + _KNOWN * np.eye(len(both[0])))
        width = np.sqrt(own * beta[at, None] ** 2 + damage.own + left)
        edges = np.pad(log_theta[at], ((0, 0), (1, 1)), constant_values=np.nan)
        lines = [(damage.centre - edges[:, damage.state + k]) / width for k in (1, 0)]
        parts.append(_integrated(root, 1.0 / width, lines, rule))
    return np.concatenate(parts)


def _directions(damage: Damage, record: float, width: float) -> Pair:
    """Return directions in which places share intensity, and the variance that is left out.

    They are (n_place, n) and by arch. Directions of hardly any variance beside `width` are left
    out, and count as the arches' own.
    """
    whole = damage.shared + record * damage.likeness
    values, vectors = np.linalg.eigh(whole)
    least = _NEGLIGIBLE * (width + damage.own.mean())
    kept = values >= min(least, values[-1])
    left = np.diag(whole) - vectors[:, kept] ** 2 @ values[kept]
    return vectors[:, kept], np.maximum(left, 0.0)[damage.place]


def _rule(size: int) -> Pair:
    """Return nodes, (size, n_node), and ln weights of a mean over standard normal numbers."""
    if size == 1:
        nodes, weight = np.polynomial.hermite_e.hermegauss(_NODES)
        return nodes[None], np.log(weight / weight.sum())
    normal = scipy.stats.qmc.MultivariateNormalQMC(
        np.zeros(size), rng=np.random.default_rng(1)
    )
    return normal.random(_FIELDS).T, np.full(_FIELDS, -np.log(_FIELDS))


def _integrated(
    root: FloatArray, slope: FloatArray, lines: Sequence[FloatArray], rule: Pair
) -> FloatArray:
    """Return ln of the mean of prod (Phi(high) - Phi(low)) over v normal, (n_draw,).

    low and high are slope x + `lines`, with x = root v, of each arch; nan is no bound. `slope` and
    lines are (n_draw, n_arch), `root` is (n_draw, n_arch, n); `rule` is that of `_rule`, about the
    likeliest v.
    """
    noise, weight = rule
    at, factor = _likeliest(root, slope, lines)
    fields = at[..., None] + np.linalg.solve(np.swapaxes(factor, 1, 2), noise)
    x = slope[..., None] * (root @ fields)
    low, high = (
        np.where(np.isnan(line), side, line)[..., None] + x
        for line, side in zip(lines, (-np.inf, np.inf))
    )
    logs = log_between(low, high).sum(axis=1) + weight
    logs += 0.5 * ((noise**2).sum(axis=0) - (fields**2).sum(axis=1))
    volume = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(logsumexp(logs, axis=1) - volume)


def _likeliest(
    root: FloatArray, slope: FloatArray, lines: Sequence[FloatArray]
) -> tuple[Any, Any]:
    """Return the likeliest v of `_integrated`, and the Cholesky factor of the curvature there."""
    turned = np.swapaxes(root, 1, 2)
    one = np.eye(root.shape[2])
    at: Any = np.zeros(turned.shape[:2])
    bounds = [
        np.stack([slope + 0.0 * line, line], axis=-1).reshape(-1, 1, 2)
        for line in lines
    ]
    for _ in range(_ITERATIONS):
        x = (root @ at[..., None]).ravel()
        _, rise, bend = interval_terms(np.stack([x, np.ones_like(x)], 1), *bounds)
        gradient = turned @ rise[:, 0].reshape(*slope.shape, 1) + at[..., None]
        curvature = turned @ (bend[:, 0, 0].reshape(*slope.shape, 1) * root) + one
        step = np.linalg.solve(curvature, gradient)[..., 0]
        at -= step
        if np.abs(step).max() < _CLOSE:
            break
    return at, np.linalg.cholesky(curvature)
