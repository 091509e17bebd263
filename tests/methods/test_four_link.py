"""Baseline `four_link`: the linkage, its impacts, its verdicts, and where it does not apply."""

import itertools
import math

import numpy as np
import pytest

import archfrag as af
from archfrag.arch import STANDARD_GRAVITY as g
from archfrag.errors import STATUS_MESSAGE
from archfrag.mechanics import four_bars
from archfrag.mechanics.contact.placing import move_faces
from archfrag.mechanics.four_bars import place_linkage, speed_after_impact
from archfrag.mechanics.model import model_of, new_state, new_work
from archfrag.mechanics.onset import HINGE_EXTRADOS, HINGE_INTRADOS
from archfrag.mechanics.status import Status
from archfrag.mechanics.types import GroundMotion, Options
from archfrag.methods import base
from archfrag.methods.four_link import Motion, accelerate
from archfrag.methods.time_stepping.front import case_of
from archfrag.simulation.history import empty_frames
from archfrag.simulation.mechanism import empty_log

BITS = {"intrados": HINGE_INTRADOS, "extrados": HINGE_EXTRADOS}


def oppenheim(voussoirs=7, **options):
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs, **{"friction": 0.7, **options})


def four_link(arch, motion, **options):
    return af.simulate(arch, motion, method="four_link", **options)


def rectangle(amplitude, duration):
    """+a for `duration` [g, s]; the ramp down takes a 2000th of it."""
    shape = np.where(np.arange(2400) < 2000, 1.0, 0.0)
    return af.Motion(amplitude * g * shape, duration / 2000.0)


def there_and_back(amplitude, dt=1e-3):
    """+a for 0.3 s, then -a/2 for 0.6 s [g]."""
    time = np.arange(0.0, 0.905, dt)
    shape = np.where(time < 0.3 - 1e-9, 1.0, np.where(time < 0.9 - 1e-9, -0.5, 0.0))
    return af.Motion(amplitude * g * shape, dt)


def linkage_of(arch, hinges):
    bits = np.zeros(arch.n_joint, np.int8)
    for joint, side in hinges:
        bits[joint] = BITS[side]
    return four_bars.linkage_of(model_of(arch.chain), bits)


def masses_of(arch):
    return np.stack([arch.chain.mass, arch.chain.mass, arch.chain.inertia], axis=1)


def pins_of(arch, hinges):
    return np.array([getattr(arch, side)[joint] for joint, side in hinges])


def unit_velocities(arch, hinges):
    """Velocities of the voussoirs for a unit rotation of the first body, by a null space."""
    pins = pins_of(arch, hinges)
    closure = np.array([[-(b - a)[1], (b - a)[0]] for a, b in itertools.pairwise(pins)]).T
    rates = np.linalg.svd(closure)[2][-1]
    rates = rates / rates[0]
    # Joints open: the second body rotates back against the first about an intrados hinge, and so
    # on.
    first = -1.0 if hinges[0][1] == "intrados" else 1.0
    velocity = np.zeros((arch.n_voussoir, 3))
    at_pin = np.zeros(2)
    for k, rate in enumerate(first * rates):
        for i in range(hinges[k][0], hinges[k + 1][0]):
            arm = arch.chain.centroid[i] - pins[k]
            velocity[i] = [at_pin[0] - rate * arm[1], at_pin[1] + rate * arm[0], rate]
        bar = pins[k + 1] - pins[k]
        at_pin = at_pin + rate * np.array([-bar[1], bar[0]])
    assert np.abs(at_pin).max() < 1e-12
    return velocity


def impulse_balance(arch, hinges, before):
    """Speed and four pin impulses after an impact, from momentum and its moment: 9 equations."""
    chain, pins = arch.chain, pins_of(arch, hinges)
    unit = unit_velocities(arch, hinges)

    def momentum(velocity, first, last):
        total = np.zeros(3)
        for i in range(first, last):
            p = chain.mass[i] * velocity[i, :2]
            x, y = chain.centroid[i]
            spin = chain.inertia[i] * velocity[i, 2]
            total += [p[0], p[1], x * p[1] - y * p[0] + spin]
        return total

    matrix, right = np.zeros((9, 9)), np.zeros(9)
    for k in range(3):
        rows = slice(3 * k, 3 * k + 3)
        first, last = hinges[k][0], hinges[k + 1][0]
        matrix[rows, 8] = momentum(unit, first, last)
        right[rows] = momentum(before, first, last)
        for pin, sign in ((k, -1.0), (k + 1, 1.0)):
            x, y = pins[pin]
            matrix[rows, 2 * pin : 2 * pin + 2] = sign * np.array([[1, 0], [0, 1], [-y, x]])
    return np.linalg.solve(matrix, right)[8]


