"""The answer of a study in one sentence and a small table, and as data for ``summary.json``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from archfrag.fragility.bands import beta_interval, confidence_band, theta_interval
from archfrag.fragility.fit import Fragility
from archfrag.mechanics.status import CollapseMode
from archfrag.report.curve_figures import Resampled
from archfrag.report.summary import ArchResults, Scale, digits, study_config
from archfrag.report.tables import Table

if TYPE_CHECKING:
    from archfrag.report.page import ReportInputs
    from archfrag.simulate import Onset

SUMMARY_FORMAT = "archfrag-summary/1"
_MOST_LISTED = 3  # arches that a sentence names
Interval = tuple[float, float]


@dataclass(frozen=True)
class ArchAnswer:
    """What is known of the capacity of one arch; levels in the reader's unit.

    Attributes
    ----------
    name : str
    none : str
        Why there is no curve; empty if there is one.
    fit : Fragility or None
        Theta in SI.
    theta, beta : float
        nan without a curve.
    theta_interval, beta_interval : (float, float)
    band : str
        How the intervals were made.
    at : float or None
        Level at which the probability is given.
    probability : float
        nan without a curve or level.
    interval : (float, float)
    """

    name: str
    none: str
    fit: Fragility | None
    theta: float = np.nan
    beta: float = np.nan
    theta_interval: Interval = (np.nan, np.nan)
    beta_interval: Interval = (np.nan, np.nan)
    band: str = ""
    at: float | None = None
    probability: float = np.nan
    interval: Interval = (np.nan, np.nan)


def arch_answer(
    results: ArchResults,
    given: Fragility | str,
    resampled: Resampled | None,
    confidence: float,
    at: float | None,
) -> ArchAnswer:
    """The answer of one arch, with intervals from resampled records where there are such.

    Parameters
    ----------
    results : ArchResults
    given : Fragility or str
        The curve, theta in SI, or the sentence why there is none.
    resampled : Resampled or None
    confidence : float
    at : float or None
        Level in the reader's unit.
    """
    if isinstance(given, str):
        return ArchAnswer(results.arch, given, None, at=at)
    factor = results.scale.factor
    known = resampled is not None and bool(np.all(np.isfinite(resampled.band.theta)))
    if resampled is not None and known:
        theta, beta, band = resampled.band.theta, resampled.band.beta, "records resampled"
    else:
        low, high = theta_interval(given, confidence)
        theta, beta = (factor * low, factor * high), beta_interval(given, confidence)
        band = "runs independent"
    probability, interval = np.nan, (np.nan, np.nan)
    if at is not None:
        probability = float(given.probability(at / factor))
        if resampled is not None and known:
            interval = resampled.at(at)
        else:
            about = confidence_band(given, at / factor, confidence)
            interval = float(about.lower), float(about.upper)
    return ArchAnswer(
        results.arch, "", given, factor * given.theta, given.beta, theta, beta, band, at,
        probability, interval,
    )  # fmt: skip


def headline(answers: Sequence[ArchAnswer], scale: Scale, confidence: float) -> str:
    """The answer of the study in one sentence, without its full stop."""
    percent = f"{100 * confidence:.0f} %"
    known = [answer for answer in answers if answer.fit is not None]
    if not known:
        return f"{answers[0].name}: no fragility curve, for {answers[0].none}"
    at = known[0].at
    key = (lambda answer: answer.probability) if at is not None else (lambda answer: answer.theta)
    known.sort(key=key)

    def of(answer: ArchAnswer) -> str:
        if at is not None:
            return f"{_chance(answer.probability)} ({percent}: {_chances(answer.interval)})"
        low, high = answer.theta_interval
        return f"{digits(answer.theta)} {scale.unit} ({percent}: {digits(low)} to {digits(high)})"

    if len(known) <= _MOST_LISTED:
        listed = "; ".join(f"{answer.name} {of(answer)}" for answer in known)
    else:
        listed = f"from {known[0].name} {of(known[0])} to {known[-1].name} {of(known[-1])}"
    if at is not None:
        start = f"Probability of collapse at {scale.measure} = {digits(at)} {scale.unit}"
    else:
        start = f"{scale.measure} at which half of the motions bring the arch down (median θ)"
    missing = len(answers) - len(known)
    without = f"; {missing} of {len(answers)} arches without a curve" if missing else ""
    return f"{start}: {listed}{without}"


def answer_table(answers: Sequence[ArchAnswer], scale: Scale, confidence: float) -> Table:
    """One row for each arch: probability at the level asked for, theta, beta, intervals."""
    percent = f"{100 * confidence:.0f} %"
    at = answers[0].at
    asked = [f"P(collapse) at {digits(at)} {scale.unit}"] if at is not None else []
    rows = []
    for answer in answers:
        if answer.fit is None:
            rows.append([answer.name, *("–" for _ in asked), "no curve", "–"])
            continue
        chance = f"{_chance(answer.probability)} {_together(_chances(answer.interval))}"
        theta, beta = answer.theta_interval, answer.beta_interval
        rows.append(
            [
                answer.name,
                *(chance for _ in asked),
                f"{digits(answer.theta)} {_together(f'{digits(theta[0])}–{digits(theta[1])}')}",
                f"{answer.beta:.2f} {_together(f'{beta[0]:.2f}–{beta[1]:.2f}')}",
            ]
        )
    return Table(["arch", *asked, f"θ [{scale.unit}] ({percent})", f"β ({percent})"], rows)


def summary(
    inputs: "ReportInputs",
    cube: xr.Dataset,
    scale: Scale,
    parts: Sequence[tuple[ArchAnswer, ArchResults, "Onset"]],
    cautions: Sequence[str],
) -> dict[str, Any]:
    """Content of ``summary.json``.

    Keys: ``format``; ``study`` and ``title``; ``measure``, ``unit`` (of all levels here) and
    ``unit_in_si``; ``confidence`` of all intervals; ``level`` that probabilities are given at, or
    null; ``records``, ``levels``; ``arches``, of each ``id``, ``class``, ``curve`` (``theta``,
    ``beta``, their intervals, ``band`` how these were made, ``kind``, ``runs``, ``levels``) or
    null with ``reason``, ``probability`` (``level``, ``value``, ``interval``) or null, ``counts``
    of runs by verdict, ``mechanisms`` (fraction of the collapses by mode and by joint), and
    ``onset`` [g] (null: no limit, or it does not stand, see ``stands``); ``cautions``; and
    ``made_by``, versions and digests. What is not known is null.
    """
    attributes = cube.attrs
    kept = ("archfrag_commit", "archfrag_versions", "archfrag_plan", "archfrag_machine", "source")
    return {
        "format": SUMMARY_FORMAT,
        "study": attributes.get("archfrag_study") or study_config(cube).get("id"),
        "title": inputs.title,
        "measure": scale.measure,
        "unit": scale.unit,
        "unit_in_si": 1.0 / scale.factor,
        "confidence": inputs.confidence,
        "level": inputs.at,
        "records": cube.sizes["record"],
        "levels": cube.sizes["level"],
        "arches": [_entry(*part, classes(cube)) for part in parts],
        "cautions": list(cautions),
        "made_by": {key: attributes[key] for key in kept if key in attributes},
    }


def classes(cube: xr.Dataset) -> Mapping[str, str]:
    """Class of each arch of a cube; its own name where the cube does not say."""
    names = [str(name) for name in cube["arch"].values]
    own = [str(name) for name in cube["arch_class"].values] if "arch_class" in cube else names
    return dict(zip(names, own, strict=True))


def _entry(
    answer: ArchAnswer, results: ArchResults, onset: "Onset", of_class: Mapping[str, str]
) -> dict[str, Any]:
    counts, fit = results.counts, answer.fit
    curve = probability = None
    if fit is not None:
        curve = {
            "kind": fit.kind,
            "theta": answer.theta, "theta_interval": _pair(answer.theta_interval),
            "beta": answer.beta, "beta_interval": _pair(answer.beta_interval),
            "band": answer.band, "runs": fit.n_total, "levels": fit.n_levels,
        }  # fmt: skip
    if fit is not None and answer.at is not None:
        probability = {
            "level": answer.at,
            "value": _number(answer.probability),
            "interval": _pair(answer.interval),
        }
    fell = results.verdict == 1
    mode, joint = results.collapse_mode[fell], results.collapse_joint[fell]
    return {
        "id": answer.name,
        "class": of_class[answer.name],
        "curve": curve,
        "reason": answer.none or None,
        "probability": probability,
        "counts": {
            "runs": int(counts.runs.sum()),
            "collapsed": int(counts.collapsed.sum()),
            "standing": int(counts.standing.sum()),
            "unfinished": int(counts.unfinished.sum()),
            "solver_failures": int(counts.solver_failures.sum()),
            "not_simulated": int((~results.simulated).sum()) if not results.grouped else 0,
            "lost_contact_and_stand": results.stood_after_loss,
        },
        "mechanisms": {
            "mode": {CollapseMode(m).name.lower(): _part(mode == m) for m in np.unique(mode)},
            "joint": {str(j): _part(joint == j) for j in np.unique(joint)},
        },
        "stands": bool(onset.stands),
        "onset": {"plus": _number(onset.plus), "minus": _number(onset.minus)},
    }


def _part(mask: np.ndarray) -> float:
    return round(float(mask.mean()), 6)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _pair(ends: Interval) -> list[float | None]:
    return [_number(ends[0]), _number(ends[1])]


def _together(words: str) -> str:
    """Words in parentheses that a line does not part."""
    return f"({words})".replace(" ", "\u00a0").replace("–", "\u2060–\u2060")


def _chance(value: float) -> str:
    """A probability with two digits, three where it is small or large."""
    if not np.isfinite(value):
        return "–"
    if not 0.001 <= value <= 0.999:
        return "< 0.001" if value < 0.001 else "> 0.999"
    return f"{value:.2f}" if 0.1 <= value <= 0.9 else f"{value:.3f}"


def _chances(ends: Interval) -> str:
    low, high = map(_chance, ends)
    return low if low == high else f"{low} to {high}"
