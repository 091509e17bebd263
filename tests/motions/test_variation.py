"""How synthetic motions vary, their verticals and pulses, beside the published models."""

import numpy as np
import pytest

from archfrag.motions import synthetic
from archfrag.motions.measures import pga, pgv, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.process import displacement, velocity
from archfrag.motions.synthetic import Options, Plan, Seeds, make_motion, plan_motions
from archfrag.motions.synthetic import pulse as pulses
from archfrag.motions.synthetic import vertical as verticals
from archfrag.motions.synthetic.motion import _amplitude, _generator
from archfrag.motions.synthetic.source import table
from archfrag.motions.synthetic.variation import (
    TERMS,
    correlation,
    draw_term,
    frequencies,
    grid,
    power_fractions,
)

PERIODS = np.array([0.1, 0.2, 0.5, 1.0, 2.0])


def spectra(seeds, options=None, magnitude=6.5, distance=20.0):
    return np.log(
        [
            spectral_acceleration(make_motion(magnitude, distance, seed, options), PERIODS)
            for seed in seeds
        ]
    )


def amplitudes(motion):
    """ln of the Fourier amplitude in bands a tenth of a decade wide, 0.5 to 10 Hz."""
    power = np.abs(np.fft.rfft(motion.acceleration, 8192)) ** 2
    place = np.digitize(np.fft.rfftfreq(8192, motion.dt), np.geomspace(0.5, 10.0, 14))
    return 0.5 * np.log([power[place == band].mean() for band in range(1, 14)])


class TestTables:
    """Against pygmm's copies of the electronic supplements."""

    def test_correlation_and_deviations(self):
        pygmm = pytest.importorskip("pygmm", reason="pygmm is not installed")
        theirs = pygmm.BaylessAbrahamson2018
        f = np.array([0.15, 0.4, 1.0, 2.5, 6.0, 15.0])
        assert correlation(f) == pytest.approx(theirs.corr(f), abs=0.005)
        for ours, name in {"tau": "tau", "phi_s2s": "phi_s2s", "phi_ss": "phi_s"}.items():
            published = np.interp(frequencies(), theirs.FREQS, theirs.COEFF[name])
            assert table()[ours] == pytest.approx(published, abs=1e-6)

    def test_vertical_ratio(self):
        pygmm = pytest.importorskip("pygmm", reason="pygmm is not installed")
        for magnitude, distance, vs30 in ((5.5, 60.0, 500.0), (7.5, 5.0, 760.0)):
            scenario = pygmm.Scenario(
                mag=magnitude, dist_rup=distance, v_s30=vs30, mechanism="SS", pga_ref=0.2
            )
            theirs = pygmm.GulerceAbrahamson2011(scenario).ratio[2:]
            ours = verticals.vertical_ratio(magnitude, distance, vs30, 0.2)
            # At 2 s the two read the bounds of Vs30 differently.
            assert ours == pytest.approx(theirs, rel=0.002)


class TestTerms:
    @pytest.mark.parametrize("kind", TERMS)
    def test_deviation_and_correlation_are_the_tables(self, kind):
        generator = np.random.default_rng(1)
        rows = np.array([draw_term(kind, generator) for _ in range(3000)])
        assert rows.std(axis=0) == pytest.approx(table()[TERMS[kind]], rel=0.06)
        found = np.corrcoef(rows.T)
        assert found == pytest.approx(correlation(frequencies()), abs=0.08)

    def test_motions_share_what_their_seeds_share(self):
        def correlated(pairs):
            rows = [[amplitudes(make_motion(6.0, 30.0, s)) for s in pair] for pair in pairs]
            first, second = np.array(rows).transpose(1, 0, 2)
            columns = zip(first.T, second.T, strict=True)
            return np.mean([np.corrcoef(a, b)[0, 1] for a, b in columns])

        n = range(120)
        event = correlated([(Seeds(s, s, s), Seeds(s + 500, s, s + 500)) for s in n])
        site = correlated([(Seeds(s, s, s), Seeds(s + 500, s + 500, s)) for s in n])
        both = correlated([(Seeds(s, s, s), Seeds(s + 500, s, s)) for s in n])
        none = correlated([(Seeds(s, s, s), Seeds(s + 500, s + 500, s + 500)) for s in n])
        assert abs(none) < 0.15
        assert 0.2 < event < 0.5
        assert 0.15 < site < 0.45
        assert 0.5 < both < 0.75


