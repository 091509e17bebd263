"""For cells of pages: pictures by archfrag's own functions, and figures of a report."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from html import escape
from pathlib import Path

import pandas as pd
from filelock import FileLock
from IPython.display import HTML
from look import picture, svg_of, themed
from matplotlib.figure import Figure

import archfrag as af
from archfrag.report.arch_figure import arch_at_onset
from archfrag.report.film import Example
from archfrag.report.film import film as film_and_frames
from archfrag.report.html import STYLE
from archfrag.report.svg import BLUE, GREY, SKY, VERMILION

ROOT = Path(os.environ["ARCHFRAG_DOCS"]).parent
WORD = re.compile(
    r"\b(?!inf\b)[A-Za-z]{2}"
)  # of a column that does not hold numbers alone


def table(frame: pd.DataFrame) -> HTML:
    """A table without index, columns of numbers to the right; an empty cell has no value."""
    columns = [
        ["" if pd.isna(each) else _written(each) for each in frame[name]]
        for name in frame
    ]
    kinds = [_kind(each) for each in columns]
    head = "".join(
        f"<th{kind}>{escape(str(name).replace('_', ' '))}</th>"
        for name, kind in zip(frame, kinds)
    )
    body = "".join(
        "<tr>"
        + "".join(f"<td{kind}>{escape(one)}</td>" for one, kind in zip(row, kinds))
        + "</tr>"
        for row in zip(*columns)
    )
    return HTML(
        '<div class="table-wrapper"><table class="docutils align-default">'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _kind(column: list[str]) -> str:
    if not any(map(WORD.search, column)):
        return ' class="number"'
    return ' class="text"' if max(map(len, column)) > 24 else ""


def _written(value: object) -> str:
    """Three digits of a fraction, all of what is before the point."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:.3g}"


def arch(shape: af.Arch, caption: str = "") -> HTML:
    """The arch with hinges and thrust line at onset, the ground accelerating to either side."""
    drawn = arch_at_onset(af.onset(shape), "arch")
    return picture(drawn.file, caption)


def shipped_study() -> tuple[dict, Path]:
    """The summary of the shipped study and the folder of its results; it runs once."""

    def make(folder: Path) -> None:
        study, output = (
            str(ROOT / "configs" / "shipped.yaml"),
            json.dumps(str(folder / "results")),
        )
        subprocess.run(
            ["archfrag", "run", study, f"--set=output={output}", "--quiet"], check=True
        )

    results = _once("shipped-study", make) / "results"
    return json.loads((results / "summary.json").read_text("utf-8")), results


def curve_of(results: Path, caption: str = "") -> HTML:
    """The curve of the first class or arch of a study with its band, half a page wide."""
    summary = json.loads((results / "summary.json").read_text("utf-8"))
    found = (summary["classes"] or summary["arches"])[0]
    rows = pd.read_csv(results / "curve.csv")
    rows = rows[rows.iloc[:, 0] == found["id"]]
    level, chance, low, high = (rows[name] for name in rows.columns[-4:])
    theta, onset = found["curve"]["theta"], summary["arches"][0]["onset"]["plus"]
    figure = Figure((3.7, 3.3), layout="constrained")
    axes = figure.subplots()
    axes.fill_between(level, low, high, color=SKY, alpha=0.35, lw=0.0)
    axes.plot(level, chance, color=BLUE, lw=2.0)
    axes.plot([theta, theta, 0.0], [0.0, 0.5, 0.5], color=GREY, lw=0.8, ls="--")
    axes.annotate(
        f"θ {theta:.2g} {summary['unit']}",
        (theta, 0.0),
        (4, 4),
        textcoords="offset points",
    )
    if summary["unit"] == "g":
        axes.plot([onset], [0.0], "o", color=VERMILION, clip_on=False)
        axes.annotate("onset", (onset, 0.0), (0, 6), textcoords="offset points", ha="center",
                      color=VERMILION)  # fmt: skip
    axes.grid(True)
    axes.set(xlabel=f"{summary['measure']} ({summary['unit']})", ylabel="probability of collapse",
             xlim=(0.0, level.max()), ylim=(0.0, 1.0))  # fmt: skip
    return picture(svg_of(figure), caption, words="Fragility curve with its band")


