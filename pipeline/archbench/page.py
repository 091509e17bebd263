"""`python -m archbench`: measure the parts asked for, keep their tables, write one page."""

import io
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import jinja2
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from archbench import charts
from archbench.adapters.client import MISSING, NAMES, solver_versions
from archbench.quantities import QUANTITIES
from archbench.runner import PARTS, QUICK, Bench, about_of, digest, load_tables
from archbench.settings import available_methods
from archbench.speed import cost_over
from archfrag.errors import InputError
from archfrag.files import replacing
from archfrag.study.provenance import strict_json
from archfrag.system import available_cores

LINES = 10
HOURS = 4.0  # of all parts
RECORDS = 30  # of the part fragility
# Tables that charts are drawn of; what their rows are told apart by, and what is compared.
DRAWN = {
    "speed": ["points"],
    "fragility": ["curves"],
    "knee": ["settings"],
    "growth": ["runs", "exponents"],
    "stability": ["cells"],
    "joints": ["errors", "models"],
    "corner_cases": ["runs"],
}
Error = tuple[str, str, float, float, float]
OURS = ("auto", "time_stepping", "event_driven")
ALIKE = {
    "speed": ("points", ["scene", "quantity", "method", "value"], "seconds"),
    "knee": ("settings", ["arch", "method", "value"], "seconds"),
    "growth": ("runs", ["voussoirs", "method"], "seconds"),
    "stability": ("cells", ["plane", "row", "value", "method"], "kind"),
    "corner_cases": ("runs", ["case", "variant", "method"], "result"),
    "joints": ("errors", ["arch", "stiffness", "pulse"], "error_rigid"),
    "spans": ("borders", ["pulse", "spans"], "over_most"),
}
# How far a quick measurement may be from the page: costs by this factor, all else by so much.
FACTOR = 2.0
APART = 0.1


def summary_table(levels: pd.DataFrame) -> pd.DataFrame:
    """Which method at which error: the one that reaches it in most scenes, then the cheapest."""
    order = levels.sort_values(
        ["error", "scenes", "over_cheapest"], ascending=[False, False, True]
    )
    columns = [
        "error",
        "method",
        "parameter",
        "value",
        "scenes",
        "seconds",
        "over_cheapest",
    ]
    return order.groupby("error", sort=False).head(1)[columns].head(LINES)


def figures_of(
    part: str, tables: dict[str, pd.DataFrame]
) -> Iterator[tuple[str, Figure]]:
    """Name and figure of each chart of a part; none where a table of it is missing."""
    if any(name not in tables for name in DRAWN.get(part, ())):
        return
    if part == "fragility":
        for study, curves in tables["curves"].groupby("study", sort=False):
            yield f"fragility_{study}", charts.fragility_chart(curves)
    elif part == "speed":
        for quantity in QUANTITIES:
            if figure := charts.cost_chart(tables["points"], quantity):
                yield f"speed_{quantity}", figure
    elif part == "knee":
        yield "knee", charts.knee_chart(tables["settings"])
    elif part == "growth":
        yield "growth", charts.growth_chart(tables["runs"], tables["exponents"])
    elif part == "stability":
        for plane, cells in tables["cells"].groupby("plane", sort=False):
            yield f"stability_{plane}", charts.stability_map(cells)
    elif part == "joints":
        yield "joints", charts.joints_chart(tables["errors"], tables["models"])
    elif part == "corner_cases":
        yield "corner_cases", charts.corner_chart(tables["runs"])


