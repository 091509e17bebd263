"""Arches on two outer piers, for tests."""

import numpy as np

import archfrag as af


def ends_of(**keys):
    """Return the keys of two piers; a pair is of the left and the right one."""
    return [
        {key: value[i] if np.ndim(value) else value for key, value in keys.items()}
        for i in (0, 1)
    ]


def on_piers(ring, height, width, **more):
    """Return an arch on two piers; a pair is of the left and the right one."""
    return af.Bridge([ring], ends=ends_of(height=height, width=width, **more))
