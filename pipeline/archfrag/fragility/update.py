"""Curves updated by damage that was seen after earthquakes.

P(state k or worse | x) = Phi((x + r - ln theta_k) / s) of an arch at ln intensity x. What arches
share is not counted twice: r, the record-to-record part of beta, and x are normal over the places
of an earthquake with the covariance tau tau' + (phi phi' + beta_record^2) rho, where rho =
exp(-3 h / length) at a distance h. s^2 = beta_model^2 + the variance of x that is an arch's own. Several
limit states have one beta (Bodenmann, Baker and Stojadinovic 2024, doi 10.1177/87552930241261486).

Draws of theta and beta are weighted by their likelihood. x + r is integrated about its likeliest
value, in one dimension by Gauss and Hermite, in more by importance sampling (Naylor and Smith
1982, J. R. Stat. Soc. C 31; Pinheiro and Bates 1995, J. Comput. Graph. Stat. 4).
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.special import logsumexp, softmax
from scipy.stats import qmc

from archfrag.errors import FitError, InputError
from archfrag.files import counted
from archfrag.fragility.curve import Curve, FloatArray, IntArray, Pair
from archfrag.fragility.damage import smoothed
from archfrag.fragility.observed import Damage, Observed, damage_of
from archfrag.fragility.probit import interval_terms, log_between
from archfrag.fragility.several import crossing_words

_DRAWS = 20_000  # of theta and beta, for each state
_FIRST = 300  # of them, from which the likelihood of all is interpolated
_FALL = 40.0  # of the log-likelihood below its greatest value, at most
_ROUNDS = 5
_USED = 500  # draws, chosen by the interpolated likelihood
_STRATA = 20  # of beta
_BLOCK = 500  # draws of neighbouring beta, within which thetas of several states are independent
_NODES = 41  # of Gauss and Hermite
_FIELDS = 64  # draws of intensities
_ITERATIONS = 30
_CLOSE = 1e-5
_KNOWN = 1e-8  # variance of ln intensity that is added to each place
_MEMORY = 1_000_000  # numbers in an array
_NEGLIGIBLE = 0.05  # variance of a direction, over that of an arch's own
_FEWEST = 100.0  # effective number of draws
_UNMOVED = 0.98  # effective share of the draws
_LEAST_OWN = 0.05  # dispersion of an arch's own, over beta
_NARROW = 1e-4  # scatter of ln beta that is added, for a beta that is known


def updated(
    curve: Curve, observed: Observed, beta_model: float | None = None, **given
) -> Curve:
    """Return the curve after damage that was seen; see `Curve.update`."""
    own = _own_share(curve, beta_model)
    damage, states = damage_of(curve, observed, **given)
    log_theta, beta = _drawn(states)

    def of_all(log_theta: FloatArray, beta: FloatArray) -> FloatArray:
        return np.sum([evidence(each, log_theta, beta, own) for each in damage], axis=0)

    drawn = beta.size
    kept, weight, number = _weighed(of_all, log_theta, beta)
    log_theta = log_theta[kept]
    beta = beta[kept]
    arches = sum(each.state.size for each in damage)
    _warn(states[-1], damage, number, drawn)
    seen = f"{counted(arches, 'arch')} in {counted(len(damage), 'earthquake')}"
    top = max(curve.im, default=float(curve.quantile(0.99)))
    grid = curve.im or np.linspace(0.0, top, 120).tolist()
    found = []
    for column, state in zip(log_theta.T, states):
        points = np.stack([np.log(beta), column])
        known = smoothed(points, weight, (len(damage), arches))
        found.append(
            replace(
                known.with_band(grid, curve.confidence),
                **{name: getattr(state, name) for name in _KEPT},
                n_independent=number,
                method=f"updated by damage of {seen}; before: {curve.method or 'a curve'}",
                assumptions=f"{curve.assumptions} {_ASSUMED.format(own)}".strip(),
            )
        )
    *lighter, last = found
    if lighter:
        last = replace(last, states=(*found,), crossings=crossing_words(found))
    return last


_KEPT = "name", "state", "meaning", "measure", "unit", "si", "levels"
_ASSUMED = (
    "Damage updated it: {:.0%} of the variance of ln capacity is an arch's own; the rest, and "
    "what is not known of the shaking, is shared within an earthquake."
)


def _own_share(curve: Curve, beta_model: float | None) -> float:
    """Return the fraction of beta^2 that is an arch's own."""
    if not curve.fitted:
        raise FitError(f"there is no curve to update: {curve.reason}")
    parts = curve.dispersion or {}
    if beta_model is None:
        if "beta_model" not in parts:
            raise InputError(
                "beta_model must be given: the part of beta that differs from arch to arch, "
                f"from 0 to beta, which is {curve.beta:.3g}; the rest is from record to record, "
                "which arches of one earthquake share (a class of several arches knows it)"
            )
        square = np.square([parts["beta_model"], parts["beta_record_to_record"]])
        return float(max(square[0] / square.sum(), _LEAST_OWN**2))
    if not 0.0 <= beta_model <= 1.001 * curve.beta:
        raise InputError(
            f"beta_model is {beta_model:g}; it lies between 0 and beta, {curve.beta:.3g}"
        )
    return float(np.clip(beta_model / curve.beta, _LEAST_OWN, 1.0) ** 2)