def energy_of(arch, velocity):
    chain = arch.chain
    square = (chain.mass[:, None] * velocity[..., :2] ** 2).sum(axis=(-2, -1))
    return 0.5 * (square + (chain.inertia * velocity[..., 2] ** 2).sum(axis=-1))


def arches(number, seed=3):
    """Arches of random shape and dead load, so without symmetry, whose hinges make linkages."""
    rng = np.random.default_rng(seed)
    while number:
        n = int(rng.integers(5, 24))
        arch = af.Arch.circular(
            10.0, rng.uniform(1.0, 2.5), rng.uniform(100.0, 170.0), n, np.inf,
            sector=bool(rng.random() < 0.5), dead_load=rng.uniform(0.0, 4e4, n),
        )  # fmt: skip
        start = af.onset(arch)
        if start.stands and len(start.hinges) == len(start.hinges_minus) == 4:
            number -= 1
            yield arch, start


class TestKinematics:
    def test_pins_hold_and_velocities_are_the_slopes_of_positions(self):
        checked = 0
        for arch, start in arches(8):
            model = model_of(arch.chain)
            state, work = new_state(model), new_work(model)
            for hinges in (start.hinges, start.hinges_minus):
                linkage, q, step = linkage_of(arch, hinges), 0.02, 1e-5
                if not place_linkage(model, linkage, 3.0 * q, 1.0, state):
                    continue
                places = []
                for at in (q - step, q + step, q):
                    assert place_linkage(model, linkage, at, 1.0, state)
                    places.append(state.position.copy())
                slope = (places[1] - places[0]) / (2.0 * step)
                scale = np.abs(slope).max() + 1.0
                assert np.abs(state.velocity - slope)[1:-1].max() < 1e-5 * scale
                move_faces(model, state.position, work.rotated, work.face, work.tangent)
                apart = work.face[:, 1] - work.face[:, 0]
                assert np.abs(apart[linkage.touch > 0.5]).max() < 1e-12 * 10.0
                opens = np.abs(apart[linkage.touch < 0.5]).max(axis=1)
                assert opens.min() > 1e-4
                checked += 1
        assert checked >= 10

    def test_velocities_of_the_voussoirs_are_those_of_the_null_space(self):
        for arch, start in arches(4):
            model = model_of(arch.chain)
            state, linkage = new_state(model), linkage_of(arch, start.hinges)
            assert place_linkage(model, linkage, 0.0, 1.0, state)
            expected = unit_velocities(arch, start.hinges)
            np.testing.assert_allclose(state.velocity[1:-1], expected, atol=1e-9)

    def test_hinges_that_alternate_wrongly_or_are_not_four_make_no_linkage(self):
        arch = oppenheim()
        hinges = af.onset(arch).hinges
        assert linkage_of(arch, hinges) is not None
        assert linkage_of(arch, hinges[:3]) is None
        assert linkage_of(arch, [*hinges[:3], (7, "extrados")]) is None


class TestOnset:
    def test_oppenheims_arch_rests_below_0_370_g_and_moves_above(self):
        arch, time = oppenheim(), np.arange(0.0, 1.0, 0.01)
        wave = af.Motion(g * np.sin(2.0 * np.pi * time), 0.01)
        peak = np.abs(wave.acceleration).max() / g
        at_rest = four_link(arch, wave, scale=0.36995 / peak)
        assert (at_rest.steps, at_rest.peak_displacement) == (0, 0.0)
        moved = four_link(arch, wave, scale=0.37006 / peak, history=True)
        assert moved.peak_displacement > 0.0
        words = {joint: f"hinge {side}" for joint, side in af.onset(arch).hinges}
        assert moved.mechanism[1].joints == words
        assert moved.mechanism[1].model == "four_hinges"
        assert moved.model_time["rest"] > 0.1

    def test_both_directions_give_the_same(self):
        arch, motion = oppenheim(), there_and_back(1.2)
        one, other = (four_link(arch, motion, scale=s, rtol=1e-8) for s in (1.0, -1.0))
        assert one.peak_displacement == pytest.approx(other.peak_displacement, rel=1e-5)
        assert one.events == other.events
        assert one.end_time == pytest.approx(other.end_time, rel=1e-5)


