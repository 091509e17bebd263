"""The fragility curve with its band and intervals; checks for all modules."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from archfrag.errors import InputError
from archfrag.files import Named
from archfrag.fragility.density import Density, FloatArray, Pair
from archfrag.fragility.density import Triple as Triple

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Table = Mapping[str, Any] | None
Ends = tuple[float, float]
_FIT = ("theta", "beta", "log_likelihood", "n_levels", "n_total", "kind")
_BAND = (
    "im",
    "lower",
    "upper",
    "confidence",
    "method",
    "assumptions",
    "n_independent",
    "n_non_monotone",
)
# Tables of a curve, plain and in SI units; those that were not asked for are None.
_TABLES = ("dispersion", "free", "measures", "cloud")


@dataclass(frozen=True, repr=False, eq=False)
class Curve:
    """Probability of collapse, or of a lighter limit state, against intensity.

    Call it with intensities >= 0 to get probabilities. Intensities are in the unit of the study,
    or of the data that the curve was fitted to.

    Attributes
    ----------
    name, state : str
        Arch or class of arches, and limit state.
    theta, beta : float
        Median capacity, and standard deviation of ln capacity; nan if there is no curve.
    reason : str
        Why there is no curve.
    theta_interval, beta_interval : (lower, upper)
        Intervals at `confidence`.
    measure, unit : str
        Intensity measure, and unit of intensities.

    Examples
    --------
    >>> import archfrag as af
    >>> curve = af.fit_ida([0.5, 0.7, 0.9, 1.3])
    >>> curve
    <Curve median 0.800 (90 %: 0.574–1.11), dispersion 0.40 (0.21–0.79)>
    >>> curve([0.4, 0.8]).round(3).tolist()
    [0.043, 0.5]
    >>> curve.quantile([0.1, 0.5]).round(3).tolist()
    [0.477, 0.8]
    """

    theta: float = np.nan
    beta: float = np.nan
    #: (2, 2), of (ln theta, beta): inverse of the observed information, or as `kind` implies
    covariance: FloatArray = field(default_factory=lambda: np.full((2, 2), np.nan))
    #: with binomial coefficients, or the density of ln capacity
    log_likelihood: float = np.nan
    n_levels: int = (
        0  #: levels, distinct observed capacities or ends of brackets that were used
    )
    n_total: int = 0  #: runs (stripes) or records that were used
    #: stripes, ida, ida_truncated, brackets, adjusted, posterior, mixture; empty without a curve
    kind: str = ""
    #: (n_arch, 2), theta and beta of each arch of a class; the curve is the mean of their curves
    members: FloatArray | None = None
    reason: str = ""
    likelihood: Curve | None = None  #: the curve by maximum likelihood, for comparison
    #: Intervals of theta and of beta by a posterior; without one they follow from `covariance`.
    intervals: tuple[Ends, Ends] | None = None
    #: Density of theta and beta by a posterior; for a class, by that of all its runs.
    density: Density | None = None
    im: Sequence[
        float
    ] = ()  #: intensities of the band up to 1.05 times the highest level
    lower: Sequence[float] = ()  #: ends of the band
    upper: Sequence[float] = ()
    confidence: float = 0.9  #: of band and intervals
    method: str = ""  #: of the band
    assumptions: str = ""  #: of the band
    n_independent: float = 0.0  #: effective number of records or runs
    n_non_monotone: int = 0  #: runs against the capacity of their record
    #: Limit states, from light to severe, fitted or not; for an arch collapse is the last.
    states: tuple[Curve, ...] = ()
    crossings: str = ""  #: text: whether curves of neighbouring states cross
    #: Runs without a verdict, and the curves if all of them collapse and if all survive.
    n_undecided: int = 0
    extremes: tuple[Curve, ...] = ()
    #: Isotonic curve, and test of the lognormal shape; in SI units, as all tables here.
    free: Table = None
    measures: Table = None  #: `compare_measures`
    cloud: Table = None  #: logistic regression
    dispersion: Table = None  #: parts of the dispersion of a class
    name: str = ""
    state: str = "collapse"
    meaning: str = ""  #: what the limit state means
    measure: str = ""
    unit: str = ""
    si: float = 1.0  #: value of `unit` in the SI unit of the measure
    levels: Sequence[float] = ()  #: levels of the study

    @property
    def fitted(self) -> bool:
        """Whether there is a curve."""
        return bool(self.kind)

    @property
    def parts(self) -> FloatArray:
        """theta and beta of the lognormal curves whose mean this curve is, (n, 2)."""
        if self.members is not None:
            return self.members
        return np.array([[self.theta, self.beta]])

    @property
    def standard_errors(self) -> FloatArray:
        """Standard errors of (ln theta, beta), (2,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> float:
        """Correlation of the estimates of ln theta and beta."""
        return float(self.covariance[0, 1] / np.prod(self.standard_errors))

    @property
    def theta_interval(self) -> Ends:
        """Interval of the median, by the posterior; without one it is normal in ln theta."""
        return self._intervals[0]

    @property
    def beta_interval(self) -> Ends:
        """Interval of the dispersion, by the posterior; without one it is normal in ln beta."""
        return self._intervals[1]

    @property
    def _intervals(self):
        """Return the intervals of theta and of beta.

        They are those of the posterior. Without one they are normal in ln theta and ln beta, from
        the standard errors.
        """
        if self.intervals:
            return self.intervals
        z = scipy.special.ndtri(tails(self.confidence)[1])
        values = np.array([self.theta, self.beta])
        reach = np.exp(z * self.standard_errors / [1.0, self.beta])
        return tuple(zip((values / reach).tolist(), (values * reach).tolist()))

    def probability(self, im: ArrayLike):
        """Return probabilities at intensities >= 0 (else InputError), of the same shape."""
        theta, beta = self.parts.T
        deviation = (log_intensity(im)[..., None] - np.log(theta)) / beta
        return scipy.special.ndtr(deviation).mean(axis=-1)

    __call__ = probability

    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Return the intensities at which the curve has given probabilities, of the same shape.

        InputError unless all probabilities lie between 0 and 1.
        """
        p = np.asarray(probability, float)
        if not np.all((p > 0.0) & (p < 1.0)):
            raise InputError(f"quantile: {p.tolist()} must lie between 0 and 1")
        theta, beta = self.parts.T
        if len(theta) == 1:
            return np.asarray(theta[0] * np.exp(beta[0] * scipy.special.ndtri(p)))

        def root(one: float) -> float:
            ends = np.log(theta) + beta * scipy.special.ndtri(one)
            low = ends.min() - 1e-9
            high = ends.max() + 1e-9
            x = scipy.optimize.brentq(lambda x: self(np.exp(x)) - one, low, high)
            return float(np.exp(x))

        return np.vectorize(root, otypes=[float])(p)

    def band(self, im: ArrayLike) -> Pair:
        """Return the lower and the upper end of the pointwise band at intensities `im`.

        Both have the shape of `im`. The band is that of the posterior; without one it is by the
        delta method. Up to the highest point that was computed it is interpolated, as it is drawn.
        """
        at = np.asarray(im, float)
        ends = self._pointwise(at)
        if self.im:  # as it is drawn, by its points
            points = [np.interp(at, self.im, end) for end in (self.lower, self.upper)]
            ends = np.where(at <= self.im[-1], points, ends)
        return ends[0], ends[1]

    def _pointwise(self, im: FloatArray):
        """Return the band of the posterior; without one the band by the delta method."""
        if self.density is not None:
            return credible_band(self.density, im, self.confidence)
        quantile = scipy.special.ndtri(tails(self.confidence)[1])
        z = (log_intensity(im) - np.log(self.theta)) / self.beta
        # var z = g C g with g = -(1, z) / beta.
        (var_theta, cov), (_, var_beta) = self.covariance
        with np.errstate(invalid="ignore"):
            variance = var_theta + 2.0 * cov * z + var_beta * z * z
            reach = quantile * np.sqrt(variance) / self.beta
            ends = scipy.special.ndtr([z - reach, z + reach])
        return np.where(np.isneginf(z), 0.0, ends)

    def draws(self, seed: int, number: int = 4000) -> Pair:
        """Draw theta and beta, (number,) each, from the posterior.

        If the curve was moved, or is that of a class, the draws are scaled so that their medians
        are its theta and beta. Without a posterior, ln theta and ln beta are normal with the
        covariance.
        """
        if self.density is not None:
            log_theta, beta = self.density.draws(seed, number)
            theta = np.exp(log_theta - self.density.log_thetas(0.5))
            return self.theta * theta, self.beta * beta / self.density.betas([0.5])
        jacobian = np.diag([1.0, 1.0 / self.beta])
        covariance = jacobian @ self.covariance @ jacobian
        generator = np.random.default_rng(seed)
        shift = generator.multivariate_normal(
            np.zeros(2), covariance, number, method="eigh"
        )
        return self.theta * np.exp(shift[:, 0]), self.beta * np.exp(shift[:, 1])

    def at(self, im: float) -> tuple[float, float, float]:
        """Return the probability at an intensity, and the ends of the band there.

        InputError if there is no curve.
        """
        if not self.fitted:
            raise InputError(self.reason)
        low, high = self.band(im)
        return float(self(im)), float(low), float(high)

    @property
    def limit_states(self) -> dict[str, Curve]:
        """Curves of all limit states that the runs show, the lightest first and collapse last."""
        lighter = (each for each in self.states if each.state != self.state)
        states = {each.state: each for each in lighter if each.fitted}
        return states | {self.state: self}

    def update(self, observed: Any, **given) -> Curve:
        """Return the curve after damage that was seen, with the curves of states that it names.

        Warnings say if damage and curve contradict, or if it is still the curve of before.

        Parameters
        ----------
        observed : path or table
            A row for each arch. `state`: survived, collapsed, or the limit state it reached (name
            or number). `median` in the unit of the curve; `tau` and `phi`, standard deviations of
            ln intensity between and within earthquakes, or `sd`, all of it. `lon` and `lat`
            [degrees] and `event` if there are several. Without places phi is each arch's own.
        beta_model : float, optional
            Part of beta that differs from arch to arch; of a class it is known.
        stations : path or table, optional
            `lon`, `lat`, `median`, `tau`, `phi`, `event`, and what was `observed`.
        shakemap : sequence of path, optional
            ``grid.xml`` and ``uncertainty.xml`` instead of median and sd.
        length : float, optional
            Distance at which intensities correlate by exp(-3) [km]; known for PGA and Sa.
        share : float, optional
            Part of sd^2 that an earthquake's places have in common.

        Examples
        --------
        >>> import archfrag as af
        >>> curve = af.fit_ida([0.3, 0.35, 0.45, 0.6])
        >>> seen = {"state": ["collapsed"] * 8 + ["survived"] * 2, "median": 0.3}
        >>> curve.update(seen | {"tau": 0.4, "phi": 0.0}, beta_model=0.2).theta < curve.theta
        True
        """
        # By name, as that module needs this one.
        update: Curve = import_module("archfrag.fragility.update").updated(
            self, observed, **given
        )
        return update

    def in_unit(self, si: float, measure: str, unit: str) -> Curve:
        """Return the curve in another unit, with all curves that it holds.

        `si` is the value of the unit in the SI unit of `measure`. Curves are fitted and stored in
        SI units, and this is the one place where their unit changes: whoever shows or writes a
        curve in another unit calls it once. Tables of a curve stay in SI units.
        """

        def moved(curves: tuple[Curve, ...]) -> tuple[Curve, ...]:
            return tuple(each.in_unit(si, measure, unit) for each in curves)

        intervals = self.intervals
        if intervals is not None:
            (low, high), beta = intervals
            intervals = (low / si, high / si), beta
        return replace(
            self,
            theta=self.theta / si,
            members=None if self.members is None else self.members / [si, 1.0],
            intervals=intervals,
            si=si,
            density=self.density and self.density.moved(-np.log(si)),
            likelihood=self.likelihood and self.likelihood.in_unit(si, measure, unit),
            states=moved(self.states),
            extremes=moved(self.extremes),
            im=[each / si for each in self.im],
            measure=measure,
            unit=unit,
        )

    def to_dataframe(self, im: ArrayLike | None = None) -> pd.DataFrame:
        """Tabulate intensities, (n,), with the probability and the ends of the band at each.

        If `im` is not given, the intensities are the levels of the study; InputError if the curve
        has none.
        """
        import pandas as pd  # which takes a third of a second

        if im is None and not self.levels:
            raise InputError(
                "im must be given: intensities at which the curve is wanted"
            )
        at = np.asarray(self.levels if im is None else im, float)
        heads = self._axis(), "probability", "lower", "upper"
        return pd.DataFrame(dict(zip(heads, (at, self(at), *self.band(at)))))

    def plot(self, ax: Axes | None = None, **style) -> Axes:
        """Draw the curve with its band on axes of matplotlib, new ones if none are given.

        `style` is handed to the line, such as color or label.
        """
        ax = plots().axes_of(ax)
        end = self.im[-1] if self.im else float(self.quantile(0.99))
        im = np.linspace(0.0, end, 200)
        (line,) = ax.plot(im, self(im), **{"label": self.name, **style})
        ax.fill_between(
            im, *self.band(im), color=line.get_color(), alpha=0.2, linewidth=0.0
        )
        ax.set(xlabel=self._axis(), ylabel=f"probability of {self.state}")
        ax.set(xlim=(0.0, end), ylim=(0, 1))
        return ax

    def _axis(self) -> str:
        return f"{self.measure} [{self.unit}]" if self.measure else "intensity"

    def words(self) -> tuple[str, str]:
        """Return median and dispersion, each with its interval, as two texts.

        If there is no curve, the first text says why and the second is empty.
        """
        if not self.fitted:
            return f"no curve: {self.reason}", ""
        values = (self.theta, *self.theta_interval)
        theta, low, high = (f"{v:.0f}" if v > 100.0 else f"{v:#.3g}" for v in values)
        beta, low_beta, high_beta = self.dispersion_words()
        median = " ".join(filter(None, ("median", theta, self.unit, self.measure)))
        dispersion = f"dispersion {beta} ({low_beta}–{high_beta})"
        return f"{median} ({100 * self.confidence:g} %: {low}–{high})", dispersion

    def dispersion_words(self) -> list[str]:
        """Return the dispersion and the ends of its interval as texts, none of which reads 0."""
        values = self.beta, *self.beta_interval
        return [
            f"{value:.2f}" if value >= 0.005 else f"{value:.1g}" for value in values
        ]

    def undecided(self, text: Callable[[float], str] | None = None) -> str:
        """Return a text on what the runs without a verdict could change; empty if there are none.

        `text` makes a text with the unit from a median.
        """
        if not self.n_undecided:
            return ""
        text = text or (lambda theta: f"{theta:.4g} {self.unit}")
        low, high = (
            text(curve.theta) if curve.fitted else "not known"
            for curve in self.extremes
        )
        n = self.n_undecided
        runs = "1 run has" if n == 1 else f"{n} runs have"
        return f"{runs} no verdict: the median is {low} if all collapse, {high} if all survive"

    def __repr__(self) -> str:
        shown = self.name, self.state * (self.state != "collapse")
        name = ", ".join(filter(None, shown))
        words = ", ".join(filter(None, self.words()))
        lost = self.undecided()
        return f"<Curve {name}{': ' * bool(name)}{words}{'; ' * bool(lost)}{lost}>"

    def _repr_html_(self) -> str:
        return str(plots().html_of(self))

    def fit_dict(self) -> Named:
        """Return theta, beta and how they were fitted as plain values.

        If there is no curve, the only entry is ``none``, the reason.
        """
        if not self.fitted:
            return {"none": self.reason}
        plain = {name: getattr(self, name) for name in _FIT}
        plain["covariance_ln_theta_beta"] = self.covariance.tolist()
        if self.members is not None:
            plain["members"] = self.members.tolist()
        return plain

    def to_dict(self) -> Named:
        """Return the curve, which must be in SI units, as plain values for JSON."""
        more = {name: getattr(self, name) for name in _TABLES}
        if self.crossings:
            states = [each._state_dict() for each in self.states]
            more["limit_states"] = {"message": self.crossings, "states": states}
        more["without_verdict"] = {}
        if self.extremes:
            collapsed, survived = (each.fit_dict() for each in self.extremes)
            ends = {"collapsed": collapsed, "survived": survived}
            more["without_verdict"] = {"runs": self.n_undecided} | ends
        found = {name: part for name, part in more.items() if part is not None}
        return self._plain() | {"more": found}

    def _state_dict(self) -> Named:
        """Return the curve of a limit state as plain values."""
        plain = self._plain() if self.fitted else {"curve": self.fit_dict()}
        return {"name": self.state, "meaning": self.meaning, **plain}

    def _plain(self) -> Named:
        """Return curve, band and intervals as plain values."""
        likelihood = self.likelihood or Curve()
        theta, beta = self.intervals or [(np.nan, np.nan)] * 2
        return {
            "curve": self.fit_dict(),
            "likelihood": likelihood.fit_dict(),
            "theta": theta,
            "beta": beta,
            "density": self.density and self.density.to_plain(),
            **{name: getattr(self, name) for name in _BAND},
        }

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any], name: str = "") -> Curve:
        """Return the curve from the values of `to_dict`, or from a part of them.

        `name` is that of its arch or class.
        """
        found = {**plain, **plain.get("more", {})}
        fit = found["curve"]
        own = {key: found[key] for key in (*_BAND, *_TABLES) if key in found}
        if "none" in fit:
            own["reason"] = fit["none"]
        else:
            own |= {key: fit[key] for key in _FIT}
            own["covariance"] = np.array(fit["covariance_ln_theta_beta"])
        if "members" in fit:
            own["members"] = np.array(fit["members"])
        if "likelihood" in plain:
            own["likelihood"] = cls.from_dict({"curve": plain["likelihood"]})
        if plain.get("density"):
            own["density"] = Density.from_plain(plain["density"])
        theta, beta = (plain.get(key) or (None,) for key in ("theta", "beta"))
        if None not in theta:
            own["intervals"] = tuple(theta), tuple(beta)
        if "limit_states" in found:
            known = found["limit_states"]
            own["crossings"] = known["message"]
            own["states"] = tuple(cls.from_dict(each, name) for each in known["states"])
        lost = found.get("without_verdict")
        if lost:
            own["n_undecided"] = lost["runs"]
            ends = (lost[key] for key in ("collapsed", "survived"))
            own["extremes"] = tuple(cls.from_dict({"curve": each}) for each in ends)
        return cls(
            **own,
            name=name,
            state=plain.get("name", "collapse"),
            meaning=plain.get("meaning", ""),
        )


def plots():
    """Import and return `archfrag.plots`."""
    import archfrag.plots  # matplotlib takes half a second

    return archfrag.plots


def credible_band(density: Density, im: ArrayLike, confidence: float) -> Pair:
    """Return central credible intervals of the probability at intensities >= 0 of any shape."""
    logs = log_intensity(im)
    level = np.array(tails(confidence)).reshape(2, *[1] * logs.ndim)
    z = density.deviations(np.where(np.isfinite(logs), logs, 0.0), level)
    lower, upper = np.where(np.isfinite(logs), scipy.special.ndtr(z), logs > 0.0)
    return lower[()], upper[()]


def log_intensity(im: ArrayLike) -> FloatArray:
    """Return ln of intensities, -inf at 0; InputError if one is < 0."""
    im = np.asarray(im, float)
    bad = im[~(im >= 0.0)]
    if bad.size:
        raise InputError(
            f"im holds {bad[0]:g}; an intensity is a number from 0 upwards"
        )
    with np.errstate(divide="ignore"):
        return np.log(im)


def positive(values: ArrayLike, name: str) -> FloatArray:
    """Return values as floats; InputError unless all are > 0 and finite."""
    given = np.asarray(values, float)
    bad = given[~((given > 0.0) & np.isfinite(given))]
    if bad.size:
        raise InputError(
            f"{name} holds {bad[0]:g}; only positive finite numbers are allowed"
        )
    return given


def rising(values: ArrayLike, name: str) -> FloatArray:
    """Return positive finite numbers as floats; InputError unless they increase."""
    given = positive(values, name)
    for i in np.flatnonzero(np.diff(given) <= 0.0)[:1]:
        raise InputError(
            f"{name} has {given[i + 1]:g} after {given[i]:g}; it must increase"
        )
    return given


def tails(confidence: float) -> list[float]:
    """Return the probabilities below the lower and the upper end of a central interval.

    InputError unless `confidence`, that of the interval, lies between 0 and 1.
    """
    if not isinstance(confidence, Real) or not 0.0 < confidence < 1.0:
        raise InputError(
            f"confidence is {confidence!r}; it lies between 0 and 1, such as 0.9"
        )
    return [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]
