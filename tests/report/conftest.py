"""For tests of drawings: every sheet that is drawn is kept."""

import pytest

from archfrag.report.plot import Sheet


@pytest.fixture
def drawn(monkeypatch):
    """Sheets that are drawn during a test: of each figure the narrow one and the wide one."""
    kept, original = [], Sheet.svg
    monkeypatch.setattr(Sheet, "svg", lambda s, *args: kept.append(s) or original(s, *args))
    return kept
