"""Arches, columns and blocks in user units, and the chains of rigid bodies that they are."""

from archfrag.arch.assemble import STANDARD_GRAVITY
from archfrag.arch.block import Block
from archfrag.arch.model import Arch

__all__ = ["STANDARD_GRAVITY", "Arch", "Block"]
