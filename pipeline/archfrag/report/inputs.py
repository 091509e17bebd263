"""What the report of a finished study is written from, and its numbers for programs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from archfrag.arch import Arch
from archfrag.errors import InputError, attempt
from archfrag.fragility.counts import Verdict, count_verdicts
from archfrag.fragility.curve import Fragility
from archfrag.mechanics.status import CollapseMode
from archfrag.motions.motion import Motion
from archfrag.report.results import Scale, reading_scale, study_config
from archfrag.simulate import Onset, onset
from archfrag.study.answer.cautions import cautions_of_cube
from archfrag.study.answer.curves import Answer, arch_classes, quoted
from archfrag.study.answer.fits import FITS, load_answers, open_cube
from archfrag.study.answer.risk import StudyRisk, risk_of
from archfrag.study.file.hazard import load_hazard
from archfrag.study.file.members import shown
from archfrag.study.file.records import load_prepared, load_record
from archfrag.study.file.schema import Study, load_study
from archfrag.study.provenance import finite
from archfrag.study.steps import read_timings, require

SUMMARY_FORMAT = "archfrag-summary/2"
_MADE_BY = ("archfrag_commit", "archfrag_versions", "archfrag_plan", "archfrag_machine", "source")


@dataclass(frozen=True)
class ReportInputs:
    """Everything a report is written from."""

    cube: xr.Dataset  #: of the study
    measure: str  #: name of the intensity measure of the cube's levels, e.g. "PGA"
    motions: Sequence[Motion]  #: unscaled, one for each record of the cube, its name as `id`
    #: Name in the cube, geometry and onset of each arch that has a section, in the page's order.
    arches: Sequence[tuple[str, Arch, Onset]]
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
    compared: tuple[xr.Dataset, Mapping[str, Answer]] | None = None
    at: float | None = None  #: level at which the probability is wanted, in the study's unit
    risk: StudyRisk | str | None = None  #: or why there are no rates


def report_inputs(study: Study, compared: Path | None = None) -> ReportInputs:
    """Results of a study, for `archfrag.report.page.write_report`.

    Parameters
    ----------
    study : Study
    compared : Path, optional
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
    entries = {entry.id: entry for entry in study.members(len(prepared)).entries}
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
        compared=None if compared is None else _compared(study, compared),
        at=study.report.at,
        risk=attempt(partial(_risk, study, cube, quoted(cube, answers, classes))),
    )


def _compared(study: Study, path: Path) -> tuple[xr.Dataset, Mapping[str, Answer]]:
    other = load_study(path)
    refused = f"study {other.id!r} cannot be compared with {study.id!r}"
    if study.id == other.id:
        raise InputError(f"{refused}: each study needs its own id")
    try:
        require(other, "cube")
        require(other, "fit")
        with open_cube(other) as cube:
            return cube.load(), load_answers(other.folder / FITS)
    except InputError as error:
        raise InputError(f"{refused}, since it is not finished: {error}") from error


def _risk(study: Study, cube: xr.Dataset, answers: Mapping[str, Answer]) -> StudyRisk | None:
    given = study.risk
    if given is None:
        return None
    hazard = load_hazard(Path(given.hazard), study.intensity.measure, given.unit, given.site)
    fits = {name: answer.curve for name, answer in answers.items()}
    return risk_of(cube, fits, hazard, given.years, study.report.confidence)


