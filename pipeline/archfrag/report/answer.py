"""The answer of a study in a small table, and as data for ``summary.json``."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import Fragility
from archfrag.mechanics.status import CollapseMode
from archfrag.report.axes import digits
from archfrag.report.summary import NOT_SIMULATED, Scale, study_config
from archfrag.report.tables import Table

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.report.page import ReportInputs
    from archfrag.simulate import Onset
    from archfrag.study.curves import Answer

SUMMARY_FORMAT = "archfrag-summary/2"
MOST_ROWS = 200  # arches of the table
Answers = Mapping[str, "Answer"]


def answer_table(answers: Answers, scale: Scale, at: float | None) -> Table:
    """One row for each arch or class: probability at the level asked for, theta and beta.

    With their intervals, and beside them theta and beta by maximum likelihood.
    """
    percent = f"{100 * next(iter(answers.values())).confidence:.0f} %"
    asked = [f"P(collapse) at {digits(at)} {scale.unit}"] if at is not None else []
    rows = []
    for name, answer in list(answers.items())[:MOST_ROWS]:
        if isinstance(answer.curve, str):
            rows.append([name, *("–" for _ in asked), "no curve", "–", "–"])
            continue
        row = [name]
        if at is not None:
            value, *ends = answer.probability(at / scale.factor)
            row.append(f"{_chance(value)} {_together(_chances(ends))}")
        low, high = (digits(scale.factor * end) for end in answer.theta)
        theta = digits(scale.factor * answer.curve.theta)
        beta = _together(f"{answer.beta[0]:.2f}–{answer.beta[1]:.2f}")
        fit, likelihood = answer.likelihood, "–"
        if isinstance(fit, Fragility):
            likelihood = f"{digits(scale.factor * fit.theta)}, {fit.beta:.2f}"
        row += [f"{theta} {_together(f'{low}–{high}')}", f"{answer.curve.beta:.2f} {beta}"]
        rows.append([*row, likelihood])
    heads = ["arch", *asked, f"θ [{scale.unit}] ({percent})", f"β ({percent})"]
    return Table([*heads, "θ, β by maximum likelihood"], rows)


def summary(
    inputs: "ReportInputs", cube: "xr.Dataset", scale: Scale, cautions: Sequence[str]
) -> dict[str, Any]:
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

    A ``curve`` has ``theta``, ``beta``, ``theta_interval``, ``beta_interval``, ``method`` and
    ``assumptions`` of curve and band, ``independent`` (records or runs that the data are worth),
    ``islands`` (runs against the capacity of their record), ``kind``, and
    ``maximum_likelihood``: ``theta``, ``beta`` and ``kind``, or null.
    """
    attributes = cube.attrs
    kept = ("archfrag_commit", "archfrag_versions", "archfrag_plan", "archfrag_machine", "source")
    of_class = classes(cube)
    onsets = {name: onset for name, _, onset in inputs.arches}
    return {
        "format": SUMMARY_FORMAT,
        "study": attributes.get("archfrag_study") or study_config(cube).get("id"),
        "title": inputs.title,
        "measure": scale.measure,
        "unit": scale.unit,
        "unit_in_si": 1.0 / scale.factor,
        "confidence": inputs.confidence,
        "level": inputs.at,
        "design": str(attributes.get("archfrag_design_kind", "stripes")),
        "records": cube.sizes["record"],
        "levels": cube.sizes["level"],
        "arches": [
            {
                "id": name,
                "class": of_class[name],
                **_answered(inputs.answers[name], scale, inputs.at),
                **runs,
                **_onset(onsets.get(name)),
            }
            for name, runs in _runs(cube)
        ],
        "classes": [
            {
                "id": name,
                "arches": sum(own == name for own in of_class.values()),
                **_answered(answer, scale, inputs.at),
                "dispersion": _plain(answer.more.get("dispersion")),
            }
            for name, answer in inputs.classes.items()
        ],
        "cautions": list(cautions),
        "made_by": {key: attributes[key] for key in kept if key in attributes},
    }


