"""Makes the chart of README from the tables beside it: python docs/evidence/make.py."""

import hashlib
from pathlib import Path

from archbench import page
from archbench.runner import load_tables

HERE = Path(__file__).parent


def main() -> None:
    """Draw the chart of README from the tables of the evidence page, and name them in it."""
    charts = dict(page.figures_of("speed", load_tables(HERE / "data", "speed")))
    points = (HERE / "data" / "speed_points.csv").read_bytes()
    metadata = {"Date": None, "Creator": None, "Source": hashlib.sha256(points).hexdigest()}
    charts["speed_overview"].savefig(HERE.parent / "images" / "evidence.svg", metadata=metadata)


if __name__ == "__main__":
    main()