def _drawn(states: Sequence[Curve]) -> Pair:
    """Draw ln theta of limit states, (n, n_state), and beta, (n,), that of the severest."""
    generator = np.random.default_rng(0)
    number = _DRAWS * len(states)
    columns = list[FloatArray]()
    for curve in states:
        theta, beta = curve.draws(len(columns), number)
        order = np.argsort(beta)
        if states[1:]:
            order = np.lexsort([generator.random(number), np.argsort(order) // _BLOCK])
        theta = theta[order]
        beta = beta[order] * np.exp(_NARROW * generator.standard_normal(number))
        columns.append(np.log(theta))
    log_theta = np.stack(columns, axis=1)
    kept = (np.diff(log_theta, axis=1) > 0.0).all(axis=1)
    if kept.sum() < _FEWEST:
        raise FitError(
            "the medians of the limit states are in the wrong order; they must rise"
        )
    log_theta = log_theta[kept]
    beta = beta[kept]
    # So ordered, every m-th draw is a stratified sample.
    rank = np.argsort(np.argsort(beta)) * _STRATA // beta.size
    order = np.lexsort([log_theta[:, -1], rank])
    return log_theta[order], beta[order]


def _weighed(
    function: Callable[[FloatArray, FloatArray], FloatArray],
    log_theta: FloatArray,
    beta: FloatArray,
) -> tuple[IntArray, FloatArray, float]:
    """Return draws of the curve by their likelihood, their weights, and their effective number.

    The log-likelihood is found at some of all draws and interpolated. By this some draws are
    chosen, and their weights make up for its error; if that is large, they improve it.
    """
    points = np.column_stack([np.log(beta), log_theta])
    points /= np.ptp(np.quantile(points, [0.25, 0.75], axis=0), axis=0)
    exact = np.full(beta.size, np.nan)
    tried = np.arange(0, beta.size, max(1, beta.size // _FIRST))
    exact[tried] = function(log_theta[tried], beta[tried])
    part = (np.arange(_USED) + 0.5) / _USED
    for _ in range(_ROUNDS):
        known = np.flatnonzero(~np.isnan(exact))
        logs = np.maximum(exact[known], exact[known].max() - _FALL)
        near = RBFInterpolator(points[known], logs)(points)
        chance = softmax(near)
        kept = np.searchsorted(np.cumsum(chance), part)
        kept = np.minimum(kept, beta.size - 1)
        tried = np.setdiff1d(kept, known)
        if tried.size:
            exact[tried] = function(log_theta[tried], beta[tried])
        weight = softmax(exact[kept] - near[kept])
        if weight @ weight < 2.0 / _USED:
            break
    return kept, weight, float(1.0 / (chance @ chance))


def evidence(
    damage: Damage, log_theta: FloatArray, beta: FloatArray, own: float
) -> FloatArray:
    """Return ln of the probability of the damage that one earthquake did, (n_draw,).

    `log_theta`, (n_draw, n_state), rises from state to state. `own` is the part of beta^2, of beta
    (n_draw,), that is an arch's own.
    """
    record = (1.0 - own) * beta**2
    width = own * beta**2
    # Directions in which hardly anything is shared count as the arches' own.
    values, vectors = np.linalg.eigh(
        damage.shared + np.median(record) * damage.likeness
    )
    least = _NEGLIGIBLE * (np.median(width) + damage.own.mean())
    basis = vectors[:, values >= min(least, values[-1])]
    whole = damage.shared, damage.likeness
    inner = [basis.T @ each @ basis for each in whole]
    rest = [
        np.maximum(np.diag(each) - ((basis @ part) * basis).sum(axis=1), 0.0)[
            damage.place
        ]
        for each, part in zip(whole, inner)
    ]
    basis = basis[damage.place]
    size = basis.shape[1]
    if size == 1:
        noise, weight = np.polynomial.hermite_e.hermegauss(_NODES)
        rule = noise[None], np.log(weight / weight.sum())
    else:
        normal = qmc.MultivariateNormalQMC(np.zeros(size), rng=np.random.default_rng(1))
        rule = normal.random(_FIELDS).T, np.full(_FIELDS, -np.log(_FIELDS))
    step = max(1, _MEMORY // (len(basis) * max(size, _FIELDS)))
    parts = []
    for i in range(0, beta.size, step):
        at = slice(i, i + step)
        both = inner[0] + record[at, None, None] * inner[1] + _KNOWN * np.eye(size)
        root = basis @ np.linalg.cholesky(both)
        square = width[at, None] + damage.own + rest[0] + record[at, None] * rest[1]
        edges = np.pad(log_theta[at], ((0, 0), (1, 1)), constant_values=np.nan)
        bounds = [
            np.stack(
                [np.ones_like(square), damage.centre - edges[:, damage.state + k]], -1
            )
            / np.sqrt(square)[..., None]
            for k in (1, 0)
        ]
        parts.append(_integrated(root, bounds, rule))
    return np.concatenate(parts)


def _integrated(
    root: FloatArray, bounds: Sequence[FloatArray], rule: Pair
) -> FloatArray:
    """Return ln of the mean of prod (Phi(high) - Phi(low)) over v normal, (n_draw,).

    `bounds` are low and high, (n_draw, n_arch, 2): slope and intercept in x = root v, nan in the
    intercept where there is no bound. `root` is (n_draw, n_arch, n); `rule` are nodes about the
    likeliest v, (n, n_node), and ln weights.
    """
    noise, weight = rule
    across = np.swapaxes(root, 1, 2)
    rows = [
        np.where(np.isnan(row[..., 1:]), np.nan, row).reshape(-1, 1, 2)
        for row in bounds
    ]
    at = np.zeros((len(root), len(noise)))
    for _ in range(_ITERATIONS):
        x = (root @ at[..., None])[..., 0]
        p = np.stack([x, np.ones_like(x)], -1).reshape(-1, 2)
        _, slope, bend = interval_terms(p, *rows)
        slope = across @ slope[:, 0].reshape(*x.shape, 1) + at[..., None]
        bend = bend[:, 0, 0].reshape(*x.shape, 1)
        curvature = across @ (bend * root) + np.eye(len(noise))
        step = np.linalg.solve(curvature, slope)[..., 0]
        at -= step
        if np.abs(step).max() < _CLOSE:
            break
    factor = np.linalg.cholesky(curvature)
    fields = at[..., None] + np.linalg.solve(np.swapaxes(factor, 1, 2), noise)
    x = root @ fields
    low, high = (
        np.where(np.isnan(row[..., 1:]), side, row[..., :1] * x + row[..., 1:])
        for row, side in zip(bounds, (-np.inf, np.inf))
    )
    logs = log_between(low, high).sum(axis=1) + weight
    logs += 0.5 * ((noise**2).sum(axis=0) - (fields**2).sum(axis=1))
    volume = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(logsumexp(logs, axis=1) - volume)


def _warn(curve: Curve, damage: Sequence[Damage], number: float, drawn: int) -> None:
    """Warn if damage and curve contradict, if damage says nothing, or is beyond the levels."""
    most = max(np.exp(each.centre.max()) for each in damage)
    top = max(curve.levels, default=np.inf)
    found = {
        f"only {number:.0f} of {drawn} draws of the curve agree with the damage: it was very "
        "wide, or the damage contradicts it; check intensities and states": number
        < _FEWEST,
        "the damage tells hardly anything of the median and the dispersion, which are those of "
        "before": number > _UNMOVED * drawn,
        f"arches were shaken by up to {most:.3g} {curve.unit}, and the highest level of the study "
        f"is {top:.3g}: the curve is extrapolated there": most > top,
    }
    for words, true in found.items():
        if true:
            warnings.warn(words, stacklevel=5)
