"""The record files of a study: found by an index or by patterns, each with how to read it."""

import fnmatch
import glob
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from archfrag.errors import InputError, StudyError
from archfrag.motions.calibrate import check_file
from archfrag.motions.index import (
    INDEX_NAME,
    IndexEntry,
    find_entry,
    goes_with_records,
    load_index,
)
from archfrag.motions.partners import VERTICAL, folder_names, partners, vertical_files
from archfrag.study.file import meant
from archfrag.study.file.motions import FileSet
from archfrag.study.file.schema import Study
from archfrag.study.files import KINDS, Inputs, sha256_if_there


@dataclass(frozen=True)
class Source:
    """A record file, and how to read it."""

    path: Path
    options: dict[str, Any]  # unit, inventory, accept and columns, as of `archfrag.read_motion`
    entry: IndexEntry | None = None  # row of the study's index
    name: str | None = None  # what ids begin with, where the file's own name is not enough
    # Files of the components "vertical" and "transverse" (the other horizontal) that are asked
    # for, unless they are in the record's own.
    others: dict[str, Path] = field(default_factory=dict)


def needs_pairs(study: Study) -> bool:
    """Whether both horizontal components of a record are needed at once."""
    steps = [step.name for step in study.motions.processing]
    return "rotate" in steps or study.intensity.measure.strip().startswith("RotD")


def find_sources(study: Study) -> list[Source]:
    """Find the record files of a study, in the order of its results.

    StudyError or RecordError if a file or an id is missing, or a file is found twice with
    different settings.
    """
    asked = study.motions
    rows = [] if asked.index is None else load_index(asked.index)
    used = rows
    if asked.select is not None and not asked.files:
        table = {row.id: row for row in rows}
        check_known(asked.select, table)
        used = [table[name] for name in dict.fromkeys(asked.select)]
    indexed = [Source(row.path, {"unit": row.unit or None, "accept": row.accept}, row)
               for row in used]  # fmt: skip
    given: dict[Path, Source] = {}
    for number, files in enumerate(asked.files):
        key = f"motions.files[{number}]"
        for source in _from_files(files, key):
            # Two patterns may match the same file.
            if given.setdefault(source.path, source) != source:
                other = "another unit, inventory, columns or accept"
                raise StudyError(f"{key}: an entry before it matches {source.path} with {other}")
    for source in (*indexed, *given.values()):
        check_file(source.path)
        if inventory := source.options.get("inventory"):
            check_file(Path(inventory))
    found = _without_verticals(indexed) + _with_names(_without_verticals(list(given.values())))
    return _with_partners(found, study, rows)


def study_inputs(study: Study) -> Inputs:
    """All files that the motions of a study follow from.

    Paths are relative to the folder of the results, so that a study may be moved with them.
    """
    sources, index = find_sources(study), study.motions.index
    records = [s.path for s in sources] + [path for s in sources for path in s.others.values()]
    places = list(dict.fromkeys(path.parent for path in records))
    indices = [place / INDEX_NAME for each in places for place in (each, each.parent)]
    if index is not None:
        indices.insert(0, Path(index, INDEX_NAME) if os.path.isdir(index) else Path(index))
    names = {name for path in records for name in (path.stem, path.name)}
    inventories = [Path(given) for s in sources if (given := s.options.get("inventory"))]
    for place in places:
        # NAME.xml, or NET.STA.xml with codes that only the record's content gives.
        every = sorted(place.glob("*.xml"))
        inventories += [p for p in every if p.stem in names or p.stem.count(".") == 1]
    inputs: Inputs = {}
    for kind, paths in zip(KINDS, (records, indices, inventories)):
        digests = {os.path.relpath(path, study.folder): sha256_if_there(path) for path in paths}
        inputs[kind] = {path: digest for path, digest in digests.items() if digest is not None}
    return inputs


