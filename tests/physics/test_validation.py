"""Published and independently computed values, and the laws behind them."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as g
from archfrag.errors import StabilityError
from archfrag.mechanics.status import Status


def pulse(amplitude, duration, span=None):
    """Ground acceleration +a for `duration`, -a/2 for twice as long [g, s]."""
    time = np.arange(0.0, 3.0 * duration + 0.01, 1e-4)
    shape = np.where(time < duration - 1e-9, 1.0, np.where(time < 3.0 * duration - 1e-9, -0.5, 0))
    return af.Motion(amplitude * g * shape, 1e-4)


def oppenheim(voussoirs=7, **options):
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs, **{"friction": 0.7, **options})


def limit_analysis(arch, sense):
    """Largest load factor by a linear programme over all joint forces (static theorem)."""
    chain = arch.chain
    n_body, n_joint = arch.n_voussoir, arch.n_joint
    first = [
        chain.face_after[j] + (chain.centroid[j] if j < n_body else 0.0) for j in range(n_joint)
    ]
    # Unknowns: normal forces at both ends of each joint, its shear, and the load factor.
    balance = np.zeros((3 * n_body, 3 * n_joint + 1))
    load = np.zeros(3 * n_body)
    friction_rows = []
    scale = chain.mass.sum() * g
    for j, (inner, outer) in enumerate(first):
        tangent = (outer - inner) / np.linalg.norm(outer - inner)
        normal = np.array([tangent[1], -tangent[0]])
        for body, sign in ((j, 1.0), (j - 1, -1.0)):
            if not 0 <= body < n_body:
                continue
            rows = slice(3 * body, 3 * body + 3)
            places = ((inner, normal), (outer, normal), (inner, tangent))
            for k, (point, direction) in enumerate(places):
                arm = point - chain.centroid[body]
                moment = arm[0] * direction[1] - arm[1] * direction[0]
                balance[rows, 3 * j + k] = sign * np.array([*direction, moment])
        if np.isfinite(chain.friction[j]):
            for side in (1.0, -1.0):
                row = np.zeros(3 * n_joint + 1)
                row[3 * j : 3 * j + 2] = -chain.friction[j]
                row[3 * j + 2] = side
                friction_rows.append(row)
    for body in range(n_body):
        load[3 * body + 1] = chain.mass[body] * g / scale
        balance[3 * body, -1] = -chain.mass[body] * g / scale
    objective = np.zeros(3 * n_joint + 1)
    objective[-1] = -sense
    bounds = [(0, None), (0, None), (None, None)] * n_joint + [(None, None)]
    found = linprog(
        objective,
        A_ub=np.array(friction_rows) if friction_rows else None,
        b_ub=np.zeros(len(friction_rows)) if friction_rows else None,
        A_eq=balance,
        b_eq=load,
        bounds=bounds,
        method="highs",
    )
    if found.status == 3:
        return sense * math.inf
    return found.x[-1] if found.success else math.nan


class TestStaticTheorem:
    @pytest.mark.parametrize(
        ("shape", "voussoirs", "friction", "sector", "expected"),
        [
            ((10.0, 1.5, 157.5), 7, np.inf, True, 0.37001),
            ((10.0, 1.5, 157.5), 7, np.inf, False, 0.37361),
            ((10.0, 1.5, 157.5), 1000, np.inf, True, 0.3534),
            ((10.0, 1.0, 120.0), 1000, np.inf, True, 0.5800),
            ((10.0, 2.0, 140.0), 1000, np.inf, True, 0.7711),
            ((10.0, 1.2, 180.0), 1000, np.inf, True, 0.0461),
            ((10.0, 1.5, 157.5), 7, 0.4, False, 0.2570),
        ],
    )
    def test_onset_of_the_reference_arches(self, shape, voussoirs, friction, sector, expected):
        start = af.onset(af.Arch.circular(*shape, voussoirs, friction, sector=sector))
        assert start.plus == pytest.approx(expected, abs=1e-4)
        assert start.minus == pytest.approx(start.plus, rel=1e-9)

    def test_hinges_of_oppenheims_arch(self):
        start = af.onset(oppenheim())
        sides = ["extrados", "intrados", "extrados", "intrados"]
        assert start.hinges == list(zip([0, 2, 4, 7], sides))
        assert start.hinges_minus == list(zip([0, 3, 5, 7], sides[1:] + sides[:1]))
        assert start.sliding == []

    def test_thrust_passes_through_the_hinges_and_stays_in_the_joints(self):
        arch = oppenheim()
        start = af.onset(arch)
        for joint, side in start.hinges:
            corner = (arch.extrados if side == "extrados" else arch.intrados)[joint]
            assert start.thrust_plus[joint] == pytest.approx(corner, abs=1e-6)
        radius = np.hypot(*start.thrust.T)
        assert (radius >= 9.25 - 1e-9).all()
        assert (radius <= 10.75 + 1e-9).all()

    def test_equals_a_linear_programme_over_all_joint_forces(self):
        rng = np.random.default_rng(5)
        compared = 0
        for _ in range(60):
            n = int(rng.integers(2, 20))
            friction = rng.uniform(0.35, 1.0, n + 1)
            friction[rng.random(n + 1) < 0.3] = np.inf
            arch = af.Arch.circular(
                10.0,
                rng.uniform(1.0, 3.0),
                rng.uniform(60.0, 180.0),
                n,
                friction,
                sector=bool(rng.random() < 0.5),
                dead_load=rng.uniform(0.0, 1e5, n),
            )
            start = af.onset(arch)
            for value, sense in ((start.plus, 1.0), (-start.minus, -1.0)):
                expected = limit_analysis(arch, sense)
                if abs(expected) > 1e3:
                    assert value == sense * math.inf
                    continue
                if math.isnan(expected):
                    assert not start.stands
                    continue
                assert value == pytest.approx(expected, rel=1e-7, abs=1e-9)
                compared += 1
        assert compared > 60

    @pytest.mark.parametrize(
        ("voussoirs", "friction", "sector", "least"),
        [(2000, np.inf, True, 0.1075), (27, np.inf, False, 0.1067), (27, 0.35, False, 0.1512)],
    )
    def test_least_thickness_of_the_semicircle(self, voussoirs, friction, sector, least):
        def stands(ratio):
            arch = af.Arch.circular(10.0, 10 * ratio, 180.0, voussoirs, friction, sector=sector)
            return af.onset(arch).stands

        assert stands(least + 2e-4)
        assert not stands(least - 2e-4)

    def test_no_thickness_stands_below_the_least_friction(self):
        def any_stands(friction):
            return any(
                af.onset(af.Arch.circular(10.0, t, 180.0, 500, friction)).stands
                for t in np.arange(1.0, 4.0, 0.05)
            )

        assert not any_stands(0.3085)
        assert any_stands(0.3100)

    def test_an_arch_that_cannot_stand_is_a_result_of_onset_and_an_error_of_simulate(self):
        thin = af.Arch.circular(10.0, 0.95, 180.0, 27, 0.7)
        assert not af.onset(thin).stands
        with pytest.raises(StabilityError, match="does not stand under its own weight"):
            af.simulate(thin, pulse(0.1, 0.3))

    def test_column_tips_at_its_slenderness_or_slides_at_its_friction(self):
        rocking = af.onset(af.Block(0.2, 1.0, friction=0.8))
        assert (rocking.plus, rocking.minus) == pytest.approx((0.2, 0.2), rel=1e-12)
        assert rocking.hinges == [(0, "extrados")]
        sliding = af.onset(af.Block(0.2, 1.0, friction=0.15))
        assert sliding.plus == pytest.approx(0.15, rel=1e-12)
        assert sliding.sliding == [0]


class TestRest:
    def test_nothing_moves_for_a_minute(self):
        arch = af.Arch.circular(10.0, 1.2, 180.0, 27, 0.7, sector=False)
        still = np.zeros((27, 3))
        for initial in (None, (still, still)):
            response = af.simulate(arch, af.Motion(np.zeros(6001), 0.01), initial=initial)
            assert response.status is Status.STANDING
            assert response.peak_displacement <= 1e-9

    def test_a_motion_inside_the_rest_range_moves_nothing(self):
        arch = oppenheim()
        limit = af.onset(arch).plus
        noise = np.random.default_rng(1).uniform(-1, 1, 2000)
        motion = af.Motion((limit - 1e-9) * g * noise / np.abs(noise).max(), 0.01)
        response = af.simulate(arch, motion)
        assert response.peak_displacement == 0.0
        assert response.steps == 0
        beyond = af.simulate(arch, motion, scale=1.001)
        assert beyond.steps > 0

    def test_vertical_acceleration_acts_through_the_direction_of_the_force(self):
        arch = oppenheim()
        limit = af.onset(arch).plus
        for vertical in (-0.3, 0.0, 0.4):
            steady = np.full(200, 1.0)
            inside = af.Motion(
                0.999 * limit * (1 + vertical) * g * steady, 0.01, vertical * g * steady
            )
            outside = af.Motion(
                1.01 * limit * (1 + vertical) * g * steady, 0.01, vertical * g * steady
            )
            assert af.simulate(arch, inside).steps == 0
            assert af.simulate(arch, outside).steps > 0

    def test_a_ring_too_thin_falls(self):
        thin = af.Arch.circular(10.0, 0.95, 180.0, 27, 0.7, sector=False)
        still = np.zeros((27, 3))
        response = af.simulate(thin, af.Motion(np.zeros(400), 0.01), initial=(still, still))
        assert response.collapsed
        assert 1.1 < response.lost_contact_time < 1.5
        assert response.lost_contact_time <= response.collapse_time < response.end_time


class TestSignorini:
    @pytest.mark.parametrize(
        ("duration", "least", "sweep"),
        [(0.3, 0.6805, (0.66, 0.70)), (0.5, 0.4395, (0.42, 0.46))],
    )
    def test_least_collapsing_pulse(self, duration, least, sweep):
        arch = oppenheim()
        found = next(
            a for a in np.arange(*sweep, 0.0025) if af.simulate(arch, pulse(a, duration)).collapsed
        )
        assert found == pytest.approx(least, rel=0.01)

    @pytest.mark.parametrize(("amplitude", "least"), [(0.5, 0.634), (0.7, 0.365), (1.0, 0.2197)])
    def test_least_duration_of_a_rectangular_pulse(self, amplitude, least):
        arch = oppenheim()

        def collapses(duration):
            time = np.arange(0.0, duration + 0.01, 1e-4)
            motion = af.Motion(np.where(time < duration, amplitude * g, 0.0), 1e-4)
            return af.simulate(arch, motion, dt=2.5e-4).collapsed

        assert collapses(1.01 * least)
        assert not collapses(0.99 * least)

    def test_keystone_before_the_first_impact_at_second_order(self):
        arch = oppenheim(sector=False)
        errors = []
        for dt in (4e-3, 2e-3, 1e-3, 2.5e-4):
            history = af.simulate(
                arch, pulse(0.5, 0.3), method="time_stepping", dt=dt, history=True
            ).history
            key = history.displacement.sel(component="x", voussoir=3)
            errors.append(np.interp([0.2, 0.4], history.time, key))
        assert errors[-1] == pytest.approx([-0.01621, -0.04211], rel=1.5e-3)
        steps = np.abs(np.diff(np.array(errors)[:, 1]))
        assert steps[0] / steps[1] == pytest.approx(4.0, rel=0.15)

    def test_unfinished_is_neither_collapse_nor_survival(self):
        response = af.simulate(oppenheim(), pulse(0.5, 0.3), follow=0.0)
        assert response.status is Status.UNFINISHED
        assert response.collapsed is None

    def test_overturning_sine_of_a_block(self):
        block = af.Block(0.2, 1.0, friction=0.8)
        time = np.arange(0.0, 1.0, 1e-4)
        sine = af.Motion(np.where(time < 0.5, g * np.sin(4.0 * np.pi * time), 0.0), 1e-4)
        assert not af.simulate(block, sine, scale=0.2925).collapsed
        assert af.simulate(block, sine, scale=0.2950).collapsed


class TestImpact:
    def test_housners_ratio(self):
        width, height = 0.2, 1.0
        block = af.Block(width, height, friction=0.8)
        alpha = math.atan(width / height)
        tilt = 0.5 * alpha
        half, up = 0.5 * width, 0.5 * height
        x = half - (half * math.cos(tilt) - up * math.sin(tilt))
        y = half * math.sin(tilt) + up * math.cos(tilt) - up
        state = (np.array([[x, y, -tilt]]), np.zeros((1, 3)))
        fine = af.simulate(
            block, af.Motion(np.zeros(30000), 1e-4), initial=state, dt=1e-4, history=True
        ).history
        speed = fine.angular_velocity.values[:, 0]
        first = int(np.flatnonzero(np.diff(np.sign(fine.rotation.values[:, 0])))[0])
        ratio = speed[first + 5] / speed[first - 3]
        assert ratio == pytest.approx(1.0 - 1.5 * math.sin(alpha) ** 2, abs=3e-3)


class TestEnergy:
    @pytest.mark.parametrize("follow", [0.0, 20.0])
    def test_the_account_closes_in_motion_and_at_rest(self, follow):
        energy = af.simulate(oppenheim(), pulse(0.5, 0.3), follow=follow).energy
        assert (energy["kinetic"] > 0.0) == (follow == 0.0)
        gained = energy["kinetic"] + energy["potential"]
        given = energy["ground"] + energy["friction"] + energy["impacts"] + energy["balance_error"]
        assert gained == pytest.approx(given, abs=1e-9 * energy["largest_kinetic"])

    def test_what_no_law_explains_is_small_and_of_second_order_before_impacts(self):
        arch = oppenheim()
        time = np.arange(0.0, 0.4, 1e-4)
        push = af.Motion(np.where(time < 0.2, 0.6 * g, 0.0), 1e-4)
        errors = [
            af.simulate(arch, push, method="time_stepping", dt=dt, follow=0.0).energy_error
            for dt in (2e-3, 1e-3, 5e-4)
        ]
        assert errors[-1] < 1e-5
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
        assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.25)

    def test_no_run_gains_energy(self):
        rng = np.random.default_rng(11)
        for _ in range(30):
            arch = oppenheim(int(rng.integers(3, 15)), friction=rng.uniform(0.45, 1.0))
            motion = pulse(rng.uniform(0.4, 1.2), rng.uniform(0.1, 0.5))
            response = af.simulate(arch, motion)
            largest = response.energy["largest_kinetic"]
            assert response.energy["friction"] <= 0.0
            assert response.energy["impacts"] <= 0.0
            assert response.energy["balance_error"] <= 1e-2 * largest  # ten times the tolerance
            assert response.status in (Status.STANDING, Status.COLLAPSED, Status.UNFINISHED)


class TestSymmetry:
    def test_mirrored_motion_gives_the_mirrored_response_before_impacts(self):
        arch = oppenheim()
        motion = pulse(0.5, 0.3)
        right = af.simulate(arch, motion, history=True).history
        left = af.simulate(arch, motion, scale=-1.0, history=True).history
        n = int(np.searchsorted(right.time.values, 0.4))
        mirrored = left.displacement.values[:n, ::-1] * np.array([-1.0, 1.0])
        assert np.abs(right.displacement.values[:n] - mirrored).max() < 1e-9

    def test_two_runs_are_equal_to_the_last_bit(self):
        one, two = (af.simulate(oppenheim(27), pulse(0.6, 0.3)) for _ in range(2))
        assert one.energy == two.energy
        assert one.peak_displacement == two.peak_displacement
