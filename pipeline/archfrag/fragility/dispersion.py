"""Dispersion of capacity of a class of arches, divided into its parts.

One rule throughout, the law of total variance on ln capacity: with A the arch (a sample of what
is not known of it, or one of a fleet),

    var ln C = E[var(ln C | A)] + var(E[ln C | A]),

of which the first is beta_record_to_record^2 and the second beta_model^2. What records do to some
arches and not to others (the interaction), and the scatter that time step and tolerances bring,
belong to the first. A variance that is estimated as negative counts as 0.
"""

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import positive, shaped


def split_capacities(capacity: ArrayLike) -> tuple[float, float]:
    """Divide the dispersion of capacities into beta_record_to_record and beta_model.

    Analysis of variance by moments with two factors, since all arches meet the same records and
    their means all have the scatter of the records (Searle, Casella and McCulloch 1992, *Variance
    Components*, chapters 3 and 4).

    Parameters
    ----------
    capacity : array_like, (n_arch, n_record)
        Capacity of each arch under each record, any unit, > 0; nan where not known. Records not
        known for all arches are left out.

    Raises
    ------
    InputError, FitError
        If the argument is not valid; if fewer than two arches, or two records of each, remain.
    """
    logs = np.log(positive(capacity, "capacities", unknown=True))
    if logs.ndim != 2 or logs.size == 0:
        raise InputError(f"capacities have shape {logs.shape}; (n_arch, n_record) is needed")
    logs = logs[:, ~np.isnan(logs).any(axis=0)]
    a, r = logs.shape
    if a < 2 or r < 2:
        raise FitError(
            f"{a} arches with {r} records of known capacity remain; two of each are needed to "
            "separate modelling from records"
        )
    arch, record = logs.mean(axis=1), logs.mean(axis=0)
    residual = logs - arch[:, None] - record + logs.mean()
    interaction = float((residual**2).sum()) / ((a - 1) * (r - 1))
    # var(ln C | arch) is that of the records and of the interaction together.
    within = record.var(ddof=1) + (a - 1) / a * interaction
    return _roots(within, arch.var(ddof=1) - interaction / r)


def split_curves(
    theta: ArrayLike, beta: ArrayLike, standard_error: ArrayLike, *, shared: float = 0.0
) -> tuple[float, float]:
    """Divide the dispersion of fitted curves into beta_record_to_record and beta_model.

    beta_model^2 is the variance of ln theta over the arches less the mean square of its standard
    errors (moments, as DerSimonian and Laird 1986, Control. Clin. Trials 7, with equal weights);
    beta_record_to_record^2 is the mean of beta^2.

    Parameters
    ----------
    theta, beta, standard_error : array_like, (n_arch,)
        Of each arch's curve; the standard error of ln theta.
    shared : float
        Correlation of the errors of ln theta between arches, 0 to below 1: near the correlation
        of their ln capacities where all meet the same records, 0 where each has its own.

    Raises
    ------
    InputError, FitError
        If an argument is not valid; if there are fewer than two arches.
    """
    logs = np.log(positive(theta, "theta"))
    betas = shaped(positive(beta, "beta"), logs.shape, "beta")
    errors = shaped(positive(standard_error, "standard_error"), logs.shape, "standard_error")
    if not 0.0 <= shared < 1.0:
        raise InputError(f"shared is {shared:g}; a correlation from 0 to below 1 is needed")
    if logs.size < 2:
        raise FitError("one arch has no modelling dispersion; sample several")
    sampling = np.mean(errors**2) * (1.0 - shared)
    return _roots(np.mean(betas**2), logs.var(ddof=1) - sampling)


def _roots(within: float, between: float) -> tuple[float, float]:
    return float(np.sqrt(max(within, 0.0))), float(np.sqrt(max(between, 0.0)))
