"""From a finished study to all that its report is written from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from archfrag.errors import InputError, attempt
from archfrag.simulate import Onset, onset
from archfrag.study.config import Study, load_study
from archfrag.study.cube import read_timings
from archfrag.study.curves import Answer, quoted
from archfrag.study.fits import FITS, cautions_of_cube, load_answers, open_cube
from archfrag.study.members import members, shown
from archfrag.study.records import load_prepared, load_record
from archfrag.study.steps import require

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.arch import Arch
    from archfrag.motions.motion import Motion
    from archfrag.study.risk import StudyRisk


@dataclass(frozen=True)
class ReportInputs:
    """Everything a report is written from."""

    cube: "xr.Dataset"  #: of the study
    measure: str  #: name of the intensity measure of the cube's levels, e.g. "PGA"
    motions: "Sequence[Motion]"  #: unscaled, one for each record of the cube, its name as `id`
    #: Name in the cube, geometry and onset of each arch that has a section, in the page's order.
    arches: "Sequence[tuple[str, Arch, Onset]]"
    answers: Mapping[str, Answer]  #: of each arch of the cube, theta in the SI unit
    classes: Mapping[str, Answer] = field(default_factory=dict)  #: of classes of several arches
    #: What must be known before a curve is used; what concerns one arch begins with its name and a
    #: colon.
    cautions: Sequence[str] = ()
    #: Wall time of each run of an arch, or of groups of them [s].
    timings: Mapping[str, Sequence[float]] | None = None
    title: str = "Fragility of masonry arches"
    confidence: float = 0.9  #: of all bands and intervals
    #: Cube and answers of another study with the same measure, to be compared in common arches.
    beside: "tuple[xr.Dataset, Mapping[str, Answer]] | None" = None
    at: float | None = None  #: level at which the probability is wanted, in the study's unit
    risk: "StudyRisk | str | None" = None  #: or why there are no rates


def report_inputs(study: Study, beside: Path | None = None) -> ReportInputs:
    """Results of a study, for `archfrag.report.page.write_report`.

    Parameters
    ----------
    study : Study
    beside : Path, optional
        Study file of another, finished study.

    Raises
    ------
    InputError
        If results are missing or not those of the study as it is.
    OutputError
        If another study's cube is in its folder.
    """
    require(study, "cube")
    require(study, "fit")
    prepared = load_prepared(study)
    with open_cube(study) as opened:
        cube = opened.load()
    answers, classes = (load_answers(study.folder / FITS, of) for of in ("arches", "classes"))
    entries = {entry.id: entry for entry in members(study, len(prepared)).entries}
    medians = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]
    names = [list(answers)[i] for i in shown(medians)]
    arches = [(name, entries[name].build()) for name in names]
    return ReportInputs(
        cube=cube,
        measure=study.intensity.measure,
        motions=[load_record(study.work, record) for record in prepared],
        arches=[(name, arch, onset(arch)) for name, arch in arches],
        answers=answers,
        classes=classes,
        cautions=cautions_of_cube(study, cube, answers),
        timings=read_timings(study),
        title=study.title,
        confidence=study.report.confidence,
        beside=None if beside is None else _beside(study, beside),
        at=study.report.at,
        risk=attempt(partial(_risk, study, cube, quoted(cube, answers, classes))),
    )


def _beside(study: Study, path: Path) -> "tuple[xr.Dataset, Mapping[str, Answer]]":
    other = load_study(path)
    refused = f"study {other.id!r} cannot be shown beside {study.id!r}"
    if study.id == other.id:
        raise InputError(f"{refused}: each study needs its own id")
    try:
        require(other, "cube")
        require(other, "fit")
        with open_cube(other) as cube:
            return cube.load(), load_answers(other.folder / FITS)
    except InputError as error:
        raise InputError(f"{refused}, since it is not finished: {error}") from error


def _risk(study: Study, cube: "xr.Dataset", answers: Mapping[str, Answer]) -> "StudyRisk | None":
    from archfrag.study.hazard import load_hazard
    from archfrag.study.risk import risk_of

    given = study.risk
    if given is None:
        return None
    hazard = load_hazard(Path(given.hazard), study.intensity.measure, given.unit, given.site)
    fits = {name: answer.curve for name, answer in answers.items()}
    return risk_of(cube, fits, hazard, given.years, study.report.confidence)
