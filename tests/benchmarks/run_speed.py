"""Speed of time stepping and of the ladder beside MuJoCo and LMGC90: the pulse scene, one thread.

The simulated span is the moving part: from the pulse's start, which moves the arch at once, to
where our solver finds it at rest; the others run the same span. Runs are interleaved, so that
what else the machine does meets all alike; the figure is the median. Building and compiling are
apart. The
error is that of the largest displacement, by event-driven integration at a tolerance of 1e-7; with
27 voussoirs the motion after the first impacts is chaotic and so is this error.
"""

import argparse
import statistics
from dataclasses import replace
from pathlib import Path

from tables import machine, markdown, write_csv

from archfrag.evidence.peers.client import NAMES, VARIANTS, open_peers
from archfrag.evidence.peers.drive import Outcome
from archfrag.evidence.scene import load_scene

HEAD = [
    "voussoirs",
    "solver",
    "wall s per simulated s",
    "least",
    "most",
    "times ours",
    "times ours (CPU)",
    "us per step",
    "steps",
    "span (s)",
    "set-up (s)",
    "largest (m)",
    "its error (%)",
]
SLOW = {"lmgc90", "siconos"}
LADDER = ("ladder_1e-1", "ladder_3e-2", "ladder_1e-2", "ladder_1e-3")
REFERENCE = "events_1e-7"
STEP_OF_LADDER = 5e-4
STEPS = {**dict.fromkeys(LADDER, STEP_OF_LADDER), "steps_3ms": 3e-3}


def main() -> None:
    """Time every solver on every size and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--peers",
        nargs="+",
        default=["steps_3ms", *LADDER, "mujoco", "mujoco_corners", "lmgc90", "lmgc90_unlocked"],
        choices=[*NAMES[1:], *VARIANTS],
    )
    parser.add_argument("--voussoirs", type=int, nargs="+", default=[7, 27], choices=[7, 27, 81])
    parser.add_argument("--step", type=float, default=0.001, help="time step [s]")
    parser.add_argument("--runs", type=int, default=5, help="runs of each, interleaved")
    parser.add_argument(
        "--slow-at-most",
        type=int,
        default=7,
        help="largest number of voussoirs that LMGC90 and Siconos are timed at",
    )
    parser.add_argument("--csv", type=Path, help="file for the table as CSV")
    arguments = parser.parse_args()
    peers = open_peers(["archfrag", REFERENCE, *arguments.peers])
    if "archfrag" not in peers:
        raise SystemExit("archfrag itself cannot be imported; nothing to compare")
    rows: list[list[object]] = []
    for voussoirs in arguments.voussoirs:
        scene = load_scene(f"arch{voussoirs}_pulse")
        names = [
            n for n in peers if peers[n].adapter not in SLOW or voussoirs <= arguments.slow_at_most
        ]
        # Once unmeasured: kernels compile, and our run tells the span.
        span = peers["archfrag"].run(scene, arguments.step).simulated_seconds
        span = arguments.step * round(span / arguments.step)
        exact = peers[REFERENCE].run(scene, STEP_OF_LADDER).peak_displacement
        names.remove(REFERENCE)
        outcomes: dict[str, list[Outcome]] = {name: [] for name in names}
        set_up = {name: peers[name].run(replace(scene, duration=0.01), 0.001) for name in names}
        for _ in range(arguments.runs):
            for name in names:
                own = peers[name].adapter == "archfrag"
                part = scene if own else replace(scene, duration=span)
                outcome = peers[name].run(part, STEPS.get(name, arguments.step))
                # Rest found early is part of the same span.
                outcomes[name].append(replace(outcome, simulated_seconds=span))
        ours = statistics.median(map(_cost, outcomes["archfrag"]))
        ours_cpu = statistics.median(map(_cpu, outcomes["archfrag"]))
        for name, runs in outcomes.items():
            costs = sorted(map(_cost, runs))
            middle = statistics.median(costs)
            last = runs[-1]
            rows.append(
                [
                    voussoirs,
                    f"{name} ({last.version})" if name in VARIANTS else last.version,
                    f"{middle:.5f}",
                    f"{costs[0]:.5f}",
                    f"{costs[-1]:.5f}",
                    f"{middle / ours:.2f}",
                    f"{statistics.median(map(_cpu, runs)) / ours_cpu:.2f}",
                    f"{1e6 * last.wall_seconds / last.steps:.1f}",
                    last.steps,
                    f"{last.simulated_seconds:.3f}",
                    f"{set_up[name].setup_seconds:.4f}",
                    f"{last.peak_displacement:.4f}",
                    f"{100 * (last.peak_displacement / exact - 1):+.1f}",
                ]
            )
    title = f"Speed at {arguments.step * 1e3:g} ms, median of {arguments.runs}"
    print(f"{machine()}, one thread\n\n{markdown(title, HEAD, rows)}")
    if arguments.csv:
        write_csv(arguments.csv, HEAD, rows)
    for peer in peers.values():
        peer.close()


def _cost(outcome: Outcome) -> float:
    """Wall seconds for a simulated second."""
    return outcome.wall_seconds / outcome.simulated_seconds


def _cpu(outcome: Outcome) -> float:
    """CPU seconds for a simulated second: what a busy machine disturbs less."""
    return outcome.cpu_seconds / outcome.simulated_seconds


if __name__ == "__main__":
    main()