def errors_table(
    tables: Mapping[str, Mapping[str, pd.DataFrame]],
) -> pd.DataFrame:
    """Errors of ln theta by steps, programs, joints, spans and records, with their cost.

    `cost` is over that of a study by default: `auto`, 30 records, one span with rigid joints.
    `error` is a mean over arches, for steps and joints the root of that of its square; below
    `known_to` it is not known.
    """
    made: dict[tuple[str, str], Callable[[pd.DataFrame], Iterator[Error]]] = {
        ("knee", "settings"): _by_steps,
        ("fragility", "curves"): _by_programs,
        ("joints", "models"): _by_joints,
        ("spans", "theta"): _by_spans,
    }
    rows = [
        row
        for (part, name), errors in made.items()
        if name in tables.get(part, {})
        for row in errors(tables[part][name])
    ]
    table = pd.DataFrame(rows, columns=["kind", "what", "cost", "error", "known_to"])
    return table.dropna(subset=["cost"])  # without a study by default


def _by_steps(knee: pd.DataFrame) -> Iterator[Error]:
    unit = knee["arch"].map(knee[charts.is_default(knee)].set_index("arch")["seconds"])
    knee = knee.assign(cost=knee["seconds"] / unit)[knee["rms"] > 0.0]
    for (method, value), own in knee.groupby(["method", "value"], sort=False):
        yield (str(method), f"{value:g}", *_mean_error(own))


def _by_programs(curves: pd.DataFrame) -> Iterator[Error]:
    unit = curves.loc[charts.is_default(curves), "seconds"].median()
    for method, own in curves[~curves["method"].isin(OURS)].groupby("method"):
        best = own.iloc[-1]
        error = best["theta_difference"], best["theta_known_to"]
        label = charts.style_of(str(method)).label
        yield (str(method), label, best["seconds"] / unit, *error)
    sampling = curves["theta_sampling"].iloc[0]
    for part in (1 / 3, 1.0, 10.0 / 3, 10.0):
        words = f"{RECORDS * part:.0f} records"
        yield ("records", words, part, sampling * part**-0.5, 0.0)


def _by_joints(models: pd.DataFrame) -> Iterator[Error]:
    models = models[np.isfinite(models["stiffness"])]
    keys = ["arch", "stiffness"]
    rigid = models.loc[models["model"] == "rigid", [*keys, "seconds"]]
    models = models.merge(rigid, "left", keys, suffixes=("", "_rigid"))
    exact = models["error"] == 0.0
    usual = models.loc[~exact, "standard_error"].median()
    models["cost"] = models["seconds"] / models["seconds_rigid"]
    models["standard_error"] = models["standard_error"].mask(exact, usual)
    for model, own in models.groupby("model", sort=False):
        yield ("joints", str(model), *_mean_error(own))


def _by_spans(theta: pd.DataFrame) -> Iterator[Error]:
    unit = theta.loc[theta["spans"] == 1, "seconds"].median()
    known = np.maximum(theta["standard_error"], theta["standard_error"].median())
    error = np.log1p(theta["over_most"])
    columns = theta["spans"], theta["seconds"] / unit, error, known
    for spans, *row in zip(*columns, strict=True):
        yield ("spans", f"{spans:g} of {theta['spans'].max():g} spans", *row)


def _mean_error(own: pd.DataFrame) -> tuple[float, float, float]:
    """Mean cost of some rows, root mean square of error and of standard error."""
    squares = (own[["error", "standard_error"]] ** 2).mean() ** 0.5
    return float(np.exp(np.log(own["cost"]).mean())), *squares


def overview(tables: Mapping[str, Mapping[str, pd.DataFrame]]) -> Figure | None:
    """The chart of README: errors of steps, programs and models against their cost.

    None if the default was not measured.
    """
    if "points" not in tables["speed"]:
        return None
    return charts.errors_chart(tables["speed"]["points"], errors_table(tables))


def other_points(points: pd.DataFrame) -> pd.DataFrame:
    """Drawn points of others' solvers and baselines, with their cost over ours."""
    shown = points[points["quantity"].isin(["amplitude", "peak", "position"])]
    shown = shown[shown["drawn"].astype(bool)]
    shown = shown.assign(error=np.maximum(shown["error"], shown["floor"]))
    shown = shown.assign(over_ours=cost_over(shown, OURS))
    return shown[~shown["method"].isin(OURS)]


