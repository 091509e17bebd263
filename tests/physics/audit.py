"""Scenes and measurements for tests of motion, written apart from the kernels they judge."""

import math

import numpy as np

import archfrag as af

g = 9.80665


def sampled(shape, duration, dt=1e-4):
    """Motion whose acceleration [g] at time t [s] is ``shape(t)``, and zero from `duration` on."""
    time = np.arange(0.0, duration + 0.01, dt)
    value = np.where(time < duration - 1e-9, np.broadcast_to(shape(time), time.shape), 0.0)
    return af.Motion(value * g, dt)


def tilted(width, height, tilt):
    """State of a block rotated about its right corner by `tilt` [rad], at rest."""
    half, up = width / 2.0, height / 2.0
    across = half - (half * math.cos(tilt) - up * math.sin(tilt))
    rise = half * math.sin(tilt) + up * math.cos(tilt) - up
    return np.array([[across, rise, -tilt]]), np.zeros((1, 3))


def pulse(amplitude, duration):
    """Ground acceleration +a for `duration`, then -a/2 for twice as long [g, s]."""
    return sampled(lambda t: amplitude * np.where(t < duration - 1e-9, 1.0, -0.5), 3.0 * duration)


def random_scene(rng, dt=5e-4):
    """An arch that stands and four seconds of motion, up to 2.5 times what starts it."""
    while True:
        arch = af.Arch.circular(
            10.0,
            rng.uniform(1.0, 2.5),
            rng.uniform(90.0, 170.0),
            int(rng.integers(3, 28)),
            rng.uniform(0.4, 1.0),
            sector=bool(rng.random() < 0.5),
        )
        start = af.onset(arch)
        if start.stands:
            break
    time = np.arange(0.0, 4.0, dt)
    window = np.minimum(1.0, np.minimum(time, time[-1] - time) / 0.2)
    waves = zip(rng.normal(size=6), rng.uniform(0.4, 6.0, 6), rng.uniform(0.0, 6.3, 6))
    across = sum(a * np.sin(2.0 * np.pi * f * time + p) for a, f, p in waves) * window
    across *= min(start.plus, 3.0) * g * rng.uniform(1.05, 2.5) / np.abs(across).max()
    effective_gravity = 0.3 * g * rng.random() * np.sin(6.0 * np.pi * time) * window
    return arch, af.Motion(across, dt, effective_gravity)


def impulse(samples, dt, start, end):
    """Integral of a piecewise-linear history, zero outside, from `start` to `end` (arrays)."""
    total = np.concatenate([[0.0], np.cumsum(0.5 * dt * (samples[1:] + samples[:-1]))])

    def until(time):
        time = np.clip(time, 0.0, (samples.size - 1) * dt)
        i = np.minimum((time / dt).astype(int), samples.size - 2)
        part = time - i * dt
        slope = (samples[i + 1] - samples[i]) / dt
        return total[i] + part * (samples[i] + 0.5 * part * slope)

    return until(end) - until(start)
