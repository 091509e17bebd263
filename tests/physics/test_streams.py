"""Runs that go on side by side while others are added: each has the results that it has alone."""

import itertools

import numpy as np
import pytest

import archfrag as af
from archfrag.physics import shared
from archfrag.physics.ground import MotionPlaces, grounds_of
from archfrag.physics.status import Count
from archfrag.physics.steps.run import PLACES
from archfrag.simulation.simulate import Stream, results_of_runs

RING = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)
JOINTS = np.tile([1e10, 1e10, 0.05, 0.0], (RING.n_joint, 1))
BRIDGE = af.Bridge([RING, RING], piers={"height": 5.0, "width": 4.0})
KINDS = {
    "rigid": (RING, {}),
    "fixed steps": (RING, {"method": "time_stepping", "dt": 2e-3}),
    "by events": (af.Block(0.6, 1.8, friction=0.4), {"method": "event_driven"}),
    "tied": (RING.tied(level=6.0, area=5e-4), {}),
    "faces": (RING.changed(chain=RING.chain._replace(joint=JOINTS)), {}),
    "spans": (BRIDGE, {}),
    "waves": (BRIDGE, {"wave_speed": -900.0}),
}
FACTORS = (0.01, 3.0, 5.0, 8.0)


def waves(sizes=(90, 2, 160, 40, 120)):
    """Motions of unlike steps and lengths; the last one comes after another."""
    rng = np.random.default_rng(5)
    made = [
        af.Motion(6.0 * np.hanning(n) * rng.normal(size=n), 0.02 + 1e-3 * k)
        for k, n in enumerate(sizes)
    ]
    return [*made, made[0].then(made[0].scaled(0.5), 0.3)]


def streamed(arch, pairs, most, **given):
    """Results by number of run; at most `most` are held, those of each call are added at once."""
    stream = Stream(arch, **given)
    todo = iter(enumerate(pairs))
    found = {}
    while True:
        for number, pair in itertools.islice(todo, most - stream.held):
            stream.add(number, *pair)
        if not stream.held:
            return found
        keys, results, wall_time, starts = stream.go_on()
        assert (wall_time > 0.0).all()
        for row, key in enumerate(keys):
            found[key] = [values[row] for values in results], starts[row]


def assert_equal(found, expected, starts):
    assert sorted(found) == list(range(len(starts)))
    for row, (values, start) in found.items():
        assert start == starts[row]
        for name, value, whole in zip(expected._fields, values, expected):
            np.testing.assert_array_equal(value, whole[row], err_msg=f"{row} {name}")


@pytest.mark.parametrize("most", [1, 9, PLACES])
@pytest.mark.parametrize("kind", KINDS)
def test_a_run_is_the_same_whatever_goes_beside_it(kind, most):
    arch, given = KINDS[kind]
    pairs = list(itertools.product(waves(), FACTORS))
    np.random.default_rng(most).shuffle(pairs)
    given = {"follow": 2.0, **given}
    expected, _, starts = results_of_runs(arch, *zip(*pairs), **given)
    assert len(set(expected.status.tolist())) > 1
    assert_equal(streamed(arch, pairs, most, **given), expected, starts)


def test_eight_lanes_and_four_give_the_same_bits(monkeypatch):
    pairs = list(itertools.product(waves(), FACTORS))
    made = []
    for count in "48":
        monkeypatch.setenv("ARCHFRAG_LANES", count)
        assert Stream(RING).lanes == int(count)
        made.append(results_of_runs(RING, *zip(*pairs))[0])
    for name, four, eight in zip(made[0]._fields, *made):
        np.testing.assert_array_equal(four, eight, err_msg=name)


def test_inaccurate_runs_are_made_again(monkeypatch):
    monkeypatch.setattr(shared, "LEAST_ENERGY", 1e-5)
    monkeypatch.setattr(shared, "ENERGY_ALLOWED", 1e-2)
    pairs = list(itertools.product(waves(), FACTORS))
    expected, _, starts = results_of_runs(RING, *zip(*pairs))
    assert set(expected.count[:, Count.REFINED].tolist()) >= {0, 1}
    assert_equal(streamed(RING, pairs, 9), expected, starts)


def test_motions_come_and_go():
    rng = np.random.default_rng(2)
    places = MotionPlaces(3)
    held = {}
    for turn in range(40):
        n, far = int(rng.integers(2, 50)), turn > 20 and turn % 3 > 0
        given = rng.normal(size=n), rng.normal(size=n) if turn % 2 else None, 0.01 * n
        apart = rng.normal(size=(n, 2, 2)) if far else None
        one = grounds_of([(*given, apart)], [float(turn)])
        number = places.put(one, list(held))
        assert number not in held
        assert places.put(one, [*held, number]) == number
        held[number] = one
        whole = places.grounds
        for other, own in held.items():
            rows = slice(*whole.first[other : other + 2])
            for name in (
                "horizontal",
                "vertical",
                "impulse_x",
                "impulse_y",
                "next_break",
            ):
                np.testing.assert_array_equal(
                    getattr(whole, name)[rows], getattr(own, name)
                )
            if own.far.size or whole.far.size:
                np.testing.assert_array_equal(
                    whole.far[rows], own.far if own.far.size else 0.0
                )
            assert (whole.time_step[other], whole.noted[other]) == (
                own.time_step[0],
                own.noted[0],
            )
        if len(held) == 2:  # one place is left
            del held[int(rng.choice(list(held)))]
