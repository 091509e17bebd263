"""From the cube of a study to its fragility curves, stored and told, with reasons for caution."""

import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import FitError, InputError, attempt
from archfrag.files import write_csv
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import Fragility
from archfrag.fragility.quoted import Answer
from archfrag.study.answer import curves
from archfrag.study.answer.cube import in_si
from archfrag.study.file.members import SHOWN, shown
from archfrag.study.file.records import read_manifest
from archfrag.study.file.schema import Intensity, Study
from archfrag.study.provenance import (
    CUBE,
    NETCDF,
    finite,
    read_json,
    refuse_foreign_cube,
    write_text,
)
from archfrag.study.validate import suspicious, unit_warnings

FITS, CURVE = "fits.json", "curve.csv"
DECIMALS = 9  # of a probability
MOST_UNDECIDED = 0.05  # fraction of the runs at a level, beyond which there is a caution
MOST_SURVIVING, MOST_AGAIN = 0.25, 0.2  # fractions of the records
MOST_SCALING = 10.0
LEAST_EVENTS = 4
# Answers of arches, answers of classes of several arches, and the cube that they are from.
Fitted = tuple[dict[str, Answer], dict[str, Answer], xr.Dataset]


def open_cube(study: Study) -> xr.Dataset:
    """Read the cube of a study into memory.

    InputError if there is none, OutputError if it is another study's.
    """
    path = study.folder / CUBE
    refuse_foreign_cube(study)
    try:
        with NETCDF, xr.open_dataset(path) as cube:
            return in_si(cube.load())
    except (OSError, ValueError) as error:
        how = "`archfrag cube` on the study file makes it"
        raise InputError(f"{path}: is missing or damaged; {how}") from error


def fit_cube(study: Study) -> Fitted:
    """Find and store the curves of arches and classes: JSON in SI, CSV in the study's unit."""
    confidence, keys = study.report.confidence, study.limit_states.model_dump()
    worded = partial(FitError.worded, factor=study.intensity.factor, unit=study.intensity.unit)

    def part(make: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
        found = attempt(partial(make, *arguments), worded)
        return {"none": found} if isinstance(found, str) else found

    with open_cube(study) as opened:
        cube = opened.load()
    runs = curves.runs_of_cube(cube, worded=worded)
    answers = {each.name: curves.answer(each, confidence) for each in runs}
    medians = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]
    for each in (runs[number] for number in shown(medians)):
        more = answers[each.name].more
        more["free"] = part(curves.free_shapes, each, confidence)
        more["measures"] = part(curves.measures_compared, each)
        more["limit_states"] = part(curves.limit_states, each, keys, answers[each.name])
        if not each.design.on_levels:
            more["cloud"] = {"logistic": part(curves.cloud_curves, each, confidence)}
    for each in runs:
        answers[each.name].more["without_verdict"] = part(curves.without_verdict, each, confidence)
    classes = {}
    sizes = Counter(curves.arch_classes(cube).values())
    names = [name for name, size in sizes.items() if size > 1]
    for each in curves.runs_of_cube(cube, names, worded):
        name, members = each.name, [answers[arch] for arch in each.cube["arch"].values.astype(str)]
        classes[name] = curves.of_class(curves.answer(each, confidence), members)
        split = {}
        if not isinstance(curve := classes[name].curve, str):
            split = part(curves.dispersion_split, each, members, curve.beta)
        states = part(curves.limit_states, each, keys, classes[name])
        states["states"] = [s for s in states.get("states", ()) if s["name"] != "collapse"]
        lost = part(curves.without_verdict, each, confidence)
        classes[name].more.update(dispersion=split, limit_states=states, without_verdict=lost)
    _store(study, answers, classes, cube)
    return answers, classes, cube


