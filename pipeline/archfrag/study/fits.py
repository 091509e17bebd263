"""From the cube of a study to its fragility curves."""

import json
from dataclasses import replace
from pathlib import Path

import xarray as xr

from archfrag.errors import FitError, InputError
from archfrag.fragility.counts import count_verdicts
from archfrag.fragility.fit import Fragility, fit_stripes
from archfrag.study.config import Study
from archfrag.study.cube import CUBE, refuse_foreign_cube
from archfrag.study.files import write_text

FITS = "fits.json"


def open_cube(study: Study) -> xr.Dataset:
    """The cube of a study.

    Raises
    ------
    InputError
        If there is none yet, or it is damaged.
    OutputError
        If it is another study's.
    """
    path = study.folder / CUBE
    if not path.is_file():
        raise InputError(f"{path}: there is no cube yet; `archfrag cube` on the study makes it")
    refuse_foreign_cube(study)
    try:
        return xr.open_dataset(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is damaged; `archfrag cube` makes it anew") from error


def fit_cube(study: Study) -> dict[str, Fragility | str]:
    """Fit a curve to each arch of the cube and store all in ``fits.json``.

    Returns
    -------
    dict
        By arch: the curve, theta in the SI unit of the measure; or the sentence why there is
        none, with levels in the unit of the study.

    Raises
    ------
    InputError, OutputError
        See `open_cube`.
    """
    fits: dict[str, Fragility | str] = {}
    with open_cube(study) as cube:
        factor = _si_factor(study)
        levels = cube["intensity"].values / factor
        for number, name in enumerate(cube["arch"].values):
            verdict = cube["verdict"].isel(arch=number).transpose("record", "level").values
            counts = count_verdicts(verdict)
            try:
                fit = fit_stripes(levels, counts.collapsed, counts.n)
                fits[str(name)] = replace(fit, theta=fit.theta * factor)
            except FitError as error:
                fits[str(name)] = f"{error} (levels in {study.intensity.unit})"
    stored = {
        name: curve.to_dict() if isinstance(curve, Fragility) else {"none": curve}
        for name, curve in fits.items()
    }
    content = {
        "study": study.id,
        "measure": study.intensity.measure,
        "unit": cube["intensity"].attrs["units"],
        "fits": stored,
    }
    write_text(study.folder / FITS, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return fits


def _si_factor(study: Study) -> float:
    """SI unit of the measure over the unit of the study."""
    return study.intensity.si[0] / study.intensity.given[0]


def fit_sentence(study: Study, name: str, fit: Fragility | str) -> str:
    """A curve in the unit of the study, or why there is none."""
    if isinstance(fit, str):
        return f"{name}: no curve: {fit}"
    theta = fit.theta / _si_factor(study)
    return (
        f"{name}: median {theta:.4g} {study.intensity.unit} of {study.intensity.measure}, "
        f"dispersion {fit.beta:.3g}, from {fit.n_total} runs"
    )


def load_fits(path: Path) -> dict[str, Fragility | str]:
    """Curves that `fit_cube` stored.

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))["fits"]
        return {
            name: str(fit["none"]) if "none" in fit else Fragility.from_dict(fit)
            for name, fit in stored.items()
        }
    except FileNotFoundError:
        raise InputError(f"{path}: there are no fits yet; `archfrag fit` makes them") from None
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError) as error:
        raise InputError(f"{path}: is damaged ({error}); `archfrag fit` makes it anew") from None
