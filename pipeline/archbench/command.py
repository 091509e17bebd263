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

    `parts` are keys of `archbench.page.PARTS`, all if empty; tables in `output` of parts not asked
    for are left and shown, and what a killed run has finished is not done again. `records` are
    those of the working folder, or of the checkout, if not given. `solvers` may be "all" of those
    that are installed. InputError if there is no part or solver of a name, or it is not installed.
    """
    for name in parts:
        if name not in PARTS:
            raise InputError(f"evidence has no part {name!r}; allowed are {', '.join(PARTS)}")
    for name in solvers:
        if name not in (*NAMES, "all"):
            raise InputError(f"--solvers: {name!r}; allowed are all, {', '.join(NAMES)}")
    found = solver_versions(NAMES if "all" in solvers else tuple(dict.fromkeys(solvers)))
    for name, text in found.items():
        if text.startswith("not installed") and "all" not in solvers:
            raise InputError(f"--solvers: {name} {text}")
        report(f"{name}: {text}")
    here, checkout = Path("records"), Path(__file__).parents[2] / "records"
    bench = Bench(
        output,
        quick=quick,
        records=(records or (here if here.is_dir() else checkout)).resolve(),
        real=None if real is None else real.resolve(),
        solvers=tuple(name for name in found if not found[name].startswith("not installed")),
        workers=workers or available_cores(),
        report=report,
    )
    for part in parts or PARTS:
        began = time.perf_counter()
        bench.save(part, import_module(f"archbench.{part}").measure(bench))
        report(f"{part}: {time.perf_counter() - began:.0f} s")
    return write_page(output)
