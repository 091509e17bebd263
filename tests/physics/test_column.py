"""Multi-drum column: onset, overturning under a pulse in two parts, and the jump of its mode."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.status import Status
from tests.physics.audit import pulse

EVENT_DRIVEN = {"method": "event_driven", "rtol": 1e-4}
TIME_STEPPING = {"method": "time_stepping", "dt": 5e-4}
HEIGHT = np.append(np.arange(8) * 0.82, 5.95)
WIDTH = 1.11 - 0.21 * HEIGHT / 5.95


def column(friction=np.inf):
    """Seven drums and a top block, tapering: Dimitri, De Lorenzis and Zavarise (2011)."""
    right = np.column_stack([0.5 * WIDTH, HEIGHT])
    return af.Arch.from_joints(
        right, right * [-1.0, 1.0], friction=friction, density=2620.0, free_end=True
    )


def falls(amplitude, duration, options):
    """Whether it has collapsed twenty seconds after the pulse."""
    run = af.simulate(column(), pulse(amplitude, duration), **options)
    assert run.status in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)
    return run.status is Status.COLLAPSED


class TestOnset:
    def test_tips_where_the_body_force_meets_the_edge_of_its_worst_joint(self):
        thickness = np.diff(HEIGHT)
        below, above = WIDTH[:-1], WIDTH[1:]
        mass = 0.5 * (below + above) * thickness
        middle = HEIGHT[:-1] + thickness * (below + 2.0 * above) / (3.0 * (below + above))
        slenderness = [
            0.5 * WIDTH[j] / ((mass[j:] @ middle[j:]) / mass[j:].sum() - HEIGHT[j])
            for j in range(8)
        ]
        start = af.onset(column())
        assert start.plus == pytest.approx(min(slenderness), rel=1e-9)
        assert start.hinges == [(int(np.argmin(slenderness)), "extrados")]


class TestOverturning:
    @pytest.mark.parametrize("options", [EVENT_DRIVEN, TIME_STEPPING])
    def test_jump_of_the_least_amplitude(self, options):
        amplitudes = (0.46, 0.465, 0.47)
        assert not any(falls(amplitude, 0.33, options) for amplitude in amplitudes)
        assert all(falls(amplitude, 0.34, options) for amplitude in amplitudes)

    def test_both_methods_find_the_same_least_amplitude(self):
        for duration, least in ((0.20, 1.4637), (0.33, 0.7825), (0.36, 0.3722)):
            for options in (EVENT_DRIVEN, TIME_STEPPING):
                assert not falls(0.995 * least, duration, options)
                assert falls(1.005 * least, duration, options)
