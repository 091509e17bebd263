"""What else follows from runs: other shapes, measures, limit states, parts of the dispersion."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import FitError
from archfrag.fragility.counts import Verdict, find_brackets
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.study.answer.curves import Answer, Runs, Worded, curve_to_dict

if TYPE_CHECKING:
    import xarray as xr

_SEED, _RESAMPLES = 1, 300
MISFIT = 0.05  # p-value below which the lognormal curve does not describe the collapses
MOST_BELOW = 0.01  # probability of a limit state at the onset of motion


def free_shapes(runs: Runs, confidence: float, worded: Worded = str) -> dict[str, Any]:
    """Curves without a shape given beforehand, and whether the lognormal one fits the runs."""
    from archfrag.fragility.quoted import check_lognormal, isotonic_curve

    drawn: dict[str, Any] = {"seed": _SEED, "resamples": _RESAMPLES}
    shaped: dict[str, Any] = {}
    try:
        curve = isotonic_curve(runs.brackets, runs.group, confidence=confidence, **drawn)
        shaped["isotonic"] = {name: values.tolist() for name, values in curve.items()}
        p_value, _ = check_lognormal(runs.brackets, **drawn)
    except FitError as error:
        return shaped | {"none": worded(error)}
    message = (
        f"The lognormal curve does not describe these collapses (p = {p_value:.3g}): quote the "
        "isotonic curve too."
        if p_value < MISFIT
        else f"Nothing here contradicts a lognormal curve (p = {p_value:.2g}); with a small "
        "number of records only a large misfit would show."
    )
    return shaped | {"test_of_fit": {"p_value": p_value, "message": message}}


def cloud_curves(runs: Runs, confidence: float) -> dict[str, Any]:
    """Curve of a cloud by logistic regression."""
    from archfrag.fragility.fit import fit_cloud

    # Each record has one run.
    level, verdict = runs.level[runs.decided], runs.verdict[runs.decided]
    event = None if runs.group is None else runs.group[runs.decided.any(axis=1)]
    return fit_cloud(
        level, verdict == Verdict.COLLAPSED, event,
        seed=_SEED, resamples=_RESAMPLES, confidence=confidence,
    )  # fmt: skip


def measures_compared(cube: "xr.Dataset", runs: Runs) -> dict[str, Any]:
    """The study's measure compared with others in which its motions are known."""
    from archfrag.fragility.measures import compare_measures

    names, rows = cube["measure"].values.astype(str).tolist(), runs.rows
    value = cube["record_measure"].transpose("measure", "record").values[:, rows]
    exponent = dict(zip(names, cube["measure_exponent"].values.tolist()))
    known = {k: v for k, v in zip(names, value) if exponent[k] > 0.0 and (v > 0.0).all()}
    table = compare_measures(
        runs.brackets, known, exponent, str(cube["intensity"].attrs["measure"]),
        magnitude=cube["magnitude"].values[rows], distance=cube["distance"].values[rows],
        event=runs.group,
    )  # fmt: skip
    units = dict(zip(names, cube["measure_unit"].values.astype(str).tolist()))
    return {**table, "rows": [{**row, "unit": units[row["measure"]]} for row in table["rows"]]}


def limit_states(
    parts: "Sequence[tuple[xr.Dataset, Runs]]", keys: Mapping[str, float], worded: Worded = str
) -> dict[str, Any]:
    """Curves of damage short of collapse, ordered, from the runs of an arch or of all of a class.

    `parts` is each arch's part of the cube with its runs, `keys` the ``limit_states`` of a study.
    """
    from archfrag.fragility.limit_states import fit_limit_states

    limits = [float(cube["static_limit"]) for cube, _ in parts]
    rad = f", {limits[0]:.3g} rad" if len(parts) == 1 else ""
    meanings = {
        "motion": "a joint opens or slides",
        "impact": "a joint closes by an impact",
        "residual": f"a displacement of {keys['residual']:g} of a joint's length is left",
        "rotation": f"rotation by {keys['rotation']:g} of the static limit{rad}",
        "contact lost": "a joint opens at both corners, regained or not",
        "collapse": "a loss of contact that cannot be regained",
    }
    if not np.isfinite(limits).all():
        del meanings["rotation"]
    exceeded = np.concatenate([_exceeded(*part, keys, list(meanings)) for part in parts])
    level = np.concatenate([np.broadcast_to(r.level, r.verdict.shape) for _, r in parts])
    found, message = fit_limit_states(exceeded, level, list(meanings))
    onset = min(_onset(cube) for cube, _ in parts)
    states = []
    for (name, meaning), (fit, none) in zip(meanings.items(), found, strict=True):
        note = worded(none) if none else ""
        curve = curve_to_dict(_above(fit, onset) or note)
        states.append({"name": name, "meaning": meaning, "note": note, "curve": curve})
    return {"message": message, "states": states}


