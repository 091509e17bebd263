"""Samples of parameters: marginals, correlation, designs of points; joints that are recessed."""

import warnings

import numpy as np
import pytest
from scipy import stats

import archfrag as af
from archfrag.arch.recess import recessed
from archfrag.arch.uncertain import (
    Lognormal,
    Normal,
    Triangular,
    Uniform,
    correlation_factor,
    sample,
    unit_points,
)
from archfrag.errors import GeometryError, InputError

U = np.array([1e-6, 0.01, 0.2, 0.5, 0.77, 0.99, 1 - 1e-6])
MARGINALS = {
    "normal": (Normal(mean=1.5, sd=0.2), stats.norm(1.5, 0.2)),
    "truncated normal": (
        Normal(mean=1.5, sd=0.2, lower=1.4, upper=1.9),
        stats.truncnorm(-0.5, 2.0, 1.5, 0.2),
    ),
    "lognormal": (Lognormal(median=0.7, beta=0.3), stats.lognorm(0.3, scale=0.7)),
    "uniform": (Uniform(start=-1.0, stop=3.0), stats.uniform(-1.0, 4.0)),
    "triangular": (Triangular(start=1.0, mode=2.0, stop=5.0), stats.triang(0.25, 1.0, 4.0)),
    "falling": (Triangular(start=0.0, mode=0.0, stop=2.0), stats.triang(0.0, 0.0, 2.0)),
    "rising": (Triangular(start=0.0, mode=2.0, stop=2.0), stats.triang(1.0, 0.0, 2.0)),
}


class TestMarginals:
    @pytest.mark.parametrize("name", MARGINALS)
    def test_quantiles_are_scipys(self, name):
        own, other = MARGINALS[name]
        np.testing.assert_allclose(own.quantile(U), other.ppf(U), rtol=1e-9, atol=1e-12)

    def test_truncated_lognormal_keeps_its_shape_between_the_bounds(self):
        whole = stats.lognorm(0.2, scale=0.7)
        cut = Lognormal(median=0.7, beta=0.2, lower=0.6, upper=0.9)
        low, high = whole.cdf([0.6, 0.9])
        np.testing.assert_allclose(cut.quantile(U), whole.ppf(low + U * (high - low)), rtol=1e-12)

    def test_bounds_that_leave_nothing_are_refused(self):
        with pytest.raises(InputError, match=r"lies between lower = 9 and upper = inf"):
            Normal(mean=1.0, sd=0.1, lower=9.0).quantile(0.5)

    @pytest.mark.parametrize("scheme", ["sobol", "latin_hypercube"])
    def test_samples_have_the_distribution_asked_for(self, scheme):
        marginals = {name: own for name, (own, _) in MARGINALS.items()}
        drawn = sample(marginals, 256, scheme=scheme, seed=4)
        for name, (_, other) in MARGINALS.items():
            # Of 256 random numbers the 5 % point is 0.085: these are stratified.
            assert stats.kstest(drawn[name], other.cdf).statistic < 0.01


class TestPoints:
    @pytest.mark.parametrize("scheme", ["sobol", "latin_hypercube"])
    def test_each_slice_has_a_point(self, scheme):
        points = unit_points(64, 5, scheme, seed=2)
        assert np.all(np.sort((64 * points).astype(int), axis=0) == np.arange(64)[:, None])

    @pytest.mark.parametrize("scheme", ["sobol", "latin_hypercube"])
    def test_seed_decides_and_nothing_is_warned_of(self, scheme):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            first, again, other = (unit_points(37, 3, scheme, seed) for seed in (1, 1, 2))
        np.testing.assert_array_equal(first, again)
        assert not np.any(first == other)

    def test_longer_sobol_designs_begin_with_shorter_ones(self):
        long = unit_points(1000, 4, "sobol", seed=3)
        for n in (1, 5, 64, 999):
            np.testing.assert_array_equal(unit_points(n, 4, "sobol", seed=3), long[:n])

    def test_no_samples_and_one(self):
        assert unit_points(1, 2, "sobol", 1).shape == (1, 2)
        assert sample({}, 8) == {}


