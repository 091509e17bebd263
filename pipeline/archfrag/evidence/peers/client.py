"""The caller's side of a peer's process."""

import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from archfrag.evidence.peers.drive import Outcome
from archfrag.evidence.scene import Scene

NAMES = ("archfrag", "mujoco", "pymunk", "lmgc90", "siconos")
# The same peers set up in another way that is worth a line of its own.
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "steps_3ms": ("archfrag", {"method": "time_stepping"}),
    # With events located, though above its limit auto would only step.
    "ladder_1e-1": ("archfrag", {"method": "auto", "rtol": 1e-1, "settings": {"coarse": 1.0}}),
    "ladder_3e-2": ("archfrag", {"method": "auto", "rtol": 3e-2, "settings": {"coarse": 1.0}}),
    "ladder_1e-2": ("archfrag", {"method": "auto", "rtol": 1e-2}),
    "ladder_1e-3": ("archfrag", {"method": "auto", "rtol": 1e-3}),
    "events_1e-7": ("archfrag", {"method": "event_driven", "rtol": 1e-7}),
    "mujoco_corners": ("mujoco", {"contacts": "corners"}),
    "lmgc90_unlocked": ("lmgc90", {"locked": []}),
}
_WORKER = Path(__file__).parent / "worker.py"


class PeerMissing(Exception):
    """The peer cannot be used here; the message says why."""


class PeerFailed(Exception):
    """A run ended without an outcome; the message says how."""


class Peer:
    """A peer, ready for requests; started again after a run that took its process down.

    Parameters
    ----------
    name : str
        One of `NAMES` or `VARIANTS`.
    limit : float
        Longest that a run may take [s].

    Attributes
    ----------
    version : str
        As the peer says it.

    Raises
    ------
    PeerMissing
        If it is not installed.
    """

    def __init__(self, name: str, limit: float = 600.0) -> None:
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
            reply = self._read()
            if "ready" in reply:
                self.version = reply["version"]
                return
            self.close()
            reasons.append(str(reply.get("missing") or reply.get("error")))
        raise PeerMissing("; ".join(reasons))

    def _read(self) -> dict[str, Any]:
        process = self.process
        assert process is not None
        assert process.stdout is not None
        ready, _, _ = select.select([process.stdout], [], [], self.limit)
        if not ready:
            return {"error": f"no answer in {self.limit:g} s"}
        line = process.stdout.readline()
        return json.loads(line) if line else {"error": f"process ended ({process.wait()})"}

    def run(
        self, scene: Scene, dt: float, settings: dict[str, Any] | None = None, **options: Any
    ) -> Outcome:
        """Run a scene with step `dt` [s]; `options` as `drive.drive` takes them.

        Raises
        ------
        PeerFailed
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
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        reply = self._read()
        if "error" in reply:
            self.close()
            raise PeerFailed(f"{self.name}, {scene.name}, dt {dt:g} s: {reply['error']}")
        return Outcome(**{**reply, "peer": self.name})

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            for stream in (self.process.stdin, self.process.stdout):
                if stream is not None:
                    stream.close()
            self.process = None


def peer_versions(names: Sequence[str]) -> dict[str, str]:
    """Version of each peer, or why it cannot be used here.

    Parameters
    ----------
    names : sequence of str
        Of `NAMES` or `VARIANTS`.
    """
    found = {}
    for name in names:
        try:
            peer = Peer(name)
        except PeerMissing as reason:
            found[name] = f"not installed: {reason}"
        else:
            found[name] = peer.version
            peer.close()
    return found


def open_peers(names: list[str], limit: float = 600.0) -> dict[str, Peer]:
    """Those of the named peers that are installed; says why of the others."""
    found = {}
    for name in names:
        began = time.perf_counter()
        try:
            found[name] = Peer(name, limit)
        except PeerMissing as reason:
            print(f"skipped {name}: {reason}", file=sys.stderr)
        else:
            print(f"started {name} in {time.perf_counter() - began:.1f} s", file=sys.stderr)
    return found


def _interpreters(name: str) -> list[str]:
    """This one, then for Siconos the system's own: Debian packages it for no other."""
    own = os.environ.get(f"ARCHFRAG_{name.upper()}_PYTHON")
    if own:
        return [own]
    system = shutil.which("python3", path="/usr/bin")
    return [sys.executable, *([system] if name == "siconos" and system else [])]
