"""The distinct element method against closed forms, and what its springs get wrong."""

import math

import numpy as np
import pytest

import archfrag as af
from archfrag.mechanics.contact.placing import move_faces
from archfrag.mechanics.model import model_of, new_state, new_work
from archfrag.mechanics.status import Status
from archfrag.methods.penalty.springs import Sum, new_springs, press_joints

G = 9.80665


def penalty(arch, motion, scale=1.0, **given):
    """Run by springs; `given` holds settings and other arguments of `simulate`."""
    others = {k: given.pop(k) for k in ("dt", "history", "initial", "follow") if k in given}
    return af.simulate(arch, motion, scale, method="penalty", settings=given, **others)


def still(seconds):
    return af.Motion(np.zeros(int(100 * seconds) + 1), 0.01)


def pulse(tp):
    """Ground acceleration +1 for tp, then -1/2 for twice as long [m/s2]."""
    time = np.arange(round(3 * tp / 0.001) + 1) * 0.001
    return af.Motion(np.where(time < tp - 1e-9, 1.0, np.where(time < 3 * tp, -0.5, 0.0)), 0.001)


@pytest.fixture(scope="module")
def arch():
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)


class TestStatics:
    @pytest.mark.parametrize("stiffness", [1e8, 1e10])
    def test_a_block_sinks_by_its_weight_over_its_springs(self, stiffness):
        response = penalty(
            af.Block(1.0, 2.0, friction=0.6), still(0.1), stiffness=stiffness, history=True
        )
        expected = 2000.0 * 2.0 * G / stiffness
        sunk = response.history.displacement.values[:, 0, 1]
        np.testing.assert_allclose(sunk, -expected, rtol=1e-6)
        assert response.overlap == pytest.approx(expected, rel=1e-6)
        assert response.residual == pytest.approx(expected, rel=1e-3)
        assert response.status == Status.STANDING

    @pytest.mark.parametrize("friction", [0.7, math.inf])
    def test_an_arch_stands_without_a_jolt_and_does_not_creep(self, friction):
        arch = af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=friction)
        response = penalty(arch, still(20.0), history=True)
        moved = response.history.displacement.values
        assert 1e-5 < np.abs(moved[0]).max() < 1e-3
        assert np.abs(moved - moved[0]).max() < 1e-12
        assert response.energy["largest_kinetic"] < 1e-12
        assert response.energy_error == 0.0


class TestFriction:
    def test_a_sliding_block_is_braked_by_mu_g(self):
        mu, speed = 0.3, 1.0
        block = af.Block(2.0, 0.5, friction=mu)
        start = (np.zeros((1, 3)), np.array([[speed, 0.0, 0.0]]))
        response = penalty(block, still(1.0), initial=start, history=True)
        slid = response.history.displacement.values[-1, 0, 0]
        assert slid == pytest.approx(speed**2 / (2 * mu * G), rel=2e-3)
        work = 0.5 * block.chain.mass[0] * speed**2
        assert response.energy["friction"] == pytest.approx(-work, rel=0.02)
        velocity = response.history.velocity.sel(time=0.2, method="nearest")
        expected = speed - mu * G * float(velocity.time)
        assert float(velocity.values[0, 0]) == pytest.approx(expected, abs=2e-3)


def rocking_block(stiffness, **given):
    """History of the free rocking of validation section 3, and the angle alpha."""
    alpha, half_width = 0.2, 0.5
    block = af.Block(2 * half_width, 2 * half_width / math.tan(alpha), friction=math.inf)
    tilt, centre = 0.5 * alpha, block.chain.centroid[0]
    pivot = np.array([-half_width, 0.0])
    c, s = math.cos(tilt), math.sin(tilt)
    arm = centre - pivot
    shift = pivot + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]]) - centre
    start = (np.array([[*shift, tilt]]), np.zeros((1, 3)))
    response = penalty(
        block, af.Motion(np.zeros(2), 1e-3), stiffness=stiffness, initial=start, history=True,
        follow=6.0, dt=2e-4, **given,
    )  # fmt: skip
    return response, alpha


