"""The stochastic model, how its motions vary, the shipped ones, and their index."""

import itertools
import re

import numpy as np
import pygmm
import pytest

from archfrag.errors import InputError, OutputError, RecordError
from archfrag.motions import synthetic
from archfrag.motions.index import load_index
from archfrag.motions.measures import pga, pgv, significant_duration, spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.process import displacement, velocity
from archfrag.motions.read import load_motion
from archfrag.motions.selection import Rupture, predict
from archfrag.motions.synthetic import (
    Options,
    Plan,
    Seeds,
    make_motion,
    plan_motions,
    source,
)
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
from archfrag.motions.units import STANDARD_GRAVITY

from .helpers import SHIPPED


def rupture_distance(magnitude, surface_distance):
    """From the Joyner-Boore distance, as the authors' values are given [km]."""
    top = max(2.673 - 1.136 * max(magnitude - 4.970, 0.0), 0.0) ** 2
    return np.hypot(top, surface_distance)


# Values that P. J. Stafford, first author of the model, released for checking (optimised form;
# distributed with the sources of pyRVT 0.8): amplitude [m/s] at 0.1, 1 and 10 Hz and duration
# [s] at a magnitude and Joyner-Boore distance [km].
AUTHORS = {
    (5.0, 100.0): ((5.951679e-05, 3.627168e-03, 2.333459e-03), 11.04066),
    (6.0, 30.0): ((4.824304e-03, 7.578799e-02, 3.702352e-02), 9.24816),
    (7.0, 10.0): ((1.811731e-01, 5.452651e-01, 2.551431e-01), 12.96604),
}


class TestModel:
    @pytest.mark.parametrize("scenario", AUTHORS)
    def test_spectrum_and_duration_are_the_authors(self, scenario):
        amplitudes, duration = AUTHORS[scenario]
        reach = rupture_distance(*scenario)
        ours = source.fourier_amplitude((0.1, 1.0, 10.0), scenario[0], reach)
        assert ours == pytest.approx(amplitudes, rel=1e-3)
        assert source.ground_motion_duration(scenario[0], reach) == pytest.approx(
            duration, rel=1e-3
        )

    def test_path_duration_beyond_the_table(self):
        far = [source.ground_motion_duration(6.0, r) for r in (280.0, 290.0)]
        assert far[1] - far[0] == pytest.approx(0.156 * 10.0, rel=1e-9)

    def test_mean_amplitude_of_many_motions_is_the_target(self):
        # Above the low cut and away from the baseline, the mean square over seeds.
        power = 0.0
        for seed in range(200):
            motion = synthetic.make_motion(6.0, 20.0, seed, Options(vary=False))
            amplitude = np.abs(np.fft.rfft(motion.acceleration, 8192)) * motion.dt
            power = power + amplitude**2
        f = np.fft.rfftfreq(8192, 0.01)
        for low, high in ((0.4, 1.0), (1.0, 4.0), (4.0, 20.0)):
            band = (f > low) & (f < high)
            target = source.fourier_amplitude(f[band], 6.0, 20.0)
            target *= source.median_adjustment(f[band], 6.0, 20.0)
            assert np.mean(power[band] / 200 / target**2) == pytest.approx(1.0, abs=0.08)

    @pytest.mark.parametrize(
        ("arguments", "reason"),
        [
            ((2.0, 20.0, 1), r"magnitude = 2.0 is outside 3 to 8"),
            ((6.0, -1.0, 1), r"distance .km. = -1.0 is outside 0 to 300"),
            ((float("nan"), 20.0, 1), r"magnitude = nan is outside"),
            ((6.0, 20.0, 1, Options(dt=0.0)), r"time step 0.0 s must be above 0"),
            ((6.0, 20.0, 1, Options(vs30=300.0)), r"vs30 .m/s. = 300.0 is outside 450 to 1000"),
            ((6.0, 20.0, -1), r"seed -1 must be from 0 to 2\^63 - 1"),
        ],
    )
    def test_outside_the_model(self, arguments, reason):
        with pytest.raises(InputError, match=reason):
            synthetic.make_motion(*arguments)


