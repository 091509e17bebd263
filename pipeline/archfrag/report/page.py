"""The report of a study: one HTML file that needs no network, and its numbers for programs.

Its sections on arches stand in `archfrag.report.sections`, those on the whole study here.
"""

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import OutputError, attempt
from archfrag.files import check_targets, make_folder
from archfrag.fragility.curve import FloatArray
from archfrag.motions.measures import measure, parse_measure, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.report import curve_figures, html, svg
from archfrag.report.film import typical_run
from archfrag.report.first_page import first_page, lead_sentence, leading_arch
from archfrag.report.html import TEXTS, Picture, digits, measured, paragraph, table
from archfrag.report.inputs import (
    ReportInputs,
    Scale,
    report_inputs,
    summary,
)
from archfrag.report.limits import study_aspects
from archfrag.report.papers import write_papers
from archfrag.report.risk_section import risk_section
from archfrag.report.sections import (
    PageSection,
    answers_table,
    arch_sections,
    class_sections,
    table_sections,
)
from archfrag.report.svg import Entry, Sheet, figure, log_ticks
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import CURVE, FITS, cautions_of, gathered, store_fits
from archfrag.study.answer.rates import risk_of_study
from archfrag.study.file.members import SHOWN
from archfrag.study.file.schema import StudyKeys
from archfrag.study.products import ALL_CURVES, README, REPORT_FILES
from archfrag.study.provenance import OWNER, write_text

SUMMARY = REPORT_FILES[1]  # beside the page
_FEW_PERIODS = np.geomspace(0.03, 4.0, 32)  # of the figure of spectra [s]
_BINS = 110  # of a thumbnail
_NAME = 180.0  # of a record under its thumbnail [px]
_MOST_THUMBNAILS = 60
_MOST_SPECTRA = 80


def make_report(study: StudyKeys, table: Fitted | None = None) -> Path:
    """Write the report of a finished study and return its path.

    Of a `table` of verdicts it has no arches and no motions, and its curves are stored too;
    OutputError if the folder holds the results of a study.

    Beside it are its numbers ``summary.json``, its curves as SVG files (``curves.svg`` in the
    place of those of many arches), and the tables of `archfrag.report.papers`.
    """
    out = study.folder / "report.html"
    if table is None:
        return write_report(report_inputs(study), out)
    if (study.work / OWNER).exists():
        raise OutputError(
            f"{study.folder}: holds the results of a study; give another output"
        )
    given = [
        str(table.cube.attrs["table_source"]),
        study.risk.hazard if study.risk else None,
    ]
    check_targets([study.folder / FITS, study.folder / CURVE], given)
    make_folder(study.folder)
    scale = Scale(
        study.intensity.measure, study.intensity.unit, 1.0 / study.intensity.factor
    )
    inputs = ReportInputs(
        table.cube,
        scale,
        (),
        (),
        table.arches,
        table.classes,
        cautions_of(study, table),
        title=study.title,
        confidence=study.report.confidence,
        risk=attempt(partial(risk_of_study, study, table)),
    )
    write_report(inputs, out, given)
    store_fits(study, table)
    return out


def write_report(
    inputs: ReportInputs, out: Path, given: Iterable[str | Path | None] = ()
) -> Path:
    """Write the report `out` and the files beside it; return its path.

    Raise OutputError if they cannot be written, or would replace what was `given` or is of others.
    """
    text, figures = render(inputs)
    names = (*figures, *(name for name in REPORT_FILES if name != README))
    check_targets([out.parent / name for name in names], given, of_study=True)
    for name, picture in figures.items():
        write_text(out.parent / name, picture.file)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out.parent / SUMMARY, numbers + "\n")
    scale = inputs.scale
    write_papers(inputs.fitted, scale.measure, scale.unit, scale.factor, out.parent)
    write_text(out, text)
    return out