def free_rocking(stiffness, **given):
    """Time of the first impact [s], and amplitude over alpha of the half swing after it."""
    response, alpha = rocking_block(stiffness, **given)
    angle = response.history.rotation.values[:, 0]
    time = response.history.time.values
    down = np.flatnonzero((angle[:-1] > 0.0) & (angle[1:] <= 0.0))[0]
    up = down + np.flatnonzero((angle[down:-1] < 0.0) & (angle[down + 1 :] >= 0.0))[0]
    part = angle[down] / (angle[down] - angle[down + 1])
    first = time[down] + part * (time[down + 1] - time[down])
    return first, np.abs(angle[down:up]).max() / alpha


class TestRocking:
    def test_time_to_the_first_impact_converges_as_stiffness_grows(self):
        """Against Housner's block with large rotations, by quadrature of its energy."""
        alpha, start = 0.2, 0.1
        rate = math.sqrt(3 * G / (4 * math.hypot(0.5, 0.5 / math.tan(alpha))))
        u = (np.arange(4000) + 0.5) / 4000
        angle = start * (1 - u**2)
        speed = rate * np.sqrt(2 * (math.cos(alpha - start) - np.cos(alpha - angle)))
        quarter = np.mean(2 * start * u / speed)
        assert quarter == pytest.approx(3.08096 / 4, rel=3e-3)
        times = [free_rocking(k)[0] / quarter for k in (1e7, 1e9, 1e10)]
        assert abs(times[2] - times[1]) < 0.1 * abs(times[1] - times[0])
        assert abs(times[2] - 1.0) < 1e-3 < abs(times[0] - 1.0)

    def test_impact_loses_what_housner_gives_once_dashpots_are_strong(self):
        """Validation section 3: 0.42019 alpha after the first impact."""
        errors = [
            free_rocking(1e10, damping_stiffness=damping)[1] - 0.42019
            for damping in (0.01, 0.3, 1.0)
        ]
        assert errors[0] > errors[1] > abs(errors[2])
        assert abs(errors[2]) < 0.004


class TestCorners:
    @pytest.mark.parametrize("tilt", [0.2, -0.2])
    @pytest.mark.parametrize("slip", [0.0, 0.004, -0.007, 0.02, -0.02])
    def test_force_is_the_slope_of_the_energy_also_where_vertices_pass(self, tilt, slip):
        model = model_of(af.Block(1.0, 2.0, friction=math.inf).chain)
        state, work = new_state(model), new_work(model)
        state = state._replace(position=work.position)
        springs = new_springs(model, 1e9, 1e-12, 0.01)
        corner = np.array([math.copysign(0.5, -tilt), -1.0])
        c, s = math.cos(tilt), math.sin(tilt)
        place = np.array([0.0, -3e-3, tilt])
        place[:2] += [corner[0] + slip * math.cos(tilt / 2), slip * math.sin(tilt / 2)]
        place[:2] -= [c * corner[0] - s * corner[1], s * corner[0] + c * corner[1]]

        def energy(at):
            work.touch[:] = springs.shear[:] = 0.0
            state.position[1] = at
            move_faces(model, state.position, work.rotated, work.face, work.tangent)
            press_joints(model, state, work, springs, 0.0)
            return springs.sums[Sum.ELASTIC]

        energy(place)
        force = springs.total[1].copy()
        slope = np.empty(3)
        for k in range(3):
            step = 1e-7 * np.eye(3)[k]
            slope[k] = (energy(place + step) - energy(place - step)) / 2e-7
        assert work.touch.sum() == 1
        np.testing.assert_allclose(force, -slope, atol=3e-3 * np.abs(force).max())