def solvers_table(points: pd.DataFrame, left_out: pd.DataFrame) -> pd.DataFrame:
    """Least error of the collapse amplitude by scene and other solver, or why there is none.

    With it, the cost of a run over that of ours at equal error.
    """
    known = set(available_methods())
    others = [name for name in dict.fromkeys(points["method"]) if name not in known]
    asked = points[points["quantity"] == "amplitude"]
    shown = other_points(asked)
    why = dict(zip(left_out["what"], left_out["why"], strict=True))
    rows = []
    for scene in dict.fromkeys(points["scene"]):
        row = {"scene": scene}
        for name in others:
            own = shown[(shown["scene"] == scene) & (shown["method"] == name)]
            said = why.get(f"{scene}, {name}", "no change of the verdict within reach")
            if len(own):
                best = own.loc[own["error"].idxmin()]
                said = f"{100.0 * best['error']:.2g} %, × {best['over_ours']:.3g}"
            row[name] = said
        rows.append(row)
    return pd.DataFrame(rows)


def left_out_table(tables: Mapping[str, Mapping[str, pd.DataFrame]]) -> pd.DataFrame:
    """What all parts left out, by reason."""
    found = [
        own["left_out"].assign(part=part)
        for part, own in tables.items()
        if "left_out" in own
    ]
    table = pd.concat([pd.DataFrame(columns=["part", "what", "why"]), *found])
    # Reasons that differ in numbers alone are one.
    kind = table["why"].str.replace(r"\d[\d.e+-]*", "…", regex=True)
    grouped = table.groupby(["part", kind], sort=False)
    counted = grouped.agg(cases=("what", "size"), first=("what", "first"))
    return counted.reset_index()[["part", "why", "cases", "first"]]


def compare(page: Path, quick: Path) -> pd.DataFrame:
    """Figures of a page beside those of a quick measurement, and whether they agree.

    Both are of the rows that both have. Costs are over ours at equal error, or over that of
    `auto`, and may differ by `FACTOR`; fractions that are right, and errors, by `APART`.
    """
    rows = []
    for part, (name, keys, value) in ALIKE.items():
        tables = [load_tables(folder, part) for folder in (page, quick)]
        if not all(name in own for own in tables):
            continue
        known, found = (
            _by_key(own[name].dropna(subset=[value]), keys) for own in tables
        )
        both = known.index.intersection(found.index)
        figures = [
            _figures(part, own.loc[both].reset_index(), value) for own in (known, found)
        ]
        for what in figures[0].index.intersection(figures[1].index):
            one, other = (own[what] for own in figures)
            held = abs(other - one) <= APART
            if value == "seconds":
                held = max(one / other, other / one) <= FACTOR
            row = {"part": part, "figure": what, "page": one, "quick": other}
            rows.append({**row, "rows": len(both), "agree": bool(held)})
    return pd.DataFrame(rows)


