"""For tests of drawings: every sheet that is drawn is kept."""

import pytest

from archfrag.report.plot import Sheet


@pytest.fixture
def drawn(monkeypatch):
    """Sheets that are drawn during a test: of each figure the wide one and the narrow one."""
    kept = []
    original = Sheet.svg

    def keep(sheet, *args):
        kept.append(sheet)
        return original(sheet, *args)

    monkeypatch.setattr(Sheet, "svg", keep)
    return kept
