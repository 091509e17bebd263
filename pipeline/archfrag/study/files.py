"""Files that a study reads and writes: by content, complete or not at all, known as ours."""

import contextlib
import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import archfrag
from archfrag.files import cannot_write as cannot_write
from archfrag.files import make_folder as make_folder
from archfrag.files import opened
from archfrag.files import replacing as replacing
from archfrag.files import sha256_of as sha256_of
from archfrag.motions.index import INDEX_NAME

if TYPE_CHECKING:
    from archfrag.study.config import Study
    from archfrag.study.records import Source

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
    """Write a text file completely or not at all; leave one that holds the text already alone."""
    with contextlib.suppress(OSError), opened(path, 4 * len(text)) as file:
        if file.read() == text.encode():
            return
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def canonical_json(value: Any) -> str:
    """One text for one value: sorted keys, no spaces, floats to their last bit."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def digest_of(value: Any) -> str:
    """SHA-256 of a value that JSON knows, 64 hexadecimal digits."""
    return hashlib.sha256(canonical_json(value).encode("utf-8", "surrogateescape")).hexdigest()


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
    with contextlib.suppress(OSError), opened(path) as file:
        return file.read(len(_HDF5)) in (b"", _HDF5) or path.stat().st_size == entry["size"]
    return False


def _load(study: "Study") -> dict[str, Any]:
    with contextlib.suppress(OSError, ValueError):
        return dict(json.loads((study.work / WRITTEN).read_text(encoding="utf-8")))
    return {}


Inputs = dict[str, dict[str, str]]
KINDS = ("record", "index", "inventory")


def read_inputs(index: str | None, sources: Sequence["Source"]) -> Inputs:
    """SHA-256 of all files that the motions of a study follow from, by kind and path."""
    partners = (path for s in sources for path in (s.upward, s.beside) if path is not None)
    records = [*(source.path for source in sources), *partners]
    places = list(dict.fromkeys(path.parent for path in records))
    indices = [place / INDEX_NAME for each in places for place in (each, each.parent)]
    if index is not None:
        given = Path(index)
        indices.insert(0, given / INDEX_NAME if given.is_dir() else given)
    names = {name for path in records for name in (path.stem, path.name)}
    inventories = [Path(s.inventory) for s in sources if s.inventory is not None]
    for place in places:
        beside = sorted(place.glob("*.xml"))
        # NAME.xml, or NET.STA.xml with codes that only the record's content gives.
        inventories += [p for p in beside if p.stem in names or p.stem.count(".") == 1]
    found: Inputs = {}
    for kind, paths in zip(KINDS, (records, indices, inventories)):
        digests = {str(path): sha256_if_there(path) for path in dict.fromkeys(paths)}
        found[kind] = {path: digest for path, digest in digests.items() if digest is not None}
    return found


def changes(before: Inputs, now: Inputs) -> list[str]:
    """What changed from one state of the inputs to another, a line for each file.

    Nothing has where files of the same names hold the same, in whatever folders.
    """
    lines = []
    for kind in KINDS:
        old, new = before.get(kind, {}), now.get(kind, {})
        if _contents(old) == _contents(new):
            continue
        for path in sorted(set(old) | set(new)):
            was, is_ = old.get(path), new.get(path)
            if was is None or is_ is None:
                lines.append(f"{kind} {path} is {'new' if was is None else 'gone'}")
            elif was != is_:
                what = f"has changed (sha256 {was[:12]}, now {is_[:12]})"
                lines.append(f"{kind} {path} {what}")
    return lines


def _contents(digests: dict[str, str]) -> list[tuple[str, str]]:
    return sorted((Path(path).name, digest) for path, digest in digests.items())


def by_name(digests: dict[str, str]) -> dict[str, str]:
    """Digests by the shortest ends of their paths that distinguish all: no place, only names."""
    paths = [Path(path).parts for path in digests]
    for size in range(1, max(map(len, paths), default=1) + 1):
        ends = ["/".join(parts[-size:]) for parts in paths]
        if len(set(ends)) == len(ends):
            break
    return dict(zip(ends, digests.values()))
