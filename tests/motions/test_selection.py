"""Records selected to a target: models, targets, and the algorithm."""

import numpy as np
import pandas as pd
import pytest

from archfrag.motions import target as targets
from archfrag.motions.index import load_index
from archfrag.motions.measures import scale_factor, spectral_acceleration
from archfrag.motions.motion import STANDARD_GRAVITY, Motion
from archfrag.motions.read import load_motion
from archfrag.motions.selection import read_targets, select_records, target_of_index
from archfrag.motions.target import (
    MODELS,
    conditional_spectrum,
    predict,
    spectrum_target,
)

from .helpers import at2_text, refused

GRID = np.array([0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])
NEAR = (7.0, 12.0, 400.0)


@pytest.mark.parametrize("model", MODELS)
def test_all_models_are_within_a_factor_of_two_of_each_other(model):
    rupture = (6.5, 20.0, 500.0)
    ln_median, sd, notes = predict(rupture, model, [0.1, 1.0])
    assert np.abs(ln_median - predict(rupture, "BSSA14", [0.1, 1.0])[0]).max() < np.log(
        2.0
    )
    assert ((sd > 0.5) & (sd < 0.9)).all()
    assert notes == ()


def test_csv_of_a_conditional_spectrum_is_that_spectrum(tmp_path):
    made = conditional_spectrum(NEAR, 0.5, 1.0, GRID)
    rows = zip(made.periods[::-1], made.median[::-1], made.sd[::-1])
    path = tmp_path / "target.csv"
    path.write_text(
        "period_s,Sa_g,sd\n" + "".join(f"{t},{m},{s}\n" for t, m, s in rows)
    )
    found = read_targets(path)[None]
    assert found.conditioning == 1.0
    assert found.ln_mean == pytest.approx(made.ln_mean)
    assert found.covariance == pytest.approx(made.covariance, abs=1e-9)


PERIODS = np.sort(np.append(np.geomspace(0.05, 5.0, 19), 1.0))
TARGET = conditional_spectrum((7.0, 15.0, 500.0), 0.4, 1.0, PERIODS)


@pytest.fixture(scope="module")
def thousand():
    """Made-up records: spectra about CY14 with the published correlation, M, R and Vs30 drawn."""
    rng = np.random.default_rng(0)
    values, vectors = np.linalg.eigh(targets.correlation(PERIODS[:, None], PERIODS))
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    rows = []
    for number in range(1000):
        rupture = (
            rng.uniform(5.5, 7.5),
            10.0 ** rng.uniform(1, 2),
            rng.uniform(250, 800),
        )
        median, sd, _ = predict(rupture, "CY14", PERIODS)
        sa = np.exp(median + sd * (root @ rng.standard_normal(PERIODS.size)))
        facts = {
            "record": f"R{number:04d}",
            "file": f"{number:04d}.AT2",
            "event": f"E{rng.integers(60)}",
            "station": f"S{number // 2}",
            "magnitude": rupture[0],
            "distance_km": rupture[1],
            "vs30_mps": rupture[2],
            "pulse": bool(rng.random() < 0.1),
        }
        rows.append(facts | {f"T{t:.6f}S": value for t, value in zip(PERIODS, sa)})
    return pd.DataFrame(rows)


def errors_of(found):
    return np.array(
        [found.facts()[key] for key in ("median_error", "sd_error")], dtype=float
    )


def test_conditional_spectrum_is_recovered(thousand):
    free = TARGET.sd > 0.0
    found = []
    for seed in (1, 2, 3):
        chosen = select_records(thousand, TARGET, 30, seed)
        mean, sd = errors_of(chosen)
        assert np.abs(mean).max() <= 0.05
        assert np.nanmax(np.abs(sd)) <= 0.10
        assert np.isnan(sd).sum() == 1
        assert np.exp(chosen.ln_sa[:, TARGET.given].mean()) == pytest.approx(0.4)
        assert chosen.cautions == ()
        found.append(np.corrcoef(chosen.ln_sa[:, free].T))
    sd = TARGET.sd[free]
    expected = TARGET.covariance[np.ix_(free, free)] / np.outer(sd, sd)
    assert np.sqrt(((np.mean(found, axis=0) - expected) ** 2).mean()) < 0.15


def test_of_a_mean_only_records_close_to_it_are_taken_within_the_factors(thousand):
    mean = spectrum_target(TARGET.periods, TARGET.median, 0.0 * TARGET.median, "mean")
    found = select_records(thousand, mean, 11, 1, max_scale=2.0)
    assert np.abs(errors_of(found)[0]).max() <= 0.05
    assert found.sd.mean() < 0.5 * TARGET.sd.mean()
    assert found.table["scale"].between(0.5, 2.0).all()


def test_one_of_an_event_and_of_a_recording(thousand):
    found = select_records(thousand, TARGET, 40, 1, per_event=1).table
    assert not found["event"].duplicated().any()
    pairs = thousand.assign(event=[f"E{i // 2}" for i in range(1000)])
    found = select_records(pairs, TARGET, 100, 1).table
    assert not found[["event", "station"]].duplicated().any()


