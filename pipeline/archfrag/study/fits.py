"""From the cube of a study to its fragility curves, and what to know before these are used."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import FitError, InputError, attempt
from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.fragility.curve import Fragility
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
    """Find the curve of each arch and class of the cube and store all in ``fits.json``.

    All numbers are in SI; the text of an error names levels in the unit of the study.
    """
    confidence, keys = study.report.confidence, study.limit_states.model_dump()
    worded = partial(FitError.worded, factor=study.intensity.factor, unit=study.intensity.unit)

    def part(make: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
        found = attempt(partial(make, *arguments), worded)
        return {"none": found} if isinstance(found, str) else found

    with open_cube(study) as cube:
        runs = curves.runs_of_cube(cube.load())
        own = [(cube.isel(arch=number), each) for number, each in enumerate(runs)]
        answers = {each.name: curves.answer(each, confidence, worded) for each in runs}
        medians = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]
        for number in shown(medians):
            one, each = own[number]
            more = answers[each.name].more
            more["free"] = part(comparisons.free_shapes, each, confidence, worded)
            more["measures"] = part(comparisons.measures_compared, one, each)
            more["limit_states"] = part(comparisons.limit_states, [own[number]], keys, worded)
            if each.design == "cloud":
                more["cloud"] = part(comparisons.cloud_curves, one, each, confidence, worded)
        for each in runs:
            found = part(curves.without_verdict, each, confidence, worded)
            answers[each.name].more["without_verdict"] = found
        classes = {}
        for name, (group, places) in curves.classes_of_cube(cube, runs).items():
            members = [answers[runs[i].name] for i in places]
            classes[name] = curves.of_class(curves.answer(group, confidence, worded), members)
            split = {}
            if not isinstance(curve := classes[name].curve, str):
                alone = [runs[i] for i in places]
                split = part(comparisons.dispersion_split, alone, members, curve.beta)
            states = part(comparisons.limit_states, [own[i] for i in places], keys, worded)
            states["states"] = [s for s in states.get("states", ()) if s["name"] != "collapse"]
            lost = part(curves.without_verdict, group, confidence, worded)
            classes[name].more.update(dispersion=split, limit_states=states, without_verdict=lost)
        unit = cube["intensity"].attrs["units"]
        design = json.loads(cube.attrs["archfrag_design"])
    plain, of_classes = (
        {name: each.to_dict() for name, each in some.items()} for some in (answers, classes)
    )
    content = {
        "study": study.id, "measure": study.intensity.measure, "unit": unit, "design": design,
        "fits": {name: each["curve"] for name, each in plain.items()},
        "arches": plain, "classes": of_classes,
    }  # fmt: skip
    text = json.dumps(finite(content, None), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(study.folder / FITS, text + "\n")
    return {name: Answer.from_dict(each) for name, each in plain.items()}


def lost_text(found: Answer, median: Callable[[float], str]) -> str:
    """What the runs without a verdict could change; empty if there are none."""
    lost = found.more.get("without_verdict") or {}
    if "runs" not in lost:
        return ""
    ends = [
        f"{median(curve['theta']) if 'theta' in curve else 'not known'} if {verb}"
        for curve, verb in ((lost["collapsed"], "all collapse"), (lost["standing"], "all stand"))
    ]
    runs = "1 run has" if lost["runs"] == 1 else f"{lost['runs']} runs have"
    return f"{runs} no verdict: the median is {ends[0]}, {ends[1]}"


def _median(study: Study, theta: float) -> str:
    return f"{theta / study.intensity.factor:.4g} {study.intensity.unit}"


def fit_text(study: Study, name: str, found: Answer) -> str:
    """A curve in the unit of the study, or why there is none."""
    lost = lost_text(found, partial(_median, study))
    lost = f"; {lost}" if lost else ""
    if isinstance(found.curve, str):
        return f"{name}: no curve: {found.curve}{lost}"
    factor, percent = study.intensity.factor, f"{100 * found.confidence:g} %"
    theta, low, high = (value / factor for value in (found.curve.theta, *found.theta))
    return (
        f"{name}: median {theta:.4g} {study.intensity.unit} of {study.intensity.measure} "
        f"({percent}: {low:.4g} to {high:.4g}), dispersion {found.curve.beta:.3g} "
        f"({found.beta[0]:.3g} to {found.beta[1]:.3g}){lost}"
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
MOST_AGAIN = 0.2  # fraction of the records
LEAST_EVENTS = 4
MOST_NAMED = 12  # arches; of more only their number


def cautions_of_cube(study: Study, cube: "xr.Dataset", answers: Mapping[str, Answer]) -> list[str]:
    """All that a study's cube and curves give reason to caution, levels in the study's unit."""
    levels = [f"{level:.4g} {study.intensity.unit}" for level in study.intensity.given]
    if cube["intensity"].ndim > 1:
        levels = ["levels of their own"]
    names = cube["arch"].values.astype(str).tolist()
    verdict = cube["verdict"].transpose("arch", "record", "level").values
    counts = [undecided(count_verdicts(own), levels) for own in verdict]
    found = [f"{name}: {message}" for name, message in zip(names, counts) if message]
    if cube["intensity"].ndim == 1:
        stripes = cube.attrs.get("archfrag_design_kind") == "stripes"
        for name, own in zip(names, verdict):
            messages = [
                standing(own, levels[-1]),
                standing_again(own) if stripes else "",
                coarse_levels(cube["intensity"].values, answers[name].curve),
            ]
            found += [f"{name}: {message}" for message in messages if message]
    found += doubts(study, members(study, cube.sizes["record"])) + uncorrected(study)
    found += design_cautions(json.loads(cube.attrs.get("archfrag_design", "{}")))
    return found + [each for each in (scaled_far(cube), events_caution(cube)) if each]


def events_caution(cube: "xr.Dataset") -> str:
    """Message on records that are all of one earthquake, or of two or three; else empty."""
    events = cube["event"].values.astype(str) if "event" in cube else np.array([""])
    names = np.unique(events)
    if len(events) < 2 or names.size >= min(LEAST_EVENTS, len(events)) or not events.all():
        return ""
    if names.size > 1:
        return (
            f"the {len(events)} records are of {names.size} earthquakes, which hardly show how "
            "earthquakes differ: bands may hold the truth less often than stated; add records of "
            "other earthquakes"
        )
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
            f"{name}: {count} of {checked} checks near the border contradict the capacity of "
            "their record, which has several borders between standing and collapse then; "
            "the search found one of them, not always the lowest, and beta includes the scatter "
            "of single runs"
        )
    return found


def standing(verdict: NDArray[np.int8], highest: str) -> str:
    """Message on records that withstand all levels, (n_record, n_level); else empty."""
    known = (verdict != Verdict.NOT_SIMULATED).any(axis=1)
    fell = (verdict == Verdict.COLLAPSED).any(axis=1)
    stood = (verdict[:, -1] == Verdict.STANDING) & ~fell
    if stood.sum() <= MOST_STANDING * known.sum():
        return ""
    if not fell.any():
        return f"no record caused collapse up to {highest}, the highest level; add higher levels"
    count = f"{stood.sum()} of {known.sum()} records stand at {highest}, the highest level"
    return f"{count}: theta rests on the others and on the shape of the curve; add higher levels"


def standing_again(verdict: NDArray[np.int8]) -> str:
    """Message on records that are not monotone, (n_record, n_level); else empty."""
    known = (verdict != Verdict.NOT_SIMULATED).any(axis=1)
    fell = np.maximum.accumulate(verdict == Verdict.COLLAPSED, axis=1)
    again = (fell & (verdict == Verdict.STANDING)).any(axis=1)
    if again.sum() <= MOST_AGAIN * known.sum():
        return ""
    return (
        f"{again.sum()} of {known.sum()} records stand again above a level at which they "
        "collapsed (non-monotone records): near the border a single run decides little; beta "
        "includes this scatter of single runs"
    )


def coarse_levels(levels: NDArray[np.float64], curve: Fragility | str) -> str:
    """Message on levels farther apart at the median than the dispersion, in ln; else empty."""
    if isinstance(curve, str) or len(levels) < 2:
        return ""
    above = int(np.clip(np.searchsorted(levels, curve.theta), 1, len(levels) - 1))
    spacing = float(np.log(levels[above] / levels[above - 1]))
    if spacing <= curve.beta:
        return ""
    return (
        f"the levels beside the median are {spacing:.2g} apart in ln, more than the dispersion of "
        f"{curve.beta:.2g}, whose interval may hold the truth less often than stated; add levels "
        "near the median"
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
