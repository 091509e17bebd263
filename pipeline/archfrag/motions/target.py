"""Target spectra for selecting records, from the ground-motion models of pygmm."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from archfrag.errors import InputError, from_extra
from archfrag.motions.channel import Samples

Rupture = tuple[
    float, float, float
]  # moment magnitude, closest distance [km], Vs30 [m/s]
MODELS = {
    "ASK14": "AbrahamsonSilvaKamai2014",
    "BSSA14": "BooreStewartSeyhanAtkinson2014",
    "CB14": "CampbellBozorgnia2014",
    "CY14": "ChiouYoungs2014",
    "I14": "Idriss2014",
    "ASB14": "AkkarSandikkayaBommer2014",
}
PERIODS = tuple(float(f"{period:.3g}") for period in np.geomspace(0.05, 5.0, 20))
SAME = 1e-6  # relative difference of periods that are the same
_WORDS = {"mag": "magnitude", "dist_rup": "distance [km]", "v_s30": "Vs30 [m/s]"}


def predict(
    rupture: Rupture, model: str, periods: ArrayLike
) -> tuple[Samples, Samples, tuple[str, ...]]:
    """Return ln of the median Sa [ln g], the standard deviation of ln Sa, and messages.

    Both rows have shape (n_period,); messages name each argument for which the model is not
    recommended.
    The fault is vertical, of strike-slip, and reaches as deep as Chiou and Youngs (2014) expect.
    `model` is ``ASK14``, ``BSSA14``, ``CB14``, ``CY14``, ``I14`` (Earthquake Spectra 30(3), 2014;
    these give RotD50) or ``ASB14`` (Akkar, Sandikkaya and Bommer 2014, Bull. Earthquake Eng. 12;
    the geometric mean of two components); a single component varies somewhat more. Damping is
    5 %. InputError if the model is unknown, a number is not positive, or a period [s] is outside
    the model's.
    """
    if model not in MODELS:
        raise InputError(
            f"ground-motion model {model!r} must be one of {', '.join(MODELS)}"
        )
    magnitude, distance, vs30 = rupture
    if not all(0.0 < value < np.inf for value in rupture):
        raise InputError(
            f"magnitude, distance and Vs30 {rupture} must be numbers above 0"
        )
    # Chiou and Youngs (2014), Eq 5: mean depth to the top.
    top = min(max(2.673 - 1.136 * max(magnitude - 4.970, 0.0), 0.0) ** 2, distance)
    surface = float(np.sqrt(distance**2 - top**2))
    facts = {
        "mag": magnitude,
        "dist_rup": distance,
        "dist_jb": surface,
        "dist_x": -surface,
        "v_s30": vs30,
        "dip": 90.0,
        "depth_tor": top,
        "mechanism": "SS",
        "on_hanging_wall": False,
    }
    pygmm = from_extra("pygmm", "select")
    kind = getattr(pygmm, MODELS[model])
    messages = []
    known = {}
    for parameter in [each for each in kind.PARAMS if each.name in facts]:
        name = parameter.name
        known[name] = value = facts[name]
        low, high = (getattr(parameter, end, None) for end in ("min", "max"))
        if (low is not None and value < low) or (high is not None and value > high):
            messages.append(
                f"{model} is recommended for {_WORDS.get(name, name)} {low or 0} to "
                f"{high or 'any'}, not {value:g}"
            )
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # in whose place are the messages
        prediction = kind(pygmm.Scenario(**known))
    ends = prediction.periods.min(), prediction.periods.max()
    asked = np.atleast_1d(np.asarray(periods, dtype=float))
    # A period of the table's end may differ from the one typed by rounding.
    _check_within(
        asked, ends[0] * (1 - 1e-9), ends[1] * (1 + 1e-9), f"of the model {model}"
    )
    inside = np.clip(asked, *ends)
    ln_median = prediction.interp_ln_spec_accels(inside)
    return ln_median, prediction.interp_ln_stds(inside), tuple(messages)


def correlation(first: ArrayLike, second: ArrayLike) -> Samples:
    """Return the correlation of ln Sa between periods [s], about a model's median.

    The periods `first` and `second` are broadcast against each other.
    Baker and Jayaram (2008), Earthquake Spectra 24(1), 299-317, as pygmm computes it; InputError
    for a period outside 0.01 to 10 s, where it was fitted.
    """
    both = [np.asarray(periods, float) for periods in (first, second)]
    for periods in both:
        _check_within(
            periods, 0.01, 10.0, "of the correlations of Baker and Jayaram (2008)"
        )
    pygmm = from_extra("pygmm.baker_jayaram_2008", "select")
    return np.asarray(pygmm.calc_correls(*both), float)


def _check_within(periods: Samples, low: float, high: float, what: str) -> None:
    outside = periods[~((periods >= low) & (periods <= high))]
    if outside.size:
        raise InputError(
            f"period {outside[0]:g} s is outside {low:g} to {high:g} s {what}"
        )


@dataclass(frozen=True, eq=False)
class Target:
    """Distribution of ln Sa [ln g] that selected records are to have."""

    periods: Samples  # rising, (n_period,) [s]
    ln_mean: Samples
    covariance: Samples  # (n_period, n_period), zero for a spectrum that is a mean only
    conditioning: float | None = (
        None  # period [s] at which Sa is given: every record is scaled to it
    )
    messages: tuple[str, ...] = ()  # what users of the target should know

    @property
    def median(self) -> Samples:
        """exp of the mean of ln Sa, shape (n_period,) [g]."""
        return np.exp(self.ln_mean)

    @property
    def sd(self) -> Samples:
        """Standard deviation of ln Sa, shape (n_period,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def given(self) -> int | None:
        """Index of the conditioning period; None without one."""
        if self.conditioning is None:
            return None
        return int(np.abs(np.log(self.periods / self.conditioning)).argmin())


def conditional_spectrum(
    rupture: Rupture,
    level: float,
    conditioning: float,
    periods: ArrayLike = PERIODS,
    model: str = "CY14",
) -> Target:
    """Return mean and covariance of ln Sa, given Sa at one period.

    With median exp(mu), standard deviation sigma and correlation rho, and epsilon =
    (ln level - mu*) / sigma* at the conditioning period T*:

    mean_i = mu_i + rho_i* epsilon sigma_i
    covariance_ij = sigma_i sigma_j (rho_ij - rho_i* rho_j*)

    Baker (2011), J. Struct. Eng. 137(3); Jayaram, Lin and Baker (2011), Earthquake Spectra 27(3).
    `level` is Sa at T* [g], `conditioning` is T* [s], added to the `periods` [s] if need be.
    InputError if a number is not positive, or a period is out of range or there twice.
    """
    if not 0.0 < level < np.inf or not 0.0 < conditioning < np.inf:
        raise InputError(
            f"level = {level} g of Sa({conditioning} s): both must be above 0"
        )
    grid = _rising(periods, "periods")
    others = grid[np.abs(np.log(grid / conditioning)) >= SAME]
    star = int(np.searchsorted(others, conditioning))
    grid = np.insert(others, star, conditioning)
    rho = correlation(grid[:, None], grid)
    median, sd, messages = predict(rupture, model, grid)
    mean = median + rho[star] * (np.log(level) - median[star]) / sd[star] * sd
    covariance = np.outer(sd, sd) * (rho - np.outer(rho[star], rho[star]))
    covariance[star, :] = covariance[:, star] = 0.0
    mean[star] = np.log(level)
    return Target(grid, mean, covariance, float(conditioning), messages)


def scenario_target(
    rupture: Rupture,
    period: float,
    level: tuple[float | None, float | None],
    measured: Sequence[float],
    model: str,
) -> Target:
    """Return the conditional spectrum of a scenario at the measured periods nearest ``PERIODS``.

    `period` is the conditioning period [s]. `level` is (Sa there [g], None), or (None, number of
    standard deviations above its median). `measured` are the periods of a flatfile [s]: between
    them the scatter of spectra would be lost.
    """
    sa, epsilon = level
    if sa is None:
        ln_median, sd, _ = predict(rupture, model, [period])
        sa = float(np.exp(ln_median[0] + epsilon * sd[0]))
    near = {
        min(measured, key=lambda have: abs(np.log(have / t)), default=t)
        for t in PERIODS
    }
    return conditional_spectrum(rupture, sa, period, sorted(near), model)


def spectrum_target(
    periods: Samples, median: Samples, sd: Samples, source: str
) -> Target:
    """Return a target from a spectrum [g] at periods [s], of a code or of uniform hazard.

    `median` is exp of the mean of ln Sa, `sd` its standard deviation, (n_period,) each. If `sd`
    is 0 at one period, this is the conditioning period. If it is 0 at all, the target is a
    mean, to which records are to be close. InputError, beginning with `source`, for numbers that
    are not finite, medians not above 0, or zeros of `sd` at several periods but not at all.
    """
    rising = _rising(periods, f"{source}: periods")
    for name, row, low in (("median Sa", median, median <= 0.0), ("sd", sd, sd < 0.0)):
        if not np.isfinite(row).all() or low.any():
            raise InputError(
                f"{source}: {name} {row.tolist()} needs {row.size} finite numbers above 0 (sd may "
                "be 0)"
            )
    order = np.argsort(periods)
    ln_sa = np.log(median[order])
    sd = sd[order]
    zero = np.flatnonzero(sd == 0.0)
    if zero.size == sd.size:
        return Target(rising, ln_sa, np.zeros((sd.size, sd.size)))
    if zero.size > 1:
        raise InputError(
            f"{source}: sd is 0 at {zero.size} periods; it may be at one, which then is the "
            "conditioning period, or at all"
        )
    rho = correlation(rising[:, None], rising)
    for star in rho[zero]:
        rest = np.sqrt(np.where(star < 1.0, 1.0 - star**2, 1.0))
        rho = (rho - np.outer(star, star)) / np.outer(rest, rest)
        np.fill_diagonal(rho, 1.0)
    conditioning = next(iter(rising[zero].tolist()), None)
    return Target(rising, ln_sa, np.outer(sd, sd) * rho, conditioning)


def _rising(periods: ArrayLike, name: str) -> Samples:
    values = np.sort(np.asarray(periods, float).ravel())
    if not (values.size and np.isfinite(values).all() and values[0] > 0.0):
        raise InputError(
            f"{name} {values.tolist()} must be positive numbers of seconds"
        )
    twice = np.flatnonzero(np.diff(np.log(values)) < SAME)
    if twice.size:
        raise InputError(f"{name}: {values[twice[0]]:g} s is there twice")
    return values
