"""Scenes and adapters: the chain that every solver is given, and the contract that all keep."""

import math
import shutil
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import archfrag as af
from archbench.adapters import client
from archbench.adapters.client import OtherSolver, SolverFailed
from archbench.adapters.corners import Corners
from archbench.adapters.drive import drive
from archbench.scene import STANDARD_GRAVITY, Scene, load_scene, scene_names

SCENES = [name for name in scene_names() if load_scene(name).motion["kind"] != "record"]
PULSE = replace(load_scene("arch7_pulse"), duration=0.41)
ROCKING = replace(
    load_scene("block_sine"),
    initial={"angle": 0.05, "spin": 0.02}, motion={"kind": "none"}, duration=0.31,
)  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
class TestEveryScene:
    def test_bodies_are_those_of_the_package(self, name):
        scene = load_scene(name)
        own = {key: scene.chain[key] for key in ("density", "depth", "dead_load")
               if key in scene.chain}  # fmt: skip
        ours = af.Arch.from_joints(
            *scene.joint_lines(), scene.friction, free_end=scene.free_end, **own
        ).chain
        bodies = scene.bodies()
        np.testing.assert_allclose(bodies.mass, ours.mass, rtol=1e-12)
        np.testing.assert_allclose(bodies.inertia, ours.inertia, rtol=1e-12)
        np.testing.assert_allclose(bodies.centroid, ours.centroid, rtol=0.0, atol=1e-12)

    def test_outlines_are_anticlockwise_and_touch(self, name):
        scene = load_scene(name)
        for outline in (*scene.polygons(), *scene.supports()):
            edge = np.roll(outline, -1, axis=0) - outline
            after = np.roll(edge, -1, axis=0)
            assert np.all(edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0] > 0.0)
        for before, after in pairwise(scene.polygons()):
            assert len({tuple(p) for p in before} & {tuple(p) for p in after}) == 2

    def test_ground_holds_the_springing_faces(self, name):
        """A foot of a corner lies inside the ground, a thickness from its ends."""
        scene = load_scene(name)
        inner, outer = scene.joint_lines()
        for ground, start, end in zip(scene.supports(), inner[[0, -1]], outer[[0, -1]]):
            along = (end - start) / np.linalg.norm(end - start)
            across = (ground - start) @ [-along[1], along[0]]
            assert np.ptp((ground - start) @ along) == pytest.approx(
                np.linalg.norm(end - start) + 2.0 * scene.thickness
            )
            assert sorted(np.abs(across)) == pytest.approx([0.0, 0.0, *[2 * scene.thickness] * 2])

    @pytest.mark.parametrize("dt", [0.005, 0.0005])
    def test_steps_have_the_impulse_of_the_motion(self, name, dt):
        scene = load_scene(name)
        samples, step = scene.ground_acceleration()
        means = scene.step_means(dt)
        assert len(means) == round(scene.duration / dt)
        impulse = 0.5 * step * (samples[1:] + samples[:-1]).sum()
        assert means.sum() * dt == pytest.approx(impulse, abs=1e-9)

    def test_contacts_are_closed_at_rest_and_linearised_exactly(self, name):
        corners, step = Corners(load_scene(name)), 1e-6
        q = np.zeros((corners.count, 3))
        assert corners.linearise(q)[0] == pytest.approx(0.0, abs=1e-12)
        q = 0.01 * np.sin(np.arange(q.size)).reshape(q.shape)
        value, matrix = corners.linearise(q)
        for side, bodies in enumerate((corners.before, corners.after)):
            for column in range(3):
                for i in np.flatnonzero(bodies < corners.count)[:6]:
                    moved = q.copy()
                    moved[bodies[i], column] += step
                    change = (corners.linearise(moved)[0] - value)[i] / step
                    assert change == pytest.approx(matrix[i, :, 3 * side + column], abs=1e-4)


def test_pulse_leaves_the_ground_at_rest_and_displaced():
    """+a for tp then −a/2 for 2 tp: no velocity is left, and the ground has moved by 1.5 a tp²."""
    velocity = np.cumsum(load_scene("arch7_pulse").at(0.4).step_means(0.001)) * 0.001
    assert abs(velocity[-1]) < 1e-9
    assert velocity.sum() * 0.001 == pytest.approx(1.5 * 0.4 * STANDARD_GRAVITY * 0.09, rel=1e-5)


def test_unknown_scene_and_unknown_key_are_refused():
    with pytest.raises(FileNotFoundError, match="arch8_pulse"):
        load_scene("arch8_pulse")
    with pytest.raises(TypeError, match="voussoir"):
        Scene(**PULSE.to_dict(), voussoir=7)


