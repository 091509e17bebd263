"""From the cube of a study to its fragility curves."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from archfrag.errors import InputError
from archfrag.fragility.curve import Fragility
from archfrag.study import comparisons, curves
from archfrag.study.config import Study
from archfrag.study.cube import CUBE, refuse_foreign_cube
from archfrag.study.curves import Answer
from archfrag.study.files import write_text
from archfrag.study.members import shown

if TYPE_CHECKING:
    import xarray as xr

FITS = "fits.json"
T = TypeVar("T")


def open_cube(study: Study) -> "xr.Dataset":
    """The cube of a study.

    Raises
    ------
    InputError
        If there is none yet, or it is damaged.
    OutputError
        If it is another study's.
    """
    import xarray as xr

    path = study.folder / CUBE
    if not path.is_file():
        raise InputError(f"{path}: there is no cube yet; `archfrag cube` on the study makes it")
    refuse_foreign_cube(study)
    try:
        return xr.open_dataset(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is damaged; `archfrag cube` makes it anew") from error


def fit_cube(study: Study) -> dict[str, Answer]:
    """Find the curve of each arch and class of the cube and store all in ``fits.json``.

    Returns
    -------
    dict
        By arch; theta in the SI unit of the measure; sentences with levels in the study's unit.

    Raises
    ------
    InputError, OutputError
        See `open_cube`.
    """
    confidence, keys = study.report.confidence, study.limit_states.model_dump()
    factor = _si_factor(study)
    with open_cube(study) as cube:
        runs = [
            replace(each, level=each.level / factor) for each in curves.runs_of_cube(cube.load())
        ]
        grouped = curves.classes_of_cube(cube, runs)
        answers = {each.name: curves.answer(each, confidence) for each in runs}
        medians = [
            np.nan if isinstance(found.curve, str) else found.curve.theta
            for found in answers.values()
        ]
        for number in shown(medians):
            each, one = runs[number], cube.isel(arch=number)
            answers[each.name].more.update(
                free=comparisons.free_shapes(each, confidence),
                measures=comparisons.measures_compared(one, each),
                limit_states=comparisons.limit_states(one, each, keys),
            )
            if each.design == "cloud":
                own = comparisons.cloud_curves(one, each, confidence)
                answers[each.name].more["cloud"] = own
        classes = {name: curves.answer(each, confidence) for name, each in grouped.items()}
        names = cube["arch_class"].values.astype(str)
        for name, found in classes.items():
            members = [each for each, own in zip(runs, names) if own == name]
            found.more["dispersion"] = comparisons.dispersion_split(members)
            found.more["mixture"] = comparisons.class_mixture(
                [answers[each.name] for each in members]
            )
        unit = cube["intensity"].attrs["units"]
        design = json.loads(cube.attrs["archfrag_design"])
    answers = {name: _in_si(each, study) for name, each in answers.items()}
    content = {
        "study": study.id,
        "measure": study.intensity.measure,
        "unit": unit,
        "design": design,
        "fits": {name: curves.curve_to_dict(each.curve) for name, each in answers.items()},
        "arches": {name: each.to_dict() for name, each in answers.items()},
        "classes": {name: _in_si(each, study).to_dict() for name, each in classes.items()},
    }
    text = json.dumps(null(content), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(study.folder / FITS, text + "\n")
    return answers


def null(value: Any) -> Any:
    """The value with None in the place of numbers that are not finite: JSON has none."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: null(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [null(entry) for entry in value]
    return value


def _in_si(found: Answer, study: Study) -> Answer:
    """An answer in the unit of the study, as one in SI."""
    factor = _si_factor(study)

    def scaled(curve: Fragility | str) -> Fragility | str:
        if isinstance(curve, str):
            return f"{curve} (levels in {study.intensity.unit})"
        return replace(curve, theta=curve.theta * factor)

    more = dict(found.more)
    if "limit_states" in more:
        states = [
            {**state, "curve": curves.curve_to_dict(scaled(curves.curve_of_dict(state["curve"])))}
            for state in more["limit_states"]["states"]
        ]
        more["limit_states"] = {**more["limit_states"], "states": states}
    for key in ("dispersion", "mixture"):
        if key in more:
            medians = {n: more[key][n] * factor for n in ("theta", "median") if n in more[key]}
            more[key] = {**more[key], **medians}
    for cloud in more.get("cloud", {}).values():
        if "theta" in cloud:
            cloud["theta"] *= factor
            cloud["theta_interval"] = [end * factor for end in cloud["theta_interval"]]
    for shape in more.get("free", {}).values():
        if isinstance(shape, dict) and "im" in shape:
            shape["im"] = [value * factor for value in shape["im"]]
    if isinstance(found.curve, str):
        return replace(
            found, curve=scaled(found.curve), likelihood=scaled(found.likelihood), more=more
        )
    return replace(
        found,
        curve=scaled(found.curve),
        likelihood=scaled(found.likelihood),
        theta=(found.theta[0] * factor, found.theta[1] * factor),
        im=[value * factor for value in found.im],
        more=more,
    )


def _si_factor(study: Study) -> float:
    """SI unit of the measure over the unit of the study."""
    return study.intensity.si[0] / study.intensity.given[0]


def fit_sentence(study: Study, name: str, found: Answer) -> str:
    """A curve in the unit of the study, or why there is none."""
    if isinstance(found.curve, str):
        return f"{name}: no curve: {found.curve}"
    factor, percent = _si_factor(study), f"{100 * found.confidence:g} %"
    theta, low, high = (value / factor for value in (found.curve.theta, *found.theta))
    return (
        f"{name}: median {theta:.4g} {study.intensity.unit} of {study.intensity.measure} "
        f"({percent}: {low:.4g} to {high:.4g}), dispersion {found.curve.beta:.3g} "
        f"({found.beta[0]:.3g} to {found.beta[1]:.3g})"
    )


def load_answers(path: Path, of: str = "arches") -> dict[str, Answer]:
    """Answers that `fit_cube` stored, by arch or, with ``of="classes"``, by class.

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    return _load(path, lambda stored: {n: Answer.from_dict(a) for n, a in stored[of].items()})


def load_fits(path: Path) -> dict[str, Fragility | str]:
    """Curves that `fit_cube` stored.

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    return _load(
        path, lambda stored: {n: curves.curve_of_dict(fit) for n, fit in stored["fits"].items()}
    )


def _load(path: Path, read: Callable[[Any], T]) -> T:
    try:
        return read(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise InputError(f"{path}: there are no fits yet; `archfrag fit` makes them") from None
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError) as error:
        raise InputError(f"{path}: is damaged ({error}); `archfrag fit` makes it anew") from None
