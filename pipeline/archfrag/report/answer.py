"""The answer of a study as data, for ``summary.json``."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import Fragility
from archfrag.mechanics.status import CollapseMode
from archfrag.report.inputs import ReportInputs
from archfrag.report.summary import Scale, study_config
from archfrag.study.curves import Answer, arch_classes

SUMMARY_FORMAT = "archfrag-summary/2"
_MADE_BY = ("archfrag_commit", "archfrag_versions", "archfrag_plan", "archfrag_machine", "source")


def summary(inputs: ReportInputs, scale: Scale) -> dict[str, Any]:
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
    of_class = arch_classes(cube)
    onsets = {name: onset for name, _, onset in inputs.arches}
    arches = [
        {
            "id": name, "class": of_class[name],
            **_answered(inputs.answers[name], scale, inputs.at), **runs,
            "stands": bool(onsets[name].stands) if name in onsets else None,
            "onset": {side: getattr(onsets[name], side) for side in ("plus", "minus")}
            if name in onsets else None,
        }
        for name, runs in _runs(cube)
    ]  # fmt: skip
    of_classes = [
        {
            "id": name, "arches": list(of_class.values()).count(name),
            **_answered(answer, scale, inputs.at), "dispersion": answer.more.get("dispersion"),
        }
        for name, answer in inputs.classes.items()
    ]  # fmt: skip
    found: dict[str, Any] = _plain({
        "format": SUMMARY_FORMAT,
        "study": attributes.get("archfrag_study") or study_config(cube).get("id"),
        "title": inputs.title,
        "measure": scale.measure, "unit": scale.unit, "unit_in_si": 1.0 / scale.factor,
        "confidence": inputs.confidence, "level": inputs.at,
        "design": str(attributes.get("archfrag_design_kind", "stripes")),
        "records": cube.sizes["record"], "levels": cube.sizes["level"],
        "arches": arches, "classes": of_classes,
        "cautions": list(inputs.cautions),
        "made_by": {key: attributes[key] for key in _MADE_BY if key in attributes},
    })  # fmt: skip
    return found


def _answered(answer: Answer, scale: Scale, at: float | None) -> dict[str, Any]:
    """Curve and probability of an arch or a class, or the reason why there is none."""
    lost = answer.more.get("without_verdict") or None
    if lost and "runs" in lost:
        medians = {key: lost[key].get("theta") for key in ("collapsed", "standing")}
        theta = {key: each and scale.factor * each for key, each in medians.items()}
        lost = {"runs": lost["runs"], "theta_if": theta}
    found = {"reason": None, "without_verdict": lost}
    if isinstance(answer.curve, str):
        return found | {"curve": None, "reason": answer.curve, "probability": None}
    probability = None
    if at is not None:
        value, *ends = answer.probability(at / scale.factor)
        probability = {"level": at, "value": value, "interval": ends}
    likelihood = None
    if isinstance(answer.likelihood, Fragility):
        fit = answer.likelihood
        likelihood = {"theta": scale.factor * fit.theta, "beta": fit.beta, "kind": fit.kind}
    curve = {
        "theta": scale.factor * answer.curve.theta,
        "theta_interval": [scale.factor * end for end in answer.theta],
        "beta": answer.curve.beta,
        "beta_interval": list(answer.beta),
        "method": answer.method,
        "assumptions": answer.assumptions,
        "independent": answer.n_independent,
        "islands": answer.n_islands,
        "kind": answer.curve.kind,
        "maximum_likelihood": likelihood,
    }
    return found | {"curve": curve, "probability": probability}


def _runs(cube: xr.Dataset) -> Iterator[tuple[str, dict[str, Any]]]:
    """Counts and mechanisms of each arch, by its name."""
    names = ("verdict", "collapse_mode", "collapse_joint", "lost_contact_time")
    tables = [cube[name].transpose("arch", "record", "level").values for name in names]
    for arch, verdict, mode, joint, lost in zip(cube["arch"].values, *tables, strict=True):
        fell, stood = verdict == Verdict.COLLAPSED, verdict == Verdict.STANDING
        counts = {
            "runs": int((verdict != Verdict.NOT_SIMULATED).sum()),
            "collapsed": int(fell.sum()),
            "standing": int(stood.sum()),
            "unfinished": int((verdict == Verdict.UNFINISHED).sum()),
            "solver_failures": int((verdict == Verdict.SOLVER_FAILURE).sum()),
            "not_simulated": int((verdict == Verdict.NOT_SIMULATED).sum()),
            "lost_contact_and_stand": int((stood & np.isfinite(lost)).sum()),
        }
        mechanisms = {
            "mode": {CollapseMode(m).name.lower(): part for m, part in _parts(mode[fell])},
            "joint": {str(j): part for j, part in _parts(joint[fell])},
        }
        yield str(arch), {"counts": counts, "mechanisms": mechanisms}


def _parts(codes: np.ndarray) -> Sequence[tuple[int, float]]:
    """Each code with its fraction of all."""
    return [(int(code), round(float((codes == code).mean()), 6)) for code in np.unique(codes)]


def _plain(found: Any) -> Any:
    """Values as JSON knows them, with null for what is no number."""
    if isinstance(found, Mapping):
        return {key: _plain(value) for key, value in found.items()}
    if isinstance(found, list | tuple):
        return [_plain(value) for value in found]
    if found == "nan" or (isinstance(found, float) and not np.isfinite(found)):
        return None
    return found
