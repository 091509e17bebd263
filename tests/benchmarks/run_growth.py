"""How the cost of one arch grows with the number of voussoirs that it is cut into.

Three spans of the arch of validation (R 10 m, t 1.5 m, embrace 157.5 degrees, no sliding):
"one mechanism", a second of a load just above onset, without impacts, in arches of seven voussoirs
that are cut further where the thrust stays inside the ring, so that the same four joints hinge
whatever the number (the script sees to it); "equal cuts", a somewhat larger load up to before the
first impact, in equal voussoirs; "whole scene", validation's pulse to the end, in equal
voussoirs. And the arch at rest in a record. Row "growth".
"""

import argparse
import math
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import stats
from tables import machine, markdown, write_csv
from watched import watched

import archfrag
from archfrag.arch import STANDARD_GRAVITY
from archfrag.simulate import Response, warmup

EMBRACE = 157.5
SEVEN = np.linspace(0.0, EMBRACE, 8)
NUMBERS = (7, 14, 27, 54, 81, 108)
# Angles [degrees] between which a joint stays closed under such a load: away from the hinges at
# 45 and 90 degrees, on the sides to which the thrust does not lean.
INSIDE = ((1.0, 21.5), (23.5, 34.0), (46.5, 66.5), (68.5, 88.5), (113.5, 134.0), (136.0, 156.5))
# Mean and ripple of a load [g], its samples' step and its duration [s].
NEAR_ONSET = (0.374, 0.001, 0.005, 1.0)
ABOVE_ONSET = (0.40, 0.01, 0.01, 0.29)
PULSE, PULSE_LENGTH, PULSE_STEP = 0.5, 0.3, 1e-3
RECORD = Path(__file__).parents[2] / "records/synthetic/syn-m75-r020.mseed"


class Sample(NamedTuple):
    """One timed run."""

    span: str
    voussoirs: int
    cpu_time: float
    response: Response


def cut_inside(voussoirs: int) -> archfrag.Arch:
    """The arch of seven voussoirs with further joints where they stay closed."""
    extra = voussoirs - 7
    length = np.array([end - start for start, end in INSIDE])
    place = (np.arange(extra) + 0.5) / max(extra, 1) * length.sum()
    window = np.searchsorted(np.cumsum(length), place, side="right")
    start = np.array([INSIDE[w][0] - length[:w].sum() for w in window])
    joints = np.sort(np.concatenate([SEVEN, start + place]))
    return archfrag.Arch.circular(10.0, 1.5, EMBRACE, voussoirs, math.inf, joints=joints)


def cut_equally(voussoirs: int) -> archfrag.Arch:
    """The arch of equal voussoirs."""
    return archfrag.Arch.circular(10.0, 1.5, EMBRACE, voussoirs, math.inf)


def load_of(mean: float, ripple: float, step: float, duration: float) -> archfrag.Motion:
    """A load whose slope changes at every sample, as in a record."""
    time = np.arange(round(duration / step) + 1) * step
    load = mean + ripple * np.sin(10.0 * np.pi * time)
    return archfrag.Motion(load * STANDARD_GRAVITY, step)


def start_of(mean: float, ripple: float, step: float, _: float) -> archfrag.Motion:
    """The first two samples of such a load."""
    return load_of(mean, ripple, step, step)


def pulse() -> archfrag.Motion:
    """+a for tp, then -a/2 for twice as long."""
    time = np.arange(round(3.0 * PULSE_LENGTH / PULSE_STEP) + 1) * PULSE_STEP
    load = np.where(time < PULSE_LENGTH, PULSE, -0.5 * PULSE)
    load[-1] = 0.0
    return archfrag.Motion(load * STANDARD_GRAVITY, PULSE_STEP)


