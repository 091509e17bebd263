"""What can be known to be wrong with a study before anything is computed."""

import contextlib
import errno
import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError, OutputError, StudyError
from archfrag.files import cannot_write, counted
from archfrag.study.file.members import (
    Members,
    check_buildable,
    check_standing,
    needs_records,
)
from archfrag.study.file.records import is_raw, measured, read_manifest, read_sources, study_inputs
from archfrag.study.file.schema import Study
from archfrag.study.files import read_owner, refuse_foreign_cube

# Beyond these a unit may have been mistaken: friction, size [m], levels over the onset.
MOST_FRICTION, LARGEST, FAR_BEYOND = 2.0, 300.0, 10.0
MOST_ASKED = 12  # arches, records
CORRECTING = {"detrend", "bandpass", "baseline", "response"}  # steps of processing


def check_arches(study: Study, n_record: int = 1) -> Members:
    """See that all arches of a study can exist and stand under their own weight."""
    found = study.members(n_record)
    check_buildable(found)
    check_standing(found)
    return found


def _check_some(found: Members) -> int:
    """Check arches as `check_arches`, of very many only some; how many."""
    some = found.checked()
    check_standing(some)
    return len(some)


def uncorrected(study: Study) -> tuple[str, ...]:
    """Message on prepared records that are raw and not corrected by the study either."""
    with contextlib.suppress(InputError):
        records = read_manifest(study)["records"]
        raw = [record["id"] for record in records if record.get("raw")]
        return _uncorrected(study, raw, len(records))
    return ()


def _uncorrected(study: Study, raw: list[str], total: int) -> tuple[str, ...]:
    if not raw or CORRECTING & {step.name for step in study.motions.processing}:
        return ()
    more = f" and {len(raw) - MOST_ASKED} more" if len(raw) > MOST_ASKED else ""
    return (
        f"{len(raw)} of {counted(total, 'record')} raw, as recorded ("
        f"{', '.join(raw[:MOST_ASKED])}{more}): their drift is taken for motion; correct them by "
        "motions.processing, such as [detrend, {bandpass: {lowest: 0.1, highest: 25}}]",
    )


def unit_warnings(study: Study, found: Members) -> tuple[str, ...]:
    """What can be, but so rarely that a unit may have been mistaken; of the first arches."""
    from archfrag.simulate import onset

    levels = np.array(study.intensity.si) / STANDARD_GRAVITY
    onset_counts = study.intensity.measure == "PGA" and not study.motions.vertical
    messages = []
    for member in list(found)[:MOST_ASKED]:
        arch = member.entry.build()
        friction = max(filter(math.isfinite, arch.chain.friction.tolist()), default=0.0)
        size = float(np.ptp(arch.chain.centroid, axis=0).max())
        start = onset(arch)
        least = min(start.plus, start.minus)
        for wrong, text in (
            (friction > MOST_FRICTION, f"friction {friction:.3g} is a coefficient beyond that of "
             "any masonry; was an angle meant?"),
            (size > LARGEST, f"the arch is {size:.0f} m large; lengths are in m"),
            (onset_counts and levels.max() <= least, "no level is above the onset of motion "
             f"({least:.3g} g); is their unit right?"),
            (onset_counts and levels.min() > FAR_BEYOND * least, "all levels are more than "
             f"{FAR_BEYOND:.0f} times the onset of motion ({least:.3g} g); is their unit right?"),
        ):  # fmt: skip
            messages += [f"{member.id}: {text}"] if wrong else []
    return tuple(messages)


def check_start(study: Study) -> None:
    """See that the last step will have what it needs: a hazard, and a folder to write to."""
    if (risk := study.risk) is not None:
        from archfrag.study.file.hazard import load_hazard

        load_hazard(Path(risk.hazard), study.intensity.measure, risk.unit, risk.site)
    check_output(study)


def check_output(study: Study) -> None:
    """See that the output folder can be written and is no other study's; nothing is created."""
    _check_writable(study.folder)
    refuse_foreign_results(study)


def refuse_foreign_results(study: Study) -> None:
    """See that the output folder holds no results of another study."""
    refuse_foreign_cube(study)
    owner = read_owner(study).get("id", study.id)
    if owner != study.id:
        whose = f"holds results of study {owner!r}, not of study {study.id!r}"
        raise OutputError(f"{study.folder}: {whose}; give the studies different output folders")


def _check_writable(folder: Path) -> None:
    try:
        place = next(path for path in (folder, *folder.parents) if path.exists())
    except OSError as error:
        raise cannot_write(folder, error) from error
    code = 0
    if not place.is_dir():
        code = errno.ENOTDIR
    elif not os.access(place, os.W_OK | os.X_OK):
        code = errno.EROFS if os.statvfs(place).f_flag & os.ST_RDONLY else errno.EACCES
    if code:
        raise cannot_write(folder, OSError(code, os.strerror(code)))


@dataclass(frozen=True)
class Summary:
    """What a study amounts to."""

    study: str
    arches: int
    records: int
    levels: int
    design: str  # its kind
    runs: int  # by the study's own method
    extent: str = "exactly"  # what is meant by `runs`: exactly, about, or at most so many
    classes: tuple[str, ...] = ()  # of arches that were drawn or come from a table
    cautions: tuple[str, ...] = ()  # what is possible but doubtful
    partners: tuple[str, ...] = ()  # files of records that are put together from several

    def __str__(self) -> str:
        """All but the name in one line."""
        runs = f"{self.extent} {counted(self.runs, 'run')}".removeprefix("exactly ")
        parts = ((self.arches, "arch"), (self.records, "record"), (self.levels, "level"))
        text = ", ".join([counted(*part) for part in parts] + [runs])
        if self.design != "stripes":
            text += f" by design {self.design}"
        return text


def check_study(study: Study) -> Summary:
    """Check all of a study without running it: arches stand, records are read and scaled."""
    check_start(study)
    # Arches that each record has of its own are known once the records are.
    if not needs_records(study.arches):
        _check_some(study.members())
    study_inputs(study)
    raw, partners = {}, []
    for motion in read_sources(study):
        measured(motion, study)
        raw[motion.id], about = is_raw(motion), motion.metadata
        others = [about.get("file_transverse"), about.get("vertical_file")]
        used = " and ".join(name for name in others if name and name != about["file"])
        partners += [f"{about['file']} with {used}"] if used else []
    records = len(raw)
    if not records:
        raise StudyError("motions: the study has no record")
    found = study.members(records)
    unchecked = len(found) - _check_some(found)
    design, levels = study.design, len(study.intensity.si)
    met, arches = np.unique(found.meets(records).sum(axis=1), return_counts=True)
    each = [design.size(int(count), levels) for count in met]
    runs = sum(size * n for (size, _), n in zip(each, arches.tolist()))
    cautions = unit_warnings(study, found)
    cautions += _uncorrected(study, [name for name in raw if raw[name]], records)
    if unchecked:
        left = f"{unchecked} of {len(found)} arches were not checked"
        cautions += (f"{left}; the run checks all of them before it simulates",)
    return Summary(
        study.id, len(found), records, levels, design.kind, runs, each[0][1],
        found.summaries(), cautions, tuple(partners),
    )  # fmt: skip
