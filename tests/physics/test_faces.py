"""Joints that give: the law of a face, rest on it, and motions against other programs."""

import math

import numpy as np
import pytest

import archfrag as af
from archbench.paper.many_points import ManyPoints
from archfrag.errors import ArchfragError, InputError, StabilityError
from archfrag.physics.ground import Impulse, grounds_of
from archfrag.physics.interface import Options
from archfrag.physics.state import Clock, model_of
from archfrag.physics.status import Energy, Status
from archfrag.physics.steps import face_rest, face_step
from archfrag.physics.steps.face_law import Gaps, bear, press
from archfrag.physics.steps.face_rest import first_frequency, settled
from archfrag.physics.steps.face_step import delay_of, new_face_runs
from archfrag.physics.steps.face_velocities import balance, find_velocities
from archfrag.physics.steps.step import accept_step, pose_step
from archfrag.simulation.simulate import simulate_runs
from tests.piers import on_piers

K = 3e10
SHEAR = 2e10
MU = 0.6
# Crown of an arch of 17 voussoirs under a half sine of 0.15 g and 0.25 s, with stiffness damping
# of 5 % at 11 Hz and 9 contact points a face: 3DEC (J. V. Lemos; histories in the data of
# HybriDFEM, thlgrs/HybriDFEM-3.1).
OF_3DEC = {0.1: 1.05, 0.2: 5.55, 0.3: 10.97, 0.4: 14.44, 0.5: 15.95}
PEAK_OF_3DEC = 16.13


def given(arch, stiffness, points=0, damping=0.05, gravity=None):
    """An arch on faces of one stiffness [Pa/m] and a depth of one metre."""
    row = [stiffness, stiffness, damping, float(points)]
    chain = arch.chain._replace(joint=np.tile(row, (arch.n_joint, 1)))
    return arch.changed(
        chain=chain if gravity is None else chain._replace(gravity=gravity)
    )


def lemos(stiffness=1e10, points=3):
    friction = math.tan(math.radians(35.0))
    arch = af.Arch.circular(4.0, 0.5, 180.0, 17, friction, sector=False, density=2700.0)
    return given(arch, stiffness, points, gravity=10.0)


def half_sine(duration, rest, amplitude=1.0):
    time = np.arange(0.0, duration + rest, 5e-4)
    wave = amplitude * np.sin(np.pi * time / duration)
    return af.Motion(np.where(time < duration, wave, 0.0), 5e-4)


def crown(arch, run):
    """Time and sway of the top of the key [s], [mm]."""
    key = arch.n_voussoir // 2
    history = run.history
    above = arch.extrados[key : key + 2, 1].mean() - arch.centroids[key, 1]
    sway = history.displacement.values[:, key, 0]
    sway = sway - above * np.sin(history.rotation.values[:, key])
    return history.time.values, 1e3 * sway


def law_of(d0, d1, half, slip=0.0, length=1e9, points=0.0):
    gaps = Gaps(d0, d1, d0, d1, -half, half, 1.0, d0, d1)
    return bear(gaps, half, (slip,) * 3, length, (K, SHEAR, MU), points)


