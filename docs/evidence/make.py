"""Makes the chart of README from the tables beside it: python docs/evidence/make.py."""

from pathlib import Path

from archbench import page
from archbench.runner import load_tables

HERE = Path(__file__).parent


def main() -> None:
    """Draw the chart of README from the tables of the evidence page."""
    charts = dict(page.figures_of("speed", load_tables(HERE / "data", "speed")))
    charts["speed_overview"].savefig(
        HERE.parent / "images" / "evidence.svg", metadata={"Date": None, "Creator": None}
    )


if __name__ == "__main__":
    main()