def film(report: Path | str, caption: str = "") -> HTML:
    """The first film of a report, with a box that stops it."""
    return _moving(Path(report).read_text(encoding="utf-8"), caption)


def film_of(response: af.Response, caption: str = "") -> HTML:
    """A run with its history as the film that reports have."""
    motion, factor = response.motion, response.scale
    run = Example(
        response.arch, motion, factor, f"times {factor:.3g}", response, "", same=True
    )
    drawn = "".join(str(each.svg) for each in film_and_frames(run, "film", "A run"))
    return HTML(f'<div class="small">{_moving(drawn, caption).data}</div>')


def _moving(text: str, caption: str) -> HTML:
    start = text.find('<svg class="moving"')
    drawn = (
        re.findall(r"<svg.*?</svg>", text[start:], flags=re.DOTALL)[:2]
        if start >= 0
        else []
    )
    if len(drawn) < 2 or 'class="still' not in drawn[1]:
        raise LookupError("no film with still frames")
    body = themed(f"<style>{STYLE}</style>{''.join(drawn)}")
    stop = '<label><input type="checkbox"> pause</label>'
    return HTML(
        f'<figure class="drawn film">{stop}{body}<figcaption>{caption}</figcaption></figure>'
    )


def side_by_side(*figures: HTML) -> HTML:
    """Figures in a row, or below each other where they do not fit."""
    return HTML(f'<div class="row">{"".join(each.data for each in figures)}</div>')


def from_report(report: Path | str, caption: str) -> HTML:
    """The figure of a report whose caption begins with these words."""
    text = Path(report).read_text(encoding="utf-8")
    for figure in re.findall(r"<figure>.*?</figure>", text, flags=re.DOTALL):
        words = re.search(r"<figcaption>(.*?)</figcaption>", figure, flags=re.DOTALL)
        if words and words[1].startswith(caption):
            drawn = re.findall(r"<svg.*?</svg>", figure, flags=re.DOTALL)
            if not drawn:
                break
            inside = rf"\1<style>{STYLE}</style>"
            svg = re.sub(r"(<svg[^>]*>)", inside, drawn[0], count=1)
            return picture(svg, words[1])
    raise LookupError(f"{report}: no figure whose caption begins with {caption!r}")


def finished_study() -> None:
    """Copy the study ring.yaml with its results here; it runs once."""

    def make(folder: Path) -> None:
        for path in (ROOT / "docs" / "howto" / "study").iterdir():
            shutil.copy(path, folder)
        made = "--events 8 --records-per-event 2 --magnitude 6:7.5 --distance-km 5:40"
        command = ["archfrag", "records", "make", *made.split(), "--out", "motions"]
        subprocess.run(command, cwd=folder, check=True)
        subprocess.run(
            ["archfrag", "run", "ring.yaml", "--quiet"], cwd=folder, check=True
        )

    shutil.copytree(_once("finished-study", make), Path.cwd(), dirs_exist_ok=True)


def _once(name: str, make: Callable[[Path], None]) -> Path:
    """A folder that the first page that asks makes; others wait for it."""
    folder = Path(os.environ["ARCHFRAG_KEPT"]) / name
    folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / "lock"):
        if not (folder / "finished").exists():
            make(folder)
            (folder / "finished").touch()
    return folder


def keep(path: Path | str, name: str) -> None:
    """Keep a file that a cell made, to be linked as ``made/NAME``."""
    folder = Path(os.environ["ARCHFRAG_KEPT"]) / "site" / "made"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, folder / name)
