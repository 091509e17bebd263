"""Baseline `four_link` on one block: Housner's rocking, against another integrator."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as g
from tests.methods.test_four_link import four_link


class TestRockingBlock:
    HALF = (0.1, 0.5)

    def block(self):
        return af.Block(0.2, 1.0, friction=np.inf)

    def rocking(self, motion, angle, end):
        """Housner's block by another integrator: [times, angles] and times of its impacts."""
        b, h = self.HALF
        alpha, radius = math.atan(b / h), math.hypot(b, h)
        acceleration = motion.acceleration

        def rate(t, y):
            a = np.interp(t, np.arange(acceleration.size) * motion.dt, acceleration, right=0.0)
            side = 1.0 if y[0] > 0.0 or (y[0] == 0.0 and y[1] > 0.0) else -1.0
            lean = alpha * side - y[0]
            restoring = g * math.sin(lean) - a * math.cos(lean)
            return [y[1], -0.75 / radius * restoring]

        def closed(t, y):
            return y[0] if t > clock + 1e-9 else np.sign(y[0] + y[1])

        closed.terminal = True
        clock, y, times, angles, impacts = 0.0, [angle, 0.0], [], [], []
        while clock < end:
            part = solve_ivp(rate, (clock, end), y, events=closed, rtol=1e-10, atol=1e-13,
                             max_step=2e-3)  # fmt: skip
            times.append(part.t)
            angles.append(part.y[0])
            clock, y = part.t[-1], [0.0, part.y[1, -1] * (1.0 - 1.5 * math.sin(alpha) ** 2)]
            if part.status == 1:
                impacts.append(clock)
        return np.concatenate(times), np.concatenate(angles), impacts

    def test_shaken_block_is_housners(self):
        b, h = self.HALF
        time, angle = np.arange(0.0, 1.5, 1e-3), 0.1
        motion = af.Motion(0.5 * np.sin(7.0 * time), 1e-3)
        pin = np.array([-b, 0.0])
        arm = np.array([b, h])
        c, s = math.cos(angle), math.sin(angle)
        moved = pin + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
        state = np.array([[moved[0], moved[1] - h, angle]])
        response = four_link(
            self.block(), motion, initial=(state, np.zeros((1, 3))), history=True, rtol=1e-9,
            follow=0.5,
        )  # fmt: skip
        times, angles, impacts = self.rocking(motion, angle, 1.4)
        assert len(impacts) >= 2
        hits = [change.time for change in response.mechanism if change.cause == "impact"]
        assert hits[: len(impacts)] == pytest.approx(impacts, abs=1e-5)
        past = response.history.sel(time=slice(0.0, 1.39))
        expected = np.interp(past.time.values, times, angles)
        assert np.abs(past.rotation.values[:, 0] - expected).max() < 1e-5
