"""Records selected to a target, from candidates that the tests draw themselves."""

import time

import numpy as np
import pandas as pd
import pytest

from archfrag.errors import InputError, OutputError, RecordError
from archfrag.motions.index import load_index
from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.motion import Motion
from archfrag.motions.read import load_motion
from archfrag.motions.scale import scale_factor
from archfrag.motions.selection import (
    Rupture,
    conditional_spectrum,
    correlation,
    predict,
    screen,
    select_records,
    spectrum_target,
)
from archfrag.motions.units import STANDARD_GRAVITY

from .helpers import at2_text

PERIODS = np.sort(np.append(np.geomspace(0.05, 5.0, 19), 1.0))
TARGET = conditional_spectrum(Rupture(7.0, 15.0, 500.0), 0.4, 1.0, PERIODS)


def flatfile(count, seed=0, periods=PERIODS):
    """Made-up records: spectra about CY14 with the published correlation, M, R and Vs30 drawn."""
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(correlation(periods[:, None], periods))
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    rows = []
    for number in range(count):
        rupture = Rupture(rng.uniform(5.5, 7.5), 10.0 ** rng.uniform(1, 2), rng.uniform(250, 800))
        median, sd, _ = predict(rupture, "CY14", periods)
        sa = np.exp(median + sd * (root @ rng.standard_normal(periods.size)))
        facts = {
            "record": f"R{number:04d}", "file": f"{number:04d}.AT2",
            "event": f"E{rng.integers(60)}", "station": f"S{number // 2}",
            "magnitude": rupture.magnitude, "distance_km": rupture.distance_km,
            "vs30_mps": rupture.vs30_mps, "pulse": bool(rng.random() < 0.1),
        }  # fmt: skip
        rows.append(facts | {f"T{t:.6f}S": value for t, value in zip(periods, sa)})
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def thousand():
    return flatfile(1000)


class TestRecovery:
    @pytest.mark.parametrize("seed", [1, 2, 3])
    def test_conditional_spectrum(self, thousand, seed):
        started = time.perf_counter()
        found = select_records(thousand, TARGET, 30, seed)
        assert time.perf_counter() - started < 10.0
        mean, sd = found.errors
        assert np.abs(mean).max() <= 0.05
        assert np.nanmax(np.abs(sd)) <= 0.10
        assert np.isnan(sd).sum() == 1
        assert found.median[TARGET.given] == pytest.approx(0.4)
        assert found.cautions == ()

    def test_correlations_are_those_of_the_target(self, thousand):
        free = TARGET.sd > 0.0
        expected = (TARGET.covariance / np.outer(TARGET.sd + ~free, TARGET.sd + ~free))[free][
            :, free
        ]
        found = np.mean(
            [
                np.corrcoef(select_records(thousand, TARGET, 30, seed).ln_sa[:, free].T)
                for seed in range(5)
            ],
            axis=0,
        )
        assert np.sqrt(((found - expected) ** 2).mean()) < 0.15

    def test_spectrum_with_scatter_and_no_conditioning(self, thousand):
        median, sd, _ = predict(Rupture(6.5, 20.0, 500.0), "CY14", PERIODS)
        target = spectrum_target(PERIODS, np.exp(median), sd)
        mean, scatter = select_records(thousand, target, 30, 1).errors
        assert np.abs(mean).max() <= 0.05
        assert np.abs(scatter).max() <= 0.10

    def test_mean_only_takes_records_close_to_it(self, thousand):
        target = spectrum_target(PERIODS, TARGET.median)
        found = select_records(thousand, target, 11, 1)
        assert np.abs(found.errors[0]).max() <= 0.05
        assert found.sd.mean() < 0.5 * TARGET.sd.mean()
        assert ((found.table["scale"] >= 0.25) & (found.table["scale"] <= 4.0)).all()


class TestReproducible:
    def test_same_seed_same_set_whatever_the_order_of_rows(self, thousand):
        one = select_records(thousand, TARGET, 20, 7)
        shuffled = thousand.sample(frac=1.0, random_state=3)
        other = select_records(shuffled, TARGET, 20, 7)
        pd.testing.assert_frame_equal(one.table, other.table)
        assert np.array_equal(one.ln_sa, other.ln_sa)


