"""Each figure of a page stands in docs/claims.csv with the file that holds it.

A row's source is a file, or `file#words`: then only what stands about these words on their line
counts. A row with `why` says how its figures follow from the source or, without a source, why
nothing holds them.
"""

import csv
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ["README.md"]
PAGES += sorted(
    path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")
)
BLOCKS = r"\A---\n.*?\n---$|^ *(```+|~~~+).*?^ *\1$|^ *\d+\. "
NO_FIGURES = (
    r"`[^`]*`|\]\([^)]*\)|\$\$.*?\$\$|\$[^$]*\$|https?://\S+|doi 10\.\S+",  # code, formulas
    r"\b(?:Eqs?|Figs?) \d+(?:(?:,| to| and) \d+)*",  # of a paper
    r"(?<![\d,.])(?:19|20)\d\d(?:-\d\d)*(?![\d.,]\d)",  # years
    r"v?\d+\.\d+\.\d+\S*|\b(?:[A-Z]\w+ \d+\.|Wine |macOS )\d+",  # versions
    r"(?<=xxx) (?:and|to|or) \d\.\d+",  # versions that follow
    r"\((?:\d+\.)?\d+\)|\b(?i:equation|section|figure|table|chapter|step)s? \(?\d[\d.]*",
    r"\*[^*|]+\*[\dx(), –]+",  # journals, with volume and pages
    r"90 %(?=:| band| interval| \()",  # how sure, not how much
    r"(?<![\w,.-])\d(?![\de]|[.,]\d| ?(?:%|[µmk]?[msg]\b|[MG]B|Hz|min|Pa|·|times))",  # counts
)
POWERS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
DIGITS = str.maketrans(POWERS + "−", "-0123456789-")
NUMBER = r"(?:\d{1,3}(?:,\d{3})+(?!\d)|\d(?:[\d_]*\d)?)(?:\.\d+)?(?:e[-+]?\d\d?\b)?"
NUMBER += rf"(?:(?:·10)?[{POWERS}]+)?"
FIGURE = rf"(?<![\w.^-])[-−]?{NUMBER}(?![\w-]|[.,]\d)"

with open(ROOT / "docs" / "claims.csv", encoding="utf-8") as file:
    CLAIMS = list(csv.DictReader(file))


def read(name):
    """Return a page on one line, without front matter, blocks of code and numbers of lists."""
    text = (ROOT / name).read_text("utf-8")
    return " ".join(re.sub(BLOCKS, "", text, flags=re.S | re.M).split())


def figures(text):
    """Return where figures stand in a text."""
    for pattern in NO_FIGURES:
        text = re.sub(pattern, lambda found: "x" * len(found[0]), text)
    return [found.span() for found in re.finditer(FIGURE, text)]


def value(figure):
    """Return a number as written, and half a unit of its last digit."""
    text = figure.translate(DIGITS).strip("-").replace(",", "").replace("_", "")
    if any(each in figure for each in POWERS):  # 3·10¹¹ or 10¹¹
        text, power = re.fullmatch(r"(?:(.+)·)?10(-?\d+)", text).groups()
        text = f"{text or 1}e{power}"
    digits, _, power = text.partition("e")
    return float(text), 0.5 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def holds(numbers, figure):
    """Return whether one of some numbers is the figure, to the figure's last digit."""
    wanted, half = value(figure)
    return any(
        abs(found - wanted) <= half * (1 + 1e-9)
        for number in numbers
        for found in (
            *(number * factor for factor in (1, 100, 1000, 0.01, 0.001)),
            100 * abs(number - 1),
        )
    )


@pytest.mark.parametrize("page", PAGES)
def test_each_figure_of_a_page_is_in_a_claim(page):
    text = read(page)
    claimed = [row["text"] for row in CLAIMS if row["page"] == page]
    assert [claim for claim in claimed if claim not in text] == []
    inside = [
        found.span()
        for claim in claimed
        for found in re.finditer(re.escape(claim), text)
    ]
    assert [
        text[max(0, start - 60) : end + 30]
        for start, end in figures(text)
        if not any(first <= start and end <= last for first, last in inside)
    ] == []


@pytest.mark.parametrize("page", PAGES)
def test_each_claim_is_held_by_its_source(page):
    text = read(page)
    spans = figures(text)
    for row in (row for row in CLAIMS if row["page"] == page):
        assert row["source"] or row["why"], row
        assert len(row["why"].split()) <= 12, row
        if not row["source"]:
            continue
        name, _, words = row["source"].partition("#")
        found = (ROOT / name).read_text("utf-8")
        if words:
            found = "\n".join(
                re.findall(f".{{0,50}}{re.escape(words)}.{{0,150}}", found)
            )
        assert found, row
        if row["why"]:
            continue
        if name.endswith(".csv"):
            found = found.replace(",", " ")
        numbers = [value(each)[0] for each in re.findall(rf"(?<![\w.]){NUMBER}", found)]
        begin = text.index(row["text"])
        held = {
            text[start:end]: holds(numbers, text[start:end])
            for start, end in spans
            if begin <= start and end <= begin + len(row["text"])
        }
        assert all(held.values()), (row, held)