class TestCorrelation:
    def test_ranks_and_scores_have_the_correlations_asked_for(self):
        drawn = sample(
            {"a": Lognormal(median=1.0, beta=0.5), "b": Normal(mean=0.0, sd=1.0),
             "c": Lognormal(median=2.0, beta=0.2)},
            2**13,
            correlation={"a": {"b": 0.6}, "c": {"a": -0.4}},
        )  # fmt: skip
        scores = np.corrcoef([np.log(drawn["a"]), drawn["b"], np.log(drawn["c"])])
        np.testing.assert_allclose(
            scores[np.triu_indices(3, 1)], [0.6, -0.4, 0.0], atol=0.01
        )
        rank = stats.spearmanr(drawn["a"], drawn["b"]).statistic
        assert rank == pytest.approx(6.0 / np.pi * np.arcsin(0.3), abs=0.01)

    def test_marginals_are_kept(self):
        drawn = sample(
            {"a": Uniform(start=0.0, stop=1.0), "b": Triangular(start=1.0, mode=2.0, stop=5.0)},
            2**10,
            correlation={"a": {"b": 0.9}},
        )
        assert stats.kstest(drawn["b"], MARGINALS["triangular"][1].cdf).statistic < 0.02

    @pytest.mark.parametrize(
        ("given", "part"),
        [
            ({"a": {"d": 0.1}}, "d is not one of the parameters that vary"),
            ({"a": {"a": 0.1}}, "with itself"),
            ({"a": {"b": 0.1}, "b": {"a": 0.1}}, "is given twice"),
            ({"a": {"b": 1.0}}, "must be greater than -1 and less than 1"),
            ({"a": {"b": float("nan")}}, "must be greater than -1 and less than 1"),
            ({"a": {"b": 0.9, "c": 0.9}, "b": {"c": -0.9}}, "cannot hold together"),
        ],
    )
    def test_what_cannot_be_is_refused(self, given, part):
        with pytest.raises(InputError, match=part):
            correlation_factor(["a", "b", "c"], given)


class TestRecess:
    def test_a_recessed_block_rocks_about_what_is_left(self):
        # Rocking starts at the lever arms' ratio: base corner to centroid.
        block = af.Block(width=0.5, height=2.0, friction=2.0)
        rests = af.onset(recessed(block, intrados=0.05, extrados=0.1))
        towards = {round(rests.plus, 9), round(rests.minus, 9)}
        assert towards == {0.2, 0.15}
        whole = af.onset(block)
        assert whole.plus == pytest.approx(0.25)

    def test_onset_is_that_of_a_thinner_ring_of_the_same_bodies(self):
        ring = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
        less = recessed(ring, intrados=0.05, extrados=0.05)
        np.testing.assert_array_equal(less.chain.mass, ring.chain.mass)
        length = np.hypot(*(less.chain.face_after[:, 1] - less.chain.face_after[:, 0]).T)
        np.testing.assert_allclose(length, 1.4)
        np.testing.assert_allclose(
            less.chain.face_before[1:] + less.chain.centroid[:, None],
            np.concatenate([less.chain.face_after[1:-1] + less.chain.centroid[1:, None],
                            less.chain.face_after[-1:]]),
            atol=1e-12,
        )  # fmt: skip
        thinner = af.Arch.circular(10.0, 1.4, 157.5, voussoirs=7, friction=0.7)
        assert af.onset(less).plus == pytest.approx(af.onset(thinner).plus, rel=1e-3)
        assert ring.parameters.get("recess") is None
        assert less.parameters["recess"] == {"intrados": 0.05, "extrados": 0.05}

    def test_sides_are_the_users_in_a_flipped_chain(self):
        ring = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7, sector=False)
        flipped = af.Arch.from_joints(ring.intrados[::-1], ring.extrados[::-1], friction=0.7)
        assert flipped.flipped
        depths = np.linspace(0.0, 0.14, 8)
        one, other = recessed(ring, depths, 0.02), recessed(flipped, depths[::-1], 0.02)
        np.testing.assert_allclose(other.intrados, one.intrados[::-1])
        # The same ring, travelled the other way: acceleration towards +x stays what it was.
        assert af.onset(other).plus == pytest.approx(af.onset(one).plus, rel=1e-9)
        assert af.onset(other).minus == pytest.approx(af.onset(one).minus, rel=1e-9)
        assert af.onset(one).plus != pytest.approx(af.onset(one).minus, rel=1e-2)
        for corner in (0, 1):
            side = getattr(other, other.corner_name(corner))
            np.testing.assert_allclose(other.chain.face_before[0, corner], side[0])

    def test_a_free_face_is_no_joint(self):
        height = np.linspace(0.0, 2.0, 3)
        right = np.column_stack([np.full(3, 0.25), height])
        column = af.Arch.from_joints(right, right * [-1, 1], friction=0.7, free_end=True)
        less = recessed(column, [0.1, 0.0])
        np.testing.assert_allclose(less.intrados[:, 0], [0.15, 0.25, 0.25])

    @pytest.mark.parametrize(
        ("depth", "part"),
        [
            (0.5, r"recess of joint 0 leaves 0 m of its 0\.5 m"),
            (-0.1, r"recess\.intrados = -0\.1 m is impossible"),
            ([0.1, 0.1], "recess.intrados has shape"),
        ],
    )
    def test_what_leaves_no_joint_is_refused(self, depth, part):
        with pytest.raises(GeometryError, match=part):
            recessed(af.Block(width=0.5, height=2.0, friction=1.0), depth)
