"""Runs of archfrag's time stepping on chains, without an `Arch`."""

import math

import numpy as np

from archfrag.physics.ground import grounds_of
from archfrag.physics.interface import Options
from archfrag.physics.methods.registry import METHODS, steps_of_tolerance
from archfrag.physics.state import model_of
from archfrag.physics.status import Count
from archfrag.simulation.arguments import LOSS_LIMIT
from archfrag.simulation.response import empty_output

STEPPING = METHODS["time_stepping"]


def options_of(chain, motion, rtol=1e-3, follow=20.0):
    """Return options as of `af.simulate`."""
    unit = math.sqrt(model_of(chain).length.min() / chain.gravity)
    step, largest = (unit * part for part in steps_of_tolerance(rtol, chain.mass.size))
    return Options(
        time_step=step,
        tolerance=rtol,
        accuracy=rtol,
        follow=follow,
        max_steps=int(1e3 + (motion.duration + follow) / min(step, 1e-3 * unit)),
        loss_limit=LOSS_LIMIT,
        check_interval=64,
        frame_interval=1e-4,
        crowding=0.0,
        largest_step=largest,
    )


def run_many(chain, motion, factors, **given):
    """Run a chain from rest under one motion times each factor; return options and outcomes."""
    options = options_of(chain, motion, **given)
    ground = grounds_of([(motion.acceleration, None, motion.dt)])
    run = STEPPING.load("run_many")
    first = np.zeros(len(factors), int)
    return options, run(chain, ground, first, np.array(factors, float), options)


def displacements(chain, motion, factor, **given):
    """Return times and the largest displacement of a centroid at each, (n,) [s] and [m]."""
    options = options_of(chain, motion, **given)
    ground = grounds_of([(motion.acceleration, None, motion.dt)])
    n_frame = int((motion.duration + options.follow) / options.time_step)
    shape = n_frame, 0, chain.mass.size, chain.friction.size
    frames, log = empty_output(*shape)
    start = np.pad(chain.centroid, [(0, 0), (0, 1)])
    still = np.zeros(start.shape)
    run = STEPPING.load()
    found = run(chain, ground, factor, start, still, True, options, frames, log)
    n = int(found.count[0, Count.FRAMES])
    assert n < n_frame
    shift = np.hypot(*frames.position[:n, :, :2].T).max(axis=0)
    return frames.time[:n], shift