def test_cautions(thousand):
    found = select_records(
        thousand.assign(event="Kobe"), TARGET, 20, 1, max_scale=100.0
    )
    assert any(
        "20 of 20 records are of one event (Kobe)" in each for each in found.cautions
    )


def test_index_that_a_study_reads_and_scales_by_the_same_factors(tmp_path):
    """At the level of a conditional spectrum a study's factors are those selected."""
    (tmp_path / "sets").mkdir()
    rng = np.random.default_rng(2)
    rows = []
    periods = [0.2, 0.5, 1.0]
    for number in range(8):
        samples = rng.standard_normal(300) * np.hanning(300) * rng.uniform(0.05, 0.2)
        (tmp_path / f"{number}.AT2").write_text(at2_text(samples))
        sa = spectral_acceleration(Motion(samples, 0.01), periods)
        facts = {"record": f"r{number}", "file": f"{number}.AT2", "magnitude": 6.5}
        rows.append(
            facts | {f"T{period:.3f}S": value for period, value in zip(periods, sa)}
        )
    sa = np.array([0.3, 0.15, 0.1])
    sd = np.array([0.5, 0.0, 0.5])
    target = spectrum_target(np.array(periods), sa, sd, "target")
    found = select_records(pd.DataFrame(rows), target, 4, 1, max_scale=50.0)
    found.write(tmp_path / "sets" / "selected.csv", folder=tmp_path)
    entries = load_index(tmp_path / "sets" / "selected.csv")
    assert [entry.id for entry in entries] == found.table["record"].tolist()
    for entry, factor in zip(entries, found.table["scale"]):
        motion = load_motion(entry)
        assert motion.metadata["Mw"] == 6.5
        assert float(motion.metadata["scale"]) == pytest.approx(factor, rel=1e-8)
        needed = scale_factor(motion, "Sa(0.5)", 0.15 * STANDARD_GRAVITY)
        assert needed == pytest.approx(factor, rel=1e-5)
    written, factors = target_of_index(tmp_path / "sets" / "selected.csv")
    np.testing.assert_allclose(written, [periods, sa, sd], rtol=1e-5)
    assert list(factors.values()) == pytest.approx(
        found.table["scale"].tolist(), rel=1e-8
    )
    (tmp_path / "sets" / "selected.target.csv").unlink()
    assert target_of_index(tmp_path / "sets" / "selected.csv") is None


def test_same_seed_same_set_however_rows_are_ordered(thousand):
    one = select_records(thousand, TARGET, 20, 7)
    other = select_records(thousand.sample(frac=1.0, random_state=3), TARGET, 20, 7)
    pd.testing.assert_frame_equal(one.table, other.table)


def chosen(change=lambda table: table, **options):
    return lambda table, _: select_records(
        change(table.iloc[:50]), TARGET, 20, 1, **options
    )


def predicted(change, model="CY14", periods=(1.0,)):
    facts = {"magnitude": 6.5, "distance_km": 20.0, "vs30_mps": 500.0} | change
    return lambda *_: predict(tuple(facts.values()), model, periods)


def in_csv(text):
    def read(_, folder):
        (folder / "target.csv").write_text(text)
        return read_targets(folder / "target.csv")[None]

    return read


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (
            lambda *_: targets.correlation(1.0, 0.009),
            ["period 0.009 s", "0.01 to 10 s"],
        ),
        (predicted({}, "CY08"), ["'CY08'", "ASK14, BSSA14"]),
        (predicted({}, "ASB14", [5.0]), ["period 5 s", "0.01 to 4 s", "ASB14"]),
        (predicted({"vs30_mps": 0.0}), ["20.0, 0.0) must be numbers above 0"]),
        (lambda *_: conditional_spectrum(NEAR, 0.0, 1.0), ["level = 0.0 g"]),
        (
            lambda *_: conditional_spectrum(NEAR, 0.3, 1.0, [0.5, 0.5]),
            ["0.5 s is there twice"],
        ),
        (in_csv("T,Sa_g\n1,2\n"), ["target.csv", "'period_s'"]),
        (in_csv("period_s,Sa_g\n1,x\n"), ["target.csv: Sa_g: ", "'x'"]),
        (in_csv("period_s,Sa_g,sd\n1,2,0\n2,2,0\n3,2,.5\n"), ["sd is 0 at 2 periods"]),
        (
            chosen(lambda t: t.drop(columns="T0.050000S")),
            ["no column T0.050S", "measure at"],
        ),
        (chosen(lambda t: t.assign(record="x")), ["'x' is there twice"]),
        (
            chosen(lambda t: t.assign(**{"T0.050000S": -999.0})),
            ["of 50 candidates 0 have Sa"],
        ),
        (chosen(max_scale=1.001), ["20 records were asked for", "of 50 candidates"]),
        (chosen(per_event=0), ["per_event = 0"]),
        (
            chosen(lambda t: t.assign(event=["A", "B"] * 25), per_event=2),
            ["4 with at most 2"],
        ),
    ],
)
def test_refusals(thousand, tmp_path, call, parts):
    refused(lambda: call(thousand, tmp_path), *parts)