class TestLaw:
    @pytest.mark.parametrize("turn", [1e-3, -1e-3, 2e-2])
    def test_a_strip_bears_a_third_of_its_length_inside_the_edge(self, turn):
        half = 0.4
        normal = 8e4
        strip = math.sqrt(2.0 * normal / (K * abs(turn)))
        d0 = abs(turn) * (half - strip)
        has = law_of(d0, turn, half)
        assert has.normal == pytest.approx(normal, rel=1e-9)
        edge = -math.copysign(half - strip / 3.0, turn)
        assert has.moment / has.normal == pytest.approx(edge, rel=1e-9)

    @pytest.mark.parametrize("points", [0, 2, 3])
    def test_forces_are_sums_over_the_part_that_overlaps(self, points):
        draw = np.random.default_rng(7)
        for _ in range(40):
            d0 = 1e-5 * draw.normal()
            d1 = 1e-4 * draw.normal()
            half = draw.uniform(0.1, 1.0)
            count = points or 200_001
            place = np.linspace(-half, half, count)
            weight = {
                0: np.full(count, 2.0 * half / (count - 1)),
                2: [half] * 2,
                3: [0.5 * half, half, 0.5 * half],
            }[points]
            force = -K * np.minimum(d0 + d1 * place, 0.0) * weight
            has = law_of(d0, d1, half, points=float(points))
            scale = K * (abs(d0) + half * abs(d1)) * half
            assert has.normal == pytest.approx(force.sum(), abs=1e-5 * scale)
            assert has.moment == pytest.approx(
                (force * place).sum(), abs=1e-5 * scale * half
            )

    @pytest.mark.parametrize("points", [0.0, 2.0, 3.0])
    def test_what_a_joint_stores_is_the_work_of_what_it_bears(self, points):
        """The account of a run does not see it: dashpots take the difference."""
        for d0, d1 in ((-1e-5, 1e-5), (3e-6, -4e-5), (-5e-6, 2e-5)):
            has = law_of(d0, d1, 0.4, points=points)
            less, more, left, right = (
                press(d0 + x, d1 + y, 0.4, K, points)[0]
                for x, y in ((-1e-9, 0), (1e-9, 0), (0, -1e-9), (0, 1e-9))
            )
            assert (less - more) / 2e-9 == pytest.approx(has.normal, rel=1e-5)
            assert (left - right) / 2e-9 == pytest.approx(has.moment, rel=1e-5)

    @pytest.mark.parametrize("points", [0, 2, 3])
    def test_shear_opposes_the_slip_up_to_friction(self, points):
        d0 = -1e-5
        half = 0.5
        small, large = (
            law_of(d0, 0.0, half, slip, points=float(points)) for slip in (1e-6, 1.0)
        )
        assert small.shear == pytest.approx(-SHEAR * 2.0 * half * 1e-6)
        assert small.hold == pytest.approx(SHEAR * 2.0 * half)
        assert large.shear == pytest.approx(-MU * large.normal)
        assert large.hold == 0.0

    def test_what_comes_into_contact_has_not_slipped(self):
        assert law_of(-1e-5, 0.0, 0.5, 1e-6, length=0.1).shear == pytest.approx(
            -SHEAR * 0.1 * 1e-6
        )


