"""Makes the chart of README and the errors of the report: python docs/evidence/make.py."""

import hashlib
from pathlib import Path

from archbench import page
from archbench.runner import load_tables
from archfrag.report.html import ERRORS

HERE = Path(__file__).parent


def main() -> None:
    """Make them from the tables of the evidence page, and name their source in the chart."""
    tables = {part: load_tables(HERE / "data", part) for part in page.PARTS}
    errors = page.errors_table(tables)
    known = errors["kind"].isin(["auto", "time_stepping", "joints", "spans"])
    text = errors[known].to_csv(index=False, float_format="%.3g", lineterminator="\n")
    Path(ERRORS).write_text(text, encoding="utf-8")
    source = (HERE / "data" / "speed_points.csv").read_bytes() + text.encode()
    metadata = {"Date": None, "Creator": None}
    metadata["Source"] = hashlib.sha256(source).hexdigest()
    chart = HERE.parent / "images" / "evidence.svg"
    page.overview(tables).savefig(chart, metadata=metadata)


if __name__ == "__main__":
    main()
