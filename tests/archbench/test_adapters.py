"""Scenes and adapters: the chain that every solver is given, and the contract that all keep."""

import math
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from archbench.adapters import client
from archbench.adapters.client import NAMES, OtherSolver, SolverFailed
from archbench.adapters.drive import drive
from archbench.scene import Corners, load_scene, scene_names
from archbench.settings import Setting
from archbench.solve import arch_of, collapses, solve
from archfrag.arch.geometry import cross

SCENES = [name for name in scene_names() if load_scene(name).motion["kind"] != "record"]
PULSE = replace(load_scene("arch7_pulse"), duration=0.41)
ROCKING = replace(
    load_scene("block_sine"),
    initial={"angle": 0.05, "spin": 0.02},
    motion={"kind": "none"},
    duration=0.31,
)


@pytest.mark.parametrize("scene", [load_scene(name) for name in SCENES], ids=SCENES)
class TestEveryScene:
    def test_bodies_are_those_of_the_package(self, scene):
        ours = arch_of(scene).chain
        for found, own in zip(scene.bodies(), (ours.mass, ours.inertia, ours.centroid)):
            np.testing.assert_allclose(found, own, rtol=1e-12, atol=1e-12)

    def test_outlines_are_anticlockwise_and_the_ground_ends_at_the_springing_faces(
        self, scene
    ):
        for outline in (*scene.polygons(), *scene.supports()):
            edge = np.roll(outline, -1, axis=0) - outline
            assert np.all(cross(edge, np.roll(edge, -1, axis=0)) > 0.0)
        inner, outer = scene.joint_lines()
        for ground, start, end in zip(scene.supports(), inner[[0, -1]], outer[[0, -1]]):
            away = np.abs(cross(end - start, ground - start)) / math.dist(start, end)
            assert sorted(away) == pytest.approx([0.0, 0.0, *[2 * scene.thickness] * 2])

    @pytest.mark.parametrize("dt", [0.005, 0.0005])
    def test_steps_have_the_impulse_of_the_motion(self, scene, dt):
        samples, step = scene.ground_acceleration()
        means = scene.step_means(dt)
        assert len(means) == round(scene.duration / dt)
        impulse = 0.5 * step * (samples[1:] + samples[:-1]).sum()
        assert means.sum() * dt == pytest.approx(impulse, abs=1e-9)

    def test_contacts_are_closed_at_rest_and_linearised_exactly(self, scene):
        corners = Corners(scene)
        step = 1e-6
        q = np.zeros((corners.count, 3))
        assert corners.linearise(q)[0] == pytest.approx(0.0, abs=1e-12)
        q = 0.01 * np.sin(np.arange(q.size)).reshape(q.shape)
        value, matrix = corners.linearise(q)
        for contact, columns in enumerate(corners.columns[:6]):
            for k, column in enumerate(columns):
                if column < q.size:
                    moved = q + step * (np.arange(q.size) == column).reshape(q.shape)
                    change = (corners.linearise(moved)[0] - value)[contact] / step
                    assert change == pytest.approx(matrix[contact, :, k], abs=1e-4)


def test_the_normal_is_that_of_the_face_that_a_corner_lies_on():
    corners = Corners(PULSE)
    inner, outer = np.array(PULSE.joint_lines())[:, 3]
    out = 0.5 * (outer - inner) / math.dist(outer, inner)
    q = np.zeros((corners.count, 3))
    q[2, 2], q[3] = (
        0.1,
        [*out, -0.05],
    )  # the body after joint 3 slid outwards, and both turned
    value, matrix = corners.linearise(q)
    for contact, angle in ((6, 0.1), (7, -0.05)):
        turned = np.exp(1j * angle) * (corners.normal[contact] @ [1.0, 1j])
        normal = [turned.real, turned.imag]
        assert matrix[contact, 0, 3:5] == pytest.approx(normal, abs=1e-12)
        for k, column in enumerate(corners.columns[contact]):
            moved = q + 1e-6 * (np.arange(q.size) == column).reshape(q.shape)
            change = (corners.linearise(moved)[0] - value)[contact] / 1e-6
            assert change == pytest.approx(matrix[contact, :, k], abs=1e-4)


VERSION = "sideways 1"


class Sideways:
    """A stepper whose bodies move sideways as x(t): the driver's judgement in closed form."""

    unconverged = None

    def __init__(self, place):
        self.place = place
        self.start = PULSE.bodies().centroid
        self.time = 0.0

    def step(self, acceleration):
        self.time += 0.005

    def centroids(self):
        return self.start + np.array([self.place(self.time), 0.0])