class TestSolve:
    @pytest.mark.parametrize("points", [0, 3])
    def test_the_system_is_the_derivative_of_the_balance(self, points):
        arch = given(af.Arch.circular(4.0, 0.5, 180.0, 5, 0.4), 1e10, points)
        model, faces = settled(arch.chain)
        runs = new_face_runs(model, faces)
        draw = np.random.default_rng(3)
        step = 1e-3
        runs.state.clock[Clock.STEP] = step
        runs.state.position[:] = model.start
        runs.state.velocity[1:-1] = 0.02 * draw.normal(size=(5, 3))
        runs.memory.touching[:] = faces.touching
        runs.memory.slip[:] = faces.slip
        pose_step(runs, Impulse(0.0, 0.0))
        work = runs.work
        own = runs.own
        work.solved[:] = runs.state.velocity

        def left():
            balance(runs, step, step)
            return own.left[1:-1].ravel().copy()

        left()
        size = 15
        matrix = np.zeros((15, 15))
        for i in range(5):
            matrix[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = own.block[i + 1]
            if i < 4:
                matrix[3 * i : 3 * i + 3, 3 * i + 3 : 3 * i + 6] = own.upper[i + 1]
                matrix[3 * i + 3 : 3 * i + 6, 3 * i : 3 * i + 3] = own.lower[i + 1]
        for k in range(size):
            i, c = divmod(k, 3)
            ends = []
            for way in (1.0, -1.0):
                work.solved[i + 1, c] += way * 1e-7
                ends.append(left())
                work.solved[i + 1, c] -= way * 1e-7
            slope = (ends[0] - ends[1]) / 2e-7
            # The length in contact also changes the shear, which the iteration leaves out.
            np.testing.assert_allclose(
                matrix[:, k], slope, atol=2e-3 * np.abs(matrix).max()
            )

    @pytest.mark.parametrize("stiffness", [1e9, 1e11, 1e13])
    def test_impulses_balance_momentum(self, stiffness):
        arch = given(af.Arch.circular(4.0, 0.5, 180.0, 9, 0.7), stiffness)
        model, faces = settled(given(arch, max(stiffness, 1e10)).chain)
        runs = new_face_runs(model, faces)
        draw = np.random.default_rng(5)
        runs.state.clock[Clock.STEP] = 2e-4
        runs.state.position[:] = model.start
        runs.state.velocity[1:-1] = 0.1 * draw.normal(size=(9, 3))
        runs.memory.touching[:] = faces.touching
        pose_step(runs, Impulse(0.0, 0.0))
        solved, _ = find_velocities(runs, 2e-4, 2e-4, 1e-9, True)
        assert solved
        work = runs.work
        momentum = np.zeros((11, 2))
        for j in range(10):
            momentum[j + 1] += work.reaction[j, :2]
            momentum[j] -= work.reaction[j, :2]
        change = model.mass[1:-1, None] * (work.solved - work.free)[1:-1, :2]
        np.testing.assert_allclose(
            momentum[1:-1], change, atol=1e-6 * np.abs(change).max()
        )


class TestRest:
    def test_a_block_sinks_by_its_weight_over_its_stiffness(self):
        block = given(af.Block(width=0.4, height=1.0, friction=0.7), 1e9)
        model, faces = settled(block.chain)
        weight = block.chain.mass[0] * block.chain.gravity
        sinks = model_of(block.chain).start[1, 1] - model.start[1, 1]
        assert sinks == pytest.approx(weight / (1e9 * 0.4), rel=1e-6)
        assert faces.stored == pytest.approx(0.5 * weight * sinks, rel=1e-6)

    def test_the_first_mode_of_a_block_is_that_of_two_springs(self):
        width = 0.4
        height = 1.0
        k = 1e9
        block = given(af.Block(width, height, friction=0.7), k)
        mass = block.chain.mass[0]
        arm = 0.5 * height
        inertia = mass * (width**2 + height**2) / 12.0
        shear = k * width
        turn = k * width**3 / 12.0
        stiffness = np.array(
            [[shear, shear * arm], [shear * arm, turn + shear * arm**2]]
        )
        root = np.diag([mass**-0.5, inertia**-0.5])
        lowest = np.linalg.eigvalsh(root @ stiffness @ root)[0]
        found = first_frequency(model_of(block.chain), block.chain)
        assert found == pytest.approx(math.sqrt(lowest) / (2.0 * math.pi), rel=1e-9)

    def test_an_arch_that_falls_on_soft_joints_has_no_rest(self):
        thin = af.Arch.circular(4.0, 0.45, 180.0, 17, 0.7)
        assert settled(given(thin, 1e8).chain) is Status.DOES_NOT_STAND
        assert isinstance(settled(given(thin, 1e12).chain), tuple)

    def test_stress_on_piers_and_free_ends_bears_the_weight(self):
        ring = af.Arch.segmental(8.0, 2.0, 0.8, 8, 0.7)
        for arch in (on_piers(ring, height=3.0, width=2.0), af.Block(0.4, 2.0, 0.7)):
            soft = given(arch, 1e10)
            model, faces = settled(soft.chain)
            assert (model.start[1:-1, 1] < arch.centroids[:, 1]).all()
            assert (faces.touching > 0.0).all()

    @pytest.mark.parametrize("stiffness", [1e10, 3e10, 1e11, 1e12])
    @pytest.mark.parametrize(
        "moved",
        [
            {"spread": 0.003},
            {"spread": 0.02},
            {"spread": 0.03},
            {"spread": -0.02},
            {"settlement": 0.02},
            {"rotation": 0.3},
            {"spread": 0.01, "settlement": 0.01, "springing": "left"},
        ],
    )
    def test_an_arch_rests_after_its_springing_has_moved(self, stiffness, moved):
        ring = af.Arch.segmental(8.0, 3.0, 0.7, 9, friction=0.6)
        arch = af.move_springing(af.jointed(ring, stiffness, model="face"), **moved)
        model, faces = settled(arch.chain)
        assert np.abs(model.start[1:-1] - model_of(arch.chain).start[1:-1]).max() < 0.02
        assert (faces.touching > 0.0).all()

    def test_what_the_solver_does_not_find_is_not_said_to_fall(self, monkeypatch):
        monkeypatch.setattr(face_rest, "settle", lambda *_: face_rest.MOVES_ON)
        with pytest.raises(ArchfragError, match="does not say that it falls") as raised:
            af.simulate(lemos(1.1e10), half_sine(0.25, 0.5))
        assert not isinstance(raised.value, StabilityError)

    @pytest.mark.parametrize("damping", [0.0, 0.05])
    @pytest.mark.parametrize(
        ("seconds", "follow"), [(0.2, 0.0), (5.0, 0.0), (0.2, 3.0)]
    )
    def test_an_arch_rests_under_no_motion(self, damping, seconds, follow):
        arch = af.jointed(
            af.Arch.circular(4.0, 0.6, 150.0, 5, 0.7),
            3e10,
            damping=damping,
            model="face",
        )
        nothing = af.Motion(np.zeros(round(seconds / 0.01)), 0.01)
        run = af.simulate(arch, nothing, follow=follow)
        assert run.status.name == "STANDING"
        assert run.peak_displacement < 1e-9


def ring_that_slides(stiffness, points=None):
    ring = af.Arch.circular(5.0, 1.2, 157.5, 7, friction=0.35)
    return af.jointed(ring, stiffness, model="face", points=points)


def three_waves(size):
    time = np.arange(0.0, 3.0 / 1.6, 0.002)
    wave = size * np.sin(2.0 * math.pi * 1.6 * time)
    return af.Motion(np.concatenate([wave, np.zeros(250)]), 0.002)


class TestEnergy:
    @pytest.mark.parametrize("stiffness", [3e10, 1e11])
    @pytest.mark.parametrize("points", [2, 3, None])
    @pytest.mark.parametrize("size", [4.0, 6.0])
    def test_joints_that_slide_make_none(self, stiffness, points, size):
        arch = ring_that_slides(stiffness, points)
        run = af.simulate(arch, three_waves(size), follow=1.0, method="time_stepping")
        assert run.residual_displacement > 0.1
        assert 0.0 < run.energy_error < 1e-3

    @pytest.mark.parametrize("points", [2, 3, None])
    @pytest.mark.parametrize(
        "broken", ["nothing", "sense of shear", "no friction limit", "what is stored"]
    )
    def test_the_account_fails_if_a_law_is_broken(self, points, broken):
        arch = ring_that_slides(3e10, points)
        model, faces = settled(arch.chain)
        options = Options(*(len(Options._fields) * (0.5,)))
        still = grounds_of([(np.zeros(2), None, 1.0)])
        runs = new_face_runs(model, faces)._replace(options=options, grounds=still)
        step = 5e-4
        clock = runs.state.clock
        runs.state.position[:] = model.start
        runs.memory.slip[:] = faces.slip
        runs.memory.touching[:] = faces.touching
        runs.memory.half[:] = faces.half
        clock[Clock.STORED] = faces.stored
        clock[Clock.STEP] = step
        for number in range(600):
            ground = 6.0 * math.sin(2.0 * math.pi * 1.6 * number * step)
            impulse = Impulse(ground * step, 0.0)
            pose_step(runs, impulse)
            find_velocities(runs, step, delay_of(faces, step), 1e-6, True)
            if broken == "sense of shear":
                reaction = runs.work.reaction
                normal = runs.work.normal
                along = np.column_stack([-normal[:, 1], normal[:, 0]])
                part = (reaction[:, :2] * along).sum(axis=1, keepdims=True)
                reaction[:, :2] -= 2.0 * part * along
            if broken == "no friction limit":
                runs.own.most[:] = math.inf
            if broken == "what is stored":
                clock[Clock.STORED] *= 1.01
            face_step.record_joints.py_func(runs, step, True)
            accept_step(runs, impulse, True)
        energy = runs.state.energy
        error = energy[Energy.BALANCE_ERROR_PEAK] / energy[Energy.LARGEST_KINETIC]
        assert bool(error < 1e-3) is (broken == "nothing")


class TestMotion:
    def test_3dec_gives_the_same_crown(self):
        arch = lemos()
        run = af.simulate(
            arch, half_sine(0.25, 0.5, -1.5), dt=5e-4, history=True, follow=0.0
        )
        time, sway = crown(arch, run)
        assert sway.max() == pytest.approx(PEAK_OF_3DEC, rel=0.02)
        for at, known in OF_3DEC.items():
            assert np.interp(at, time, sway) == pytest.approx(known, rel=0.02)

    @pytest.mark.parametrize("points", [3, 0])
    def test_explicit_springs_at_points_give_the_same_motion(self, points):
        arch = given(af.Arch.circular(4.0, 0.6, 150.0, 5, 0.7), 2e9, points)
        model, faces = settled(arch.chain)
        twin = ManyPoints(arch.chain, points or 65, faces.delay)
        assert twin.own[0] / (2.0 * math.pi) == pytest.approx(
            first_frequency(model, arch.chain), rel=1e-3
        )
        key = arch.n_voussoir // 2
        rest = arch.chain.centroid
        assert twin.position[key + 1, 1] - rest[key, 1] == pytest.approx(
            model.start[key + 1, 1] - rest[key, 1], rel=0.01
        )
        moved = twin.shake(
            lambda t: 5.0 * math.sin(math.pi * t / 0.25) * (t < 0.25), 0.6, 5e-3
        )
        run = af.simulate(
            arch, half_sine(0.25, 0.35, 5.0), dt=2.5e-4, history=True, follow=0.0
        )
        own = run.history.displacement.values[:, key, 0]
        theirs = moved[:, key, 0] - moved[0, key, 0]
        time = 5e-3 * np.arange(theirs.size)
        ours = np.interp(time, run.history.time.values, own)
        assert np.abs(ours).max() == pytest.approx(np.abs(theirs).max(), rel=0.01)
        # Our dashpots act a delay before points close, theirs from then on.
        first = time < 0.3
        assert np.abs(ours - theirs)[first].max() < 0.02 * np.abs(theirs).max()

    def test_energy_is_accounted_for(self):
        for points in (0, 2, 3):
            run = af.simulate(
                lemos(1e10, points), half_sine(0.25, 0.5, 0.8), follow=1.0
            )
            energy = run.energy
            spent = energy["ground"] + energy["friction"] + energy["impacts"]
            has = energy["kinetic"] + energy["potential"]
            assert has == pytest.approx(
                spent + energy["balance_error"], abs=1e-9 * energy["ground"]
            )
            assert energy["friction"] <= 0.0
            assert energy["impacts"] <= 0.0
            assert abs(energy["balance_error"]) <= 1e-3 * energy["ground"]

    def test_dashpots_damp_the_first_mode_by_their_ratio(self):
        arch = given(af.Block(width=1.0, height=1.0, friction=5.0), 1e8, damping=0.05)
        model, _ = settled(arch.chain)
        period = 1.0 / first_frequency(model, arch.chain)
        kick = half_sine(0.5 * period, 8.0 * period, 0.02)
        run = af.simulate(arch, kick, dt=period / 400.0, history=True, follow=0.0)
        sway = run.history.rotation.values[:, 0]
        time = run.history.time.values
        tops = [
            k
            for k in range(1, sway.size - 1)
            if sway[k - 1] < sway[k] >= sway[k + 1] > 0.0
        ]
        tops = [k for k in tops if time[k] > period]
        assert np.diff(time[tops]).mean() == pytest.approx(period, rel=0.01)
        fall = np.diff(np.log(sway[tops])).mean()
        assert fall == pytest.approx(-2.0 * math.pi * 0.05, rel=0.05)

    @pytest.mark.parametrize("damping", [0.0, 0.02, 0.05, 0.1])
    def test_steps_damp_the_first_mode_by_the_ratio_that_is_asked(self, damping):
        block = af.jointed(
            af.Block(width=1.0, height=1.0, friction=5.0),
            3e9,
            model="face",
            damping=damping,
        )
        period = 1.0 / first_frequency(model_of(block.chain), block.chain)
        kick = af.Motion(np.where(np.arange(600) < 3, 0.05, 0.0), period / 20.0)
        run = af.simulate(block, kick, history=True, follow=0.0)
        sway = run.history.rotation.values[:, 0]
        time = run.history.time.values
        after = time > 3.5 * period
        rate = np.gradient(sway[after], time[after])
        # What is left of the first mode after a while, by its energy.
        size = np.hypot(rate, 2.0 * math.pi / period * sway[after])
        span = 6.0 * period
        whole = time[after] - time[after][0]
        ratio = -np.log(np.interp(span, whole, size) / size[0]) / (
            2.0 * math.pi * span / period
        )
        asked = damping / math.sqrt(1.0 - damping**2)
        assert asked - 0.005 < ratio < asked + max(0.012, 0.15 * asked)

    def test_dashpots_press_only_where_faces_touch(self):
        # Peaks of a block that rocks, by explicit springs at 201 points of their own [mm].
        block = af.jointed(
            af.Block(width=0.6, height=2.0, friction=0.7), 1e10, model="face"
        )
        time = np.arange(0.0, 0.4501, 1e-3)
        pulse = af.Motion(
            np.where(time < 0.4, 4.2 * np.sin(math.pi * time / 0.4), 0.0), 1e-3
        )
        run = af.simulate(block, pulse, dt=1e-4, history=True, follow=1.5)
        sway = 1e3 * np.abs(run.history.displacement.values[:, 0, 0])
        tops = [
            sway[k]
            for k in range(1, sway.size - 1)
            if sway[k - 1] < sway[k] >= sway[k + 1]
        ]
        tops = [top for top in tops if top > 10.0]
        np.testing.assert_allclose(tops[:5], [32.4, 29.5, 27.0, 24.6, 22.5], rtol=0.012)

    @pytest.mark.parametrize("stiffness", [3e10, 1e11])
    def test_steps_by_default_slide_as_far_as_short_ones(self, stiffness):
        arch = ring_that_slides(stiffness)
        far = [
            af.simulate(
                arch, three_waves(5.0), size, follow=1.0, dt=dt
            ).residual_displacement
            for dt in (None, 1.5e-4)
            for size in (0.7, 0.8, 0.9, 1.0, 1.1, 1.2)
        ]
        assert sum(far[:6]) == pytest.approx(sum(far[6:]), rel=0.05)

    @pytest.mark.parametrize(("stiffness", "dt"), [(1e10, 1e-3), (1e14, 2e-3)])
    def test_runs_side_by_side_have_the_bits_of_single_ones(self, stiffness, dt):
        # With the stiffer joints some steps find no velocities, and are halved.
        arch = lemos(stiffness, 0)
        factors = [0.7, 0.9, 1.2, 3.0, 0.5]
        motion = half_sine(0.25, 0.5)
        given = {"method": "time_stepping", "dt": dt, "follow": 1.0}
        many = simulate_runs(arch, [motion] * len(factors), factors, **given)
        single = [af.simulate(arch, motion, factor, **given) for factor in factors]
        assert (sum(one.work["shortened"] for one in single) > 0) is (stiffness > 1e12)
        for one, side in zip(single, many, strict=True):
            assert one.work == side.work
            assert one.energy == side.energy
            assert (one.status, one.end_time) == (side.status, side.end_time)
            assert one.peak_rotation == side.peak_rotation

    @pytest.mark.parametrize(("stiffness", "border"), [(1e10, 0.090), (1e11, 0.145)])
    def test_a_thin_arch_falls_earlier_on_joints_that_give(self, stiffness, border):
        # Two programs with a continuous face; rigid joints: 0.185 g.
        arch = lemos(stiffness, 0)
        pulse = half_sine(0.25, 3.0, 10.0)
        falls = [
            af.simulate(arch, pulse, border * part, follow=5.0).collapsed
            for part in (0.92, 1.06)
        ]
        assert falls == [False, True]

    def test_stiff_joints_tend_to_rigid_ones(self):
        rigid = af.Block(width=0.4, height=2.0, friction=0.8)
        pulse = half_sine(0.4, 1.0, 9.81)

        def border(arch):
            low = 0.2
            high = 1.5
            while high / low > 1.004:
                middle = math.sqrt(low * high)
                fell = af.simulate(arch, pulse, middle, follow=8.0).collapsed
                low, high = (low, middle) if fell else (middle, high)
            return low

        assert border(given(rigid, 1e13)) == pytest.approx(border(rigid), rel=0.02)

    def test_a_base_may_move_on_its_own(self):
        arch = lemos()
        motion = half_sine(0.25, 0.5, 1.0)
        alike, apart = (
            af.simulate(arch, motion, bases={"right": own}, follow=1.0)
            for own in (motion, 0.05)
        )
        alone = af.simulate(arch, motion, follow=1.0)
        assert alike.peak_rotation == pytest.approx(alone.peak_rotation, rel=1e-6)
        assert apart.peak_rotation != pytest.approx(alone.peak_rotation, rel=1e-3)

    def test_what_needs_rigid_joints_refuses(self):
        with pytest.raises(InputError, match="method event_driven needs rigid joints"):
            af.simulate(lemos(), half_sine(0.25, 0.5), method="event_driven")
        rest = np.zeros((17, 3))
        with pytest.raises(InputError, match="initial needs rigid joints"):
            af.simulate(lemos(), half_sine(0.25, 0.5), initial=(rest, rest))
        with pytest.raises(InputError, match="limit_load needs rigid joints"):
            af.limit_load(lemos())
