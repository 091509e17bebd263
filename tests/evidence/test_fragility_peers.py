"""The fragility study by peers: scenes, and which of ours is as good for less."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import archfrag as af
from archfrag.evidence.fragility import peers as module
from archfrag.evidence.fragility.peers import FALL, OURS, peers_note, scenes_of
from archfrag.evidence.fragility.reference import reference_ways
from archfrag.evidence.fragility.studies import Records
from archfrag.evidence.part import Setup
from archfrag.evidence.run import Places, peak_acceleration
from archfrag.evidence.store import load, save


@pytest.fixture
def records():
    time = 0.01 * np.arange(300)
    motions = [
        af.Motion((1.0 + k) * np.sin(2.0 * np.pi * time), 0.01, id=identifier)
        for k, identifier in enumerate(("a", "b", "c"))
    ]  # fmt: skip
    return Records("shipped", motions, [0.5, 1.0, 1.5, 2.0])


def test_scenes_are_every_second_record_at_the_study_s_levels(records):
    rows = scenes_of(records)
    assert [[scene.name for scene in row] for row in rows] == [["a"] * 4, ["c"] * 4]
    peaks = [peak_acceleration(scene) for scene in rows[1]]
    assert peaks == pytest.approx([0.5, 1.0, 1.5, 2.0])
    assert rows[0][0].duration >= 2.99 + FALL


def capacity(steps, cost):
    """A stand-in for a solver: what falls at which level, and what a run costs [s]."""

    def run(*_):
        return np.array([[[float(fell) for fell in row] for row in steps],
                         [[cost] * len(row) for row in steps]])  # fmt: skip

    return run


def test_the_cheapest_of_ours_that_is_as_good_is_found(monkeypatch, tmp_path):
    exact = [[0, 0, 0, 1]] * 3 + [[0, 0, 1, 1]] * 3 + [[0, 1, 1, 1]] * 3 + [[1, 1, 1, 1]]
    early = [[0, 0, 1, 1]] * 3 + [[0, 1, 1, 1]] * 4 + [[1, 1, 1, 1]] * 3
    references = [way for ways in reference_ways(quick=True) for way in ways]
    costs = {str(way): 1.0 for way in (*references, *OURS)}
    costs |= {"time_stepping 4 ms": 0.01, "auto 0.01": 0.05}
    good = {*map(str, references), "auto 0.01", "time_stepping 1 ms"}
    monkeypatch.setattr(
        module, "_ours",
        lambda way, _: capacity(exact if str(way) in good else early, costs[str(way)])(),
    )  # fmt: skip
    monkeypatch.setattr(module, "_peer", lambda peer, scenes, step: capacity(exact, 0.2)())
    monkeypatch.setattr(module, "_predicted", lambda *_: 1.0)
    monkeypatch.setattr(module, "Peer", lambda *_: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(module, "scenes_of", lambda _: [[None]])
    setup = Setup(True, Places(tmp_path), peers=("mujoco",), say=lambda _: None)
    records = SimpleNamespace(study="shipped", levels=[0.5, 1.0, 1.4, 2.0])
    frame, left_out = module.compare_peers(setup, records)
    assert not left_out
    peers = frame[frame["who"] == "peer"]
    assert list(peers["cheapest_of_ours"]) == ["auto 0.01"] * 3
    assert peers["cheapest_seconds"].tolist() == pytest.approx([0.05 * 40] * 3)
    assert peers["cpu_seconds"].tolist() == pytest.approx([0.2 * 40] * 3)
    assert "faster than every peer, by 4.0 times" in peers_note(frame).text
    save(tmp_path, "fragility", {"peers": frame}, {})
    assert peers_note(load(tmp_path, "fragility")["peers"]).rows == peers_note(frame).rows


def test_a_peer_whose_luck_none_of_ours_had_is_named():
    luck = {"scatter_ln_theta": 0.02, "scatter_beta": 0.02}
    columns = ("way", "who", "cpu_seconds", "ln_theta_difference", "beta_difference")
    rows = (
        ("time_stepping 4 ms", "ours", 1.0, 0.01, 0.015),
        ("mujoco 4 ms", "peer", 9.0, 0.0, 0.001),
        ("mujoco 2 ms", "peer", 18.0, -0.03, -0.05),
    )
    table = pd.DataFrame(rows, columns=list(columns)).assign(**luck)
    frame = module.choose(table.reindex(columns=list(module.COLUMNS)).astype(
        {"cheapest_of_ours": object}))  # fmt: skip
    frame["differ"] = 0
    assert frame["cheapest_of_ours"].tolist()[1:] == ["time_stepping 4 ms"] * 2
    text = peers_note(frame).text
    assert "faster than every peer, by 9.0 times" in text
    assert text.endswith("in both theta and beta as mujoco 4 ms.")
