"""Synthetic ground motions: any number, each from its magnitude, distance and seeds alone."""

from archfrag.motions.synthetic.motion import MODEL, Options, Seeds, make_motion
from archfrag.motions.synthetic.source import (
    VS30,
    fourier_amplitude,
    ground_motion_duration,
    median_adjustment,
    window,
)
from archfrag.motions.synthetic.suite import (
    FIRST_SEED,
    Plan,
    Recipe,
    make_suite,
    plan_motions,
    shipped_recipes,
    suite,
)
from archfrag.motions.synthetic.variation import correlation

__all__ = [
    "FIRST_SEED",
    "MODEL",
    "VS30",
    "Options",
    "Plan",
    "Recipe",
    "Seeds",
    "correlation",
    "fourier_amplitude",
    "ground_motion_duration",
    "make_motion",
    "make_suite",
    "median_adjustment",
    "plan_motions",
    "shipped_recipes",
    "suite",
    "window",
]
