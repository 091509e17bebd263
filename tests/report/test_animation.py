"""Runs in motion: key frames against the history, still frames, and no script."""

import re

import numpy as np
import pytest

import archfrag as af
from archfrag.report import animation
from archfrag.report.example import Example, near_miss
from tests.report.test_figures import results
from tests.report.test_mechanism import ARCH, pulse


@pytest.fixture(scope="module")
def fallen():
    motion, response = pulse()
    return Example(ARCH, motion, 1.0, "PGA = 0.69 g", response, "chosen", True)


@pytest.fixture(scope="module")
def shown(fallen):
    return animation.animation(fallen, "fall0", "A collapse")


class TestKeyFrames:
    def test_linear_motion_between_them_is_close_to_the_run(self, fallen):
        frames = animation.key_frames(fallen)
        history = fallen.response.history
        time = history["time"].values
        inside = (time >= frames.time[0]) & (time <= frames.time[-1])
        for body in range(ARCH.n_voussoir):
            turned = np.interp(time[inside], frames.time, frames.rotation[:, body])
            true = history["rotation"].values[inside, body]
            assert np.abs(turned - true).max() < 0.02 * np.abs(history["rotation"].values).max()
        assert 12 <= frames.time.size <= 40
        assert frames.time[-1] == time[-1]

    def test_many_voussoirs_get_fewer(self):
        arch = af.Arch.circular(10.0, 1.5, 157.5, 81, 0.7)
        motion, _ = pulse()
        response = af.simulate(arch, motion, history=True)
        example = Example(arch, motion, 1.0, "PGA", response, "x", True)
        assert animation.key_frames(example).time.size <= 30
        assert len(animation.animation(example, "a", "A collapse").svg) < 200_000

    def test_nothing_moves(self):
        motion, response = pulse(0.2)
        example = Example(ARCH, motion, 0.2, "PGA", response, "x", True)
        assert animation.animation(example, "a", "A near miss") is None


class TestDrawing:
    def test_no_script_and_small(self, shown):
        assert len(shown.svg) < 150_000
        assert "<script" not in shown.svg
        assert not re.search(r"\son\w+=", shown.svg)
        assert shown.svg.count("<svg") == 2
        assert 'class="still"' in shown.svg

    def test_key_frames_end_where_the_run_ends(self, fallen, shown):
        """Rotation of each voussoir in the last key frame, clockwise in the drawing [deg]."""
        last = np.rad2deg(fallen.response.history["rotation"].values[-1])
        for body in range(ARCH.n_voussoir):
            rule = re.search(rf"@keyframes fall0-k{body}\{{(.*?)\}}\}}", shown.svg)[1]
            turn = float(re.findall(r"rotate\(([-.\d]+)deg", rule)[-1])
            assert turn == pytest.approx(-last[body], abs=0.06)
            percents = [float(p) for p in re.findall(r"([.\d]+)%", rule)]
            assert percents == sorted(percents)
            assert percents[0] == 0.0

    def test_all_names_are_defined(self, shown):
        used = set(re.findall(r'href="#([^"]+)"', shown.svg))
        assert used <= set(re.findall(r'\bid="([^"]+)"', shown.svg))
        names = set(re.findall(r"animation-name:([\w-]+)", shown.svg))
        assert names == set(re.findall(r"@keyframes ([\w-]+)", shown.svg))

    def test_time_is_said(self, fallen, shown):
        end = fallen.response.end_time
        assert f"{end:.2f} s" in shown.svg
        assert f"to {end:.2f} s" in shown.caption


def test_near_miss_is_the_standing_run_with_the_largest_rotation():
    from dataclasses import replace

    data = results()
    reach = np.zeros(data.verdict.shape)
    stood = np.argwhere(data.verdict == 0)
    fell = np.argwhere(data.verdict == 1)
    reach[tuple(stood[2])] = 0.08
    reach[tuple(stood[1])] = 0.03
    reach[tuple(fell[0])] = 0.9
    assert near_miss(replace(data, peak_rotation=reach))[:2] == tuple(stood[2])
    assert near_miss(replace(data, peak_rotation=None)) is None
    assert near_miss(replace(data, peak_rotation=0.0 * reach)) is None
