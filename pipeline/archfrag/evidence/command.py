"""`archfrag evidence`: measure the parts asked for, keep their tables, write the guide."""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pandas as pd

from archfrag.errors import InputError
from archfrag.evidence.part import Setup, in_processes
from archfrag.evidence.peers.client import NAMES, VARIANTS, peer_versions
from archfrag.evidence.store import load, save
from archfrag.methods.registry import AUTO
from archfrag.simulate import warmup
from archfrag.simulation.checks import available_methods

# In the order in which they are measured and shown.
PARTS: dict[str, str] = {
    "speed": "archfrag.evidence.speed.accuracy",
    "growth": "archfrag.evidence.growth",
    "stability": "archfrag.evidence.stability.planes",
    "corner_cases": "archfrag.evidence.cases.corner_cases",
    "fragility": "archfrag.evidence.fragility.error",
}
# Folder of the table of the peers that were run last.
PEERS = "peers"


def part(name: str) -> ModuleType:
    """Module of a part: it has `measure(setup)` and `show(frames)`."""
    return import_module(PARTS[name])


def _compile(setup: Setup) -> None:
    """Have all kernels in the cache; the longest to compile first, others beside it."""
    began = time.perf_counter()
    installed = [name for name in available_methods() if name != AUTO]
    longest_first = sorted(installed, key=lambda name: name != "event_driven")
    in_processes(warmup, [(name,) for name in longest_first], setup.workers)
    setup.say(f"evidence: kernels ready in {time.perf_counter() - began:.0f} s")


def gather_evidence(names: Sequence[str], setup: Setup, folder: Path) -> Path:
    """Measure parts one after the other, save each as soon as it is there, write the guide.

    Parameters
    ----------
    names : sequence of str
        Keys of `PARTS`; all if empty.
    setup : Setup
    folder : Path
        Tables of parts not asked for are left as they are, and shown.

    Returns
    -------
    Path
        The guide's page.

    Raises
    ------
    InputError
        If there is no part, or no peer, of a name.
    """
    from archfrag.evidence.guide import write_guide

    for name in names:
        if name not in PARTS:
            raise InputError(f"evidence has no part {name!r}; allowed are {', '.join(PARTS)}")
    known = (*NAMES, *VARIANTS)
    for name in setup.peers:
        if name not in known:
            raise InputError(f"evidence knows no peer {name!r}; allowed are {', '.join(known)}")
    peers = peer_versions(setup.peers)
    facts = {"quick": setup.quick, "peers": peers, "workers": setup.workers}
    if peers:
        table = pd.DataFrame(peers.items(), columns=["peer", "version"])
        save(folder, PEERS, {"versions": table}, facts)
    _compile(setup)
    for name in names or PARTS:
        began = time.perf_counter()
        setup.say(f"evidence: {name} begins")
        frames = part(name).measure(setup)
        save(folder, name, frames, facts)
        setup.say(f"evidence: {name} done in {time.perf_counter() - began:.0f} s")
    found = {name: load(folder, name) for name in PARTS}
    versions = load(folder, PEERS).get("versions", pd.DataFrame(columns=["peer", "version"]))
    return write_guide(
        {name: frames for name, frames in found.items() if frames},
        folder,
        dict(versions.itertuples(index=False)),
    )