def _exceeded(
    cube: "xr.Dataset", runs: Runs, keys: Mapping[str, float], names: Sequence[str]
) -> NDArray[np.int64]:
    """Verdicts on the limit states of an arch, as those on collapse, (n_record, n_level, n)."""
    part = cube.isel(record=runs.rows).transpose("record", "level", ...)
    states: dict[str, Any] = {
        "motion": part["openings"] + part["slides"] + part["impacts"] > 0,
        "impact": part["impacts"] > 0,
        "residual": part["residual_displacement"] >= keys["residual"] * part["joint_length"],
        "rotation": part["peak_rotation"] >= keys["rotation"] * part["static_limit"],
        "contact lost": np.isfinite(part["lost_contact_time"]),
        "collapse": part["verdict"] == Verdict.COLLAPSED,
    }
    codes = [np.where(states[name], Verdict.COLLAPSED, Verdict.STANDING) for name in names]
    codes = [np.where(runs.decided, code, Verdict.NOT_SIMULATED) for code in codes]
    if runs.design.adaptive:  # where the runs of a record imply others
        codes = [find_brackets(code, runs.level).filled for code in codes]
    return np.stack(codes, axis=-1)


def _onset(cube: "xr.Dataset") -> float:
    """Least level at which an arch can move under its records, 0 where that is not known [SI]."""
    own, names = cube["intensity"].attrs["measure"], cube["measure"].values.astype(str).tolist()
    if bool(cube["record_vertical"].any()) or not {own, "PGA"} <= set(names):
        return 0.0
    value = dict(zip(names, cube["record_measure"].transpose("measure", "record").values))
    least = STANDARD_GRAVITY * min(float(cube["onset_plus"]), float(cube["onset_minus"]))
    power = float(cube["measure_exponent"].values[names.index(own)])
    return float(np.min(value[own] * (least / value["PGA"]) ** power))


def _above(fit: Fragility | None, onset: float) -> Fragility | str | None:
    """The curve, or why it is none: it gives a probability where nothing can move."""
    below = float(fit.probability(onset)) if fit is not None and onset > 0.0 else 0.0
    if below <= MOST_BELOW:
        return fit
    return (
        f"it would give a probability of {below:.2f} at the onset of motion, below which nothing "
        "moves; levels near the onset may show it"
    )


def dispersion_split(
    members: Sequence[Runs], answers: Sequence[Answer], beta: float
) -> dict[str, Any]:
    """Parts of the dispersion `beta` of a class: from record to record, and between its arches.

    By the capacities of all runs; by the likeliest curve of each arch where records withstand the
    largest level, since without these, the mildest, what is left would differ less.
    """
    from archfrag.fragility.curve import split_capacities, split_curves

    if not members[0].design.on_levels or len({len(each.verdict) for each in members}) > 1:
        return {}
    capacity = np.stack([each.brackets.middle for each in members])
    if np.isnan(capacity).any():
        fits = [a.likelihood for a in answers if isinstance(a.likelihood, Fragility)]
        split = split_curves(
            [fit.theta for fit in fits], [fit.beta for fit in fits],
            [fit.standard_errors[0] for fit in fits], shared=_shared_error(capacity),
        )  # fmt: skip
    else:
        split = split_capacities(capacity)
    scale = beta / np.hypot(*split)
    return {"beta_record_to_record": scale * split[0], "beta_model": scale * split[1]}


def _shared_error(capacity: FloatArray) -> float:
    """Mean correlation of ln capacities between arches, by the records known for all."""
    logs = np.log(capacity[:, ~np.isnan(capacity).any(axis=0)])
    if logs.shape[1] < 3 or (np.ptp(logs, axis=1) == 0.0).any():
        return 0.0
    pairs = np.triu_indices(len(logs), k=1)
    return float(np.clip(np.corrcoef(logs)[pairs].mean(), 0.0, 0.99))
