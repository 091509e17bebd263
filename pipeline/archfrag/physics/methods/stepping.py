"""Time stepping as a method: of rigid joints, or of joints that give."""

import numpy as np

from archfrag.physics.faces import shake as faces
from archfrag.physics.ground import Grounds
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.steps import run as rigid


def run(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Outcomes:
    """Integrate one chain under one ground motion; as `archfrag.physics.steps.run.run`."""
    method = rigid if chain.joint is None else faces
    given = (position, velocity, from_rest)
    return method.run(chain, grounds, factor, *given, options, frames, log)


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Integrate one chain from rest under many motions; as `archfrag.physics.steps.run`."""
    method = rigid if chain.joint is None else faces
    return method.run_many(chain, grounds, motion, factor, options)
