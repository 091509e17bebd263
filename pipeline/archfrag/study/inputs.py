"""What a study reads, by content: records, index and inventories with their SHA-256."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from archfrag.motions.index import INDEX_NAME
from archfrag.study.files import sha256_if_there

if TYPE_CHECKING:
    from archfrag.study.records import Source

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
            if old.get(path) == new.get(path):
                continue
            what = f"{kind} {path}"
            if path not in new:
                lines.append(f"{what} is gone")
            elif path not in old:
                lines.append(f"{what} is new")
            else:
                lines.append(f"{what} has changed (sha256 {old[path][:12]}, now {new[path][:12]})")
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
