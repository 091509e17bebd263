"""Joints that give: contact points by the strips of elastic faces, and rows for the kernels."""

import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest

import archfrag as af
from archfrag.errors import GeometryError, InputError, StabilityError, UnitWarning
from archfrag.physics.status import Joint
from archfrag.simulation.rest import static_limit
from archfrag.simulation.standing import (
    arch_cautions,
    edge_loss,
    edge_text,
    joints_text,
)
from tests.physics.test_cautions import flat_arch
from tests.piers import on_piers

RING = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
THIN = af.Arch.circular(2.5, 0.3, 157.5, voussoirs=27, friction=0.7)
NAVE = on_piers(RING, height=6.0, width=4.0, courses=2)
SLIDES = af.Arch.circular(5.0, 1.0, 180.0, voussoirs=11, friction=0.37)


def lengths(arch):
    return np.hypot(*(arch.extrados - arch.intrados)[: arch.n_joint].T)


def inset(before, after):
    """How far inside the ends of a joint its contact points lie; the same at both."""
    np.testing.assert_allclose(
        after.intrados - before.intrados, before.extrados - after.extrados, atol=1e-12
    )
    return 0.5 * (lengths(before) - lengths(after))


def strip(arch, stiffness, rotation):
    """Lengths on which the joints of an arch bear at a rotation, by its normal forces."""
    return np.sqrt(2.0 * af.onset(arch).normal / (stiffness * rotation))


def at_rest(arch, stiffness):
    """Normal forces of the joints at rest, by steps of elastic faces."""
    still = af.Motion(np.zeros(20), 0.01)
    soft = af.jointed(arch, stiffness, model="face")
    force = af.simulate(soft, still, history=True, follow=0.0).history.reaction.values[
        -1
    ]
    x, y = (arch.extrados - arch.intrados)[: arch.n_joint].T
    return abs(force[:, 0] * y - force[:, 1] * x) / np.hypot(x, y)


def held_by_faces(arch, near):
    """Ground acceleration at which elastic faces give way, by a slow ramp about one [g]."""
    time = np.arange(0.0, 23.0, 0.01)
    load = near * np.interp(time, [0.0, 3.0, 23.0], [0.0, 0.9, 1.1])
    ramp = af.Motion(load * 9.80665, 0.01)
    moved = af.simulate(arch, ramp, history=True, follow=0.0).history.displacement
    far = (
        np.hypot(*np.moveaxis(moved.values, -1, 0)).max(axis=1)
        > 0.05 * lengths(arch).min()
    )
    return np.interp(moved.time.values[np.argmax(far)], time, load)


