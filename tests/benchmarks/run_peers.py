"""Same scenes in our solver and in others': tables of what each gives.

Sections as in the README beside this file: A arch pulses, B semicircle, C block, cost.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tables import machine, markdown, write_csv

from archfrag.evidence.peers.client import NAMES, VARIANTS, Peer, PeerFailed, open_peers
from archfrag.evidence.peers.drive import Outcome
from archfrag.evidence.scene import Scene, load_scene

# Steps [s]: those at which people use each peer, the finest first worth its cost.
STEPS = {
    "archfrag": (0.002, 0.001, 0.0005),
    "mujoco": (0.002, 0.0005),
    "pymunk": (0.002, 0.0005),
    "lmgc90": (0.005, 0.002, 0.001),
    "siconos": (0.001,),
}
# The same for 27 voussoirs, where Gauss-Seidel sweeps cost seconds for a simulated second.
STEPS_LONG = {
    **STEPS,
    "archfrag": (0.002, 0.0005),
    "lmgc90": (0.005,),
    "siconos": (0.005,),
}
# Amplitudes [g]: swept whole, because verdicts are not monotone.
SWEEPS = {
    "arch7_pulse": np.arange(0.65, 0.8126, 0.0125),
    "arch7_long_pulse": np.arange(0.4, 0.53126, 0.00625),
    "block_sine": np.arange(0.288, 0.3001, 0.001),
}
PROBES = (0.2, 0.4)
Table = tuple[str, list[str], list[list[object]]]


def sweep(peer: Peer, scene: Scene, dt: float, amplitudes: np.ndarray) -> list[bool | None]:
    """Verdict at each amplitude; None where the run failed."""
    verdicts: list[bool | None] = []
    for amplitude in amplitudes:
        try:
            verdicts.append(peer.run(scene.at(float(amplitude)), dt).collapsed)
        except PeerFailed as failure:
            print(failure, file=sys.stderr)
            verdicts.append(None)
    return verdicts


def threshold(amplitudes: np.ndarray, verdicts: list[bool | None]) -> tuple[str, str]:
    """Last standing / first collapsing amplitude, and the amplitudes above that stand again."""
    falls = [i for i, verdict in enumerate(verdicts) if verdict]
    failed = [f"{a:.4g}" for a, verdict in zip(amplitudes, verdicts) if verdict is None]
    note = f"failed at {', '.join(failed)}" if failed else ""
    if not falls:
        return f"stands to {amplitudes[-1]:.4g}", note
    first = falls[0]
    below = f"{amplitudes[first - 1]:.4f}" if first else f"below {amplitudes[0]:.4f}"
    again = [
        f"{a:.4g}" for a, verdict in zip(amplitudes[first:], verdicts[first:]) if verdict is False
    ]
    note = "; ".join(filter(None, [f"stands again at {', '.join(again)}" if again else "", note]))
    return f"{below} / {amplitudes[first]:.4f}", note


def section_a(peers: dict[str, Peer]) -> list[Table]:
    """Arch of 7 under pulses: amplitudes, and the motion before and after the first impact."""
    names = ("arch7_pulse", "arch7_long_pulse")
    rows: list[list[object]] = []
    motion: list[list[object]] = []
    for name, peer in peers.items():
        for dt in STEPS[name]:
            cells: list[object] = [name, f"{dt * 1e3:g}"]
            for scene in names:
                verdicts = sweep(peer, load_scene(scene), dt, SWEEPS[scene])
                cells += threshold(SWEEPS[scene], verdicts)
            rows.append(cells)
        for dt in sorted({*STEPS[name], 0.001, 0.0005}, reverse=True):
            outcome = attempt(peer, load_scene("arch7_pulse"), dt, history=True)
            if outcome is not None:
                probes = [f"{value:.5f}" for value in keystone(outcome)]
                motion.append([name, f"{dt * 1e3:g}", *probes, f"{outcome.peak_displacement:.4f}"])
    head = ["solver", "step (ms)", "tp 0.3 s (g)", "", "tp 0.5 s (g)", ""]
    head_motion = ["solver", "step (ms)", *(f"at {t} s (m)" for t in PROBES), "largest (m)"]
    return [
        ("A. Last standing / first collapsing amplitude", head, rows),
        ("A. Keystone's horizontal displacement at 0.5 g, tp 0.3 s", head_motion, motion),
    ]


def section_b(peers: dict[str, Peer]) -> list[Table]:
    """Semicircle of 27: self-weight and five cycles at 1 Hz."""
    rows: list[list[object]] = []
    for name, peer in peers.items():
        for dt in STEPS_LONG[name]:
            cells: list[object] = [name, f"{dt * 1e3:g}"]
            for scene in ("semicircle27_stands", "semicircle27_falls", "semicircle27_harmonic"):
                outcome = attempt(peer, load_scene(scene), dt)
                if outcome is None:
                    cells += ["failed"] * (1 if scene.endswith("falls") else 2)
                    continue
                verdict = f"falls at {outcome.collapse_time:.2f} s"
                cells.append(verdict if outcome.collapsed else "stands")
                if not scene.endswith("falls"):
                    cells.append(f"{outcome.peak_displacement:.3g}")
            rows.append(cells)
            print(cells, file=sys.stderr)
    head = [
        "solver",
        "step (ms)",
        "t/R 0.12",
        "moved (m)",
        "t/R 0.095",
        "harmonic 0.3 g, t/R 0.15",
        "largest (m)",
    ]
    return [("B. Semicircle of 27 voussoirs", head, rows)]


def section_c(peers: dict[str, Peer]) -> list[Table]:
    """Block under one sine."""
    rows: list[list[object]] = []
    for name, peer in peers.items():
        for dt in (0.002, 0.0005):
            verdicts = sweep(peer, load_scene("block_sine"), dt, SWEEPS["block_sine"])
            rows.append([name, f"{dt * 1e3:g}", *threshold(SWEEPS["block_sine"], verdicts)])
    return [("C. Block: overturning amplitude (g)", ["solver", "step (ms)", "0.5 s", ""], rows)]


def section_cost(peers: dict[str, Peer]) -> list[Table]:
    """Wall seconds of stepping for a simulated second of the moving arch, at 2 ms."""
    rows: list[list[object]] = []
    for name, peer in peers.items():
        cells: list[object] = [name]
        for voussoirs, span in ((7, 2.0), (27, 1.0), (81, 0.3)):
            if peer.adapter == "siconos" and voussoirs == 81:
                cells.append("-")
                continue
            scene = replace(load_scene(f"arch{voussoirs}_pulse"), duration=span)
            runs = [
                attempt(peer, scene, 0.002) for _ in range(1 if peer.adapter == "lmgc90" else 3)
            ]
            costs = [run.wall_seconds / run.simulated_seconds for run in runs if run is not None]
            cells.append(f"{np.median(costs):.4f}" if costs else "failed")
        rows.append(cells)
        print(cells, file=sys.stderr)
    head = ["solver", "7 voussoirs", "27", "81"]
    return [("Cost: wall seconds per simulated second at 2 ms", head, rows)]


def attempt(peer: Peer, scene: Scene, dt: float, **options: Any) -> Outcome | None:
    """Outcome of a run, or None and a line on stderr."""
    try:
        return peer.run(scene, dt, **options)
    except PeerFailed as failure:
        print(failure, file=sys.stderr)
        return None


def keystone(outcome: Outcome) -> list[float]:
    """Horizontal displacement of the middle voussoir at the probes [m]."""
    history = outcome.history
    assert history is not None
    place = np.array(history["centroids"])
    middle = place[:, place.shape[1] // 2, 0]
    return [float(np.interp(t, history["time"], middle - middle[0])) for t in PROBES]


SECTIONS: dict[str, Callable[[dict[str, Peer]], list[Table]]] = {
    "A": section_a,
    "B": section_b,
    "C": section_c,
    "cost": section_cost,
}


def main() -> None:
    """Run the sections asked for and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="A|B|C|cost", help="all if none is given")
    parser.add_argument("--peers", nargs="+", default=list(NAMES), choices=[*NAMES, *VARIANTS])
    parser.add_argument("--step", type=float, nargs="+", help="steps [s] instead of the usual")
    parser.add_argument("--limit", type=float, default=600.0, help="longest run [s]")
    parser.add_argument("--csv", type=Path, help="folder for the tables as CSV")
    arguments = parser.parse_args()
    unknown = set(arguments.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"unknown section {', '.join(sorted(unknown))}; allowed: A B C cost")
    for name, (adapter, _) in VARIANTS.items():
        STEPS[name], STEPS_LONG[name] = STEPS[adapter], STEPS_LONG[adapter]
    if arguments.step:
        for name in arguments.peers:
            STEPS[name] = STEPS_LONG[name] = tuple(arguments.step)
    peers = open_peers(arguments.peers, arguments.limit)
    print(f"{machine()}\n")
    for section in arguments.sections or SECTIONS:
        for index, (title, head, rows) in enumerate(SECTIONS[section](peers)):
            print(markdown(title, head, rows), flush=True)
            if arguments.csv:
                write_csv(arguments.csv / f"{section.lower()}_{index}.csv", head, rows)
    for peer in peers.values():
        peer.close()


if __name__ == "__main__":
    main()
