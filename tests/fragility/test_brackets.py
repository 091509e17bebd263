"""Capacities in brackets: the border of a record, censored likelihood, Student's t."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2, norm, t

from archfrag.errors import FitError, InputError
from archfrag.fragility.bands import beta_interval, capacity_band, theta_interval
from archfrag.fragility.brackets import RULES, fill_verdicts, find_brackets, midpoints
from archfrag.fragility.capacities import fit_brackets, fit_moments
from archfrag.fragility.fit import fit_ida, fit_stripes

LEVELS = np.array([0.2, 0.3, 0.4, 0.5, 0.7])
TENTHS = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
INF = np.inf


def bracketed(n, levels, seed, theta=0.4, beta=0.5):
    capacity = theta * np.exp(beta * np.random.default_rng(seed).standard_normal(n))
    place = np.searchsorted(levels, capacity)
    return np.append(0.0, levels)[place], np.append(levels, INF)[place]


class TestBracketsOfRecords:
    @pytest.mark.parametrize(
        ("row", "count", "first"),
        [
            ([0, 0, 1, 1, 1], (0.3, 0.4), (0.3, 0.4)),
            ([1, 1, 1, 1, 1], (0.0, 0.2), (0.0, 0.2)),
            ([0, 0, 0, 0, 0], (0.7, INF), (0.7, INF)),
            ([0, 1, 0, 1, 1], (0.3, 0.4), (0.2, 0.3)),
            ([0, 2, 3, 1, 1], (0.2, 0.5), (0.2, 0.5)),
            ([0, 1, 2, 0, 1], (0.3, 0.5), (0.2, 0.3)),
        ],
    )
    def test_border(self, row, count, first):
        for rule, expected in (("count", count), ("first", first)):
            found = find_brackets([row], LEVELS, rule)
            assert (found.lower[0], found.upper[0]) == expected

    def test_islands_are_counted_and_undecided_records_left_out(self):
        table = [[0, 0, 1, 1, 1], [2, 3, 2, 2, 2], [0, 1, 0, 1, 1], [1, 0, 0, 0, 0]]
        assert np.flatnonzero(find_brackets(table, LEVELS, "count").decided).tolist() == [0, 2, 3]
        assert find_brackets(table, LEVELS, "count").known().lower.size == 3
        assert find_brackets(table, LEVELS, "first").contradictions.sum() == 0 + 1 + 4
        assert find_brackets(table, LEVELS, "count").contradictions.sum() == 0 + 2 + 2

    def test_count_keeps_the_collapses_of_each_record(self):
        table = np.random.default_rng(1).integers(0, 2, (40, 5))
        found = find_brackets(table, LEVELS, "count")
        assert np.array_equal((found.upper[:, None] <= LEVELS).sum(1), table.sum(1))

    def test_order_of_levels_does_not_matter(self):
        table = np.random.default_rng(1).integers(0, 3, (40, 5))
        order = np.array([3, 0, 4, 1, 2])
        for rule in RULES:
            a, b = (find_brackets(table[:, i], LEVELS[i], rule) for i in (np.arange(5), order))
            assert np.array_equal(a.lower, b.lower)
            assert np.array_equal(a.upper, b.upper)

    @pytest.mark.parametrize(
        ("verdict", "levels", "rule", "sentence"),
        [
            ([[0, 1]], [0.1, 0.2], "last", "rule is 'last'"),
            ([[0, 1]], [0.1], "count", r"levels have shape \(1,\)"),
            ([[0, 1]], [0.1, 0.0], "count", "positive finite"),
            ([0, 1], [0.1, 0.2], "count", "n_record"),
            ([[0, 7]], [0.1, 0.2], "count", "verdict holds 7"),
        ],
    )
    def test_impossible_tables(self, verdict, levels, rule, sentence):
        with pytest.raises(InputError, match=sentence):
            find_brackets(verdict, levels, rule)

    def test_no_decided_run(self):
        with pytest.raises(FitError, match="no run collapsed or stood"):
            find_brackets([[2, 3]], [0.1, 0.2]).known()


class TestIslandsAndGaps:
    def test_rules_differ_at_islands_only(self):
        verdict = [[0, 0, 1, 1, 1], [0, 1, 0, 0, 1], [0, 0, 0, 0, 0], [1, 1, 1, 1, 1]]
        fewest, first = find_brackets(verdict, TENTHS), find_brackets(verdict, TENTHS, "first")
        assert fewest.lower.tolist() == [0.2, 0.4, 0.5, 0.0]
        assert fewest.upper.tolist() == [0.3, 0.5, np.inf, 0.1]
        assert fewest.contradictions.tolist() == [0, 1, 0, 0]
        assert first.lower.tolist() == [0.2, 0.1, 0.5, 0.0]
        assert first.contradictions.tolist() == [0, 2, 0, 0]
        assert fewest.middle[0] == pytest.approx(np.sqrt(0.06))
        assert np.isnan(fewest.middle[2:]).all()

    def test_cells_that_decide_nothing_widen_the_bracket(self):
        found = find_brackets([[0, 4, 2, 1, 4], [4, 4, 4, 4, 3]], TENTHS)
        assert (found.lower[0], found.upper[0]) == (0.1, 0.4)
        assert (found.lower[1], found.upper[1], found.decided[1]) == (0.0, np.inf, 0)

    def test_bisected_grid_is_filled_to_the_grid_it_stands_for(self):
        generator = np.random.default_rng(1)
        capacity = generator.uniform(0.05, 0.6, 40)
        whole = (capacity[:, None] <= TENTHS).astype(int)
        bisected = np.full(whole.shape, 4)
        for row, cells in zip(whole, bisected, strict=True):
            low, high = -1, TENTHS.size
            while high - low > 1:
                middle = (low + high) // 2
                cells[middle] = row[middle]
                low, high = (low, middle) if row[middle] else (middle, high)
        assert np.count_nonzero(bisected == 4) > 50
        assert np.array_equal(fill_verdicts(bisected), whole)

    def test_levels_of_each_record(self):
        table = np.random.default_rng(1).integers(0, 3, (40, 5))
        scale = np.linspace(0.5, 2.0, 40)
        for rule in RULES:
            own = find_brackets(table, LEVELS * scale[:, None], rule)
            same = find_brackets(table, LEVELS, rule)
            assert own.lower == pytest.approx(same.lower * scale)
            assert np.array_equal(own.contradictions, same.contradictions)


class TestCensoredLikelihood:
    """The estimate is where an independently written likelihood is largest."""

    @pytest.mark.parametrize("seed", range(5))
    def test_against_a_search(self, seed):
        lower, upper = bracketed(25, LEVELS, seed)
        lower[:3] = upper[:3] = [0.33, 0.41, 0.55]

        def loss(p):
            z_low = (np.log(np.maximum(lower, 1e-300)) - p[0]) / np.exp(p[1])
            z_high = (np.log(upper) - p[0]) / np.exp(p[1])
            with np.errstate(divide="ignore"):
                inside = np.log(norm.cdf(z_high) - norm.cdf(z_low))
            known = norm.logpdf(z_low) - p[1]
            return -np.where(lower == upper, known, inside).sum()

        fit = fit_brackets(lower, upper)
        found = minimize(
            loss, [-0.9, -0.7], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}
        )
        assert np.log(fit.theta) == pytest.approx(found.x[0], abs=1e-6)
        assert fit.beta == pytest.approx(np.exp(found.x[1]), rel=1e-6)
        assert fit.log_likelihood == pytest.approx(-found.fun, abs=1e-9)
        assert (fit.kind, fit.n_total) == ("brackets", 25)
        h, point = 1e-4, np.array([np.log(fit.theta), np.log(fit.beta)])
        steps = h * np.eye(2)
        hessian = np.array([
            [(loss(point + i + j) - loss(point + i - j) - loss(point - i + j)
              + loss(point - i - j)) / (4 * h * h) for i in steps] for j in steps
        ])  # fmt: skip
        scale = np.diag([1.0, fit.beta])
        assert fit.covariance == pytest.approx(scale @ np.linalg.inv(hessian) @ scale, rel=1e-4)

    def test_levels_as_brackets_of_runs_of_their_own(self):
        """A run that collapsed lies in (0, im], one that stood in (im, inf): a stripe."""
        im, collapses, n = np.array([0.2, 0.4, 0.6]), np.array([2, 5, 9]), 10
        lower = np.concatenate([np.r_[np.zeros(k), np.full(n - k, x)]
                                for x, k in zip(im, collapses, strict=True)])  # fmt: skip
        upper = np.concatenate([np.r_[np.full(k, x), np.full(n - k, INF)]
                                for x, k in zip(im, collapses, strict=True)])  # fmt: skip
        stripes = fit_stripes(im, collapses, n)
        with pytest.raises(FitError, match="bracketed from both sides"):
            fit_brackets(lower, upper)
        fit = fit_brackets(np.r_[lower, stripes.theta], np.r_[upper, stripes.theta * 1e3])
        assert fit.theta == pytest.approx(stripes.theta, rel=0.1)

    def test_narrow_brackets_are_capacities(self):
        capacity = np.random.default_rng(8).lognormal(0.0, 0.4, 30)
        exact = fit_brackets(capacity, capacity)
        moments = fit_moments(capacity)
        assert exact.theta == pytest.approx(moments.theta, rel=1e-12)
        assert exact.beta == pytest.approx(moments.beta * np.sqrt(29 / 30), rel=1e-10)
        for width in (1e-3, 1e-5, 1e-9):
            near = fit_brackets(capacity * np.exp(-width / 2), capacity * np.exp(width / 2))
            assert near.beta == pytest.approx(exact.beta, rel=1e-5)
            assert near.log_likelihood == pytest.approx(
                exact.log_likelihood + 30 * np.log(width), abs=1e-4
            )

    def test_unit_of_intensity(self):
        lower, upper = bracketed(30, LEVELS, 3)
        a, b = fit_brackets(lower, upper), fit_brackets(9.80665 * lower, 9.80665 * upper)
        assert b.theta == pytest.approx(9.80665 * a.theta, rel=1e-12)
        assert b.covariance == pytest.approx(a.covariance, rel=1e-10)

    def test_midpoints(self):
        assert midpoints([0.2, 0.0, 0.8], [0.8, 0.5, INF]) == pytest.approx([0.4])

    @pytest.mark.parametrize(
        ("lower", "upper", "kind", "sentence"),
        [
            ([0.3, 0.3], [0.4, 0.4], FitError, "between 0.3 and 0.4 would agree with all 2"),
            ([0.3, 0.2], [0.4, 0.3], FitError, "between 0.3 and 0.3 would agree"),
            ([0.0, 0.5], [0.2, INF], FitError, "bracketed from both sides"),
            ([0.3, 0.5], [0.2, 0.6], InputError, "from 0.3 to 0.2 cannot be"),
            ([0.0], [INF], InputError, "from 0 to inf cannot be"),
            ([INF], [INF], InputError, "from inf to inf cannot be"),
            ([np.nan], [1.0], InputError, "from nan to 1 cannot be"),
            ([0.1, 0.2], [1.0], InputError, r"upper \(1,\)"),
        ],
    )
    def test_brackets_without_a_curve(self, lower, upper, kind, sentence):
        with pytest.raises(kind, match=sentence):
            fit_brackets(lower, upper)


class TestStudentsT:
    CAPACITY = np.random.default_rng(4).lognormal(-0.5, 0.4, 12)

    def test_band_is_the_formula_inverted(self):
        """At the ends of the band of ln IM at z, the band of probability ends at Phi(z)."""
        fit = fit_moments(self.CAPACITY)
        n, s, z = 12, fit.beta, np.linspace(-2.0, 2.0, 9)
        reach = t.ppf(0.95, n - 1) * s * np.sqrt(1.0 / n + z**2 / (2.0 * (n - 1)))
        middle = np.log(fit.theta) + z * s
        assert capacity_band(fit, np.exp(middle - reach)).upper == pytest.approx(norm.cdf(z))
        assert capacity_band(fit, np.exp(middle + reach)).lower == pytest.approx(norm.cdf(z))

    def test_intervals_are_those_of_a_normal_sample(self):
        fit = fit_ida(self.CAPACITY)
        reach = t.ppf(0.95, 11) * fit.beta / np.sqrt(12)
        assert np.log(theta_interval(fit)) == pytest.approx(
            [np.log(fit.theta) - reach, np.log(fit.theta) + reach]
        )
        assert beta_interval(fit) == pytest.approx(
            fit.beta * np.sqrt(11 / chi2.ppf([0.95, 0.05], 11))
        )

    def test_narrow_brackets_give_nearly_the_same(self):
        fit = fit_brackets(0.999 * self.CAPACITY, 1.001 * self.CAPACITY)
        exact = fit_moments(self.CAPACITY)
        im = np.array([0.3, 0.6, 1.1])
        assert capacity_band(fit, im).lower == pytest.approx(
            capacity_band(exact, im).lower, abs=1e-3
        )
        assert beta_interval(fit) == pytest.approx(beta_interval(exact), rel=1e-3)

    @pytest.mark.parametrize("n", [2, 3, 12])
    def test_rises_within_0_and_1(self, n):
        im = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 200), [INF]])
        band = capacity_band(fit_moments(self.CAPACITY[:n]), im)
        for end in (band.lower, band.upper):
            assert np.all(np.diff(end) >= 0.0)
            assert (end[0], end[-1]) == (0.0, 1.0)
        assert np.all(band.lower <= band.upper)

    def test_needs_capacities(self):
        with pytest.raises(InputError, match="'stripes'; Student's t needs capacities"):
            capacity_band(fit_stripes([0.2, 0.4, 0.6], [1, 4, 9], 10), 0.5)
