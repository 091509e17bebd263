"""The report of a study: one HTML file that needs no network, and its numbers for programs."""

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import Markup, escape

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError, attempt
from archfrag.export.papers import write_papers
from archfrag.fragility.curve import Curve, FloatArray
from archfrag.motions.measures import measure, parse_measure, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.report import curve_figures, html
from archfrag.report import svg as look
from archfrag.report.arch_figure import typical_run
from archfrag.report.first_page import first_page, leading_arch
from archfrag.report.html import TEXTS, Picture, digits, measured, paragraph, table
from archfrag.report.inputs import ReportInputs, arch_results, study_config, summary, thetas
from archfrag.report.limits import study_aspects
from archfrag.report.risk_section import risk_parts
from archfrag.report.sections import arch_parts, card, class_parts
from archfrag.report.svg import Entry, Sheet, figure, log_ticks
from archfrag.study.answer.curves import arch_classes
from archfrag.study.answer.fits import gathered
from archfrag.study.file.members import SHOWN
from archfrag.study.provenance import write_text
from archfrag.study.steps import ALL_CURVES, REPORT_FILES

SUMMARY = REPORT_FILES[1]  # beside the page
_FEW_PERIODS = np.geomspace(0.03, 4.0, 32)  # of the report's figure
_BINS = 110  # of a thumbnail
_NAME = 180.0  # of a record under its thumbnail [px]
_MOST_THUMBNAILS, _MOST_SPECTRA = 60, 80
_MOST_ANIMATED, _MOST_ROWS = 4, 200  # arches: with films, and in the table of answers


