"""Version of archfrag, which is stated here only."""

__version__ = "0.1.0"
