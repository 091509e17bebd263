"""The baselines against closed forms and equations of motion, and what each gets wrong."""

import functools
import importlib.util
import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import nnls
from tests.physics.linkages import joined
from tests.validation.scenes import g, oppenheim, pulse, tilted

import archfrag as af
from archbench.baselines import common, variant
from archbench.baselines.corners import corner_case
from archbench.baselines.four_bars import linkage_of, place_linkage, speed_after_impact
from archbench.baselines.four_link import Motion, accelerate
from archbench.baselines.gauss_seidel import solve_corner
from archbench.baselines.quadratic_programme import Programme
from archbench.baselines.springs import Sum, new_springs, press_joints
from archbench.exact import Rocking
from archbench.paper.arch import hinge_matrix
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.ground import grounds_of
from archfrag.physics.interface import Options
from archfrag.physics.onset import HINGE_EXTRADOS, HINGE_INTRADOS
from archfrag.physics.state import model_of, new_state, new_work
from archfrag.physics.status import Status
from archfrag.simulation.response import empty_output

LINKS = "four_link"
SPRINGS = "penalty"
SWEEPS = "gauss_seidel"
PROGRAMME = "quadratic_programme"
needs_solver = pytest.mark.skipif(
    importlib.util.find_spec("piqp") is None, reason="piqp is not installed"
)
both = pytest.mark.parametrize(
    "method", [SWEEPS, pytest.param(PROGRAMME, marks=needs_solver)]
)


def still(seconds):
    return af.Motion(np.zeros(int(100 * seconds) + 1), 0.01)


def rocking_errors(method, friction, dt=None, **settings):
    """Relative errors of the amplitudes after two impacts against Housner's block."""
    slenderness = 0.2
    width = 1.0
    height = width / math.tan(slenderness)
    start = 0.5 * slenderness
    exact = Rocking(
        slenderness, math.sqrt(0.75 * g / math.hypot(0.5 * width, 0.5 * height))
    )
    tops = np.array(exact.amplitudes(start, 3))
    times = np.cumsum([exact.quarter(start), *(2.0 * exact.quarter(a) for a in tops)])
    response = af.simulate(
        af.Block(width, height, friction=friction),
        still(0.02),
        method=variant(method, **settings),
        history=True,
        initial=tilted(width, height, start),
        follow=4.5,
        dt=dt,
    )
    tilt = abs(response.history.rotation.values[:, 0])
    time = response.history.time.values
    found = [tilt[(time > times[k]) & (time < times[k + 1])].max() for k in range(2)]
    return np.abs(found / tops[:2] - 1.0)


def case_at(make, chain, place, velocity):
    """A case of a baseline in a state of its voussoirs, under ground that does not move."""
    options = Options(1e-3, 1e-6, 1e-6, 0.0, 10, 0.5, 64, 1e-3, 0.0)
    output = empty_output(0, 0, chain.mass.size, chain.friction.size)
    case = make(
        chain, grounds_of([(np.zeros(3), None, 0.01)]), 1.0, False, options, *output
    )
    common.start(case, place, velocity, False)
    return case


def linkage(arch, hinges):
    bits = np.zeros(arch.n_joint, np.int8)
    for joint, side in hinges:
        bits[joint] = {"intrados": HINGE_INTRADOS, "extrados": HINGE_EXTRADOS}[side]
    return linkage_of(model_of(arch.chain), bits)


def arches(number):
    """Arches of random shape and dead load, so without symmetry, whose hinges make linkages.

    Yielded with their onset and the masses of all degrees of freedom.
    """
    rng = np.random.default_rng(3)
    while number:
        n = int(rng.integers(5, 24))
        arch = af.Arch.circular(
            10.0,
            rng.uniform(1.0, 2.5),
            rng.uniform(100.0, 170.0),
            n,
            np.inf,
            dead_load=rng.uniform(0.0, 4e4, n),
        )
        start = af.onset(arch)
        chain = arch.chain
        if start.stands and len(start.hinges) == len(start.hinges_minus) == 4:
            number -= 1
            yield arch, start, np.stack([chain.mass, chain.mass, chain.inertia], axis=1)


