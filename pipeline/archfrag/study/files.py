"""Files of results: written complete or not at all, by content, and known as ours."""

import contextlib
import hashlib
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import archfrag
from archfrag.files import cannot_write as cannot_write
from archfrag.files import make_folder as make_folder
from archfrag.files import replacing as replacing

if TYPE_CHECKING:
    from archfrag.study.config import Study

PACKAGE = Path(archfrag.__file__).resolve().parent
WRITTEN = "written.json"
_HDF5 = b"\x89HDF"
# Temporary names: a dot, the name that the file was to have, and random characters.
_LEFT_OVER = re.compile(
    r"\..+\.(npz|npy|json|csv|nc|html|svg|yaml|xml|parquet)\.[A-Za-z0-9_]+(\.tmp)?"
)


def sweep(folder: Path) -> None:
    """Remove temporary files that a killed run left; nothing else may be at work there."""
    for path in folder.rglob(".*"):
        if _LEFT_OVER.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file completely or not at all, and leave one that holds the text already alone.

    Raises
    ------
    OutputError
    """
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if path.read_text(encoding="utf-8") == text:
            return
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def canonical_json(value: Any) -> str:
    """One text for one value: sorted keys, no spaces, floats to their last bit."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def digest_of(value: Any) -> str:
    """SHA-256 of a value that JSON knows, 64 hexadecimal digits."""
    return hashlib.sha256(canonical_json(value).encode("utf-8", "surrogateescape")).hexdigest()


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha256_if_there(path: Path | str) -> str | None:
    """SHA-256 of a file; None if there is none that can be read."""
    try:
        return sha256_of(Path(path))
    except (OSError, ValueError):
        return None


def source_hash(*names: str) -> str:
    """Hash of some of the package's files and folders: an edit makes results out of date."""
    digest = hashlib.sha256()
    for name in names:
        place = PACKAGE / name
        for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if path.is_file() and path.suffix != ".pyc":
                digest.update(str(path.relative_to(PACKAGE)).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def remember(study: "Study", names: Iterable[str], group: str) -> None:
    """Remember files of the results, and remove older ones of the same group that we wrote."""
    written, kept = _load(study), set(names)
    for name in [n for n, entry in written.items() if entry["group"] == group]:
        path = study.folder / name
        if name not in kept and sha256_if_there(path) == written[name]["sha256"]:
            path.unlink(missing_ok=True)
        del written[name]
    for name in kept:
        path = study.folder / name
        size = path.stat().st_size
        written[name] = {"group": group, "sha256": sha256_of(path), "size": size}
    write_text(study.work / WRITTEN, canonical_json(written) + "\n")


def is_ours_damaged(study: "Study", name: str) -> bool:
    """Whether a netCDF file of the results that cannot be read is what is left of one of ours.

    It is if we wrote one of its name and it is empty, begins as such files do, or is as large.
    """
    entry, path = _load(study).get(name), study.folder / name
    if entry is None:
        return False
    with contextlib.suppress(OSError), open(path, "rb") as file:
        return file.read(len(_HDF5)) in (b"", _HDF5) or path.stat().st_size == entry["size"]
    return False


def _load(study: "Study") -> dict[str, Any]:
    with contextlib.suppress(OSError, ValueError):
        return dict(json.loads((study.work / WRITTEN).read_text(encoding="utf-8")))
    return {}