def _by_key(table: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    table = table.fillna({"variant": ""})
    grouped = table.groupby(keys, sort=False)
    numbers = grouped.median(numeric_only=True)
    return grouped.first().assign(**numbers)


def _figures(part: str, table: pd.DataFrame, value: str) -> pd.Series:
    """One figure for each method."""
    if part == "speed":
        found = other_points(table)
        return found["over_ours"].groupby(found["method"]).median().dropna()
    if value == "seconds":
        cost = np.exp(np.log(table[value]).groupby(table["method"]).mean())
        return (cost / cost["auto"]).drop("auto")
    if "method" in table:
        right = table[value].isin(["right", "undecided", "held"])
        return right.groupby(table["method"]).mean()
    return table[value].groupby(table[ALIKE[part][1][-1]]).median()


def svg_of(figure: Figure) -> str:
    """A figure as inline SVG."""
    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(buffer, format="svg", metadata=nothing)
    return re.sub(r"^.*?(?=<svg )", "", buffer.getvalue(), flags=re.DOTALL)


def _html(table: pd.DataFrame) -> str:
    return table.to_html(index=False, na_rep="", float_format="{:.3g}".format, border=0)


def write_page(folder: Path) -> Path:
    """Write `index.html` and the charts as SVG files from all tables of a folder."""
    tables = {part: load_tables(folder, part) for part in PARTS}
    sections = []
    for part, found in tables.items():
        if not found:
            continue
        drawn = {name: svg_of(figure) for name, figure in figures_of(part, found)}
        for name, svg in drawn.items():
            _write(folder / f"{name}.svg", svg)
        small = {
            name: _html(table) for name, table in found.items() if len(table) <= 60
        }
        about = strict_json(about_of(folder, part))
        sections.append((PARTS[part].title, list(drawn.items()), small, about))
    figure = overview(tables)
    chart = svg_of(figure) if figure else ""
    if chart:
        _write(folder / "overview.svg", chart)
    levels = tables["speed"].get("levels")
    summary = "" if levels is None else _html(summary_table(levels))
    template = Path(__file__).with_name("page.html.j2").read_text(encoding="utf-8")
    page = jinja2.Environment(autoescape=False).from_string(template)
    known = {"sections": sections, "summary": summary, "overview": chart}
    text = page.render(known, stale=staleness(folder))
    _write(folder / "index.html", text)
    return folder / "index.html"


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def staleness(folder: Path) -> str:
    """One sentence on the parts whose tables are not of today's kernels; empty if all are."""
    kept = {part: about_of(folder, part).get("kernels") for part in PARTS}
    old = [part for part, own in kept.items() if own and own != digest(part)]
    missing = [part for part, own in kept.items() if not own]
    said = (("of other kernels than today's", old), ("not measured yet", missing))
    found = [
        f"{what}: {', '.join(PARTS[part].title.partition(':')[0] for part in parts)}"
        for what, parts in said
        if parts
    ]
    return f"Not all figures are of today ({'; '.join(found)})." if found else ""


def gather(
    parts: Sequence[str],
    output: Path | None = None,
    workers: int | None = None,
    report: Callable[[str], None] = print,
    hours: float | None = None,
) -> Path:
    """Measure parts one after the other, save each as soon as it is there, write the page.

    `parts` are of `PARTS`; "all" of them, or "quick" for the reduced set of those that are named,
    or of all. A part whose tables in `output` are of the same sources is left as it is. All
    solvers that are installed take part. `hours` are those that all parts may take.
    """
    quick = "quick" in parts
    named = [name for name in parts if name not in ("all", "quick")]
    for name in named:
        if name not in PARTS:
            raise InputError(
                f"evidence has no part {name!r}; allowed are all, quick, "
                f"{', '.join(PARTS)}"
            )
    found = solver_versions(NAMES)
    for name, text in found.items():
        report(f"{name}: {text}")
    folder = output or Path("results", "quick" if quick else "evidence")
    bench = Bench(
        folder,
        quick,
        solvers={
            name: text for name, text in found.items() if not text.startswith(MISSING)
        },
        workers=workers or available_cores(),
        report=report,
    )
    share = hours / HOURS if hours else QUICK if quick else 1.0
    for part in PARTS if "all" in parts or not named else named:
        seconds = 60.0 * PARTS[part].minutes * share
        began = time.monotonic()
        own = replace(
            bench, part=part, until=began + seconds, seconds=seconds, left_out=[]
        )
        if own.is_measured():
            report(f"{part}: kept")
            continue
        for name in found.keys() - bench.solvers.keys():
            own.leave_out(name, found[name])
        own.save(import_module(f"archbench.{part}").measure(own))
        report(f"{part}: {time.monotonic() - began:.0f} s")
        write_page(folder)
    return write_page(folder)
