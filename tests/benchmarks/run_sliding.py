"""Arches with little friction: when joints start to slide and stick, and what collapses them.

Event-driven integration beside time stepping at fine steps, for arches whose onset of motion is
itself a sliding mechanism.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from amplitudes import (
    Sweep,
    around,
    first_collapse,
    ranges,
    sampled,
    sweep,
    two_part_pulse,
)
from tables import machine, markdown, write_csv

import archfrag as af
from archfrag.evidence.part import in_processes
from archfrag.evidence.run import Way
from archfrag.simulate import warmup

FRICTIONS = (0.33, 0.36, 0.45)
# Thickness [m], embrace [degrees], voussoirs; radius 10 m.
SHAPES = ((1.5, 157.5, 7), (2.0, 157.5, 7), (2.0, 180.0, 15))
PERIOD = 0.8  # [s]
LEVELS = 2.2  # amplitude of the histories, in onsets
SHORTEST = 5e-3  # slides compared; interruptions below it are left out [s]
WAYS = (
    Way("time_stepping", "dt", 2.5e-4),
    Way("time_stepping", "dt", 1.25e-4),
    Way("event_driven", "rtol", 1e-4),
)
SCOUT = Way("event_driven", "rtol", 1e-3)
PART, SPACING, WIDTH = 0.08, 0.01, 5e-4


class Slide(NamedTuple):
    """One joint sliding one way."""

    start: float  # [s]
    end: float
    joint: int
    side: str


def arch_of(friction: float, shape: tuple[float, float, int]) -> af.Arch:
    """Circular arch of sectors."""
    thickness, embrace, voussoirs = shape
    return af.Arch.circular(10.0, thickness, embrace, voussoirs, friction)


def one_sine(dt: float = 1e-4) -> af.Motion:
    """One sine of 1 g."""
    return sampled(lambda t: np.sin(2.0 * np.pi * t / PERIOD), PERIOD, dt)


MOTIONS = {"one sine 0.8 s": one_sine, "+a 0.3 s, -a/2 0.6 s": lambda: two_part_pulse(0.3)}


def slides_of(response: af.Response) -> list[Slide]:
    """From when to when joints slide, in order of their start; short interruptions left out."""
    found: list[Slide] = []
    active: dict[int, tuple[float, str]] = {}
    for change in response.mechanism or ():
        now = {
            joint: text.split("towards ")[1]
            for joint, text in change.joints.items()
            if "towards" in text
        }
        for joint in [j for j, (_, side) in active.items() if now.get(j) != side]:
            start, side = active.pop(joint)
            found.append(Slide(start, change.time, joint, side))
        for joint, side in now.items():
            active.setdefault(joint, (change.time, side))
    found += [Slide(start, response.end_time, j, side) for j, (start, side) in active.items()]
    joined: list[Slide] = []
    for slide in sorted(found, key=lambda s: (s.joint, s.start)):
        last = joined[-1] if joined else None
        if (
            last is not None
            and (last.joint, last.side) == (slide.joint, slide.side)
            and slide.start - last.end < SHORTEST
        ):
            joined[-1] = last._replace(end=slide.end)
        else:
            joined.append(slide)
    return sorted(joined)


def matched(ours: list[Slide], others: list[Slide]) -> list[tuple[Slide, Slide]]:
    """Slides longer than `SHORTEST` in both, in order, up to the first without its like."""
    pairs = []
    for slide in (s for s in ours if s.end - s.start > SHORTEST):
        like = [
            other
            for other in others
            if (other.joint, other.side) == (slide.joint, slide.side)
            and other.end - other.start > 0.5 * SHORTEST
            and abs(other.start - slide.start) < 0.5 * (slide.end - slide.start)
        ]
        if not like:
            break
        pairs.append((slide, min(like, key=lambda other: abs(other.start - slide.start))))
    return pairs


def history_row(friction: float, shape: tuple[float, float, int]) -> list[object]:
    """Instants and amplitudes of sliding under one sine, well below collapse."""
    arch = arch_of(friction, shape)
    onset = af.onset(arch)
    amplitude = LEVELS * onset.plus
    runs = []
    for way in (Way("event_driven", "rtol", 1e-6), WAYS[0], WAYS[1]):
        warmup(way.method)
        runs.append(
            af.simulate(arch, one_sine(), scale=amplitude, history=True, **way.options)
        )  # fmt: skip
    ours, fine = runs[0], runs[2]
    pairs = matched(slides_of(ours), slides_of(fine))
    first = pairs[0] if pairs else None
    starts = [abs(one.start - other.start) for one, other in pairs]
    ends = [abs(one.end - other.end) for one, other in pairs]
    left = [np.abs(run.history.displacement.values[-1]).max() for run in runs]  # type: ignore[union-attr]
    lost = [run.energy["friction"] + run.energy["impacts"] for run in runs]
    return [
        f"{friction:g}",
        "{} m, {}°, {}".format(*shape),
        f"{onset.plus:.4f}",
        f"{', '.join(map(str, onset.sliding))}",
        f"{amplitude:.4f}",
        f"{np.arcsin(1.0 / LEVELS) * PERIOD / (2.0 * np.pi):.5f}",
        f"{first[0].start:.5f} / {first[1].start:.5f}" if first else "-",
        f"{first[0].end:.5f} / {first[1].end:.5f}" if first else "-",
        f"{len(pairs)}",
        f"{1e3 * np.median(starts):.2f}, {1e3 * max(starts):.2f}",
        f"{1e3 * np.median(ends):.2f}, {1e3 * max(ends):.2f}",
        " / ".join(f"{run.peak_displacement:.4f}" for run in runs),
        " / ".join(f"{value:.4f}" for value in left),
        " / ".join(f"{1e-3 * value:.2f}" for value in lost),
        " / ".join(run.status.name.lower() for run in (ours, fine)),
    ]


def amplitude_results(
    friction: float, shape: tuple[float, float, int], name: str
) -> tuple[float, list[Sweep]]:
    """First collapse of the scout's coarse grid, and all ways on the grid around it."""
    arch, motion = arch_of(friction, shape), MOTIONS[name]()
    first = first_collapse(arch, motion, af.onset(arch).plus, 3.0, SCOUT, 1.03)
    grid = around(first, PART, SPACING)
    return first, [sweep(arch, motion, grid, way, WIDTH) for way in WAYS]