def build(scene, dt):
    """This module is an adapter too: one that fails, or takes long, as the step is."""
    if dt == 1.0:
        raise ValueError("a step of 1 s")
    time.sleep(0.0 if dt > 1e-4 else 60.0)
    return Sideways(math.sin)


def test_collapse_is_a_centroid_beyond_two_thicknesses_and_no_motion_is_a_failure():
    scene = replace(PULSE, duration=5.0)
    found = drive(Sideways(lambda t: 0.5 * t * t), scene, 0.005, history=True)
    expected = math.sqrt(2.0 * 2.0 * scene.thickness)
    end = found.simulated_seconds
    assert found.collapsed
    assert expected < end <= expected + 0.01 + 1e-9
    assert [found.steps * 0.005, found.history["time"][-1]] == pytest.approx([end, end])
    stands = drive(Sideways(lambda t: 2.9 * math.sin(t)), scene, 0.005)
    assert not stands.collapsed
    assert stands.peak_displacement == pytest.approx(2.9, rel=1e-4)
    for place in (lambda t: math.nan, lambda t: 1e3 * t * t):
        with pytest.raises(ArithmeticError, match="m/s at"):
            drive(Sideways(place), scene, 0.005)


def test_a_failed_run_is_no_outcome_and_the_next_one_runs(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    monkeypatch.setattr(client, "MODULE", "tests.archbench.{}")
    solver = OtherSolver("test_adapters")
    assert solver.version == VERSION
    with pytest.raises(
        SolverFailed, match=r"test_adapters, arch7_pulse, dt 1 s: .*a step of 1 s"
    ):
        solver.run(PULSE, 1.0)
    assert solver.run(PULSE, 0.005).peak_displacement == pytest.approx(
        math.sin(0.41), abs=1e-3
    )
    solver.process.kill()
    with pytest.raises(SolverFailed, match="process ended"):
        solver.run(PULSE, 0.005)
    solver.limit = 1.0
    with pytest.raises(SolverFailed, match=r"no answer in 1 s"):
        solver.run(PULSE, 1e-5)


def test_the_process_of_a_solver_needs_numpy_alone():
    """The interpreter of the system, in which Siconos is, has nothing of archfrag's."""
    code = (
        "import runpy, sys; sys.modules.update(dict.fromkeys("
        "('archfrag', 'shapely', 'scipy', 'lazy_loader')))\n"
        "sys.argv = ['drive.py', 'archbench.nothing_adapter']; "
        f"runpy.run_path({str(Path(client.__file__).with_name('drive.py'))!r}, "
        "run_name='__main__')"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd="/"
    )
    assert "No module named 'archbench.nothing_adapter'" in found.stdout, found.stderr


# Largest relative error of the keystone before the first impact, and of the block; `lmgc90` starts
# from rest.
ERRORS = {
    "siconos": (0.02, 0.06),
    "pinocchio": (0.02, 0.06),
    "lmgc90": (0.01, None),
    "mujoco_corners": (0.1, 0.08),
    "mujoco_warp": (0.1, 0.08),
    "pymunk": (0.04, 0.1),
}


@pytest.mark.parametrize("name", NAMES)
def test_each_solver_that_is_installed_moves_as_ours(name):
    """Keystone at 0.2 and 0.4 s as LMGC90 and Siconos at 0.5 ms agree on it; a block rocks."""
    try:
        OtherSolver(name, 120.0).close()
    except client.SolverMissing as reason:
        pytest.skip(str(reason))
    arch, block = ERRORS[name]

    def moved(scene, setting, times):
        frames = solve(scene, setting, history=True).frames
        middle = frames.displacement[:, frames.displacement.shape[1] // 2]
        return np.array([np.interp(times, frames.time, x) - x[0] for x in middle.T])

    theirs = Setting(name, "dt", 0.002)
    found = moved(PULSE, theirs, [0.2, 0.4])[0]
    assert found == pytest.approx([-0.01621, -0.04211], rel=arch)
    if block is None:
        assert "initial state" in solve(ROCKING, theirs).status
    else:
        start = ROCKING.initial_state()[0][0, :2, None]
        ours = start + moved(ROCKING, Setting("time_stepping", "dt", 1e-4), [0.3])
        assert start + moved(ROCKING, theirs, [0.3]) == pytest.approx(ours, rel=block)


def test_a_corner_of_mujoco_that_sinks_in_a_long_step_stays_on_its_face():
    pytest.importorskip("mujoco")
    column = load_scene("column_pulse")
    assert not collapses(column, Setting("mujoco_corners", "dt", 0.005), 0.24)
