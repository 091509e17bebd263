"""Arches or classes of arches compared that met the same motions; two measures and one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Curve, FloatArray, IntArray
from archfrag.fragility.plane import Plane, fit_plane
from archfrag.fragility.quoted import shared_events
from archfrag.fragility.risk import HazardCurve
from archfrag.fragility.several import crossing_groups, left_out, parts_of, ratios
from archfrag.fragility.verdicts import Brackets
from archfrag.study.answer.curves import ArchRuns, Fitted, known_measures, runs_of_cube
from archfrag.study.file.schema import Intensity

Table = dict[str, dict[str, float]]


def compare(
    fitted: Sequence[Fitted],
    names: Sequence[str],
    hazard: HazardCurve | None = None,
    confidence: float = 0.9,
) -> dict[str, Table]:
    """Compare arches or classes of arches with the first of them, motion by motion.

    Each of `names` is of the study at its place in `fitted`. The members of two classes are pairs:
    the same number of arches, sampled alike.

    Returns by name of each but the first the rows ``theta`` [SI] and, with a hazard, ``rate``
    [1/year], each with before, after, ratio, lower, upper. InputError if a name is not known,
    or the motions or the samples differ; FitError if an arch has no curve.
    """
    runs = list[ArchRuns]()
    curves = list[Curve]()
    for study, name in zip(fitted, names):
        if name not in study.curves:
            have = ", ".join(study.curves)
            raise InputError(
                f"there is no arch or class {name!r}; the study has {have}"
            )
        curve = study.curves[name]
        own = study.runs[name]
        if not curve.fitted:
            raise FitError(f"{name} has no curve: {curve.reason}")
        if study is not fitted[0]:
            same = _same_motions(fitted[0].cube, study.cube)
            own = runs_of_cube(same, [name])[name]
        curves.append(curve)
        runs.append(own)
        _check_pairs(runs[0], own)

    @cache
    def without(place: int, groups: bytes) -> FloatArray:
        """Return ln theta and ln beta of an arch, by the posterior without scatter."""
        own = runs[place]
        parts = parts_of(np.frombuffer(groups, int))

        def estimate(brackets: Brackets) -> Curve:
            return own.design.posterior(brackets.without_scatter())[0].curve

        return left_out(own.brackets, parts, estimate)

    least = [own.onset(curve) for own, curve in zip(runs, curves)]
    found = {}
    for i, name in enumerate(names[1:], 1):
        ways = [each.tobytes() for each in _groupings(runs[0], runs[i])]
        pairs = [(without(0, each), without(i, each)) for each in ways]
        onsets = least[0], least[i]
        found[name] = ratios((curves[0], curves[i]), pairs, hazard, onsets, confidence)
    return found


def _groupings(one: ArchRuns, two: ArchRuns) -> list[IntArray]:
    """Return groups of rows that are alike in two arches or classes of arches."""
    record = one.cube["record"].values.astype(str)
    event = shared_events(one.cube["event"].values)
    alike = {**one.groups, **two.groups, "event": record if event is None else event}
    alike.pop("record", None)
    return crossing_groups(
        [np.resize(each, len(one.verdict)) for each in alike.values()]
    )


def plane_of(
    fitted: Fitted, intensity: Intensity, second: str = "best", arch: str | None = None
) -> Plane:
    """Return the plane of an arch in the study's intensity and a second measure.

    The second is the measure with the least p-value if it is "best". It has the unit of the
    levels, or its SI unit if that is of another kind. `arch` may be None if there is one.
    """
    names = list(fitted.arches)
    unit = intensity.unit
    factor = intensity.factor
    if arch not in (names if arch or names[1:] else [None]):
        raise InputError(f"plane: arch = {arch!r} must be one of {', '.join(names)}")
    runs = fitted.runs[arch or names[0]]
    known, exponent, units = known_measures(runs.cube)
    own = intensity.measure
    planes = list[Plane]()
    reasons = list[FitError]()
    others = [name for name in known if name != own]
    if second not in (*others, "best"):
        raise InputError(
            f"plane: second = {second!r} must be best, or one of {', '.join(others)}"
        )
    ends = {
        end: getattr(runs.brackets, end) / factor
        for end in ("lower", "upper", "levels")
    }
    for name in others if second == "best" else [second]:
        power = exponent[name] / exponent[own]
        alike = units[name] == units[own]
        ratio = (
            known[name] / (factor if alike else 1.0) / (known[own] / factor) ** power
        )
        both = unit, unit if alike else units[name]
        try:
            plane = fit_plane(replace(runs.brackets, **ends), ratio, power, runs.group)
            planes.append(replace(plane, measures=(own, name), units=both))
        except FitError as error:
            reasons.append(error)
    if not planes:
        raise reasons[0]
    best = min(planes, key=lambda plane: plane.p_value)
    return replace(
        best, tests=len(planes), p_value=min(1.0, best.p_value * len(planes))
    )


def _same_motions(own: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Return the other cube in the order of the own records; InputError unless they agree."""
    refused = "the two studies cannot be compared, since their"
    measures = [str(cube["intensity"].attrs["measure"]) for cube in (own, other)]
    if measures[0] != measures[1]:
        raise InputError(f"{refused} levels are of {measures[0]} and of {measures[1]}")
    one, two = (_of_motions(cube) for cube in (own, other))
    for name in one.index.symmetric_difference(two.index)[:1]:
        raise InputError(f"{refused} motions differ: {name} is in one of them only")
    common = one.columns.intersection(two.columns)
    alike = np.isclose(one[common], two.loc[one.index, common], rtol=1e-9, atol=0.0)
    for name in one.index[np.flatnonzero(~alike.all(axis=1))[:1]]:
        raise InputError(f"{refused} motions differ: {name} is not the same in both")
    return other.isel(record=two.index.get_indexer(one.index))


def _of_motions(cube: xr.Dataset) -> pd.DataFrame:
    """Tabulate the measures of each record, and whether its vertical component is used."""
    table = cube["record_measure"].transpose("record", "measure").to_pandas()
    return table.assign(vertical=cube["record_vertical"].values.astype(float))


def _check_pairs(one: ArchRuns, two: ArchRuns) -> None:
    """Check that the members of two classes are pairs, drawn alike; InputError if not."""
    sizes = [runs.cube.sizes["arch"] for runs in (one, two)]
    pair = f"{one.name} and {two.name} cannot be compared"
    if sizes[0] != sizes[1]:
        raise InputError(
            f"{pair}: they have {sizes[0]} and {sizes[1]} arches; sample them alike"
        )
    for name in map(str, one.cube.data_vars):
        if (
            name.startswith("arch_")
            and name in two.cube
            and one.cube[name].dtype.kind == "f"
        ):
            first, second = (
                np.argsort(runs.cube[name].values).tolist() for runs in (one, two)
            )
            if first != second:
                key = name.removeprefix("arch_")
                rule = "give both entries the same vary with the same seed and number of samples"
                raise InputError(f"{pair}: their samples of {key} differ; {rule}")
