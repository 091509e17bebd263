"""The stochastic model, how its motions vary, the shipped ones, and their index."""

import numpy as np
import pygmm
import pytest

from archfrag.errors import InputError, RecordError
from archfrag.motions import synthetic
from archfrag.motions.index import load_index
from archfrag.motions.measures import integral, spectral_acceleration
from archfrag.motions.motion import STANDARD_GRAVITY, Motion
from archfrag.motions.read import load_motion
from archfrag.motions.synthetic import (
    Recipe,
    _generator,
    make_motion,
    plan_motions,
)
from archfrag.motions.synthetic import amplitude as source
from archfrag.motions.synthetic.amplitude import (
    COEFFICIENTS,
    FREQUENCIES,
    TERMS,
    draw_term,
)
from archfrag.motions.target import predict

from .helpers import SHIPPED, pga

PERIODS = np.array([0.1, 0.2, 0.5, 1.0, 2.0])
# Values that P. J. Stafford, first author of the model, released for checking (optimised form;
# distributed with the sources of pyRVT 0.8): amplitude [m/s] at 0.1, 1 and 10 Hz and duration
# [s] at a magnitude and Joyner-Boore distance [km].
AUTHORS = {
    (5.0, 100.0): (5.951679e-05, 3.627168e-03, 2.333459e-03, 11.04066),
    (6.0, 30.0): (4.824304e-03, 7.578799e-02, 3.702352e-02, 9.24816),
    (7.0, 10.0): (1.811731e-01, 5.452651e-01, 2.551431e-01, 12.96604),
}


def mean_term(seeds):
    """Mean over some seeds of the sum of terms that each motion has, at PERIODS."""
    drawn = [
        sum(draw_term(kind, _generator(kind, seed)) for kind, seed in zip(TERMS, each))
        for each in seeds
    ]
    return np.interp(np.log(1.0 / PERIODS), np.log(FREQUENCIES), np.mean(drawn, axis=0))


class TestModel:
    @pytest.mark.parametrize("scenario", AUTHORS)
    def test_spectrum_and_duration_are_the_authors(self, scenario):
        magnitude, surface = scenario
        top = max(2.673 - 1.136 * max(magnitude - 4.970, 0.0), 0.0) ** 2
        reach = np.hypot(top, surface)
        ours = source.fourier_amplitude((0.1, 1.0, 10.0), magnitude, reach)
        found = (*ours, source.ground_motion_duration(magnitude, reach))
        assert found == pytest.approx(AUTHORS[scenario], rel=1e-3)

    @pytest.mark.parametrize(
        ("recipe", "reason"),
        [
            (Recipe(2.0, 20.0, 1), r"magnitude = 2.0 is outside 3 to 8"),
            (
                Recipe(6.0, 20.0, 1, vs30=300.0),
                r"vs30 .m/s. = 300.0 is outside 450 to 1000",
            ),
            (Recipe(6.0, 20.0, -1), r"seed = -1 is outside 0 to 9"),
        ],
    )
    def test_outside_the_model(self, recipe, reason):
        with pytest.raises(InputError, match=reason):
            make_motion(recipe)

    def test_tables_are_those_of_the_supplements(self):
        """As pygmm has them."""
        theirs = pygmm.BaylessAbrahamson2018
        f = np.array([0.15, 0.4, 1.0, 2.5, 6.0, 15.0])
        assert source.correlation(f) == pytest.approx(theirs.corr(f), abs=0.005)
        for ours, name in {
            "tau": "tau",
            "phi_s2s": "phi_s2s",
            "phi_ss": "phi_s",
        }.items():
            published = np.interp(FREQUENCIES, theirs.FREQS, theirs.COEFF[name])
            assert COEFFICIENTS[ours] == pytest.approx(published, abs=1e-6)
        for magnitude, distance, vs30 in ((5.5, 60.0, 500.0), (7.5, 5.0, 760.0)):
            facts = {
                "mag": magnitude,
                "dist_rup": distance,
                "v_s30": vs30,
                "mechanism": "SS",
            }
            model = pygmm.GulerceAbrahamson2011(pygmm.Scenario(**facts, pga_ref=0.2))
            ratio = source.vertical_ratio(magnitude, distance, vs30, 0.2)
            # At 2 s the two read the bounds of Vs30 differently.
            assert ratio == pytest.approx(model.ratio[2:], rel=0.002)


