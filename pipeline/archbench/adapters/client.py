"""The caller's side of a solver's process."""

import json
import os
import select
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from archbench.adapters.drive import Outcome
from archbench.scene import Scene

# MuJoCo with contact points at corners, which is more accurate than its own between hulls.
NAMES = ("mujoco_corners", "mujoco_warp", "pymunk", "lmgc90", "siconos", "pinocchio")
MISSING = "not installed"
MODULE = "archbench.adapters.{}_adapter"
_START_LIMIT = 900.0  # some compile when they start [s]
_THREADS = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)


class SolverMissing(Exception):
    """The solver cannot be used here; the message states why."""


class SolverFailed(Exception):
    """A run ended without an outcome; the message states how."""


class OtherSolver:
    """One of `NAMES`, ready for requests; started again after a run that ended its process.

    It is looked for in this interpreter, or in that of ``ARCHFRAG_<NAME>_PYTHON``; `SolverMissing`
    if it is not installed. `limit` is the longest that a run may take [s].
    """

    def __init__(self, name: str, limit: float = 600.0) -> None:
        self.name = name
        self.limit = limit
        self.version = ""
        self.process: subprocess.Popen | None = None
        self._start()

    def _start(self) -> subprocess.Popen:
        reasons = []
        for python in _interpreters(self.name):
            worker = [python, str(Path(__file__).with_name("drive.py"))]
            self.process = subprocess.Popen(
                [*worker, MODULE.format(self.name)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **_THREADS},
                text=True,
            )
            reply = _read(self.process, _START_LIMIT)
            if "version" in reply:
                self.version = reply["version"]
                return self.process
            self.close()
            reasons.append(str(reply["error"]))
        raise SolverMissing("; ".join(reasons))

    def run(self, scene: Scene, dt: float, history: bool = False) -> Outcome:
        """Run a scene with step `dt` [s]; `SolverFailed` if there is no outcome."""
        process = self.process or self._start()
        assert process.stdin is not None
        request = {"scene": vars(scene), "dt": dt, "history": history}
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            reply = _read(process, self.limit)
        except BrokenPipeError:
            reply = {"error": f"process ended ({process.wait()})"}
        if "error" in reply:
            self.close()
            raise SolverFailed(
                f"{self.name}, {scene.name}, dt {dt:g} s: {reply['error']}"
            )
        return Outcome(**reply)

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


def _read(process: subprocess.Popen, limit: float) -> dict[str, Any]:
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], limit)
    if not ready:
        return {"error": f"no answer in {limit:g} s"}
    line = process.stdout.readline()
    return json.loads(line) if line else {"error": f"process ended ({process.wait()})"}


def solver_versions(names: Sequence[str]) -> dict[str, str]:
    """Version of each solver, or `MISSING` and why it cannot be used here."""
    found = {}
    for name in names:
        try:
            solver = OtherSolver(name)
        except SolverMissing as reason:
            found[name] = f"{MISSING}: {reason}"
        else:
            found[name] = solver.version
            solver.close()
    return found


def _interpreters(name: str) -> list[str]:
    """This one, then for Siconos the system's own: Debian packages it for no other."""
    own = os.environ.get(f"ARCHFRAG_{name.upper()}_PYTHON")
    if own:
        return [own]
    system = shutil.which("python3", path="/usr/bin")
    return [sys.executable, *([system] if name == "siconos" and system else [])]
