"""Synthetic ground motions: any number, each from its magnitude, distance and seeds alone."""

from archfrag.motions.synthetic.amplitude import VS30
from archfrag.motions.synthetic.motion import MODEL, Options, Seeds, make_motion
from archfrag.motions.synthetic.suite import Plan, make_suite, plan_motions, shipped_recipes

__all__ = ["MODEL", "VS30", "Options", "Plan", "Seeds", "make_motion", "make_suite",
           "plan_motions", "shipped_recipes"]  # fmt: skip