class TestLagrange:
    def test_acceleration_is_that_of_lagranges_equation(self):
        """M q.. + M' q.^2 / 2 = -V', with M and V' of all voussoirs, M' by differences."""
        q, speed, rng = 0.02, 0.7, np.random.default_rng(4)
        checked = 0
        for arch, start in arches(8):
            chain, mass = arch.chain, masses_of(arch)
            n = (arch.n_voussoir, arch.n_joint)
            ground = GroundMotion(np.zeros(3), np.zeros(3), 0.01)
            options = Options(1e-3, 1e-6, 1e-6, 0.0, 10, 0.5, 64, 1e-3, 0.0)
            case = case_of(
                chain, ground, False, options, empty_frames(0, *n), empty_log(0, n[1])
            )  # fmt: skip
            still = np.column_stack([chain.centroid, np.zeros(n[0])])
            base.start(case, still, np.zeros((n[0], 3)), False)
            linkage = linkage_of(arch, start.hinges)
            if not place_linkage(case.model, linkage, 3.0 * q, 1.0, case.state):
                continue
            shake = rng.normal(size=2)
            motion = Motion(
                np.zeros(3), np.zeros(3), np.array([shake, [0.0, 0.0]]), np.zeros(1), np.zeros(2)
            )  # fmt: skip
            inertia = []
            for at in (q - 1e-5, q + 1e-5, q):
                place_linkage(case.model, linkage, at, 1.0, case.state)
                unit = case.state.velocity[1:-1].copy()
                inertia.append((mass * unit**2).sum())
            half = (inertia[1] - inertia[0]) / 4e-5
            slope = (mass * unit * [shake[0], shake[1] + case.model.gravity, 0.0]).sum()
            expected = -(half * speed**2 + slope) / inertia[2]
            found, power = accelerate(case, linkage, motion, q, speed, 0.0)
            assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)
            by_ground = -speed * (mass[:, :2] * unit[:, :2] * shake).sum()
            assert power == pytest.approx(by_ground, rel=1e-9)
            checked += 1
        assert checked >= 5

    def test_energy_is_conserved_between_impacts_to_the_tolerance(self):
        errors = []
        for rtol in (1e-4, 1e-7, 1e-10):
            response = four_link(oppenheim(), rectangle(1.0, 0.2), rtol=rtol)
            assert response.status is Status.STANDING
            errors.append(response.energy_error)
        assert errors[0] < 1e-3
        assert errors[1] < 1e-5
        assert errors[2] < 1e-8
        assert errors[0] > 10.0 * errors[2]

    def test_reactions_balance_every_voussoir_by_newtons_and_eulers_laws(self):
        arch, dt = oppenheim(), 1e-3
        time = np.arange(0.0, 0.8, dt)
        up = 0.2 * g * np.sin(9.0 * time)
        motion = af.Motion(0.9 * g * np.cos(3.0 * time), dt, vertical=up)
        response = four_link(arch, motion, history=True, rtol=1e-10)
        past = response.history
        inside = slice(50, 250)
        step = np.arange(past.time.size)[inside]
        ends = past.time.values[step + 1] - past.time.values[step - 1]
        np.testing.assert_allclose(ends, 2.0 * dt, rtol=1e-9)

        def rate(name):
            values = past[name].values
            return (values[step + 1] - values[step - 1]) / (2.0 * dt)

        ground = np.stack([np.interp(past.time.values[step], time, a)
                           for a in (motion.acceleration, up + g)], axis=1)  # fmt: skip
        force, moment = past.reaction.values[step], past.moment.values[step]
        mass, weight = arch.chain.mass[:, None], arch.chain.mass.sum() * g
        left = force[:, :-1] - force[:, 1:] - mass * (rate("velocity") + ground[:, None, :])
        assert np.abs(left).max() < 1e-4 * weight
        tilt = past.rotation.values[step]
        centre = arch.chain.centroid + past.displacement.values[step]

        def places(points, joint):
            """Where points of a joint are on the voussoirs before and after it."""
            for body in (joint - 1, joint):
                if not 0 <= body < arch.n_voussoir:
                    yield np.broadcast_to(points[joint], (step.size, 2))
                    continue
                c, s = np.cos(tilt[:, body]), np.sin(tilt[:, body])
                x, y = points[joint] - arch.chain.centroid[body]
                yield centre[:, body] + np.stack([c * x - s * y, s * x + c * y], axis=1)

        def moment_of(arm, joint):
            return arm[:, 0] * force[:, joint, 1] - arm[:, 1] * force[:, joint, 0]

        # The middle of an open joint lies between the middles of its two faces.
        middles = 0.5 * (arch.intrados + arch.extrados)
        middle = [sum(places(middles, j)) / 2.0 for j in range(arch.n_joint)]
        spin = moment[:, :-1] - moment[:, 1:] - arch.chain.inertia * rate("angular_velocity")
        for i in range(arch.n_voussoir):
            for j, sign in ((i, 1.0), (i + 1, -1.0)):
                spin[:, i] += sign * moment_of(middle[j] - centre[:, i], j)
        assert np.abs(spin).max() < 1e-4 * weight * 1.5
        # Pins bear no moment.
        for joint, side in af.onset(arch).hinges:
            before, after = places(getattr(arch, side), joint)
            np.testing.assert_allclose(before, after, atol=1e-9)
            about_pin = moment[:, joint] + moment_of(middle[joint] - before, joint)
            assert np.abs(about_pin).max() < 1e-9 * weight * 10.0
        # Corners of closed joints are let off neither thrust nor friction.
        assert response.residual < 0.5


