"""From the cube of a study to its fragility curves, and what to know before these are used."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.study import comparisons, curves
from archfrag.study.checks import doubts, uncorrected
from archfrag.study.config import Study
from archfrag.study.cube import CUBE, refuse_foreign_cube
from archfrag.study.curves import Answer
from archfrag.study.files import write_text
from archfrag.study.members import members, shown
from archfrag.study.provenance import finite

if TYPE_CHECKING:
    import xarray as xr

FITS = "fits.json"


def open_cube(study: Study) -> "xr.Dataset":
    """The cube of a study.

    Raises
    ------
    InputError
        If there is none yet, or it is damaged.
    OutputError
        If it is another study's.
    """
    import xarray as xr

    path = study.folder / CUBE
    if not path.is_file():
        raise InputError(f"{path}: there is no cube yet; `archfrag cube` on the study makes it")
    refuse_foreign_cube(study)
    try:
        return xr.open_dataset(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is damaged; `archfrag cube` makes it anew") from error


def fit_cube(study: Study) -> dict[str, Answer]:
    """Find the curve of each arch and class of the cube and store all in ``fits.json``."""
    confidence, keys = study.report.confidence, study.limit_states.model_dump()
    factor = study.intensity.factor
    with open_cube(study) as cube:
        runs = [
            replace(each, level=each.level / factor) for each in curves.runs_of_cube(cube.load())
        ]
        answers = {each.name: curves.answer(each, confidence) for each in runs}
        medians = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]
        for number in shown(medians):
            each, one = runs[number], cube.isel(arch=number)
            more = answers[each.name].more
            more["free"] = comparisons.free_shapes(each, confidence)
            more["measures"] = comparisons.measures_compared(one, each)
            more["limit_states"] = comparisons.limit_states(one, each, keys)
            if each.design == "cloud":
                more["cloud"] = comparisons.cloud_curves(one, each, confidence)
        classes = {}
        names = cube["arch_class"].values.astype(str)
        for name, group in curves.classes_of_cube(cube, runs).items():
            members = [each for each, own in zip(runs, names) if own == name]
            own_answers = [answers[each.name] for each in members]
            classes[name] = curves.answer(group, confidence)
            classes[name].more["dispersion"] = comparisons.dispersion_split(members, own_answers)
        unit = cube["intensity"].attrs["units"]
        design = json.loads(cube.attrs["archfrag_design"])
    plain, of_classes = (
        {name: _in_si(each.to_dict(), factor, study.intensity.unit) for name, each in some.items()}
        for some in (answers, classes)
    )
    content = {
        "study": study.id, "measure": study.intensity.measure, "unit": unit, "design": design,
        "fits": {name: each["curve"] for name, each in plain.items()},
        "arches": plain, "classes": of_classes,
    }  # fmt: skip
    text = json.dumps(finite(content, None), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(study.folder / FITS, text + "\n")
    return {name: Answer.from_dict(each) for name, each in plain.items()}


def _in_si(value: Any, factor: float, unit: str, key: str = "") -> Any:
    """Plain values of an answer in the unit of the study, as one in SI."""
    if key in ("theta", "theta_interval", "im") and not isinstance(value, dict):
        return [v * factor for v in value] if isinstance(value, list | tuple) else value * factor
    if isinstance(value, dict) and key != "measures":
        if key in ("curve", "likelihood") and "none" in value:
            return {"none": f"{value['none']} (levels in {unit})"}
        return {name: _in_si(each, factor, unit, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_in_si(each, factor, unit) for each in value]
    return value


def fit_text(study: Study, name: str, found: Answer) -> str:
    """A curve in the unit of the study, or why there is none."""
    if isinstance(found.curve, str):
        return f"{name}: no curve: {found.curve}"
    factor, percent = study.intensity.factor, f"{100 * found.confidence:g} %"
    theta, low, high = (value / factor for value in (found.curve.theta, *found.theta))
    return (
        f"{name}: median {theta:.4g} {study.intensity.unit} of {study.intensity.measure} "
        f"({percent}: {low:.4g} to {high:.4g}), dispersion {found.curve.beta:.3g} "
        f"({found.beta[0]:.3g} to {found.beta[1]:.3g})"
    )


def load_answers(path: Path, of: str = "arches") -> dict[str, Answer]:
    """Answers that `fit_cube` stored, by arch or, with ``of="classes"``, by class.

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))[of]
        return {name: Answer.from_dict(answer) for name, answer in stored.items()}
    except FileNotFoundError:
        raise InputError(f"{path}: there are no fits yet; `archfrag fit` makes them") from None
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError) as error:
        raise InputError(f"{path}: is damaged ({error}); `archfrag fit` makes it anew") from None


MOST_UNDECIDED = 0.05  # fraction of the runs at a level
MOST_SCALING, FAR_TOO_MUCH = 10.0, 100.0
MOST_STANDING = 0.25  # fraction of the records
MOST_NAMED = 12  # arches; of more only their number


