"""Cost against the number of voussoirs: timed runs become exponents."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from archfrag.evidence import growth
from archfrag.evidence.part import Setup
from archfrag.evidence.run import Places
from archfrag.evidence.store import load, save


def made_up(power, numbers=(7, 14, 27, 54), method="auto", scatter=0.0, seed=1):
    rng = np.random.default_rng(seed)
    rows = [
        growth.Cost(
            method, n, turn, 2.0 * 1e-3 * n**power * np.exp(scatter * rng.normal()), 2.0, 10, "x"
        )
        for turn in range(3)
        for n in numbers
    ]
    return pd.DataFrame(rows, columns=growth.Cost._fields)


def test_exponent_of_a_power_law():
    row = growth.exponents_table(made_up(1.3)).iloc[0]
    assert row["exponent"] == pytest.approx(1.3)
    assert row["at_least"] == pytest.approx(1e-3 * 7**1.3)
    assert row["high"] - row["low"] == pytest.approx(0.0, abs=1e-6)


def test_interval_holds_the_exponent_as_often_as_it_says():
    rows = [
        growth.exponents_table(made_up(1.0, scatter=0.1, seed=seed)).iloc[0] for seed in range(200)
    ]
    held = np.mean([row["low"] < 1.0 < row["high"] for row in rows])
    assert 0.84 < held < 0.96


def test_two_numbers_give_no_interval():
    assert np.isnan(growth.exponents_table(made_up(1.0, numbers=(7, 14))).iloc[0]["low"])


def test_scene_is_the_same_arch_cut_further():
    few, many = growth.scene_of(7), growth.scene_of(54)
    assert len(many.polygons()) == 54
    assert few.chain["radius"] == many.chain["radius"]
    # Straight sides: 7 of them hold less than the ring, 54 nearly all.
    assert few.bodies().mass.sum() == pytest.approx(many.bodies().mass.sum(), rel=0.03)


def test_a_run_ends_at_the_same_instant_and_costs_time():
    cost = growth.timed("time_stepping", 7, 0)
    assert cost.moving_seconds == pytest.approx(growth.SECONDS, abs=0.05)
    assert 0.0 < cost.cpu_seconds < 5.0
    assert cost.steps > 400


def test_what_would_take_too_long_is_not_begun():
    seen = [growth.Cost("a", n, -1, 0.01 * n**3, 1.0, 1, "x") for n in (7, 14)]
    assert growth._too_long(seen, 28, 1000.0) == ""
    assert "220 s" in growth._too_long(seen, 28, 100.0)


def test_what_is_shown_comes_from_the_tables_on_disk(tmp_path):
    runs = pd.concat([made_up(1.1), made_up(2.0, (7, 14), "time_stepping")])
    left_out = [("mujoco", "all", "not installed")]
    frames = {
        "runs": runs,
        "exponents": growth.exponents_table(runs),
        "left_out": pd.DataFrame(left_out, columns=["method", "voussoirs", "reason"]),
    }
    save(tmp_path, "growth", frames, {})
    section = growth.show(load(tmp_path, "growth"))
    assert "n^1.10" in section.lead[0]
    assert "n^2.00" in section.lead[0]
    assert section.notes[-1].rows[0][0] == "mujoco"
    assert "<svg" in section.pictures["growth"].svg


def test_methods_and_peers_are_timed_in_turn(monkeypatch):
    monkeypatch.setattr(growth, "available_methods", lambda: ("time_stepping",))
    monkeypatch.setattr(growth, "NUMBERS", {True: (3, 5)})
    monkeypatch.setattr(growth, "TURNS", {True: 2})
    frames = growth.measure(Setup(True, Places(Path()), peers=("archfrag", "no such peer")))
    runs = frames["runs"]
    assert runs["method"].tolist() == ["time_stepping", "archfrag"] * 4
    assert runs["voussoirs"].tolist() == [3, 3, 5, 5] * 2
    assert frames["left_out"]["method"].tolist() == ["no such peer"]
    assert frames["exponents"]["exponent"].notna().all()
