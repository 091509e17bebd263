"""Calibration on shake-table tests; where their data are, the numbers of the validation page."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.validation.scenes import rocking

import archfrag as af
from archbench import nature
from archbench.exact import Rocking
from archbench.scene import STANDARD_GRAVITY

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "validation" / "shake_table"
PAGE = json.loads((ROOT / "docs" / "validation" / "nature.json").read_text("utf-8"))


class TestCalibration:
    def test_a_base_off_the_centre_rocks_earlier_to_its_nearer_end(self):
        start = af.onset(nature.block(0.10, 0.5, 0.3))  # wider to the right
        ends = np.tan(0.13) * 0.7 / 1.3, np.tan(0.13)
        assert (start.plus, start.minus) == pytest.approx(ends, rel=1e-6)

    def test_chances_are_means_over_near_blocks(self):
        shape = [x.size for x in nature.GRID.values()]
        steeper = np.broadcast_to(np.arange(12)[:, None, None, None] < 6, (*shape, 1))
        chance = nature.chances(steeper)
        assert nature.chances(np.ones((*shape, 2), bool)) == pytest.approx(1.0)
        assert np.all(np.diff(chance[0, :, 2, 3, 0]) <= 1e-12)
        edge = chance[
            :, 6, 2, 3, 0
        ]  # blocks that are set up less alike collapse more often
        assert np.all(np.diff(edge) > 0.0)
        assert edge[0] == pytest.approx(0.235, abs=0.005)

    def test_likelihood_is_the_chance_with_some_verdicts_flipped(self):
        one = nature.calibrate(np.array([[0.25]]), np.array([True]), np.ones((1, 1)))
        chance = nature.FLIPS + (1.0 - 2.0 * nature.FLIPS) * 0.25
        assert one[2][0] == pytest.approx(np.log(chance.mean()))
        assert one[1][0, 0] == pytest.approx(chance @ chance / chance.sum())

    def test_the_block_that_agrees_is_found_and_predicts_what_was_held_back(self):
        generator = np.random.default_rng(1)
        blocks = generator.random((40, 300)) < 0.4
        toppled = blocks[7] ^ (generator.random(300) < 0.05)
        known = np.arange(300) < 100
        (weight,), (p,), (evidence,) = nature.calibrate(blocks, toppled, known[None])
        assert weight.sum(axis=0).argmax() == 7
        assert weight.sum() == pytest.approx(1.0)
        flip = np.exp(weight.sum(axis=1) @ np.log(nature.FLIPS))
        assert 0.015 < flip < 0.12
        assert np.array_equal(p > 0.5, blocks[7])
        others = nature.calibrate(np.delete(blocks, 7, 0), toppled, known[None])[2]
        assert evidence > others[0] + 20.0

    def test_quantiles_of_even_weights_are_those_of_the_grid(self):
        axes = nature.FLIPS, nature.SCATTERS, *nature.GRID.values()
        even = np.ones([x.size for x in axes])
        found = nature.quantiles(even / even.size)
        low, middle, high = found["off_centre"]
        assert middle == pytest.approx(0.0, abs=1e-12)
        assert -low == pytest.approx(high)
        assert found["half_diagonal"][1] == pytest.approx(0.52, rel=1e-6)

    def test_verdicts_of_a_grid_survive_as_text(self):
        shape = *(x.size for x in nature.GRID.values()), 3
        flags = np.random.default_rng(2).random(shape) < 0.4
        assert np.array_equal(nature.unpacked(nature.packed(flags), 3), flags)

    def test_contradictions_are_counted_in_each_motion(self):
        toppled = np.array([0, 1, 0, 1, 0, 0, 1, 1], bool)
        motion = np.repeat(["a", "b"], 4)
        assert nature.contradictions(np.arange(8.0), toppled, motion) == 1
        assert nature.contradictions(np.arange(8.0), ~toppled, motion) == 4


@pytest.fixture(scope="module")
def tests():
    return nature.read_tests(DATA)


@pytest.fixture(scope="module")
def collapsed(tests):
    return nature.unpacked(PAGE["verdicts"], len(tests.motions))


@pytest.mark.filterwarnings("ignore::archfrag.errors.UnitWarning")
@pytest.mark.xdist_group("nature")
@pytest.mark.skipif(
    not DATA.is_dir(), reason="../shared/validation is not beside the repository"
)
class TestNature:
    def test_verdicts_that_are_kept_are_those_of_the_blocks(self, tests, collapsed):
        generator = np.random.default_rng(1)
        kept = collapsed.reshape(-1, len(tests.motions))
        for k in generator.choice(len(kept), 12, replace=False):
            found = nature.verdicts(nature.block(*nature.points()[k]), tests.motions)
            assert (found != kept[k]).mean() < 0.02, nature.points()[k]

    def test_the_page_shows_what_is_measured_and_its_rows_hold(self, tests, collapsed):
        found = nature.measure(tests, collapsed)
        for k, least, elements in ((1, 0.885, 0.866), (2, 0.92, 0.916)):
            own = found[f"specimen {k}"]
            shown = PAGE[f"specimen {k}"]
            assert own["equal_best_block"] >= least
            assert own["equal"] >= least > elements
            assert own["held_back"]["archfrag"] > own["held_back"]["elements"]
            for name in ("equal", "equal_best_block"):
                assert own[name] == pytest.approx(shown[name], abs=0.008)
            assert own["held_back"] == pytest.approx(shown["held_back"], abs=0.008)
            for name in ("tests", "archfrag"):
                for measure, rel in (("PGV", 0.05), ("PGA", 0.1)):
                    for each in ("theta", "beta"):
                        value = shown[name][measure][each]
                        assert own[name][measure][each] == pytest.approx(value, rel=rel)
        low, high = found["specimen 2"]["tests"]["PGV"]["beta"][1:]
        assert low < found["specimen 2"]["archfrag"]["PGV"]["beta"][0] < high

    def test_intervals_hold_known_parameters(self, tests, collapsed):
        held = nature.intervals_that_hold(tests, nature.chances(collapsed), 6)
        assert sum(held.values()) >= 18  # of 24
        kept = PAGE["held of 50"].values()
        assert 172 <= sum(kept) <= 188  # 86 to 94 % of 200
        assert min(kept) >= 41

    def test_specimen_1_loses_more_at_impacts_than_a_rigid_block(
        self, tests, collapsed
    ):
        """Symmetric blocks of the grid, and the same by the rocking equation with a factor."""
        lossy = np.zeros_like(collapsed[:, :, :1])
        for i, alpha in enumerate(nature.GRID["slenderness"]):
            for j, size in enumerate(nature.GRID["half_diagonal"]):
                twin = Rocking(alpha, np.sqrt(0.75 * STANDARD_GRAVITY / size))
                for k, each in enumerate(tests.motions):
                    lossy[i, j, 0, k] = (
                        np.abs(rocking(each, twin, 0.85 * twin.ratio)).max() > 1.0
                    )

        def evidence(verdicts, toppled):
            chance = nature.chances(np.repeat(verdicts, 7, axis=2))
            return nature.calibrate(chance, toppled, np.ones((1, toppled.size)))[2][0]

        gain = {
            k: evidence(lossy, own) - evidence(collapsed[:, :, 3:4], own)
            for k, own in tests.toppled.items()
        }
        assert gain[1] > 8.0
        assert gain[2] < 2.0