def test_the_ground_is_at_rest_before_and_after():
    """That making them again gives the same bytes is in workflow/test_cli_records.py."""
    for recipe in synthetic.shipped_recipes()[::4]:
        motion = make_motion(recipe)
        speed = integral(motion.acceleration, motion.dt)
        place = np.cumsum(speed)
        assert not motion.acceleration[:100].any()
        assert abs(speed[-1]) < 1e-4 * np.abs(speed).max()
        assert abs(place[-1]) < 5e-3 * np.abs(place).max()


def test_the_shipped_suite_is_the_models_but_for_what_its_seeds_drew():
    """The 15 events and 30 sites of the suite happen to be strong: their terms are known."""
    seeds = []
    ratios = []
    for entry in load_index(SHIPPED):
        about = entry.metadata
        seeds.append([about[key] for key in ("event_seed", "site_seed", "seed")])
        facts = (about[key] for key in ("Mw", "distance_km", "Vs30_mps"))
        median = predict(tuple(facts), "CY14", PERIODS)[0]
        spectrum = spectral_acceleration(load_motion(entry), PERIODS) / STANDARD_GRAVITY
        ratios.append(np.log(spectrum) - median)
    found = np.exp(np.mean(ratios, axis=0) - mean_term(seeds))
    assert found == pytest.approx(1.0, abs=0.15)


HEADER = "id,file,sha256,Mw,dt_s,unit\n"


@pytest.mark.parametrize(
    ("content", "step", "reason"),
    [
        (
            lambda content: content[::-1],
            "0.01",
            r"sha256 is .*; the file has changed since",
        ),
        (bytes, "0.02", r"dt is 0.01 s, the index lists dt_s = 0.02 s$"),
    ],
)
def test_file_that_is_not_as_an_index_lists_it(tmp_path, content, step, reason):
    listed = load_index(SHIPPED)[0]
    row = f"a,a.mseed,{listed.sha256},5.5,{step},m/s2\n"
    (tmp_path / "index.csv").write_text(HEADER + row)
    with pytest.raises(RecordError, match=r"listed, but cannot be read \(No such file"):
        load_motion(load_index(tmp_path)[0])
    (tmp_path / "a.mseed").write_bytes(content(listed.path.read_bytes()))
    with pytest.raises(RecordError, match=reason):
        load_motion(load_index(tmp_path)[0])


class TestVariation:
    """The rows of records/README.md, with fewer seeds."""

    @pytest.mark.parametrize("kind", TERMS)
    def test_deviation_and_correlation_are_the_tables(self, kind):
        generator = np.random.default_rng(1)
        rows = np.array([draw_term(kind, generator) for _ in range(3000)])
        assert rows.std(axis=0) == pytest.approx(COEFFICIENTS[TERMS[kind]], rel=0.06)
        assert np.corrcoef(rows.T) == pytest.approx(
            source.correlation(FREQUENCIES), abs=0.08
        )

    def test_terms_are_common_where_seeds_are(self):
        def amplitudes(*seeds):
            """ln of the Fourier amplitude in bands a tenth of a decade wide, 0.5 to 10 Hz."""
            motion = make_motion(Recipe(6.0, 30.0, *seeds))
            power = np.abs(np.fft.rfft(motion.acceleration, 8192)) ** 2
            place = np.digitize(
                np.fft.rfftfreq(8192, motion.dt), np.geomspace(0.5, 10.0, 14)
            )
            return 0.5 * np.log([power[place == band].mean() for band in range(1, 14)])

        first = np.array([amplitudes(s) for s in range(80)])
        for event, site, low, high in (
            (500, 500, -0.15, 0.15),
            (0, 500, 0.2, 0.5),
            (500, 0, 0.15, 0.45),
            (0, 0, 0.5, 0.75),
        ):
            other = np.array(
                [amplitudes(s + 500, s + event, s + site) for s in range(80)]
            )
            found = [np.corrcoef(a, b)[0, 1] for a, b in zip(first.T, other.T)]
            assert low < np.mean(found) < high

    def test_scatter_is_the_published_total_and_leaves_the_median(self):
        varied, plain = (
            np.log(
                [
                    spectral_acceleration(
                        make_motion(Recipe(6.5, 20.0, seed, vary=vary)), PERIODS
                    )
                    for seed in range(300)
                ]
            )
            for vary in (True, False)
        )
        # Mean total of four models at M 6.5 and PERIODS; 0.1, and 0.06 for 300 seeds.
        published = np.array([0.66, 0.64, 0.66, 0.70, 0.70])
        assert varied.std(axis=0) == pytest.approx(published, abs=0.16)
        assert plain.std(axis=0).max() < 0.45
        left = (varied - plain).mean(axis=0) - mean_term(
            [(s, s, s) for s in range(300)]
        )
        assert np.exp(left) == pytest.approx(1.0, abs=0.07)