class TestInset:
    @pytest.mark.parametrize(
        ("arch", "stiffness"),
        [
            (af.Arch.segmental(10.7, 1.1, 0.5, 9, friction=math.inf), 1e10),
            (af.Arch.segmental(12.0, 1.5, 0.45, 15, friction=math.inf), 3e10),
            (THIN, 3e10),
        ],
        ids=["rise/span 0.10", "rise/span 0.125", "thin"],
    )
    def test_it_bears_what_elastic_faces_bear_under_a_slow_ramp(self, arch, stiffness):
        by_inset = af.onset(af.jointed(arch, stiffness)).plus
        face = af.jointed(arch, stiffness, model="face")
        assert held_by_faces(face, by_inset) == pytest.approx(by_inset, rel=0.03)

    @pytest.mark.parametrize(
        ("width", "height", "k"), [(0.1, 2.0, 3e10), (0.5, 10.0, 1e9)]
    )
    def test_of_a_block_it_is_half_its_strip_at_a_third_of_that_over_its_height(
        self, width, height, k
    ):
        block = af.Block(width, height, 0.8, depth=0.6)
        weight = block.chain.mass[0] * block.chain.gravity
        x = (6.0 * weight * height / (k * 0.6)) ** (1 / 3)
        soft = af.jointed(block, k)
        assert inset(block, soft)[0] == pytest.approx(0.5 * x, rel=0.02)
        # Exactly, with large rotations: the largest load over all rotations.
        theta = np.geomspace(1e-4, 1.0, 10_000) * width / height
        arm = 0.5 * width - np.sqrt(2.0 * weight / (k * 0.6 * theta)) / 3.0
        load = np.tan(np.arctan2(arm, 0.5 * height) - theta).max()
        assert af.onset(soft).plus == pytest.approx(load, rel=0.015)

    def test_the_load_is_the_largest_that_the_elastic_faces_bear(self):
        start = af.onset(RING)
        falls = static_limit(RING, start)
        best = 0.0
        for rotation in np.geomspace(1e-4, 0.1, 400) * falls:
            third = strip(RING, 3e10, rotation) / 3.0
            load = (
                af.onset(RING.recessed(third, third)).plus
                - start.plus * rotation / falls
            )
            best = max(best, load)
        assert af.onset(af.jointed(RING, 3e10)).plus == pytest.approx(best, rel=0.01)

    def test_it_goes_with_the_cube_root_of_the_stiffness_and_each_joint_has_its_own_force(
        self,
    ):
        one, other = (inset(RING, af.jointed(RING, k)) for k in (3e11, 2.4e12))
        np.testing.assert_allclose(one / other, 2.0, rtol=0.01)
        root = np.sqrt(at_rest(RING, 3e11))
        np.testing.assert_allclose(one / one[0], root / root[0], rtol=1e-3)

    def test_bodies_keep_mass_inertia_and_centroid(self):
        soft = af.jointed(RING, 1e10)
        for name in ("mass", "inertia", "centroid", "friction"):
            np.testing.assert_array_equal(
                getattr(soft.chain, name), getattr(RING.chain, name)
            )
        assert soft.outlines is RING.outlines
        assert soft.dimensions == RING.dimensions
        assert (soft.chain.joint, soft.chain.start, soft.chain.tie) == (
            None,
            None,
            None,
        )

    def test_it_lies_inside_what_a_recess_leaves(self):
        worn = RING.recessed(0.05, 0.02)
        soft = af.jointed(worn, 3e10)
        assert (inset(worn, soft) > 0.02).all()
        assert soft.parameters["recess"] == {"intrados": 0.05, "extrados": 0.02}

    def test_of_strip_and_crushed_depth_the_larger_is_lost(self):
        k = 3e10
        f = 4.7e6
        soft, weak = (
            inset(RING, each) for each in (af.jointed(RING, k), af.crushed(RING, f))
        )
        both = inset(RING, af.jointed(RING, k, strength=f))
        assert (soft > weak).any()
        assert (soft < weak).any()
        np.testing.assert_allclose(both, np.maximum(soft, weak), rtol=0.02)

    def test_joints_of_a_list_are_those_of_piers_and_bases_too(self):
        stiffness = np.full(NAVE.n_joint, math.inf)
        stiffness[[0, 3]] = 1e10
        assert np.flatnonzero(inset(NAVE, af.jointed(NAVE, stiffness))).tolist() == [
            0,
            3,
        ]
        assert (inset(NAVE, af.jointed(NAVE, 1e10)) > 0.0).all()

    def test_bits_do_not_depend_on_threads_of_linear_algebra(self):
        """An arch of 47 voussoirs, as beyond 33 the elimination of OpenBLAS has threads."""
        code = (
            "import archfrag as af; arch = af.Arch.circular(5.0, 0.8, 180.0, 47, 0.7); "
            "print(af.jointed(arch, 3e10).intrados.tobytes().hex())"
        )
        found = {
            subprocess.run(
                [sys.executable, "-c", code],
                env={**os.environ, "OPENBLAS_NUM_THREADS": str(count)},
                check=True,
                capture_output=True,
                text=True,
            ).stdout
            for count in (1, 2)
        }
        assert len(found) == 1

    def test_of_a_column_of_drums_and_of_polygons(self):
        drums = [[(-0.5, i), (0.5, i), (0.5, i + 1), (-0.5, i + 1)] for i in range(4)]
        ground = [[(-0.5, 0), (0.5, 0)]]
        column = af.Arch.from_polygons(drums, 0.8, ground=ground)
        depth = inset(column, af.jointed(column, 1e10))
        np.testing.assert_allclose(
            depth / depth[0], np.sqrt([1, 0.75, 0.5, 0.25]), rtol=1e-6
        )

    def test_where_the_mechanism_slides_the_rotation_is_that_without_sliding(self):
        assert math.isnan(static_limit(SLIDES, af.onset(SLIDES)))
        rough = af.Arch.circular(5.0, 1.0, 180.0, voussoirs=11, friction=math.inf)
        one, other = (inset(each, af.jointed(each, 3e10)) for each in (SLIDES, rough))
        root = np.sqrt(af.onset(SLIDES).normal / af.onset(rough).normal)
        np.testing.assert_allclose(one, other * root, rtol=0.02)

    def test_where_nothing_rotates_it_is_that_of_a_block_as_high_as_the_centroid(self):
        flat = flat_arch(0.2, 5, friction=math.inf)
        assert math.isnan(static_limit(flat, af.onset(flat)))
        strips = np.sqrt(2.0 * at_rest(flat, 1e10) / 1e10)
        middle = math.sqrt(np.mean(strips**2))
        rotation = (middle / (6.0 * lengths(flat).mean())) ** (2 / 3)
        expected = 0.5 * strips / math.sqrt(rotation)
        np.testing.assert_allclose(
            inset(flat, af.jointed(flat, 1e10)), expected, rtol=1e-3
        )