class TestSpectra:
    """The rows of tests/benchmarks/run_scatter.py, with fewer seeds."""

    def test_scatter_is_the_published_total(self):
        # Mean total of four models at M 6.5 and PERIODS; 0.1, and 0.06 for 300 seeds.
        published = np.array([0.66, 0.64, 0.66, 0.70, 0.70])
        found = spectra(range(300)).std(axis=0)
        assert found == pytest.approx(published, abs=0.16)
        assert spectra(range(60), Options(vary=False)).std(axis=0).max() < 0.45

    def test_variation_leaves_the_median(self):
        varied = spectra(range(300))
        plain = spectra(range(300), Options(vary=False))
        terms = sum(
            np.mean([draw_term(k, _generator(k, s)) for s in range(300)], axis=0) for k in TERMS
        )
        sample = np.interp(np.log(1.0 / PERIODS), np.log(frequencies()), terms)
        assert np.exp((varied - plain).mean(axis=0) - sample) == pytest.approx(1.0, abs=0.07)

    def test_scaled_to_pga_velocities_still_vary(self):
        plan = Plan(60, 2, [5.5, 7.5], [10.0, 100.0], True, True)
        motions = [recipe.make() for recipe in plan_motions(plan)]
        assert np.std([np.log(pgv(m) / pga(m)) for m in motions], ddof=1) > 0.45

    def test_vs30_changes_amplitudes_as_published(self):
        soft, rock = (amplitudes(make_motion(6.0, 30.0, 3, Options(vs30=v))) for v in (500, 760))
        f = np.sqrt(np.geomspace(0.5, 10.0, 14)[1:] * np.geomspace(0.5, 10.0, 14)[:-1])
        slope = np.interp(f, frequencies(), table()["c8"])
        # The correction of the median follows the spectrum a little.
        assert soft - rock == pytest.approx(slope * np.log(500 / 760), abs=0.05)


class TestVertical:
    def test_ratio_is_the_models(self):
        made = [make_motion(6.5, 20.0, seed, Options(vertical=True)) for seed in range(150)]
        ratio = np.log(
            [
                spectral_acceleration(Motion(m.vertical, m.dt), PERIODS)
                / spectral_acceleration(m, PERIODS)
                for m in made
            ]
        )
        amplitude = _amplitude(grid(), 6.5, 20.0, 760.0)
        rock_pga = verticals._expected_peak(amplitude, 6.5, 20.0) / 9.80665
        assert rock_pga == pytest.approx(np.median([pga(m) for m in made]) / 9.80665, rel=0.2)
        wanted = verticals.vertical_ratio(6.5, 20.0, 760.0, rock_pga)
        wanted = np.interp(PERIODS, verticals.vertical_periods(), wanted)
        assert np.exp(ratio.mean(axis=0)) == pytest.approx(wanted, rel=0.12)
        assert 0.3 < ratio.std(axis=0).min() < ratio.std(axis=0).max() < 0.65

    def test_factor_gives_mean_squares_of_oscillators_the_ratio(self):
        amplitude = _amplitude(grid(), 7.0, 10.0, 760.0)
        factor = verticals.vertical_factor(amplitude, 7.0, 10.0, 760.0)
        gain = np.exp(2.0 * np.interp(np.log(grid()), np.log(frequencies()), factor))
        periods = np.array([0.05, 0.075, 0.1, 0.15, 0.2, 0.5])
        found = np.sqrt(power_fractions(amplitude, periods) @ gain)
        rock_pga = verticals._expected_peak(amplitude, 7.0, 10.0) / 9.80665
        wanted = verticals.vertical_ratio(7.0, 10.0, 760.0, rock_pga)
        places = np.interp(periods, verticals.vertical_periods(), wanted)
        assert found == pytest.approx(places, rel=0.04)

    def test_horizontal_stays(self):
        alone, both = (make_motion(6.0, 20.0, 4, Options(vertical=v)) for v in (False, True))
        assert np.array_equal(alone.acceleration, both.acceleration)
        assert alone.vertical is None