def joints_in_motion(response: Response) -> float:
    """Joints that hinge or slide, mean over the moving time."""
    span, total = 0.0, 0.0
    for change in response.mechanism or ():
        if change.model != "rest" and change.until > change.time:
            span += change.until - change.time
            total += (change.until - change.time) * len(change.joints)
    return total / span if span else math.nan


# Arch of a number of voussoirs, motion, time to go on past it [s], and runs for each turn.
SPANS: dict[str, tuple[Callable[[int], archfrag.Arch], archfrag.Motion, float, int]] = {
    "one mechanism, start": (cut_inside, start_of(*NEAR_ONSET), 0.0, 5),
    "one mechanism": (cut_inside, load_of(*NEAR_ONSET), 0.0, 5),
    "equal cuts, start": (cut_equally, start_of(*ABOVE_ONSET), 0.0, 5),
    "equal cuts": (cut_equally, load_of(*ABOVE_ONSET), 0.0, 5),
    "whole scene": (cut_equally, pulse(), 20.0, 1),
}


def check_mechanism(numbers: list[int], **options) -> None:
    """See that "one mechanism" is one: the same hinges at the same angles all along.

    Raises
    ------
    SystemExit
    """
    build, motion, follow, _ = SPANS["one mechanism"]
    seen = set()
    for number in numbers:
        arch = build(number)
        response = archfrag.simulate(arch, motion, follow=follow, history=True, **options)
        angle = arch.parameters["joints"]
        for change in response.mechanism or ():
            if change.joints:
                seen.add(tuple((round(angle[j], 6), how) for j, how in change.joints.items()))
    if len(seen) != 1:
        raise SystemExit(f"the mechanism is not the same for all numbers of voussoirs: {seen}")


def measure(numbers: list[int], runs: int, method: str, **options) -> list[Sample]:
    """Every span and number, `runs` times in turn; kernels and memory warm."""
    run = watched(method)
    samples: list[Sample] = []
    for repeat in range(-1, runs):
        for name, (build, motion, follow, times) in SPANS.items():
            for number in numbers * times:
                response = archfrag.simulate(
                    build(number), motion, follow=follow, method=run.name, **options
                )
                if repeat >= 0:
                    samples.append(Sample(name, number, run.cpu_time, response))
    return samples


def sample_row(sample: Sample) -> list[object]:
    """One timed run as cells."""
    span, number, cpu_time, response = sample
    ends = [response.steps, response.events["events"], response.status.name]
    return [span, number, f"{cpu_time:.7f}", *ends]


def exponent(numbers: list[int], costs: list[float]) -> tuple[float, float]:
    """Exponent of a power law through medians, and half of its 90 % interval (Student's t)."""
    fit = stats.linregress(np.log(numbers), np.log(costs))
    reach = stats.t.ppf(0.95, len(numbers) - 2) if len(numbers) > 2 else math.nan
    return float(fit.slope), float(reach * fit.stderr)


def median_of(samples: list[Sample], span: str, number: int) -> float:
    """Median CPU time of a span [s]."""
    times = [s.cpu_time for s in samples if (s.span, s.voussoirs) == (span, number)]
    return statistics.median(times)


def growth_rows(samples: list[Sample], numbers: list[int], **options) -> list[list[object]]:
    """Costs by number of voussoirs, motion without its start, and exponents."""
    rows: list[list[object]] = []
    costs: dict[str, list[float]] = {}
    for span, (build, motion, follow, _) in SPANS.items():
        costs[span] = [median_of(samples, span, number) for number in numbers]
        last = {s.voussoirs: s.response for s in samples if s.span == span}
        moving = [
            joints_in_motion(
                archfrag.simulate(build(n), motion, follow=follow, history=True, **options)
            )
            for n in numbers
        ]
        for i, number in enumerate(numbers):
            response = last[number]
            steps, changes = response.steps, response.events["events"]
            seconds = response.end_time - response.model_time["rest"]
            cells = [span, number, f"{1e6 * costs[span][i]:.0f}", f"{seconds:.3f}", steps, changes]
            rows.append([*cells, response.events["hand_overs"], f"{moving[i]:.2f}"])
    for span in ("one mechanism", "equal cuts"):
        start = costs[f"{span}, start"]
        costs[f"{span}, motion alone"] = [a - b for a, b in zip(costs[span], start)]
    for span, values in costs.items():
        if min(values) <= 0.0:
            continue
        slope, reach = exponent(numbers, values)
        rows.append([span, "exponent", f"n^{slope:.3f} ± {reach:.3f}"] + [""] * 5)
    return rows


