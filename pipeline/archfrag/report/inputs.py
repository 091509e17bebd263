"""From a finished study to all that its report is written from."""

from pathlib import Path
from typing import Any

import numpy as np

from archfrag.report.page import ReportInputs
from archfrag.report.summary import reading_scale
from archfrag.simulate import onset
from archfrag.study.cautions import cautions_of_cube
from archfrag.study.config import Study
from archfrag.study.cube import read_timings
from archfrag.study.curves import Answer
from archfrag.study.fits import FITS, load_answers, load_fits, open_cube
from archfrag.study.members import members, shown
from archfrag.study.records import load_prepared, load_record
from archfrag.study.steps import require


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
        If results are missing or not those of the study as it is, or its hazard cannot be read.
    OutputError
        If another study's cube is in its folder.
    """
    require(study, "cube")
    require(study, "fit")
    prepared = load_prepared(study)
    with open_cube(study) as opened:
        cube = opened.load()
    answers = load_answers(study.folder / FITS)
    entries = {entry.id: entry for entry in members(study, len(prepared)).entries}
    names = list(answers)
    arches = [(names[i], entries[names[i]].build()) for i in shown(_medians(answers))]
    return ReportInputs(
        cube=cube,
        measure=study.intensity.measure,
        motions=[load_record(study.work, record) for record in prepared],
        arches=[(name, arch, onset(arch)) for name, arch in arches],
        answers=answers,
        classes=load_answers(study.folder / FITS, "classes"),
        cautions=cautions_of_cube(study, cube),
        timings=read_timings(study),
        title=study.title,
        confidence=study.report.confidence,
        beside=None if beside is None else _beside(study, beside),
        at=study.report.at,
        risk=None if study.risk is None else _risk(study),
    )


def _medians(answers: dict[str, Answer]) -> list[float]:
    return [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]


def _beside(study: Study, other: Path) -> Any:
    from archfrag.report.beside import load_beside
    from archfrag.study.config import load_study

    return load_beside(study, load_study(other))


def _risk(study: Study) -> dict[str, Any] | None:
    from archfrag.report.risk_section import risk_section
    from archfrag.study.hazard import load_hazard
    from archfrag.study.risk import risk_of

    given, measure = study.risk, study.intensity.measure
    assert given is not None
    hazard = load_hazard(Path(given.hazard), measure, given.unit, given.site)
    with open_cube(study) as cube:
        fits = load_fits(study.folder / FITS)
        found = risk_of(cube, fits, hazard, given.years, study.report.confidence)
        return risk_section(found, reading_scale(cube, measure))
