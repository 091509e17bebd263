"""Four runs get the bits that one would; compiled kernels give what plain Python gives."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from archfrag.physics import numbers
from archfrag.physics.kernels import primitives as pairs
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.primitives import LANES, lane_array, runs_of


@kernel
def everything(a, b, limit, out):
    for i in range(a.shape[0]):
        x = a[i, 0]
        y = a[i, 1]
        sine, cosine = numbers.sine_cosine(x)
        low = (x < b[i]) & pairs.opposite(y >= limit)
        either = low | (x == y) ^ (y <= 0.0)
        out[i, 0] = sine
        out[i, 1] = cosine
        out[i, 2] = pairs.select(either, math.sqrt(abs(x)) / (1.0 + y * y), -y)
        out[i, 3] = (
            numbers.larger(x, y) + numbers.smaller(x, 2.0) - numbers.flag(x != y)
        )
        out[i, 4] = pairs.fused(x, y, b[i]) + numbers.nearest(x)
        out[i, 5] = 0.0
        if pairs.some(either):
            out[i, 5] = pairs.select(either, 1.0, 0.0)


@pytest.mark.parametrize("count", LANES)
def test_every_lane_has_the_bits_of_a_float(count):
    rng = np.random.default_rng(11)
    n = 500
    a = lane_array((n, 2), count)
    b = lane_array((n,), count)
    out = lane_array((n, 6), count)
    runs_of(a)[:] = rng.normal(0.0, 3.0, (n, 2, count))
    runs_of(b)[:] = rng.normal(0.0, 1.0, (n, count))
    everything(a, b, 0.25, out)
    for number in range(count):
        alone = np.zeros((len(b), 6))
        everything(
            runs_of(a)[..., number].copy(), runs_of(b)[..., number].copy(), 0.25, alone
        )
        assert np.array_equal(runs_of(out)[..., number], alone)
    assert 0.1 < runs_of(out)[:, 5].mean() < 0.9


@pytest.mark.parametrize("reach", [0.8, 7.0, 3000.0])
def test_sine_and_cosine_are_right_to_two_units_in_the_last_place(reach):
    angle = np.random.default_rng(5).uniform(-reach, reach, 4000)
    a = np.column_stack([angle, angle])
    out = np.zeros((len(angle), 6))
    everything(a, np.zeros(len(angle)), 0.0, out)
    assert np.max(np.abs(out[:, 0] - np.sin(angle))) < 2.3e-16
    assert np.max(np.abs(out[:, 1] - np.cos(angle))) < 2.3e-16


RUN = """
import numpy as np, archfrag as af
arch = af.Arch.circular(10.0, 1.5, 157.5, 3, friction=0.7)
motion = af.Motion(np.full(60, 8.0), 0.001)
r = af.simulate(arch, motion, dt=1e-3, follow=0.0, method="time_stepping")
print(r.peak_displacement, r.energy["ground"], af.onset(arch).plus, r.steps)
"""


def test_compiled_and_interpreted_agree():
    values = []
    for disabled in ("0", "1"):
        command = [sys.executable, "-W", "ignore", "-c", RUN]
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disabled}
        printed = subprocess.check_output(command, env=environment, text=True)
        values.append([float(word) for word in printed.split()])
    assert values[0][0] > 1e-4
    assert values[1] == pytest.approx(values[0], rel=1e-9)
