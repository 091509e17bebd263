"""An arch or a class of arches compared with another one that met the same motions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import Brackets
from archfrag.fragility.curve import Fragility
from archfrag.fragility.quoted import shared_events
from archfrag.fragility.ratio import left_out, parts_of, ratios
from archfrag.fragility.risk import HazardCurve
from archfrag.study.answer.curves import Runs, onsets_in_measure, runs_of_cube

Table = dict[str, dict[str, float]]


def compare(
    cubes: Sequence[xr.Dataset], names: Sequence[str],
    curves: Sequence[Mapping[str, Fragility | str]],
    hazard: HazardCurve | None = None, confidence: float = 0.9,
) -> dict[str, Table]:  # fmt: skip
    """Compare arches or classes of arches with the first of them, motion by motion.

    Each of `names` is of the cube, and has its curve among the `curves`, at its place. The members
    of two classes are pairs: the same number of arches, sampled alike.

    Returns by name of each but the first the rows ``theta`` [SI] and, with a hazard, ``rate``
    [1/year], each with before, after, ratio, lower, upper. InputError if a name is not known,
    or the motions or the samples differ; FitError if an arch has no curve.
    """
    runs, fits = [], []
    for cube, name, known in zip(cubes, names, curves, strict=True):
        if name not in known:
            have = ", ".join(known)
            raise InputError(f"there is no arch or class {name!r}; the study has {have}")
        if isinstance(fit := known[name], str):
            raise FitError(f"{name} has no curve: {fit}")
        fits.append(fit)
        cube = cubes[0] if cube is cubes[0] else _same_motions(cubes[0], cube)
        runs.append(runs_of_cube(cube, [name])[0])
        _check_pairs(runs[0], runs[-1])
    record = runs[0].cube["record"].values.astype(str)
    groups = shared_events(runs[0].cube["event"].values)
    groups = record if groups is None else groups
    rows = [np.tile(groups, len(each.verdict) // record.size) for each in runs]
    parts = [parts_of(each) for each in rows]

    def estimate(own: Runs, found: Brackets) -> Fragility:
        """What the jackknife repeats: the posterior of the design's curve, without scatter."""
        plain = replace(found, contradictions=0 * found.contradictions)
        return own.design.posterior(plain)[0].fragility

    without = [left_out(own.brackets, p, partial(estimate, own)) for own, p in zip(runs, parts)]
    least = [onsets_in_measure(each.cube) for each in runs]
    least = [each if fit.members is not None else each.min() for each, fit in zip(least, fits)]
    return {
        name: ratios((fits[0], fits[i]), (without[0], without[i]), hazard, (least[0], least[i]),
                     confidence)
        for i, name in enumerate(names) if i
    }  # fmt: skip


def _same_motions(own: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """The other cube with its records in the order of the own; InputError unless they agree."""
    refused = "the two studies cannot be compared, since their"
    measures = [str(cube["intensity"].attrs["measure"]) for cube in (own, other)]
    if measures[0] != measures[1]:
        raise InputError(f"{refused} levels are of {measures[0]} and of {measures[1]}")
    names, others = (cube["record"].values.astype(str).tolist() for cube in (own, other))
    if lacking := sorted(set(names) ^ set(others)):
        raise InputError(f"{refused} motions differ: {lacking[0]} is in one of them only")
    ordered = other.isel(record=[others.index(name) for name in names])
    for name, one, two in zip(names, _of_motions(own), _of_motions(ordered)):
        common = one.keys() & two.keys()
        if not all(np.isclose(one[key], two[key], rtol=1e-9, atol=0.0) for key in common):
            raise InputError(f"{refused} motions differ: {name} is not the same in both")
    return ordered


def _of_motions(cube: xr.Dataset) -> list[dict[str, float]]:
    """What is known of each record as it is: its measures, and whether its vertical is used."""
    names = cube["measure"].values.astype(str).tolist()
    values = cube["record_measure"].transpose("record", "measure").values
    verticals = cube["record_vertical"].values.astype(float)
    rows = zip(values.tolist(), verticals.tolist())
    return [dict(zip(names, row)) | {"vertical": vertical} for row, vertical in rows]


def _check_pairs(one: Runs, two: Runs) -> None:
    """Check that the members of two classes are pairs, drawn alike; InputError if not."""
    sizes = [runs.cube.sizes["arch"] for runs in (one, two)]
    pair = f"{one.name} and {two.name} cannot be compared"
    if sizes[0] != sizes[1]:
        raise InputError(f"{pair}: they have {sizes[0]} and {sizes[1]} arches; sample them alike")
    for name in map(str, one.cube.data_vars):
        if name.startswith("arch_") and name in two.cube and one.cube[name].dtype.kind == "f":
            first, second = (np.argsort(runs.cube[name].values).tolist() for runs in (one, two))
            if first != second:
                key = name.removeprefix("arch_")
                raise InputError(
                    f"{pair}: their samples of {key} differ; give both entries the same vary with "
                    "the same seed and number of samples"
                )