class TestFourLink:
    """One degree of freedom."""

    def test_pins_hold_and_acceleration_is_that_of_lagranges_equation(self):
        """M q.. + M' q.^2 / 2 = -V', with M and V' of all voussoirs, M' by differences."""
        q = 0.02
        step = 1e-5
        speed = 0.7
        rng = np.random.default_rng(4)
        zeros = np.zeros(3)
        checked = 0
        for arch, start, mass in arches(8):
            rest = np.column_stack([arch.chain.centroid, np.zeros(arch.n_voussoir)])
            case = case_at(common.case_of, arch.chain, rest, 0.0 * rest)
            model = case.model
            state = case.state
            bars = linkage(arch, start.hinges)
            if not place_linkage(model, bars, 3.0 * q, 1.0, state):
                continue
            places = []
            inertia = []
            for at in (q - step, q + step, q):
                assert place_linkage(model, bars, at, 1.0, state)
                places.append(state.position[1:-1].copy())
                unit = state.velocity[1:-1].copy()
                inertia.append((mass * unit**2).sum())
            moved = (places[1] - places[0]) / (2.0 * step)
            assert np.abs(unit - moved).max() < 1e-5 * (np.abs(moved).max() + 1.0)
            work = new_work(model)
            move_faces(model, state.position, work)
            apart = np.abs(work.face[:, 1] - work.face[:, 0]).max(axis=2)
            assert apart[bars.contact > 0.5].max() < 1e-11
            assert apart[bars.contact < 0.5].min() > 1e-4
            change = (inertia[1] - inertia[0]) / (2.0 * step)
            shake = rng.normal(size=2)
            slope = (mass * unit * [shake[0], shake[1] + arch.chain.gravity, 0.0]).sum()
            expected = -(0.5 * change * speed**2 + slope) / inertia[2]
            shakes = np.array([shake, zeros[:2]])
            motion = Motion(zeros, zeros.copy(), shakes, np.zeros(1), np.zeros(2))
            found, power = accelerate(case, bars, motion, q, speed, 0.0)
            assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)
            by_ground = -speed * (mass[:, :2] * unit[:, :2] * shake).sum()
            assert power == pytest.approx(by_ground, rel=1e-9)
            checked += 1
        assert checked >= 3

    def test_speed_after_an_impact_is_that_of_the_impulse_balance(self):
        """Momentum of the three new bodies, four pin impulses that keep their hinges."""
        for arch, start, mass in arches(4):
            model = model_of(arch.chain)
            chain = arch.chain
            velocity = []
            for hinges, speed in ((start.hinges, -1.0), (start.hinges_minus, 1.0)):
                state = new_state(model)
                assert place_linkage(model, linkage(arch, hinges), 0.0, 1.0, state)
                velocity.append(speed * state.velocity[1:-1])
            before, unit = velocity
            joints = [joint for joint, _ in start.hinges_minus]
            pins = np.array(
                [getattr(arch, side)[joint] for joint, side in start.hinges_minus]
            )
            bodies = [np.arange(a, b) for a, b in pairwise(joints)]
            parts = [joined(chain, body, chain.centroid) for body in bodies]
            m = np.array([[part[0], part[0], part[1]] for part in parts]).ravel()
            momentum = np.zeros((3, 3))
            for k, body in enumerate(bodies):
                arm = chain.centroid[body] - parts[k][2]
                push = mass[body] * before[body]
                spin = push[:, 2] + arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]
                momentum[k] = [*push[:, :2].sum(0), spin.sum()]
            rows = hinge_matrix(np.array([part[2] for part in parts]), pins)
            system = np.block(
                [[np.diag(m / m.max()), -rows.T], [rows, np.zeros((8, 8))]]
            )
            right = np.concatenate([momentum.ravel() / m.max(), np.zeros(8)])
            after = np.linalg.lstsq(system, right, rcond=None)[0][2]
            speed = speed_after_impact(mass, unit, before)
            assert speed * unit[joints[0], 2] == pytest.approx(after, rel=1e-6)
            assert (mass * (speed * unit) ** 2).sum() <= (mass * before**2).sum()

    def test_rocking_is_housners_and_the_balance_of_an_arch_closes(self):
        assert rocking_errors(LINKS, math.inf).max() < 1e-3
        coarse, fine = (
            af.simulate(
                oppenheim(), pulse(1.0, 0.2), method=LINKS, rtol=rtol
            ).energy_error
            for rtol in (1e-4, 1e-10)
        )
        assert coarse < 1e-3
        assert fine < min(1e-7, 0.1 * coarse)

    def test_a_sliding_onset_a_foreign_state_and_falling_ground_are_not_its_own(self):
        block = af.Block(0.4, 0.5, friction=0.3)
        falling = af.Motion(np.zeros(50), 0.01, vertical=np.full(50, -1.5 * g))
        lifted = np.zeros((2, 7, 3))
        lifted[0, 3, 1] = 0.01
        for arch, motion, initial in (
            (block, pulse(1.0, 0.5), None),
            (oppenheim(), falling, None),
            (oppenheim(), pulse(0.1, 0.5), lifted),
        ):
            response = af.simulate(arch, motion, method=LINKS, initial=initial)
            assert (response.status, response.collapsed) == (
                Status.NOT_APPLICABLE,
                None,
            )
        assert (
            af.simulate(block, pulse(0.1, 0.5), method=LINKS).status is Status.STANDING
        )