def summary(inputs: ReportInputs) -> dict[str, Any]:
    """Content of ``summary.json``.

    Keys: ``format``; ``study`` and ``title``; ``measure``, ``unit`` (of all levels here) and
    ``unit_in_si``; ``confidence`` of all intervals; ``level`` that probabilities are given at, or
    null; ``design``, as in the cube; ``records``, ``levels``; ``arches``, of each ``id``,
    ``class``, ``curve``, ``reason``, ``probability``, ``counts`` of runs by verdict,
    ``mechanisms`` (fraction of the collapses by mode and by joint), and ``onset`` [g] (null: no
    limit, or it does not stand, see ``stands``; both null where the arch was not built for the
    report); ``classes``, of each ``id``, ``curve``, ``reason``, ``probability``, ``arches`` and
    ``dispersion``; ``cautions``; and ``made_by``, versions and digests. What is not known is
    null.

    ``without_verdict`` of an arch or a class is null if every run collapsed or stands; else it has
    ``runs``, the number of those that do not, and ``theta_if``: theta if all of them were
    ``collapsed``, or all ``standing``.

    The curve of a class is the mean of those of its arches; its ``theta`` and ``beta`` are those
    of the lognormal curve with the same mean and standard deviation of ln capacity.
    ``dispersion`` holds the parts of that ``beta``.

    A ``curve`` has ``theta``, ``beta``, ``theta_interval``, ``beta_interval``, ``method`` and
    ``assumptions`` of curve and band, ``independent`` (records or runs that the data are worth),
    ``islands`` (runs against the capacity of their record), ``kind``, and
    ``maximum_likelihood``: ``theta``, ``beta`` and ``kind``, or null.
    """
    cube, attributes = inputs.cube, inputs.cube.attrs
    scale, of_class = reading_scale(cube, inputs.measure), arch_classes(cube)
    onsets = {name: onset for name, _, onset in inputs.arches}
    of_runs = ("verdict", "lost_contact_time", "collapse_mode", "collapse_joint")
    tables = [cube[name].transpose("arch", "record", "level").values for name in of_runs]
    arches = []
    for name, *own in zip(map(str, cube["arch"].values), *tables, strict=True):
        start = onsets.get(name)
        arches.append({
            "id": name, "class": of_class[name],
            **_answered(inputs.answers[name], scale, inputs.at), **_runs(*own),
            "stands": start and bool(start.stands),
            "onset": start and {"plus": start.plus, "minus": start.minus},
        })  # fmt: skip
    classes = [
        {
            "id": name, "arches": list(of_class.values()).count(name),
            **_answered(answer, scale, inputs.at), "dispersion": answer.more.get("dispersion"),
        }
        for name, answer in inputs.classes.items()
    ]  # fmt: skip
    found: dict[str, Any] = finite({
        "format": SUMMARY_FORMAT,
        "study": attributes.get("archfrag_study") or study_config(cube).get("id"),
        "title": inputs.title,
        "measure": scale.measure, "unit": scale.unit, "unit_in_si": 1.0 / scale.factor,
        "confidence": inputs.confidence, "level": inputs.at,
        "design": str(attributes.get("archfrag_design_kind", "stripes")),
        "records": cube.sizes["record"], "levels": cube.sizes["level"],
        "arches": arches, "classes": classes,
        "cautions": list(inputs.cautions),
        "made_by": {key: attributes[key] for key in _MADE_BY if key in attributes},
    }, None)  # fmt: skip
    return found


def _answered(answer: Answer, scale: Scale, at: float | None) -> dict[str, Any]:
    """Curve and probability of an arch or a class, or the reason why there is none."""
    lost = answer.more.get("without_verdict") or None
    if lost and "runs" in lost:
        medians = {key: lost[key].get("theta") for key in ("collapsed", "standing")}
        theta = {key: each and scale.factor * each for key, each in medians.items()}
        lost = {"runs": lost["runs"], "theta_if": theta}
    fit, likelihood = answer.curve, answer.likelihood
    found = {"reason": None, "without_verdict": lost}
    if isinstance(fit, str):
        return found | {"curve": None, "reason": fit, "probability": None}
    probability = None
    if at is not None:
        value, *ends = answer.probability(at / scale.factor)
        probability = {"level": at, "value": value, "interval": ends}
    likeliest = None
    if isinstance(likelihood, Fragility):
        theta_most = scale.factor * likelihood.theta
        likeliest = {"theta": theta_most, "beta": likelihood.beta, "kind": likelihood.kind}
    curve = {
        "theta": scale.factor * fit.theta,
        "theta_interval": [scale.factor * end for end in answer.theta],
        "beta": fit.beta, "beta_interval": list(answer.beta),
        "method": answer.method, "assumptions": answer.assumptions,
        "independent": answer.n_independent, "islands": answer.n_islands,
        "kind": fit.kind, "maximum_likelihood": likeliest,
    }  # fmt: skip
    return found | {"curve": curve, "probability": probability}


def _runs(verdict: NDArray, lost: NDArray, mode: NDArray, joint: NDArray) -> dict[str, Any]:
    """Counts and mechanisms of the runs of an arch."""
    found, fell = count_verdicts(verdict), verdict == Verdict.COLLAPSED
    names = ("runs", "collapsed", "standing", "unfinished", "solver_failures")
    counts = {name: int(getattr(found, name).sum()) for name in names}
    counts["not_simulated"] = verdict.size - counts["runs"]
    stood = (verdict == Verdict.STANDING) & np.isfinite(lost)
    counts["lost_contact_and_stand"] = int(stood.sum())
    modes = [CollapseMode(code).name.lower() for code in mode[fell]]
    mechanisms = {
        kind: {str(k): round(n / len(codes), 6) for k, n in sorted(Counter(codes).items())}
        for kind, codes in (("mode", modes), ("joint", joint[fell].tolist()))
    }
    return {"counts": counts, "mechanisms": mechanisms}
