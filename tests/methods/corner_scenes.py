"""Scenes on which both baselines with two contacts a joint are tested."""

import functools
import math

import numpy as np
from scipy.interpolate import CubicSpline

import archfrag as af
from tests.physics.audit import g, pulse
from tests.physics.test_time_stepping import rocking, tilted

# the table of other solvers, section A: LMGC90 and Siconos at 0.5 ms agree in all digits.
KEYSTONE = {0.2: -0.01621, 0.4: -0.04211}


def arch(voussoirs=7, friction=0.7):
    """The arch of the table of other solvers, section A."""
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs, friction, sector=False)


def shaken_below_onset(method):
    """An arch under noise that stays below 0.9 of its onset."""
    scene = arch()
    noise = np.random.default_rng(5).uniform(-1.0, 1.0, 101) * 0.9 * af.onset(scene).plus * g
    return af.simulate(scene, af.Motion(noise, 0.01), method=method)


def thrown_block(method, friction=0.4, speed=1.0):
    """A low block set sliding by a blow: response, and its velocity after 0.1 s [m/s]."""
    block = af.Block(1.0, 0.5, friction=friction)
    velocity = np.array([[speed, 0.0, 0.0]])
    response = af.simulate(
        block, af.Motion(np.zeros(3), 0.01), method=method, history=True,
        initial=(np.zeros((1, 3)), velocity), follow=2.0,
    )  # fmt: skip
    history = response.history
    return response, float(np.interp(0.1, history.time, history.velocity[:, 0, 0]))


def rocking_errors(method, friction, dt):
    """Relative errors of the amplitudes after two impacts against Housner's block."""
    slenderness, width = 0.2, 1.0
    height = width / math.tan(slenderness)
    frequency = math.sqrt(0.75 * g / math.hypot(width / 2.0, height / 2.0))
    times, amplitudes = rocking(frequency, slenderness, 0.5 * slenderness, 3)
    response = af.simulate(
        af.Block(width, height, friction=friction), af.Motion(np.zeros(3), 0.01), method=method,
        dt=dt, history=True, initial=tilted(width, height, 0.5 * slenderness), follow=4.5,
    )  # fmt: skip
    tilt, time = abs(response.history.rotation.values[:, 0]), response.history.time.values
    tops = [tilt[(time > times[k]) & (time < times[k + 1])].max() for k in range(2)]
    return np.array(tops) / amplitudes[:2] - 1.0


@functools.cache
def shaken_arch(method, dt=1e-3):
    """The arch under 0.5 g of section A, to the end."""
    return af.simulate(arch(), pulse(0.5, 0.3), method=method, dt=dt, history=True)


def keystone_errors(method):
    """Differences from `KEYSTONE` [m]."""
    history = shaken_arch(method).history
    path = history.displacement[:, 3, 0]
    return [float(np.interp(time, history.time, path)) - KEYSTONE[time] for time in KEYSTONE]


def first_steps(method):
    """Displacements and rotations in the first 0.1 s, at 0.1 ms a step."""
    history = af.simulate(
        arch(), af.Motion(np.full(101, 0.5 * g), 1e-3), method=method, dt=1e-4, history=True,
        follow=0.0,
    ).history.drop_duplicates("time")  # fmt: skip
    state = np.concatenate([history.displacement.values, history.rotation.values[..., None]], -1)
    times = np.arange(1, 100) * 1e-3
    flat = state.reshape(len(state), -1)
    # Frames of some methods lie in the middle of their steps.
    return CubicSpline(history.time.values, flat)(times).T
