"""What limits the numbers of an arch: hinges at the very edges, and joints that lock."""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.simulation.standing import arch_cautions, edge_loss, edge_text

RING = af.Arch.segmental(span=8.0, rise=3.0, thickness=0.6, voussoirs=9, friction=0.6)


def flat_arch(lean, voussoirs, friction=0.6, height=0.4):
    """Flat arch between -1 and 1 m whose joints lean outwards at the top."""
    x = np.linspace(-1.0, 1.0, voussoirs + 1)
    top = np.column_stack([x + height * np.tan(lean * x), np.full_like(x, height)])
    return af.Arch.from_joints(np.column_stack([x, 0.0 * x]), top, friction=friction)


class TestHingesInside:
    @pytest.mark.parametrize("width", [0.4, 0.1])
    def test_of_a_block_it_is_their_part_of_its_half_width(self, width):
        block = af.Block(width=width, height=2.0, friction=0.8)
        assert edge_loss(block) == pytest.approx(0.01 / (0.5 * width), rel=1e-9)

    def test_one_that_is_too_narrow_does_not_stand(self):
        block = af.Block(width=0.018, height=0.1, friction=0.8)
        assert edge_loss(block) == 1.0
        assert edge_text(block, 1.0).endswith("the arch does not stand")

    def test_on_top_of_what_crushes_and_of_a_recess(self):
        weak = af.crushed(RING.recessed(0.02, 0.0), 2e6)
        expected = af.onset(weak.recessed(0.01, 0.01)).plus / af.onset(weak).plus
        assert edge_loss(weak) == pytest.approx(1.0 - expected, rel=1e-6)
        assert edge_loss(weak) > edge_loss(RING)

    def test_of_one_that_has_spread_it_is_as_built(self):
        weak = af.crushed(RING, 2e6)
        spread = af.move_springing(weak, spread=0.01)
        assert edge_loss(spread) == edge_loss(weak)
        assert edge_loss(spread.tied(level=1.0, area=3e-4)) == edge_loss(weak)
        assert "of the arch as built by" in edge_text(spread, edge_loss(spread))

    def test_nothing_is_said_of_one_that_does_not_stand(self):
        thin = af.Arch.circular(10.0, 0.3, 157.5, voussoirs=27, friction=0.7)
        assert math.isnan(edge_loss(thin))
        assert edge_text(thin, math.nan) == ""
        assert arch_cautions(thin, af.onset(thin)) == []

    def test_a_caution_where_it_is_more_than_a_tenth(self):
        thin = af.Arch.circular(2.5, 0.3, 157.5, voussoirs=27, friction=0.7)
        (caution,) = arch_cautions(thin, af.onset(thin))
        assert "joints: {stiffness: 3e+10}" in caution
        assert arch_cautions(RING, af.onset(RING)) == []


class TestJointsThatLock:
    def test_a_flat_arch_with_vertical_joints_falls_at_once(self):
        arch = flat_arch(0.0, 5)
        start = af.onset(arch)
        assert math.inf in (start.plus, start.minus)
        (caution,) = arch_cautions(arch, start)
        assert "towards +x and -x" in caution
        assert af.limit_load(arch, method="event_driven") < 0.01

    @pytest.mark.parametrize("peak", [0.1, 0.3])
    @pytest.mark.parametrize("method", ["auto", "event_driven"])
    def test_it_falls_too_after_a_motion_that_has_wedged_it(self, method, peak):
        wave = peak * 9.81 * np.sin(np.linspace(0.0, 2.0 * np.pi, 100))
        motion = af.Motion(np.append(wave, np.zeros(10)), 0.01)
        assert af.simulate(
            flat_arch(0.0, 5), motion, method=method, rests=False
        ).collapsed

    def test_one_of_keystones_does_not_move(self):
        with pytest.raises(
            af.errors.InputError, match=r"towards -x up to 2.04 g; its joints"
        ):
            af.limit_load(flat_arch(0.2, 5), "-x", method="event_driven")