def render(inputs: ReportInputs) -> tuple[str, dict[str, Picture]]:
    """Return the page as text, and by file name the figures that are files too."""
    curves = curve_figures.all_curves(inputs, inputs.answers, inputs.classes)
    sections = [*risk_section(inputs), *overview(inputs, curves)]
    if not inputs.arches:  # runs of another program
        sections += table_sections(inputs)
        first = Markup("<h1>{}</h1>").format(inputs.title)
        shown = list(inputs.quoted)
        first += lead_sentence(inputs)
    else:
        lead = leading_arch(inputs)
        examples = [typical_run(inputs, place) for place in range(len(inputs.arches))]
        arches, appendix = arch_sections(inputs, examples, lead)
        sections += [
            *class_sections(inputs),
            *arches,
            motions_section(inputs),
            provenance_section(inputs.cube.attrs),
            *appendix,
            glossary_section(inputs),
        ]
        first = first_page(inputs, examples[lead])
        shown = [name for name, _, _ in inputs.arches if name in inputs.quoted]
    # Cautions that no section has; of those of arches that differ in numbers only the first.
    rest = [words for words in inputs.cautions if words.partition(": ")[0] not in shown]
    digest = base64.b64encode(hashlib.sha256(html.SCRIPT.encode()).digest()).decode()
    listed = inputs.quoted
    text = html.template(
        "report.html.j2",
        inputs=inputs,
        scale=inputs.scale,
        sections=sections,
        n_level=inputs.cube.sizes["level"],
        n_arch=len(inputs.answers),
        script=html.SCRIPT,
        script_hash=f"'sha256-{digest}'",
        first=first,
        answers=answers_table(inputs, listed) if len(listed) > 1 else "",
        cautions=html.cautions(gathered(rest, inputs.cube, shown)),
    )
    figures = {
        name: picture for section in sections for name, picture in section.files.items()
    }
    return text, figures | ({ALL_CURVES: curves} if len(inputs.answers) > SHOWN else {})


def overview(inputs: ReportInputs, curves: Picture) -> Iterator[PageSection]:
    """Yield the section on all arches, if there are several; `curves` is their figure."""
    if len(inputs.quoted) > 1:
        yield PageSection("all", "All arches", [curves, *_ratios(inputs)])


def _ratios(inputs: ReportInputs) -> Iterator[Markup]:
    """Yield medians and rates of arches or classes over those of their references."""
    ratios = inputs.ratios
    if isinstance(ratios, str):
        yield paragraph(f"There are no ratios: {ratios}.", "note")
        return
    words = {
        "theta": f"median capacity θ [{inputs.scale.unit}]",
        "rate": "collapses a year",
    }
    rows = []
    for name, of_measure in ratios.items():
        for what, row in of_measure.items():
            form = inputs.scale.digits if what == "theta" else html.rounded
            pair = form(row["before"]), form(row["after"])
            ends = f"{row['lower']:.2f} to {row['upper']:.2f}"
            over = inputs.references[name]
            rows.append([name, over, words[what], *pair, f"{row['ratio']:.2f}", ends])
    if rows:
        heads = ["arch", "over", "", "that one", "this arch", "ratio", inputs.percent]
        yield table("Ratios of arches", heads, rows, "compact", 3)
        yield paragraph(TEXTS["ratios"]["how"], "note")


def thumbnails(motions: Sequence[Motion]) -> Picture:
    """Draw accelerograms, each divided by its peak, as many in a row as the page has room for."""
    shown = motions[:_MOST_THUMBNAILS]
    pieces = []
    for motion in shown:
        values = np.asarray(motion.acceleration, dtype=float)
        _, low, high = svg.envelope(values / (np.abs(values).max() or 1.0), _BINS)
        place = np.linspace(0.5, 109.5, low.size)
        outline = svg.ribbon(place, 20.0 - 19.0 * low, 20.0 - 19.0 * high)
        pieces.append(
            f'<div><svg viewBox="0 0 110 40" preserveAspectRatio="none" aria-hidden="true">'
            f'<path d="M0 20H110" class="gr"/><path d="{outline}" class="wave"/></svg>'
            f"<span>{escape(svg.shortened(motion.id, _NAME))}</span>"
            f"<span>{measure(motion, 'PGA') / STANDARD_GRAVITY:.2f} g, {motion.duration:.0f} s"
            "</span></div>"
        )
    label = f"Accelerograms of {len(shown)} of {len(motions)} ground motions"
    return Picture(
        f'<div class="thumbnails" role="img" aria-label="{label}">{"".join(pieces)}</div>',
        f"{label}: horizontal acceleration divided by its PGA, which is given with the duration.",
    )