def classes(cube: "xr.Dataset") -> dict[str, str]:
    """Class of each arch of a cube; its own name where the cube holds none."""
    names = [str(name) for name in cube["arch"].values]
    own = [str(name) for name in cube["arch_class"].values] if "arch_class" in cube else names
    return dict(zip(names, own, strict=True))


def _answered(answer: "Answer", scale: Scale, at: float | None) -> dict[str, Any]:
    """Curve and probability of an arch or a class, or the reason why there is none."""
    if isinstance(answer.curve, str):
        return {"curve": None, "reason": answer.curve, "probability": None}
    probability = None
    if at is not None:
        value, *ends = answer.probability(at / scale.factor)
        probability = {"level": at, "value": _number(value), "interval": _pair(ends)}
    likelihood = None
    if isinstance(answer.likelihood, Fragility):
        fit = answer.likelihood
        likelihood = {"theta": scale.factor * fit.theta, "beta": fit.beta, "kind": fit.kind}
    return {
        "curve": {
            "theta": scale.factor * answer.curve.theta,
            "theta_interval": _pair([scale.factor * end for end in answer.theta]),
            "beta": answer.curve.beta,
            "beta_interval": _pair(answer.beta),
            "method": answer.method,
            "assumptions": answer.assumptions,
            "independent": answer.n_independent,
            "islands": answer.n_islands,
            "kind": answer.curve.kind,
            "maximum_likelihood": likelihood,
        },
        "reason": None,
        "probability": probability,
    }


def _runs(cube: "xr.Dataset") -> Iterator[tuple[str, dict[str, Any]]]:
    """Counts and mechanisms of each arch, by its name."""
    names = ("verdict", "collapse_mode", "collapse_joint", "lost_contact_time")
    tables = [
        cube[name].transpose("arch", "record", "level").values for name in names if name in cube
    ]
    for place, arch in enumerate(cube["arch"].values):
        verdict, mode, joint, *lost = (table[place] for table in tables)
        fell, stood = verdict == Verdict.COLLAPSED, verdict == Verdict.STANDING
        modes, joints = mode[fell], joint[fell]
        counts = {
            "runs": int((verdict != NOT_SIMULATED).sum()),
            "collapsed": int(fell.sum()),
            "standing": int(stood.sum()),
            "unfinished": int((verdict == Verdict.UNFINISHED).sum()),
            "solver_failures": int((verdict == Verdict.SOLVER_FAILURE).sum()),
            "not_simulated": int((verdict == NOT_SIMULATED).sum()),
            "lost_contact_and_stand": int((stood & np.isfinite(lost[0])).sum()) if lost else None,
        }
        mechanisms = {
            "mode": {CollapseMode(m).name.lower(): _part(modes == m) for m in np.unique(modes)},
            "joint": {str(j): _part(joints == j) for j in np.unique(joints)},
        }
        yield str(arch), {"counts": counts, "mechanisms": mechanisms}


def _onset(onset: "Onset | None") -> dict[str, Any]:
    if onset is None:
        return {"stands": None, "onset": None}
    both = {"plus": _number(onset.plus), "minus": _number(onset.minus)}
    return {"stands": bool(onset.stands), "onset": both}


def _plain(found: Any) -> Any:
    """Values as JSON knows them, with null for what is no number."""
    if isinstance(found, Mapping):
        return {key: _plain(value) for key, value in found.items()}
    if isinstance(found, list | tuple):
        return [_plain(value) for value in found]
    if found == "nan" or (isinstance(found, float) and not np.isfinite(found)):
        return None
    return found


def _part(mask: np.ndarray) -> float:
    return round(float(mask.mean()), 6)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _pair(ends: Sequence[float]) -> list[float | None]:
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


def _chances(ends: Sequence[float]) -> str:
    low, high = map(_chance, ends)
    return low if low == high else f"{low} to {high}"
