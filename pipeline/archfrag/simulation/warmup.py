"""Kernels made ready ahead of a run, with a message that says how long it takes."""

import contextlib
import json
import os
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from archfrag.arch import Arch, Bridge
from archfrag.arch.quasi_static import SlowArch
from archfrag.motions.motion import Motion
from archfrag.physics.kernels import load
from archfrag.physics.kernels.__main__ import make_all_ready
from archfrag.physics.kernels.primitives import LANES
from archfrag.physics.oscillator import largest_response
from archfrag.simulation.arguments import check_compiled, check_method, method_names
from archfrag.simulation.rest import onset
from archfrag.simulation.simulate import simulate, simulate_many
from archfrag.system import every

TICK = 1.0
# What compiling takes on two cores, and making machine code of LLVM code [s].
COMPILING = 60.0
EMITTING = 5.0


def warmup(
    method: str | None = None, progress: Callable[[str], object] | None = None
) -> float:
    """Make the kernels ready once for this machine, or load them; return the seconds it took.

    Machine code is made of the LLVM code that comes with archfrag. If none does, the kernels are
    compiled, by two processes where there are two cores. `method` is the one to make ready; if not
    given, all installed methods are. `progress` is called with a message such as "loading kernels"
    or "compiling kernels (first run only): 12 s of about 60 s", first at once, then about every
    second from another thread.
    """
    check_compiled(plain=False)
    started = time.perf_counter()
    ready = kernels_are_compiled()
    names = method_names() if method is None else (method,)
    names = tuple(check_method(name).name for name in names)
    arch = Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)
    motion = Motion(np.zeros(3), dt=0.01)
    what = "compiling kernels"
    expected = COMPILING
    if is_shipped():
        what = "making machine code of the kernels"
        expected = EMITTING

    def report() -> None:
        passed = time.perf_counter() - started
        text = f"{what} (first run only): {passed:.0f} s of about {expected:.0f} s"
        if progress is not None:
            progress("loading kernels" if ready else text)

    report()
    with contextlib.nullcontext() if ready else every(TICK, report):
        make_all_ready()
        for name in names:
            simulate_many(arch, motion, [1.0], method=name)
            simulate(arch, motion, method=name)
    return time.perf_counter() - started


def is_shipped() -> bool:
    """Return whether archfrag comes with LLVM code of its kernels for this kind of processor."""
    return all(load.is_shipped(name) for name in load.SETS)


def kernels_are_compiled() -> bool:
    """Return whether `warmup` has only to load the kernels of a study."""
    return all(load.is_ready(name) for name in load.of_all())


def used_kernels() -> dict[str, list[Any]]:
    """Return the kernels that studies call, by set; each with the types of its arguments."""
    arch = Arch.circular(10.0, 1.5, 157.5, voussoirs=3, friction=0.7)
    motion = Motion(np.sin(np.arange(50.0)), dt=0.01)

    def calls() -> Iterator[None]:
        onset(arch)
        slow = SlowArch(arch.tied(level=6.0, area=5e-4, prestress=100.0))
        slow.tension(0, 200.0)
        for wave in (motion.acceleration, motion.acceleration * 1j):
            largest_response(wave, 0.01, 10.0, 0.05, np.ones(1, complex), np.zeros(1))
        yield
        for count in LANES:
            os.environ["ARCHFRAG_LANES"] = str(count)
            simulate_many(arch, motion, [0.5], method="time_stepping")
            yield
        del os.environ["ARCHFRAG_LANES"]
        simulate(arch, motion, method="time_stepping")
        simulate_many(arch, motion, [0.5], method="event_driven")
        simulate(arch, motion, method="event_driven")
        yield
        joint = np.tile([1e10, 1e10, 0.05, 0.0], (arch.n_joint, 1))
        soft = arch.changed(chain=arch.chain._replace(joint=joint))
        simulate_many(soft, motion, [0.5])
        simulate(soft, motion)
        yield
        bridge = Bridge([arch, arch], piers={"height": 5.0, "width": 4.0})
        onset(bridge)
        SlowArch(bridge.tied(level=6.0, area=5e-4)).tension(0, 200.0)
        simulate_many(bridge, motion, [0.5])
        simulate(bridge, motion)
        joint = np.tile([1e10, 1e10, 0.05, 0.0], (bridge.n_joint, 1))
        soft = bridge.changed(chain=bridge.chain._replace(joint=joint))
        simulate_many(soft, motion, [0.5])
        simulate(soft, motion)
        yield

    sets = dict[str, list[Any]]()
    known = set[Any]()
    load.called.clear()
    for name, _ in zip(load.SETS, calls()):
        sets[name] = sorted(set(load.called) - known, key=repr)
        known.update(load.called)
    return sets


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    print(json.dumps(used_kernels()))
