"""All of a frame belongs to one instant: positions, velocities and reactions, in every method."""

import numpy as np
import pytest

import archfrag as af
from tests.validation.scenes import g, oppenheim, sampled

ARCH = oppenheim()
# Smooth while the arch moves on its four hinges.
PUSH = sampled(lambda t: 0.55 * np.sin(2.0 * np.pi * t / 1.2), 0.5, dt=1e-3)


def frames(method, scale=1.0, **options):
    return af.simulate(
        ARCH, PUSH, scale=scale, method=method, history=True, follow=0.0, **options
    ).history.drop_duplicates("time")


def errors_of(method, **options):
    """Of velocities against positions, over the largest velocity, and of the forces on each
    voussoir against its momentum, over the weight.
    """
    history = frames(method, **options)
    mass = ARCH.chain.mass[:, None]
    time = history.time.values
    speed = history.velocity.values
    span = (time[2:] - time[:-2])[:, None, None]
    change, gain = (
        (x[2:] - x[:-2]) / span for x in (history.displacement.values, speed)
    )
    shake = np.interp(time[1:-1], PUSH.time, PUSH.acceleration)[:, None]
    given = -np.diff(history.reaction.values[1:-1], axis=1)
    given -= mass * np.stack(np.broadcast_arrays(shake, g), axis=-1)
    even = np.abs(np.diff(time, 2)) < 1e-9
    moves = even & (time[1:-1] > 0.30) & (time[1:-1] < 0.45)
    assert moves.sum() > 30
    velocity = np.abs(change - speed[1:-1])[moves].max() / np.abs(speed).max()
    return np.array(
        [velocity, np.abs(given - gain * mass)[moves].max() / (mass.sum() * g)]
    )


def test_steps_are_off_by_the_square_of_the_step():
    coarse, fine = (errors_of("time_stepping", dt=dt) for dt in (4e-3, 2e-3))
    assert (fine < 2e-3).all()
    assert (fine < np.maximum(0.35 * coarse, 1e-9)).all()


@pytest.mark.parametrize(("method", "rtol"), [("event_driven", 1e-8), ("auto", 1e-5)])
def test_methods_that_locate_events_are_off_by_the_interval_of_frames(method, rtol):
    assert (errors_of(method, rtol=rtol) < 1e-4).all()


@pytest.mark.parametrize("method", ["time_stepping", "event_driven"])
def test_frames_at_rest_hold_the_reactions_of_rest(method):
    lifted = -np.diff(frames(method, 0.1).reaction.values[0], axis=0)
    weight = ARCH.chain.mass * g
    np.testing.assert_allclose(lifted[:, 1], weight, rtol=1e-6)
    np.testing.assert_allclose(lifted[:, 0], 0.0, atol=1e-6 * weight.sum())