class TestSettings:
    def test_without_a_finite_stiffness_it_is_the_arch_itself(self):
        assert af.jointed(RING, math.inf) is RING
        assert af.jointed(RING, [math.inf] * 8, model="face") is RING
        weak = af.crushed(RING, 2e6)
        same = af.jointed(RING, math.inf, strength=2e6)
        assert weak.parameters == same.parameters
        np.testing.assert_array_equal(weak.chain.face_after, same.chain.face_after)

    def test_parameters_tell_it_and_the_positions_of_joints_stay(self):
        soft = af.jointed(RING, [3e10, *[math.inf] * 7], shear=1e10, strength=1e8)
        assert soft.parameters["joints"] == {
            "stiffness": [3e10, *["inf"] * 7],
            "shear": 1e10,
            "damping": 0.05,
            "model": "inset",
        }
        assert soft.parameters["strength"] == 1e8
        at = [0.0, 20.0, 60.0, 80.0]
        ring = af.Arch.circular(
            10.0, 1.5, 80.0, voussoirs=3, friction=0.7, joint_positions=at
        )
        assert af.jointed(ring, 3e10).parameters["joint_positions"] == at

    def test_a_face_is_a_row_of_each_joint_and_changes_no_geometry(self):
        ring = af.Arch.circular(
            10.0, 1.5, 157.5, voussoirs=7, friction=0.7, depth=[1, 1, 1, 0.6, 1, 1, 1]
        )
        stiffness = np.linspace(1e10, 2e10, 8)
        soft = af.jointed(ring, stiffness, 5e9, 0.1, "face", 3)
        depth = np.array([1, 1, 1, 0.6, 0.6, 1, 1, 1])
        expected = np.column_stack(
            [stiffness * depth, 5e9 * depth, [0.1] * 8, [3.0] * 8]
        )
        np.testing.assert_array_equal(soft.chain.joint, expected)
        assert soft.intrados is ring.intrados
        assert af.jointed(ring, 1e10, model="face").chain.joint[0, Joint.POINTS] == 0.0
        shear = af.jointed(ring, stiffness, model="face").chain.joint[:, Joint.SHEAR]
        np.testing.assert_array_equal(shear, stiffness * depth)
        assert soft.parameters["joints"]["points"] == 3

    def test_ties_and_springings_come_after(self):
        soft = af.jointed(RING, 3e10).tied(level=6.0, area=5e-4, prestress=1e4)
        assert soft.parameters["joints"]["model"] == "inset"
        moved = af.move_springing(af.jointed(RING, 3e10), spread=0.05)
        assert moved.parameters["joints"]["stiffness"] == 3e10

    @pytest.mark.parametrize(
        ("call", "error", "message"),
        [
            (
                lambda: af.jointed(RING, 1e5),
                GeometryError,
                "all at least 1e+06 Pa/m and at most",
            ),
            (
                lambda: af.jointed(RING, 1e16),
                GeometryError,
                "most 1e+15 Pa/m (inf: rigid)",
            ),
            (
                lambda: af.jointed(RING, [1e10] * 7),
                GeometryError,
                "one for each of the 8 joints",
            ),
            (
                lambda: af.jointed(RING, 1e10, shear=-1.0),
                GeometryError,
                "joints.shear = -1.0",
            ),
            (
                lambda: af.jointed(RING, 1e10, damping=1.5),
                InputError,
                "joints.damping is 1.5",
            ),
            (
                lambda: af.jointed(RING, 1e10, model="soft"),
                InputError,
                "must be inset or face",
            ),
            (
                lambda: af.jointed(RING, 1e10, points=3),
                InputError,
                "needs joints.model face",
            ),
            (
                lambda: af.jointed(RING, 1e10, model="face", points=4),
                InputError,
                "2 or 3",
            ),
            (
                lambda: af.jointed(RING, 1e10, strength=-1.0),
                InputError,
                "strength is -1.0",
            ),
            (
                lambda: af.jointed(RING, 1e10, model="face", strength=1e6),
                InputError,
                "strength = 1e+06 needs joints.model inset",
            ),
            (
                lambda: af.jointed(RING, [1e10, *[math.inf] * 7], model="face"),
                InputError,
                "face needs a finite stiffness and shear",
            ),
            (
                lambda: af.jointed(RING, 1e10, model="face").tied(level=6.0, area=5e-4),
                GeometryError,
                "a tie needs rigid joints: joints.model inset",
            ),
            (
                lambda: af.jointed(RING.tied(level=6.0, area=5e-4), 1e10),
                InputError,
                "joints comes before ties and before springings",
            ),
            (
                lambda: af.jointed(af.jointed(RING, 1e10), 1e10),
                InputError,
                "already; joints",
            ),
            (
                lambda: af.crushed(af.jointed(RING, 1e10), 1e6),
                InputError,
                "already; strength",
            ),
            (
                lambda: af.jointed(af.crushed(RING, 2e6), 1e10),
                InputError,
                "give it to jointed",
            ),
            (
                lambda: af.jointed(RING, 1e10).recessed(0.01),
                GeometryError,
                "recessed comes before",
            ),
            (
                lambda: on_piers(af.jointed(RING, 1e10), height=5.0, width=3.0),
                GeometryError,
                "has joints already; Bridge comes before",
            ),
            (
                lambda: af.jointed(THIN, 1e7),
                StabilityError,
                "joints of 1e+07 Pa/m, which bear inside their ends; make it thicker",
            ),
        ],
    )
    @pytest.mark.filterwarnings("ignore:joints.stiffness")
    def test_what_does_not_fit_together_is_refused(self, call, error, message):
        with pytest.raises(error, match=re.escape(message)):
            call()

    def test_a_slip_of_unit_is_named(self):
        with pytest.warns(
            UnitWarning, match=r"joints.stiffness = 3e\+07 Pa/m: usual are 1e\+08"
        ):
            af.jointed(af.Block(1.0, 1.5, 0.8), 3e7)


