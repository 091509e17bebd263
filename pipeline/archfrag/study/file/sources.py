"""The records of a study: found by an index or by patterns, read and processed."""

import fnmatch
import glob
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag.errors import InputError, RecordError
from archfrag.files import sha256_of
from archfrag.motions import index
from archfrag.motions.calibrate import check_file
from archfrag.motions.partners import VERTICAL, folder_names, partners, vertical_files
from archfrag.study.file import meant
from archfrag.study.file.motions import FileSet, apply_step
from archfrag.study.file.schema import Study
from archfrag.study.files import KINDS, Inputs, sha256_if_there

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion


@dataclass(frozen=True)
class Source:
    """A record file, and how to read it."""

    path: Path
    options: dict[str, Any]  # unit, inventory, accept and columns, as of `archfrag.read_motion`
    entry: index.IndexEntry | None = None  # row of the study's index
    name: str | None = None  # what ids begin with, where the file's own name is not enough
    # Files of the components "vertical" and "transverse" (the other horizontal) that are asked
    # for, unless they are in the record's own.
    others: dict[str, Path] = field(default_factory=dict)


def needs_pairs(study: Study) -> bool:
    """Whether both horizontal components of a record are needed at once."""
    steps = [step.name for step in study.motions.processing]
    return "rotate" in steps or study.intensity.measure.strip().startswith("RotD")


def find_sources(study: Study) -> list[Source]:
    """Find the record files of a study.

    InputError or RecordError for a file or id that is missing, or is there with two settings.
    """
    asked = study.motions
    rows = [] if asked.index is None else index.load_index(asked.index)
    select = None if asked.files else asked.select  # of files the ids are known when read
    check_known(select or (), [row.id for row in rows])
    indexed = [Source(row.path, {"unit": row.unit or None, "accept": row.accept}, row)
               for row in rows if select is None or row.id in select]  # fmt: skip
    given: dict[Path, Source] = {}
    for number, files in enumerate(asked.files):
        try:
            for source in _from_files(files):
                # Two patterns may match the same file.
                if given.setdefault(source.path, source) != source:
                    other = "another unit, inventory, columns or accept"
                    raise InputError(f"an entry before it matches {source.path} with {other}")
        except InputError as error:
            raise InputError(f"motions.files[{number}]: {error}") from None
    every = [*indexed, *given.values()]
    for source in every:
        check_file(source.path)
        if inventory := source.options.get("inventory"):
            check_file(Path(inventory))
    # Without those that hold only the vertical component of another one's record.
    verticals = vertical_files(sorted({source.path for source in every}))
    sites = {_site(source.entry) for source in every if not _is_vertical(source.entry)} - {None}
    found = [source for source in every if source.path not in verticals
             and not (_is_vertical(source.entry) and _site(source.entry) in sites)]  # fmt: skip
    return _with_partners(_with_names(found), study, rows)


def study_inputs(study: Study) -> Inputs:
    """All files that the motions of a study follow from.

    Paths are relative to the folder of the results, so that a study may be moved with them.
    """
    sources, given = find_sources(study), study.motions.index
    records = [s.path for s in sources] + [path for s in sources for path in s.others.values()]
    places = list(dict.fromkeys(path.parent for path in records))
    indices = [place / index.INDEX_NAME for each in places for place in (each, each.parent)]
    if given is not None:
        indices.insert(0, Path(given, index.INDEX_NAME if os.path.isdir(given) else ""))
    names = {name for path in records for name in (path.stem, path.name)}
    inventories = [Path(p) for s in sources if (p := s.options.get("inventory")) is not None]
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
    """Check that all selected records exist; `InputError` names the first that does not."""
    names = list(known)
    for name in selected:
        if name not in names:
            hint = meant(name, names) or f"the study has {', '.join(names)}"
            raise InputError(f"motions.select: {name!r} is not a record of the study; {hint}")


def _from_files(files: FileSet) -> list[Source]:
    pattern, paths = Path(files.path), [Path(files.path)]
    if glob.has_magic(files.path) and not pattern.is_file():
        # Folders match as they are written, names in any case.
        place, name = str(pattern.parent), re.compile(fnmatch.translate(pattern.name), re.I)
        folders = [place] if os.path.isdir(place) else glob.glob(place, recursive=True)
        every = [Path(folder, each) for folder in folders for each in folder_names(Path(folder))]
        paths = sorted(p for p in every if name.match(p.name) and not index.goes_with_records(p))
        if not paths:
            raise InputError(f"no file matches {files.path}")
    options = files.model_dump(exclude={"path"})
    if files.columns is not None:
        from archfrag.motions.formats.columns import parse_columns

        options["columns"] = parse_columns(files.columns)
    return [Source(path, options) for path in paths]


def _with_names(sources: list[Source]) -> list[Source]:
    """Give sources whose ids would be equal the names of their folders too, but common ones."""
    plain = [source for source in sources if source.entry is None]
    stems = Counter(source.path.stem for source in plain)
    alike: dict[str, list[Path]] = {}
    for source in plain:
        if stems[source.path.stem] > 1 and index.find_entry(source.path) is None:
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


