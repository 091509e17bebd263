"""What follows from the runs of a cube for each arch and of each class: curves and their bands."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import Brackets, Verdict, find_brackets
from archfrag.fragility.curve import FloatArray, Fragility, mixture
from archfrag.fragility.quoted import shared_events
from archfrag.study.runs import Design, design_of

if TYPE_CHECKING:
    import xarray as xr

POINTS = 120  # of a band
Worded = Callable[[FitError], str]  # text of an error, with its levels in the unit people read


@dataclass(frozen=True)
class Runs:
    """Runs of one arch, or of all arches of a class under each other."""

    name: str
    design: Design
    verdict: NDArray[np.int64]  # (n_record, n_level)
    level: FloatArray  # (n_level,) or (n_record, n_level) [SI]
    # (n_record,): what rows have in common: an earthquake, or for a class the record.
    group: NDArray[np.str_] | None = None
    unit: str = "event"  # which of the two
    # (n_record,): numbers of the records in the cube.
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, int))

    @property
    def decided(self) -> NDArray[np.bool_]:
        """Runs that collapsed or survived."""
        return (self.verdict == Verdict.COLLAPSED) | (self.verdict == Verdict.STANDING)

    @cached_property
    def brackets(self) -> Brackets:
        """Between which levels the capacity of each record lies [SI]."""
        return find_brackets(self.verdict, self.level)


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
    n_independent: float = 0.0  # effective number of records or runs
    n_non_monotone: int = 0  # runs against the capacity of their record
    more: dict[str, Any] = field(default_factory=dict)  # further results by name, plain values

    def probability(self, im: float) -> tuple[float, float, float]:
        """Probability of collapse at an intensity, and its band; InputError without a curve."""
        if isinstance(self.curve, str):
            raise InputError(self.curve)
        low, high = (float(np.interp(im, self.im, side)) for side in (self.lower, self.upper))
        return float(self.curve.probability(im)), low, high

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        own = {name: curve_to_dict(getattr(self, name)) for name in ("curve", "likelihood")}
        return vars(self) | own

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> "Answer":
        """Inverse of `to_dict`."""
        own: dict[str, Any] = {n: curve_of_dict(plain[n]) for n in ("curve", "likelihood")}
        for name in ("theta", "beta"):
            own[name] = tuple(np.nan if end is None else float(end) for end in plain[name])
        return cls(**{**plain, **own})


def curve_to_dict(curve: Fragility | str) -> dict[str, Any]:
    """A curve, or why there is none, as plain values."""
    return {"none": curve} if isinstance(curve, str) else curve.to_dict()


def curve_of_dict(plain: Mapping[str, Any]) -> Fragility | str:
    """Inverse of `curve_to_dict`."""
    return str(plain["none"]) if "none" in plain else Fragility.from_dict(dict(plain))


def runs_of_cube(cube: "xr.Dataset") -> list[Runs]:
    """Runs of each arch of a cube."""
    design = design_of(json.loads(cube.attrs["archfrag_design"]))
    verdicts = cube["verdict"].transpose("arch", "record", "level").values.astype(np.int64)
    level, group = cube["intensity"].values, shared_events(cube["event"].values)
    found = []
    for i, (name, verdict) in enumerate(zip(cube["arch"].values.astype(str), verdicts)):
        rows = np.flatnonzero((verdict != Verdict.NOT_SIMULATED).any(axis=1))
        at = level[i, rows] if level.ndim == 3 else level
        own = None if group is None else group[rows]
        found.append(Runs(str(name), design, verdict[rows], at, own, rows=rows))
    return found


def classes_of_cube(cube: "xr.Dataset", runs: Sequence[Runs]) -> dict[str, tuple[Runs, list[int]]]:
    """Runs of the arches of each class together, and their places; classes of several arches."""
    record, found = cube["record"].values.astype(str), {}
    names = np.array(list(arch_classes(cube).values()))
    for name in dict.fromkeys(names.tolist()):
        places = np.flatnonzero(names == name).tolist()
        if len(places) > 1:
            own = [runs[i] for i in places]
            level, verdict = own[0].level, np.concatenate([each.verdict for each in own])
            if level.ndim == 2:
                level = np.concatenate([each.level for each in own])
            group = np.concatenate([record[each.rows] for each in own])
            found[name] = Runs(name, own[0].design, verdict, level, group, "record"), places
    return found


def answer(runs: Runs, confidence: float, worded: Worded = str) -> Answer:
    """Curve of some runs with the band and the intervals that are quoted."""
    likelihood = likeliest(runs, worded)
    im = np.linspace(0.0, 1.05 * float(np.nanmax(runs.level)), POINTS)
    try:
        if len(runs.verdict) < 2:
            raise FitError("there is only one record, from which no curve follows")
        quoted = runs.design.estimate(
            runs.brackets, im, confidence=confidence, groups=runs.group, unit=runs.unit
        )
    except FitError as error:
        return Answer(worded(error), likelihood, confidence=confidence)
    return Answer(
        quoted.curve, likelihood, quoted.theta, quoted.beta,
        im.tolist(), quoted.lower.tolist(), quoted.upper.tolist(), confidence,
        quoted.method, quoted.assumptions, quoted.n_independent, quoted.n_contradictions,
    )  # fmt: skip


def likeliest(runs: Runs, worded: Worded = str) -> Fragility | str:
    """Curve by maximum likelihood, or why there is none."""
    try:
        return runs.design.likelihood(runs.brackets)
    except FitError as error:
        return worded(error)


def of_class(pooled: Answer, members: Sequence[Answer]) -> Answer:
    """Answer of a class, from that of all its runs together and those of its arches.

    Its curve is the mean of those of its arches; if one of these has none, the lognormal curve of
    all runs. Band and intervals are of the latter. The class has no other curve, and one beta.
    """
    if isinstance(curve := pooled.curve, str):
        return replace(pooled, likelihood="")
    fits = [each.curve for each in members if isinstance(each.curve, Fragility)]
    count, lacking = len(members), len(members) - len(fits)
    made = (
        f"The curve is the mean of the curves of its {count} arches; theta and beta are those of "
        "the lognormal curve with the same mean and standard deviation of ln capacity."
    )
    if lacking:
        made = (
            f"{lacking} of its {count} arches have no curve, so the curve is the lognormal one of "
            "all runs of the class."
        )
    text = f"{made} Band and intervals: {pooled.assumptions}"
    whole = curve if lacking else mixture(curve, fits)
    return replace(pooled, curve=whole, likelihood="", assumptions=text)


def without_verdict(runs: Runs, confidence: float, worded: Worded = str) -> dict[str, Any]:
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


def arch_classes(cube: "xr.Dataset") -> dict[str, str]:
    """Class of each arch of a cube; its own name where the cube holds none."""
    classes = cube["arch_class" if "arch_class" in cube else "arch"]
    return dict(zip(cube["arch"].values.astype(str).tolist(), classes.values.astype(str).tolist()))


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
