"""Limit states of a study: the estimator of collapse, the order of the data, and no copies."""

from dataclasses import replace

import numpy as np
import pytest

from archfrag.fragility.verdicts import Verdict
from archfrag.study.answer.curves import curve_of, limit_states, runs_of_cube
from archfrag.study.designs import Grid, Ida, ask
from tests.report import synthetic

KEYS = {"residual": 0.01, "rotation": 0.5}
N = 24


def states_of(design="stripes", events=(), left=0.004, **medians):
    """Limit states of an arch whose runs exceed each from a median on, and collapse from 4 on."""
    cube = synthetic.cube(items=synthetic.motions(N), n_level=15)
    z = 0.4 * np.random.default_rng(6).standard_normal((N, 1))
    level = cube["intensity"].values
    collapse = medians.pop("collapse", 4.0)

    def exceeds(median):
        return (median * np.exp(z) < level)[None]

    medians = {
        "rotation": 3.0,
        "residual": 5.0,
        "motion": 1.2,
        "impact": 1.5,
        **medians,
    }
    of = {name: exceeds(median) for name, median in medians.items()}
    dims = cube["verdict"].dims
    fell = exceeds(collapse)
    verdict = np.where(fell, Verdict.COLLAPSED, Verdict.SURVIVED).astype(np.int8)
    if design == "ida":
        grid = Grid(0, np.arange(N), level, np.ones(N), 1.0)
        requests = {0: Ida(kind="ida").requests(grid)}
        ask(requests, lambda cases: verdict[0, cases["record"], cases["place"]])
        verdict = grid.seen[None]
    cube = cube.assign(
        verdict=(dims, verdict),
        openings=(dims, of["motion"].astype(int)),
        slides=(dims, 0 * of["motion"]),
        impacts=(dims, of["impact"].astype(int)),
        lost_contact_time=(dims, np.where(fell, 1.0, np.nan)),
        residual_displacement=(dims, np.where(fell | of["residual"], 0.1, left)),
        peak_rotation=(dims, np.where(of["rotation"], 0.2, 0.0)),
        static_limit=("arch", [0.2]),
        joint_length=("arch", [1.0]),
        measure=["PGA"],
        measure_exponent=("measure", [1.0]),
        record_measure=(("record", "measure"), np.ones((N, 1))),
    )
    if len(events):
        cube = cube.assign(event=("record", np.asarray(events).astype(str)))
    cube.attrs["archfrag_design"] = f'{{"kind": "{design}"}}'
    (runs,) = runs_of_cube(cube).values()
    collapse = curve_of(runs, 0.9)
    states, crossings = limit_states(runs, KEYS, collapse)
    collapse = replace(collapse, states=states)
    return collapse, {each.state: each for each in states}, crossings


def width(answer):
    return np.log(answer.theta_interval[1] / answer.theta_interval[0])


@pytest.mark.parametrize("events", [(), np.arange(N) // 3])
def test_intervals_are_of_the_size_of_those_of_collapse(events):
    collapse, states, _ = states_of(events=events)
    own = states["rotation"]
    assert own.theta == pytest.approx(0.75 * collapse.theta, rel=0.05)
    assert width(own) == pytest.approx(width(collapse), rel=0.2)
    assert np.diff(own.beta_interval) == pytest.approx(
        np.diff(collapse.beta_interval), rel=0.25
    )
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
    _, states, crossings = states_of(residual=residual)
    known = [name for name, own in states.items() if own.fitted]
    assert known == ["motion", "impact", *order, "collapse"]
    thetas = [states[name].theta for name in known]
    assert thetas == sorted(thetas)
    assert states["residual"].theta == pytest.approx(residual, rel=0.15)
    assert crossings == "The curves of the limit states do not cross."


def test_a_search_for_collapse_gives_lighter_states_too():
    """By the likelihood of both states: by itself the median would be some 10 % too low."""
    _, every, _ = states_of()
    collapse, states, _ = states_of("ida")
    own = states["rotation"]
    whole = every["rotation"]
    assert own.theta == pytest.approx(whole.theta, rel=0.05)
    assert whole.theta_interval[0] < own.theta < whole.theta_interval[1]
    assert width(whole) < width(own) < 1.6 * width(whole)
    assert own.n_independent == collapse.n_independent
    assert len(own.lower) == len(collapse.lower)
    assert "lognormal together" in own.assumptions
    assert collapse.limit_states["rotation"].theta == own.theta


def test_a_state_far_below_collapse_has_no_curve_by_a_search():
    _, states, _ = states_of("ida", motion=0.6)
    assert states["motion"].reason.startswith(
        "ida chose the levels of the runs by collapse: only"
    )
    assert (
        "% of the records have a run below it, and 30 % are needed"
        in states["motion"].reason
    )


def test_records_of_one_earthquake_count_as_fewer_in_a_search():
    z = np.random.default_rng(6).standard_normal(N)
    _, alone, _ = states_of("ida")
    _, shared, _ = states_of("ida", events=np.argsort(np.argsort(z)) // 3)
    assert shared["rotation"].n_independent < alone["rotation"].n_independent
    assert width(shared["rotation"]) > width(alone["rotation"])


def test_a_state_without_a_curve_of_collapse_is_not_guessed():
    _, states, _ = states_of("ida", collapse=40.0)
    assert not states["rotation"].fitted
    assert (
        "its curve needs one of collapse, and nothing bounds"
        in states["rotation"].reason
    )