class TestWhichModel:
    @pytest.mark.parametrize(
        ("span", "rise", "thickness", "voussoirs", "needed"),
        [
            (10.7, 1.1, 0.5, 9, True),
            (12.0, 1.5, 0.45, 15, True),
            (8.1, 0.9, 0.4, 9, True),
            (10.0, 4.0, 0.45, 21, False),
            (10.0, 2.5, 0.5, 15, False),
        ],
    )
    def test_flat_arches_need_faces(self, span, rise, thickness, voussoirs, needed):
        arch = af.Arch.segmental(span, rise, thickness, voussoirs, friction=0.65)
        for stiffness in (3e10, 1e11):
            soft = af.jointed(arch, stiffness)
            assert joints_text(soft).endswith("joints.model face is needed") == needed
            assert (joints_text(soft) in arch_cautions(soft, af.onset(soft))) == needed

    def test_by_what_the_inset_takes_of_the_onset(self):
        thick = af.Arch.circular(5.0, 1.5, 180.0, voussoirs=11, friction=0.7)
        assert joints_text(af.jointed(thick, 3e11)).endswith(": rigid ones are enough")
        assert joints_text(RING).endswith(
            ": joints.model inset is enough, rigid ones are not"
        )
        assert joints_text(af.jointed(THIN, 1e9)).endswith(
            ": joints.model face is needed"
        )
        soft = af.jointed(RING, 3e10)
        lost = 100.0 * (1.0 - af.onset(soft).plus / af.onset(RING).plus)
        words = f"its joints of 3e+10 Pa/m lower the onset of motion by {lost:.1f} %"
        for each in (
            soft,
            af.jointed(RING, 3e10, model="face"),
            soft.tied(6.0, area=1e-4),
        ):
            assert joints_text(each).startswith(words)
        assert joints_text(af.jointed(RING.recessed(0.3, 0.3), 3e10)) != joints_text(
            soft
        )

    def test_a_caution_where_the_model_of_the_arch_is_not_enough(self):
        soft = af.jointed(THIN, 1e9)
        assert arch_cautions(soft, af.onset(soft)) == [joints_text(soft)]
        face = af.jointed(THIN, 1e9, model="face")
        assert arch_cautions(face, af.onset(THIN)) == []
        soft = af.jointed(RING, 3e10)
        assert arch_cautions(soft, af.onset(soft)) == []

    def test_hinges_10_mm_further_inside(self):
        soft = af.jointed(RING, 3e10)
        face = af.jointed(RING, 3e10, model="face")
        depth = inset(RING, soft) + 0.01
        expected = (
            1.0 - af.onset(RING.recessed(depth, depth)).plus / af.onset(soft).plus
        )
        assert edge_loss(soft) == pytest.approx(expected, rel=1e-9)
        assert "10 mm further inside" in edge_text(soft, 0.1)
        assert edge_loss(face) == edge_loss(RING)
        assert edge_text(face, 0.1) == edge_text(RING, 0.1)
        assert edge_text(RING, 0.1).endswith(
            "%, and the collapse border by about as much"
        )