def cautions_of_cube(study: Study, cube: "xr.Dataset") -> list[str]:
    """All that a study's cube gives reason to caution, levels in the study's unit."""
    levels = [f"{level:.4g} {study.intensity.unit}" for level in study.intensity.given]
    if cube["intensity"].ndim > 1:
        levels = ["levels of their own"]
    names = cube["arch"].values.astype(str).tolist()
    verdict = cube["verdict"].transpose("arch", "record", "level").values
    counts = [undecided(count_verdicts(own), levels) for own in verdict]
    found = [f"{name}: {message}" for name, message in zip(names, counts) if message]
    if cube["intensity"].ndim == 1:
        stand = [standing(own, levels[-1]) for own in verdict]
        found += [f"{name}: {message}" for name, message in zip(names, stand) if message]
    found += doubts(study, members(study, cube.sizes["record"])) + uncorrected(study)
    found += design_cautions(json.loads(cube.attrs.get("archfrag_design", "{}")))
    return found + [each for each in (scaled_far(cube), one_event(cube)) if each]


def one_event(cube: "xr.Dataset") -> str:
    """Message on records that are all of one earthquake; empty if they are not."""
    events = cube["event"].values.astype(str) if "event" in cube else np.array([""])
    if len(events) < 2 or (events != events[0]).any() or not events[0]:
        return ""
    return (
        f"all records are of one earthquake ({events[0]}): what varies from earthquake to "
        "earthquake is neither in the dispersion nor in the bands"
    )


def design_cautions(design: Mapping[str, Any]) -> list[str]:
    """Messages on what a design did not reach, or found against its own assumption."""
    found, against = [], dict[str, tuple[int, int]]()
    for name, note in design.get("arches", {}).items():
        if note.get("why"):
            found.append(
                f"{name}: the median is known to {100 * note['half_width']:.2g} % instead of the "
                f"{100 * design['precision']['theta']:.2g} % wanted: {note['why']}"
            )
        if note.get("contradictions"):
            against[name] = (note["contradictions"], note["checked"])
    if len(against) > MOST_NAMED:
        sums = np.sum(list(against.values()), axis=0).tolist()
        against = {f"{len(against)} arches": (sums[0], sums[1])}
    for name, (count, checked) in against.items():
        found.append(
            f"{name}: {count} of {checked} runs at random contradict the capacity of their "
            "record, which has more than one border then; the lowest level that was found to "
            "cause collapse is taken"
        )
    return found


def standing(verdict: NDArray[np.int8], highest: str) -> str:
    """Message on records that withstand all levels, (n_record, n_level); else empty."""
    known = (verdict != Verdict.NOT_SIMULATED).any(axis=1)
    fell = (verdict == Verdict.COLLAPSED).any(axis=1)
    stood = (verdict[:, -1] == Verdict.STANDING) & ~fell
    if stood.sum() <= MOST_STANDING * known.sum():
        return ""
    if stood.sum() == known.sum():
        return f"no record caused collapse up to {highest}, the highest level; add higher levels"
    return (
        f"{stood.sum()} of {known.sum()} records stand at {highest}, the highest level: theta "
        "rests on the others and on the shape of the curve; add higher levels"
    )


def undecided(counts: VerdictCounts, levels: Sequence[str]) -> str:
    """Message on unfinished and failed runs; empty if at no level they are too many."""
    lost = counts.unfinished + counts.solver_failures
    fraction = lost / np.maximum(counts.runs, 1)
    many = int(np.count_nonzero(fraction > MOST_UNDECIDED))
    if not many:
        return ""
    worst = int(fraction.argmax())
    return (
        f"more than {100 * MOST_UNDECIDED:g} % of the runs are unfinished or failed at {many} of "
        f"{len(levels)} levels (most: {lost[worst]} of {counts.runs[worst]} at {levels[worst]}); "
        "they count neither as collapse nor as survival, and the curve may be off by more than "
        "its band"
    )


def scaled_far(cube: "xr.Dataset") -> str:
    """Message on motions that are scaled too far; empty if there is none."""
    made = cube["verdict"].transpose("arch", "record", "level").values != Verdict.NOT_SIMULATED
    factors = np.broadcast_to(cube["scale_factor"].values, made.shape)
    largest = np.where(made, factors, 0.0).max(axis=(0, 2))
    far, too_far = (int((largest > most).sum()) for most in (MOST_SCALING, FAR_TOO_MUCH))
    if not far:
        return ""
    record = int(largest.argmax())
    worst = f"{largest[record]:,.0f}" if largest[record] >= 100.0 else f"{largest[record]:.3g}"
    noise = f"; of {too_far} by more than {FAR_TOO_MUCH:g}, the noise of a recording as well"
    return (
        f"{far} of {largest.size} motions were run scaled by more than {MOST_SCALING:g} (most: "
        f"{cube['record'].values[record]!s} by {worst}), which makes weak motions "
        "into strong ones of another kind" + (noise if too_far else "")
    )


def accepted_records(cube: "xr.Dataset") -> str:
    """Message on records that the study accepts against a doubt; empty if there is none."""
    doubts = cube["accepted"].values.astype(str) if "accepted" in cube else ()
    listed = zip(cube["record"].values, doubts)
    named = [f"{record!s} ({doubt})" for record, doubt in listed if doubt]
    return f"accepted although something is odd about them: {', '.join(named)}" if named else ""
