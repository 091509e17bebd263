"""For tests of drawings: every sheet that is drawn is kept, with its panels."""

import pytest

from archfrag.report.svg import Panel, Sheet


@pytest.fixture
def drawn(monkeypatch):
    """Sheets that are drawn during a test: of each figure the narrow one and the wide one."""
    kept, svg, init = [], Sheet.svg, Panel.__init__

    def keep_panel(panel, sheet, *arguments, **named):
        init(panel, sheet, *arguments, **named)
        sheet.__dict__.setdefault("panels", []).append(panel)

    monkeypatch.setattr(Sheet, "svg", lambda s, *args: kept.append(s) or svg(s, *args))
    monkeypatch.setattr(Panel, "__init__", keep_panel)
    return kept