class TestImpact:
    def test_speed_is_that_of_the_impulse_balance_and_energy_is_never_gained(self):
        for arch, start in arches(12):
            pair = (start.hinges, start.hinges_minus)
            for old, new in (pair, pair[::-1]):
                before = -unit_velocities(arch, old)
                unit = unit_velocities(arch, new)
                speed = speed_after_impact(masses_of(arch), unit, before)
                assert speed == pytest.approx(impulse_balance(arch, new, before), rel=1e-9)
                assert energy_of(arch, speed * unit) <= energy_of(arch, before)

    def test_a_run_loses_at_its_impact_what_the_balance_states(self):
        arch = oppenheim()
        start = af.onset(arch)
        response = four_link(arch, rectangle(1.0, 0.2), history=True)
        hit = [change.time for change in response.mechanism if change.cause == "impact"]
        past = response.history
        speed = np.concatenate([past.velocity, past.angular_velocity.values[..., None]], axis=2)
        kinetic = energy_of(arch, speed)
        after = np.searchsorted(past.time.values, hit[0])
        measured = kinetic[after] / kinetic[after - 1]
        before = -unit_velocities(arch, start.hinges)
        unit = unit_velocities(arch, start.hinges_minus)
        kept = energy_of(arch, impulse_balance(arch, start.hinges_minus, before) * unit)
        assert measured == pytest.approx(kept / energy_of(arch, before), rel=5e-3)
        assert response.mechanism[1].joints == {
            joint: f"hinge {side}" for joint, side in start.hinges_minus
        }

    def test_the_balance_closes_over_all_impacts(self):
        response = four_link(oppenheim(), there_and_back(1.4), rtol=1e-9)
        energy = response.energy
        assert response.events["impacts"] > 20
        assert energy["impacts"] < 0.0
        assert energy["impacts"] == pytest.approx(-energy["ground"], rel=1e-6)
        assert response.energy_error < 1e-6

    def test_impacts_that_accumulate_end_at_rest_with_bounded_work(self):
        time = np.arange(0.0, 8.0, 0.01)
        for shake in (np.sin(9.0 * time), np.sign(np.sin(2.0 * time))):
            response = four_link(oppenheim(), af.Motion(0.6 * g * shake, 0.01))
            assert response.status in (Status.STANDING, Status.COLLAPSED)
            assert response.steps < 20_000


class TestWhereItDoesNotApply:
    @pytest.mark.parametrize(
        "arch",
        [af.Block(0.4, 0.5, friction=0.3), oppenheim(friction=0.4, sector=False)],
        ids=["block", "arch"],
    )
    def test_an_onset_that_slides_is_neither_collapse_nor_survival(self, arch):
        assert af.onset(arch).sliding
        response = four_link(arch, rectangle(1.0, 0.5))
        assert response.status is Status.NOT_APPLICABLE
        assert response.collapsed is None
        assert math.isnan(response.collapse_time)
        resting = four_link(arch, rectangle(0.1, 0.5))
        assert resting.status is Status.STANDING

    def test_an_initial_state_that_is_none_of_a_linkage(self):
        arch = oppenheim()
        lifted = np.zeros((7, 3))
        lifted[3, 1] = 0.01
        response = four_link(arch, rectangle(0.1, 0.5), initial=(lifted, np.zeros((7, 3))))
        assert response.status is Status.NOT_APPLICABLE
        still = four_link(arch, rectangle(0.1, 0.5), initial=np.zeros((2, 7, 3)))
        assert still.status is Status.STANDING

    def test_a_ground_that_falls_away(self):
        motion = af.Motion(np.zeros(50), 0.01, vertical=np.full(50, -1.5 * g))
        assert four_link(oppenheim(), motion).status is Status.NOT_APPLICABLE

    def test_every_status_has_its_message(self):
        assert set(STATUS_MESSAGE) == set(Status)
