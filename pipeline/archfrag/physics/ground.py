"""Ground motions of many runs: impulses over steps, segments between samples, and rest."""

from collections.abc import Collection, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from archfrag.physics.kernels.kernel import inlined, kernel
from archfrag.physics.kernels.primitives import lane, width, with_lane
from archfrag.physics.kernels.structs import struct
from archfrag.physics.state import Clock

# Loads beyond the range of rest by less than this part of gravity leave forces that no contact
# problem distinguishes from rounding: rounding, not the load, would start the motion.
BEYOND = 1e-11
# An instant this near to a sample, over the time step, belongs to the piece behind it.
BARELY = 1e-9


class Impulse(NamedTuple):
    """Velocity that a ground motion takes from free bodies in a step."""

    x: float  # integral of the acceleration of the left base [m/s]
    y: float


class Segment(NamedTuple):
    """Ground acceleration from an instant on, for as long as it is linear in time."""

    end: float  # time until which it is linear [s]; inf after the record
    x: float  # at that instant [m/s2]
    slope_x: float  # [m/s3]
    y: float
    slope_y: float
    # Of the right base relative to the left one, at that instant: acceleration, velocity,
    # displacement and jerk.
    far_x: tuple[float, float, float, float]
    far_y: tuple[float, float, float, float]


@struct()
class Grounds(NamedTuple):
    """Ground motions one after the other: linear between samples, zero outside them."""

    horizontal: np.ndarray  # (n_sample,) of all motions [m/s2]
    vertical: np.ndarray  # (n_sample,) upwards [m/s2]
    impulse_x: np.ndarray  # (n_sample,) integral from each motion's first sample [m/s]
    impulse_y: np.ndarray  # (n_sample,)
    # (n_sample, n_base, 2, 3) x, y: acceleration, velocity and displacement of each base but the
    # left one, relative to that one; of length zero where all move alike
    far: np.ndarray
    # (n_sample,) int64: number in its motion of the next sample at which the slope changes
    next_break: np.ndarray
    first: np.ndarray  # (n_motion + 1,) int64: where each motion begins
    time_step: np.ndarray  # (n_motion,) [s]
    # (n_motion,) when a run notes whether the chain still moves; 0: never [s]
    noted: np.ndarray


OF_SAMPLES = Grounds._fields[:6]  # those with a row for each sample


def _integral(wave: np.ndarray, dt: float) -> np.ndarray:
    total = np.zeros(wave.shape)
    if np.any(wave):
        np.add(wave[1:], wave[:-1], out=total[1:])
        total *= 0.5 * dt
        np.cumsum(total, out=total)
    return total


def _far(acceleration: np.ndarray, dt: float) -> np.ndarray:
    """Return acceleration, velocity and displacement (n, n_base, 2, 3) of an acceleration.

    Its samples (n, n_base, 2) are `dt` apart [s], and it is linear between them.
    """
    waves = acceleration.reshape(len(acceleration), -1).T
    velocity = np.column_stack([_integral(wave, dt) for wave in waves])
    velocity = velocity.reshape(acceleration.shape)
    rise = dt * velocity[:-1] + dt**2 / 6.0 * (
        2.0 * acceleration[:-1] + acceleration[1:]
    )
    start = np.zeros((1, *acceleration.shape[1:]))
    displacement = np.concatenate([start, np.cumsum(rise, axis=0)])
    return np.stack([acceleration, velocity, displacement], axis=-1)


def _breaks(*waves: np.ndarray) -> np.ndarray:
    x = waves[0]
    largest = max(np.abs(wave).max() for wave in waves)
    last = x.size - 1
    following = np.full(x.size, last)
    bend = sum(np.abs(part[:-2] - 2.0 * part[1:-1] + part[2:]) for part in waves)
    bent = np.flatnonzero(bend > 1e-12 * largest) + 1
    following[bent - 1] = bent
    return np.append(np.minimum.accumulate(following[:-1][::-1])[::-1], last)


