"""Earthquake records to collapse probabilities of masonry arches."""

from importlib import import_module
from typing import TYPE_CHECKING

from archfrag.version import __version__

_NAMES = {
    "archfrag.arch": ("Arch", "Block"),
    "archfrag.motions.formats.columns": ("Columns",),
    "archfrag.motions.motion": ("Motion",),
    "archfrag.motions.read": ("read_motion",),
    "archfrag.simulation.simulate": (
        "Onset", "Response", "limit_load", "onset", "simulate", "simulate_many",
    ),
    "archfrag.simulation.springings": ("move_springing", "springing_path"),
    "archfrag.simulation.strength": ("crushed",),
    "archfrag.fragility.curve": ("Curve",),
    "archfrag.fragility.fit": ("fit_ida", "fit_stripes"),
    "archfrag.study.reading": ("read_motions",),
    "archfrag.studies": ("Study",),
    "archfrag.results": ("Results", "open"),
}  # fmt: skip
_HOME = {name: module for module, names in _NAMES.items() for name in names}
__all__ = [
    "Arch", "Block", "Columns", "Curve", "Motion", "Onset", "Response", "Results",
    "Study", "__version__", "crushed", "fit_ida", "fit_stripes", "limit_load", "move_springing",
    "onset", "open", "read_motion", "read_motions", "simulate", "simulate_many", "springing_path",
]  # fmt: skip

if TYPE_CHECKING:
    from archfrag.arch import Arch, Block
    from archfrag.fragility.curve import Curve
    from archfrag.fragility.fit import fit_ida, fit_stripes
    from archfrag.motions.formats.columns import Columns
    from archfrag.motions.motion import Motion
    from archfrag.motions.read import read_motion
    from archfrag.results import Results, open
    from archfrag.simulation.simulate import (
        Onset,
        Response,
        limit_load,
        onset,
        simulate,
        simulate_many,
    )
    from archfrag.simulation.springings import move_springing, springing_path
    from archfrag.simulation.strength import crushed
    from archfrag.studies import Study
    from archfrag.study.reading import read_motions


def __getattr__(name: str):
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'archfrag' has no attribute {name!r}")


def __dir__():
    return __all__
