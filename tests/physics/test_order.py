"""Orders of convergence of all methods, in smooth motion and through an impact.

An arch of three voussoirs on its four hinges: the motion that all methods can follow, whatever
else they assume. Under a push that fades it swings out until 0.3 s; pushed back it lands with all
four joints at once at about 0.43 s and swings to the other side, four hinges again.
"""

import functools
import inspect

import numpy as np
import pytest

import archfrag as af
from archbench.baselines import SHARED, is_available, variant
from archfrag.physics.methods.registry import known_methods
from archfrag.physics.status import Status

g = 9.80665
SAMPLE = 2.5e-4
SMOOTH = 0.28
IMPACT = 0.6
ARCH = af.Arch.circular(10.0, 1.5, 157.5, 3, 0.7)
STEPS = {"dt": (8e-3, 4e-3, 2e-3, 1e-3)}
SHORT_STEPS = {"dt": (1e-4, 5e-5, 2.5e-5, 1.25e-5)}
TOLERANCES = {"rtol": (1e-8, 1e-9, 1e-10)}
# Setting that is refined; order in smooth motion and through an impact; tolerance of a solver.
# Steps that do not know of impacts are of first order there. Adaptive methods are proportional to
# their tolerance. Damping of the penalty method enters by the rate of half a step ago.
ORDERS = {
    "time_stepping": (STEPS, 2.0, 1.0, {}),
    "gauss_seidel": (STEPS, 2.0, 1.0, {"sweep_tolerance": 1e-12}),
    "quadratic_programme": (STEPS, 2.0, 1.0, {"solver_tolerance": 1e-11}),
    "penalty": (SHORT_STEPS, 1.0, 1.0, {}),
    "event_driven": (TOLERANCES, 1.0, 1.0, {}),
    "auto": (TOLERANCES, 1.0, 1.0, {}),
    "four_link": (TOLERANCES, 1.0, 1.0, {}),
}
# Where in its step an impact falls is chance: the error of one run is the first-order one times
# anything up to one, and means over three motions leave several tenths of the order. Step control
# leaves as much in smooth motion, which takes it some ten steps only.
MARGIN = (0.3, 0.4)
AMPLITUDES = (0.43, 0.44, 0.45)
SIGNATURE = [
    "chain",
    "grounds",
    "factor",
    "position",
    "velocity",
    "from_rest",
    "options",
    "frames",
    "log",
]


def state_at(time, method, amplitude, **options):
    """Displacements and rotations at an instant, by the cubic through the frames beside it."""
    samples = np.arange(round((time + 0.02) / SAMPLE) + 1) * SAMPLE
    push = amplitude * np.where(samples < 0.3 - 1e-9, 1.1 - 0.7 * samples, -0.5)
    run = af.simulate(
        ARCH,
        af.Motion(push * g, SAMPLE),
        method=method,
        history=True,
        follow=0.0,
        **options,
    )
    assert run.status is Status.UNFINISHED
    history = run.history.drop_duplicates("time")
    frames = history.isel(time=np.abs(history.time.values - time).argsort()[:4])
    moved = frames.displacement.values.reshape(4, -1)
    places = np.hstack([moved, frames.rotation.values])
    away = frames.time.values - time
    return np.linalg.solve(np.vander(away / np.abs(away).max()), places)[-1]


@functools.cache
def reference(time, method, amplitude):
    """The motion that a method converges to, tightly resolved."""
    if (
        method == "penalty"
    ):  # its joints are springs: its own motion with much shorter steps
        return state_at(time, method, amplitude, dt=1.5e-6)
    return state_at(time, "event_driven", amplitude, rtol=1e-12)


def mean_errors(method, time, amplitudes):
    """Relative errors for each value of the setting that is refined, means over motions."""
    ((name, values),), *_, settings = ORDERS[method][0].items(), ORDERS[method][3]
    errors = np.zeros(len(values))
    for amplitude in amplitudes:
        exact = reference(time, method, amplitude)
        for i, value in enumerate(values):
            tuned = variant(method, **settings) if settings else method
            found = state_at(time, tuned, amplitude, **{name: value})
            errors[i] += (
                np.abs(found - exact).max() / np.abs(exact).max() / len(amplitudes)
            )
    return np.array(values), errors


def test_every_method_has_an_order_and_the_common_signature():
    assert set(ORDERS) == set(known_methods())
    for info in known_methods().values():
        run = info.load()
        parameters = list(inspect.signature(getattr(run, "py_func", run)).parameters)
        own = [each.name for each in info.parameters if each.name not in SHARED]
        assert parameters == [*SIGNATURE, *own]


@pytest.mark.parametrize("method", known_methods())
@pytest.mark.parametrize("impact", [False, True])
def test_order(method, impact):
    if not is_available(known_methods()[method]):
        pytest.skip(f"needs {known_methods()[method].needs}")
    setting, *orders, _ = ORDERS[method]
    time, amplitudes = (IMPACT, AMPLITUDES) if impact else (SMOOTH, AMPLITUDES[:1])
    values, errors = mean_errors(method, time, amplitudes)
    order = np.polyfit(np.log(values), np.log(errors), 1)[0]
    assert order > orders[impact] - MARGIN[impact]
    if "rtol" in setting:
        assert (errors < 10.0 * values).all()
