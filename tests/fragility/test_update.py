"""Curves updated by damage that was seen, against quadratures of their own."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from archfrag.errors import InputError
from archfrag.fragility.curve import Curve
from archfrag.fragility.evidence import evidence
from archfrag.fragility.observed import damage_of
from archfrag.fragility.quoted import quoted_band
from archfrag.fragility.update import updated
from archfrag.fragility.verdicts import find_brackets

SPREAD = np.log(0.49 / 0.32) / (2.0 * norm.ppf(0.95))
PRIOR = Curve(
    0.39,
    0.5,
    np.diag([SPREAD**2, 0.0]),
    kind="posterior",
    measure="PGA",
    unit="g",
    si=9.80665,
)
STATES = ["collapsed"] * 8 + ["survived"] * 2
SEEN = {"state": STATES, "median": 0.3, "tau": 0.0, "phi": 0.0}
KNOWN = {
    "state": ["collapsed", "survived"],
    "median": [0.3, 0.5],
    "tau": 0.2,
    "phi": 0.3,
}
FAR = KNOWN | {"lon": [13.0, 13.05], "lat": [42.0, 42.0]}
GRID = """<shakemap_grid xmlns="http://earthquake.usgs.gov/eqcenter/shakemap">
<grid_field index="1" name="LON" units="dd" /><grid_field index="2" name="LAT" units="dd" />
<grid_field index="3" name="{}" units="{}" />
<grid_data>
13.0 42.0 {} 13.2 42.0 {} 13.0 42.2 {} 13.2 42.2 {}
</grid_data></shakemap_grid>"""


@pytest.mark.parametrize(
    ("tau", "phi", "beta_model", "theta"),
    [
        (0.0, 0.0, 0.5, 0.322),
        (0.4, 0.0, 0.5, 0.370),
        (0.0, 0.4, 0.5, 0.334),
        (0.0, 0.0, 0.3, 0.373),
        (0.4, 0.0, 0.3, 0.380),
    ],
)
def test_eight_of_ten_at_one_site(tau, phi, beta_model, theta):
    """By a quadrature of its own, as published values there are none."""
    curve = PRIOR.update(SEEN | {"tau": tau, "phi": phi}, beta_model=beta_model)
    t = np.log(0.39) + SPREAD * np.linspace(-7.0, 7.0, 1401)
    z = np.linspace(-8.0, 8.0, 1601)
    shared = np.hypot(tau, np.sqrt(0.25 - beta_model**2))
    p = norm.cdf((np.log(0.3) + shared * z[:, None] - t) / np.hypot(beta_model, phi))
    chance = (
        norm.pdf(z) @ (p**8 * (1.0 - p) ** 2) * norm.pdf((t - np.log(0.39)) / SPREAD)
    )
    below = np.cumsum(chance) / chance.sum()
    low, middle, high = np.exp(np.interp([0.05, 0.5, 0.95], below, t))
    assert abs(middle - theta) < 0.001
    assert abs(curve.theta - theta) < 0.002
    assert curve.theta_interval == pytest.approx((low, high), rel=0.02)
    assert curve.beta == pytest.approx(0.5, abs=1e-3)


def test_places_share_by_their_distance():
    """The integral over both intensities, by a grid of its own."""
    ((damage,), _) = damage_of(PRIOR, FAR)
    own = 0.36
    away = 0.05 * 111.195 * np.cos(np.radians(42.0))
    rho = np.exp(-3.0 * away / 11.5)
    variance = 0.2**2 + 0.3**2 + (1.0 - own) * 0.25
    shared = 0.2**2 + (variance - 0.2**2) * rho
    root = np.linalg.cholesky([[variance, shared], [shared, variance]])
    z = np.linspace(-7.0, 7.0, 401)
    x, y = np.einsum("ij,jkl->ikl", root, np.array(np.meshgrid(z, z)))
    theta = np.log([0.3, 0.39, 0.6])
    s = 0.5 * np.sqrt(own)
    weight = norm.pdf(z) * (z[1] - z[0])
    direct = [
        weight
        @ (norm.cdf((np.log(0.3) + x - t) / s) * norm.sf((np.log(0.5) + y - t) / s))
        @ weight
        for t in theta
    ]
    found = evidence(damage, theta[:, None], np.full(3, 0.5), own)
    assert np.exp(found) == pytest.approx(direct, rel=0.01)


def test_earthquakes_are_independent():
    twice = pd.concat([pd.DataFrame(KNOWN).assign(event=name) for name in "ab"])
    damage, _ = damage_of(PRIOR, twice)
    (single,), _ = damage_of(PRIOR, KNOWN)
    at = np.log([[0.3], [0.5]]), np.array([0.5, 0.4])
    assert [evidence(each, *at, 0.5).tolist() for each in damage] == [
        evidence(single, *at, 0.5).tolist()
    ] * 2


def test_a_station_at_the_arch_makes_its_intensity_known():
    station = {"lon": 13.0, "lat": 42.0, "median": [0.6], "tau": 0.2, "phi": 0.3}
    arch = {"lon": 13.0, "lat": 42.0, "median": 0.6, "tau": 0.2, "phi": 0.3}
    seen = pd.DataFrame({"state": STATES} | arch)
    curve = PRIOR.update(seen, beta_model=0.5, stations=station | {"observed": 0.3})
    assert abs(curve.theta - 0.322) < 0.002


def test_shakemap_gives_intensity_and_scatter(tmp_path):
    for name, *field in (
        ("grid", "PGA", "pctg", 30.0, 30.0, 30.0, 30.0),
        ("uncertainty", "STDPGA", "ln(pctg)", 0.4, 0.4, 0.4, 0.4),
    ):
        (tmp_path / f"{name}.xml").write_text(GRID.format(*field))
    files = [tmp_path / "grid.xml", tmp_path / "uncertainty.xml"]
    seen = {"state": STATES, "lon": 13.1, "lat": 42.1}
    curve = PRIOR.update(seen, beta_model=0.5, shakemap=files, share=1.0)
    assert abs(curve.theta - 0.370) < 0.002
    with pytest.raises(InputError, match="that cover them"):
        PRIOR.update(seen | {"lon": 15.0}, beta_model=0.5, shakemap=files, share=1.0)
    (tmp_path / "grid.xml").write_text("<a>")
    with pytest.raises(InputError, match=r"grid\.xml: is damaged"):
        PRIOR.update(seen, beta_model=0.5, shakemap=files, share=1.0)


def test_a_class_knows_what_its_arches_share():
    parts = {"beta_record_to_record": 0.4, "beta_model": 0.3}
    known = replace(PRIOR, dispersion=parts).update(SEEN)
    assert known.theta == PRIOR.update(SEEN, beta_model=0.3).theta


def test_the_curve_is_a_curve():
    """Also after a study, whose posterior is on a grid; it says what it was updated by."""
    verdict = np.exp(0.4 * np.linspace(-1.5, 1.5, 12))[:, None] < np.geomspace(
        0.3, 3, 12
    )
    found = find_brackets(verdict.astype(int), np.geomspace(0.3, 3, 12))
    study = replace(quoted_band(found, np.linspace(0, 3, 50)), measure="PGA", unit="g")
    curve = study.update(SEEN | {"median": 0.6, "tau": 0.2}, beta_model=0.3)
    assert curve.theta < study.theta
    low, high = curve.band(1.0)
    assert low < curve(1.0) < high
    assert curve.quantile(0.5) == pytest.approx(curve.theta)
    theta, _ = curve.draws(1, 2000)
    assert np.quantile(theta, [0.05, 0.95]) == pytest.approx(
        curve.theta_interval, rel=0.02
    )
    assert "10 arches in 1 earthquake" in curve.method
    again = Curve.from_dict(curve.to_dict())
    assert (again.theta, again.method) == (curve.theta, curve.method)
    assert curve.update(KNOWN, beta_model=0.2).theta != curve.theta


def test_states_have_one_beta_and_their_order():
    light = replace(PRIOR, theta=0.2, state="rotation")
    both = replace(PRIOR, states=(light,))
    seen = SEEN | {"state": ["collapsed"] * 2 + ["rotation"] * 5 + ["survived"] * 3}
    curve = both.update(seen, beta_model=0.3)
    states = curve.limit_states
    assert list(states) == ["rotation", "collapse"]
    assert states["rotation"].theta < states["collapse"].theta
    assert states["rotation"].beta == states["collapse"].beta
    numbers = both.update(seen | {"state": [2] * 2 + [1] * 5 + [0] * 3}, beta_model=0.3)
    assert numbers.theta == curve.theta
    alone = both.update(SEEN, beta_model=0.3)
    assert list(alone.limit_states) == ["collapse"]


@pytest.mark.parametrize(
    ("seen", "levels", "words"),
    [
        (SEEN | {"median": 0.004}, (), "contradicts"),
        (
            {"state": ["survived"], "median": 0.05, "tau": 0.4, "phi": 0.1},
            (),
            "hardly anything",
        ),
        (SEEN | {"tau": 0.4}, (0.1, 0.25), "highest level of the study is 0.25"),
    ],
)
def test_what_was_learnt_from_the_prior_alone_is_said(seen, levels, words):
    with pytest.warns(UserWarning, match=words):
        replace(PRIOR, levels=levels).update(seen, beta_model=0.3)


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        ({}, {"beta_model": None}, "beta_model must be given"),
        ({}, {"beta_model": 0.7}, "lies between 0 and beta, 0.5"),
        (
            {"state": "burnt"},
            {},
            "the table: column 'state' has 'burnt', which is not known; known are survived",
        ),
        ({"median": -0.3}, {}, "the table: column 'median' has -0.3; from 1e-09 to"),
        ({"median": "x"}, {}, "the table: column 'median': could not"),
        ({"medium": 1}, {}, "column 'medium' is not known; known are state"),
        (
            {"median": None, "median [m]": 1},
            {},
            r"column 'median' is in m; intensities must be in g",
        ),
        ({"median [g]": 1}, {}, "is there twice"),
        ({"tau": None}, {}, "the table has no column 'tau'; it needs"),
        ({"tau": None, "phi": None, "sd": 0.4}, {}, "share is None"),
        ({"lon": 13.0}, {}, "no column 'lat'"),
        ({}, {"shakemap": ["grid.xml"]}, "leave out stations and median"),
        (FAR, {"length": -1.0}, "length is -1.0"),
    ],
)
def test_refusals(change, options, words):
    seen = {key: value for key, value in (KNOWN | change).items() if value is not None}
    with pytest.raises(InputError, match=words):
        updated(PRIOR, seen, **({"beta_model": 0.3} | options))


def test_another_measure_needs_its_length():
    with pytest.raises(InputError, match="length is None"):
        replace(PRIOR, measure="PGV").update(FAR, beta_model=0.3)
    with pytest.warns(UserWarning, match="hardly anything"):
        replace(PRIOR, measure="Sa(0.5)").update(FAR, beta_model=0.3)


def test_draws_without_an_end_do_no_harm(monkeypatch):
    """Curves of a few records that hardly collapse have some."""
    draws = Curve.draws

    def some_endless(curve, seed, number):
        theta, beta = draws(curve, seed, number)
        theta[::1000] = np.inf
        return theta, beta

    expected = PRIOR.update(SEEN, beta_model=0.5)
    monkeypatch.setattr(Curve, "draws", some_endless)
    after = PRIOR.update(SEEN, beta_model=0.5)
    assert after.theta == pytest.approx(expected.theta, rel=0.01)
