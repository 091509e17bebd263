"""Event-driven integration on mega-voussoirs (Sinopoli, section 3.5)."""

from archfrag.methods.event_driven.front import run, run_many

__all__ = ["run", "run_many"]
