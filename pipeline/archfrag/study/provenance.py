"""Files that a study reads and writes, known by their content; and what results are made with."""

import contextlib
import functools
import hashlib
import json
import math
import os
import platform
import re
import socket
import subprocess
import threading
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag.errors import OutputError
from archfrag.files import STAMPS, opened, replacing, sha256_of, sweep
from archfrag.version import __version__

if TYPE_CHECKING:
    from archfrag.study.file.schema import StudyKeys

PACKAGE = Path(__file__).resolve().parents[1]
CUBE = "cube.nc"
OWNER = "study.json"  # in the hidden folder
FIGURE = re.compile(r"curves\.svg|curve-[A-Za-z0-9][A-Za-z0-9_.+-]*\.svg")
# netCDF's C library is not safe in threads, and xarray's own lock does not hold for attributes.
NETCDF = threading.RLock()
Inputs = dict[str, dict[str, str]]  # SHA-256 of files by kind and path


def write_text(path: Path, text: str) -> None:
    """Write a text file completely or not at all; leave one that holds the text already alone."""
    with contextlib.suppress(OSError), opened(path, 4 * len(text)) as file:
        if file.read() == text.encode():
            return
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def canonical_json(value: Any) -> str:
    """Return one text for one value: sorted keys, no spaces, floats to their last bit."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def read_json(path: Path) -> Any:
    """Return the value of a JSON file; OSError or ValueError if it cannot be read or holds
    something else.
    """
    try:
        with opened(path) as file:
            return json.load(file)
    except RecursionError:
        raise ValueError("lists in lists without end") from None


def digest_of(value: Any) -> str:
    """Return the SHA-256 of a value that JSON knows, 64 hexadecimal digits."""
    return hashlib.sha256(
        canonical_json(value).encode("utf-8", "surrogateescape")
    ).hexdigest()


def files_of_code(*patterns: str) -> list[Path]:
    """Return the files of this package that patterns match, in order."""
    found = {path for pattern in patterns for path in PACKAGE.glob(pattern)}
    return sorted(path for path in found if path.is_file() and path.suffix != ".pyc")


@functools.cache
def digest_of_code(*patterns: str) -> str:
    """Return the SHA-256 of files of this package, 64 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in files_of_code(*patterns):
        digest.update(str(path.relative_to(PACKAGE)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def sha256_if_there(path: Path | str) -> str | None:
    """Return the SHA-256 of a file; None if there is none that can be read."""
    try:
        return sha256_of(Path(path))
    except (OSError, ValueError):
        return None


def check_own(study: "StudyKeys") -> None:
    """Sweep the hidden folder of a study; OutputError for anything there but files and folders.

    A link leads to files of somebody else, which would be emptied or removed as our own.
    """
    strange = "is a link, pipe or device, which archfrag did not make; remove it"
    if study.work.is_symlink():
        raise OutputError(f"{study.work}: {strange}")
    for entry in study.work.rglob("*"):
        if entry.is_symlink() or not (entry.is_dir() or entry.is_file()):
            raise OutputError(f"{entry}: {strange}")
    sweep(study.work)


def read_state(path: Path) -> dict[str, Any]:
    """Return what a file of the hidden folder holds; empty if it cannot be read."""
    try:
        return dict(read_json(path))
    except (OSError, ValueError, TypeError):
        return {}


def write_stamp(work: Path, step: str, stamp: dict[str, Any]) -> None:
    """Put what a step was made from, and what it made, into the stamp of a study."""
    write_text(
        work / STAMPS, canonical_json(read_state(work / STAMPS) | {step: stamp}) + "\n"
    )


def read_stamp(
    study: "StudyKeys", step: str
) -> tuple[dict[str, Any] | None, dict[str, str]]:
    """Return what a step was made from, None if it is not done, and digests of its files."""
    try:
        stamp = read_state(study.work / STAMPS)[step]
        return dict(stamp["from"]), dict(stamp["files"])
    except (ValueError, KeyError, TypeError):
        return None, {}


def refuse_foreign_cube(study: "StudyKeys") -> None:
    """See that no other study's cube stands where this study's is to be; ours may be damaged."""
    path = study.folder / CUBE
    digest = read_stamp(study, "cube")[1].get(CUBE)
    if not path.exists() or (digest is not None and sha256_if_there(path) == digest):
        return
    owner = None
    if path.is_file():  # a pipe would be waited for
        import xarray as xr

        try:
            with NETCDF, xr.open_dataset(path, engine="netcdf4") as cube:
                owner = cube.attrs.get("archfrag_study")
        except (OSError, ValueError, RuntimeError):
            with contextlib.suppress(OSError), opened(path) as file:
                if digest is not None and file.read(4) in (b"", b"\x89HDF"):
                    return
    if owner != study.id:
        whose = (
            f"the cube of study {owner!r}"
            if owner
            else "a file that is no cube of archfrag"
        )
        advice = "give the studies different output folders, or move the file"
        raise OutputError(
            f"{path}: {whose} is in the place of study {study.id!r}; {advice}"
        )


def changes(before: Inputs, now: Inputs, folder: Path) -> list[str]:
    """List the changes from one state of the inputs to another, a line for each file."""
    lines = []
    for kind in ("record", "index", "inventory"):
        old = before.get(kind, {})
        new = now.get(kind, {})
        for path in sorted(
            path for path in old | new if old.get(path) != new.get(path)
        ):
            what = (
                "is new"
                if path not in old
                else "has changed"
                if path in new
                else "is gone"
            )
            lines.append(f"{kind} {os.path.normpath(folder / path)} {what}")
    return lines


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results pass through."""
    found = {"archfrag": __version__, "python": platform.python_version()}
    for name in ("numpy", "numba", "llvmlite", "scipy", "obspy", "netCDF4"):
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


@functools.cache
def commit() -> str:
    """Return the git commit of the checkout that this package runs from, "-dirty" if it has
    changes.

    Without one that of the wheel, of ARCHFRAG_COMMIT in the environment, or "unknown".
    """
    checkout = PACKAGE.parents[1]
    if (checkout / ".git").exists():
        command = [
            "git",
            "describe",
            "--always",
            "--abbrev=40",
            "--exclude=*",
            "--dirty",
        ]
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            return subprocess.check_output(
                command, cwd=checkout, stderr=subprocess.DEVNULL, text=True, timeout=20
            ).strip()
    built_from = PACKAGE / "commit.txt"
    if built_from.is_file():
        return built_from.read_text().strip()
    return os.environ.get("ARCHFRAG_COMMIT", "unknown")


def strict_json(value: Any) -> str:
    """Return the JSON that every reader takes: infinity as "inf"."""
    return json.dumps(finite(value), ensure_ascii=False, allow_nan=False)


def finite(value: Any, none: Any = str) -> Any:
    """Return value with text, or with `none`, in the place of floats that JSON does not know."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value) if none is str else none
    if isinstance(value, dict):
        return {key: finite(entry, none) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry, none) for entry in value]
    return value


def available_cores() -> int:
    """Return the cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)  # not on every system
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def machine() -> dict[str, Any]:
    """Describe the machine for the log."""
    return {
        "host": socket.gethostname(),
        "system": platform.platform(),
        "cores": available_cores(),
    }


def add_to_log(folder: Path, entry: dict[str, Any]) -> None:
    """Add an entry to ``run_log.json`` in a folder."""
    path = folder / "run_log.json"
    before = list[Any]()
    with contextlib.suppress(OSError, ValueError, TypeError):
        before = list(read_json(path))
    write_text(path, json.dumps([*before, entry], indent=1) + "\n")
