"""All of a frame belongs to one instant: positions, velocities and reactions, in every method."""

import numpy as np
import pytest

import archfrag as af
from tests.physics.audit import g

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)
TIME = np.arange(0.0, 0.5, 1e-3)
# Smooth while the arch moves on its four hinges.
PUSH = af.Motion(0.55 * g * np.sin(2.0 * np.pi * TIME / 1.2), 1e-3)


def errors_of(method, **options):
    """Of velocities against positions, and of the forces on each voussoir against its momentum.

    Returns
    -------
    velocity : float
        Over the largest velocity.
    force : float
        Over the weight.
    """
    history = af.simulate(
        ARCH, PUSH, method=method, history=True, follow=0.0, **options
    ).history.drop_duplicates("time")
    time = history.time.values
    place, speed = history.displacement.values, history.velocity.values
    force = history.reaction.values
    mass = ARCH.chain.mass
    change = (place[2:] - place[:-2]) / (time[2:] - time[:-2])[:, None, None]
    gain = (speed[2:] - speed[:-2]) / (time[2:] - time[:-2])[:, None, None]
    shake = np.interp(time[1:-1], PUSH.time, PUSH.acceleration)
    given = force[1:-1, :-1] - force[1:-1, 1:]
    given[:, :, 0] -= mass * shake[:, None]
    given[:, :, 1] -= mass * g
    even = np.abs(np.diff(time[1:]) - np.diff(time[:-1])) < 1e-9
    moves = even & (time[1:-1] > 0.30) & (time[1:-1] < 0.45)
    assert moves.sum() > 30
    fastest = np.abs(speed).max()
    return (
        np.abs(change - speed[1:-1])[moves].max() / fastest,
        np.abs(given - gain * mass[:, None])[moves].max() / (mass.sum() * g),
    )


def test_steps_are_off_by_the_square_of_the_step():
    coarse, fine = (np.array(errors_of("time_stepping", dt=dt)) for dt in (4e-3, 2e-3))
    assert (fine < 2e-3).all()
    assert (fine < np.maximum(0.35 * coarse, 1e-9)).all()


@pytest.mark.parametrize(
    ("method", "options"), [("event_driven", {"rtol": 1e-8}), ("auto", {"rtol": 1e-5})]
)
def test_methods_that_locate_events_are_off_by_the_interval_of_frames(method, options):
    velocity, force = errors_of(method, **options)
    assert velocity < 1e-4
    assert force < 1e-4


def test_frames_at_rest_hold_the_reactions_of_rest():
    for method in ("time_stepping", "event_driven"):
        history = af.simulate(
            ARCH, PUSH, scale=0.1, method=method, history=True, follow=0.0
        ).history
        force = history.reaction.values[0]
        lifted = force[:-1] - force[1:]
        np.testing.assert_allclose(lifted[:, 1], ARCH.chain.mass * g, rtol=1e-6)
        np.testing.assert_allclose(lifted[:, 0], 0.0, atol=1e-6 * ARCH.chain.mass.sum() * g)
