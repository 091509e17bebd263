"""Time stepping as a method: one run, or many of one arch, several at a time.

The stepper is the same for rigid joints and for joints that give; each has a `Law` of its own.
With rigid joints nothing is integrated while the body force stays inside the range of rest of the
configuration; a chain on springs is never at rest in a motion. Four or eight runs go side by side
until one waits for what has to be done for it alone (`Law.handle`), and a run that has ended makes
place for the next, which may have been added meanwhile (`Lanes`). A run's results are the same to
the last bit, whether it goes alone or beside others.
"""

import functools
import threading
from collections.abc import Callable, Sequence

import numpy as np

from archfrag.physics import shared
from archfrag.physics.contact.path import new_path
from archfrag.physics.contact.placing import move_faces
from archfrag.physics.ground import (
    Grounds,
    MotionPlaces,
    end_of_motion,
    move_ground,
)
from archfrag.physics.interface import Chain, Frames, MechanismLog, Options, Outcomes
from archfrag.physics.kernels.kernel import kernel
from archfrag.physics.kernels.primitives import (
    LANES,
    lane,
    lane_array,
    runs_of,
    some,
    width,
)
from archfrag.physics.state import KEPT, Clock, Law, Model, Runs, model_of, new_runs
from archfrag.physics.status import Cause, Count, Energy, Level, Status, Wait
from archfrag.physics.steps import service
from archfrag.physics.steps.at_impacts import solve_contacts
from archfrag.physics.steps.face_rest import settled
from archfrag.physics.steps.face_step import new_face_runs
from archfrag.physics.steps.step import (
    accept_contacts,
    accept_step,
    pose_contacts,
    pose_step,
)
from archfrag.system import Deferred

UNKNOWN = (np.nan, np.nan)
load = Deferred("archfrag.physics.kernels.load")  # it needs LLVM
PLACES = 3 * LANES[-1]  # for runs that go on or wait
PATIENCE = 200  # pieces of work between two looks for other runs where there is room
RIGID = Law(
    pose=pose_contacts,
    solve=solve_contacts,
    accept=accept_contacts,
    go_on=service.go_on,
    start=service.rest,
    handle=service.handle,
)


@kernel
def try_step(runs, live):
    """Pose the next step of every run, and solve it.

    Return the impulse of the ground, and the masks solved and unsolved. A run in neither has had
    its step shortened, or its step is not done yet.
    """
    impulse = move_ground(runs)
    pose_step(runs, impulse)
    solved, unsolved = runs.law.solve(runs, live)
    return impulse, solved, unsolved


@kernel
def step_several(runs):
    """Step runs side by side until one waits; the reason is in ``state.clock[Clock.CODE]``."""
    clock = runs.state.clock
    until = end_of_motion(runs.grounds, clock, runs.options.follow)
    waits = False
    while not waits:
        impulse, solved, unsolved = try_step(runs, clock[Clock.CODE] == Wait.GO)
        collapsed = broken = clock[Clock.CODE] != clock[Clock.CODE]
        if some(solved):
            collapsed, broken = accept_step(runs, impulse, solved)
        runs.law.go_on(runs, until, (solved, unsolved, collapsed, broken))
        code = clock[Clock.CODE]
        waits = some((code != Wait.GO) & (code != Wait.IDLE))


@kernel
def step_one(runs, until, output):
    """Try a step of one run, and write its history; as `step_several` set its code."""
    impulse, solved, unsolved = try_step(runs, True)
    collapsed = broken = False
    if solved:
        collapsed, broken = service.accept_recorded(runs, impulse, output)
    runs.law.go_on(runs, until, (solved, unsolved, collapsed, broken))


@kernel
def end(runs, output, results):
    """Write the results of a run that has ended.

    Energy that joints store counts as potential energy.

    Writes: output (energy, peak), results.energy.
    """
    clock = runs.state.clock
    row = int(clock[Clock.RUN])
    given = runs.model, runs.state, runs.work, runs.options
    shared.end_run(*given, output, results, row)
    stored = clock[Clock.STORED] - clock[Clock.STORED_FIRST]
    results.energy[row, Energy.POTENTIAL] += stored


