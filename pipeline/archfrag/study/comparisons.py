"""What else follows from runs: other shapes, measures, limit states, parts of the dispersion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import FitError, InputError, attempt
from archfrag.fragility.brackets import fill_verdicts, find_brackets
from archfrag.fragility.counts import Verdict
from archfrag.fragility.curve import FloatArray, Fragility
from archfrag.study.curves import Answer, Runs, curve_to_dict
from archfrag.study.design import GRIDS

if TYPE_CHECKING:
    import xarray as xr

_SEED = 1
MOST_BELOW = 0.01  # probability of a limit state at the onset of motion


def free_shapes(
    runs: Runs, confidence: float, worded: Callable[[FitError], str] = str
) -> dict[str, Any]:
    """Curves without a shape given beforehand, and whether the lognormal one fits the runs."""
    from archfrag.fragility.goodness import check_lognormal
    from archfrag.fragility.runs import Resampling, gather_runs
    from archfrag.fragility.shapes import isotonic_curve, kernel_curve

    verdict, level = runs.verdict.ravel(), runs.level.ravel()
    if runs.design in GRIDS:
        verdict, level = fill_verdicts(runs.verdict), runs.level
    resampling = Resampling(_SEED, 300, confidence)
    shaped: dict[str, Any] = {}
    try:
        own = gather_runs(verdict, level, event=runs.group)
        for curve in (isotonic_curve(own, resampling), kernel_curve(own, resampling)):
            shaped[curve.kind] = {
                "im": curve.im.tolist(), "probability": curve.value.tolist(),
                "lower": curve.lower.tolist(), "upper": curve.upper.tolist(),
            }  # fmt: skip
        test = check_lognormal(own, resampling)
        shaped["test_of_fit"] = {"p_value": test.p_value, "message": test.message}
    except FitError as error:
        shaped["none"] = worded(error)
    return shaped


def cloud_curves(
    cube: "xr.Dataset", runs: Runs, confidence: float, worded: Callable[[FitError], str] = str
) -> dict[str, Any]:
    """Curves of a cloud by logistic regression and by the modified method, on peak rotation."""
    from archfrag.fragility.cloud import cloud_binary, cloud_modified
    from archfrag.fragility.runs import Resampling

    decided = runs.decided.ravel()
    level = runs.level.ravel()[decided]
    fell = (runs.verdict.ravel()[decided] == Verdict.COLLAPSED).astype(int)
    response = cube["peak_rotation"].transpose("record", "level").values[runs.rows]
    response = response.ravel()[decided]
    event = None if runs.group is None else runs.group[decided]
    limit, resampling = float(cube["static_limit"]), Resampling(_SEED, 300, confidence)
    # A run without motion has no response to regress.
    moved = (response > 0.0) | (fell == 1)
    some = None if event is None else event[moved]
    moving = level[moved], response[moved], fell[moved], limit
    found: dict[str, Any] = {}
    for name, fit in (
        ("logistic", partial(cloud_binary, level, fell, resampling, event=event)),
        ("modified", partial(cloud_modified, *moving, resampling, event=some)),
    ):
        curve = attempt(fit, worded)
        found[name] = {"none": curve} if isinstance(curve, str) else {
            "theta": curve.theta, "beta": curve.beta, "theta_interval": curve.theta_interval,
            "beta_interval": curve.beta_interval, "notes": list(curve.notes),
        }  # fmt: skip
    return found


def measures_compared(cube: "xr.Dataset", runs: Runs) -> dict[str, Any]:
    """The study's measure beside others in which its motions are known."""
    from archfrag.fragility.measures import Motions, compare_measures

    exponent = cube["measure_exponent"].values.astype(float)
    rows = runs.rows
    value = cube["record_measure"].transpose("record", "measure").values[rows]
    known = (exponent > 0.0) & (value > 0.0).all(axis=0)
    names = cube["measure"].values.astype(str)
    motions = Motions(
        tuple(names[known].tolist()), value[:, known], exponent[known],
        cube["magnitude"].values[rows], cube["distance"].values[rows], runs.group,
    )  # fmt: skip
    own = str(cube["intensity"].attrs["measure"])
    table = compare_measures(runs.verdict, runs.factor, motions, own)
    units = dict(zip(names.tolist(), cube["measure_unit"].values.astype(str).tolist()))
    listed = [{**asdict(row), "unit": units[row.measure]} for row in table.rows]
    return {**asdict(table), "rows": listed}


