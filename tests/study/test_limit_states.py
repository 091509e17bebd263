"""Limit states of a study: the estimator of collapse, the order of the data, and no copies."""

import numpy as np
import pytest

from archfrag.fragility.verdicts import Verdict
from archfrag.study.answer.curves import curve_of, limit_states, runs_of_cube
from tests.report import synthetic

KEYS = {"residual": 0.01, "rotation": 0.5}
N = 24


def states_of(design="stripes", events=(), left=0.004, **medians):
    """Limit states of an arch whose runs exceed each from a median on, and collapse from 4 on."""
    cube = synthetic.cube(items=synthetic.motions(N), n_level=15)
    z = 0.4 * np.random.default_rng(6).standard_normal((N, 1))
    level = cube["intensity"].values

    def exceeds(median):
        return (median * np.exp(z) < level)[None]

    medians = {"rotation": 3.0, "residual": 5.0, "motion": 1.2, "impact": 1.5, **medians}
    of = {name: exceeds(median) for name, median in medians.items()}
    dims, fell = cube["verdict"].dims, exceeds(4.0)
    cube = cube.assign(
        verdict=(dims, np.where(fell, Verdict.COLLAPSED, Verdict.SURVIVED).astype(np.int8)),
        openings=(dims, of["motion"].astype(int)), slides=(dims, 0 * of["motion"]),
        impacts=(dims, of["impact"].astype(int)),
        lost_contact_time=(dims, np.where(fell, 1.0, np.nan)),
        residual_displacement=(dims, np.where(fell | of["residual"], 0.1, left)),
        peak_rotation=(dims, np.where(of["rotation"], 0.2, 0.0)),
        static_limit=("arch", [0.2]), joint_length=("arch", [1.0]),
        measure=["PGA"], measure_exponent=("measure", [1.0]),
        record_measure=(("record", "measure"), np.ones((N, 1))),
    )  # fmt: skip
    if len(events):
        cube = cube.assign(event=("record", np.asarray(events).astype(str)))
    cube.attrs["archfrag_design"] = f'{{"kind": "{design}"}}'
    (runs,) = runs_of_cube(cube).values()
    collapse = curve_of(runs, 0.9)
    found = limit_states(runs, KEYS, collapse)
    collapse.more["limit_states"] = found
    return collapse, {each.state: each for each in collapse.states}, found


def width(answer):
    return np.log(answer.theta_interval[1] / answer.theta_interval[0])


@pytest.mark.parametrize("events", [(), np.arange(N) // 3])
def test_intervals_are_of_the_size_of_those_of_collapse(events):
    collapse, states, _ = states_of(events=events)
    own = states["rotation"]
    assert own.theta == pytest.approx(0.75 * collapse.theta, rel=0.05)
    assert width(own) == pytest.approx(width(collapse), rel=0.2)
    assert np.diff(own.beta_interval) == pytest.approx(np.diff(collapse.beta_interval), rel=0.25)
    assert own.n_independent == pytest.approx(collapse.n_independent, rel=0.1)
    assert len(own.lower) == len(collapse.lower)
    assert width(own) > 0.2


def test_a_state_that_no_run_exceeds_short_of_collapse_has_no_curve():
    _, states, _ = states_of()
    for name in ("residual", "contact lost"):
        assert states[name].reason == (
            "no run exceeds it short of collapse, so it has no curve of its own"
        )


@pytest.mark.parametrize(
    ("residual", "order"),
    [(2.0, ["residual", "rotation"]), (3.5, ["rotation", "residual"])],
)
def test_states_are_in_the_order_of_the_data(residual, order):
    _, states, found = states_of(residual=residual)
    known = [name for name, own in states.items() if own.fitted]
    assert known == ["motion", "impact", *order, "collapse"]
    thetas = [states[name].theta for name in known]
    assert thetas == sorted(thetas)
    assert states["residual"].theta == pytest.approx(residual, rel=0.15)
    assert found["message"] == "The curves of the limit states do not cross."


def test_a_search_for_collapse_gives_no_curve_of_lighter_states():
    """It runs levels near the collapse of each record, which biases what lies below."""
    collapse, states, _ = states_of("ida")
    assert "ida chose the levels of the runs by collapse" in states.pop("motion").reason
    assert states.pop("collapse").fit_dict() == collapse.fit_dict()
    assert all("by collapse, which biases it" in own.reason for own in states.values())