def grounds_of(motions: Sequence[tuple[Any, ...]], noted=()) -> Grounds:
    """Join ground motions, each (horizontal, vertical or None, time step), into arrays.

    A fourth entry, if there is one and it is not None, is the acceleration (n_sample, n_base, 2)
    of the bases but the left one, less that of the left one. `noted`: when to note whether the
    chain still moves [s].
    """
    x = [np.ascontiguousarray(given[0], float) for given in motions]
    # Zeros that are only read take no memory.
    y = [
        np.zeros(wave.shape)
        if given is None or not np.any(given)
        else np.asarray(given, float)
        for wave, (_, given, *_) in zip(x, motions)
    ]
    step = np.array([float(each[2]) for each in motions])
    apart = [
        each[3] if len(each) > 3 and each[3] is not None else None for each in motions
    ]
    bases = [np.shape(each)[1] for each in apart if each is not None]
    far = np.zeros((0, 1, 2, 3))
    if bases:
        alike = bases[0], 2
        given = (
            np.zeros((w.size, *alike)) if a is None else a for w, a in zip(x, apart)
        )
        far = np.concatenate(
            [_far(np.asarray(a, float), dt) for a, dt in zip(given, step)]
        )

    def joined(waves: Sequence[np.ndarray]) -> np.ndarray:
        return waves[0] if len(waves) == 1 else np.concatenate(waves)

    of_x, of_y = (
        joined([_integral(w, dt) for w, dt in zip(waves, step)]) for waves in (x, y)
    )
    first = np.cumsum([0, *(wave.size for wave in x)])
    waves_of = far[..., 0].reshape(len(far), 2 * far.shape[1])
    parts = [waves_of[a:b].T for a, b in pairwise(first.tolist())]
    breaks = joined(
        [_breaks(a, b, *c) if c.size else _breaks(a, b) for a, b, c in zip(x, y, parts)]
    )
    after = np.array(noted if len(noted) else np.zeros(step.size), float)
    return Grounds(joined(x), joined(y), of_x, of_y, far, breaks, first, step, after)