@kernel
def start_at_rest(runs, motion, factor, output):
    """Start a run from rest where the model starts.

    `motion` is the number of its ground motion, and `factor` multiplies that motion.
    """
    shared.begin(runs.model, runs.state, runs.work, motion, factor)
    runs.state.clock[Clock.CODE] = runs.law.start(runs, output)


@kernel
def start_given(runs, output):
    """Start from the positions and velocities of a given state."""
    shared.read_state(runs.model, runs.state, runs.work)
    shared.log_change(runs.state, 0.0, Cause.START, -1, Level.ALL_VOUSSOIRS, output)
    service.start_moving(runs.state, runs.options, output)


@kernel
def run_one(runs, at_rest, output, results):
    """Move one run to its end, with its history."""
    clock = runs.state.clock
    work = runs.work
    if at_rest:
        start_at_rest(runs, 0, clock[Clock.FACTOR], output)
    else:
        start_given(runs, output)
    until = end_of_motion(runs.grounds, clock, runs.options.follow)
    while clock[Clock.CODE] == Wait.GO:
        step_one(runs, until, output)
        runs.law.handle(runs, output)
    position = runs.state.position
    move_faces(runs.model, position, work)
    end(runs, output, results)


@kernel
def start_next(one, waiting, begun, motion, factor, output, results):
    """Start the next run of `waiting` that moves at all; end those before it.

    `begun` counts those that were begun. If none moves, the run is `Wait.IDLE`.
    """
    clock = one.state.clock
    while begun[0] < waiting.size:
        run = waiting[begun[0]]
        begun[0] += 1
        start_at_rest(one, motion[run], factor[run], output)
        clock[Clock.RUN] = run
        if clock[Clock.CODE] == Wait.GO:
            return
        end(one, output, results)
    clock[Clock.CODE] = Wait.IDLE
    clock[Clock.STEP] = one.options.time_step


@kernel
def copy_run(of, place, to, number):
    """Copy the values that a run keeps from place `place` of `of` to place `number` of `to`.

    Reads: of.columns.
    Writes: to.columns.
    """
    for k in range(len(of.columns)):
        for i in range(of.columns[k].shape[0]):
            to.columns[k][i, number] = of.columns[k][i, place]


@kernel
def count_going(several):
    """Return how many of the runs side by side have not ended.

    Reads: several.state.clock.
    """
    going = 0
    code = several.state.clock[Clock.CODE]
    for number in range(width(code)):
        going += int(lane(code, number)) != Wait.IDLE
    return going


@kernel
def run_several(
    several, one, waiting, begun, motion, factor, patience, output, results
):
    """Go on with runs side by side, from rest; those of `waiting` begin where there is room.

    `several` steps them; `one` starts, serves and ends each of them alone. Run k has the motion of
    number ``motion[k]`` times ``factor[k]``, and row k of the results. `begun` counts those of
    `waiting` that were begun. Where room is left, it returns once a run has ended, or after
    `patience` pieces of work; if that is negative, once all have ended.
    """
    work = one.work
    clock = several.state.clock
    lanes = width(clock[Clock.CODE])
    for number in range(lanes):
        if int(lane(clock[Clock.CODE], number)) == Wait.IDLE:
            start_next(one, waiting, begun, motion, factor, output, results)
            copy_run(one, 0, several, number)
    going = count_going(several)
    to_end = patience < 0
    left = patience
    while going == lanes or (going > 0 and (to_end or left > 0)):
        left -= 1
        step_several(several)
        for number in range(lanes):
            code = int(lane(clock[Clock.CODE], number))
            if code in (Wait.GO, Wait.IDLE):
                continue
            copy_run(several, number, one, 0)
            position = one.state.position
            move_faces(one.model, position, work)
            if one.law.handle(one, output) != Wait.GO:
                end(one, output, results)
                left = 0
                start_next(one, waiting, begun, motion, factor, output, results)
            copy_run(one, 0, several, number)
        going = count_going(several)


