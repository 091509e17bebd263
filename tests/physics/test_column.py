"""Multi-drum column: onset, overturning under a pulse in two parts, and the jump of its mode."""

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.status import Status
from tests.physics.audit import g, pulse

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

    @pytest.mark.parametrize("options", [EVENT_DRIVEN, TIME_STEPPING])
    def test_nothing_moves_below_it(self, options):
        limit = af.onset(column()).plus
        assert af.simulate(column(), pulse(0.999 * limit, 0.3), **options).steps == 0
        assert af.simulate(column(), pulse(1.01 * limit, 0.3), **options).peak_rotation > 1e-5

    @pytest.mark.parametrize("options", [EVENT_DRIVEN, TIME_STEPPING])
    def test_slide_on_a_smooth_base_is_that_of_newmark(self, options):
        friction, amplitude, duration = 0.1, 0.4, 0.2
        arch = column(np.r_[friction, np.full(7, 0.5)])
        run = af.simulate(arch, pulse(amplitude, duration), history=True, **options)
        # There until it stops, back while the ground still pushes, and on until it stops again.
        ahead, behind = amplitude - friction, 0.5 * amplitude + friction
        there = 0.5 * ahead * duration**2 * (1.0 + ahead / behind)
        pushed = duration * (2.0 - ahead / behind)
        rate = 0.5 * amplitude - friction
        back = 0.5 * rate * pushed**2 * (1.0 + rate / friction)
        weight = arch.chain.mass.sum() * g
        assert run.status is Status.STANDING
        assert run.history.displacement.values[-1, :, 0] == pytest.approx(
            np.full(8, g * (back - there)), rel=2e-3
        )
        assert run.energy["friction"] == pytest.approx(
            -friction * weight * g * (there + back), rel=2e-3
        )


class TestOverturning:
    # Least amplitudes of UDEC, LMGC90 and HybriDFEM, least and largest [g].
    @pytest.mark.parametrize(
        ("duration", "low", "high"),
        [(0.15, 2.05, 2.20), (0.30, 0.87, 0.88), (0.40, 0.29, 0.31), (0.60, 0.23, 0.25)],
    )
    def test_least_amplitude_is_within_three_codes(self, duration, low, high):
        """By time stepping; tests/validation compares the event-driven method with each code."""
        assert not falls(0.95 * low, duration, TIME_STEPPING)
        assert falls(1.05 * high, duration, TIME_STEPPING)

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
