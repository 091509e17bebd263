"""Dispersion of capacity of a class of arches, its parts, and what its arches differ by.

One rule throughout, the law of total variance on ln capacity: with A the arch (a sample of what
is not known of it, or one of a fleet),

    var ln C = E[var(ln C | A)] + var(E[ln C | A]),

of which the first is beta_record_to_record^2 + beta_numerical^2, the latter being what time step
and tolerances of a run bring, and the second beta_model^2. What records do to some arches and not
to others (the interaction) belongs to the first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import positive, shaped


@dataclass(frozen=True)
class Dispersion:
    """Parts of the dispersion of ln capacity, each a standard deviation [1]."""

    theta: float  #: median capacity over arches and records, in the unit of the capacities
    beta_record_to_record: float  #: 0 where the estimated variance is negative; see `notes`
    beta_model: float  #: between arches; likewise
    beta_numerical: float  #: what a run's time step and tolerances bring, as given
    standard_errors: tuple[float, float]  #: of both, for normal ln capacities; nan where 0
    n_arch: int
    n_record: float  #: records of each arch
    notes: tuple[str, ...] = ()

    def combined(self) -> float:
        """Dispersion of a class of arches: record-to-record and modelling together."""
        return combine(self.beta_record_to_record, self.beta_model)

    @property
    def message(self) -> str:
        """How the parts combine."""
        return (
            f"beta_record_to_record = {self.beta_record_to_record:.3f} and beta_model = "
            f"{self.beta_model:.3f} combine to {self.combined():.3f} (root of the sum of squares)."
        )


def combine(*betas: float) -> float:
    """Dispersion of independent parts, each finite and >= 0: root of the sum of squares."""
    bad = [beta for beta in betas if not 0.0 <= beta < np.inf]
    if bad:
        raise InputError(f"a dispersion is {bad[0]:g}; it is a finite number from 0 upwards")
    return float(np.sqrt(sum(beta * beta for beta in betas)))


def split_capacities(capacity: ArrayLike, *, numerical: float = 0.0) -> Dispersion:
    """Divide the dispersion of capacities of sampled arches under records.

    Analysis of variance by moments with two factors, since all arches meet the same records and
    their means all have the scatter of the records (Searle, Casella and McCulloch 1992, *Variance
    Components*, chapters 3 and 4). For arches with records of their own see `split_curves`.

    Parameters
    ----------
    capacity : array_like, (n_arch, n_record)
        Capacity of each arch under each record, any unit, > 0; nan where not known. Records not
        known for all arches are left out.
    numerical : float
        Standard deviation of ln capacity of one run due to the numerical method, which is taken
        out of the record-to-record part.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if fewer than two arches, or two records of each, remain.

    Examples
    --------
    >>> from archfrag.fragility.dispersion import split_capacities
    >>> parts = split_capacities([[1.0, 2.0, 4.0], [2.0, 4.0, 8.0]])
    >>> round(parts.beta_record_to_record, 4), round(parts.beta_model, 4)
    (0.6931, 0.4901)
    """
    logs = np.log(positive(capacity, "capacities", unknown=True))
    if logs.ndim != 2 or logs.size == 0:
        raise InputError(f"capacities have shape {logs.shape}; (n_arch, n_record) is needed")
    notes, known = [], ~np.isnan(logs).any(axis=0)
    if not known.all():
        notes.append(f"{np.count_nonzero(~known)} records without all capacities are left out")
    logs = logs[:, known]
    a, r = logs.shape
    if a < 2 or r < 2:
        raise FitError(
            f"{a} arches with {r} records of known capacity remain; two of each are needed to "
            "separate modelling from records"
        )
    overall = logs.mean()
    arch, record = logs.mean(axis=1), logs.mean(axis=0)
    of_arch, of_record = r * float(arch.var(ddof=1)), a * float(record.var(ddof=1))
    residual = logs - arch[:, None] - record + overall
    interaction = float((residual**2).sum()) / ((a - 1) * (r - 1))
    # var(ln C | arch) is that of the records and of the interaction together.
    within = (of_record + (a - 1) * interaction) / a
    within_variance = 2.0 * (of_record**2 / (r - 1) + (a - 1) * interaction**2 / (r - 1)) / a**2
    model_variance = 2.0 * (of_arch**2 / (a - 1) + interaction**2 / ((a - 1) * (r - 1))) / r**2
    parts = (within, within_variance), ((of_arch - interaction) / r, model_variance)
    return _dispersion(float(np.exp(overall)), parts, (a, float(r)), notes, numerical)


def split_curves(
    theta: ArrayLike, beta: ArrayLike, standard_error: ArrayLike, *,
    shared: float = 0.0, n_record: int, numerical: float = 0.0,
) -> Dispersion:  # fmt: skip
    """Divide the dispersion from one fitted curve per arch.

    beta_model^2 is the variance of ln theta over the arches less the mean square of its standard
    errors (moments, as DerSimonian and Laird 1986, Control. Clin. Trials 7, with equal weights);
    beta_record_to_record^2 is the mean of beta^2.

    Parameters
    ----------
    theta, beta : array_like, (n_arch,)
        Of each arch's curve.
    standard_error : array_like, (n_arch,)
        Of ln theta.
    shared : float
        Correlation of the errors of ln theta between arches, 0 to below 1: near the correlation
        of their ln capacities where all meet the same records, 0 where each has its own.
    n_record : int
        Records of each arch, for the standard errors.
    numerical : float
        As in `split_capacities`.

    Raises
    ------
    InputError, FitError
        If an argument cannot be; if there are fewer than two arches.

    Examples
    --------
    >>> from archfrag.fragility.dispersion import split_curves
    >>> parts = split_curves([0.8, 1.25], [0.3, 0.3], [0.1, 0.1], n_record=10)
    >>> round(parts.beta_record_to_record, 4), round(parts.beta_model, 4)
    (0.3, 0.2993)
    """
    logs = np.log(positive(theta, "theta"))
    betas = shaped(positive(beta, "beta"), logs.shape, "beta")
    errors = shaped(positive(standard_error, "standard_error"), logs.shape, "standard_error")
    if not 0.0 <= shared < 1.0:
        raise InputError(f"shared is {shared:g}; a correlation from 0 to below 1 is needed")
    if n_record < 2:
        raise InputError(f"n_record is {n_record}; at least 2")
    n_arch = logs.size
    if n_arch < 2:
        raise FitError("one arch has no modelling dispersion; sample several")
    within, observed = float(np.mean(betas**2)), float(logs.var(ddof=1))
    sampling = float(np.mean(errors**2)) * (1.0 - shared)
    # With records of their own the arches' betas are independent estimates; with shared ones not.
    freedom = (n_record - 1) * (1.0 + (n_arch - 1) * (1.0 - shared))
    between = observed - sampling, 2.0 * observed**2 / (n_arch - 1)
    parts = (within, 2.0 * within**2 / freedom), between
    sizes = n_arch, float(n_record)
    return _dispersion(float(np.exp(logs.mean())), parts, sizes, [], numerical)


def _dispersion(
    theta: float, parts: Sequence[tuple[float, float]], sizes: tuple[int, float],
    notes: list[str], numerical: float,
) -> Dispersion:  # fmt: skip
    """Of the variances within and between arches, each with its own variance."""
    (within, error), modelling = parts
    parts = (within - combine(numerical) ** 2, error), modelling
    betas, errors = [], []
    for name, (square, variance) in zip(("record-to-record", "modelling"), parts, strict=True):
        if square <= 0.0:
            notes.append(
                f"the {name} variance is estimated as {square:.2g}, not above 0: the other parts "
                "explain all the scatter that was seen"
            )
        betas.append(float(np.sqrt(max(square, 0.0))))
        errors.append(float(np.sqrt(variance) / (2.0 * betas[-1])) if square > 0.0 else np.nan)
    return Dispersion(
        theta, betas[0], betas[1], float(numerical), (errors[0], errors[1]), *sizes, tuple(notes)
    )
