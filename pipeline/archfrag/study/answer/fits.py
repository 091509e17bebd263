"""From the cube of a study to its fragility curves, stored and told."""

import json
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from archfrag.errors import FitError, InputError, attempt
from archfrag.files import write_csv
from archfrag.study.answer import comparisons, curves
from archfrag.study.answer.cautions import cautions_of_cube
from archfrag.study.answer.curves import Answer
from archfrag.study.file.members import SHOWN, shown
from archfrag.study.file.schema import Study
from archfrag.study.files import CUBE, read_json, refuse_foreign_cube, write_text
from archfrag.study.provenance import finite

if TYPE_CHECKING:
    import xarray as xr

FITS, CURVE = "fits.json", "curve.csv"


def open_cube(study: Study) -> "xr.Dataset":
    """The cube of a study; InputError if there is none, OutputError if it is another study's."""
    import xarray as xr

    path = study.folder / CUBE
    if not path.is_file():
        raise InputError(f"{path}: there is no cube yet; `archfrag cube` on the study makes it")
    refuse_foreign_cube(study)
    try:
        return xr.open_dataset(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is damaged; `archfrag cube` makes it again") from error


class Fitted(NamedTuple):
    """Answers from a cube."""

    arches: dict[str, Answer]
    classes: dict[str, Answer]  # of several arches
    cube: "xr.Dataset"

    def quoted(self, members: bool = False) -> dict[str, Answer]:
        """Answers that are handed on, see `curves.quoted`."""
        return curves.quoted(self.cube, self.arches, self.classes, members)


def fit_cube(study: Study) -> Fitted:
    """Find the curve of each arch and class of the cube; store all in ``fits.json``.

    All numbers are in SI; the text of an error names levels in the unit of the study. The table
    ``curve.csv`` is in the unit of the study.
    """
    confidence, keys = study.report.confidence, study.limit_states.model_dump()
    worded = partial(FitError.worded, factor=study.intensity.factor, unit=study.intensity.unit)

    def part(make: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
        found = attempt(partial(make, *arguments), worded)
        return {"none": found} if isinstance(found, str) else found

    with open_cube(study) as opened:
        cube = opened.load()
    runs = curves.runs_of_cube(cube)
    own = [(cube.isel(arch=number), each) for number, each in enumerate(runs)]
    answers = {each.name: curves.answer(each, confidence, worded) for each in runs}
    medians = [np.nan if isinstance(a.curve, str) else a.curve.theta for a in answers.values()]
    for number in shown(medians):
        one, each = own[number]
        more = answers[each.name].more
        more["free"] = part(comparisons.free_shapes, each, confidence, worded)
        more["measures"] = part(comparisons.measures_compared, one, each)
        more["limit_states"] = part(comparisons.limit_states, [own[number]], keys, worded)
        if not each.design.on_levels:
            more["cloud"] = {"logistic": part(comparisons.cloud_curves, each, confidence)}
    for each in runs:
        found = part(curves.without_verdict, each, confidence, worded)
        answers[each.name].more["without_verdict"] = found
    classes = {}
    for name, (group, places) in curves.classes_of_cube(cube, runs).items():
        members = [answers[runs[i].name] for i in places]
        classes[name] = curves.of_class(curves.answer(group, confidence, worded), members)
        split = {}
        if not isinstance(curve := classes[name].curve, str):
            alone = [runs[i] for i in places]
            split = part(comparisons.dispersion_split, alone, members, curve.beta)
        states = part(comparisons.limit_states, [own[i] for i in places], keys, worded)
        states["states"] = [s for s in states.get("states", ()) if s["name"] != "collapse"]
        lost = part(curves.without_verdict, group, confidence, worded)
        classes[name].more.update(dispersion=split, limit_states=states, without_verdict=lost)
    fitted = Fitted(answers, classes, cube)
    _store(study, fitted)
    return fitted


def _store(study: Study, fitted: Fitted) -> None:
    import pandas as pd

    arches, classes, cube = fitted
    plain = {name: each.to_dict() for name, each in arches.items()}
    content = {
        "study": study.id, "measure": study.intensity.measure,
        "unit": cube["intensity"].attrs["units"],
        "design": json.loads(cube.attrs["archfrag_design"]),
        "fits": {name: each["curve"] for name, each in plain.items()},
        "arches": plain, "classes": {name: each.to_dict() for name, each in classes.items()},
    }  # fmt: skip
    text = json.dumps(finite(content, None), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(study.folder / FITS, text + "\n")
    head, factor = f"{study.intensity.measure} [{study.intensity.unit}]", study.intensity.factor
    rows = [pd.DataFrame(columns=["arch", head, "probability", "lower", "upper"])]
    for name, found in fitted.quoted().items():
        if not isinstance(found.curve, str):
            im = np.array(found.im)
            rows.append(pd.DataFrame({
                "arch": name, head: im / factor, "probability": found.curve.probability(im),
                "lower": found.lower, "upper": found.upper,
            }))  # fmt: skip
    write_csv(study.folder / CURVE, rows)


def fit_lines(study: Study, fitted: Fitted) -> list[str]:
    """What to tell about curves: those of the first arches and of classes, and cautions."""
    lines = [fit_text(study, name, each) for name, each in list(fitted.arches.items())[:SHOWN]]
    if len(fitted.arches) > SHOWN:
        lines.append(f"{len(fitted.arches) - SHOWN} more arches in {study.folder / FITS}")
    lines += [f"class {fit_text(study, name, each)}" for name, each in fitted.classes.items()]
    cautions = cautions_of_cube(study, fitted.cube, fitted.arches)
    return [f"fit: {line}" for line in lines] + [f"caution: {each}" for each in cautions]


def fit_text(study: Study, name: str, found: Answer) -> str:
    """A curve in the unit of the study, or why there is none."""
    factor, unit = study.intensity.factor, study.intensity.unit
    lost = lost_text(found, lambda theta: f"{theta / factor:.4g} {unit}")
    lost = f"; {lost}" if lost else ""
    if isinstance(found.curve, str):
        return f"{name}: no curve: {found.curve}{lost}"
    theta, low, high = (value / factor for value in (found.curve.theta, *found.theta))
    return (
        f"{name}: median {theta:.4g} {unit} of {study.intensity.measure} "
        f"({100 * found.confidence:g} %: {low:.4g} to {high:.4g}), dispersion "
        f"{found.curve.beta:.3g} ({found.beta[0]:.3g} to {found.beta[1]:.3g}){lost}"
    )


def lost_text(found: Answer, median: Callable[[float], str]) -> str:
    """What the runs without a verdict could change; empty if there are none."""
    lost = found.more.get("without_verdict") or {}
    if "runs" not in lost:
        return ""
    low, high = (
        median(lost[key]["theta"]) if "theta" in lost[key] else "not known"
        for key in ("collapsed", "standing")
    )
    runs = "1 run has" if lost["runs"] == 1 else f"{lost['runs']} runs have"
    return f"{runs} no verdict: the median is {low} if all collapse, {high} if all stand"


def load_fits(study: Study) -> Fitted:
    """What `fit_cube` stored, and the cube; InputError if the file is missing or damaged."""
    path = study.folder / FITS
    try:
        stored = read_json(path)
        arches, classes = (
            {name: Answer.from_dict(answer) for name, answer in stored[of].items()}
            for of in ("arches", "classes")
        )
    except FileNotFoundError:
        raise InputError(f"{path}: there are no fits yet; `archfrag fit` makes them") from None
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError) as error:
        raise InputError(f"{path}: is damaged ({error}); `archfrag fit` makes it again") from None
    return Fitted(arches, classes, open_cube(study))