@figure
def spectra(
    sheet: Sheet,
    periods: FloatArray,
    scaled: FloatArray,
    level: str,
    target: FloatArray | None = None,
    marks: Sequence[float] = (),
) -> tuple[str, str]:
    """Draw spectra (n_record, n_period) [g] at 5 % damping with their median and 16 to 84 %.

    A `target` has rows of periods, median [g] and sd of ln Sa; `marks` are periods of the measure.
    """
    low, median, high = np.nanquantile(scaled, [0.16, 0.5, 0.84], axis=0)
    floor = max(median.max() / 1000.0, 0.7 * float(np.nanmin(scaled[scaled > 0])))
    entries = [
        Entry("records", svg.GREY, "line"),
        Entry("16 to 84 %", "#b9dcf2"),
        Entry("median", svg.BLUE, "line"),
    ]
    if target is not None:
        entries.append(Entry("target: median, 16 and 84 %", svg.VERMILION, "line"))
    x = (float(periods[0]), float(periods[-1]))
    y = (floor, 1.3 * float(np.nanmax(scaled)))
    panel = svg.panel_below(sheet, entries, 240.0, x, y, log=True)
    panel.axis_x(log_ticks(*x), "period [s]", grid=True)
    panel.axis_y(log_ticks(*y), "Sa, 5 % damping [g]")
    shown = scaled[:_MOST_SPECTRA]
    for row in np.where(shown >= floor, shown, np.nan):
        panel.line(periods, row, svg.GREY, 0.5, opacity=0.6)
    panel.band(periods, np.maximum(low, floor), np.maximum(high, floor), svg.SKY, 0.35)
    panel.line(periods, np.where(median >= floor, median, np.nan), svg.BLUE, 2.0)
    if target is not None:
        at, middle, sd = target[:, (target[0] >= x[0]) & (target[0] <= x[1])]
        for z, width, dash in (
            (0.0, 2.0, ""),
            (1.0, 1.2, "5 2.5"),
            (-1.0, 1.2, "5 2.5"),
        ):
            panel.line(
                at, np.clip(middle * np.exp(z * sd), *y), svg.VERMILION, width, dash
            )
    for mark in marks:
        panel.line([mark, mark], y, svg.INK, 0.9, "2 2")
    return (
        f"Response spectra of {len(scaled)} records {level}",
        f"Pseudo-acceleration spectra at 5 % damping of {len(shown)} of {len(scaled)} records, "
        f"{level}." + " Dotted: periods of the study's measure." * bool(marks),
    )


def motions_section(inputs: ReportInputs) -> PageSection:
    """Return the section on the ground motions."""
    cube = inputs.cube
    recorded = "Ground motions as recorded"
    parts: list[Any] = [thumbnails(inputs.motions), _scaled_spectra(inputs)]
    parts.append(html.folded(recorded, _motion_table(inputs)))
    events = Counter(sorted(filter(None, cube["event"].values.astype(str).tolist())))
    if events:
        listed = table(
            "Earthquakes", ["earthquake", "records"], events.items(), "compact"
        )
        remark = paragraph(TEXTS["notes"]["events"], "note")
        parts.append(html.folded("Earthquakes", remark, listed))
    parts += _first_shocks(inputs)
    waivers = cube["accepted"].values.astype(str) if "accepted" in cube else ()
    named = [
        f"{name!s} ({words})"
        for name, words in zip(cube["record"].values, waivers)
        if words
    ]
    if named:
        words = f"Records accepted despite a warning: {', '.join(named)}."
        parts.append(paragraph(words, "caution"))
    return PageSection("motions", "Ground motions", parts)


def _first_shocks(inputs: ReportInputs) -> Iterator[Any]:
    """Yield which first shocks come before the records, how strong, and which before which."""
    plan = inputs.plan
    scale = inputs.scale
    shaken = (
        [] if plan is None else [i for i, arch in enumerate(plan.arches) if arch.shock]
    )
    if plan is None or not shaken:
        return
    levels = dict.fromkeys(scale.text(plan.arches[i].shock[0]) for i in shaken)
    gap = plan.arches[shaken[0]].shock[1]
    names = [*plan.records, *plan.first]
    rows = []
    for record, each in enumerate(plan.records):
        if (shock := plan.shock(shaken[0], record)) is not None:
            rows.append([each.id, names[shock[0]].id])
    listed = ", ".join(dict.fromkeys(first for _, first in rows))
    words = TEXTS["notes"]["shocks"]
    at = f"{scale.measure} {' and '.join(levels)}"
    yield html.heading("First shocks")
    yield paragraph(words.format(names=listed, levels=at, gap=gap))
    first = table("First shocks", ["record", "first shock before it"], rows, "pairs", 2)
    yield html.folded("First shock of each record", first)


