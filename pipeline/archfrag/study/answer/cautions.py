"""What a study's cube and curves give reason to caution, before these are used."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.fragility.counts import Verdict, VerdictCounts, count_verdicts
from archfrag.fragility.curve import Fragility
from archfrag.study.answer.curves import Answer
from archfrag.study.checks import uncorrected, unit_warnings
from archfrag.study.file.schema import Study

if TYPE_CHECKING:
    import xarray as xr

MOST_UNDECIDED = 0.05  # fraction of the runs at a level
MOST_SCALING, FAR_TOO_MUCH = 10.0, 100.0
MOST_SURVIVING = 0.25  # fraction of the records
MOST_AGAIN = 0.2  # fraction of the records
LEAST_EVENTS = 4
MOST_NAMED = 12  # arches; of more only their number


def cautions_of_cube(study: Study, cube: "xr.Dataset", answers: Mapping[str, Answer]) -> list[str]:
    """All that a study's cube and curves give reason to caution, levels in the study's unit."""
    on_levels = cube["intensity"].ndim == 1
    levels = [f"{level:.4g} {study.intensity.unit}" for level in study.intensity.given]
    design = json.loads(cube.attrs["archfrag_design"])
    verdicts = cube["verdict"].transpose("arch", "record", "level").values
    own = list(zip(cube["arch"].values.astype(str).tolist(), verdicts))
    if not on_levels:
        levels = ["levels of their own"]
    found = [(name, undecided(count_verdicts(verdict), levels)) for name, verdict in own]
    for name, verdict in own if on_levels else ():
        found.append((name, surviving(verdict, levels[-1])))
        if not study.design.adaptive:
            found.append((name, non_monotone(verdict)))
        found.append((name, coarse_levels(cube["intensity"].values, answers[name].curve)))
    of_arches = [f"{name}: {message}" for name, message in found if message]
    members = study.members(cube.sizes["record"])
    of_study = [*unit_warnings(study, members), *uncorrected(study), *design_cautions(design)]
    return [*of_arches, *of_study, *filter(None, (scaled_far(cube), events_caution(cube)))]


def events_caution(cube: "xr.Dataset") -> str:
    """Message on records that are all of one earthquake, or of two or three; else empty."""
    events = cube["event"].values.astype(str) if "event" in cube else np.array([""])
    names = np.unique(events)
    if len(events) < 2 or names.size >= min(LEAST_EVENTS, len(events)) or not events.all():
        return ""
    if names.size > 1:
        return (
            f"the {len(events)} records are of {names.size} earthquakes, too few to show how "
            "earthquakes differ, so bands may be too narrow; add records of other earthquakes"
        )
    return (
        f"all records are of one earthquake ({events[0]}): dispersion and bands do not include "
        "the variation between earthquakes"
    )


def design_cautions(design: Mapping[str, Any]) -> list[str]:
    """Messages on what a design did not reach, or found against its own assumption."""
    found, against = [], dict[str, tuple[int, int]]()
    for name, note in design.get("arches", {}).items():
        if note.get("why"):
            found.append(
                f"{name}: the median is known to {100 * note['half_width']:.2g} % instead of the "
                f"{100 * design['precision']['theta']:.2g} % requested: {note['why']}"
            )
        if note.get("contradictions"):
            against[name] = (note["contradictions"], note["checked"])
    if len(against) > MOST_NAMED:
        sums = np.sum(list(against.values()), axis=0).tolist()
        against = {f"{len(against)} arches": (sums[0], sums[1])}
    for name, (count, checked) in against.items():
        found.append(
            f"{name}: {count} of {checked} checks near the border contradict the capacity of "
            "their record. Such a record has several borders between survival and collapse; the "
            "search found one of them, not always the lowest. Beta includes the scatter of single "
            "runs"
        )
    return found


def surviving(verdict: NDArray[np.int8], highest: str) -> str:
    """Message on records that survive all levels, (n_record, n_level); else empty."""
    known = (verdict != Verdict.NOT_SIMULATED).any(axis=1)
    collapsed = (verdict == Verdict.COLLAPSED).any(axis=1)
    survived = (verdict[:, -1] == Verdict.STANDING) & ~collapsed
    if survived.sum() <= MOST_SURVIVING * known.sum():
        return ""
    if not collapsed.any():
        return f"no record caused collapse up to {highest}, the highest level; add higher levels"
    return (
        f"{survived.sum()} of {known.sum()} records do not cause collapse at {highest}, the "
        "highest level, so the upper part of the curve is extrapolated; add higher levels"
    )


def non_monotone(verdict: NDArray[np.int8]) -> str:
    """Message on records that collapse below a level that they survive; else empty."""
    known = (verdict != Verdict.NOT_SIMULATED).any(axis=1)
    collapsed = np.maximum.accumulate(verdict == Verdict.COLLAPSED, axis=1)
    again = (collapsed & (verdict == Verdict.STANDING)).any(axis=1)
    if again.sum() <= MOST_AGAIN * known.sum():
        return ""
    return (
        f"{again.sum()} of {known.sum()} records do not cause collapse above a level at which "
        "they did (non-monotone records): near the border a single run proves little, and beta "
        "includes this scatter"
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
        f"the levels next to the median are {spacing:.2g} apart in ln, more than the dispersion "
        f"of {curve.beta:.2g}, whose interval may then be too narrow; add levels near the median"
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
        "they count neither as collapse nor as survival, so the curve may be wrong by more than "
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
    noise = f", {too_far} by more than {FAR_TOO_MUCH:g}, which also scales up their noise"
    return (
        f"{far} of {largest.size} records were scaled up by more than {MOST_SCALING:g} (most: "
        f"{cube['record'].values[record]!s}, by {worst}){noise if too_far else ''}. A weak "
        "motion that is scaled up differs from a strong one (it is shorter and has less "
        "long-period energy); use stronger records"
    )


def accepted_records(cube: "xr.Dataset") -> str:
    """Message on records that the study accepts despite a warning; empty if there is none."""
    waivers = cube["accepted"].values.astype(str) if "accepted" in cube else ()
    listed = zip(cube["record"].values, waivers)
    named = [f"{record!s} ({waived})" for record, waived in listed if waived]
    return f"records accepted despite a warning: {', '.join(named)}" if named else ""