class TestPulse:
    def test_wavelet_is_the_derivative_of_its_velocity(self):
        time = np.linspace(-3.0, 3.0, 6001)
        velocity = np.cumsum(pulses.wavelet(time, 2.0, 0.7)) * 1e-3
        form = 0.5 * (1.0 + np.cos(np.pi * time / 2.0)) * np.cos(np.pi * time + 0.7)
        form[np.abs(time) > 2.0] = 0.0
        assert velocity == pytest.approx(form, abs=5e-3)

    def test_period_follows_magnitude(self):
        drawn = np.log(
            [pulses.draw_period(7.0, np.random.default_rng(seed)) for seed in range(2000)]
        )
        assert drawn.mean() == pytest.approx(-5.73 + 0.99 * 7.0, abs=0.04)
        assert drawn.std() == pytest.approx(0.56, abs=0.03)

    def test_amplification_is_shahi_and_bakers_near_the_period(self):
        gains = []
        for seed in range(80):
            plain, pulse = (make_motion(6.5, 5.0, seed, Options(pulse=p)) for p in (False, True))
            at = np.array([0.3, 0.88]) * pulse.metadata["pulse_period_s"]
            gains.append(spectral_acceleration(pulse, at) / spectral_acceleration(plain, at))
        found = np.exp(np.log(gains).mean(axis=0))
        assert found == pytest.approx(pulses.amplification([0.3, 0.88]), rel=0.2)

    def test_ends_at_rest(self):
        motion = make_motion(7.0, 5.0, 1, Options(pulse=True))
        speed, place = velocity(motion), displacement(motion)
        assert abs(speed[-1]) < 1e-4 * np.abs(speed).max()
        assert abs(place[-1]) < 5e-3 * np.abs(place).max()


class TestPlan:
    def test_seeds_say_who_shares_an_event_and_a_site(self):
        recipes = plan_motions(Plan(2, 3, [6.0], [10.0, 30.0], seed=4, sites=2))
        assert [r.seeds.event - 4_000_000 for r in recipes] == [0, 0, 0, 1, 1, 1]
        assert [r.seeds.site - 4_000_000 for r in recipes] == [0, 1, 0, 1, 0, 1]
        assert [r.seeds.record - 4_000_000 for r in recipes] == list(range(6))
        assert [r.distance for r in recipes] == [10.0, 30.0] * 3

    def test_drawn_values_lie_between_their_ends_and_follow_the_seed(self):
        def drawn(seed):
            plan = Plan(200, 2, [5.5, 7.5], [10.0, 100.0], True, True, seed, pulses=0.25)
            return plan_motions(plan)

        recipes = drawn(1)
        assert recipes == drawn(1)
        assert recipes != drawn(2)
        magnitudes = [r.magnitude for r in recipes]
        distances = [r.distance for r in recipes]
        assert 5.5 < min(magnitudes) < max(magnitudes) < 7.5
        assert 10.0 < min(distances) < max(distances) < 100.0
        assert np.log(distances).mean() == pytest.approx(np.log(10.0) + np.log(10.0) / 2, abs=0.1)
        assert np.mean([r.options.pulse for r in recipes]) == pytest.approx(0.25, abs=0.08)

    def test_folder_of_a_plan_reads_back(self, tmp_path):
        from archfrag.motions.index import load_index
        from archfrag.motions.read import load_motion

        recipes = plan_motions(Plan(1, 2, [6.0], [20.0], vertical=True))
        synthetic.make_suite(tmp_path, recipes)
        for entry, recipe in zip(load_index(tmp_path), recipes, strict=True):
            read, made = load_motion(entry), recipe.make()
            assert read.id == recipe.id
            assert entry.metadata["event_seed"] == recipe.seeds.event
            assert np.array_equal(read.acceleration, made.acceleration)
            assert np.array_equal(read.vertical, made.vertical)
