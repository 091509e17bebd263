"""Scene files: they load, build, and are the chains and motions that our solver is given."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.evidence.peers.drive import drive
from archfrag.evidence.run import Places, arch_of, with_samples
from archfrag.evidence.scene import STANDARD_GRAVITY, Scene, load_scene, scene_names

ROOT = Path(__file__).parents[2]
PLACES = Places(ROOT / "records", ROOT.parent / "shared" / "records")
SCENES = scene_names()


def scene_with_samples(name):
    """A scene, its record read; skipped where a real record is not at hand."""
    try:
        return with_samples(load_scene(name), PLACES)
    except InputError as reason:
        pytest.skip(str(reason))


def test_every_section_of_the_comparison_has_a_scene():
    sections = {
        section.strip() for name in SCENES for section in load_scene(name).source.split(",")
    }
    assert sections >= {"A", "B", "C", "cost"}


@pytest.mark.parametrize("name", SCENES)
class TestEveryScene:
    def test_bodies_are_those_of_the_package(self, name):
        scene = scene_with_samples(name)
        ours, bodies = arch_of(scene).chain, scene.bodies()
        np.testing.assert_allclose(bodies.mass, ours.mass, rtol=1e-12)
        np.testing.assert_allclose(bodies.inertia, ours.inertia, rtol=1e-12)
        np.testing.assert_allclose(bodies.centroid, ours.centroid, rtol=0.0, atol=1e-12)

    def test_outlines_are_counter_clockwise_and_share_their_joints(self, name):
        outlines = scene_with_samples(name).polygons()
        for outline in outlines:
            edge = np.roll(outline, -1, axis=0) - outline
            turned = np.roll(edge, -1, axis=0)
            assert np.all(edge[:, 0] * turned[:, 1] - edge[:, 1] * turned[:, 0] > 0.0)
        for before, after in pairwise(outlines):
            shared = {tuple(corner) for corner in before} & {tuple(corner) for corner in after}
            assert len(shared) == 2

    def test_ground_lies_beyond_the_springing_faces(self, name):
        scene = scene_with_samples(name)
        inner, outer = scene.joint_lines()
        faces = [(inner[0], outer[0]), (inner[-1], outer[-1])]
        for ground, (start, end), voussoir in zip(
            scene.supports(), faces, (scene.polygons()[0], scene.polygons()[-1])
        ):
            along = (end - start) / np.linalg.norm(end - start)
            across = np.array([-along[1], along[0]])
            ground_side, voussoir_side = (ground - start) @ across, (voussoir - start) @ across
            assert (
                max(ground_side.min(), ground_side.max(), key=abs)
                * max(voussoir_side.min(), voussoir_side.max(), key=abs)
                < 0.0
            )
            assert np.ptp((ground - start) @ along) == pytest.approx(
                np.linalg.norm(end - start) + 2.0 * scene.thickness
            )

    @pytest.mark.parametrize("dt", [0.005, 0.0005])
    def test_steps_carry_the_whole_motion(self, name, dt):
        scene = scene_with_samples(name)
        samples, step = scene.ground_acceleration()
        means = scene.step_means(dt)
        assert len(means) == round(scene.duration / dt)
        assert means.sum() * dt == pytest.approx(
            0.5 * step * (samples[1:] + samples[:-1]).sum(), abs=1e-9
        )


def test_pulse_leaves_the_ground_at_rest_and_moved_on():
    """+a for tp then −a/2 for 2 tp: no velocity is left, and the ground has moved by 1.5 a tp²."""
    scene = load_scene("arch7_pulse").at(0.4)
    dt = 0.001
    velocity = np.cumsum(scene.step_means(dt)) * dt
    assert abs(velocity[-1]) < 1e-9
    assert velocity.max() == pytest.approx(0.4 * STANDARD_GRAVITY * 0.3, rel=2e-3)
    assert velocity.sum() * dt == pytest.approx(1.5 * 0.4 * STANDARD_GRAVITY * 0.3**2, rel=1e-5)


class _Falling:
    """A stepper whose bodies fall freely sideways: the driver's judgement in closed form."""

    version, unconverged, contacts = "test", None, None

    def __init__(self, scene: Scene, dt: float) -> None:
        self.start, self.dt, self.steps = scene.bodies().centroid, dt, 0

    def advance(self, ground_acceleration) -> None:
        self.steps += len(ground_acceleration)

    def centroids(self):
        return self.start + np.array([0.5 * (self.steps * self.dt) ** 2, 0.0])


def test_collapse_is_a_centroid_beyond_two_thicknesses():
    scene, dt = load_scene("arch7_pulse"), 0.005
    outcome = drive("test", _Falling(scene, dt), scene, dt, {}, 0.0)
    expected = np.sqrt(2.0 * 2.0 * scene.thickness)
    assert outcome.collapsed
    assert expected < outcome.collapse_time <= expected + 0.01 + 1e-9
    assert outcome.simulated_seconds == pytest.approx(outcome.collapse_time)
    assert outcome.steps == round(outcome.collapse_time / dt)


def test_unknown_scene_and_unknown_key_are_refused():
    with pytest.raises(FileNotFoundError):
        load_scene("arch8_pulse")
    with pytest.raises(TypeError):
        Scene(**load_scene("block_sine").to_dict(), voussoir=7)
