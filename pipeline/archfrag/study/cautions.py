"""What must be known before a curve is used: runs that decide nothing, motions scaled far."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.study.config import Study
from archfrag.study.fits import open_cube

if TYPE_CHECKING:
    import xarray as xr

MOST_UNDECIDED = 0.05  # fraction of the runs at a level
MOST_SCALING = 10.0
MOST_NAMED = 12  # arches; of more only their number


def study_cautions(study: Study) -> list[str]:
    """All that a study's cube gives reason to caution, levels in the study's unit."""
    with open_cube(study) as cube:
        return cautions_of_cube(study, cube)


def cautions_of_cube(study: Study, cube: "xr.Dataset") -> list[str]:
    """`study_cautions` of a cube that is available."""
    levels = [f"{level:.4g} {study.intensity.unit}" for level in study.intensity.given]
    if cube["intensity"].ndim > 1:
        levels = ["levels of their own"]
    names = cube["arch"].values.astype(str).tolist()
    found = [
        f"{name}: {message}"
        for number, name in enumerate(names)
        if (message := undecided(_counts(cube, number), levels))
    ]
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


def _counts(cube: "xr.Dataset", arch: int) -> VerdictCounts:
    return count_verdicts(cube["verdict"].isel(arch=arch).transpose("record", "level").values)


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
    far = int(np.count_nonzero(largest > MOST_SCALING))
    if not far:
        return ""
    record = int(largest.argmax())
    return (
        f"{far} of {largest.size} motions are scaled by more than {MOST_SCALING:g} (most: "
        f"{cube['record'].values[record]!s} by {largest[record]:.3g}), which makes weak motions "
        "into strong ones of another kind"
    )


def accepted_records(cube: "xr.Dataset") -> str:
    """Message on records that the study accepts against a doubt; empty if there is none."""
    if "accepted" not in cube:
        return ""
    named = [
        f"{record!s} ({doubt})"
        for record, doubt in zip(cube["record"].values, cube["accepted"].values.astype(str))
        if doubt
    ]
    return f"accepted although something is odd about them: {', '.join(named)}" if named else ""
