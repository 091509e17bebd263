"""For cells of pages: pictures by archfrag's own functions, and figures of a report."""

import fcntl
import os
import re
import shutil
import subprocess
from pathlib import Path

from IPython.display import HTML

import archfrag as af
from archfrag.report.arch_figure import arch_at_onset
from archfrag.report.picture import standalone


def picture(svg: str, caption: str = "") -> HTML:
    """An SVG as a figure of the page, as wide as the text."""
    svg = re.sub(r"<\?xml.*?\?>|<!DOCTYPE.*?>", "", svg, flags=re.DOTALL)
    return HTML(f'<figure class="drawn">{svg}<figcaption>{caption}</figcaption></figure>')


def arch(shape: af.Arch, caption: str = "") -> HTML:
    """The arch with hinges and thrust line at onset, the ground accelerating to either side."""
    return picture(standalone(arch_at_onset(shape, af.onset(shape), "arch")), caption)


def from_report(report: Path | str, caption: str) -> HTML:
    """The figure of a report whose caption begins with these words."""
    text = Path(report).read_text(encoding="utf-8")
    style = re.search(r"svg text\{font.*?(?=\n)", text)
    for figure in re.findall(r"<figure>.*?</figure>", text, flags=re.DOTALL):
        words = re.search(r"<figcaption>(.*?)</figcaption>", figure, flags=re.DOTALL)
        if words and words[1].startswith(caption):
            svg = re.search(r"<svg.*?</svg>", figure, flags=re.DOTALL)
            if style is None or svg is None:
                break
            inside = f"<style>{style[0]}</style>"
            return picture(re.sub(r"(<svg[^>]*>)", rf"\1{inside}", svg[0], count=1), words[1])
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
            subprocess.run(["archfrag", "run", "ring.yaml", "--quiet"], cwd=folder, check=True)
    shutil.copytree(folder, Path.cwd(), dirs_exist_ok=True)


def keep(path: Path | str, name: str) -> None:
    """Copy a file that a cell made into the site, to be linked as ``made/NAME``."""
    folder = Path(os.environ["ARCHFRAG_SITE"]) / "made"
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, folder / name)
