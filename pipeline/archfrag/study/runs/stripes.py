"""The design `stripes`: every record at every level."""

from typing import Literal

import numpy as np

from archfrag.study.runs.design import Design, Grid, Requests


class Stripes(Design):
    """Every record at every level."""

    kind: Literal["stripes"] = "stripes"
    text = "every record at every level"

    def requests(self, grid: Grid) -> Requests:
        """Ask for all runs at once."""
        n_record, n_level = grid.records.size, grid.levels.size
        verdicts = yield grid.cases(*np.divmod(np.arange(n_record * n_level), n_level))
        return {"runs": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Runs of an arch."""
        return n_record * n_level, "exactly"