class TestSuite:
    def test_every_shipped_file_is_listed(self):
        entries = load_index(SHIPPED)
        assert len(entries) >= 24
        files = {path.resolve() for path in (SHIPPED / "synthetic").iterdir()}
        assert {entry.path.resolve() for entry in entries} == files
        assert sum(path.stat().st_size for path in files) < 2_000_000
        magnitudes = {entry.metadata["Mw"] for entry in entries}
        distances = {entry.metadata["distance_km"] for entry in entries}
        assert (min(magnitudes), max(magnitudes)) == (5.5, 7.5)
        assert (min(distances), max(distances)) == (5.0, 100.0)
        assert [entry.metadata["seed"] for entry in entries] == list(range(20250101, 20250131))
        events = [entry.metadata["event_seed"] for entry in entries]
        assert sorted(set(events)) == list(range(20250101, 20250116))
        assert {events.count(event) for event in events} == {2}

    def test_making_again_gives_the_same_samples_and_index(self, tmp_path):
        paths = synthetic.make_suite(tmp_path)
        assert sorted(p.name for p in tmp_path.rglob("*") if p.is_file()) == sorted(
            [path.name for path in paths] + ["index.csv"]
        )
        again, shipped = load_index(tmp_path), load_index(SHIPPED)
        for ours, theirs in zip(again, shipped, strict=True):
            assert (ours.id, ours.metadata) == (theirs.id, theirs.metadata)
            assert np.array_equal(load_motion(ours).acceleration, load_motion(theirs).acceleration)

    def test_motions_start_and_end_at_rest(self):
        for entry in load_index(SHIPPED):
            motion = load_motion(entry)
            assert not motion.acceleration[:100].any()
            assert not motion.acceleration[-100:].any()
            speed, place = velocity(motion), displacement(motion)
            assert abs(speed[-1]) < 1e-4 * np.abs(speed).max()
            assert abs(place[-1]) < 5e-3 * np.abs(place).max()
            assert 20.0 < motion.duration < 80.0
            assert 1.0 < significant_duration(motion) < 40.0
            assert 0.05 < pga(motion) < 10.0

    def test_folder_that_cannot_be_made(self, tmp_path):
        (tmp_path / "file").touch()
        with pytest.raises(OutputError, match=r"cannot be written"):
            synthetic.make_suite(tmp_path / "file")


class TestIndex:
    HEADER = "id,file,sha256,Mw,dt_s,unit\n"

    def write(self, folder, *rows, header=HEADER):
        (folder / "index.csv").write_text(header + "".join(f"{row}\n" for row in rows))
        return folder / "index.csv"

    @pytest.mark.parametrize(
        ("rows", "header", "reason"),
        [
            (["a,f,,6,0.01,g"], "id,file,unit_of\n", r"column 'unit' is missing from the index$"),
            ([",f,,6,0.01,g"], HEADER, r"line 2: id is empty$"),
            (["a,f,,6,0.01,ft"], HEADER, r"line 2: unknown unit 'ft' of acceleration"),
            (["a,f,,big,0.01,g"], HEADER, r"line 2: Mw = 'big' is not a number$"),
            (["a,f,,nan,0.01,g"], HEADER, r"line 2: Mw = 'nan' is not a finite number$"),
            (["a,f,,6,,g", "a,h,,6,,g"], HEADER, r"line 3: id 'a' occurs twice$"),
        ],
    )
    def test_bad_row(self, tmp_path, rows, header, reason):
        path = self.write(tmp_path, *rows, header=header)
        with pytest.raises(RecordError, match=reason) as caught:
            load_index(path)
        assert str(path) in str(caught.value)

    @pytest.mark.parametrize(
        ("change", "reason"),
        [
            ("content", r"sha256 is .*; the file has changed since it was listed$"),
            ("gone", r"listed in the index but cannot be read \(No such file"),
            ("step", r"the index lists dt_s = 0.02 s, the file has 0.01 s$"),
        ],
    )
    def test_file_that_is_not_as_listed(self, tmp_path, change, reason):
        source = load_index(SHIPPED)[0]
        copy = tmp_path / "a.mseed"
        copy.write_bytes(source.path.read_bytes())
        step = "0.02" if change == "step" else "0.01"
        self.write(tmp_path, f"a,a.mseed,{source.sha256},5.5,{step},m/s2")
        if change == "content":
            copy.write_bytes(copy.read_bytes()[::-1])
        elif change == "gone":
            copy.unlink()
        with pytest.raises(RecordError, match=reason):
            load_motion(load_index(tmp_path)[0])