def _with_partners(
    sources: list[Source], study: Study, rows: Sequence[index.IndexEntry]
) -> list[Source]:
    """Sources with the files of the other components that are asked for.

    A row of the index with the same event and station comes before a file of nearly the same name.
    """
    asked = {"transverse": needs_pairs(study), "vertical": study.motions.vertical}
    if not any(asked.values()):
        return sources
    by_name = {place: partners(folder_names(place)) for place in {s.path.parent for s in sources}}
    found = []
    for source in sources:
        others, site = {}, _site(source.entry)
        alike = [row for row in rows if site and _site(row) == site and row is not source.entry]
        for kind, names in zip(asked, by_name[source.path.parent]):
            paths = [row.path for row in alike if _is_vertical(row) == (kind == "vertical")]
            if len(paths) != 1 and (named := names.get(source.path.name)):
                paths = [source.path.with_name(named)]
            if asked[kind] and len(paths) == 1:
                others[kind] = paths[0]
        found.append(replace(source, others=others))
    return found


def _is_vertical(row: index.IndexEntry | None) -> bool:
    return row is not None and bool(VERTICAL.fullmatch(str(row.metadata.get("component") or "")))


def _site(row: index.IndexEntry | None) -> tuple[Any, Any] | None:
    """Event and station of a row of an index, if both are known."""
    found = (row.metadata.get("event"), row.metadata.get("station")) if row else (None, None)
    return found if all(found) else None


def read_sources(study: Study) -> Iterator["Motion"]:
    """Read the motions of a study one after the other, processed as it asks."""
    select, steps = study.motions.select, {s.name: s.settings for s in study.motions.processing}
    chosen = steps.get("choose", {}).get("components", ())
    taken: dict[str, Path] = {}
    left_out: dict[Any, str] = {}  # records by their facts, with a component not chosen
    used, turned = set[Any](), set[Any]()
    for source in find_sources(study):
        path, every = source.path, _read(source)
        facts = {"file": path.name, "file_sha256": sha256_of(path)}
        for motion in every:
            about, code = motion.metadata, str(motion.metadata.get("component", ""))
            shared = tuple(str(about.get(k) or "") for k in ("event", "station", "start_time"))
            record = shared if any(shared) else path
            if chosen and not {code.upper(), code[-1:].upper()} & {c.upper() for c in chosen}:
                left_out.setdefault(record, f"{path}: record {motion.id} ({code})")
                continue
            used.add(record)
            if (path, code) in turned:  # the other component of a motion that was rotated
                continue
            motion = _with_components(study, motion, every, source)
            if "rotate" in steps:
                same = motion.metadata.get("file_transverse", "") == path.name
                file = path if same else source.others.get("transverse")
                turned.add((file, motion.metadata.get("component_transverse", "")))
            motion = _processed(study, motion, source)
            if motion.id in taken:
                whose = f"already belongs to {taken[motion.id]}; each record needs its own"
                raise RecordError(f"{path}: the record id {motion.id!r} {whose}")
            taken[motion.id] = path
            if select is None or motion.id in select:
                yield motion._replaced(metadata={**motion.metadata, **facts})
    if lost := [name for record, name in left_out.items() if record not in used]:
        text = f"has none of the components {', '.join(chosen)} that motions.processing chooses"
        raise RecordError(f"{lost[0]}: {text}")
    check_known(select or (), taken)


def _read(source: Source) -> list["Motion"]:
    from archfrag.motions.read import load_motion, read_motions

    if source.entry is not None:
        return [load_motion(source.entry)]
    return read_motions(source.path, name=source.name, **source.options)


def _with_components(
    study: Study, motion: "Motion", every: Sequence["Motion"], source: Source
) -> "Motion":
    """Give a motion the components that the study asks for, and no others."""
    from archfrag.motions.partners import other_horizontal, with_transverse, with_vertical
    from archfrag.motions.read import read_vertical

    others: dict[str, Motion | None] = {}
    if study.motions.vertical and motion.vertical is None:
        file = source.others.get("vertical")
        others["vertical"] = None if file is None else read_vertical(file, **source.options)
    if needs_pairs(study):
        other, file = other_horizontal(motion, every), source.others.get("transverse")
        if other is None and file is not None:
            found = _read(replace(source, path=file, entry=None, name=None))
            other = found[0] if len(found) == 1 else None
        others["other horizontal"] = other
    if motion.vertical is not None and not study.motions.vertical:
        labels = {**motion.metadata, "vertical_component": ""}
        log = (*motion.log, "Vertical component left out.")
        motion = motion._replaced(vertical=None, metadata=labels, log=log)
    for component, other in others.items():
        if other is None:
            raise RecordError(
                f"{source.path}: record {motion.id} has no {component} component, which the study "
                "needs. It must be in this file, in one whose name differs in the direction only "
                "(N and E; 090, 180 and UP), or in the one other row of an index with this event "
                "and station"
            )
        if source.entry is not None:  # an index states what the headers may spell differently
            labels = {**other.metadata, **dict.fromkeys(("event", "date", "station"), "")}
            other = other._replaced(metadata=labels)
        if component == "vertical":
            motion = with_vertical(motion, other)
        else:
            motion = with_transverse(motion, other)
            motion = motion._replaced(metadata={**motion.metadata, "id_transverse": other.id})
    return motion


def _processed(study: Study, motion: "Motion", source: Source) -> "Motion":
    for number, step in enumerate(study.motions.processing):
        try:
            motion = apply_step(step, motion, source.path, source.options.get("inventory"))
        except InputError as error:
            key = f"motions.processing[{number}] ({step.name})"
            raise RecordError(f"{source.path}: {key}: {error}") from None
        if step.name == "rotate":
            one, other = motion.id, str(motion.metadata.get("id_transverse", ""))
            common = os.path.commonprefix([one, other]).rstrip(" -+_.:")  # noqa: RUF071
            motion = motion._replaced(id=common or f"{one}+{other}")
    return motion
