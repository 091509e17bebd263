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
import xarray as xr
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from archfrag.arch import Arch
from archfrag.errors import InputError, OutputError
from archfrag.fragility.fit import Fragility
from archfrag.report.answer import (
    ArchAnswer,
    answer_table,
    arch_answer,
    classes,
    headline,
    summary,
)
from archfrag.report.arch_section import arch_section
from archfrag.report.curve_figures import Resampled, all_curves, resample
from archfrag.report.measure_figures import MeasureRow
from archfrag.report.motion_figures import Spectrum
from archfrag.report.motion_section import motion_section
from archfrag.report.picture import SVG_STYLE, Picture, standalone
from archfrag.report.plot import hatch_definitions
from archfrag.report.summary import ArchResults, Scale, arch_results, reading_scale
from archfrag.study.cautions import scaled_far
from archfrag.study.steps import REPORT_FILES

if TYPE_CHECKING:
    import pandas as pd

    from archfrag.motions.motion import Motion
    from archfrag.report.beside import Beside
    from archfrag.simulate import Onset


SUMMARY = REPORT_FILES[1]  # beside the page
_MOST_DETAILED = 12  # arches with a section of their own
_MOST_ANIMATED = 4


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
    at : float, optional
        Level at which the probability of collapse is wanted, in the unit of the study.
    limit_states : mapping of arch to sequence of (name, Fragility)
        Curves of limit states in their order, theta in the SI unit of the cube's intensity.
    measures : mapping of arch to sequence of MeasureRow
        Intensity measures compared.
    risk : mapping, optional
        The section on risk: any of ``sentence`` (text), ``pictures`` (of Picture), ``tables`` (of
        (label, Table)) and ``note`` (text), shown in this order.
    """

    cube: xr.Dataset | Path
    measure: str
    motions: Sequence["Motion"]
    arches: Sequence[tuple[str, Arch, "Onset"]]
    fits: Mapping[str, Fragility | str]
    spectra: Mapping[str, Spectrum] | None = None
    timings: "pd.DataFrame | None" = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    title: str = "Fragility of masonry arches"
    confidence: float = 0.9
    beside: "Beside | None" = None
    at: float | None = None
    limit_states: Mapping[str, Sequence[tuple[str, Fragility]]] = field(default_factory=dict)
    measures: Mapping[str, Sequence[MeasureRow]] = field(default_factory=dict)
    risk: Mapping[str, Any] | None = None


def write_report(study_results: ReportInputs, out: Path) -> Path:
    """Write the report, and beside it its numbers and curves; each file whole.

    ``summary.json`` holds what `archfrag.report.answer.summary` says, ``curve-<arch>.svg`` the
    curve of each arch that has a section.

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
        text, sections, data = _render(study_results, cube)
    for section in sections:
        _write_whole(out.parent / f"curve-{section['name']}.svg", standalone(section["curve"]))
    numbers = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    _write_whole(out.parent / SUMMARY, numbers + "\n")
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
        cube = xr.load_dataset(inputs.cube)
    except (OSError, ValueError) as error:
        raise InputError(f"the cube {inputs.cube} cannot be read: {error}") from error
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


def _render(
    inputs: ReportInputs, cube: xr.Dataset
) -> tuple[str, list[dict[str, Any]], dict[str, Any]]:
    """The page, its sections on arches, and the content of ``summary.json``."""
    scale = reading_scale(cube, inputs.measure)
    _check(inputs, cube)
    results = [arch_results(cube, name, scale) for name, _, _ in inputs.arches]
    bands = [_band(each, inputs) for each in results]
    answers = [
        arch_answer(each, inputs.fits[each.arch], band, inputs.confidence, inputs.at)
        for each, band in zip(results, bands, strict=True)
    ]
    detailed = _detailed(answers)
    sections = [
        arch_section(inputs, cube, results[i], i, bands[i], number < _MOST_ANIMATED)
        for number, i in enumerate(detailed)
    ]
    caution = _scaled_far(cube, scale)
    provenance = dict(inputs.provenance) or dict(cube.attrs)
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=inputs.title,
            headline=headline(answers, scale, inputs.confidence),
            answers=answer_table(answers, scale, inputs.confidence),
            bands=sorted({answer.band for answer in answers if answer.band}),
            all_curves=all_curves(
                {a.name: a.fit for a in answers if a.fit is not None},
                dict(zip([a.name for a in answers], bands, strict=True)),
                classes(cube),
                scale,
                max(float(each.levels.max()) for each in results),
                inputs.at,
            ),
            n_arch=len(answers),
            sections=sections,
            beside=_beside(inputs, cube, scale),
            risk=inputs.risk,
            scale=scale,
            caution=caution,
            loss_limit=_loss_limit(cube),
            percent=f"{100 * inputs.confidence:.0f} %",
            n_record=cube.sizes["record"],
            n_level=cube.sizes["level"],
            motions=motion_section(inputs, cube, scale),
            facts=[(k, v) for k, v in map(_plain, provenance.items()) if "\n" not in v],
            documents=[(k, v) for k, v in map(_plain, provenance.items()) if "\n" in v],
            svg_style=Markup(SVG_STYLE),
            hatches=Markup(hatch_definitions()),
        )
    )
    onsets = [onset for _, _, onset in inputs.arches]
    parts = list(zip(answers, results, onsets, strict=True))
    data = summary(inputs, cube, scale, parts, [caution] if caution else [])
    return text, sections, data


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("archfrag.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["inline"] = _inline
    return environment


def _inline(shown: Picture) -> Markup:
    """A picture for all widths, or the drawing for the page's column and the narrow one."""
    if not shown.narrow:
        return Markup(shown.svg)
    return Markup(f'<div class="broad">{shown.svg}</div><div class="slim">{shown.narrow}</div>')


def _band(results: ArchResults, inputs: ReportInputs) -> Resampled | None:
    if isinstance(inputs.fits[results.arch], str):
        return None
    return resample(results, inputs.confidence, inputs.at)


def _detailed(answers: Sequence[ArchAnswer]) -> list[int]:
    """Places of the arches with a section: all, or of many those at even ranks of theta."""
    if len(answers) <= _MOST_DETAILED:
        return list(range(len(answers)))
    order = np.argsort([answer.theta for answer in answers], kind="stable")
    chosen = order[np.linspace(0, len(answers) - 1, _MOST_DETAILED).round().astype(int)]
    return sorted(int(place) for place in chosen)


def _beside(inputs: ReportInputs, cube: xr.Dataset, scale: Scale) -> dict[str, Any] | None:
    if inputs.beside is None:
        return None
    from archfrag.report.beside import beside_section

    return beside_section(inputs, cube, scale)


def _scaled_far(cube: xr.Dataset, scale: Scale) -> str:
    """Caution on motions scaled too far, where all arches share the levels."""
    if cube["intensity"].dims != ("level",):
        return ""
    return scaled_far(cube, [scale.text(level) for level in cube["intensity"].values.tolist()])


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
