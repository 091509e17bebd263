"""Event-driven integration on mega-voussoirs (Sinopoli, section 3.5)."""

from archfrag.methods.event_driven.front import (
    ENERGY_ALLOWED,
    LEAST_ENERGY,
    LEAST_OVERLAP,
    OVERLAP_ALLOWED,
    run,
)

__all__ = ["ENERGY_ALLOWED", "LEAST_ENERGY", "LEAST_OVERLAP", "OVERLAP_ALLOWED", "run"]
