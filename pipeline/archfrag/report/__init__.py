"""One offline page of what a study found and how it was found."""

from pathlib import Path
from typing import Any


def make_report(study: Any, compared: Path | None = None) -> Path:
    """Write the report of a finished study, compared with that of another study file; its path."""
    from archfrag.report.inputs import report_inputs
    from archfrag.report.page import write_report

    return write_report(report_inputs(study, compared), study.folder / "report.html")
