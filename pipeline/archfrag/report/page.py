"""The report of a study: one HTML file that needs no network, and its numbers for programs.

Its sections on arches stand in `archfrag.report.sections`, those on the whole study here.
"""

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import OutputError
from archfrag.files import check_targets, make_folder
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.measures import measure, parse_measure, spectra_of
from archfrag.motions.motion import Motion
from archfrag.report.curve_figures import (
    all_curves,
    contributions,
    hazard_and_fragility,
)
from archfrag.report.film import typical_run
from archfrag.report.first_page import (
    first_page,
    lead_sentence,
    leading,
    leading_arch,
)
from archfrag.report.html import (
    SCRIPT,
    TEXTS,
    Picture,
    cautions,
    digits,
    folded,
    heading,
    interval,
    lines,
    measured,
    pairs,
    paragraph,
    rounded,
    table,
    template,
)
from archfrag.report.inputs import (
    ReportInputs,
    report_inputs,
    thetas,
    write_papers,
)
from archfrag.report.limits import (
    errors_and_costs,
    errors_of,
    errors_sentence,
    study_aspects,
)
from archfrag.report.sections import (
    PageSection,
    answers_table,
    arch_sections,
    class_sections,
    table_sections,
)
from archfrag.report.svg import (
    BLUE,
    GREY,
    INK,
    SKY,
    VERMILION,
    Entry,
    Sheet,
    Words,
    envelope,
    figure,
    panel_below,
    ribbon,
    shortened,
)
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import CURVE, FITS, gathered, store_fits
from archfrag.study.answer.rates import ASSUMPTIONS, StudyRisk
from archfrag.study.file.members import SHOWN
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import (
    ALL_CURVES,
    OWNER,
    README,
    REPORT_FILES,
    write_text,
)

_REMARKS = TEXTS["notes"]
_PERIODS = np.geomspace(0.03, 4.0, 32)  # of the figure of spectra [s]
_MOST_THUMBNAILS = 60
_MOST_SPECTRA = 80


