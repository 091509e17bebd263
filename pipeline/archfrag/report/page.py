"""The report of a study: one HTML file that needs nothing else, on a network or off it."""

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from archfrag.arch import Arch
from archfrag.errors import InputError, OutputError
from archfrag.fragility.fit import Fragility
from archfrag.report import motion_figures, tables
from archfrag.report.arch_section import arch_section
from archfrag.report.beside import Beside, beside_section
from archfrag.report.canvas import Picture, standalone
from archfrag.report.motion_figures import PERIODS, Spectrum
from archfrag.report.summary import Scale, arch_results, reading_scale
from archfrag.study.cautions import accepted_records, scaled_far

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion
    from archfrag.simulate import Onset


@dataclass(frozen=True)
class ReportInputs:
    """Everything a report is written from.

    Attributes
    ----------
    cube : xarray.Dataset or Path
        The cube of the study, or the netCDF file that holds it.
    measure : str
        Name of the intensity measure of the cube's levels, e.g. "PGA".
    motions : sequence of Motion
        Unscaled, one for each record of the cube, with the record's name as `id`.
    arches : sequence of (str, Arch, Onset)
        Name in the cube, geometry and onset of each arch, in the order of the page.
    fits : mapping of str to Fragility or str
        For each arch its curve, theta in the SI unit of the cube's intensity, or the sentence
        why there is none, which is shown as it is.
    spectra : mapping of record to (periods [s], Sa [m/s2]), optional
        At 5 % damping, unscaled, all at the same periods; computed here where not given.
    timings : DataFrame, optional
        Column `wall_time` [s], and `arch`; one row for each run or group of runs.
    provenance : mapping, optional
        Text, numbers, lists or mappings of what made the results; the attributes of the cube
        where not given.
    title : str
    confidence : float
        Of all bands and intervals.
    beside : Beside, optional
        Another study with the same measure, to be compared in the arches that both have.
    """

    cube: xr.Dataset | Path
    measure: str
    motions: Sequence["Motion"]
    arches: Sequence[tuple[str, Arch, "Onset"]]
    fits: Mapping[str, Fragility | str]
    spectra: Mapping[str, Spectrum] | None = None
    timings: pd.DataFrame | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    title: str = "Fragility of masonry arches"
    confidence: float = 0.9
    beside: Beside | None = None


def write_report(study_results: ReportInputs, out: Path) -> Path:
    """Write the report, and beside it each arch's curve as ``curve-<arch>.svg``; each file whole.

    Parameters
    ----------
    study_results : ReportInputs
    out : Path
        HTML file; replaced only once the new one is complete.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    InputError
        If the parts do not belong together.
    OutputError
        If a file cannot be written.
    """
    out = Path(out)
    with _opened(study_results) as cube:
        text, sections = _render(study_results, cube)
    for section in sections:
        _write_whole(out.parent / f"curve-{section['name']}.svg", standalone(section["curve"]))
    _write_whole(out, text)
    return out


def _write_whole(out: Path, text: str) -> None:
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", dir=out.parent, prefix=f".{out.name}.", delete=False
        ) as file:
            temporary = file.name
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, out)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise OutputError(
            f"the report cannot be written to {out}: {error.strerror}; choose a folder that "
            "exists, may be written to and has room"
        ) from error


@contextmanager
def _opened(inputs: ReportInputs) -> Iterator[xr.Dataset]:
    if isinstance(inputs.cube, xr.Dataset):
        yield inputs.cube
        return
    try:
        cube = xr.open_dataset(inputs.cube, cache=False)
    except (OSError, ValueError) as error:
        raise InputError(f"the cube {inputs.cube} cannot be read: {error}") from error
    # Read arch by arch: a large cube does not fit in memory.
    with cube:
        yield cube


def render(study_results: ReportInputs) -> str:
    """The page as text; the same inputs give the same text.

    Raises
    ------
    InputError
        If the parts do not belong together.
    """
    with _opened(study_results) as cube:
        return _render(study_results, cube)[0]


