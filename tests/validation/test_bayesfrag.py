"""Curves updated by a survey, against BayesFrag's tutorial (bayesfrag/README.md)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import gamma, invgamma, norm

from archfrag.fragility.posterior import gridded
from archfrag.fragility.update import updated

HERE = Path(__file__).parent / "bayesfrag"
KM = 2.0 * np.pi * 6371.0 / 360.0  # of a degree at the equator


def priors():
    """The tutorial's priors of theta / beta in ln and of beta, as curves of two states."""
    beta = np.geomspace(0.15, 3.0, 90)
    eta = np.linspace(-6.5, 6.5, 521)
    first = norm.pdf(eta, np.log(0.2), 1.5)
    step = np.arange(0.5, 261) * (eta[1] - eta[0])
    both = np.convolve(first, gamma.pdf(step, 1.5, scale=1 / 2.5))[: eta.size]
    made = []
    for density, state in ((first, "slight"), (both, "collapse")):
        log_theta = beta[:, None] * eta
        # Of equal steps of ln beta, and of one step of ln theta.
        weight = (invgamma.pdf(beta, 2.5) * beta)[:, None] * density
        curve = gridded(beta, log_theta, weight, (1, 1)).curve
        made.append(replace(curve, state=state, measure="PGA", unit="g", si=9.80665))
    return replace(made[1], states=(made[0],))


def survey(name, **columns):
    """A table of the tutorial, its coordinates [km] put beside the equator."""
    table = pd.read_csv(HERE / f"{name}_withIM_PGA.csv")
    logs = {"median": np.exp(table["mu_logIM"])}
    places = {"lon": table["x"] / KM, "lat": table["y"] / KM}
    spread = {name: table[f"{name}_logIM"] for name in ("tau", "phi")}
    more = {own: change(table[head]) for own, (head, change) in columns.items()}
    return pd.DataFrame(logs | places | spread | more)


def test_thetas_and_beta_are_those_of_the_tutorial():
    """With intensities fixed beta would be 0.92. All of beta is each building's own there."""
    sites = survey("survey", state=("DamageState", np.asarray))
    stations = survey("stations", observed=("obs_logIM", np.exp))
    prior = priors()
    curve = updated(prior, sites, prior.beta, stations=stations)
    slight = curve.limit_states["slight"]
    _, beta = curve.draws(1, 20_000)
    assert abs(beta.mean() - 0.65) < 0.03  # the tutorial gives means
    assert slight.beta == pytest.approx(curve.beta, rel=0.02)
    assert abs(slight.theta - 0.1925) < 0.015
    assert 0.43 < curve.theta < 1.09
    low, high = curve.beta_interval
    assert 0.45 < low < 0.54
    assert 0.78 < high < 0.95
