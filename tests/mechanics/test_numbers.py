"""The number type of the kernels: four runs get the bits that one would."""

import math

import numpy as np
import pytest

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.lanes import LANES, lane_array, runs_of
from archfrag.mechanics.numbers import (
    flag,
    fused,
    larger,
    nearest,
    opposite,
    select,
    sine_cosine,
    smaller,
    some,
)


@kernel
def everything(a, b, limit, out):
    for i in range(a.shape[0]):
        x, y = a[i, 0], a[i, 1]
        sine, cosine = sine_cosine(x)
        low = (x < b[i]) & opposite(y >= limit)
        either = low | (x == y) ^ (y <= 0.0)
        out[i, 0], out[i, 1] = sine, cosine
        out[i, 2] = select(either, math.sqrt(abs(x)) / (1.0 + y * y), -y)
        out[i, 3] = larger(x, y) + smaller(x, 2.0) - flag(x != y)
        out[i, 4] = fused(x, y, b[i]) + nearest(x)
        out[i, 5] = 0.0
        if some(either):
            out[i, 5] = select(either, 1.0, 0.0)


def samples(n=500):
    rng = np.random.default_rng(11)
    a, b = lane_array((n, 2)), lane_array((n,))
    runs_of(a)[:] = rng.normal(0.0, 3.0, (n, 2, LANES))
    runs_of(b)[:] = rng.normal(0.0, 1.0, (n, LANES))
    return a, b


def test_every_lane_has_the_bits_of_a_float():
    a, b = samples()
    out = lane_array((len(b), 6))
    everything(a, b, 0.25, out)
    for number in range(LANES):
        alone = np.zeros((len(b), 6))
        everything(runs_of(a)[..., number].copy(), runs_of(b)[..., number].copy(), 0.25, alone)
        assert np.array_equal(runs_of(out)[..., number], alone)
    assert 0.1 < runs_of(out)[:, 5].mean() < 0.9


def test_operators_mean_what_they_mean_for_floats():
    a, b = (runs_of(part)[..., 0].copy() for part in samples())
    out = np.zeros((len(b), 6))
    everything(a, b, 0.25, out)
    x, y = a[:, 0], a[:, 1]
    either = ((x < b) & ~(y >= 0.25)) | ((x == y) ^ (y <= 0.0))
    assert np.array_equal(out[:, 5], either)
    expected = np.where(either, np.sqrt(np.abs(x)) / (1.0 + y * y), -y)
    assert np.array_equal(out[:, 2], expected)
    assert np.allclose(out[:, 3], np.maximum(x, y) + np.minimum(x, 2.0) - 1.0, rtol=1e-15)
    assert np.allclose(out[:, 4], x * y + b + np.rint(x), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("reach", [0.8, 7.0, 3000.0])
def test_sine_and_cosine_are_right_to_two_units_in_the_last_place(reach):
    angle = np.random.default_rng(5).uniform(-reach, reach, 4000)
    a = np.column_stack([angle, angle])
    out = np.zeros((len(angle), 6))
    everything(a, np.zeros(len(angle)), 0.0, out)
    assert np.max(np.abs(out[:, 0] - np.sin(angle))) < 2.3e-16
    assert np.max(np.abs(out[:, 1] - np.cos(angle))) < 2.3e-16


def test_lane_arrays_are_aligned_for_the_processor_s_vectors():
    for shape in ((1,), (3, 2), (7, 2, 2)):
        assert lane_array(shape).ctypes.data % (8 * LANES) == 0