class TestPenalty:
    """Distinct elements on springs."""

    run = staticmethod(functools.partial(af.simulate, method=SPRINGS))

    def test_a_block_sinks_by_its_weight_over_its_springs_and_an_arch_does_not_creep(
        self,
    ):
        block = af.Block(1.0, 2.0, friction=0.6)
        response = self.run(block, still(0.1), method=variant(SPRINGS, stiffness=1e8))
        assert response.overlap == pytest.approx(2000.0 * 2.0 * g / 1e8, rel=1e-6)
        moved = self.run(
            oppenheim(), still(2.0), history=True
        ).history.displacement.values
        assert 1e-5 < np.abs(moved[0]).max() < 1e-3
        assert np.abs(moved - moved[0]).max() < 1e-12

    def test_impact_loses_what_housner_gives_once_dashpots_are_strong(self):
        soft, strong = (
            rocking_errors(SPRINGS, math.inf, 2e-4, damping_stiffness=damping)[0]
            for damping in (0.01, 1.0)
        )
        assert strong < 0.01 < soft

    @pytest.mark.parametrize("tilt", [0.2, -0.2])
    @pytest.mark.parametrize("slip", [0.0, 0.004, -0.02])
    def test_force_is_the_slope_of_the_energy_also_where_vertices_pass(
        self, tilt, slip
    ):
        model = model_of(af.Block(1.0, 2.0, friction=math.inf).chain)
        state = new_state(model)
        work = new_work(model)
        state = state._replace(position=work.position)
        springs = new_springs(model, 1e9, 1e-12, 0.01)
        corner = np.array([math.copysign(0.5, -tilt), -1.0])
        c = math.cos(tilt)
        s = math.sin(tilt)
        place = np.array([0.0, -3e-3, tilt])
        place[:2] += [corner[0] + slip * math.cos(tilt / 2), slip * math.sin(tilt / 2)]
        place[:2] -= [c * corner[0] - s * corner[1], s * corner[0] + c * corner[1]]

        def energy(at):
            work.contact[:] = springs.shear[:] = 0.0
            state.position[1] = at
            move_faces(model, state.position, work)
            press_joints(model, state, work, springs, 0.0)
            return springs.sums[Sum.ELASTIC]

        energy(place)
        force = springs.total[1].copy()
        steps = 1e-7 * np.eye(3)
        slope = (
            np.array([energy(place + step) - energy(place - step) for step in steps])
            / 2e-7
        )
        assert work.contact.sum() == 1
        np.testing.assert_allclose(force, -slope, atol=3e-3 * np.abs(force).max())

    def test_is_stable_below_the_critical_step_and_not_above(self):
        below, above = (
            self.run(
                oppenheim(),
                pulse(0.2, 0.3),
                dt=0.5,
                follow=2.0,
                method=variant(SPRINGS, step_fraction=part),
            )
            for part in (0.8, 1.12)
        )
        assert below.status in (Status.STANDING, Status.UNFINISHED)
        assert below.energy_error < 0.1
        assert above.status == Status.NOT_FINITE
        block = af.Block(1.0, 2.0, friction=0.6)
        far = self.run(block, still(2000.0), method=variant(SPRINGS, stiffness=1e16))
        assert far.status == Status.WORK_BOUND

    @pytest.mark.parametrize(("amplitude", "falls"), [(0.60, False), (0.80, True)])
    def test_amplitude_that_collapses_is_about_that_of_other_solvers(
        self, amplitude, falls
    ):
        """MuJoCo, Siconos and LMGC90 0.675 to 0.70 g."""
        stiff = variant(SPRINGS, stiffness=1e10)
        run = self.run(oppenheim(), pulse(amplitude, 0.3), method=stiff, follow=3.0)
        assert run.collapsed is True if falls else not run.collapsed
        assert max(run.energy["impacts"], run.energy["friction"]) <= 0.0