class _Sideways:
    """A stepper whose bodies move sideways as x(t): the driver's judgement in closed form."""

    unconverged = None

    def __init__(self, place) -> None:
        self.place, self.start, self.time = place, PULSE.bodies().centroid, 0.0

    def advance(self, ground_acceleration) -> None:
        self.time += 0.005 * len(ground_acceleration)

    def centroids(self):
        return self.start + np.array([self.place(self.time), 0.0])


def test_collapse_is_a_centroid_beyond_two_thicknesses():
    scene = replace(PULSE, duration=5.0)
    found = drive(_Sideways(lambda t: 0.5 * t * t), scene, 0.005, history=True)
    expected = math.sqrt(2.0 * 2.0 * scene.thickness)
    assert found.collapsed
    assert expected < found.collapse_time <= expected + 0.01 + 1e-9
    assert found.steps == round(found.collapse_time / 0.005)
    assert found.history["time"][-1] == pytest.approx(found.simulated_seconds)
    stands = drive(_Sideways(lambda t: 2.9 * math.sin(t)), scene, 0.005)
    assert not stands.collapsed
    assert stands.peak_displacement == pytest.approx(2.9, rel=1e-4)


@pytest.mark.parametrize("place", [lambda t: math.nan, lambda t: 1e3 * t * t])
def test_positions_that_are_no_motion_are_a_failure_and_no_collapse(place):
    with pytest.raises(ArithmeticError, match="m/s at"):
        drive(_Sideways(place), PULSE, 0.005)


class TestProcess:
    def test_names_and_interpreters_that_are_not_there(self, monkeypatch):
        with pytest.raises(ValueError, match=r"chrono.*mujoco"):
            OtherSolver("chrono")
        monkeypatch.setenv("ARCHFRAG_LMGC90_PYTHON", shutil.which("false"))
        found = client.solver_versions(["archfrag", "lmgc90"])
        assert found["archfrag"] == f"archfrag {af.__version__}"
        assert found["lmgc90"].startswith("not installed: process ended (1)")

    def test_a_failed_run_is_no_outcome_and_the_next_one_runs(self):
        solver = OtherSolver("archfrag")
        with pytest.raises(SolverFailed, match=r"archfrag, arch7_pulse, dt 0.001 s.*'rtl'.*rtol"):
            solver.run(PULSE, 0.001, {"rtl": 1e-3})
        with pytest.raises(SolverFailed, match="method"):
            solver.run(PULSE, 0.001, {"method": "guess"})
        solver.run(PULSE, 0.001)
        solver.process.kill()
        with pytest.raises(SolverFailed, match="process ended"):
            solver.run(PULSE, 0.001)
        solver.limit = 1e-3
        with pytest.raises(SolverFailed, match=r"no answer in 0\.001 s"):
            solver.run(PULSE, 1e-5)
        solver.limit = 60.0
        assert not solver.run(PULSE, 0.001).collapsed
        solver.close()


# Largest relative error of the keystone before the first impact, and of the block; `lmgc90` starts
# from rest.
SOLVERS = {
    "archfrag": (0.01, 0.05), "siconos": (0.02, 0.06), "pinocchio": (0.02, 0.06),
    "kamino": (0.02, 0.06), "lmgc90": (0.01, None), "mujoco": (0.1, 0.08), "pymunk": (0.04, 0.1),
    "mujoco_corners": (0.1, 0.08),
}  # fmt: skip


def _displacement(outcome, scene, time):
    """Of the middle body, between the two nearest samples (ours are not equidistant)."""
    centroids = np.array(outcome.history["centroids"]) - scene.bodies().centroid
    middle = centroids[:, centroids.shape[1] // 2]
    return np.array([np.interp(time, outcome.history["time"], along) for along in middle.T])


@pytest.mark.parametrize("name", [*SOLVERS])
def test_each_solver_that_is_installed_moves_as_ours(name):
    """Keystone at 0.2 and 0.4 s as LMGC90 and Siconos at 0.5 ms agree on it; a block rocks."""
    try:
        solver = OtherSolver(name, 120.0)
    except client.SolverMissing as reason:
        pytest.skip(str(reason))
    arch, block = SOLVERS[name]
    outcome = solver.run(PULSE, 0.002, history=True)
    for time, expected in ((0.2, -0.01621), (0.4, -0.04211)):
        assert _displacement(outcome, PULSE, time)[0] == pytest.approx(expected, rel=arch)
    if block is None:
        with pytest.raises(SolverFailed, match="initial state"):
            solver.run(ROCKING, 0.002)
    else:
        ours = OtherSolver("archfrag").run(ROCKING, 1e-4, history=True)
        theirs = solver.run(ROCKING, 0.002, history=True)
        for time in (0.0, 0.3):
            expected = _displacement(ours, ROCKING, time)
            found = _displacement(theirs, ROCKING, time)
            assert found == pytest.approx(expected, rel=block)
    solver.close()
