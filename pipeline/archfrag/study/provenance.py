"""Provenance of a study: what its results depend on, which files it makes, and what is done.

A study has one stamp: digests of what its cube depends on, and the SHA-256 of the files that were
made. Times of modification are not used. Nothing heavy is imported before it is known whether
anything is to be done.
"""

import contextlib
import functools
import glob
import hashlib
import json
import math
import os
import platform
import re
import socket
import subprocess
import threading
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag.errors import OutputError
from archfrag.files import (
    STAMPS,
    WORK,
    Named,
    absolute,
    check_targets,
    make_folder,
    opened,
    relative_path,
    replacing,
    sha256_of,
    sweep,
)
from archfrag.system import Deferred, available_cores
from archfrag.version import __version__

if TYPE_CHECKING:
    from archfrag.study.file.schema import StudyKeys

metadata = Deferred("importlib.metadata")  # loads modules of e-mail too
PACKAGE = Path(__file__).resolve().parents[1]
CUBE = "cube.nc"
README = "README.txt"
REPORT_FILES = ("report.html", "summary.json", "capacities.csv", "runs.csv", README)
ALL_CURVES = (
    "curves.svg"  # one figure of all curves, if there are too many for one each
)
SHOWN = 12  # most arches that a report shows one by one; of more it shows three
MANIFEST = "motions.json"  # in the hidden folder
OWNER = "study.json"  # in the hidden folder
FIGURE = r"curves\.svg|curve-[A-Za-z0-9][A-Za-z0-9_.+-]*\.svg"
# netCDF's C library is not safe in threads, and xarray's own lock does not hold for attributes.
NETCDF = threading.RLock()
Inputs = dict[str, dict[str, str]]  # SHA-256 of files by kind and path