@both
class TestContactDynamics:
    """Two contacts a joint, on the velocity level."""

    def test_rocking_loses_what_housner_gives(self, method):
        assert rocking_errors(method, 0.8, 2.5e-4).max() < 6e-3

    def test_keystone_energy_and_collapse_are_those_of_lmgc90(self, method):
        run = functools.partial(
            af.simulate, oppenheim(sector=False), method=method, dt=1e-3
        )
        response = run(pulse(0.5, 0.3), history=True)
        history = response.history
        found = np.interp([0.2, 0.4], history.time, history.displacement[:, 3, 0])
        assert found == pytest.approx([-0.01621, -0.04211], abs=1e-4)
        assert response.energy_error < 5e-4
        assert response.residual < 1e-3
        for amplitude, falls in ((0.675, False), (0.700, True)):
            assert run(pulse(amplitude, 0.3)).collapsed is falls

    def test_a_sliding_block_stays_on_the_ground_by_sweeps_and_leaves_it_by_the_programme(
        self, method
    ):
        """Projected on the cone u_n >= mu u_t, a speed v becomes v mu / (1 + mu^2) upwards."""
        response = af.simulate(
            af.Block(1.0, 0.5, friction=0.4),
            still(0.02),
            method=method,
            history=True,
            follow=2.0,
            initial=(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])),
        )
        history = response.history
        speed = np.interp(0.1, history.time, history.velocity[:, 0, 0])
        assert speed == pytest.approx(1.0 - 0.4 * g * 0.1, rel=2e-3)
        lift = 0.0 if method == SWEEPS else 0.4 / (1.0 + 0.4**2)
        rise = history.displacement.values[:, 0, 1].max()
        assert rise == pytest.approx(lift**2 / (2.0 * g), rel=0.02, abs=1e-9)
        assert (response.energy_error > 0.1) == (method == PROGRAMME)


class TestSweeps:
    def test_laws_hold_for_random_contacts(self):
        rng = np.random.default_rng(1)
        seen = set()
        for _ in range(1000):
            root = rng.normal(size=(2, 2))
            operator = root @ root.T + 0.2 * np.eye(2)
            free = rng.normal(size=2)
            mu = rng.choice([0.0, 0.3, 0.7, math.inf])
            w_nn = operator[0, 0]
            w_nt = operator[0, 1]
            w_tt = operator[1, 1]
            if np.isfinite(mu) and min(w_nn - mu * w_nt, w_nn + mu * w_nt) <= 0.0:
                continue
            r_n, r_t, touches, slide = solve_corner(
                w_nn, w_nt, w_tt, free[0], free[1], mu
            )
            u_n, u_t = free + operator @ [r_n, r_t]
            seen.add((touches, slide))
            assert min(r_n, u_n) == pytest.approx(0.0, abs=1e-10)
            if np.isfinite(mu):
                assert abs(r_t) <= mu * r_n * (1.0 + 1e-12)
            if slide != 0.0:
                assert slide * r_t >= 0.0 >= slide * u_t - 1e-10
            elif touches:
                assert u_t == pytest.approx(0.0, abs=1e-10)
        assert seen == {(False, 0.0), (True, 0.0), (True, 1.0), (True, -1.0)}

    def test_steps_at_the_cap_are_counted_and_the_run_goes_on(self):
        five, many = (
            af.simulate(
                oppenheim(),
                pulse(0.5, 0.3),
                method=method,
                follow=0.0,
            )
            for method in (variant(SWEEPS, sweeps=5), SWEEPS)
        )
        assert five.work["unconverged"] > 0.8 * five.steps
        assert many.work["unconverged"] == 0
        assert many.residual < 0.1 * five.residual


@needs_solver
def test_solution_of_the_programme_is_that_of_least_squares_on_the_reactions():
    """Moreau: what is left of the free velocities is their projection on a polar cone."""
    rng = np.random.default_rng(2)
    chain = af.Arch.circular(10.0, 1.5, 157.5, 5, 0.7).chain
    position = np.column_stack([chain.centroid, np.zeros(5)])
    for _ in range(3):
        case = case_at(corner_case, chain, position, 1e-3 * rng.normal(size=(5, 3)))
        programme = Programme(case, 1e-11)
        programme.pose()
        # Corners that overlap a little at the positions of the step have no bias.
        programme.low[:] = 0.0
        programme.solve()
        dense = np.zeros((programme.low.size, 21))
        for r, row in enumerate(programme.row.reshape(-1, 6)):
            dense[r, 3 * (r // 4) : 3 * (r // 4) + 6] = row
        dense = dense[:, 3:18]
        free = -programme.linear
        expected = free + dense.T @ nnls(dense.T, -free)[0]
        assert abs(programme.solution - expected).max() < 1e-6 * abs(free).max()