def make_report(study: StudyKeys, table: Fitted | None = None) -> Path:
    """Write the report of a finished study and return its path.

    The report of a `table` of verdicts has no arches and no motions, and its curves are stored
    too; OutputError if the folder holds the results of a study.

    Next to the report are its numbers ``summary.json``, its curves as SVG files (for many arches
    one file ``curves.svg``), and the tables of `archfrag.report.inputs`.
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
    write_report(report_inputs(study, table), out, given)
    store_fits(study, table)
    return out


def write_report(
    inputs: ReportInputs, out: Path, given: Iterable[str | Path | None] = ()
) -> Path:
    """Write the report `out` and the files next to it; return its path.

    `given` are the input files. OutputError if a file cannot be written, or would replace an input
    or a file that archfrag did not make.
    """
    text, figures = render(inputs)
    names = (*figures, *(name for name in REPORT_FILES if name != README))
    check_targets([out.parent / name for name in names], given, of_study=True)
    for name, picture in figures.items():
        write_text(out.parent / name, picture.file)
    write_papers(inputs, out.parent)
    write_text(out, text)
    return out


def render(inputs: ReportInputs) -> tuple[str, dict[str, Picture]]:
    """Return the page as text, and the figures that are written as files, by file name."""
    curves = all_curves(inputs, inputs.answers, list(inputs.classes))
    listed = inputs.quoted
    shown = list(listed)
    sections = list[PageSection]()
    if inputs.risk is not None:
        sections.append(PageSection("risk", "Risk", list(_rates(inputs, inputs.risk))))
    if inputs.code is not None:
        sections.append(
            PageSection("code", "In the words of the code", list(_code(inputs)))
        )
    if len(listed) > 1:
        sections.append(PageSection("all", "All arches", [curves, *_ratios(inputs)]))
    if not inputs.arches:  # runs of another program
        sections += table_sections(inputs)
        first = Markup("<h1>{}</h1>").format(inputs.title) + lead_sentence(inputs)
    else:
        lead = leading_arch(inputs)
        examples = {name: typical_run(inputs, name) for name in inputs.arches}
        arches, appendix = arch_sections(inputs, examples, lead)
        sections += [
            *class_sections(inputs),
            *arches,
            PageSection("motions", "Ground motions", list(_motions(inputs))),
            _provenance(inputs.cube.attrs),
            *appendix,
            _glossary(inputs),
            *_errors(inputs, lead),
        ]
        first = first_page(inputs, examples[lead])
        shown = [name for name in inputs.arches if name in listed]
    # Cautions that are in no section; of those that differ in numbers only, the first.
    rest = [words for words in inputs.cautions if words.partition(": ")[0] not in shown]
    digest = base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
    text = template(
        "report.html.j2",
        inputs=inputs,
        sections=sections,
        script=SCRIPT,
        script_hash=f"'sha256-{digest}'",
        first=first,
        answers=answers_table(inputs, listed) if len(listed) > 1 else "",
        cautions=cautions(gathered(rest, inputs.cube, shown)),
    )
    figures = {ALL_CURVES: curves} if len(inputs.answers) > SHOWN else {}
    for section in sections:
        figures |= section.files
    return text, figures


def _rates(inputs: ReportInputs, risk: StudyRisk | str) -> Iterator[Any]:
    """Yield the rates of collapse, and figures of each arch.

    If there are many arches, only the first three have figures.
    """
    if isinstance(risk, str):
        yield paragraph(f"There are no rates of collapse: {risk}.", "none")
        return
    hazard = risk.hazard
    first = next(iter(hazard.curves))
    words = f"Rates with the hazard curve {first} of {Path(hazard.source).name}"
    yield paragraph(". ".join([words, *hazard.messages, ""]), "note")
    yield _rates_table(risk, inputs.percent)
    rates = [arch.rate for arch in risk.arches.values() if not isinstance(arch, str)]
    if any(rate.mean > rate.quoted for rate in rates):
        yield paragraph(TEXTS["notes"]["mean_rate"], "note")
    shown = SHOWN if len(risk.arches) <= SHOWN else 3
    for name, arch in list(risk.arches.items())[:shown]:
        if len(risk.arches) > 1:
            yield heading(name)
        if isinstance(arch, str):
            yield paragraph(f"No rate: {arch}.", "none")
            continue
        yield cautions(arch.cautions)
        yield hazard_and_fragility(arch, hazard, inputs.scale)
        yield contributions(arch, inputs.scale)
        yield contributions(arch, inputs.scale, "part")
    assumed = (f"{words[0].upper()}{words[1:]}." for words in ASSUMPTIONS)
    yield paragraph(" ".join(assumed), "note")


def _rates_table(risk: StudyRisk, percent: str) -> Markup:
    """Return the table of rates of collapse, with probabilities over `risk.years`."""
    heads = [
        "arch",
        "collapses a year",
        percent,
        "mean rate",
        "return period [years]",
        f"probability in {risk.years:g} years",
        percent,
        "beyond the hazard curve",
        "left out below the onset",
        *(f"a year, {key}" for key in list(risk.hazard.curves)[1:]),
    ]
    rows = []
    for name, arch in risk.arches.items():
        name += f", {risk.classes[name]} arches" if name in risk.classes else ""
        if isinstance(arch, str):
            rows.append([name, "no curve", *["–"] * (len(heads) - 2)])
            continue
        rate = arch.rate
        likely, *ends = rate.probability_in(risk.years)
        least, most = ("at least ", "at most ") if rate.is_bound else ("", "")
        rows.append(
            [
                name,
                least + rounded(rate.quoted),
                interval((rate.lower, rate.upper), rounded),
                rounded(rate.mean),
                most + rounded(rate.return_period),
                least + rounded(likely),
                interval(ends, rounded),
                f"{100 * (rate.below + rate.above):.1f} %",
                rounded(rate.below_onset) if np.any(arch.onset) else "–",
                *(rounded(rate) for rate in list(arch.by_curve.values())[1:]),
            ]
        )
    return table("Rates of collapse", heads, rows, "compact")


def _code(inputs: ReportInputs) -> Iterator[Any]:
    """Yield demand and capacity for the limit states of a building code, and their sources."""
    code = inputs.code
    rows = inputs.code_rows
    if code is None or rows is None:
        return
    unit = inputs.scale.label
    ratio = "capacity / demand" + " (ζ_E)" * (code.norm == "ntc2018")
    heads = [
        "arch",
        "limit state",
        "return period [years]",
        f"demand, {unit}",
        "curve of",
    ]
    heads += [f"capacity: P ≤ {code.probability:g}, {unit}", ratio, "times a year"]
    shown = [
        [
            name,
            word,
            f"{years:,.0f}",
            measured(demand),
            state,
            digits(capacity),
            measured(ratio, ".2f"),
            "at least " * bound + rounded(rate),
        ]
        for name, word, years, demand, state, _, capacity, ratio, rate, bound in rows.values
    ]
    yield table("Demand and capacity", heads, shown, "compact", 2)
    yield paragraph(TEXTS["code"]["how"] + TEXTS["code"][code.norm], "note")
    if rows["demand"].isna().any():
        yield paragraph(TEXTS["code"]["beyond"], "caution")


def _ratios(inputs: ReportInputs) -> Iterator[Markup]:
    """Yield medians and rates of arches or classes over those of their references."""
    ratios = inputs.ratios
    if isinstance(ratios, str):
        yield paragraph(f"There are no ratios: {ratios}.", "note")
        return
    kinds = {
        "theta": (
            f"median capacity θ [{inputs.scale.unit}]",
            inputs.scale.factor,
            digits,
        ),
        "rate": ("collapses a year", 1.0, rounded),
    }
    rows = []
    for name, of_measure in ratios.items():
        for what, row in of_measure.items():
            words, factor, write = kinds[what]
            both = [write(factor * row[end]) for end in ("before", "after")]
            ends = interval((row["lower"], row["upper"]))
            over = inputs.references[name]
            rows.append([name, over, words, *both, f"{row['ratio']:.2f}", ends])
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
        _, low, high = envelope(values / (np.abs(values).max() or 1.0), 110)
        place = np.linspace(0.5, 109.5, low.size)
        outline = ribbon(place, 20.0 - 19.0 * low, 20.0 - 19.0 * high)
        peak = measure(motion, "PGA") / STANDARD_GRAVITY
        pieces.append(
            f'<div><svg viewBox="0 0 110 40" preserveAspectRatio="none" aria-hidden="true">'
            f'<path d="M0 20H110" class="gr"/><path d="{outline}" class="wave"/></svg>'
            f"<span>{escape(shortened(motion.id, 180.0))}</span>"
            f"<span>{peak:.2f} g, {motion.duration:.0f} s</span></div>"
        )
    label = f"Accelerograms of {len(shown)} of {len(motions)} ground motions"
    return Picture(
        f'<div class="thumbnails" role="img" aria-label="{label}">{"".join(pieces)}</div>',
        f"{label}: horizontal acceleration divided by its PGA, which is given with the duration.",
    )


def _motions(inputs: ReportInputs) -> Iterator[Any]:
    """Yield the parts of the section on the ground motions."""
    cube = inputs.cube
    yield thumbnails(inputs.motions)
    yield spectra(inputs)
    yield folded("Ground motions as recorded", _motion_table(inputs))
    events = Counter(sorted(filter(None, cube["event"].values.astype(str).tolist())))
    if events:
        heads = ["earthquake", "records"]
        listed = table("Earthquakes", heads, events.items(), "compact")
        yield folded("Earthquakes", paragraph(_REMARKS["events"], "note"), listed)
    yield from _first_shocks(inputs)
    if "accepted" in cube:
        waivers = zip(*(cube[key].values.astype(str) for key in ("record", "accepted")))
        named = ", ".join(f"{name} ({words})" for name, words in waivers if words)
        words = f"Records accepted despite a warning: {named}."
        if named:
            yield paragraph(words, "caution")


def _first_shocks(inputs: ReportInputs) -> Iterator[Any]:
    """Yield the first shocks with their levels, and which one precedes each record.

    Nothing is yielded if there are none.
    """
    plan = inputs.plan
    scale = inputs.scale
    if plan is None:
        return
    shocks = [each.shock for each in plan.arches if each.shock]
    if not shocks:
        return
    texts = [scale.text(scale.factor * level) for level, _ in shocks]
    levels = " and ".join(dict.fromkeys(texts))
    gap = shocks[0][1]
    rows = [(each.id, each.first.id) for each in plan.records if each.first]
    listed = ", ".join(dict.fromkeys(first for _, first in rows))
    at = f"{scale.measure} {levels}"
    yield heading("First shocks")
    yield paragraph(_REMARKS["shocks"].format(names=listed, levels=at, gap=gap))
    first = table("First shocks", ["record", "first shock before it"], rows, "pairs", 2)
    yield folded("First shock of each record", first)


def _motion_table(inputs: ReportInputs) -> Markup:
    """Tabulate the motions as recorded, and the factors of the runs."""
    rows = []
    for motion in inputs.motions:
        record = inputs.cube.sel(record=motion.id)
        factors = record["scale_factor"].values
        factors = factors[np.isfinite(factors)]
        scaled = "not run"
        if factors.size:
            scaled = f"{digits(factors.min())} – {digits(factors.max())}"
        rows.append(
            {
                "record": motion.id,
                "M": measured(record["magnitude"].item(), ".2f"),
                "distance [km]": measured(record["distance"].item(), ".1f"),
                "duration [s]": f"{motion.duration:.1f}",
                "dt [s]": f"{motion.dt:g}",
                "PGA [g]": f"{measure(motion, 'PGA') / STANDARD_GRAVITY:.4f}",
                "PGV [cm/s]": f"{100 * measure(motion, 'PGV'):.2f}",
                "Arias [m/s]": measured(measure(motion, "Arias")),
                "D5\u2060–\u206095 [s]": f"{measure(motion, 'D5_95'):.1f}",
                "vertical": "no" if motion.vertical is None else "yes",
                "scale factors": scaled,
            }
        )
    label = "Ground motions as recorded, and their scale factors"
    return table(label, list(rows[0]), [[*row.values()] for row in rows], "dense")


def _level_shown(inputs: ReportInputs) -> tuple[int, str]:
    """Return the number of the level at which spectra are shown, and words on it."""
    scale = inputs.scale
    intensity = inputs.cube["intensity"].values
    if intensity.ndim > 1:
        return 0, "scaled as in the runs"
    level = intensity.size // 2
    why = "the middle level"
    medians = thetas(inputs.answers.values())
    if np.isfinite(medians).any():
        away = np.log(intensity) - np.log(np.nanmedian(medians))
        level = int(np.abs(away).argmin())
        why = "the level nearest to the median capacity"
    at = scale.text(scale.factor * intensity[level])
    return level, f"scaled to {scale.measure} = {at}, {why}"


@figure
def spectra(sheet: Sheet, inputs: ReportInputs) -> Words:
    """Draw response spectra at 5 % damping, with their median and 16 to 84 %.

    They are scaled to the level nearest to the median capacity, or to the middle level if no arch
    has a curve. If each run has its own level, they are scaled as in the runs. If there is a
    target, they are scaled as selected for it, and it is drawn too.
    """
    scale = inputs.scale
    level, words = _level_shown(inputs)
    place = {"level": level, "arch": 0}
    chosen = inputs.cube["scale_factor"].isel(place, missing_dims="ignore").values
    if next(iter(inputs.fitted.runs.values())).by_level:
        words += ", of those run at it"
        made = inputs.cube["verdict"].isel(level=level) != Verdict.NOT_RUN
        chosen = np.where(made.any("arch"), chosen, np.nan)
    entries = [Entry("records", GREY, "line"), Entry("16 to 84 %", "#b9dcf2")]
    entries.append(Entry("median", BLUE, "line"))
    target, factors = inputs.target or (None, {})
    if target is not None:
        words = "each with the factor with which it was selected for the target"
        names = [motion.id.removesuffix("-rev") for motion in inputs.motions]
        chosen = np.array([factors.get(name, np.nan) for name in names])
        entries.append(Entry("target: median, 16 and 84 %", VERMILION, "line"))
    run = np.isfinite(chosen)
    found = spectra_of([*compress(inputs.motions, run)], _PERIODS)
    scaled = found * chosen[run, None] / STANDARD_GRAVITY
    low, median, high = np.nanquantile(scaled, [0.16, 0.5, 0.84], axis=0)
    floor = max(median.max() / 1000.0, 0.7 * np.nanmin(scaled[scaled > 0]))
    x = (_PERIODS[0], _PERIODS[-1])
    y = (floor, 1.3 * np.nanmax(scaled))
    panel = panel_below(sheet, entries, 240.0, x, y, log=True)
    panel.axis_x("period [s]", grid=True)
    panel.axis_y("Sa, 5 % damping [g]")
    shown = scaled[:_MOST_SPECTRA]
    for row in np.where(shown >= floor, shown, np.nan):
        panel.line(_PERIODS, row, GREY, 0.5, opacity=0.6)
    panel.band(_PERIODS, np.maximum(low, floor), np.maximum(high, floor), SKY, 0.35)
    panel.line(_PERIODS, np.where(median >= floor, median, np.nan), BLUE, 2.0)
    if target is not None:
        at, middle, sd = target[:, (target[0] >= x[0]) & (target[0] <= x[1])]
        panel.line(at, np.clip(middle, *y), VERMILION, 2.0)
        for ratio in (np.exp(sd), np.exp(-sd)):
            panel.line(at, np.clip(middle * ratio, *y), VERMILION, 1.2, "5 2.5")
    marks = parse_measure(scale.measure).periods
    for mark in marks:
        panel.upright(mark, INK)
    return (
        f"Response spectra of {len(scaled)} records {words}",
        f"Pseudo-acceleration spectra at 5 % damping of {len(shown)} of {len(scaled)} records, "
        f"{words}." + " Dotted: periods of the study's measure." * bool(marks),
    )


def _provenance(attributes: Mapping[str, Any]) -> PageSection:
    """Return the section on how to reproduce the results, with the attributes of the cube."""
    commit = attributes.get("archfrag_commit", "not known")
    rows = []
    form = Markup('<pre tabindex="0">{}</pre>')
    for name, value in attributes.items():
        if str(value).startswith(("{", "[")):  # JSON, laid out in lines
            laid = json.dumps(json.loads(value), indent=2, ensure_ascii=False)
            value = form.format(laid)
        rows.append((name, value))
    listed = pairs("Provenance", rows, "attribute of the cube")
    words = paragraph(_REMARKS["reproduce"].format(commit=commit))
    parts = [words, folded("Attributes of the cube", listed)]
    return PageSection("provenance", "Provenance", parts)


def _errors(inputs: ReportInputs, lead: str) -> Iterator[PageSection]:
    """Yield the section on errors and what it costs to reduce them, if any is known."""
    table = errors_of(inputs, inputs.arches[lead].arch, leading(inputs)[1])
    if len(table):
        parts = [errors_and_costs(table), paragraph(errors_sentence(table))]
        yield PageSection("errors", "Errors and their costs", parts)


def _glossary(inputs: ReportInputs) -> PageSection:
    """Return the section on terms and on what is modelled."""
    loss = 100.0 * float(inputs.cube.attrs["loss_limit"])  # gap over joint length
    values = {"percent": inputs.percent, "loss_limit": f"{loss:g} %"}
    terms = {
        k.format(**values): v.format(**values) for k, v in TEXTS["glossary"].items()
    }
    terms["Limits"] = " ".join(each.sentence for each in study_aspects(inputs))
    form = Markup("<dt>{}</dt>\n<dd>{}</dd>")
    rows = lines(form.format(*term) for term in terms.items())
    parts = [Markup('<dl class="glossary">\n{}\n</dl>').format(rows)]
    return PageSection("glossary", "Terms and limits", parts)