class TestMedian:
    @pytest.mark.parametrize("magnitude", [5.5, 6.5, 7.5])
    def test_nearer_is_stronger(self, magnitude):
        def peaks(distance):
            made = [make_motion(magnitude, distance, s, Options(vary=False)) for s in range(5)]
            return np.exp(np.mean([np.log(pga(motion)) for motion in made]))

        found = [peaks(distance) for distance in (5.0, 10.0, 20.0, 40.0, 100.0)]
        assert all(near > 1.2 * far for near, far in itertools.pairwise(found))

    @pytest.mark.parametrize("model", ["CY14", "ASK14"])
    def test_the_shipped_suite_is_the_models_but_for_what_its_seeds_drew(self, model):
        """The 15 events and 30 sites of the suite happen to be strong: their terms are known."""
        drawn, ratios = [], []
        for entry in load_index(SHIPPED):
            seeds = {"event": "event_seed", "site": "site_seed", "record": "seed"}
            terms = sum(draw_term(kind, _generator(kind, entry.metadata[key]))
                        for kind, key in seeds.items())  # fmt: skip
            drawn.append(np.interp(np.log(1.0 / PERIODS), np.log(frequencies()), terms))
            facts = (entry.metadata[key] for key in ("Mw", "distance_km", "Vs30_mps"))
            median = predict(Rupture(*facts, region="california"), model, PERIODS).ln_median
            spectrum = spectral_acceleration(load_motion(entry), PERIODS) / STANDARD_GRAVITY
            ratios.append(np.log(spectrum) - median)
        found = np.exp(np.mean(np.array(ratios) - drawn, axis=0))
        assert found == pytest.approx(1.0, abs=0.15)


class TestReadme:
    """The tables of records/README.md, against pygmm's ground-motion models."""

    def test_ratios_in_the_readme_agree_with_the_table_of_motions(self):
        rows = [line.split(",") for line in (SHIPPED / "spectra.csv").read_text().splitlines()[1:]]
        readme = (SHIPPED / "README.md").read_text(encoding="utf-8")
        found = re.search(r"^\| all \| 30 \|(.*)\|$", readme, re.MULTILINE)
        expected = [float(cell) for cell in found.group(1).split("|")]
        computed = []
        for model in ("CY14", "ASK14", "BSSA14"):
            table = np.array([[float(x) for x in row[2:]] for row in rows if row[1] == model])
            assert len(table) == 30
            computed.extend(np.exp(np.log(table).mean(axis=0)))
        assert expected == pytest.approx(computed, abs=0.006)


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
        theirs = pygmm.BaylessAbrahamson2018
        f = np.array([0.15, 0.4, 1.0, 2.5, 6.0, 15.0])
        assert correlation(f) == pytest.approx(theirs.corr(f), abs=0.005)
        for ours, name in {"tau": "tau", "phi_s2s": "phi_s2s", "phi_ss": "phi_s"}.items():
            published = np.interp(frequencies(), theirs.FREQS, theirs.COEFF[name])
            assert table()[ours] == pytest.approx(published, abs=1e-6)

    def test_vertical_ratio(self):
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

    def test_terms_are_common_where_seeds_are(self):
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


class TestScatter:
    """The rows of records/README.md, with fewer seeds."""

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
        plan = Plan(60, 2, [5.5, 6.0, 6.5, 7.0, 7.5], [10.0, 30.0, 100.0])
        motions = [recipe.make() for recipe in plan_motions(plan)]
        assert np.std([np.log(pgv(m) / pga(m)) for m in motions], ddof=1) > 0.45


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


class TestPlan:
    def test_seeds_of_events_and_sites(self):
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
        recipes = plan_motions(Plan(1, 2, [6.0], [20.0], vertical=True))
        synthetic.make_suite(tmp_path, recipes)
        for entry, recipe in zip(load_index(tmp_path), recipes, strict=True):
            read, made = load_motion(entry), recipe.make()
            assert read.id == recipe.id
            assert entry.metadata["event_seed"] == recipe.seeds.event
            assert np.array_equal(read.acceleration, made.acceleration)
            assert np.array_equal(read.vertical, made.vertical)
