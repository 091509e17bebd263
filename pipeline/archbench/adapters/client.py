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

NAMES = ("archfrag", "mujoco", "pymunk", "lmgc90", "siconos", "pinocchio", "kamino")
# The same solvers with other settings that are worth a line of their own.
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "mujoco_corners": ("mujoco", {"contacts": "corners"}),
    "lmgc90_unlocked": ("lmgc90", {"locked": []}),
}
_WORKER = Path(__file__).parent / "worker.py"
# Some compile when they start [s].
_START_LIMIT = 900.0


class SolverMissing(Exception):
    """The solver cannot be used here; the message states why."""


class SolverFailed(Exception):
    """A run ended without an outcome; the message states how."""


class OtherSolver:
    """A solver, ready for requests; started again after a run that ended its process.

    Parameters
    ----------
    name : str
        One of `NAMES` or `VARIANTS`. It is looked for in this interpreter, or in that of the
        environment variable ``ARCHFRAG_<NAME>_PYTHON``.
    limit : float
        Longest that a run may take [s].

    Attributes
    ----------
    version : str
        As the solver reports it.

    Raises
    ------
    ValueError
        If there is no solver of this name.
    SolverMissing
        If it is not installed.
    """

    def __init__(self, name: str, limit: float = 600.0) -> None:
        if name not in NAMES and name not in VARIANTS:
            known = ", ".join((*NAMES, *VARIANTS))
            raise ValueError(f"there is no solver {name!r}; there are {known}")
        self.name, self.limit, self.version = name, limit, ""
        self.adapter, self.settings = VARIANTS.get(name, (name, {}))
        self.process: subprocess.Popen | None = None
        self._start()

    def _start(self) -> None:
        reasons = []
        for python in _interpreters(self.adapter):
            threads = dict.fromkeys(
                ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
            )
            self.process = subprocess.Popen(
                [python, str(_WORKER), self.adapter],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **threads},
                text=True,
            )
            reply = self._read(_START_LIMIT)
            if "ready" in reply:
                self.version = reply["version"]
                return
            self.close()
            reasons.append(str(reply.get("missing") or reply.get("error")))
        raise SolverMissing("; ".join(reasons))

    def _read(self, limit: float) -> dict[str, Any]:
        process = self.process
        assert process is not None
        assert process.stdout is not None
        ready, _, _ = select.select([process.stdout], [], [], limit)
        if not ready:
            return {"error": f"no answer in {limit:g} s"}
        line = process.stdout.readline()
        return json.loads(line) if line else {"error": f"process ended ({process.wait()})"}

    def run(
        self, scene: Scene, dt: float, settings: dict[str, Any] | None = None, **options: Any
    ) -> Outcome:
        """Run a scene with step `dt` [s]; `options` as `drive.drive` takes them.

        Raises
        ------
        SolverFailed
        """
        if self.process is None:
            self._start()
        assert self.process is not None
        assert self.process.stdin is not None
        request = {
            "scene": scene.to_dict(),
            "dt": dt,
            "settings": {**self.settings, **(settings or {})},
            "options": options,
        }
        try:
            self.process.stdin.write(json.dumps(request) + "\n")
            self.process.stdin.flush()
            reply = self._read(self.limit)
        except BrokenPipeError:
            reply = {"error": f"process ended ({self.process.wait()})"}
        if "error" in reply:
            self.close()
            raise SolverFailed(f"{self.name}, {scene.name}, dt {dt:g} s: {reply['error']}")
        return Outcome(**reply)

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            for stream in (self.process.stdin, self.process.stdout):
                if stream is not None:
                    stream.close()
            self.process = None


def solver_versions(names: Sequence[str]) -> dict[str, str]:
    """Version of each solver, or why it cannot be used here.

    Parameters
    ----------
    names : sequence of str
        Of `NAMES` or `VARIANTS`.
    """
    found = {}
    for name in names:
        try:
            solver = OtherSolver(name)
        except SolverMissing as reason:
            found[name] = f"not installed: {reason}"
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
