"""Fit the curves of a cube, store them, and list cautions."""

import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.files import counted, write_csv
from archfrag.fragility.curve import Curve
from archfrag.fragility.verdicts import Verdict, count_verdicts
from archfrag.study.answer import curves
from archfrag.study.answer.cube import open_cube
from archfrag.study.answer.curves import Fitted
from archfrag.study.file.members import SHOWN, shown
from archfrag.study.file.prepared import read_manifest
from archfrag.study.file.schema import Intensity, StudyKeys
from archfrag.study.provenance import finite, read_json, write_text
from archfrag.study.validate import suspicious, unit_warnings

FITS = "fits.json"
CURVE = "curve.csv"
DECIMALS = 9  # of a probability
MOST_UNDECIDED = (
    0.05  # fraction of the runs at a level, beyond which there is a caution
)
MOST_SURVIVING = 0.25  # fractions of the records
MOST_AGAIN = 0.2
MOST_SCALING = 10.0
LEAST_EVENTS = 4
LEAST_RECORDS = 10  # of a table of verdicts; with fewer there is a caution


def fit_cube(study: StudyKeys) -> Fitted:
    """Fit the curves of a study's arches and classes, store them and return them.

    They are stored as JSON in SI units, and as CSV in the study's unit.
    """
    fitted = fit_runs(study, open_cube(study))
    store_fits(study, fitted)
    return fitted


def fit_runs(study: StudyKeys, cube: xr.Dataset) -> Fitted:
    """Fit the curves of all arches and classes of a cube.

    The cube may lack measures and damage, such as that of a table of verdicts.
    """
    intensity = study.intensity
    keys = study.limit_states.model_dump()
    of_class = curves.arch_classes(cube)
    worded = partial(FitError.worded, factor=intensity.factor, unit=intensity.unit)
    names = [name for name, size in Counter(of_class.values()).items() if size > 1]
    runs = curves.runs_of_cube(cube, [*of_class, *names], worded)
    found = {
        name: curves.curve_of(each, study.report.confidence)
        for name, each in runs.items()
    }
    pooled = {name: found.pop(name) for name in names}
    detailed = {
        list(found)[i] for i in shown([curve.theta for curve in found.values()])
    }
    arches = {
        name: curves.completed(runs[name], curve, keys, name in detailed)
        for name, curve in found.items()
    }
    classes = {}
    for name, curve in pooled.items():
        own = runs[name]
        members = [arches[arch] for arch, of in of_class.items() if of == name]
        whole = curves.class_curve(curve, members, "row" in own.groups)
        classes[name] = curves.completed(own, whole, keys, members=members)
    return Fitted(arches, classes, cube)


def store_fits(study: StudyKeys, fitted: Fitted) -> None:
    """Write ``fits.json`` and ``curve.csv``."""
    asked = study.intensity
    cube = fitted.cube
    plain = {name: each.to_dict() for name, each in fitted.arches.items()}
    content = {
        "study": study.id,
        "measure": asked.measure,
        "unit": cube["intensity"].attrs["units"],
        "design": json.loads(cube.attrs["archfrag_design"]),
        "fits": {name: each["curve"] for name, each in plain.items()},
        "arches": plain,
        "classes": {name: each.to_dict() for name, each in fitted.classes.items()},
    }
    text = json.dumps(
        finite(content, None), indent=1, ensure_ascii=False, allow_nan=False
    )
    write_text(study.folder / FITS, text + "\n")
    im_head = f"{asked.measure} [{asked.unit}]"
    head = ["arch", im_head, "probability", "lower", "upper"]
    rows = [pd.DataFrame(columns=head)]
    for name, curve in fitted.quoted().items():
        if curve.fitted:
            im = np.array(curve.im)
            chances = np.round([curve(im), curve.lower, curve.upper], DECIMALS)
            values = name, im / asked.factor, *chances
            rows.append(pd.DataFrame(dict(zip(head, values))))
    write_csv(study.folder / CURVE, rows, float_format="%.7g")


def load_fits(study: StudyKeys) -> Fitted:
    """Read the curves that `fit_cube` stored, and the cube; InputError if a file is damaged."""
    path = study.folder / FITS
    try:
        stored = read_json(path)
        arches, classes = (
            {name: Curve.from_dict(plain, name) for name, plain in stored[of].items()}
            for of in ("arches", "classes")
        )
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        InputError,
    ) as error:
        raise InputError(
            f"{path}: is missing or damaged ({error}); `archfrag fit` makes it"
        ) from None
    return Fitted(arches, classes, open_cube(study))