def _motion_table(inputs: ReportInputs) -> Markup:
    """Tabulate the motions as recorded, and the factors of the runs."""
    rows = []
    cube = inputs.cube[["scale_factor", "magnitude", "distance"]]
    for motion in inputs.motions:
        record = cube.sel(record=motion.id)
        factor = record["scale_factor"].values[
            np.isfinite(record["scale_factor"].values)
        ]
        rows.append(
            [
                motion.id,
                measured(record["magnitude"].item(), ".2f"),
                measured(record["distance"].item(), ".1f"),
                f"{motion.duration:.1f}",
                f"{motion.dt:g}",
                f"{measure(motion, 'PGA') / STANDARD_GRAVITY:.4f}",
                f"{100 * measure(motion, 'PGV'):.2f}",
                measured(measure(motion, "Arias")),
                f"{measure(motion, 'D5_95'):.1f}",
                "no" if motion.vertical is None else "yes",
                f"{digits(factor.min())} – {digits(factor.max())}"
                if factor.size
                else "not run",
            ]
        )
    heads = [
        "record",
        "M",
        "distance [km]",
        "duration [s]",
        "dt [s]",
        "PGA [g]",
        "PGV [cm/s]",
        "Arias [m/s]",
        "D5\u2060–\u206095 [s]",
        "vertical",
        "scale factors",
    ]
    return table(
        "Ground motions as recorded, and their scale factors", heads, rows, "dense"
    )


def _scaled_spectra(inputs: ReportInputs) -> Picture:
    """Draw the spectra of the motions at the level nearest to the median capacity.

    They are at the middle level if no arch has a curve, as in the runs if each has a level of its
    own, and as selected if there is a target.
    """
    cube = inputs.cube
    scale = inputs.scale
    level = 0
    words = "scaled as in the runs"
    intensity = cube["intensity"].values
    if intensity.ndim == 1:
        medians = [each.theta for each in inputs.answers.values()]
        level = intensity.size // 2
        why = "the middle level"
        if np.isfinite(medians).any():
            level = int(
                np.abs(np.log(intensity) - np.log(np.nanmedian(medians))).argmin()
            )
            why = "the level nearest to the median capacity"
        words = (
            f"scaled to {scale.measure} = {scale.text(float(intensity[level]))}, {why}"
        )
    chosen = (
        cube["scale_factor"].isel(level=level, arch=0, missing_dims="ignore").values
    )
    target, factors = inputs.target or (None, {})
    if target is not None:
        words = "each with the factor with which it was selected for the target"
        names = [motion.id.removesuffix("-rev") for motion in inputs.motions]
        chosen = np.array([factors.get(name, np.nan) for name in names])
    spectra_g = [
        spectral_acceleration(motion, _FEW_PERIODS) * factor / STANDARD_GRAVITY
        for motion, factor in zip(inputs.motions, chosen.tolist())
        if np.isfinite(factor)
    ]
    marks = parse_measure(scale.measure).periods
    return spectra(_FEW_PERIODS, np.stack(spectra_g), words, target, marks)


def provenance_section(attributes: Mapping[str, Any]) -> PageSection:
    """Return the section on what makes the results again, and the attributes of the cube."""
    commit = attributes.get("archfrag_commit", "not known")
    rows = []
    form = Markup('<pre tabindex="0">{}</pre>')
    for name, value in attributes.items():
        if str(value).startswith(("{", "[")):  # JSON, laid out in lines
            value = form.format(
                json.dumps(json.loads(value), indent=2, ensure_ascii=False)
            )
        rows.append((name, value))
    listed = html.pairs("Provenance", rows, "attribute of the cube")
    words = paragraph(TEXTS["notes"]["reproduce"].format(commit=commit))
    return PageSection(
        "provenance",
        "Provenance",
        [words, html.folded("Attributes of the cube", listed)],
    )


def glossary_section(inputs: ReportInputs) -> PageSection:
    """Return the section on terms and on what is modelled."""
    loss = (
        f"{100.0 * float(inputs.cube.attrs['loss_limit']):g} %"  # gap over joint length
    )
    values = {"percent": inputs.percent, "loss_limit": loss}
    terms = [
        (k.format(**values), v.format(**values)) for k, v in TEXTS["glossary"].items()
    ]
    terms.append(
        ("Limits", " ".join(aspect.sentence for aspect in study_aspects(inputs)))
    )
    rows = Markup("\n").join(
        Markup("<dt>{}</dt>\n<dd>{}</dd>").format(*term) for term in terms
    )
    parts = [Markup('<dl class="glossary">\n{}\n</dl>').format(rows)]
    return PageSection("glossary", "Terms and limits", parts)