def write_text(path: Path, text: str) -> None:
    """Write a text file completely or not at all. A file that has this text is left alone."""
    with contextlib.suppress(OSError), opened(path, 4 * len(text)) as file:
        if file.read() == text.encode():
            return
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def canonical_json(value) -> str:
    """Return the JSON of a value in its one form: sorted keys, no spaces, all digits of floats."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def read_json(path: Path):
    """Return the value of a JSON file.

    OSError if the file cannot be read, ValueError if it is not JSON.
    """
    try:
        with opened(path) as file:
            return json.load(file)
    except RecursionError:
        raise ValueError("lists in lists without end") from None


def digest_of(value) -> str:
    """Return the SHA-256 of the JSON of a value as 64 hexadecimal digits."""
    return hashlib.sha256(
        canonical_json(value).encode("utf-8", "surrogateescape")
    ).hexdigest()


def files_of_code(*patterns: str) -> list[Path]:
    """Return the files of this package that match one of the patterns, sorted."""
    found = {path for pattern in patterns for path in PACKAGE.glob(pattern)}
    return sorted(path for path in found if path.is_file() and path.suffix != ".pyc")


@functools.cache
def code() -> str:
    """Return one SHA-256 of this package's files, the versions of libraries and the machine."""
    digest = hashlib.sha256(canonical_json([versions(), platform.machine()]).encode())
    for path in files_of_code("**/*"):
        digest.update(path.relative_to(PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def sha256_if_there(path: Path | str) -> str | None:
    """Return the SHA-256 of a file; None if it cannot be read."""
    try:
        return sha256_of(Path(path))
    except (OSError, ValueError):
        return None


def check_own(study: "StudyKeys") -> None:
    """Remove from the hidden folder of a study what killed processes left there.

    OutputError if the folder or an entry in it is a link, pipe or device. A link may lead to files
    of somebody else, which would then be emptied or removed.
    """
    strange = "is a link, pipe or device, which archfrag did not make; remove it"
    if study.work.is_symlink():
        raise OutputError(f"{study.work}: {strange}")
    for entry in study.work.rglob("*"):
        if entry.is_symlink() or not (entry.is_dir() or entry.is_file()):
            raise OutputError(f"{entry}: {strange}")
    sweep(study.work)


def read_state(path: Path) -> Named:
    """Return the mapping in a JSON file of the hidden folder; empty if it cannot be read."""
    try:
        return dict(read_json(path))
    except (OSError, ValueError, TypeError):
        return {}


def read_stamp(folder: Path) -> dict[str, dict[str, str]]:
    """Return the stamp of the results in a folder.

    `from` has digests of what the results depend on, by name. `files` has the SHA-256 of what was
    made, `old` that of what was made for an earlier cube. `inputs` has digests of what was read;
    it is empty until all is done.
    """
    stamp = {name: dict[str, str]() for name in ("from", "files", "old", "inputs")}
    stamp |= read_state(folder / WORK / STAMPS)
    return {
        name: each if isinstance(each, dict) else {} for name, each in stamp.items()
    }


def write_stamp(study: "StudyKeys", step: str, **others) -> None:
    """Add the SHA-256 of the files of a step to the stamp of a study.

    The step cube begins a new stamp, in which files made before are old. The step report removes
    old figures that the study no longer has. `others` replace parts of the stamp.
    """
    stamp = read_stamp(study.folder)
    if step == "cube":
        stamp = {
            "from": study.origin,
            "files": {},
            "old": stamp["old"] | stamp["files"],
        }
    made = filter(Path.is_file, products(study, step))
    stamp["files"] |= {path.name: sha256_of(path) for path in made}
    if step == "report":
        for name, digest in stamp.pop("old").items():
            path = study.folder / name
            gone = re.fullmatch(FIGURE, name) and name not in stamp["files"]
            if gone and not path.is_symlink() and sha256_if_there(path) == digest:
                path.unlink()
    write_text(study.work / STAMPS, canonical_json(stamp | others) + "\n")


def out_of_date(study: "StudyKeys", *steps: str) -> str:
    """Return why the files of cube, fit or report are out of date; empty if they are not."""
    stamp = read_stamp(study.folder)
    for path in (path for step in steps for path in products(study, step)):
        known = stamp["files"].get(path.name)
        if known is None and path.name != README:
            return f"{path}: is missing, or no step of this study made it"
        if known != sha256_if_there(path):
            return f"{path}: is missing, changed or damaged"
    before = stamp["from"]
    now = study.origin
    changed = [name for name in now | before if now.get(name) != before.get(name)]
    return (
        f"{study.folder / CUBE}: was made before these changed: {', '.join(changed)}"
        * bool(changed)
    )


def origin_of(keys: Named, place: Path, folder: Path) -> dict[str, str]:
    """Return digests of what the results in a folder depend on, except files, by name.

    `keys` are those of the study file, which is in the folder `place`; `folder` is that of the
    results.
    """
    found = {key: keys[key] for key in keys.keys() - {"output", "execution"}}
    found["folder"] = relative_path(place, os.path.realpath(folder))
    found["home"] = os.path.expanduser("~")
    found["code"] = code()
    return {str(name): digest_of(value) for name, value in found.items()}


def contents(folder: Path, places: Iterable[str]) -> dict[str, str]:
    """Return the digests of files and folders by their `places`, which start from `folder`.

    That of a folder is the digest of the names in it. A place may be a pattern; its digest is that
    of all that match.
    """
    found = {}
    for place in places:
        path = os.path.join(folder, place)
        paths = [path]
        if glob.has_magic(path) and not os.path.exists(path):
            paths = sorted(glob.glob(path, recursive=True))
        lists = [
            sorted(os.listdir(each)) if os.path.isdir(each) else sha256_if_there(each)
            for each in paths
        ]
        found[place] = digest_of([*map(os.path.basename, paths), *lists])
    return found


def finished_folder(path: Path, keys: Named, place: Path) -> Path | None:
    """Return the folder of a study's results if nothing has changed since its run; else None.

    `path` is the study file, `keys` are its keys, and `place` is its folder. None gives no reason:
    the run says what has changed. OutputError if the results are those of another study file.
    """
    output = keys.get("output") or os.path.join("results", str(keys.get("id")))
    folder = Path(absolute(str(output), place))
    check_owner(folder, path)
    with contextlib.suppress(OSError, ValueError, TypeError):
        stamp = read_stamp(folder)
        made = {name: sha256_if_there(folder / name) for name in stamp["files"]}
        same = stamp["inputs"] and stamp["from"] == origin_of(keys, place, folder)
        inputs = stamp["inputs"]
        if same and made == stamp["files"] and contents(folder, inputs) == inputs:
            return folder
    return None


def check_owner(folder: Path, study_file: Path) -> None:
    """Raise OutputError if the results in a folder are those of another study file."""
    file = folder / str(read_state(folder / WORK / OWNER).get("file", ""))
    if file.is_file() and not file.samefile(study_file):
        raise OutputError(
            f"{folder}: holds the results of {file.resolve()}; give {study_file.name} "
            "another output, or another id if it names none"
        )


def claim(study: "StudyKeys", study_file: Path) -> None:
    """Write into the folder of the results which study file they are of.

    The path of the file is relative to that folder, so that both may be moved. OutputError if the
    results are those of another study file.
    """
    check_owner(study.folder, study_file)
    here = relative_path(study_file.resolve(), study.folder.resolve())
    owner = canonical_json({"id": study.id, "file": here})
    make_folder(study.work)
    write_text(study.work / OWNER, owner + "\n")


def products(study: "StudyKeys", step: str) -> list[Path]:
    """Return the paths of the files that a step makes, without the parts that hold runs.

    `step` is motions, batch-0of1 and so on, cube, fit or report.
    """
    if step.startswith("batch"):  # a table of its runs, with how long each took
        return [study.work / "runs" / f"{step}.csv"]
    if step == "motions":
        return [study.work / MANIFEST]
    names = {"cube": [CUBE], "fit": ["fits.json", "curve.csv"]}.get(
        step, [*REPORT_FILES]
    )
    if step == "report":
        sizes = Counter(member.arch_class for member in study.members)
        drawn = [name for name, size in sizes.items() if size > 1]
        if sizes.total() > SHOWN:
            names.append(ALL_CURVES)
        else:
            drawn += [member.id for member in study.members]
        names += [f"curve-{each}.svg" for each in drawn]
    return [study.folder / name for name in names]


def files_named(study: "StudyKeys") -> list[str]:
    """Return the paths of all files that keys of a study name, except records."""
    named = [each for entry in study.arches for each in (entry.table, entry.drawing)]
    hazard = study.risk.hazard if study.risk else None
    named += [study.motions.index, study.report.logo, hazard]
    return [each for each in named if each is not None]


def check_outputs(study: "StudyKeys", *steps: str) -> None:
    """Check that the files of `steps` replace no input of the study and no foreign file.

    A foreign README is allowed, since it stays as it is; a cube of this study may be damaged.
    OutputError names the first file that is refused.
    """
    refuse_foreign_cube(study)
    targets = [path for step in steps for path in products(study, step)]
    own = [path for path in targets if path.name not in (README, CUBE)]
    check_targets(own, files_named(study), of_study=True)


def refuse_foreign_cube(study: "StudyKeys") -> None:
    """Raise OutputError if a foreign file stands where this study's cube is to be.

    It may be another study's cube. A damaged cube of this study is allowed.
    """
    path = study.folder / CUBE
    stamp = read_stamp(study.folder)
    digest = stamp["files"].get(CUBE, stamp["old"].get(CUBE))
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
        raise OutputError(
            f"{path}: {whose} is in the place of study {study.id!r}; give the studies different "
            "output folders, or move the file"
        )


def changes(before: Inputs, now: Inputs, folder: Path) -> list[str]:
    """List the changes from one state of the inputs to another, a line for each file."""
    lines = []
    for kind, new in now.items():
        old = before.get(kind, {})
        words = dict.fromkeys(old, "is gone") | dict.fromkeys(new, "is new")
        words |= dict.fromkeys(old.keys() & new, "has changed")
        for path in sorted(words):
            if old.get(path) != new.get(path):
                lines.append(f"{kind} {os.path.normpath(folder / path)} {words[path]}")
    return lines


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of archfrag, of Python and of the packages that results depend on."""
    found = {"archfrag": __version__, "python": platform.python_version()}
    for name in ("numpy", "numba", "llvmlite", "scipy", "obspy", "netCDF4"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


@functools.cache
def commit() -> str:
    """Return the git commit of this package; a checkout with changes adds "-dirty" to its name.

    Without a checkout it is the commit that the wheel was made of, else ARCHFRAG_COMMIT of the
    environment, else "unknown".
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
        return built_from.read_text("ascii").strip()
    return os.environ.get("ARCHFRAG_COMMIT", "unknown")


def strict_json(value) -> str:
    """Return JSON that every reader accepts: inf and nan become text, such as "inf"."""
    return json.dumps(finite(value), ensure_ascii=False, allow_nan=False)


def finite(value, none=str):
    """Return a value in which floats that are inf or nan are replaced, also in lists and mappings.

    They become text, or the value `none` if it is given.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return str(value) if none is str else none
    if isinstance(value, dict):
        return {key: finite(entry, none) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry, none) for entry in value]
    return value


def machine() -> Named:
    """Return the name, the system and the number of cores of this machine, for the log."""
    return {
        "host": socket.gethostname(),
        "system": platform.platform(),
        "cores": available_cores(),
    }


def add_to_log(folder: Path, entry: Named) -> None:
    """Add an entry to ``run_log.json`` in a folder."""
    path = folder / "run_log.json"
    before = list[Any]()
    with contextlib.suppress(OSError, ValueError, TypeError):
        before = list(read_json(path))
    write_text(path, json.dumps([*before, entry], indent=1) + "\n")