def in_unit(curve: Curve, intensity: Intensity) -> Curve:
    """Return the curve of an arch or class with its intensities in the unit of the study."""
    curve = curve.in_unit(intensity.factor, intensity.measure, intensity.unit)
    return replace(curve, levels=list(intensity.given))


def updated_fits(
    study: StudyKeys, fitted: Fitted, observed: Any, arch: str | None, **given
) -> Fitted:
    """Return the curves of a study, that of an arch or class after damage that was seen.

    `observed` and `given` are as for `Curve.update`, in the unit of the study. InputError unless
    `arch` has a curve; None is the only one of the study.
    """
    known = {name: each for name, each in fitted.curves.items() if each.fitted}
    name = next(iter(fitted.quoted())) if arch is None else arch
    if name not in known or (arch is None and len(fitted.quoted()) > 1):
        raise InputError(
            f"arch is {arch!r}; name the arch or class: {', '.join(known) or 'none has a curve'}"
        )
    asked = study.intensity
    curve = in_unit(known[name], asked).update(observed, **given)
    curve = curve.in_unit(1.0 / asked.factor, asked.measure, "")
    changed = {name: replace(curve, si=1.0, levels=())}
    arches, classes = (
        {**of, **changed} if name in of else of
        for of in (fitted.arches, fitted.classes)
    )
    return Fitted(arches, classes, fitted.cube)


def fit_lines(study: StudyKeys, fitted: Fitted) -> tuple[list[str], list[str]]:
    """Return aligned lines on the curves of a study, and the cautions on them.

    There is a line for each class and for each arch in no class, for `SHOWN` of them at most.
    """
    answers = {
        name: in_unit(each, study.intensity) for name, each in fitted.quoted().items()
    }
    named = list(answers)[:SHOWN]
    rows = [(name, *answers[name].words()) for name in named]
    first = max(map(len, ("report", *named)))
    second = max(len(median) if beta else 0 for _, median, beta in rows)
    lines = [
        f"{name:{first}}  {median:{second}}  {beta}".rstrip()
        for name, median, beta in rows
    ]
    if len(answers) > SHOWN:
        lines.append(f"{len(answers) - SHOWN} more in {study.folder / CURVE}")
    undecided = [(name, each.undecided()) for name, each in answers.items()]
    cautions = [f"{name}: {text}" for name, text in undecided if text]
    return lines, gathered(cautions + cautions_of(study, fitted), fitted.cube, named)


def gathered(
    cautions: Iterable[str], cube: xr.Dataset, shown: Collection[str]
) -> list[str]:
    """Return cautions; those of one kind are combined into the first, with the number of arches.

    Only cautions on arches that are not in `shown` are combined. They are of one kind if they
    differ in numbers only, and their arches are of one class.
    """
    of_class = curves.arch_classes(cube)
    kinds = dict[tuple[str, str], list[str]]()
    for each in cautions:
        name, _, words = each.partition(": ")
        key = "", each
        if name in of_class and name not in shown:
            key = of_class[name], re.sub(r"[\d.]+", "", words)
            if of_class[name] == name:
                key = "", key[1]
        kinds.setdefault(key, []).append(each)
    found = []
    for (name, _), alike in kinds.items():
        whose = f"{len(alike)} arches{f' of {name}' if name else ''}, such as "
        found.append(whose * (len(alike) > 1) + alike[0])
    return found


def cautions_of(study: StudyKeys, fitted: Fitted) -> list[str]:
    """List the cautions on a study's cube and curves, with levels in the study's unit."""
    named = ["levels of their own"]
    if study.design.on_levels:
        asked = study.intensity
        named = [f"{level:.4g} {asked.unit}" for level in asked.given]
    cautions = []
    for name, curve in fitted.arches.items():
        found = arch_cautions(fitted.runs[name], named, curve)
        cautions += [f"{name}: {message}" for message in found]
    facts = json.loads(fitted.cube.attrs["archfrag_design"]).get("arches", {})
    if study.arches:  # none of a table
        cautions += unit_warnings(study, study.members)
        cautions += suspicious(read_manifest(study)["records"])
    else:
        for name in fitted.arches:
            found = table_cautions(fitted.runs[name])
            cautions += [f"{name}: {message}" for message in found]
    return [*cautions, *study.design.cautions(facts), *record_cautions(fitted.cube)]


