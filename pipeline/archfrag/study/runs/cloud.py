"""The design `cloud`: every record once."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from archfrag.fragility.counts import Brackets
from archfrag.study.runs.design import Design, Grid, Requests

if TYPE_CHECKING:
    from archfrag.fragility.quoted import Answer


class Cloud(Design):
    """Every record once, as it is or by one factor."""

    kind: Literal["cloud"]
    factor: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    """On every record."""
    on_levels = False
    text = "every record once"

    def requests(self, grid: Grid) -> Requests:
        """Ask for all runs at once."""
        level = (self.factor / grid.unscaled) ** (1.0 / grid.power)
        verdicts = yield grid.cases(np.arange(level.size), 0, level)
        return {"runs": len(verdicts), "records": len(verdicts)}

    def size(self, n_record: int, n_level: int) -> tuple[int, str]:
        """Runs of an arch."""
        return n_record, "exactly"

    def estimate(self, found: Brackets, im: ArrayLike, **options: Any) -> "Answer":
        """Curve and band from single runs, each with a motion of its own."""
        from archfrag.fragility.quoted import quoted_runs

        decided = found.collapsed | found.survived
        level, collapsed = found.levels[decided], found.collapsed[decided]
        return quoted_runs(level, collapsed, im, confidence=options["confidence"])
