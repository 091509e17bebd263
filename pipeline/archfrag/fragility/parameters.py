"""Draws of the parameters of a curve, as uncertain as the data leave them."""

import numpy as np

from archfrag.errors import InputError
from archfrag.fragility.curve import FloatArray, Fragility

DRAWS = 4000


def parameter_draws(
    fit: Fragility, seed: int, n_record: int | None = None, draws: int = DRAWS
) -> tuple[FloatArray, FloatArray]:
    """theta and beta as uncertain as the data leave them.

    Where the data are the capacities of n records, or n records serve at all levels (which tell
    no more than their n capacities do): from the distributions of mean and variance of a normal
    sample, (n - 1) s^2 / sigma^2 being chi-squared and the mean normal about the true one by
    sigma / sqrt(n) (the reference posterior; Box and Tiao 1973, section 2.4). Otherwise (ln theta,
    ln beta) are normal with the covariance of the fit, as they also are where that is the wider
    one, for instance as the levels end below the median.

    Parameters
    ----------
    fit : Fragility
        Of kind ``"posterior"``: its covariance is that of the posterior, which already knows what
        the data are worth, and nothing is widened.
    seed : int
        Of numpy's default generator.
    n_record : int, optional
        Records that served at all levels; None if every run had a record of its own.
    draws : int

    Returns
    -------
    (ndarray, ndarray), each (draws,)

    Raises
    ------
    InputError
        If the covariance is not finite.
    """
    generator = np.random.default_rng(seed)
    count = fit.n_total if fit.kind == "ida" else n_record
    if fit.kind == "posterior":
        count = None
    variances = np.diag(fit.covariance)
    if count is not None and count > 1:
        of_sample = fit.beta**2 * np.array([1.0 / count, 0.5 / (count - 1)])
        if fit.kind == "ida" or np.all(variances <= of_sample):
            beta = fit.beta * np.sqrt((count - 1) / generator.chisquare(count - 1, draws))
            noise = generator.standard_normal(draws) / np.sqrt(count)
            return fit.theta * np.exp(beta * noise), beta
        scale = np.sqrt(np.maximum(of_sample / variances, 1.0))
    else:
        scale = np.ones(2)
    jacobian = np.diag(scale / np.array([1.0, fit.beta]))
    covariance = jacobian @ fit.covariance @ jacobian.T
    if not np.isfinite(covariance).all():
        raise InputError("the fit's covariance is not finite, so its rate has no band")
    shift = generator.multivariate_normal(np.zeros(2), covariance, draws, method="eigh")
    return fit.theta * np.exp(shift[:, 0]), fit.beta * np.exp(shift[:, 1])