def table_cautions(runs: curves.ArchRuns) -> Iterator[str]:
    """Yield warnings on one arch of a table of verdicts, which the user gave instead of runs.

    They say that its records are few, or that its collapses become fewer with intensity.
    """
    records = int(runs.decided.any(axis=1).sum())
    if 0 < records < LEAST_RECORDS:
        yield (
            f"the curve is from {counted(records, 'record')}: the prior, not the verdicts, fixes "
            f"most of its median and its dispersion; add records, at least {LEAST_RECORDS}"
        )
    levels = np.log(np.broadcast_to(runs.level, runs.verdict.shape))
    both = runs.collapsed.any() and runs.survived.any()
    if both and levels[runs.collapsed].mean() < levels[runs.survived].mean():
        yield (
            "runs that collapsed have lower intensities than those that survived, so the "
            "probability of collapse falls with intensity; does 1 mean survived here? Then name "
            "the column survived"
        )


def arch_cautions(
    runs: curves.ArchRuns, named: list[str], curve: Curve
) -> Iterator[str]:
    """Yield warnings on the runs and the curve of an arch.

    `named` has the text of each level.
    """
    verdict = runs.verdict
    levels = runs.level
    n_record = len(verdict)
    counts = count_verdicts(verdict)
    lost = counts["unfinished"] + counts["failed"]
    fraction = lost / np.maximum(counts["runs"], 1)
    many = np.count_nonzero(fraction > MOST_UNDECIDED)
    if many:
        worst = int(fraction.argmax())
        yield (
            f"more than {100 * MOST_UNDECIDED:g} % of the runs are unfinished or failed at {many} "
            f"of {len(named)} levels (most: {lost[worst]} of {counts['runs'][worst]} at "
            f"{named[worst]}); they count neither as collapse nor as survival, so the curve may "
            "be wrong by more than its band"
        )
    before = (verdict == Verdict.COLLAPSED_BEFORE).any(axis=1).sum()
    if before:
        yield (
            f"the first shock alone makes it collapse before {before} of {n_record} records; they "
            "are left out: the curve is that of the arch if it stands after its first shock"
        )
    if runs.moving:
        yield (
            f"it still moved from its first shock when the record began in {runs.moving} of "
            f"{counts['runs'].sum()} runs, so their verdicts depend on the time between the two; "
            "give motions.before a longer gap"
        )
    if not runs.design.on_levels:
        return
    beyond = (runs.survived[:, -1] & ~runs.collapsed.any(axis=1)).sum()
    tried = counts["runs"][-1] if runs.by_level else n_record
    if beyond > MOST_SURVIVING * tried:
        yield (
            f"{beyond} of {tried} records cause no collapse up to {named[-1]}, the highest "
            "level, and a curve beyond it is extrapolated; add higher levels"
        )
    once = np.maximum.accumulate(runs.collapsed, axis=1)
    again = (once & runs.survived).any(axis=1).sum()
    if again > MOST_AGAIN * n_record and not runs.design.adaptive:
        yield (
            f"{again} of {n_record} records do not cause collapse above a level at which they did "
            "(non-monotone records): near the border a single run proves little, and beta "
            "includes this scatter"
        )
    if curve.fitted and len(levels) > 1:
        above = int(np.clip(np.searchsorted(levels, curve.theta), 1, len(levels) - 1))
        spacing = float(np.log(levels[above] / levels[above - 1]))
        if spacing > curve.beta:
            yield (
                f"the levels next to the median are {spacing:.2g} apart in ln, more than the "
                f"dispersion of {curve.beta:.2g}, whose interval may then be too narrow; add "
                "levels near the median"
            )


def record_cautions(cube: xr.Dataset) -> Iterator[str]:
    """Yield warnings on records that are scaled too far, or are of too few earthquakes."""
    scaled = cube["scale_factor"].where(cube["verdict"] != Verdict.NOT_RUN)
    largest = scaled.max(["arch", "level"]).values
    far = int((largest > MOST_SCALING).sum())
    if far:
        record = int(np.nanargmax(largest))
        yield (
            f"{far} of {largest.size} records were scaled up by more than {MOST_SCALING:g} (most: "
            f"{cube['record'].values[record]!s}, by {largest[record]:,.4g}). A weak motion that "
            "is scaled up differs from a strong one (it is shorter and has less long-period "
            "energy); use stronger records"
        )
    for name, tie, what, more in (
        ("event", "are of", "earthquake", "records of other earthquakes"),
        ("first_record", "follow", "first shock", "other first shocks"),
    ):
        events = cube[name].values.astype(str) if name in cube else np.array([""])
        names = np.unique(events)
        few = names.size < min(LEAST_EVENTS, len(events))
        if few and len(events) > 1 and events.all():
            yield (
                f"the {len(events)} records {tie} {counted(names.size, what)} "
                f"({', '.join(names)}), too few to show how {what}s differ: dispersion and bands "
                f"do not include it and may be too narrow; add {more}"
            )