def _store(
    study: Study, arches: dict[str, Answer], classes: dict[str, Answer], cube: xr.Dataset
) -> None:
    measure, unit, factor = study.intensity.measure, study.intensity.unit, study.intensity.factor
    plain = {name: each.to_dict() for name, each in arches.items()}
    content = {
        "study": study.id, "measure": measure, "unit": cube["intensity"].attrs["units"],
        "design": json.loads(cube.attrs["archfrag_design"]),
        "fits": {name: each["curve"] for name, each in plain.items()},
        "arches": plain, "classes": {name: each.to_dict() for name, each in classes.items()},
    }  # fmt: skip
    text = json.dumps(finite(content, None), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(study.folder / FITS, text + "\n")
    rows = [pd.DataFrame(columns=["arch", f"{measure} [{unit}]", "probability", "lower", "upper"])]
    for name, found in curves.quoted(cube, arches, classes).items():
        if not isinstance(found.curve, str):
            im = np.array(found.im)
            chances = (found.curve.probability(im), found.lower, found.upper)
            values = name, im / factor, *(np.round(each, DECIMALS) for each in chances)
            rows.append(pd.DataFrame(dict(zip(rows[0].columns, values))))
    write_csv(study.folder / CURVE, rows, float_format="%.7g")


def load_fits(study: Study) -> Fitted:
    """Read the answers that `fit_cube` stored, and the cube; InputError if a file is damaged."""
    path = study.folder / FITS
    try:
        stored = read_json(path)
        arches, classes = (
            {name: Answer.from_dict(answer) for name, answer in stored[of].items()}
            for of in ("arches", "classes")
        )
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError) as error:
        how = "`archfrag fit` makes it"
        raise InputError(f"{path}: is missing or damaged ({error}); {how}") from None
    return arches, classes, open_cube(study)


def fit_lines(study: Study, fitted: Fitted) -> tuple[list[str], list[str]]:
    """Write aligned lines on the curves of classes and of arches of none, and the cautions."""
    arches, classes, cube = fitted
    factor, unit = study.intensity.factor, study.intensity.unit
    found = curves.quoted(cube, arches, classes)
    rows = [(name, *fit_texts(study.intensity, found[name])) for name in list(found)[:SHOWN]]
    first = max(len("report"), *(len(name) for name, _, _ in rows))
    second = max(len(median) if beta else 0 for _, median, beta in rows)
    lines = [f"{name:{first}}  {median:{second}}  {beta}".rstrip() for name, median, beta in rows]
    if len(found) > SHOWN:
        lines.append(f"{len(found) - SHOWN} more in {study.folder / CURVE}")
    lost = {name: lost_text(each, lambda theta: f"{theta / factor:.4g} {unit}")
            for name, each in found.items()}  # fmt: skip
    cautions = [f"{name}: {text}" for name, text in lost.items() if text]
    cautions += cautions_of_cube(study, cube, arches)
    return lines, gathered(cautions, cube, list(found)[:SHOWN])


def gathered(cautions: Iterable[str], cube: xr.Dataset, shown: Collection[str]) -> list[str]:
    """List cautions; of those on arches that are not `shown` alone only the first of each kind.

    Cautions are of one kind if they differ in numbers, and their arches are of one class.
    """
    of_class, kinds = curves.arch_classes(cube), dict[tuple[str, str], list[str]]()
    for each in cautions:
        name, _, words = each.partition(": ")
        key = "", each
        if name in of_class and name not in shown:
            key = of_class[name] * (of_class[name] != name), re.sub(r"[\d.]+", "", words)
        kinds.setdefault(key, []).append(each)
    found = []
    for (name, _), alike in kinds.items():
        whose = f"{len(alike)} arches{f' of {name}' if name else ''}, such as "
        found.append(whose * (len(alike) > 1) + alike[0])
    return found


def fit_text(intensity: Intensity, name: str, found: Answer) -> str:
    """A curve in the unit of the study, or why there is none, in a line."""
    lost = lost_text(found, lambda theta: f"{theta / intensity.factor:.4g} {intensity.unit}")
    texts = ", ".join(filter(None, fit_texts(intensity, found)))
    return f"{name}: {texts}{f'; {lost}' if lost else ''}"


def fit_texts(intensity: Intensity, found: Answer) -> tuple[str, str]:
    """Median in the unit of the study, and dispersion; or why there is no curve."""
    if isinstance(found.curve, str):
        return f"no curve: {found.curve}", ""
    values = (value / intensity.factor for value in (found.curve.theta, *found.theta))
    theta, low, high = (f"{v:.0f}" if v > 100.0 else f"{v:#.3g}" for v in values)
    return (
        f"median {theta} {intensity.unit} {intensity.measure} "
        f"({100 * found.confidence:g} %: {low}–{high})",
        f"dispersion {found.curve.beta:.2f} ({found.beta[0]:.2f}–{found.beta[1]:.2f})",
    )


def lost_text(found: Answer, median: Callable[[float], str]) -> str:
    """Write what the runs without a verdict could change; empty if there are none."""
    lost = found.more.get("without_verdict") or {}
    if "runs" not in lost:
        return ""
    low, high = (
        median(lost[key]["theta"]) if "theta" in lost[key] else "not known"
        for key in ("collapsed", "standing")
    )
    runs = "1 run has" if lost["runs"] == 1 else f"{lost['runs']} runs have"
    return f"{runs} no verdict: the median is {low} if all collapse, {high} if all stand"


