"""Selection of records from a flatfile, to a target spectrum and its scatter.

Spectral accelerations are in g here, as in flatfiles and ground-motion models.
"""

from archfrag.motions.selection.select import Selection, select_records
from archfrag.motions.selection.target import (
    MODELS,
    PERIODS,
    Rupture,
    Target,
    conditional_spectrum,
    correlation,
    predict,
    read_target,
    spectrum_target,
)

__all__ = [
    "MODELS", "PERIODS", "Rupture", "Selection", "Target", "conditional_spectrum",
    "correlation", "predict", "read_target", "select_records", "spectrum_target",
]  # fmt: skip
