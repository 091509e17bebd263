"""Two arches or classes under the same motions, two measures with one, and parts of a bridge."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.fragility.curve import Curve, FloatArray, IntArray
from archfrag.fragility.plane import Plane, fit_plane
from archfrag.fragility.quoted import capacity_posterior, shared_events
from archfrag.fragility.risk import HazardCurve
from archfrag.fragility.several import (
    crossing_groups,
    divide,
    left_out,
    parts_of,
    ratios,
)
from archfrag.fragility.verdicts import Brackets
from archfrag.study.answer.curves import ArchRuns, Fitted, known_measures, runs_of_cube
from archfrag.study.answer.rates import mechanisms_of
from archfrag.study.answer.rates import parts_of as parts_of_bridge
from archfrag.study.file.schema import Intensity

Table = dict[str, dict[str, float]]


def compare(
    fitted: Sequence[Fitted],
    names: Sequence[str],
    hazard: HazardCurve | None = None,
    confidence: float = 0.9,
) -> Table:
    """Compare two arches or classes of arches, motion by motion.

    `names` are an arch or class of each of the two studies `fitted`, which may be the same study.
    Two classes must have the same number of arches, sampled alike, so that their members are
    pairs.

    Returned are the rows ``theta`` [SI] and, with a hazard, ``rate`` [1/year], each with before,
    after, ratio, lower, upper. InputError if a name is not known, or the motions or the samples
    differ; FitError if an arch has no curve.
    """
    one, two = (_runs_of(each, name, fitted[0]) for each, name in zip(fitted, names))
    _check_pairs(one, two)

    def without(own: ArchRuns, groups: IntArray) -> FloatArray:
        """Return ln theta and ln beta of an arch without each part of the groups, (n_part, 2).

        They are estimated by the posterior as if single runs did not scatter.
        """

        def estimate(brackets: Brackets) -> Curve:
            return capacity_posterior(brackets.without_scatter())[0].curve

        return left_out(own.brackets, parts_of(groups), estimate)

    # Groupings of rows, of one arch or of the other.
    record = one.cube["record"].values.astype(str)
    event = shared_events(one.cube["event"].values)
    alike = {**one.groups, **two.groups, "event": record if event is None else event}
    alike.pop("record", None)
    ways = crossing_groups(
        [np.resize(each, len(one.verdict)) for each in alike.values()]
    )
    pairs = [(without(one, way), without(two, way)) for way in ways]
    curves = fitted[0].curves[one.name], fitted[1].curves[two.name]
    onsets = one.onset(curves[0]), two.onset(curves[1])
    return ratios(curves, pairs, hazard, onsets, confidence)


def _runs_of(study: Fitted, name: str, first: Fitted) -> ArchRuns:
    """Return the runs of an arch or class, with its records in the order of the `first` study.

    InputError if the name is not known or the motions differ; FitError if there is no curve.
    """
    if name not in study.curves:
        raise InputError(
            f"there is no arch or class {name!r}; the study has {', '.join(study.curves)}"
        )
    if not study.curves[name].fitted:
        raise FitError(f"{name} has no curve: {study.curves[name].reason}")
    if study is first:
        return study.runs[name]
    return runs_of_cube(_same_motions(first.cube, study.cube), [name])[name]


def plane_of(
    fitted: Fitted, intensity: Intensity, second: str = "best", arch: str | None = None
) -> Plane:
    """Return the plane of an arch in the study's intensity and a second measure.

    If `second` is "best", the measure with the least p-value is taken, and its p-value is
    multiplied by the number of measures tried. The second measure has the unit of the levels if it
    is of the same kind, else its SI unit. `arch` may be None if the study has only one. InputError
    if an argument is not known; FitError if there is no plane.
    """
    names = list(fitted.arches)
    factor = intensity.factor
    if arch not in (names if arch or names[1:] else [None]):
        raise InputError(f"plane: arch = {arch!r} must be one of {', '.join(names)}")
    runs = fitted.runs[arch or names[0]]
    known, exponent, units = known_measures(runs.cube)
    own = intensity.measure
    tried = [name for name in known if name != own]
    if second not in (*tried, "best"):
        raise InputError(
            f"plane: second = {second!r} must be best, or one of {', '.join(tried)}"
        )
    found = runs.brackets
    brackets = replace(
        found,
        lower=found.lower / factor,
        upper=found.upper / factor,
        levels=found.levels / factor,
    )
    planes = list[Plane]()
    reasons = list[FitError]()
    for name in tried if second == "best" else [second]:
        power = exponent[name] / exponent[own]
        alike = units[name] == units[own]
        scale = factor if alike else 1.0
        ratio = known[name] / scale / (known[own] / factor) ** power
        both = intensity.unit, intensity.unit if alike else units[name]
        try:
            plane = fit_plane(brackets, ratio, power, runs.group)
            planes.append(replace(plane, measures=(own, name), units=both))
        except FitError as error:
            reasons.append(error)
    if not planes:
        raise reasons[0]
    best = min(planes, key=lambda plane: plane.p_value)
    return replace(
        best, tests=len(planes), p_value=min(1.0, best.p_value * len(planes))
    )


def part_curves(runs: ArchRuns, curve: Curve, im: ArrayLike) -> pd.DataFrame:
    """Tabulate P(a collapse in each part of a bridge) at intensities `im`, (n,), with its band.

    The columns are part, im, probability, lower, upper and collapses, the number of the part in
    all runs. `curve` is that of the runs; `im` is in its unit. Parts without a collapse have no
    rows; there is none if the arch has one part, no curve or no collapse.
    """
    heads = ["part", "im", "probability", "lower", "upper", "collapses"]
    split = parts_of_bridge(runs)
    if split is None or not curve.fitted:
        return pd.DataFrame(columns=heads)
    found = divide(curve, split, mechanisms_of(runs)[0] / curve.si, im)
    values = np.broadcast_arrays(
        np.array(split.categories)[:, None],
        im,
        *found,
        split.counts.sum(axis=1)[:, None],
    )
    return pd.DataFrame(dict(zip(heads, map(np.ravel, values))))


def _same_motions(own: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Return the cube `other` with its records in the order of the cube `own`.

    InputError unless both are of one measure and have the same records with the same motions.
    """
    refused = "the two studies cannot be compared, since their"
    measures = [str(cube["intensity"].attrs["measure"]) for cube in (own, other)]
    if measures[0] != measures[1]:
        raise InputError(f"{refused} levels are of {' and of '.join(measures)}")
    # The measures of each record, and whether its vertical component is used.
    one, two = (
        cube["record_measure"]
        .transpose("record", "measure")
        .to_pandas()
        .assign(vertical=cube["record_vertical"].values.astype(float))
        for cube in (own, other)
    )
    for name in one.index.symmetric_difference(two.index)[:1]:
        raise InputError(f"{refused} motions differ: {name} is in one of them only")
    common = one.columns.intersection(two.columns)
    alike = np.isclose(one[common], two.loc[one.index, common], rtol=1e-9, atol=0.0)
    for name in one.index[np.flatnonzero(~alike.all(axis=1))]:
        raise InputError(f"{refused} motions differ: {name} is not the same in both")
    return other.isel(record=two.index.get_indexer(one.index))


def _check_pairs(one: ArchRuns, two: ArchRuns) -> None:
    """Check that the members of two classes are pairs; InputError if not.

    Both classes must have the same number of arches, and their sampled values the same order.
    """
    pair = f"{one.name} and {two.name} cannot be compared"
    sizes = [runs.cube.sizes["arch"] for runs in (one, two)]
    if sizes[0] != sizes[1]:
        raise InputError(
            f"{pair}: they have {sizes[0]} and {sizes[1]} arches; sample them alike"
        )
    for name in map(str, one.cube.data_vars):
        if not name.startswith("arch_") or name not in two.cube:
            continue
        orders = [np.argsort(runs.cube[name].values) for runs in (one, two)]
        if one.cube[name].dtype.kind == "f" and (orders[0] != orders[1]).any():
            raise InputError(
                f"{pair}: their samples of {name.removeprefix('arch_')} differ; give both entries "
                "the same vary with the same seed and number of samples"
            )
