"""For cells of pages: pictures by archfrag's own functions, and figures of a report."""

import fcntl
import os
import re
import shutil
import subprocess
from dataclasses import replace
from html import escape
from pathlib import Path

import pandas as pd
from IPython.display import HTML

import archfrag as af
from archfrag.report.arch import arch_at_onset
from archfrag.report.html import STYLE

WORD = re.compile(r"\b(?!inf\b)[A-Za-z]{2}")  # of a column that does not hold numbers alone


def picture(svg: str, caption: str = "", narrow: str = "") -> HTML:
    """An SVG as a figure of the page, and another for narrow screens where there is one."""
    svg, narrow = (
        re.sub(r"<\?xml.*?\?>|<!DOCTYPE.*?>", "", each, flags=re.DOTALL) for each in (svg, narrow)
    )
    if narrow:
        svg = f'<div class="broad">{svg}</div><div class="slim">{narrow}</div>'
    return HTML(f'<figure class="drawn">{svg}<figcaption>{caption}</figcaption></figure>')


def table(frame: pd.DataFrame) -> HTML:
    """A table without index, columns of numbers to the right; an empty cell has no value."""
    columns = [["" if pd.isna(each) else _written(each) for each in frame[name]] for name in frame]
    kinds = [_kind(each) for each in columns]
    head = "".join(
        f"<th{kind}>{escape(str(name).replace('_', ' '))}</th>" for name, kind in zip(frame, kinds)
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
    drawn = arch_at_onset(shape, af.onset(shape), "arch")
    return picture(drawn.file, caption, replace(drawn, svg=drawn.narrow).file)


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
            return picture(svg, words[1], "".join(drawn[1:2]))
    raise LookupError(f"{report}: no figure whose caption begins with {caption!r}")


def finished_study() -> None:
    """Copy the study ring.yaml with its results here; the first page that asks has it run."""
    folder = Path(os.environ["ARCHFRAG_FINISHED"])
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "results").exists():
            for path in (Path(os.environ["ARCHFRAG_DOCS"]) / "howto" / "study").iterdir():
                shutil.copy(path, folder)
            made = "--events 8 --records-per-event 2 --magnitude 6:7.5 --distance-km 5:40"
            make = ["archfrag", "records", "make", *made.split(), "--out", "motions"]
            subprocess.run(make, cwd=folder, check=True)
            subprocess.run(["archfrag", "run", "ring.yaml", "--quiet"], cwd=folder, check=True)
    shutil.copytree(folder, Path.cwd(), dirs_exist_ok=True)


def keep(path: Path | str, name: str) -> None:
    """Copy a file that a cell made into the site, to be linked as ``made/NAME``."""
    folder = Path(os.environ["ARCHFRAG_SITE"]) / "made"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, folder / name)
