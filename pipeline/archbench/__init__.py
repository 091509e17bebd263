"""The laboratory beside archfrag: cost against error, growth, stability, corner cases, curves."""

from archbench import baselines

__all__ = ["baselines"]