def write_report(inputs: ReportInputs, out: Path) -> Path:
    """Write the report `out`, or raise OutputError.

    Beside it are its numbers ``summary.json``, its curves as SVG files (``curves.svg`` in the
    place of those of many arches), and the tables of `archfrag.export.papers`.
    """
    text, figures = render(inputs)
    for name, shown in figures.items():
        write_text(out.parent / name, shown.file)
    numbers = json.dumps(summary(inputs), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(out.parent / SUMMARY, numbers + "\n")
    scale = inputs.scale
    write_papers(inputs.fitted, scale.measure, scale.unit, scale.factor, out.parent)
    write_text(out, text)
    return out


def render(inputs: ReportInputs) -> tuple[str, dict[str, Picture]]:
    """The page as text, and by file name the figures that are files too."""
    cube, answers, classes = inputs.cube, inputs.answers, inputs.classes
    every = curve_figures.all_curves(inputs, answers, classes)
    results = [
        arch_results(cube, name, inputs.scale, inputs.fitted.runs[name])
        for name, _, _ in inputs.arches
    ]
    examples = [typical_run(inputs, own, i) for i, own in enumerate(results)]
    leads, of_class = leading_arch(inputs), arch_classes(cube)
    listed = inputs.quoted
    members = {name: answer for name, answer in answers.items() if name not in listed}
    sections: list[tuple[str, str, Iterable[Any]]] = []
    if inputs.risk is not None:
        parts = _parts(risk_parts, inputs.risk, inputs.scale, inputs.percent)
        sections.append(("risk", "Risk", parts))
    if len(listed) > 1:
        sections.append(("all", "All arches", [every, *_ratios(inputs)]))
    figures = {}
    for i, name in enumerate(classes):
        mine = {each: answer for each, answer in members.items() if of_class[each] == name}
        figures[f"curve-{name}.svg"] = curve_figures.all_curves(
            inputs, mine, {name: classes[name]}
        )
        parts = _parts(class_parts, inputs, name, figures[f"curve-{name}.svg"])
        sections.append((f"class{i}", f"Class {name}", parts))
    appendix = [html.folded("Answers", _answers(inputs, members))] if members else []
    for i, (name, _, _) in enumerate(inputs.arches):
        shown = arch_parts(inputs, results[i], i, examples[i], i < _MOST_ANIMATED, i == leads)
        if name in members:
            appendix.append(html.folded(name, *filter(None, shown)))
        else:
            # An arch that has the name of its study was not given any.
            alone = len(answers) == 1 and name == cube.attrs.get("archfrag_study")
            sections.append((f"arch{i}", "The arch" if alone else name, list(shown)))
        if len(answers) <= SHOWN:
            figures[f"curve-{name}.svg"] = curve_figures.curve(results[i], answers[name])
    if len(answers) > SHOWN:
        figures[ALL_CURVES] = every
    if inputs.compared is not None:
        title = f"Compared with study {inputs.compared[0].attrs['archfrag_study']}"
        sections.append(("compared", title, list(_compared(inputs, *inputs.compared))))
    sections.append(("motions", "Ground motions", _motion_parts(inputs)))
    sections.append(("provenance", "Provenance", _provenance(cube.attrs)))
    if members:
        sections.append(("members", "Appendix: arches of classes", appendix))
    # Cautions that no section has; of those of arches that differ in numbers only the first.
    own = [name for name, _, _ in inputs.arches if name not in members]
    rest = [each for each in inputs.cautions if each.partition(": ")[0] not in own]
    loss = f"{100.0 * float(cube.attrs['loss_limit']):g} %"  # gap over joint length
    known, terms = {"percent": inputs.percent, "loss_limit": loss}, TEXTS["glossary"].items()
    digest = base64.b64encode(hashlib.sha256(html.SCRIPT.encode()).digest()).decode()
    text = html.template(
        "report.html.j2", inputs=inputs, scale=inputs.scale, sections=sections,
        n_level=cube.sizes["level"], n_arch=len(answers),
        script=html.SCRIPT, script_hash=f"'sha256-{digest}'",
        first=first_page(inputs, examples[leads]),
        answers=_answers(inputs, listed) if len(listed) > 1 else "",
        cautions=html.cautions(gathered(rest, cube, own)),
        glossary=[
            *((term.format(**known), words.format(**known)) for term, words in terms),
            ("Limits", " ".join(each.sentence for each in study_aspects(inputs))),
        ],
    )  # fmt: skip
    return text, figures


def _ratios(inputs: ReportInputs) -> Iterable[Any]:
    """Medians and rates of arches or classes over those of the first one, by common motions."""
    found, names = inputs.ratios, list(inputs.known)
    if isinstance(found, str):
        yield paragraph(f"There are no ratios: {found}.", "note")
        return
    words = {"theta": f"median capacity θ [{inputs.scale.unit}]", "rate": "collapses a year"}
    rows = []
    for name, each in found.items():
        for what, row in each.items():
            form = inputs.scale.digits if what == "theta" else html.rounded
            pair = form(row["before"]), form(row["after"])
            ends = f"{row['lower']:.2f} to {row['upper']:.2f}"
            rows.append([name, words[what], *pair, f"{row['ratio']:.2f}", ends])
    if rows:
        heads = ["arch", "", names[0], "this arch", "ratio", inputs.percent]
        yield table(f"Ratios to {names[0]}", heads, rows, "compact", 2)
        yield paragraph(TEXTS["ratios"]["how"], "note")


def _parts(make: Callable[..., Iterable[Any]], *given: Any) -> Iterable[Any]:
    """Parts of a section, or why it cannot be made."""
    made = attempt(lambda: list(make(*given)))
    if isinstance(made, str):
        return [paragraph(f"This section is missing: {made}.", "none")]
    return made


def _answers(inputs: ReportInputs, listed: Mapping[str, Curve]) -> Markup:
    scale, at, count = inputs.scale, inputs.at, Counter(arch_classes(inputs.cube).values())
    heads = ["arch", f"median capacity θ [{scale.unit}] ({inputs.percent})"]
    heads.append(f"dispersion β ({inputs.percent})")
    if at is not None:
        heads.insert(1, f"P(collapse) at {scale.text(at / scale.factor)}")
    rows = []
    for name, answer in listed.items():
        row = [f"{name}, {count[name]} arches" if name in inputs.classes else name]
        rows.append(row)
        if not answer.fitted:
            row += ["no curve", *["–"] * (len(heads) - 2)]
            continue
        if at is not None:
            value, *ends = answer.at(at / scale.factor)
            row.append(f"{html.percentages([value])} ({html.percentages(ends)})")
        theta, low, high = map(scale.digits, (answer.theta, *answer.theta_interval))
        row.append(f"{theta} ({low} to {high})")
        row.append(f"{answer.beta:.2f} ({html.interval(answer.beta_interval)})")
    more = f", the first {_MOST_ROWS}" if len(rows) > _MOST_ROWS else ""
    return table(f"Answer for each arch{more}", heads, rows[:_MOST_ROWS], "compact")


def _compared(
    inputs: ReportInputs, other: xr.Dataset, answers: Mapping[str, Curve]
) -> Iterable[Any]:
    """The arches that another study has too; InputError if the two cannot be compared."""
    cubes, of_each = (inputs.cube, other), (inputs.answers, answers)
    names = [str(cube.attrs["archfrag_study"]) for cube in cubes]
    refused = f"study {names[1]!r} cannot be compared with {names[0]!r}"
    kinds = ["{measure} [{units}]".format(**cube["intensity"].attrs) for cube in cubes]
    if kinds[0] != kinds[1]:
        raise InputError(f"{refused}: its levels are of {kinds[1]}, not of {kinds[0]}")
    own = [name for name, _, _ in inputs.arches]
    common = [name for name in own if name in answers]
    if not common:
        raise InputError(f"{refused}: it has no arch {' or '.join(own)}, but {', '.join(answers)}")
    one, two = (set(cube["record"].values.tolist()) for cube in cubes)
    sizes = {"names": names, "sizes": [len(one), len(two)], "common": len(one & two)}
    yield paragraph(TEXTS["notes"]["compared"].format(**sizes), "note")
    settings = pd.concat(map(_settings, cubes), axis=1, keys=names).fillna("–").sort_index()
    differing = settings[settings[names[0]] != settings[names[1]]].itertuples(name=None)
    label = "Settings in which the studies differ"
    yield table(label, ["key", *names], differing, "pairs", numeric_from=3)
    for arch in common:
        yield html.heading(arch)
        results = [arch_results(cube, arch, inputs.scale) for cube in cubes]
        sides = [(each, answers[arch]) for each, answers in zip(results, of_each)]
        yield curve_figures.two_studies(names, sides)
        fits = [answer for _, answer in sides]
        if fits[0].fitted and fits[1].fitted:
            change = f"{100 * (fits[1].theta / fits[0].theta - 1):+.1f} %".replace("-", "−")
            yield paragraph(f"Change of θ from {names[0]} to {names[1]}: {change}.")
        for name, (each, answer) in zip(names, sides):
            yield paragraph(f"{arch} in {name}:")
            yield card(answer, inputs.scale, inputs.percent, results=each)


def _settings(cube: xr.Dataset) -> pd.Series:
    """Keys of a study file, such as ``arches.ring.thickness``, that its results depend on."""
    config = study_config(cube)
    used = ("intensity", "motions", "design", "method")
    parts = {key: config[key] for key in used if key in config}
    parts["arches"] = {entry["id"]: entry for entry in config.get("arches", ())}
    return pd.json_normalize(parts).iloc[0].map(str)


def thumbnails(motions: Sequence[Motion]) -> Picture:
    """Accelerograms, each divided by its own peak, as many in a row as the page is wide for."""
    shown, pieces = motions[:_MOST_THUMBNAILS], []
    for motion in shown:
        values = np.asarray(motion.acceleration, dtype=float)
        _, low, high = look.envelope(values / (np.abs(values).max() or 1.0), _BINS)
        place = np.linspace(0.5, 109.5, low.size)
        outline = look.ribbon(place, 20.0 - 19.0 * low, 20.0 - 19.0 * high)
        pieces.append(
            f'<div><svg viewBox="0 0 110 40" preserveAspectRatio="none" aria-hidden="true">'
            f'<path d="M0 20H110" class="gr"/><path d="{outline}" class="wave"/></svg>'
            f"<span>{escape(look.shortened(motion.id, _NAME))}</span>"
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
    sheet: Sheet, periods: FloatArray, scaled: FloatArray, level: str,
    target: FloatArray | None = None, marks: Sequence[float] = (),
) -> tuple[str, str]:  # fmt: skip
    """Spectra at 5 % damping, (n_record, n_period) [g], with their median and 16 to 84 %.

    A `target` has rows of periods, median [g] and sd of ln Sa; `marks` are periods of the measure.
    """
    low, median, high = np.nanquantile(scaled, [0.16, 0.5, 0.84], axis=0)
    floor = max(median.max() / 1000.0, 0.7 * float(np.nanmin(scaled[scaled > 0])))
    entries = [
        Entry("records", look.GREY, "line"), Entry("16 to 84 %", "#b9dcf2"),
        Entry("median", look.BLUE, "line"),
    ]  # fmt: skip
    if target is not None:
        entries.append(Entry("target: median, 16 and 84 %", look.VERMILION, "line"))
    x, y = (float(periods[0]), float(periods[-1])), (floor, 1.3 * float(np.nanmax(scaled)))
    panel = look.panel_below(sheet, entries, 240.0, x, y, log=True)
    panel.axis_x(log_ticks(*x), "period [s]", grid=True)
    panel.axis_y(log_ticks(*y), "Sa, 5 % damping [g]")
    every, shown = 2 if sheet.narrow else 1, scaled[:_MOST_SPECTRA]
    for row in np.where(shown >= floor, shown, np.nan):
        panel.line(periods[::every], row[::every], look.GREY, 0.5, opacity=0.6)
    panel.band(periods, np.maximum(low, floor), np.maximum(high, floor), look.SKY, 0.35)
    panel.line(periods, np.where(median >= floor, median, np.nan), look.BLUE, 2.0)
    if target is not None:
        at, middle, sd = target[:, (target[0] >= x[0]) & (target[0] <= x[1])]
        for z, width, dash in ((0.0, 2.0, ""), (1.0, 1.2, "5 2.5"), (-1.0, 1.2, "5 2.5")):
            panel.line(at, np.clip(middle * np.exp(z * sd), *y), look.VERMILION, width, dash)
    for mark in marks:
        panel.line([mark, mark], y, look.INK, 0.9, "2 2")
    return (
        f"Response spectra of {len(scaled)} records {level}",
        f"Pseudo-acceleration spectra at 5 % damping of {len(shown)} of {len(scaled)} records, "
        f"{level}." + " Dotted: periods of the study's measure." * bool(marks),
    )


def _motion_parts(inputs: ReportInputs) -> Iterable[Any]:
    cube = inputs.cube
    yield thumbnails(inputs.motions)
    yield _scaled_spectra(inputs)
    yield html.folded("Ground motions as recorded", _motion_table(inputs))
    events = Counter(sorted(filter(None, cube["event"].values.astype(str).tolist())))
    if events:
        listed = table("Earthquakes", ["earthquake", "records"], events.items(), "compact")
        yield html.folded("Earthquakes", paragraph(TEXTS["notes"]["events"], "note"), listed)
    waivers = cube["accepted"].values.astype(str) if "accepted" in cube else ()
    named = [f"{name!s} ({words})" for name, words in zip(cube["record"].values, waivers) if words]
    if named:
        yield paragraph(f"Records accepted despite a warning: {', '.join(named)}.", "caution")


def _motion_table(inputs: ReportInputs) -> Markup:
    rows = []
    cube = inputs.cube[["scale_factor", "magnitude", "distance"]]
    for motion in inputs.motions:
        own = cube.sel(record=motion.id)
        factor = own["scale_factor"].values[np.isfinite(own["scale_factor"].values)]
        rows.append([
            motion.id, measured(own["magnitude"].item(), ".2f"),
            measured(own["distance"].item(), ".1f"), f"{motion.duration:.1f}", f"{motion.dt:g}",
            f"{measure(motion, 'PGA') / STANDARD_GRAVITY:.4f}",
            f"{100 * measure(motion, 'PGV'):.2f}", measured(measure(motion, "Arias")),
            f"{measure(motion, 'D5_95'):.1f}", "no" if motion.vertical is None else "yes",
            f"{digits(factor.min())} – {digits(factor.max())}" if factor.size else "not run",
        ])  # fmt: skip
    heads = [
        "record", "M", "distance [km]", "duration [s]", "dt [s]", "PGA [g]", "PGV [cm/s]",
        "Arias [m/s]", "D5\u2060–\u206095 [s]", "vertical", "scale factors",
    ]  # fmt: skip
    return table("Ground motions as recorded, and their scale factors", heads, rows, "dense")


def _scaled_spectra(inputs: ReportInputs) -> Picture:
    """Spectra at the level nearest to the median capacity, or at the middle level if no arch has
    a curve; as in the runs if each run has a level of its own; as selected if there is a target.
    """
    cube, scale, level, words = inputs.cube, inputs.scale, 0, "scaled as in the runs"
    intensity = cube["intensity"].values
    if intensity.ndim == 1:
        medians, level = thetas(inputs.answers.values()), intensity.size // 2
        why = "the middle level"
        if np.isfinite(medians).any():
            level = int(np.abs(np.log(intensity) - np.log(np.nanmedian(medians))).argmin())
            why = "the level nearest to the median capacity"
        words = f"scaled to {scale.measure} = {scale.text(float(intensity[level]))}, {why}"
    chosen = cube["scale_factor"].isel(level=level, arch=0, missing_dims="ignore").values
    target, factors = inputs.target or (None, {})
    if target is not None:
        words = "each with the factor with which it was selected for the target"
        names = [motion.id.removesuffix("-rev") for motion in inputs.motions]
        chosen = np.array([factors.get(name, np.nan) for name in names])
    spectra_g = [
        spectral_acceleration(motion, _FEW_PERIODS) * factor / STANDARD_GRAVITY
        for motion, factor in zip(inputs.motions, chosen.tolist()) if np.isfinite(factor)
    ]  # fmt: skip
    marks = parse_measure(scale.measure).periods
    return spectra(_FEW_PERIODS, np.stack(spectra_g), words, target, marks)


def _provenance(attributes: Mapping[str, Any]) -> Iterable[Any]:
    """What makes the results again, and attributes of the cube; JSON is laid out in lines."""
    commit = attributes.get("archfrag_commit", "not known")
    yield paragraph(TEXTS["notes"]["reproduce"].format(commit=commit))
    rows, form = [], Markup('<pre tabindex="0">{}</pre>')
    for name, value in attributes.items():
        if str(value).startswith(("{", "[")):
            value = form.format(json.dumps(json.loads(value), indent=2, ensure_ascii=False))
        rows.append((name, value))
    listed = html.pairs("Provenance", rows, "attribute of the cube")
    yield html.folded("Attributes of the cube", listed)
