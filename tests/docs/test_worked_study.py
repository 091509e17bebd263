"""The worked study's committed results are those of its study file, drawing and hazard curve."""

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import archfrag as af

STUDY = Path(__file__).parents[2] / "docs" / "worked_study"


def read(name):
    return json.loads((STUDY / "results" / f"{name}.json").read_text())


def test_results_belong_to_the_study():
    assert read("provenance")["sha256"] == {
        name: hashlib.sha256((STUDY / name).read_bytes()).hexdigest()
        for name in ("study.yaml", "bridge.dxf", "hazard.csv")
    }


def test_results_of_the_bridge_belong_to_its_study():
    folder = STUDY.parent / "worked_study_bridge"
    made = json.loads((folder / "results" / "provenance.json").read_text())
    assert (
        made["sha256"]
        == hashlib.sha256((folder / "study.yaml").read_bytes()).hexdigest()
    )
    compared = pd.read_csv(folder / "results" / "compared.csv")
    tied = compared[compared.other.str.endswith("-tied")]
    # As its page says; it names the spreads at which the band lies above 1.
    assert (tied.ratio > 1.0).all()
    assert (tied.lower > 1.0).sum() == 2
    spread = compared[compared.one == "spread-0"].iloc[1:]
    assert ((spread.lower < 1.0) & (spread.upper > 1.0)).all()
    joints = pd.read_csv(folder / "results" / "joints.csv")
    assert (joints.after < joints.before).all()
    assert joints.lower.max() < joints.upper.min()


def test_drawing_is_the_one_of_the_page():
    radius = (5.0**2 + (10 / 3) ** 2) / (2 * 10 / 3)
    embrace = round(2 * math.degrees(math.asin(5.0 / radius)), 2)
    shape = round(radius + 0.457 / 2, 4), 0.457, embrace
    ring, finer = (af.Arch.circular(*shape, count, friction=0.6) for count in (21, 41))
    drawn = af.Arch.from_dxf(STUDY / "bridge.dxf", friction=0.6)
    for ours, theirs in zip(ring.chain[:5], drawn.chain[:5]):
        np.testing.assert_allclose(theirs, ours, rtol=1e-12, atol=1e-12)
    assert af.onset(finer).plus == pytest.approx(af.onset(ring).plus, rel=0.02)


def test_claims_of_the_page_hold():
    ring = read("summary")["classes"][0]
    start = af.onset(af.Arch.from_dxf(STUDY / "bridge.dxf", friction=0.6))
    assert ring["curve"]["theta"] > 2.5 * start.plus
    assert (
        ring["dispersion"]["beta_model"]
        < 0.5 * ring["dispersion"]["beta_record_to_record"]
    )
    rigid = read("rigid")
    assert rigid["curve"]["theta"] > ring["curve"]["theta"]
    assert rigid["dispersion"]["beta_model"] < ring["dispersion"]["beta_model"]


def test_hazard_is_the_power_law_of_the_page():
    rows = (STUDY / "hazard.csv").read_text().split()[2:]
    for pga, rate in (map(float, row.split(",")) for row in rows):
        assert rate == pytest.approx((pga / 0.26) ** -2.5 / 475, rel=1e-3)