def cautions_of_cube(study: Study, cube: xr.Dataset, answers: Mapping[str, Answer]) -> list[str]:
    """List the cautions on a study's cube and curves, with levels in the study's unit."""
    unit, named = study.intensity.unit, ["levels of their own"]
    if study.design.on_levels:
        named = [f"{level:.4g} {unit}" for level in study.intensity.given]
    found = [
        f"{runs.name}: {message}"
        for runs in curves.runs_of_cube(cube)
        for message in arch_cautions(runs, named, answers[runs.name].curve)
    ]
    found += unit_warnings(study, study.members)
    found += suspicious(read_manifest(study)["records"])
    found += study.design.cautions(json.loads(cube.attrs["archfrag_design"]).get("arches", {}))
    return [*found, *record_cautions(cube)]


def arch_cautions(runs: curves.Runs, named: list[str], curve: Fragility | str) -> Iterator[str]:
    """Messages on the runs of an arch, at levels as they are `named`."""
    verdict, levels, n_record = runs.verdict, runs.level, len(runs.verdict)
    counts = count_verdicts(verdict)
    lost = counts["runs"] - counts["n"]
    fraction = lost / np.maximum(counts["runs"], 1)
    if many := np.count_nonzero(fraction > MOST_UNDECIDED):
        worst = int(fraction.argmax())
        yield (
            f"more than {100 * MOST_UNDECIDED:g} % of the runs are unfinished or failed at {many} "
            f"of {len(named)} levels (most: {lost[worst]} of {counts['runs'][worst]} at "
            f"{named[worst]}); they count neither as collapse nor as survival, so the curve may "
            "be wrong by more than its band"
        )
    if not runs.design.on_levels:
        return
    collapsed, survived = verdict == Verdict.COLLAPSED, verdict == Verdict.STANDING
    beyond = (survived[:, -1] & ~collapsed.any(axis=1)).sum()
    if beyond > MOST_SURVIVING * n_record and not collapsed.any():
        yield f"no record caused collapse up to {named[-1]}, the highest level; add higher levels"
    elif beyond > MOST_SURVIVING * n_record:
        yield (
            f"{beyond} of {n_record} records do not cause collapse at {named[-1]}, the highest "
            "level, so the upper part of the curve is extrapolated; add higher levels"
        )
    again = (np.maximum.accumulate(collapsed, axis=1) & survived).any(axis=1).sum()
    if again > MOST_AGAIN * n_record and not runs.design.adaptive:
        yield (
            f"{again} of {n_record} records do not cause collapse above a level at which they did "
            "(non-monotone records): near the border a single run proves little, and beta "
            "includes this scatter"
        )
    if not isinstance(curve, str) and len(levels) > 1:
        above = int(np.clip(np.searchsorted(levels, curve.theta), 1, len(levels) - 1))
        spacing = float(np.log(levels[above] / levels[above - 1]))
        if spacing > curve.beta:
            yield (
                f"the levels next to the median are {spacing:.2g} apart in ln, more than the "
                f"dispersion of {curve.beta:.2g}, whose interval may then be too narrow; add "
                "levels near the median"
            )


def record_cautions(cube: xr.Dataset) -> Iterator[str]:
    """Messages on motions that are scaled too far, and on records of one to three earthquakes."""
    scaled = cube["scale_factor"].where(cube["verdict"] != Verdict.NOT_SIMULATED)
    largest = scaled.max(["arch", "level"]).values
    if far := int((largest > MOST_SCALING).sum()):
        record = int(np.nanargmax(largest))
        worst = f"{largest[record]:,.0f}" if largest[record] >= 100.0 else f"{largest[record]:.3g}"
        yield (
            f"{far} of {largest.size} records were scaled up by more than {MOST_SCALING:g} (most: "
            f"{cube['record'].values[record]!s}, by {worst}). A weak motion that is scaled up "
            "differs from a strong one (it is shorter and has less long-period energy); use "
            "stronger records"
        )
    events = cube["event"].values.astype(str)
    names = np.unique(events)
    if len(events) < 2 or names.size >= min(LEAST_EVENTS, len(events)) or not events.all():
        return
    if names.size > 1:
        yield (
            f"the {len(events)} records are of {names.size} earthquakes, too few to show how "
            "earthquakes differ, so bands may be too narrow; add records of other earthquakes"
        )
    else:
        yield (
            f"all records are of one earthquake ({events[0]}): dispersion and bands do not "
            "include the variation between earthquakes"
        )