def limit_states(
    parts: "Sequence[tuple[xr.Dataset, Runs]]", keys: Mapping[str, float],
    worded: Callable[[FitError], str] = str,
) -> dict[str, Any]:  # fmt: skip
    """Curves of damage short of collapse, ordered, from the runs of an arch or of all of a class.

    Parameters
    ----------
    parts : sequence of (xarray.Dataset, Runs)
        Each arch with its part of the cube.
    keys : mapping of str to float
        ``limit_states`` of the study.
    worded : callable
        As of `archfrag.study.curves.answer`.
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
    found = fit_limit_states(exceeded, level, list(meanings))
    onset = min(_onset(cube) for cube, _ in parts)
    notes = [worded(each.none) if each.none else "" for each in found.states]
    return {
        "message": found.message,
        "states": [
            {"name": each.name, "meaning": meanings[each.name],
             "note": note, "curve": curve_to_dict(_above(each.fit, onset) or note)}
            for each, note in zip(found.states, notes, strict=True)
        ],
    }  # fmt: skip


def _exceeded(
    cube: "xr.Dataset", runs: Runs, keys: Mapping[str, float], names: Sequence[str]
) -> NDArray[np.int64]:
    """1 where a run of an arch exceeds a limit state, 0 where not, -1 where that is not known."""

    def values(name: str) -> NDArray:
        table: NDArray = cube[name].transpose("record", "level").values
        return table[runs.rows]

    length, limit = float(cube["joint_length"]), float(cube["static_limit"])
    states = {
        "motion": values("openings") + values("slides") + values("impacts") > 0,
        "impact": values("impacts") > 0,
        "residual": values("residual_displacement") >= keys["residual"] * length,
        "rotation": values("peak_rotation") >= keys["rotation"] * limit,
        "contact lost": np.isfinite(values("lost_contact_time")),
        "collapse": runs.verdict == Verdict.COLLAPSED,
    }
    reached = [np.where(runs.decided, states[name], -1).astype(np.int64) for name in names]
    if runs.design in ("ida", "two_stage"):  # where the runs of a record imply others
        for i, codes in enumerate(reached):
            filled = fill_verdicts(np.where(codes < 0, Verdict.NOT_SIMULATED, codes), "first")
            reached[i] = np.where(filled == Verdict.NOT_SIMULATED, -1, filled)
    return np.stack(reached, axis=-1)


def _onset(cube: "xr.Dataset") -> float:
    """Least level at which an arch can move under its records, 0 where that is not known [SI]."""
    own, names = cube["intensity"].attrs["measure"], cube["measure"].values.astype(str).tolist()
    if bool(cube["record_vertical"].any()) or not {own, "PGA"} <= set(names):
        return 0.0
    value = cube["record_measure"].transpose("record", "measure").values
    least = STANDARD_GRAVITY * min(float(cube["onset_plus"]), float(cube["onset_minus"]))
    factor = least / value[:, names.index("PGA")]
    power = float(cube["measure_exponent"].values[names.index(own)])
    return float(np.min(value[:, names.index(own)] * factor**power))


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
    from archfrag.fragility.dispersion import split_capacities, split_curves

    n_record = len(members[0].verdict)
    if members[0].design not in GRIDS or any(len(each.verdict) != n_record for each in members):
        return {}
    capacity = np.stack([find_brackets(each.verdict, each.level).middle for each in members])
    try:
        if np.isnan(capacity).any():
            fits = [a.likelihood for a in answers if isinstance(a.likelihood, Fragility)]
            split = split_curves(
                [fit.theta for fit in fits], [fit.beta for fit in fits],
                [fit.standard_errors[0] for fit in fits],
                shared=_shared_error(capacity), n_record=n_record,
            )  # fmt: skip
        else:
            split = split_capacities(capacity)
    except (FitError, InputError) as error:
        return {"none": str(error)}
    scale = beta / split.combined()
    return {
        "beta_record_to_record": scale * split.beta_record_to_record,
        "beta_model": scale * split.beta_model,
    }


def _shared_error(capacity: FloatArray) -> float:
    """Mean correlation of ln capacities between arches, by the records known for all."""
    logs = np.log(capacity[:, ~np.isnan(capacity).any(axis=0)])
    if logs.shape[1] < 3 or (np.ptp(logs, axis=1) == 0.0).any():
        return 0.0
    pairs = np.triu_indices(len(logs), k=1)
    return float(np.clip(np.corrcoef(logs)[pairs].mean(), 0.0, 0.99))