class TestSteps:
    def test_no_step_is_larger_than_the_users_nor_than_the_critical_one(self, arch):
        many = penalty(arch, still(0.1), stiffness=1e11, follow=0.0)
        fewer = penalty(arch, still(0.1), stiffness=1e9, follow=0.0)
        given = penalty(arch, still(0.1), stiffness=1e9, follow=0.0, dt=1e-5)
        assert many.steps > 3 * fewer.steps
        assert given.steps == pytest.approx(0.1 / 1e-5, abs=2)

    def test_the_critical_step_of_a_block_is_that_of_its_eigenvalues(self):
        block = af.Block(1.0, 2.0, friction=0.6)
        mass, inertia = block.chain.mass[0], block.chain.inertia[0]
        normal, shear = 0.5 * 1e9, 0.5 * 1e9 * 0.4  # at each corner of a joint of 1 m2
        stiffness = np.zeros((3, 3))
        for x, y in ((-0.5, -1.0), (0.5, -1.0)):
            along, across = np.array([1.0, 0.0, -y]), np.array([0.0, 1.0, x])
            stiffness += shear * np.outer(along, along) + normal * np.outer(across, across)
        scale = 1.0 / np.sqrt([mass, mass, inertia])
        fastest = np.sqrt(np.linalg.eigvalsh(stiffness * np.outer(scale, scale))[-1])
        ratio = 0.3
        critical = 2.0 / fastest * (np.sqrt(1.0 + ratio**2) - ratio)
        run = penalty(block, still(0.1), stiffness=1e9, follow=0.0, dt=0.05)
        assert run.steps == pytest.approx(0.1 / (0.25 * critical), rel=0.1)
        assert run.steps >= 0.1 / (0.25 * critical) - 1.0

    @pytest.mark.parametrize("damping", [0.0, 0.1, 0.3])
    def test_is_stable_below_the_critical_step_and_not_above(self, arch, damping):
        def run(part):
            return penalty(
                arch, pulse(0.3), 0.2 * G, step_fraction=part, dt=0.5,
                damping_stiffness=damping, follow=2.0,
            )  # fmt: skip

        below, above = run(0.8), run(1.12)
        assert below.status in (Status.STANDING, Status.UNFINISHED)
        assert below.energy_error < 0.1
        assert above.status == Status.NOT_FINITE
        assert above.collapsed is None

    def test_a_run_out_of_reach_is_refused(self):
        response = penalty(af.Block(1.0, 2.0, friction=0.6), still(2000.0), stiffness=1e16)
        assert response.status == Status.WORK_BOUND
        assert response.collapsed is None


class TestEnergy:
    def test_balance_closes_as_the_step_is_divided(self, arch):
        errors = [
            penalty(arch, pulse(0.3), 0.5 * G, step_fraction=part, follow=2.0).energy_error
            for part in (0.8, 0.2, 0.02)
        ]
        assert errors[2] < errors[1] < errors[0]
        assert errors[2] < 1e-3

    def test_dampers_only_take(self, arch):
        for given in (
            {"damping_stiffness": 0.0, "local_damping": 0.3},
            {"damping_stiffness": 0.0, "damping_mass": 0.2},
            {"damping_stiffness": 0.5},
        ):
            response = penalty(arch, pulse(0.3), 0.45 * G, follow=3.0, step_fraction=0.2, **given)
            assert response.energy["impacts"] < 0.0
            assert response.energy["friction"] <= 0.0
            assert response.energy_error < 0.02


class TestCollapse:
    @pytest.mark.parametrize(
        ("stiffness", "stands", "falls"),
        [(1e9, 0.60, 0.80), (1e10, 0.60, 0.80), (1e12, 0.65, 0.71)],
    )
    def test_amplitude_of_the_arch_of_validation_a(self, arch, stiffness, stands, falls):
        """Own prototype 0.6797 / 0.6812 g; MuJoCo, Siconos and LMGC90 0.675 to 0.70 g."""
        low = penalty(arch, pulse(0.3), stands * G, stiffness=stiffness, follow=3.0)
        high = penalty(arch, pulse(0.3), falls * G, stiffness=stiffness, follow=3.0)
        assert low.status in (Status.STANDING, Status.UNFINISHED)
        assert high.status == Status.COLLAPSED
        assert high.collapse_mode in ("hinging", "sliding")
        assert 0.3 < high.collapse_time < high.end_time