def per_event_row(samples: list[Sample], numbers: list[int]) -> list[object]:
    """Exponent of the whole scene's cost for an event, as cuts change the motion too."""
    costs = []
    for number in numbers:
        one = next(s for s in samples if (s.span, s.voussoirs) == ("whole scene", number))
        events = max(1, one.response.events["events"])
        costs.append(median_of(samples, "whole scene", number) / events)
    slope, reach = exponent(numbers, costs)
    text = f"n^{slope:.3f} ± {reach:.3f}"
    return ["whole scene, for an event", "exponent", text] + [""] * 5


def rest_rows(
    record: archfrag.Motion, numbers: list[int], runs: int, method: str, **options
) -> list[list[object]]:
    """Simulated seconds for a CPU second of an arch that a record leaves at rest."""
    run = watched(method)
    rows: list[list[object]] = []
    for number in numbers:
        arch = cut_equally(number)
        start = archfrag.onset(arch)
        bears = 0.9 * min(start.plus, start.minus) * STANDARD_GRAVITY
        scale = bears / np.abs(record.acceleration).max()
        times = []
        for _ in range(runs + 1):
            response = archfrag.simulate(arch, record, scale=scale, method=run.name, **options)
            times.append(run.cpu_time)
        middle = statistics.median(times[1:])
        rest = response.model_time["rest"]
        cells = [number, f"{rest:.1f}", record.acceleration.size, f"{1e6 * middle:.0f}"]
        rows.append([*cells, f"{rest / middle:,.0f}"])
    return rows


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--voussoirs", type=int, nargs="+", default=list(NUMBERS))
    parser.add_argument("--method", default="auto")
    parser.add_argument("--rtol", type=float, help="the method's own if not given")
    parser.add_argument("--runs", type=int, default=9, help="of each, interleaved")
    parser.add_argument("--record", type=Path, default=RECORD, help="for the arch at rest")
    parser.add_argument("--out", type=Path, help="file for every timed run as CSV")
    given = parser.parse_args()
    if min(given.voussoirs) < 7:
        parser.error("the arch is cut into 7 voussoirs or more")
    warmup(given.method)
    options = {"method": given.method} | ({"rtol": given.rtol} if given.rtol else {})
    check_mechanism(given.voussoirs, **options)
    samples = measure(given.voussoirs, given.runs, **options)
    head = ["span", "voussoirs", "CPU (us), median", "moving (s)", "steps", "events"]
    head += ["hand-overs", "joints in motion"]
    rows = growth_rows(samples, given.voussoirs, **options)
    rows.append(per_event_row(samples, given.voussoirs))
    print(f"{machine()}, one thread, {given.method}, rtol {given.rtol or 'its own'}\n")
    print(markdown(f"Growth, medians of {given.runs}, 90 % intervals", head, rows))
    record = archfrag.read_motion(given.record)
    head = ["voussoirs", "at rest (s)", "samples", "CPU (us)", "simulated s per CPU s"]
    table = rest_rows(record, given.voussoirs, given.runs, **options)
    print(markdown(f"At rest in {given.record.name}, at nine tenths of onset", head, table))
    if given.out:
        head = ["span", "voussoirs", "cpu_time", "steps", "events", "status"]
        write_csv(given.out, head, [sample_row(sample) for sample in samples])


if __name__ == "__main__":
    main()