class TestLimits:
    @pytest.mark.parametrize("limit", [1.5, 2.0, 4.0])
    def test_no_factor_is_beyond_the_limit(self, thousand, limit):
        scale = select_records(thousand, TARGET, 15, 1, max_scale=limit).table["scale"]
        assert scale.max() <= limit
        assert scale.min() >= 1.0 / limit

    def test_scaling_by_one_only(self):
        table = pd.DataFrame({"record": ["a", "b"], "T1.000S": [0.3, 0.6], "T2.000S": [0.2, 0.2]})
        target = spectrum_target([1.0, 2.0], [0.3, 0.1], [0.0, 0.5])
        found = select_records(table, target, 1, 1, max_scale=1.0)
        assert found.table["record"].tolist() == ["a"]
        assert found.facts()["sd_error"] == [None, None]

    def test_records_of_one_event(self, thousand):
        found = select_records(thousand, TARGET, 40, 1, per_event=1).table
        assert not found["event"].duplicated().any()

    def test_components_of_one_recording_are_not_both_taken(self, thousand):
        pairs = thousand.assign(event=[f"E{i // 2}" for i in range(1000)])
        found = select_records(pairs, TARGET, 100, 1).table
        assert not found[["event", "station"]].duplicated().any()

    def test_cautions(self, thousand):
        (column,) = (c for c in thousand if c.startswith("T1.0000"))
        weak = screen(thousand, distance_km=(40.0, None), magnitude=(None, 6.3))
        for table, part in (
            (thousand.drop(columns=column), "Sa(1) of the records is interpolated"),
            (weak, "scaled by more than 4 or less than 1/4"),
            (thousand.assign(event="Kobe"), "20 of 20 records are of one event (Kobe)"),
        ):
            found = select_records(table, TARGET, 20, 1, max_scale=100.0)
            assert any(part in caution for caution in found.cautions)


class TestScreen:
    def test_ranges(self, thousand):
        kept = screen(
            thousand, magnitude=(6.0, 7.0), distance_km=(None, 40.0), vs30_mps=(360.0, None),
            pulse=False,
        )  # fmt: skip
        assert 0 < len(kept) < 1000
        assert kept["magnitude"].between(6.0, 7.0).all()
        assert (kept["distance_km"] <= 40.0).all()
        assert (kept["vs30_mps"] >= 360.0).all()
        assert not kept["pulse"].any()

    @pytest.mark.parametrize(
        ("conditions", "reason"),
        [
            ({"magnitude": (7.0, 6.0)}, r"^magnitude from 7 to 6 is upside down$"),
            ({"vs30_mps": (1.0, 2.0)}, r"^nga\.csv: column 'vs30_mps' is missing$"),
            ({"pulse": True}, r"^nga\.csv: column 'pulse' is missing$"),
            ({"distance_km": (0, 9)}, r"^nga\.csv: distance_km = 'far' is not a number$"),
            (
                {"magnitude": (8.0, None)},
                r"^nga\.csv: no record is left; 1 records, magnitude from 8 to inf leaves 0$",
            ),
        ],
    )
    def test_refusals(self, conditions, reason):
        table = pd.DataFrame({"record": ["a"], "magnitude": [6.0], "distance_km": ["far"]})
        table.attrs["source"] = "nga.csv"
        with pytest.raises(RecordError, match=reason):
            screen(table, **conditions)


