"""What archfrag wrote among the results, remembered, to tell it from files of other people."""

import contextlib
import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from archfrag.study.config import Study
from archfrag.study.digests import canonical_json, sha256_if_there, sha256_of
from archfrag.study.files import write_text

WRITTEN = "written.json"
_HDF5 = b"\x89HDF"
_MOST_BLOCKS, _SMALLEST_BLOCK = 64, 4096


def remember(study: Study, names: Iterable[str], group: str) -> None:
    """Remember files of the results, and remove older ones of the same group that we wrote."""
    written, kept = _load(study), set(names)
    for name in [n for n, entry in written.items() if entry["group"] == group]:
        path = study.folder / name
        if name not in kept and sha256_if_there(path) == written[name]["sha256"]:
            path.unlink(missing_ok=True)
        del written[name]
    for name in kept:
        path = study.folder / name
        size = max(_SMALLEST_BLOCK, -(-path.stat().st_size // _MOST_BLOCKS))
        written[name] = {
            "group": group, "sha256": sha256_of(path), "block": size,
            "blocks": sorted(_blocks(path, size)),
        }  # fmt: skip
    write_text(study.work / WRITTEN, canonical_json(written) + "\n")


def is_ours_damaged(study: Study, name: str) -> bool:
    """Whether a netCDF file of the results that cannot be read is what is left of one of ours.

    It is if we wrote one of its name and it is empty, begins as such files do, or shares a
    block with it.
    """
    entry = _load(study).get(name)
    if entry is None:
        return False
    path = study.folder / name
    with contextlib.suppress(OSError):
        with open(path, "rb") as file:
            head = file.read(len(_HDF5))
        return head in (b"", _HDF5) or bool(_blocks(path, entry["block"]) & set(entry["blocks"]))
    return False


def _blocks(path: Path, size: int) -> set[str]:
    found = set()
    with open(path, "rb") as file:
        while len(block := file.read(size)) == size:
            found.add(hashlib.sha256(block).hexdigest()[:16])
    return found


def _load(study: Study) -> dict[str, Any]:
    with contextlib.suppress(OSError, ValueError):
        return dict(json.loads((study.work / WRITTEN).read_text(encoding="utf-8")))
    return {}