class MotionPlaces:
    """Ground motions that come and go, in the arrays of one `Grounds`.

    The motion in place k has the number 2 k; odd numbers are of the gaps between.
    """

    def __init__(self, count: int) -> None:
        self._held: list[Grounds | None] = [None] * count
        self._last = 0
        self.grounds = grounds_of([(np.zeros(1), None, 1.0)] * (2 * count))

    def put(self, one: Grounds, used: Collection[int]) -> int:
        """Hold a motion, unless it is held already; return its number.

        `used` are the numbers of motions that must stay; they leave a place free.
        """
        held = self._held
        for place, other in enumerate(held):
            if other is one:
                return 2 * place
        order = np.roll(range(len(held)), -1 - self._last).tolist()
        place = self._last = next(k for k in order if 2 * k not in used)
        held[place] = one
        size = self.grounds.horizontal.size // len(held)
        fits = one.horizontal.size <= size
        if fits and bool(one.far.size) <= bool(self.grounds.far.size):
            self._write(place, one)
            return 2 * place
        rows = len(held) * max(one.horizontal.size, size)
        like = one if one.far.size else one._replace(far=self.grounds.far)
        larger = {
            name: np.zeros((rows, *values.shape[1:]), values.dtype)
            for name, values in zip(OF_SAMPLES, like)
            if len(values)
        }
        self.grounds = self.grounds._replace(**larger)
        for each, other in enumerate(held):
            if other is not None:
                self._write(each, other)
        return 2 * place

    def _write(self, place: int, one: Grounds) -> None:
        whole = self.grounds
        start = place * (whole.horizontal.size // len(self._held))
        end = start + one.horizontal.size
        for name, values in zip(OF_SAMPLES, one):
            to = getattr(whole, name)
            if len(to):
                to[start:end] = values if len(values) else 0.0
        number = 2 * place
        whole.first[number : number + 2] = start, end
        whole.time_step[number] = one.time_step[0]
        whole.noted[number] = one.noted[0]


def one_of(grounds: Grounds, number: int, factor: float) -> Grounds:
    """Return one of several ground motions, multiplied by a factor."""
    part = slice(*grounds.first[number : number + 2])
    scaled = factor * grounds.horizontal[part], factor * grounds.vertical[part]
    far = factor * grounds.far[part, ..., 0] if grounds.far.size else None
    alone = (*scaled, grounds.time_step[number], far)
    return grounds_of([alone], grounds.noted[number : number + 1])


@inlined
def _impulse_until(time, acceleration, impulse, first, last, time_step):
    """Return the integral of one motion's acceleration from its start to `time` [m/s].

    `first` and `last` are the numbers of the motion's first and last samples in `acceleration`;
    samples are `time_step` apart [s]. `impulse` has the integral up to each sample. The integral
    is 0 before the first and constant after the last.
    """
    place = time * (1.0 / time_step)
    if place <= 0.0:
        return 0.0
    i = first + int(place)
    if i >= last:
        return impulse[last]
    part = place - (i - first)
    slope = acceleration[i + 1] - acceleration[i]
    return impulse[i] + time_step * part * (acceleration[i] + 0.5 * part * slope)


@inlined
def _place_of(grounds, motion):
    """Return the first and the last sample of a motion, and its time step [s]."""
    last = grounds.first[motion + 1] - 1
    return grounds.first[motion], last, grounds.time_step[motion]


@inlined
def _far_at(grounds, base, c, motion, time):
    """Return acceleration, velocity, displacement and jerk of a base at `time` [s].

    They are relative to the left base. `base` counts the others from 0 at the left; `c` is 0 for
    x, 1 for y. The factor on the motion is left out. After the last sample the base stands still.
    """
    far = grounds.far
    if far.shape[0] == 0:
        return 0.0, 0.0, 0.0, 0.0
    first, last, dt = _place_of(grounds, motion)
    place = max(time, 0.0) / dt
    i = first + int(place)
    if i >= last:
        return 0.0, 0.0, far[last, base, c, 2], 0.0
    a = far[i, base, c, 0]
    v = far[i, base, c, 1]
    u = far[i, base, c, 2]
    jerk = (far[i + 1, base, c, 0] - a) / dt
    s = (place - (i - first)) * dt
    u += s * (v + s * (0.5 * a + s * jerk / 6.0))
    return a + s * jerk, v + s * (a + 0.5 * s * jerk), u, jerk


@kernel
def _far_between(grounds, clock, base, c, start, end):
    """Return how a base moves from `start` to `end` [s] in direction `c`, as in `_far_at`.

    Returned are the displacement in the middle [m], the mean velocity before the middle and the
    mean velocity after the middle [m/s].

    Reads: grounds (far, first, time_step), clock.
    """
    middle = before = after = 0.0 * start
    for k in range(width(clock[Clock.TIME])):
        motion = int(lane(clock[Clock.MOTION], k))
        factor = lane(clock[Clock.FACTOR], k)
        a = lane(start, k)
        b = lane(end, k)
        first = factor * _far_at(grounds, base, c, motion, a)[2]
        half = factor * _far_at(grounds, base, c, motion, 0.5 * (a + b))[2]
        last = factor * _far_at(grounds, base, c, motion, b)[2]
        per = 2.0 / (b - a)
        middle = with_lane(middle, k, half)
        before = with_lane(before, k, per * (half - first))
        after = with_lane(after, k, per * (last - half))
    return middle, before, after


@inlined
def _gained(acceleration, impulse, start, end, place):
    """Return the integral of one motion from `start` to `end` [m/s].

    `place` is from `_place_of`.
    """
    first, last, dt = place
    late = _impulse_until(end, acceleration, impulse, first, last, dt)
    return late - _impulse_until(start, acceleration, impulse, first, last, dt)


@kernel
def impulse_between(grounds, clock, start, end):
    """Return the `Impulse` of the ground motion from `start` to `end` [s].

    Reads: grounds (first, horizontal, impulse_x, impulse_y, time_step, vertical), clock.
    """
    x = y = 0.0 * start
    for k in range(width(clock[Clock.TIME])):
        motion = int(lane(clock[Clock.MOTION], k))
        factor = lane(clock[Clock.FACTOR], k)
        place = _place_of(grounds, motion)
        a = lane(start, k)
        b = lane(end, k)
        given = _gained(grounds.horizontal, grounds.impulse_x, a, b, place)
        x = with_lane(x, k, factor * given)
        given = _gained(grounds.vertical, grounds.impulse_y, a, b, place)
        y = with_lane(y, k, factor * given)
    return Impulse(x, y)


@kernel
def move_ground(runs):
    """Move all bases to the middle of the next step; return the `Impulse` of that step.

    Writes: runs (state.velocity, work.free, work.position).
    """
    grounds = runs.grounds
    work = runs.work
    clock = runs.state.clock
    start = clock[Clock.TIME]
    end = start + clock[Clock.STEP]
    moves = grounds.far.shape[0] > 0
    first = runs.model.end
    for i in range(first, runs.model.mass.size):
        for c in range(2):
            middle = before = after = 0.0 * start
            if moves:
                middle, before, after = _far_between(
                    grounds, clock, i - first, c, start, end
                )
            work.position[i, c] = middle
            runs.state.velocity[i, c] = before
            work.free[i, c] = after
    return impulse_between(grounds, clock, start, end)


@inlined
def end_of_motion(grounds, clock, follow):
    """Return the time at which a run ends at the latest [s].

    That is `follow` [s] after the last sample.
    """
    end = 0.0 * clock[Clock.TIME]
    for k in range(width(clock[Clock.TIME])):
        first, last, dt = _place_of(grounds, int(lane(clock[Clock.MOTION], k)))
        end = with_lane(end, k, (last - first) * dt + follow)
    return end


@kernel
def segment_at(time, grounds):
    """Return the `Segment` of the first ground motion that begins at `time` [s].

    Reads: grounds (far, first, horizontal, next_break, time_step, vertical).
    """
    dt = grounds.time_step[0]
    x = grounds.horizontal
    y = grounds.vertical
    i = int(np.floor(time / dt + BARELY))
    far_x = _far_at(grounds, 0, 0, 0, max(time, i * dt))
    far_y = _far_at(grounds, 0, 1, 0, max(time, i * dt))
    if i >= grounds.first[1] - 1:
        return Segment(np.inf, 0.0, 0.0, 0.0, 0.0, far_x, far_y)
    part = time - i * dt
    rate_x = (x[i + 1] - x[i]) / dt
    rate_y = (y[i + 1] - y[i]) / dt
    now_x = x[i] + rate_x * part
    now_y = y[i] + rate_y * part
    end = grounds.next_break[i] * dt
    return Segment(end, now_x, rate_x, now_y, rate_y, far_x, far_y)


@inlined
def ground_after(ground, time):
    """Return the ground acceleration a `time` [s] after the beginning of a `Segment` [m/s2].

    Returned are x and y, then x and y of the right base relative to the left one.
    """
    x = ground.x + ground.slope_x * time
    y = ground.y + ground.slope_y * time
    far_x = ground.far_x
    far_y = ground.far_y
    return x, y, far_x[0] + far_x[3] * time, far_y[0] + far_y[3] * time


@kernel
def rest_margin(horizontal, vertical, gravity, limit_plus, limit_minus):
    """Return the distance of a body force from the limit of rest; negative outside [m/s2].

    `limit_plus` and `limit_minus` are load factors [g]. Rest depends on the direction of the body
    force only: ``-limit_minus <= k_h / (1 + k_v) <= limit_plus``, a convex cone, so that a force
    linear in time between two samples inside it stays inside.
    """
    effective = gravity + vertical
    margin = effective
    if not np.isinf(limit_plus):
        margin = min(margin, limit_plus * effective - horizontal)
    if not np.isinf(limit_minus):
        margin = min(margin, limit_minus * effective + horizontal)
    return margin


@inlined
def _moves_apart(far, i):
    """Return whether bases move apart between sample `i` and the next."""
    moves = False
    for base in range(far.shape[1]):
        for c in range(2):
            for n in range(2):
                here = far[i, base, c, n]
                moves = moves or here != 0.0 or far[i + 1, base, c, n] != 0.0
    return moves


@kernel
def end_rest(model, grounds, clock, plus, minus):
    """Return the time until which a chain rests [s], and whether it rests for good.

    `plus` and `minus` are the limits of its range of rest [g]. It does not rest while
    bases move apart.

    Reads: model.gravity, grounds (far, first, horizontal, time_step, vertical), clock.
    """
    factor = clock[Clock.FACTOR]
    first, last, dt = _place_of(grounds, int(clock[Clock.MOTION]))
    wave = grounds.horizontal
    rise = grounds.vertical
    g = model.gravity
    time = clock[Clock.TIME]
    i = first + int(time / dt)
    if i < last:
        part = time / dt - (i - first)
        x = factor * (wave[i] + part * (wave[i + 1] - wave[i]))
        y = factor * (rise[i] + part * (rise[i + 1] - rise[i]))
        margin = rest_margin(x, y, g, plus, minus) + BEYOND * g
        if margin < 0.0:
            return time, False
        while i < last:
            lasts = (i + 1 - first) * dt > time + BARELY * dt
            if grounds.far.shape[0] > 0 and lasts and _moves_apart(grounds.far, i):
                return time, False
            i += 1
            following = rest_margin(factor * wave[i], factor * rise[i], g, plus, minus)
            following += BEYOND * g
            here = (i - first) * dt
            if following < 0.0:
                return time + (here - time) * margin / (margin - following), False
            time = here
            margin = following
    for_good = rest_margin(0.0, 0.0, g, plus, minus) >= 0.0
    return max(clock[Clock.TIME], (last - first) * dt), for_good
