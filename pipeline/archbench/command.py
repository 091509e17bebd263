"""`archfrag evidence`: measure the parts asked for, keep their tables, write the page."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path

from archbench.adapters.client import NAMES, solver_versions
from archbench.page import PARTS, write_page
from archbench.runner import Bench
from archfrag.errors import InputError
from archfrag.study.provenance import available_cores


def gather(
    parts: Sequence[str],
    output: Path,
    *,
    quick: bool = False,
    records: Path | None = None,
    real: Path | None = None,
    solvers: Sequence[str] = (),
    workers: int | None = None,
    report: Callable[[str], None] = print,
) -> Path:
    """Measure parts one after the other, save each as soon as it is there, write the page.

    Parameters
    ----------
    parts : sequence of str
        Keys of `archbench.page.PARTS`; all if empty.
    output : Path
        Tables of parts not asked for are left as they are, and shown; what a killed run has
        finished is not done again.
    quick : bool
        The reduced set.
    records : Path, optional
        The shipped records, if not `records` of the working folder or of the checkout.
    real : Path, optional
        A folder of real ones.
    solvers : sequence of str
        Other solvers of `NAMES`, or "all" of those that are installed.
    workers : int, optional
        Processes; the cores that are available if not given.
    report : callable
        Takes a line for the user.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If there is no part, or no solver, of a name, or a solver is not installed.
    """
    for name in parts:
        if name not in PARTS:
            raise InputError(f"evidence has no part {name!r}; allowed are {', '.join(PARTS)}")
    for name in solvers:
        if name not in (*NAMES, "all"):
            raise InputError(f"--solvers: {name!r}; allowed are all, {', '.join(NAMES)}")
    installed = _installed(solvers, report)
    checkout = Path(__file__).parents[2] / "records"
    bench = Bench(
        output,
        quick=quick,
        records=(records or (Path("records") if Path("records").is_dir() else checkout)).resolve(),
        real=None if real is None else real.resolve(),
        solvers=installed,
        workers=workers or available_cores(),
        report=report,
    )
    for part in parts or PARTS:
        began = time.perf_counter()
        bench.save(part, import_module(f"archbench.{part}").measure(bench))
        report(f"{part}: {time.perf_counter() - began:.0f} s")
    return write_page(output)


def _installed(solvers: Sequence[str], report: Callable[[str], None]) -> tuple[str, ...]:
    """Those of the named solvers that are installed; if one asked for by name is not, refuse."""
    asked = NAMES if "all" in solvers else tuple(dict.fromkeys(solvers))
    versions = solver_versions(asked)
    missing = {name: text for name, text in versions.items() if text.startswith("not installed")}
    if missing and "all" not in solvers:
        raise InputError(f"--solvers: {'; '.join(f'{k} {v}' for k, v in missing.items())}")
    for name, text in versions.items():
        report(f"{name}: {text}")
    return tuple(name for name in asked if name not in missing)
