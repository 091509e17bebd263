"""From the cube of a study to its fragility curves."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import InputError
from archfrag.fragility.curve import Fragility
from archfrag.study import comparisons, curves
from archfrag.study.config import Study
from archfrag.study.cube import CUBE, refuse_foreign_cube
from archfrag.study.curves import Answer
from archfrag.study.files import write_text
from archfrag.study.members import shown
from archfrag.study.provenance import finite

if TYPE_CHECKING:
    import xarray as xr

FITS = "fits.json"


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
    """Find the curve of each arch and class of the cube and store all in ``fits.json``."""
    confidence, keys = study.report.confidence, study.limit_states.model_dump()
    factor = study.intensity.factor
    with open_cube(study) as cube:
        runs = [
            replace(each, level=each.level / factor) for each in curves.runs_of_cube(cube.load())
        ]
        answers = {each.name: curves.answer(each, confidence) for each in runs}
        medians = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]
        for number in shown(medians):
            each, one = runs[number], cube.isel(arch=number)
            more = answers[each.name].more
            more["free"] = comparisons.free_shapes(each, confidence)
            more["measures"] = comparisons.measures_compared(one, each)
            more["limit_states"] = comparisons.limit_states(one, each, keys)
            if each.design == "cloud":
                more["cloud"] = comparisons.cloud_curves(one, each, confidence)
        classes = {}
        names = cube["arch_class"].values.astype(str)
        for name, group in curves.classes_of_cube(cube, runs).items():
            members = [each for each, own in zip(runs, names) if own == name]
            own_answers = [answers[each.name] for each in members]
            classes[name] = curves.answer(group, confidence)
            classes[name].more["dispersion"] = comparisons.dispersion_split(members, own_answers)
        unit = cube["intensity"].attrs["units"]
        design = json.loads(cube.attrs["archfrag_design"])
    plain, of_classes = (
        {name: _in_si(each.to_dict(), factor, study.intensity.unit) for name, each in some.items()}
        for some in (answers, classes)
    )
    content = {
        "study": study.id,
        "measure": study.intensity.measure,
        "unit": unit,
        "design": design,
        "fits": {name: each["curve"] for name, each in plain.items()},
        "arches": plain,
        "classes": of_classes,
    }
    text = json.dumps(finite(content, None), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(study.folder / FITS, text + "\n")
    return {name: Answer.from_dict(each) for name, each in plain.items()}


def _in_si(value: Any, factor: float, unit: str, key: str = "") -> Any:
    """Plain values of an answer in the unit of the study, as one in SI."""
    if key in ("theta", "theta_interval", "im") and not isinstance(value, dict):
        return [v * factor for v in value] if isinstance(value, list | tuple) else value * factor
    if isinstance(value, dict) and key != "measures":
        if key in ("curve", "likelihood") and "none" in value:
            return {"none": f"{value['none']} (levels in {unit})"}
        return {name: _in_si(each, factor, unit, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_in_si(each, factor, unit) for each in value]
    return value


def fit_text(study: Study, name: str, found: Answer) -> str:
    """A curve in the unit of the study, or why there is none."""
    if isinstance(found.curve, str):
        return f"{name}: no curve: {found.curve}"
    factor, percent = study.intensity.factor, f"{100 * found.confidence:g} %"
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
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))[of]
        return {name: Answer.from_dict(answer) for name, answer in stored.items()}
    except FileNotFoundError:
        raise InputError(f"{path}: there are no fits yet; `archfrag fit` makes them") from None
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError) as error:
        raise InputError(f"{path}: is damaged ({error}); `archfrag fit` makes it anew") from None


def load_fits(path: Path) -> dict[str, Fragility | str]:
    """Curves that `fit_cube` stored.

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    return {name: answer.curve for name, answer in load_answers(path).items()}
