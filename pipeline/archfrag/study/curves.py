"""What follows from the runs of a cube for each arch and of each class: curves and their bands."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import FitError, InputError
from archfrag.fragility.bands import beta_interval, confidence_band, theta_interval
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.control_variates import estimate_two_fidelity
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray, Fragility, mixture
from archfrag.fragility.fit import fit_brackets, fit_stripes
from archfrag.fragility.quoted import quoted_band, shared_events
from archfrag.study.design import GRIDS

if TYPE_CHECKING:
    import xarray as xr

POINTS = 120  # of a band


@dataclass(frozen=True)
class Runs:
    """Runs of one arch, or of all arches of a class under each other."""

    name: str
    design: str
    verdict: NDArray[np.int64]  # (n_record, n_level)
    level: FloatArray  # (n_level,): [SI]
    factor: FloatArray  # (n_record, n_level): on the record
    # (n_record,): what rows have in common: an earthquake, or for a class the record.
    group: NDArray[np.str_] | None = None
    unit: str = "event"  # which of the two
    # (n_record, n_level): verdicts by the coarse method of a design in two stages.
    coarse: NDArray[np.int64] | None = None
    # (n_record,): numbers of the records in the cube.
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, int))

    @property
    def decided(self) -> NDArray[np.bool_]:
        """Runs that collapsed or stood."""
        return (self.verdict == Verdict.COLLAPSED) | (self.verdict == Verdict.STANDING)


@dataclass(frozen=True)
class Answer:
    """Curve of an arch or a class, how well it is known, and what else follows from its runs."""

    curve: Fragility | str  # theta in the SI unit of the measure; or why there is none
    likelihood: Fragility | str  # by maximum likelihood, for comparison
    theta: tuple[float, float] = (np.nan, np.nan)  # interval
    beta: tuple[float, float] = (np.nan, np.nan)  # interval
    im: list[float] = field(default_factory=list)  # of the band [SI]
    lower: list[float] = field(default_factory=list)  # band of the probability of collapse
    upper: list[float] = field(default_factory=list)
    confidence: float = 0.9
    method: str = ""  # of the band
    assumptions: str = ""  # of the band
    n_independent: float = 0.0  # records or runs that the data are worth
    n_islands: int = 0  # runs against the capacity of their record
    more: dict[str, Any] = field(default_factory=dict)  # further results by name, plain values

    def probability(self, im: float) -> tuple[float, float, float]:
        """Probability of collapse at an intensity, and its band; refused without a curve."""
        if isinstance(self.curve, str):
            raise InputError(self.curve)
        low, high = (float(np.interp(im, self.im, side)) for side in (self.lower, self.upper))
        return float(self.curve.probability(im)), low, high

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__}
        for name in ("curve", "likelihood"):
            plain[name] = curve_to_dict(plain[name])
        return plain

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> "Answer":
        """Inverse of `to_dict`."""
        given = dict(plain)
        for name in ("curve", "likelihood"):
            given[name] = curve_of_dict(given[name])
        for name in ("theta", "beta"):
            low, high = (np.nan if end is None else float(end) for end in given[name])
            given[name] = (low, high)
        return cls(**given)


def curve_to_dict(curve: Fragility | str) -> dict[str, Any]:
    """A curve, or why there is none, as plain values."""
    return {"none": curve} if isinstance(curve, str) else curve.to_dict()


def curve_of_dict(plain: Mapping[str, Any]) -> Fragility | str:
    """Inverse of `curve_to_dict`."""
    return str(plain["none"]) if "none" in plain else Fragility.from_dict(dict(plain))


def runs_of_cube(cube: "xr.Dataset") -> list[Runs]:
    """Runs of each arch of a cube."""
    design = str(cube.attrs["archfrag_design_kind"])
    verdict = cube["verdict"].transpose("arch", "record", "level").values.astype(np.int64)
    group = shared_events(cube["event"].values)
    both = "coarse_verdict" in cube
    coarse = cube["coarse_verdict" if both else "verdict"].transpose("arch", "record", "level")
    found = []
    for i, name in enumerate(cube["arch"].values.astype(str)):
        one = cube.isel(arch=i)
        level, factor = one["intensity"].values, one["scale_factor"].values
        other = coarse.values[i].astype(np.int64)
        made = (verdict[i] != Verdict.NOT_SIMULATED) | (other != Verdict.NOT_SIMULATED)
        rows = np.flatnonzero(made.any(axis=1))
        if level.ndim == 2:
            level = level[rows]
        found.append(
            Runs(str(name), design, verdict[i][rows], level, factor[rows],
                 None if group is None else group[rows],
                 coarse=other[rows] if both else None, rows=rows)
        )  # fmt: skip
    return found


def classes_of_cube(cube: "xr.Dataset", runs: Sequence[Runs]) -> dict[str, tuple[Runs, list[int]]]:
    """Runs of the arches of each class together, and their places; classes of several arches."""
    names = cube["arch_class"].values.astype(str)
    record = cube["record"].values.astype(str)
    found = {}
    for name in dict.fromkeys(names.tolist()):
        members = np.flatnonzero(names == name).tolist()
        if len(members) < 2:
            continue
        own = [runs[int(i)] for i in members]
        group = [record[each.rows] for each in own]
        level = own[0].level
        if level.ndim == 2:
            level = np.concatenate([each.level for each in own])
        together = Runs(
            name, own[0].design, np.concatenate([each.verdict for each in own]), level,
            np.concatenate([each.factor for each in own]), np.concatenate(group), "record",
        )  # fmt: skip
        found[name] = together, members
    return found


def answer(runs: Runs, confidence: float, worded: Callable[[FitError], str] = str) -> Answer:
    """Curve of some runs with the band and the intervals that are quoted.

    `worded` gives the text of an error, with its levels in the unit that people read.
    """
    likelihood = likeliest(runs, worded)
    im = np.linspace(0.0, 1.05 * float(np.nanmax(runs.level)), POINTS)
    try:
        if len(runs.verdict) < 2:
            raise FitError("there is only one record, from which no curve follows")
        if runs.design in GRIDS:
            quoted = quoted_band(
                runs.design, runs.verdict, runs.level, im, confidence=confidence,
                groups=runs.group, unit=runs.unit,
            )  # fmt: skip
        else:
            decided = runs.decided
            quoted = quoted_band(
                "scattered", runs.verdict[decided], runs.level[decided], im, confidence=confidence
            )
        helped = two_fidelities(runs, im, confidence)
        if helped is not None:
            return replace(helped, likelihood=likelihood)
    except FitError as error:
        return Answer(worded(error), likelihood, confidence=confidence)
    return Answer(
        quoted.curve, likelihood, quoted.theta, quoted.beta,
        im.tolist(), quoted.band.lower.tolist(), quoted.band.upper.tolist(), confidence,
        quoted.method, quoted.assumptions, quoted.n_independent, quoted.n_islands,
    )  # fmt: skip


def arch_classes(cube: "xr.Dataset") -> dict[str, str]:
    """Class of each arch of a cube; its own name where the cube holds none."""
    names = [str(name) for name in cube["arch"].values]
    own = [str(name) for name in cube["arch_class"].values] if "arch_class" in cube else names
    return dict(zip(names, own, strict=True))


def quoted(
    cube: "xr.Dataset", answers: Mapping[str, Answer], classes: Mapping[str, Answer],
    members: bool = False,
) -> dict[str, Answer]:  # fmt: skip
    """Answers that are handed on: of classes, and of arches that are of none.

    With `members` those of the arches of classes too.
    """
    of_class = arch_classes(cube)
    alone = {k: a for k, a in answers.items() if members or of_class.get(k) not in classes}
    return {**classes, **alone}


def of_class(pooled: Answer, members: Sequence[Answer]) -> Answer:
    """Answer of a class, from that of all its runs together and those of its arches.

    Its curve is the mean of those of its arches; if one of these has none, the lognormal curve of
    all runs. Band and intervals are of the latter. The class has no other curve, and one beta.
    """
    fits = [each.curve for each in members if isinstance(each.curve, Fragility)]
    curve, count = pooled.curve, len(members)
    if isinstance(curve, str):
        return replace(pooled, likelihood="")
    if len(fits) == count:
        curve = mixture(curve, fits)
        made = (
            f"The curve is the mean of the curves of its {count} arches; theta and beta are those "
            "of the lognormal curve with the same mean and standard deviation of ln capacity."
        )
    else:
        made = (
            f"{count - len(fits)} of its {count} arches have no curve, so the curve is the "
            "lognormal one of all runs of the class."
        )
    text = f"{made} Band and intervals: {pooled.assumptions}"
    return replace(pooled, curve=curve, likelihood="", assumptions=text)


def without_verdict(
    runs: Runs, confidence: float, worded: Callable[[FitError], str] = str
) -> dict[str, Any]:
    """Curves with all runs that no method decided as collapses, and as survivals.

    Empty if there are no such runs; else their number and both curves.
    """
    lost = np.isin(runs.verdict, (Verdict.UNFINISHED, Verdict.SOLVER_FAILURE))
    if not lost.any():
        return {}
    found: dict[str, Any] = {"runs": int(lost.sum())}
    for name, verdict in (("collapsed", Verdict.COLLAPSED), ("standing", Verdict.STANDING)):
        filled = replace(runs, verdict=np.where(lost, verdict, runs.verdict))
        found[name] = curve_to_dict(answer(filled, confidence, worded).curve)
    return found


def two_fidelities(runs: Runs, im: FloatArray, confidence: float) -> Answer | None:
    """Curve from coarse capacities of all records, corrected by the fine ones of some.

    None where all records have fine ones, or some capacity does not lie between two levels:
    leaving such records out would bias both.
    """
    if runs.coarse is None or runs.decided.any(axis=1).all():
        return None
    coarse = find_brackets(runs.coarse, runs.level, "first")
    fine = find_brackets(runs.verdict, runs.level, "first")
    both = runs.decided.any(axis=1)
    if not coarse.bracketed.all() or not fine.bracketed[both].all() or both.sum() < 5:
        return None
    found = estimate_two_fidelity(coarse.middle, np.where(both, fine.middle, np.nan))
    curve = Fragility(
        theta=found.theta, beta=found.beta,
        covariance=np.diag(np.square(found.standard_errors)), log_likelihood=np.nan,
        n_levels=runs.verdict.shape[1], n_total=found.n_coarse, kind="two_fidelities",
    )  # fmt: skip
    band = confidence_band(curve, im, confidence)
    return Answer(
        curve, curve, theta_interval(curve, confidence), beta_interval(curve, confidence),
        im.tolist(), band.lower.tolist(), band.upper.tolist(), confidence,
        method="control variate, jackknife",
        assumptions=f"Capacity is lognormal; ln capacities by the two methods are correlated by "
        f"{found.correlation:.2f} over {found.n_fine} of {found.n_coarse} records; the bias of ln "
        f"theta, estimated as {found.bias[0]:+.3f}, is taken out.",
        n_independent=float(found.n_coarse),
    )  # fmt: skip


def likeliest(runs: Runs, worded: Callable[[FitError], str] = str) -> Fragility | str:
    """Curve by maximum likelihood: of stripes and single runs binomial, else of brackets."""
    decided = runs.decided
    level = np.broadcast_to(runs.level, runs.verdict.shape)[decided]
    distinct, place = np.unique(level, return_inverse=True)
    fell = np.bincount(place, runs.verdict[decided] == Verdict.COLLAPSED, distinct.size)
    try:
        if runs.design in ("ida", "two_stage"):
            found = find_brackets(runs.verdict, runs.level).known()
            return fit_brackets(found.lower, found.upper)
        return fit_stripes(distinct, fell, np.bincount(place, minlength=distinct.size))
    except FitError as error:
        return worded(error)