def new_rigid_runs(model: Model, zeros=np.zeros) -> Runs:
    """Allocate one run with rigid joints, or four with `lane_array` as `zeros`."""
    return new_runs(RIGID, model, zeros, path=new_path(model))


@functools.lru_cache(maxsize=KEPT)
def rest_of(model: Model) -> tuple[float, float]:
    """Return the range of rest of a chain in its own geometry, plus and minus [g].

    Both are nan if it cannot rest.
    """
    one = new_rigid_runs(model)
    shared.begin(model, one.state, one.work, 0, 0.0)
    found, plus, minus = service.rest_range(model, one.state, one.work, one.path.rest)
    return (plus, minus) if found else UNKNOWN


_kept = threading.local()


def _makes(
    chain: Chain, options: Options, from_rest: bool = True
) -> tuple[Callable, Model, Options] | Status:
    """Return a function that allocates runs of a chain, its model, and the options filled in.

    If the chain has no rest on joints that give, return its status.
    """
    if chain.joint is None:
        model = model_of(chain)
        rest = rest_of(model) if from_rest else UNKNOWN
        options = shared.ready(options, model, rest)
        return functools.partial(new_rigid_runs, model), model, options
    found = settled(chain)
    if isinstance(found, Status):
        return found
    return functools.partial(new_face_runs, *found), found[0], options


def lanes_for(chain: Chain) -> int:
    """Return how many runs of a chain go side by side.

    Runs with rigid joints of one span go eight at a time where that is faster.
    """
    plain = chain.joint is None and chain.body is None
    return LANES[plain and load.takes_eight()]


def _side_by_side(make: Callable[..., Runs], count: int) -> Runs:
    """Allocate runs side by side."""
    return make(functools.partial(lane_array, count=count))


def _begin_none(several: Runs) -> None:
    """Reset runs side by side, so that none of them has begun."""
    runs_of(several.state.clock)[Clock.CODE] = Wait.IDLE


def _runs_for(
    chain: Chain, grounds: Grounds, options: Options, from_rest: bool = True
) -> list[Runs] | Status:
    """Return runs of a chain side by side, and one alone; or why there are none.

    A thread keeps the buffers that it used last.
    """
    found = _makes(chain, options, from_rest)
    if isinstance(found, Status):
        return found
    make, model, options = found
    count = lanes_for(chain)
    if getattr(_kept, "of", None) != (id(model), count):
        _kept.of = id(model), count
        _kept.runs = _side_by_side(make, count), make()
    return [each._replace(grounds=grounds, options=options) for each in _kept.runs]


def run(
    chain: Chain,
    grounds: Grounds,
    factor: float,
    position: np.ndarray,
    velocity: np.ndarray,
    from_rest: bool,
    options: Options,
    frames: Frames,
    log: MechanismLog,
) -> Outcomes:
    """Integrate one chain under one ground motion; the signature of every method.

    Parameters
    ----------
    position, velocity : ndarray, (n_body, 3)
        Initial state; overwritten with the final one.
    from_rest : bool
        Whether the initial state is the chain at rest in its own geometry. Chains whose joints
        give begin at rest on them, whatever the state given.
    frames, log
        Overwritten with the history and the changes of the mechanism; of length zero for none.

    Returns
    -------
    archfrag.physics.interface.Outcomes
        One row.
    """
    results = shared.new_results(1)
    found = _runs_for(chain, grounds, options, from_rest)
    if isinstance(found, Status):
        results.status[:] = int(found)
        return results
    one = found[1]
    state = one.state
    output = shared.output_to(frames, log, options.frame_interval)
    state.clock[Clock.FACTOR] = factor
    bodies = slice(1, one.model.end)
    state.position[:] = state.velocity[:] = 0.0
    state.position[bodies] = position
    state.velocity[bodies] = velocity
    rests = from_rest and not np.isnan(one.options.rest_plus)
    run_one(one, rests or chain.joint is not None, output, results)
    position[:] = state.position[bodies]
    velocity[:] = state.velocity[bodies]
    results.count[0, Count.FRAMES], results.count[0, Count.LOG_ENTRIES] = output.written
    return results


