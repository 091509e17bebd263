"""Dispersion of capacity, divided into record-to-record, modelling and numerical parts.

One rule throughout, the law of total variance on ln capacity: with A the arch (a sample of what
is not known of it), R the record, and e what a run adds by its time step and tolerances,

    var ln C = E[var(ln C | A)] + var(E[ln C | A]),

of which the first is beta_record_to_record^2 + beta_numerical^2 and the second beta_model^2. What
records do to some arches and not to others (the interaction) belongs to the first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import FloatArray


@dataclass(frozen=True)
class Dispersion:
    """Parts of the dispersion of ln capacity, each a standard deviation [1].

    Attributes
    ----------
    theta : float
        Median capacity over arches and records, in the unit of the capacities.
    beta_record_to_record, beta_model, beta_numerical : float
        The parts; one whose estimated variance is negative is 0, and `notes` says so.
    standard_errors : (float, float)
        Of the first two, for normal ln capacities; nan where the part is 0.
    n_arch, n_record : int
        Arches, and records of each (the mean number if they differ).
    notes : tuple of str
    """

    theta: float
    beta_record_to_record: float
    beta_model: float
    beta_numerical: float
    standard_errors: tuple[float, float]
    n_arch: int
    n_record: float
    notes: tuple[str, ...] = ()

    def combined(self, *, numerical: bool = False) -> float:
        """Dispersion of a class of arches: record-to-record and modelling together.

        Parameters
        ----------
        numerical : bool
            Whether the numerical part is added, which gives the dispersion as simulated.
        """
        extra = self.beta_numerical if numerical else 0.0
        return combine(self.beta_record_to_record, self.beta_model, extra)

    @property
    def message(self) -> str:
        """The parts in one sentence."""
        return (
            f"beta_record_to_record = {self.beta_record_to_record:.3f} and beta_model = "
            f"{self.beta_model:.3f} combine to {self.combined():.3f} (root of the sum of "
            f"squares); the numerical part of {self.beta_numerical:.3f} is taken out."
        )


def combine(*betas: float) -> float:
    """Dispersion of independent parts: root of the sum of squares.

    Raises
    ------
    InputError
        If a part is negative or not a number.

    Examples
    --------
    >>> from archfrag.fragility.dispersion import combine
    >>> round(combine(0.3, 0.4), 12)
    0.5
    """
    bad = [beta for beta in betas if not 0.0 <= beta < np.inf]
    if bad:
        raise InputError(f"a dispersion is {bad[0]:g}; it is a finite number from 0 upwards")
    return float(np.sqrt(sum(beta * beta for beta in betas)))


def total_variance(
    log_theta: ArrayLike, beta: ArrayLike, weights: FloatArray | None = None
) -> tuple[float, float, float]:
    """Mean of ln capacity of a class, and its variances within and between the arches.

    The weights are taken as the whole class: the variance between has the divisor n, not n - 1,
    and holds the sampling error of the medians.

    Parameters
    ----------
    log_theta, beta, weights : array_like, (n_arch,)
        ln of each arch's median, its dispersion, and its weight; equal if not given.

    Examples
    --------
    >>> from archfrag.fragility.dispersion import total_variance
    >>> [round(part, 6) for part in total_variance([-0.4, 0.4], [0.3, 0.3])]
    [0.0, 0.09, 0.16]
    """
    logs, betas = np.asarray(log_theta, dtype=float), np.asarray(beta, dtype=float)
    centre = float(np.average(logs, weights=weights))
    within = float(np.average(betas**2, weights=weights))
    return centre, within, float(np.average((logs - centre) ** 2, weights=weights))


def split_capacities(
    capacity: ArrayLike, *, same_records: bool = True, numerical: float = 0.0
) -> Dispersion:
    """Divide the dispersion of capacities of sampled arches under records.

    Analysis of variance by moments (Searle, Casella and McCulloch 1992, *Variance Components*,
    chapters 3 and 4): of two ways if all arches meet the same records, for then the means of the
    arches share the scatter of the records; of one way if each arch has records of its own.

    Parameters
    ----------
    capacity : array_like, (n_arch, n_record)
        Capacity of each arch under each record, any unit, > 0; nan where not known. With
        `same_records`, columns are records, and records not known for all arches are left out.
    same_records : bool
        Whether column i is the same motion for all arches.
    numerical : float
        Standard deviation of ln capacity of one run due to the numerical method
        (`numerical_from_repeats`, `numerical_from_theta`).

    Raises
    ------
    InputError
        If an argument cannot be.
    FitError
        If fewer than two arches, or two records of each, remain.

    Examples
    --------
    >>> from archfrag.fragility.dispersion import split_capacities
    >>> parts = split_capacities([[1.0, 2.0, 4.0], [2.0, 4.0, 8.0]])
    >>> round(parts.beta_record_to_record, 4), round(parts.beta_model, 4)
    (0.6931, 0.4901)
    """
    logs = _logs(capacity)
    _check_numerical(numerical)
    notes = []
    if same_records:
        known = ~np.isnan(logs).any(axis=0)
        if not known.all():
            notes.append(f"{np.count_nonzero(~known)} records without all capacities are left out")
        logs = logs[:, known]
    else:
        logs = logs[np.count_nonzero(~np.isnan(logs), axis=1) >= 2]
    if len(logs) < 2 or logs.shape[1] < 2:
        raise FitError(
            f"{len(logs)} arches with {logs.shape[1]} records of known capacity remain; two of "
            "each are needed to tell modelling from records"
        )
    parts = _two_way(logs) if same_records else _one_way(logs)
    within, model, within_variance, model_variance, n_record = parts
    return _dispersion(
        (float(np.exp(np.nanmean(np.nanmean(logs, axis=1)))), within, model),
        (within_variance, model_variance), numerical, (len(logs), n_record), notes,
    )  # fmt: skip


def split_curves(
    theta: ArrayLike,
    beta: ArrayLike,
    standard_error: ArrayLike,
    *,
    shared: float = 0.0,
    n_record: int,
    numerical: float = 0.0,
) -> Dispersion:
    """Divide the dispersion from one fitted curve per arch.

    beta_model^2 is the variance of ln theta over the arches less the mean square of its standard
    errors (moments, as DerSimonian and Laird 1986, Control. Clin. Trials 7, with equal weights);
    beta_record_to_record^2 is the mean of beta^2 less the numerical part.

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
    InputError
        If an argument cannot be.
    FitError
        If there are fewer than two arches.
    """
    logs = _logs(np.asarray(theta, dtype=float)[None])[0]
    betas, errors = np.asarray(beta, dtype=float), np.asarray(standard_error, dtype=float)
    for name, values in (("beta", betas), ("standard_error", errors)):
        if values.shape != logs.shape or not np.all((values >= 0.0) & np.isfinite(values)):
            raise InputError(
                f"{name} needs one number from 0 upwards for each of {logs.size} arches"
            )
    if np.isnan(logs).any():
        raise InputError("theta holds nan; leave arches without a curve out")
    if not 0.0 <= shared < 1.0:
        raise InputError(f"shared is {shared:g}; a correlation from 0 to below 1 is needed")
    if n_record < 2:
        raise InputError(f"n_record is {n_record}; at least 2")
    _check_numerical(numerical)
    n_arch = logs.size
    if n_arch < 2:
        raise FitError("one arch has no modelling dispersion; sample several")
    centre, within, between = total_variance(logs, betas)
    observed = between * n_arch / (n_arch - 1)
    sampling = float(np.mean(errors**2)) * (1.0 - shared)
    # With records of their own the arches' betas are independent estimates; with shared ones not.
    freedom = (n_record - 1) * (1.0 + (n_arch - 1) * (1.0 - shared))
    return _dispersion(
        (float(np.exp(centre)), within, observed - sampling),
        (2.0 * within**2 / freedom, 2.0 * observed**2 / (n_arch - 1)),
        numerical, (n_arch, float(n_record)), [],
    )  # fmt: skip


def numerical_from_repeats(capacity: ArrayLike) -> float:
    """Standard deviation of ln capacity among repeats that differ numerically only.

    Parameters
    ----------
    capacity : array_like, (n_case, n_repeat)
        Capacities of the same arch and record with e.g. other time steps or tolerances, > 0;
        nan where not known.

    Raises
    ------
    InputError
        If no case has two repeats.

    Examples
    --------
    >>> from archfrag.fragility.dispersion import numerical_from_repeats
    >>> round(numerical_from_repeats([[0.50, 0.51], [0.80, 0.79]]), 4)
    0.0117
    """
    logs = _logs(capacity)
    count = np.count_nonzero(~np.isnan(logs), axis=1)
    logs = logs[count >= 2]
    if not len(logs):
        raise InputError("capacity has no row with two repeats")
    off = logs - np.nanmean(logs, axis=1, keepdims=True)
    return float(np.sqrt(np.nansum(off**2) / (count[count >= 2] - 1).sum()))


def numerical_from_theta(scatter: float, n_record: int) -> float:
    """Standard deviation of ln capacity of one run, from that of ln theta between repeats.

    A study's ln theta is a mean over its records, so the scatter of one is sqrt(n_record) times
    that of ln theta, if the numerical errors of different records are independent. A bias shared
    by all records is no scatter and is not part of it.

    Raises
    ------
    InputError
        If an argument cannot be.
    """
    _check_numerical(scatter)
    if n_record < 1:
        raise InputError(f"n_record is {n_record}; at least 1")
    return float(scatter * np.sqrt(n_record))


def _two_way(logs: FloatArray) -> tuple[float, float, float, float, float]:
    """Variances within and between arches that meet the same records, and their variances."""
    a, r = logs.shape
    arch, record, overall = logs.mean(axis=1), logs.mean(axis=0), logs.mean()
    of_arch = r * float(arch.var(ddof=1))
    of_record = a * float(record.var(ddof=1))
    residual = logs - arch[:, None] - record + overall
    interaction = float((residual**2).sum()) / ((a - 1) * (r - 1))
    # var(ln C | arch) is that of the records and of the interaction together.
    within = (of_record + (a - 1) * interaction) / a
    within_variance = 2.0 * (of_record**2 / (r - 1) + (a - 1) * interaction**2 / (r - 1)) / a**2
    model_variance = 2.0 * (of_arch**2 / (a - 1) + interaction**2 / ((a - 1) * (r - 1))) / r**2
    return within, (of_arch - interaction) / r, within_variance, model_variance, float(r)


def _one_way(logs: FloatArray) -> tuple[float, float, float, float, float]:
    """The same for arches with records of their own, whose number may differ."""
    known = ~np.isnan(logs)
    count = np.count_nonzero(known, axis=1).astype(float)
    a, total = len(logs), count.sum()
    mean = np.nansum(logs, axis=1) / count
    overall = np.nansum(logs) / total
    within = float(np.nansum((logs - mean[:, None]) ** 2) / (total - a))
    between = float(np.sum(count * (mean - overall) ** 2) / (a - 1))
    size = float((total - np.sum(count**2) / total) / (a - 1))
    within_variance = 2.0 * within**2 / (total - a)
    model_variance = (2.0 * between**2 / (a - 1) + within_variance) / size**2
    return within, (between - within) / size, within_variance, model_variance, float(total / a)


def _dispersion(
    values: tuple[float, float, float],
    variances: tuple[float, float],
    numerical: float,
    sizes: tuple[int, float],
    notes: list[str],
) -> Dispersion:
    theta, within, model = values
    parts, errors = [], []
    for name, square, variance in (
        ("record-to-record", within - numerical**2, variances[0]),
        ("modelling", model, variances[1]),
    ):
        if square <= 0.0:
            notes.append(
                f"the {name} variance is estimated as {square:.2g}, not above 0: the other parts "
                "explain all the scatter that was seen"
            )
        parts.append(float(np.sqrt(max(square, 0.0))))
        errors.append(float(np.sqrt(variance) / (2.0 * parts[-1])) if square > 0.0 else np.nan)
    return Dispersion(
        theta, parts[0], parts[1], float(numerical), (errors[0], errors[1]), *sizes, tuple(notes)
    )


def _logs(capacity: ArrayLike) -> FloatArray:
    values = np.asarray(capacity, dtype=float)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"capacities have shape {values.shape}; two axes are needed")
    bad = values[~np.isnan(values) & ~((values > 0.0) & np.isfinite(values))]
    if bad.size:
        raise InputError(
            f"capacities hold {bad[0]:g}; they are positive finite numbers, nan where not known"
        )
    return np.log(values)


def _check_numerical(numerical: float) -> None:
    if not 0.0 <= numerical < np.inf:
        raise InputError(f"the numerical scatter is {numerical:g}; a number from 0 upwards")