def _render(inputs: ReportInputs, cube: xr.Dataset) -> tuple[str, list[dict[str, Any]]]:
    scale = reading_scale(cube, inputs.measure)
    _check(inputs, cube)
    beside = beside_section(inputs, cube, scale)
    sections = [
        arch_section(inputs, cube, arch_results(cube, name, scale), arch, onset, f"arch{i}")
        for i, (name, arch, onset) in enumerate(inputs.arches)
    ]
    environment = Environment(
        loader=PackageLoader("archfrag.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["inline"] = lambda shown: Markup(shown.svg)
    provenance = dict(inputs.provenance) or dict(cube.attrs)
    levels = [scale.text(level) for level in cube["intensity"].values.tolist()]
    text = environment.get_template("report.html.j2").render(
        title=inputs.title,
        sections=sections,
        beside=beside,
        scale=scale,
        caution=scaled_far(cube, levels),
        loss_limit=_loss_limit(cube),
        percent=f"{100 * inputs.confidence:.0f} %",
        n_record=cube.sizes["record"],
        n_level=cube.sizes["level"],
        motions=_motion_section(inputs, cube, scale),
        facts=[(k, v) for k, v in map(_plain, provenance.items()) if "\n" not in v],
        documents=[(k, v) for k, v in map(_plain, provenance.items()) if "\n" in v],
    )
    return text, sections


def _loss_limit(cube: xr.Dataset) -> str | None:
    """Gap over joint length from which a loss of contact is a collapse; None if not told."""
    limit = cube.attrs.get("loss_limit", cube.get("loss_limit"))
    return None if limit is None else f"{100.0 * float(limit):g} %"


def _check(inputs: ReportInputs, cube: xr.Dataset) -> None:
    records = [str(name) for name in cube["record"].values]
    given = [motion.id for motion in inputs.motions]
    if sorted(given) != sorted(records):
        odd = sorted(set(given) ^ set(records))
        raise InputError(
            f"motions and cube do not belong together: {', '.join(odd) or 'a record is twice'}"
        )
    for name, _, _ in inputs.arches:
        if name not in inputs.fits:
            raise InputError(f"fits holds neither a curve nor a sentence for arch {name!r}")


def _motion_section(inputs: ReportInputs, cube: xr.Dataset, scale: Scale) -> dict[str, Any]:
    from archfrag.motions.measures import measure, spectral_acceleration

    measures = {
        motion.id: {name: measure(motion, name) for name in ("PGA", "PGV", "Arias", "D5_95")}
        for motion in inputs.motions
    }
    spectra = inputs.spectra or {
        motion.id: (PERIODS, np.asarray(spectral_acceleration(motion, PERIODS, damping=0.05)))
        for motion in inputs.motions
    }
    level = _shown_level(inputs, cube)
    factors = cube["scale_factor"].transpose("record", "level").values[:, level]
    records = [str(name) for name in cube["record"].values]
    shown: Picture = motion_figures.spectra(
        spectra,
        dict(zip(records, factors, strict=True)),
        f"{scale.measure} = {scale.text(float(cube['intensity'].values[level]))}",
        "spectra",
    )
    return {
        "thumbnails": motion_figures.thumbnails(inputs.motions, "thumbnails"),
        "table": tables.motions(cube, inputs.motions, measures),
        "accepted": accepted_records(cube),
        "spectra": shown,
    }


def _shown_level(inputs: ReportInputs, cube: xr.Dataset) -> int:
    """Level closest to the median capacity, the middle one where no arch has a curve."""
    intensity = cube["intensity"].values
    medians = [fit.theta for fit in inputs.fits.values() if isinstance(fit, Fragility)]
    if not medians:
        return intensity.size // 2
    return int(np.abs(np.log(intensity) - np.log(np.median(medians))).argmin())


def _plain(item: tuple[str, Any]) -> tuple[str, str]:
    """A provenance entry as text; JSON, given as text or as a mapping, is laid out in lines."""
    name, value = item
    if isinstance(value, str) and value[:1] in "{[":
        try:
            value = json.loads(value)
        except ValueError:
            return name, value
    if isinstance(value, Mapping | list | tuple):
        return name, json.dumps(value, indent=2, ensure_ascii=False, default=str)
    return name, str(value)
