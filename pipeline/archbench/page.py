"""`python -m archbench`: measure the parts asked for, keep their tables, write one page."""

import io
import re
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

import jinja2
import pandas as pd
from matplotlib.figure import Figure

from archbench import charts
from archbench.adapters.client import NAMES, solver_versions
from archbench.quantities import QUANTITIES
from archbench.runner import Bench, load_tables
from archfrag.errors import InputError
from archfrag.files import replacing
from archfrag.study.provenance import available_cores

PARTS = {
    "speed": "Speed against accuracy",
    "fragility": "Fragility: error of the curve against cost of the study",
    "knee": "Knee: what an error of theta costs",
    "growth": "Growth with the number of voussoirs",
    "stability": "Stability: where methods fail",
    "joints": "Joints that give",
    "corner_cases": "Corner cases",
    "bands": "How often bands hold the truth",
}
LINES = 10


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
    """Name and figure of each chart of a part."""
    if part == "fragility":
        for study, curves in tables["curves"].groupby("study", sort=False):
            yield f"fragility_{study}", charts.fragility_chart(curves)
    elif part == "speed":
        yield "speed_overview", charts.overview_chart(tables["points"])
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
        yield "joints", charts.joints_chart(tables["errors"], tables["left_out"])
    elif part == "corner_cases":
        yield "corner_cases", charts.corner_chart(tables["runs"])


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
        about = (folder / f"{part}_about.json").read_text(encoding="utf-8")
        sections.append((PARTS[part], list(drawn.items()), small, about))
    summary = _html(summary_table(tables["speed"]["levels"])) if tables["speed"] else ""
    template = Path(__file__).with_name("page.html.j2").read_text(encoding="utf-8")
    page = jinja2.Environment(autoescape=False).from_string(template)
    _write(folder / "index.html", page.render(sections=sections, summary=summary))
    return folder / "index.html"


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def gather(
    parts: Sequence[str],
    output: Path,
    *,
    quick: bool = False,
    records: Path | None = None,
    real: Path | None = None,
    solvers: Sequence[str] = (),
    workers: int | None = None,
    report: Callable[[str], None] = print,
) -> Path:
    """Measure parts one after the other, save each as soon as it is there, write the page.

    `parts` are of `PARTS`, all if empty; tables of other parts in `output` are left and shown.
    `records` are those of the working folder, or of the checkout, if not given. `solvers` may be
    "all" of those that are installed.
    """
    for name in parts:
        if name not in PARTS:
            raise InputError(
                f"evidence has no part {name!r}; allowed are {', '.join(PARTS)}"
            )
    for name in solvers:
        if name not in (*NAMES, "all"):
            raise InputError(
                f"--solvers: {name!r}; allowed are all, {', '.join(NAMES)}"
            )
    found = solver_versions(
        NAMES if "all" in solvers else tuple(dict.fromkeys(solvers))
    )
    for name, text in found.items():
        if text.startswith("not installed") and "all" not in solvers:
            raise InputError(f"--solvers: {name} {text}")
        report(f"{name}: {text}")
    here = Path("records")
    checkout = Path(__file__).parents[2] / "records"
    bench = Bench(
        output,
        quick,
        (records or (here if here.is_dir() else checkout)).resolve(),
        None if real is None else real.resolve(),
        {
            name: text
            for name, text in found.items()
            if not text.startswith("not installed")
        },
        workers or available_cores(),
        report,
    )
    for part in parts or PARTS:
        began = time.perf_counter()
        bench.save(part, import_module(f"archbench.{part}").measure(bench))
        report(f"{part}: {time.perf_counter() - began:.0f} s")
    return write_page(output)