def test_vertical_ratio_is_the_models():
    made = [make_motion(Recipe(6.5, 20.0, seed, vertical=True)) for seed in range(150)]
    ratio = np.log(
        [
            spectral_acceleration(Motion(m.vertical, m.dt), PERIODS)
            / spectral_acceleration(m, PERIODS)
            for m in made
        ]
    )
    rock_pga = np.median([pga(m) for m in made]) / STANDARD_GRAVITY
    expected = source.vertical_ratio(6.5, 20.0, 760.0, rock_pga)
    expected = np.interp(PERIODS, source.RATIO["period_s"], expected)
    assert np.exp(ratio.mean(axis=0)) == pytest.approx(expected, rel=0.12)
    assert 0.3 < ratio.std(axis=0).min() < ratio.std(axis=0).max() < 0.65


def test_pulse_amplification_is_shahi_and_bakers_near_the_period():
    gains = []
    for seed in range(80):
        plain, pulse = (
            make_motion(Recipe(6.5, 5.0, seed, pulse=p)) for p in (False, True)
        )
        at = np.array([0.3, 0.88]) * pulse.metadata["pulse_period_s"]
        gains.append(
            spectral_acceleration(pulse, at) / spectral_acceleration(plain, at)
        )
    found = np.exp(np.log(gains).mean(axis=0))
    # Shahi and Baker (2011), T / Tp up to 0.88.
    apart = (np.log([0.3, 0.88]) + 0.127) ** 2
    amplification = np.exp(1.131 * np.exp(-3.11 * apart) + 0.058)
    assert found == pytest.approx(amplification, rel=0.2)


def test_seeds_of_events_and_sites():
    recipes = plan_motions(2, 3, [6.0], [10.0, 30.0], seed=4, sites=2)
    expected = [(0, 0, 0), (1, 0, 1), (2, 0, 0), (3, 1, 1), (4, 1, 0), (5, 1, 1)]
    assert [tuple(np.array(r[2:5]) - 4_000_000) for r in recipes] == expected
    assert [r.distance for r in recipes] == [10.0, 30.0] * 3


def test_drawn_values_lie_between_their_ends_and_follow_the_seed():
    recipes, again, others = (
        plan_motions(200, 2, [5.5, 7.5], [10.0, 100.0], True, True, seed, pulses=0.25)
        for seed in (1, 1, 2)
    )
    assert recipes == again != others
    distances = [r.distance for r in recipes]
    assert all(5.5 < r.magnitude < 7.5 for r in recipes)
    assert 10.0 < min(distances) < max(distances) < 100.0
    assert np.log(distances).mean() == pytest.approx(1.5 * np.log(10.0), abs=0.1)
    assert np.mean([r.pulse for r in recipes]) == pytest.approx(0.25, abs=0.08)
