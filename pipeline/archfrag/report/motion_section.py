"""What the page shows of the ground motions."""

from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.fragility.curve import Fragility
from archfrag.report import motion_figures, tables
from archfrag.report.motion_figures import SHOWN
from archfrag.report.summary import Scale
from archfrag.study.cautions import accepted_records

if TYPE_CHECKING:
    import xarray as xr

    from archfrag.report.page import ReportInputs


def motion_section(inputs: "ReportInputs", cube: "xr.Dataset", scale: Scale) -> dict[str, Any]:
    """Figures and table of the ground motions, by the names that the page's template uses."""
    from archfrag.motions.measures import measure, spectral_acceleration

    measures = {
        motion.id: {name: measure(motion, name) for name in ("PGA", "PGV", "Arias", "D5_95")}
        for motion in inputs.motions
    }
    spectra = inputs.spectra or {
        motion.id: (SHOWN, np.asarray(spectral_acceleration(motion, SHOWN, damping=0.05)))
        for motion in inputs.motions
    }
    factors, words = _shown_factors(inputs, cube, scale)
    return {
        "thumbnails": motion_figures.thumbnails(inputs.motions),
        "table": tables.motions(cube, inputs.motions, measures),
        "accepted": accepted_records(cube),
        "spectra": motion_figures.spectra(spectra, factors, words),
    }


def _shown_factors(
    inputs: "ReportInputs", cube: "xr.Dataset", scale: Scale
) -> tuple[dict[str, float], str]:
    """Factors that spectra are shown with, and in words what they do.

    Those of the level closest to the median capacity, of the middle one where no arch has a
    curve; those of the runs where each has a level of its own.
    """
    records = [str(name) for name in cube["record"].values]
    factors = cube["scale_factor"]
    if cube["intensity"].dims != ("level",):
        own = factors.isel(arch=0, level=0) if "arch" in factors.dims else factors.isel(level=0)
        made = {r: float(f) for r, f in zip(records, own.values, strict=True) if np.isfinite(f)}
        return made, "scaled as in the runs"
    intensity = cube["intensity"].values
    fits = [answer.curve for answer in inputs.answers.values()]
    medians = [fit.theta for fit in fits if isinstance(fit, Fragility)]
    level = intensity.size // 2
    if medians:
        level = int(np.abs(np.log(intensity) - np.log(np.median(medians))).argmin())
    chosen = factors.transpose("record", "level").values[:, level]
    words = f"scaled to {scale.measure} = {scale.text(float(intensity[level]))}"
    return dict(zip(records, chosen, strict=True)), words
