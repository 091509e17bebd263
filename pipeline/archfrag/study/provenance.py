"""Where results come from: one part that belongs in the cube, one that belongs in a log."""

import contextlib
import functools
import json
import math
import os
import platform
import socket
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import archfrag
from archfrag.files import counted
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.records import read_manifest
from archfrag.study.file.schema import Study
from archfrag.study.files import PACKAGE, digest_of, read_json, sha256_if_there, write_text
from archfrag.study.runs.store import Plan

_PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "obspy", "netCDF4")


def attributes(study: Study, plan: Plan) -> dict[str, str]:
    """Global attributes of the cube: the same on every run of the same study with this code."""
    config = {
        "id": study.id,
        "title": study.title,
        "arches": [_portable_arch(entry) for entry in study.arches],
        "intensity": {**study.intensity.model_dump(), "levels": list(study.intensity.given)},
        "method": study.method.model_dump(),
        "design": study.design.model_dump(),
    }
    inputs = read_manifest(study)["inputs"]
    count, of = sum(record.vertical for record in plan.records), len(plan.records)
    some = f"used for {count} of {of} records"
    counts = f"{counted(len(plan.arches), 'arch')} under {counted(of, 'record')}"
    return {
        "Conventions": "CF-1.11",
        "title": study.title,
        "institution": study.institution,
        "source": f"rigid-block simulations with archfrag {archfrag.__version__}, method "
        f"{study.method.name}",
        "vertical_component": some if 0 < count < of else "used" if count else "not used",
        "history": "Records read, processed and scaled to levels of the intensity measure; "
        f"simulations as the design {study.design.kind} asks for them; results gathered by "
        "archfrag.",
        "references": "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; the "
        "README of archfrag",
        "comment": f"{counts} scaled by {study.intensity.measure}. Wall times and machine are in "
        "a log beside this file.",
        "loss_limit": f"{study.method.loss_limit:g}",
        "archfrag_study": study.id,
        "archfrag_config": strict_json(config),
        "archfrag_inputs_sha256": strict_json(_by_name(inputs["record"])),
        "archfrag_index_sha256": strict_json(_by_name(inputs["index"])),
        "archfrag_inventories_sha256": strict_json(_by_name(inputs["inventory"])),
        "archfrag_processing": strict_json(
            [{"step": step.name, "settings": step.settings} for step in study.motions.processing]
        ),
        "archfrag_versions": strict_json(versions()),
        "archfrag_commit": commit(),
        "archfrag_machine": platform.machine(),
        "archfrag_plan": digest_of(plan.digests),
    }


def _portable_arch(entry: ArchEntry) -> dict[str, Any]:
    """An entry as a study gives it, defaults filled in, without folders."""
    if entry.table is not None:
        return {**entry.parameters, "table": Path(entry.table).name}
    facts = {"id": entry.id, **entry.build().parameters}
    if entry.drawing is not None:
        facts |= {"drawing": Path(entry.drawing).name, "sha256": sha256_if_there(entry.drawing)}
    if entry.vary is not None:
        facts["vary"] = entry.vary.model_dump(exclude_none=True)
    return facts


def _by_name(digests: dict[str, str]) -> dict[str, str]:
    """Digests by the shortest ends of their paths that distinguish all: no place, only names."""
    paths = [Path(path).parts for path in digests]
    for size in range(1, max(map(len, paths), default=1) + 1):
        ends = ["/".join(parts[-size:]) for parts in paths]
        if len(set(ends)) == len(ends):
            break
    return dict(zip(ends, digests.values()))


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results pass through."""
    found = {"archfrag": archfrag.__version__, "python": platform.python_version()}
    for name in _PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


@functools.cache
def commit() -> str:
    """Git commit of the checkout that this package runs from, "-dirty" if it has changes.

    Without a checkout the commit that the wheel was built from, then ARCHFRAG_COMMIT of the
    environment, which those who install from an archive may set, or else "unknown".
    """
    checkout = PACKAGE.parents[1]
    if (checkout / ".git").exists():
        command = ["git", "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"]
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            return subprocess.check_output(
                command, cwd=checkout, stderr=subprocess.DEVNULL, text=True, timeout=20
            ).strip()
    built_from = PACKAGE / "commit.txt"
    if built_from.is_file():
        return built_from.read_text().strip()
    return os.environ.get("ARCHFRAG_COMMIT", "unknown")


def strict_json(value: Any) -> str:
    """JSON that every reader takes: infinity as "inf"."""
    return json.dumps(finite(value), ensure_ascii=False, allow_nan=False)


def finite(value: Any, none: Any = str) -> Any:
    """The value with text, or with `none`, in the place of floats that JSON does not know."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value) if none is str else none
    if isinstance(value, dict):
        return {key: finite(entry, none) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry, none) for entry in value]
    return value


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """Where it runs, for the log."""
    host, system = socket.gethostname(), platform.platform()
    return {"host": host, "system": system, "cores": available_cores()}


def add_to_log(folder: Path, entry: dict[str, Any]) -> None:
    """Add an entry to ``run_log.json`` in a folder."""
    path = folder / "run_log.json"
    entries: list[Any] = []
    with contextlib.suppress(OSError, ValueError, TypeError):
        entries = list(read_json(path))
    write_text(path, json.dumps([*entries, entry], indent=1) + "\n")
