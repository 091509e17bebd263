"""What can be known to be wrong with a study before anything is computed."""

import errno
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import OutputError, StudyError
from archfrag.study.config import Study, load_study
from archfrag.study.cube import refuse_foreign_cube
from archfrag.study.files import cannot_write
from archfrag.study.members import (
    ClassSummary,
    Members,
    check_buildable,
    check_standing,
    members,
    needs_records,
    summaries,
)
from archfrag.study.records import measured, read_sources, study_inputs

STUDY_FILE = "study.yaml"


def check_arches(study: Study, n_record: int = 1) -> Members:
    """See that all arches of a study can exist and stand under their own weight.

    Parameters
    ----------
    study : Study
    n_record : int
        Its records, where each meets arches of its own.

    Returns
    -------
    Members
        The arches.

    Raises
    ------
    StudyError
        Naming the first that cannot exist.
    StabilityError
        Naming the first that does not stand, and how many samples of its class do not.
    """
    found = members(study, n_record)
    check_buildable(found)
    check_standing(found)
    return found


def check_output(study: Study) -> None:
    """See that the output folder can be written and is no other study's; nothing is created.

    Raises
    ------
    OutputError
        Naming the folder, and the other study.
    """
    _check_writable(study.folder)
    refuse_foreign_cube(study)
    resolved = study.work / STUDY_FILE
    if not resolved.exists():
        return
    try:
        owner = load_study(resolved).id
    except StudyError:
        return
    if owner != study.id:
        raise OutputError(
            f"{study.folder}: holds results of study {owner!r}, in the way of study {study.id!r}; "
            "give the studies different output folders"
        )


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
    runs: int  # at most, where the design decides
    design: str
    classes: tuple[ClassSummary, ...]  # of arches that were drawn or come from a table


def _most_runs(study: Study, records: NDArray[np.int64]) -> int:
    """Runs that the design may ask for, from the records of each arch."""
    design, grid = study.design, int(records.sum()) * len(study.intensity.si)
    if design.kind == "cloud":
        return int(records.sum())
    if design.kind == "scattered":
        most = design.runs if design.precision is None else design.precision.runs
        return int(np.minimum(records, most).sum())
    return 2 * grid if design.kind == "two_stage" else grid


def check_study(study: Study) -> Summary:
    """Check all of a study without running it: arches stand, records are read and scaled.

    Raises
    ------
    StudyError, RecordError, StabilityError, OutputError
        With the first thing that is wrong.
    """
    found = check_arches(study)
    study_inputs(study)
    records = 0
    for motion in read_sources(study):
        measured(motion, study)
        records += 1
    if not records:
        raise StudyError("motions: the study has no record")
    if needs_records(study.arches):
        found = check_arches(study, records)
    check_output(study)
    levels = len(study.intensity.si)
    runs = _most_runs(study, found.meets(records).sum(axis=1))
    return Summary(
        study.id, len(found), records, levels, runs, study.design.kind, summaries(found)
    )