def run_many(
    chain: Chain,
    grounds: Grounds,
    motion: np.ndarray,
    factor: np.ndarray,
    options: Options,
) -> Outcomes:
    """Integrate one chain from rest under many scaled ground motions, several at a time.

    Run k is moved by the motion of number ``motion[k]``, times ``factor[k]``; its row of the
    results is the same as of `run`.
    """
    results = shared.new_results(len(motion))
    found = _runs_for(chain, grounds, options)
    if isinstance(found, Status):
        results.status[:] = int(found)
        return results
    output = shared.no_output(chain.mass.size, chain.friction.size)
    motion = np.ascontiguousarray(motion, np.int64)
    factor = np.ascontiguousarray(factor, float)
    _begin_none(found[0])
    waiting = np.arange(len(motion))
    run_several(*found, waiting, np.zeros(1, int), motion, factor, -1, output, results)
    return results


Given = tuple[Grounds, float, Options]  # motion, factor and options of a run
Check = Callable[[Outcomes, Sequence[Given]], Outcomes]


class Lanes:
    """Runs of one chain that go on side by side, from rest, to which others are added.

    Their results are those of `run_many`; `check` takes them and what each run was added with.
    `steps` has the steps that each run has made so far.
    """

    def __init__(self, several: Runs, one: Runs, output: shared.Output, check: Check):
        self._several = several
        self._one = one
        self._output = output
        self._check = check
        _begin_none(several)
        self._motions = MotionPlaces(PLACES)
        self._motion = np.zeros(PLACES, int)
        self._factor = np.zeros(PLACES)
        self._given: dict[int, Given] = {}  # by the numbers of the runs held
        self._waiting: list[int] = []
        self.steps = np.zeros(PLACES)

    def add(self, ground: Grounds, factor: float, options: Options) -> int:
        """Add a run with one ground motion, to at most `PLACES`; return its number.

        The number is another run's once this one has ended. `options` differ from those of the
        other runs at most in the bound on its work.
        """
        run = next(k for k in range(PLACES) if k not in self._given)
        used = [int(self._motion[other]) for other in self._given]
        self._motion[run] = self._motions.put(ground, used)
        self._factor[run] = factor
        self._given[run] = ground, factor, options
        self._waiting.append(run)
        self.steps[run] = 0.0
        return run

    def go_on(self) -> tuple[list[int], Outcomes]:
        """Go on until a run has ended and leaves room, or for a while if there is room.

        Return the numbers of the runs that have ended, and a row of results for each.
        """
        grounds = self._motions.grounds
        runs = [each._replace(grounds=grounds) for each in (self._several, self._one)]
        results = shared.new_results(PLACES)
        results.status[:] = -1
        begun = np.zeros(1, int)
        waiting = np.array(self._waiting, int)
        moves = self._motion, self._factor
        run_several(*runs, waiting, begun, *moves, PATIENCE, self._output, results)
        del self._waiting[: int(begun[0])]
        state = self._several.state
        clock = runs_of(state.clock)
        going = clock[Clock.CODE] != Wait.IDLE
        numbers = clock[Clock.RUN, going].astype(int)
        self.steps[numbers] = runs_of(state.count)[Count.STEPS, going]
        ended = np.flatnonzero(results.status >= 0)
        self.steps[ended] = results.count[ended, Count.STEPS]
        given = [self._given.pop(run) for run in ended.tolist()]
        made = Outcomes(*(values[ended] for values in results))
        return ended.tolist(), self._check(made, given)


def lanes(
    chain: Chain, options: Options, check: Check = lambda made, given: made
) -> Lanes | None:
    """Return lanes for runs of a chain; None if it has no rest on joints that give."""
    found = _makes(chain, options)
    if isinstance(found, Status):
        return None
    make, _, options = found
    output = shared.no_output(chain.mass.size, chain.friction.size)
    runs = _side_by_side(make, lanes_for(chain)), make()
    several, one = (each._replace(options=options) for each in runs)
    return Lanes(several, one, output, check)