def amplitude_row(
    friction: float, shape: tuple[float, float, int], name: str, first: float, results: list[Sweep]
) -> list[object]:
    """Line of the second table."""
    coarse, fine, ours = (result.least for result in results)
    limit = 2.0 * fine - coarse
    above = [
        f"{way}: {ranges(result.standing_above, SPACING * first)}"
        for way, result in zip(WAYS, results)
        if result.standing_above
    ]
    failed = [f"{way}: {', '.join(r.failures)}" for way, r in zip(WAYS, results) if r.failures]
    return [
        f"{friction:g}",
        "{} m, {}°, {}".format(*shape),
        name,
        *(f"{result.least:.4f} ({result.mode})" for result in results),
        f"{100.0 * (ours / fine - 1.0):+.2f} %",
        f"{100.0 * (ours / limit - 1.0):+.2f} %",
        "; ".join(above),
        "; ".join(failed),
        " / ".join(f"{result.seconds:.1f}" for result in results),
    ]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--csv", type=Path, help="folder for the tables as CSV")
    arguments = parser.parse_args()
    cases = [(friction, shape) for friction in FRICTIONS for shape in SHAPES]
    print(f"{machine()}\n")
    head = [
        "friction",
        "thickness, embrace, voussoirs",
        "onset (g)",
        "slides at onset",
        "amplitude (g)",
        "sine passes the onset (s)",
        "first slide (s)",
        "its end (s)",
        "slides compared",
        "starts differ: median, most (ms)",
        "ends differ: median, most (ms)",
        "largest displacement (m): ours / 0.25 / 0.125 ms",
        "left at the end (m)",
        "friction and impacts (kJ)",
        "ended",
    ]
    rows = in_processes(history_row, cases, arguments.workers)
    title = "Sliding arches under one sine: event_driven 1e-6 beside time stepping at 0.125 ms"
    print(markdown(title, head, rows), flush=True)
    if arguments.csv:
        write_csv(arguments.csv / "sliding_history.csv", head, rows)
    tasks = [(friction, shape, name) for friction, shape in cases for name in MOTIONS]
    results = in_processes(amplitude_results, tasks, arguments.workers)
    rows = [amplitude_row(*task, *result) for task, result in zip(tasks, results)]
    head = [
        "friction",
        "thickness, embrace, voussoirs",
        "motion",
        *map(str, WAYS),
        "ours to 0.125 ms",
        "ours to zero step",
        "stands again (g)",
        "failed",
        "wall (s)",
    ]
    print(markdown("Sliding arches: least collapsing amplitude (g), to 0.05 %", head, rows))
    if arguments.csv:
        write_csv(arguments.csv / "sliding_amplitude.csv", head, rows)


if __name__ == "__main__":
    main()
