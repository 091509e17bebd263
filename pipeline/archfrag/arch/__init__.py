"""Arches, columns and blocks in user units, built as chains of rigid bodies."""

from importlib import import_module
from typing import TYPE_CHECKING

STANDARD_GRAVITY = 9.80665
"""Acceleration of gravity in all of archfrag [m/s2] (ISO 80000-3, standard acceleration)."""
__all__ = ["STANDARD_GRAVITY", "Arch", "Block", "Bridge"]

if TYPE_CHECKING:
    from archfrag.arch.model import Arch, Block, Bridge


def __getattr__(name: str):
    if name in (
        "Arch",
        "Block",
        "Bridge",
    ):  # whoever reads a study file needs neither numba nor scipy
        return getattr(import_module("archfrag.arch.model"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