def check_known(selected: Iterable[str], known: Iterable[str]) -> None:
    """Check that all selected records exist; `StudyError` names the first that does not."""
    names = list(known)
    for name in selected:
        if name not in names:
            hint = meant(name, names) or f"the study has {', '.join(names)}"
            raise StudyError(f"motions.select: {name!r} is not a record of the study; {hint}")


def _from_files(files: FileSet, key: str) -> list[Source]:
    pattern, paths = Path(files.path), [Path(files.path)]
    if glob.has_magic(files.path) and not pattern.is_file():
        # Folders match as they are written, names in any case.
        place, name = str(pattern.parent), re.compile(fnmatch.translate(pattern.name), re.I)
        folders = [place] if os.path.isdir(place) else glob.glob(place, recursive=True)
        every = [Path(folder, each) for folder in folders for each in folder_names(Path(folder))]
        paths = sorted(p for p in every if name.match(p.name) and not goes_with_records(p))
        if not paths:
            raise StudyError(f"{key}: no file matches {files.path}")
    options = files.model_dump(exclude={"path"})
    if files.columns is not None:
        from archfrag.motions.formats.columns import parse_columns

        try:
            options["columns"] = parse_columns(files.columns)
        except InputError as error:
            raise StudyError(f"{key}: {error}") from None
    return [Source(path, options) for path in paths]


def _with_names(sources: list[Source]) -> list[Source]:
    """Give sources whose ids would be equal the names of their folders too.

    Folders that they have in common do not count, so that a study can be moved.
    """
    stems = Counter(source.path.stem for source in sources)
    alike: dict[str, list[Path]] = {}
    for source in sources:
        if stems[source.path.stem] > 1 and find_entry(source.path) is None:
            from archfrag.motions.read import record_name  # imports obspy

            alike.setdefault(record_name(source.path), []).append(source.path)
    names: dict[Path, str] = {}
    for name, paths in alike.items():
        parents = [path.parent for path in paths]
        common = os.path.commonpath(parents)
        for path in paths if paths[1:] else ():
            last = path.name if parents.count(path.parent) > 1 else name
            names[path] = "+".join((*path.parent.relative_to(common).parts, last))
    return [replace(source, name=names.get(source.path)) for source in sources]


def _without_verticals(sources: Sequence[Source]) -> list[Source]:
    """Sources without those that hold only the vertical component of another one's record."""
    by_name = vertical_files(sorted({source.path for source in sources}))
    entries = [source.entry for source in sources]
    horizontal = {_site(entry) for entry in entries if not _is_vertical(entry)} - {None}
    return [
        source for source in sources if source.path not in by_name
        and not (_is_vertical(source.entry) and _site(source.entry) in horizontal)
    ]  # fmt: skip


def _with_partners(
    sources: list[Source], study: Study, rows: Sequence[IndexEntry]
) -> list[Source]:
    """Sources with the files of the other components that are asked for.

    A row of the index with the same event and station comes before a file of nearly the same
    name; what is in the record's own file comes before both when it is read.
    """
    asked = {"transverse": needs_pairs(study), "vertical": study.motions.vertical}
    if not any(asked.values()):
        return sources
    by_name = {place: partners(folder_names(place)) for place in {s.path.parent for s in sources}}
    found = []
    for source in sources:
        others, site = {}, _site(source.entry)
        for kind, names in zip(asked, by_name[source.path.parent]):
            alike = [row.path for row in rows if site is not None and row is not source.entry
                     and _site(row) == site and _is_vertical(row) == (kind == "vertical")]
            named = names.get(source.path.name)
            if asked[kind] and (len(alike) == 1 or named):
                others[kind] = alike[0] if len(alike) == 1 else source.path.with_name(str(named))
        found.append(replace(source, others=others))
    return found


def _is_vertical(row: IndexEntry | None) -> bool:
    return row is not None and bool(VERTICAL.fullmatch(str(row.metadata.get("component") or "")))


def _site(row: IndexEntry | None) -> tuple[Any, Any] | None:
    """Event and station of a row of an index, if both are known."""
    found = (row.metadata.get("event"), row.metadata.get("station")) if row else (None, None)
    return found if all(found) else None
