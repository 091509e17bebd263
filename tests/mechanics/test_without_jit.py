"""The kernels are plain Python too: compiled or not, they give the same."""

import os
import subprocess
import sys

import pytest

RUN = """
import numpy as np, archfrag as af
arch = af.Arch.circular(10.0, 1.5, 157.5, 3, friction=0.7)
motion = af.Motion(np.full(60, 8.0), 0.001)
r = af.simulate(arch, motion, dt=1e-3, follow=0.0)
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
