"""Gravity."""

STANDARD_GRAVITY = 9.80665
"""Acceleration of gravity in all of archfrag [m/s2] (ISO 80000-3, standard acceleration)."""
