"""For tests of drawings: every sheet is kept with its panels, and its labels must keep clear."""

import re
from html import unescape
from itertools import combinations

import pytest

from archfrag.report.svg import SIZE, SMALL, Panel, Sheet, text_width

TEXT = r'<text x="([^"]+)" y="([^"]+)"(?: class="([^"]+)")?( transform)?[^>]*>([^<]*)</text>'


def texts(sheet):
    """Words of a sheet, with the left, top, right and bottom of what they cover."""
    for x, y, kind, turned, found in re.findall(TEXT, "".join(sheet.parts)):
        words = unescape(found)
        kinds = kind.split()
        x = float(x)
        y = float(y)
        size = SMALL if "s" in kinds else SIZE
        width = text_width(words, size)
        left = x - width * (0.5 if "m" in kinds else 1.0 if "e" in kinds else 0.0)
        if turned:
            yield words, x - 0.8 * size, y - 0.5 * width, x, y + 0.5 * width
        else:
            yield words, left, y - 0.75 * size, left + width, y + 0.2 * size


def overlaps(sheet):
    """Pairs of texts of a sheet that cover each other, and texts that leave it."""
    boxes = list(texts(sheet))
    covered = [
        (a[0], b[0])
        for a, b in combinations(boxes, 2)
        if min(a[3], b[3]) - max(a[1], b[1]) > 0.5
        and min(a[4], b[4]) - max(a[2], b[2]) > 0.5
    ]
    right = sheet.width + 2.0
    bottom = sheet.height + 2.0
    return covered + [
        box[0]
        for box in boxes
        if min(box[1:3]) < -2.0 or box[3] > right or box[4] > bottom
    ]


@pytest.fixture
def drawn(monkeypatch):
    """Sheets that are drawn during a test: one for each figure."""
    kept = []
    svg = Sheet.svg
    init = Panel.__init__

    def keep_panel(panel, sheet, *arguments, **named):
        init(panel, sheet, *arguments, **named)
        sheet.__dict__.setdefault("panels", []).append(panel)

    monkeypatch.setattr(Sheet, "svg", lambda s, *args: kept.append(s) or svg(s, *args))
    monkeypatch.setattr(Panel, "__init__", keep_panel)
    yield kept
    assert kept
    assert [overlaps(sheet) for sheet in kept] == len(kept) * [[]]