class TestRefusals:
    @pytest.mark.parametrize(
        ("change", "reason"),
        [
            (lambda t: t.drop(columns="record"), r"^the flatfile: column 'record' is missing$"),
            (lambda t: t[["record"]], r"has no column of Sa, such as T0\.100S in g$"),
            (
                lambda t: t.drop(columns="T0.050000S"),
                r"has Sa from 0\.06.* the target asks for 0\.05 s$",
            ),
            (
                lambda t: t.drop(columns=[c for c in t if c.startswith(("T0.8", "T1.", "T0.7"))]),
                r"has no Sa between 0\.6.* too far apart to interpolate the target's 0\.8",
            ),
            (lambda t: t.assign(record="x"), r"record 'x' is there twice$"),
            (lambda t: t.iloc[:0], r"the flatfile: has no record$"),
            (
                lambda t: t.assign(**{"T0.050000S": -999.0}),
                r"20 records are wanted and 0 may be selected; of 50 candidates 0 have Sa at all",
            ),
            (lambda t: t.assign(**{"T0.050000S": "x"}), r"T0\.050000S = 'x' is not a number$"),
        ],
    )
    def test_tables(self, thousand, change, reason):
        with pytest.raises(RecordError, match=reason):
            select_records(change(thousand.iloc[:50]), TARGET, 20, 1)

    @pytest.mark.parametrize(
        ("options", "reason"),
        [
            (
                {"max_scale": 1.001},
                r"20 records are wanted and \d may be selected; of 50 candidates",
            ),
            ({"max_scale": 0.5}, r"^max_scale = 0\.5 must be at least 1$"),
            ({"max_scale": np.nan}, r"^max_scale = nan must be at least 1$"),
            ({"per_event": 0}, r"^per_event = 0 must be at least 1$"),
            ({"weights": (0.0, 0.0)}, r"^weights \(0\.0, 0\.0\) must be numbers from 0 on"),
        ],
    )
    def test_options(self, thousand, options, reason):
        with pytest.raises(InputError, match=reason):
            select_records(thousand.iloc[:50], TARGET, 20, 1, **options)

    def test_too_few_events(self, thousand):
        table = thousand.assign(event=[f"E{i % 3}" for i in range(1000)])
        with pytest.raises(RecordError, match=r"6 may be selected; .*, 6 with at most 2 of one"):
            select_records(table, TARGET, 10, 1, per_event=2)
        with pytest.raises(RecordError, match=r"column 'event' is missing, by which `per_event`"):
            select_records(thousand.drop(columns="event"), TARGET, 10, 1, per_event=2)


class TestOutput:
    def test_figure_shows_both_with_their_bands(self, thousand, tmp_path):
        figure = select_records(thousand, TARGET, 10, 1).figure()
        labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
        assert labels == [
            "10 selected, scaled", "target: median", "target: 2.5 and 97.5 %",
            "selected: median", "selected: 2.5 and 97.5 %",
        ]  # fmt: skip
        figure.savefig(tmp_path / "selection.svg")
        assert (tmp_path / "selection.svg").stat().st_size > 1000

    def test_index_that_a_study_reads_and_scales_by_the_same_factors(self, tmp_path):
        """At the level of a conditional spectrum a study's factors are those selected."""
        (tmp_path / "at2").mkdir()
        rng, rows = np.random.default_rng(2), []
        for number in range(8):
            samples = rng.standard_normal(300) * np.hanning(300) * rng.uniform(0.05, 0.2)
            (tmp_path / "at2" / f"{number}.AT2").write_text(at2_text(samples))
            sa = spectral_acceleration(Motion(samples, 0.01), [0.2, 0.5, 1.0])
            facts = {"record": f"r{number}", "file": f"at2/{number}.AT2", "magnitude": 6.5}
            rows.append(facts | dict(zip(["T0.200S", "T0.500S", "T1.000S"], sa)))
        target = spectrum_target([0.2, 0.5, 1.0], [0.3, 0.15, 0.1], [0.5, 0.0, 0.5])
        found = select_records(pd.DataFrame(rows), target, 4, 1, max_scale=50.0)
        (tmp_path / "sets").mkdir()
        found.write(tmp_path / "sets" / "selected.csv", folder=tmp_path)
        entries = load_index(tmp_path / "sets" / "selected.csv")
        assert [entry.id for entry in entries] == found.table["record"].tolist()
        for entry, factor in zip(entries, found.table["scale"]):
            motion = load_motion(entry)
            assert motion.metadata["Mw"] == 6.5
            assert float(motion.metadata["scale"]) == pytest.approx(factor, rel=1e-8)
            needed = scale_factor(motion, "Sa(0.5)", 0.15 * STANDARD_GRAVITY)
            assert needed == pytest.approx(factor, rel=1e-5)

    def test_nothing_half_written(self, thousand, tmp_path):
        found = select_records(thousand, TARGET, 5, 1)
        with pytest.raises(OutputError, match=r"cannot be written"):
            found.write(tmp_path / "none" / "selected.csv")
        del found.table["file"]
        with pytest.raises(RecordError, match=r"column 'file' is missing$"):
            found.write(tmp_path / "selected.csv")
        assert list(tmp_path.iterdir()) == []
