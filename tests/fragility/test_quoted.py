"""The band that the report quotes holds the truth as often as it says."""

import numpy as np
import pytest
from scipy.special import ndtri

from archfrag.errors import FitError, InputError
from archfrag.fragility.brackets import find_brackets
from archfrag.fragility.quoted import independent_records, quoted_band

BETA = 0.35
LEVELS = np.exp(BETA * np.linspace(-2.2, 2.2, 15))
P = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
IM = np.exp(BETA * ndtri(P))


def table(generator, n_record):
    return (np.exp(BETA * generator.standard_normal((n_record, 1))) <= LEVELS).astype(int)


def fraction_held(design, draw, n_study):
    """Over studies: of the curve at `P` together, of theta, and of beta."""
    generator = np.random.default_rng(15)
    held = np.zeros(3)
    for _ in range(n_study):
        verdict, intensity, groups = draw(generator)
        known = quoted_band(design, verdict, intensity, IM, groups=groups)
        held[0] += np.mean((known.band.lower <= P) & (known.band.upper >= P))
        held[1] += known.theta[0] <= 1.0 <= known.theta[1]
        held[2] += known.beta[0] <= BETA <= known.beta[1]
    return held / n_study


class TestCoverage:
    """Small beside tests/benchmarks/run_coverage.py, but a band a sixth too narrow fails."""

    LEAST, MOST = 0.865, 0.935

    def test_same_records(self):
        def draw(generator):
            return table(generator, 24), LEVELS, None

        held = fraction_held("stripes", draw, 120)
        assert self.LEAST < held[0] < self.MOST
        assert np.all(held[1:] > 0.85)

    def test_independent_runs(self):
        def draw(generator):
            at = np.tile(LEVELS, 2)
            return (np.exp(BETA * generator.standard_normal(30)) <= at) * 1, at, None

        held = fraction_held("scattered", draw, 120)
        assert self.LEAST < held[0] < self.MOST
        assert np.all(held[1:] > 0.85)

    def test_records_of_shared_events(self):
        def draw(generator):
            z = generator.standard_normal((8, 1)) + generator.standard_normal((8, 3))
            capacity = np.exp(BETA * z.reshape(-1, 1) / np.sqrt(2.0))
            return (capacity <= LEVELS).astype(int), LEVELS, np.arange(24) // 3

        assert 0.85 < fraction_held("stripes", draw, 60)[0] < 0.95
        unaware = fraction_held("stripes", lambda g: (*draw(g)[:2], None), 60)
        assert unaware[0] < 0.83


class TestDesigns:
    def test_bisected_levels_say_what_the_grid_says(self):
        """Only the two runs next to the border of each record: nothing else was known."""
        full = table(np.random.default_rng(1), 24)
        border = np.argmax(np.hstack([full, np.ones((24, 1), int)]), axis=1)
        bisected = np.full(full.shape, 2)
        rows = np.arange(24)
        inside = border < LEVELS.size
        bisected[rows[inside], border[inside]] = 1
        bisected[rows[border > 0], border[border > 0] - 1] = 0
        one = quoted_band("stripes", full, LEVELS, IM)
        for design in ("ida", "two_stage"):
            other = quoted_band(design, bisected, LEVELS, IM)
            assert np.array_equal(one.band.lower, other.band.lower)
            assert one.theta == other.theta

    def test_shapes_and_words(self):
        verdict = table(np.random.default_rng(1), 24)
        verdict[0] = 3
        known = quoted_band("stripes", verdict, LEVELS, IM.reshape(5, 1))
        assert known.band.upper.shape == (5, 1)
        assert known.n_independent == 23.0
        assert known.curve.kind == "posterior"
        assert known.assumptions == (
            "Capacity is lognormal, and records and their capacities are independent."
        )
        at = np.tile(LEVELS, (24, 1))
        runs = quoted_band("scattered", verdict, at, 0.5)
        assert (runs.band.lower.shape, runs.n_independent) == ((), 23.0 * 15)
        assert "a motion of its own" in runs.assumptions

    @pytest.mark.parametrize(
        ("arguments", "kind", "sentence"),
        [
            (("cloud", [[0, 1]], [0.1, 0.2], 0.1), InputError, "design is 'cloud'"),
            (("scattered", [0, 1], [0.1], 0.1), InputError, r"intensity \(1,\)"),
            (("scattered", [2, 3], [0.1, 0.2], 0.1), FitError, "no run collapsed or stood"),
            (("stripes", [[0, 0], [0, 0]], [0.1, 0.2], 0.1), FitError, "add levels above 0.2"),
        ],
    )
    def test_refusals(self, arguments, kind, sentence):
        with pytest.raises(kind, match=sentence):
            quoted_band(*arguments)
        with pytest.raises(InputError, match="confidence is 2"):
            quoted_band("stripes", [[0, 1], [1, 1]], [0.1, 0.2], 0.1, confidence=2.0)


class TestEvents:
    def test_alike_records_are_worth_their_events(self):
        capacity = np.repeat(np.exp(BETA * np.random.default_rng(1).standard_normal(10)), 3)
        found = find_brackets((capacity[:, None] <= LEVELS) * 1, LEVELS, "count")
        assert independent_records(found, np.arange(30) // 3) == pytest.approx(10.0)
        assert independent_records(found, np.arange(30)) == 30.0
        assert independent_records(found, np.arange(30) % 10) > 15.0

    def test_sentence_names_what_rows_share(self):
        verdict = table(np.random.default_rng(1), 24)
        groups = np.arange(24) // 3
        events = quoted_band("stripes", verdict, LEVELS, IM, groups=groups)
        records = quoted_band("stripes", verdict, LEVELS, IM, groups=groups, unit="record")
        assert ", and events are independent, their 24 rows of runs worth" in events.assumptions
        assert ", and records are independent" in records.assumptions
        assert "event" not in records.assumptions
        assert records.theta == events.theta

    @pytest.mark.parametrize(
        ("groups", "kind", "sentence"),
        [([1] * 24, FitError, "one group, 1"), ([1, 2], InputError, r"shape \(2,\)")],
    )
    def test_impossible_groups(self, groups, kind, sentence):
        verdict = table(np.random.default_rng(1), 24)
        with pytest.raises(kind, match=sentence):
            quoted_band("stripes", verdict, LEVELS, IM, groups=groups)
        with pytest.raises(InputError, match="groups are of records"):
            quoted_band("scattered", verdict[0], LEVELS, IM, groups=groups)
