"""Event-driven integration on mega-voussoirs (Sinopoli, section 3.5)."""
