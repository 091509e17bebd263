"""The motions that a study asks for: find → read → choose → pair → process → name."""

import fnmatch
import glob
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from archfrag.errors import InputError, RecordError
from archfrag.files import sha256_of
from archfrag.motions import index, partners, read
from archfrag.motions.channel import VERTICAL
from archfrag.motions.formats import one_reader
from archfrag.motions.formats.columns import parse_columns
from archfrag.motions.motion import Motion, with_component
from archfrag.motions.partners import folder_names
from archfrag.motions.process import both_senses
from archfrag.study.file.motions import Motions, apply_step
from archfrag.study.file.schema import StudyKeys
from archfrag.study.keys import at, meant

VERTICAL_LEFT = "Vertical component left out."


@dataclass
class RecordFile:
    """A record file, and how to read it."""

    path: Path
    options: dict[
        str, Any
    ]  # unit, inventory, accept and columns, as of `archfrag.read_motion`
    entry: index.IndexEntry | None = None  # row of the study's index
    name: str | None = (
        None  # what ids begin with, where the file's own name is not enough
    )
    # Files of the components that the study needs, unless they are in the record's own.
    others: dict[str, Path] = field(default_factory=dict)

    @property
    def is_vertical(self) -> bool:
        """Tell whether the index lists a vertical component."""
        code = self.entry.metadata.get("component") if self.entry else ""
        return bool(VERTICAL.fullmatch(str(code or "")))

    @property
    def site(self) -> tuple[Any, ...] | None:
        """Return event and station by the index; None if either is unknown."""
        about = self.entry.metadata if self.entry else {}
        site = (about.get("event"), about.get("station"))
        return site if all(site) else None


def find_sources(asked: Motions, measure: str) -> list[RecordFile]:
    """Find the record files that a study with this measure needs, and those of their components.

    InputError or RecordError for a file or id that is missing, or is there with two settings.
    """
    rows = [] if asked.index is None else index.load_index(asked.index)
    # Files of other components have columns of their own.
    listed = [
        RecordFile(row.path, row.options | {"columns": None}, row) for row in rows
    ]
    sources = listed
    # Of files the ids are known when they are read.
    if asked.select and not asked.files:
        check_known(asked.select, [row.id for row in rows])
        sources = [file for file, row in zip(listed, rows) if row.id in asked.select]
    by_path = dict[Path, RecordFile]()
    for number, entry in enumerate(asked.files):
        options = entry.model_dump(exclude={"path"})
        with at(f"motions.files[{number}]"):
            if entry.columns is not None:
                options["columns"] = parse_columns(entry.columns)
            for path in _matching(entry.path):
                file = RecordFile(path, options)
                # Two patterns may match the same file.
                if by_path.setdefault(path, file) != file:
                    differ = "another unit, inventory, columns or accept"
                    raise InputError(f"an earlier entry matches {path} with {differ}")
    sources = [*sources, *by_path.values()]
    for file in sources:
        for needed in filter(None, (file.path, file.options.get("inventory"))):
            read.check_file(Path(needed))
    # Without those that hold only the vertical component of another one's record.
    verticals = partners.vertical_files(sorted({file.path for file in sources}))
    sites = {file.site for file in sources if not file.is_vertical} - {None}
    sources = [
        file
        for file in sources
        if file.path not in verticals and not (file.is_vertical and file.site in sites)
    ]
    _distinguish([file for file in sources if file.entry is None])
    _find_components(sources, _needed(asked, measure), listed)
    return sources


def input_paths(study: StudyKeys) -> dict[str, list[Path]]:
    """Return the files, by kind, that the motions follow from, or would if they appeared."""
    asked = [each for each in (study.motions, study.motions.first) if each is not None]
    sources = [s for each in asked for s in find_sources(each, study.intensity.measure)]
    records = [s.path for s in sources]
    records += [path for s in sources for path in s.others.values()]
    lists = (each.index for each in asked if each.index is not None)
    indices = [Path(path, index.INDEX_NAME * os.path.isdir(path)) for path in lists]
    names = {name for path in records for name in (path.stem, path.name)}
    given = (s.options.get("inventory") for s in sources)
    inventories = [Path(path) for path in given if path is not None]
    for folder in dict.fromkeys(path.parent for path in records):
        indices += (place / index.INDEX_NAME for place in (folder, folder.parent))
        # NAME.xml, or NET.STA.xml with codes that only the record's content gives.
        tables = sorted(folder.glob("*.xml"))
        inventories += [p for p in tables if p.stem in names or p.stem.count(".") == 1]
    return {"record": records, "index": indices, "inventory": inventories}


def check_known(
    selected: Iterable[str], ids: Sequence[str], key: str = "motions.select"
) -> None:
    """Raise InputError for the first selected record that does not exist."""
    for name in selected:
        if name not in ids:
            hint = meant(name, ids) or f"the study has {', '.join(ids)}"
            raise InputError(f"{key}: {name!r} is not a record of the study; {hint}")


def following(
    asked: Motions, records: list[Any], make: Callable[[Motions], list[Any]]
) -> list[Any]:
    """Return records with what comes first before each: one of them, or of what `make` makes of
    an index; as they are without first shocks.

    Before a record that is reversed comes the reversed one of what comes before the record.
    """
    if asked.before is None:
        return records
    known = {each.id: each for each in (make(asked.first) if asked.first else records)}
    senses = 1 + asked.both_senses  # each beside its reverse, as `_name` yields them
    names = asked.before.records or [*known][::senses]
    check_known(names, [*known], "motions.before.records")
    places = [[*known].index(name) for name in names]
    found = []
    for number, record in enumerate(records):
        turn, sense = divmod(number, senses)
        first = [*known.values()][places[turn % len(places)] ^ sense]
        found.append(replace(record, first=first))
    return found


def _matching(text: str) -> list[Path]:
    """Return the file of a path, or those of a pattern, whose name may be in any case."""
    pattern = Path(text)
    if not glob.has_magic(text) or pattern.is_file():
        return [pattern]
    place = str(pattern.parent)
    name = re.compile(fnmatch.translate(pattern.name), re.I)
    folders = [place] if os.path.isdir(place) else glob.glob(place, recursive=True)
    paths = sorted(
        Path(folder, file)
        for folder in folders
        for file in folder_names(Path(folder))
        if name.match(file) and not index.goes_with_records(Path(file))
    )
    if not paths:
        raise InputError(f"no file matches {text}")
    return paths


def _distinguish(files: Sequence[RecordFile]) -> None:
    """Give files whose ids would be equal the names of their folders, but for common ones."""
    stems = Counter(file.path.stem for file in files)
    alike = dict[str, list[RecordFile]]()
    for file in files:
        if stems[file.path.stem] > 1 and not index.find_entry(file.path).id:
            alike.setdefault(read.record_name(file.path), []).append(file)
    for name, group in alike.items():
        parents = [file.path.parent for file in group]
        common = os.path.commonpath(parents)
        for file, parent in zip(group, parents) if group[1:] else ():
            last = file.path.name if parents.count(parent) > 1 else name
            file.name = "+".join((*parent.relative_to(common).parts, last))


def _needed(asked: Motions, measure: str) -> dict[str, bool]:
    """Tell whether motions need a vertical, and both horizontal components at once."""
    pairs = "rotate" in dict(asked.steps) or measure.strip().startswith("RotD")
    return {"vertical": asked.vertical, "transverse": pairs}


def _find_components(
    files: Sequence[RecordFile], needed: dict[str, bool], listed: Sequence[RecordFile]
) -> None:
    """Find the files of the other components that are needed.

    A row of the index with the same event and station comes before a file of nearly the same name.
    """
    kinds = [kind for kind, is_needed in needed.items() if is_needed]
    folders = {file.path.parent for file in files} if kinds else ()
    by_name = {folder: partners.partners(folder_names(folder)) for folder in folders}
    for file, kind in ((file, kind) for file in files for kind in kinds):
        vertical = kind == "vertical"
        paths = [
            row.path
            for row in listed
            if file.site
            and row.site == file.site
            and row.entry is not file.entry
            and row.is_vertical == vertical
        ]
        name = by_name[file.path.parent][vertical].get(file.path.name)
        if len(paths) != 1 and name:
            paths = [file.path.with_name(name)]
        if len(paths) == 1:
            file.others[kind] = paths[0]


_Read = tuple[RecordFile, Motion, list[Motion]]  # a file, one of its motions, all
_Paired = tuple[RecordFile, Motion, str]  # and how it is called if it is rotated


def read_sources(asked: Motions, measure: str) -> Iterator[Motion]:
    """Read the motions that a study asks for one after the other, processed as it states."""
    steps = asked.steps
    needed = _needed(asked, measure)
    chosen = dict(steps).get("choose", {}).get("components", ())
    with one_reader():
        recordings = _choose(_read(find_sources(asked, measure)), chosen)
        paired = _pair(recordings, needed, "rotate" in dict(steps))
        yield from _name(_process(paired, steps), asked)


def _read(files: Iterable[RecordFile]) -> Iterator[_Read]:
    """Read the horizontal components of files, with what tells the records of one earthquake."""
    pairs: dict[Path, dict[str, str]] = {}
    for file in files:
        path = file.path
        if file.entry is None:
            motions = read.read_horizontals(path, name=file.name, **file.options)
        else:
            motions = [read.load_motion(file.entry)]
        if path.parent not in pairs:
            pairs[path.parent] = partners.partners(folder_names(path.parent))[0]
        other = pairs[path.parent].get(path.name)
        digest = sha256_of(path)
        pair = ""
        for place, motion in enumerate(motions):
            if other and not partners.numbered(path.name, other):
                first = sha256_of(path.with_name(min(path.name, other)))[:16]
                pair = f"{first} {motion.acceleration.size} {motion.dt:g}"
            motions[place] = motion.stating(file_sha256=digest, pair=pair)
        yield from ((file, motion, motions) for motion in motions)


def _choose(recordings: Iterable[_Read], components: Sequence[str]) -> Iterator[_Read]:
    """Keep the chosen components (all if none is named); RecordError for a record without one."""
    letters = {code.upper() for code in components}
    left_out = dict[Any, str]()
    used = set[Any]()
    for file, motion, motions in recordings:
        facts = motion.facts
        code = facts.component
        record = facts.event, facts.station, facts.start_time
        if not any(record):
            record = (str(file.path), "", "")
        if letters and not {code.upper(), code[-1:].upper()} & letters:
            left_out.setdefault(record, f"{file.path}: record {motion.id} ({code})")
            continue
        used.add(record)
        yield file, motion, motions
    for lost in (name for record, name in left_out.items() if record not in used):
        raise RecordError(
            f"{lost}: has none of the components {', '.join(components)} that "
            "motions.processing chooses"
        )


def _pair(
    recordings: Iterable[_Read], needed: dict[str, bool], rotates: bool
) -> Iterator[_Paired]:
    """Give motions the components that are needed, and no others.

    Where they are rotated, both horizontal components of a record give one motion.
    """
    turned = set[Any]()
    kinds = [kind for kind, is_needed in needed.items() if is_needed]
    for file, motion, motions in recordings:
        if (file.path, motion.facts.component) in turned:
            continue
        paired = motion
        ids = [motion.id, ""]
        if motion.vertical is not None and not needed["vertical"]:
            log = (*motion.log, VERTICAL_LEFT)
            paired = replace(motion.stating(of_vertical=None), vertical=None, log=log)
        for kind in kinds:
            if kind == "transverse" or motion.vertical is None:
                other = _component(kind, file, motion, motions)
                if file.entry is not None:  # whose spelling headers need not have
                    other = other.stating(event="", date="", station="")
                paired = with_component(paired, other, kind)
                ids[1] = other.id  # of the transverse, which comes last
        part = paired.facts.of_transverse
        if rotates and part:
            same = part.file == file.path.name
            other_file = file.path if same else file.others.get("transverse")
            turned.add((other_file, part.component))
        # What is rotated is named after both horizontal components.
        common = os.path.commonprefix(ids).rstrip(" -+_.:")  # noqa: RUF071
        yield file, paired, common or "+".join(ids)


def _component(
    kind: str, file: RecordFile, motion: Motion, motions: Sequence[Motion]
) -> Motion:
    """Return the "vertical" or "transverse" of a motion; RecordError if there is none."""
    path = file.others.get(kind)
    clue = ""
    vertical = kind == "vertical"
    other = None if vertical else partners.other_horizontal(motion, motions)
    if other is None and path is not None:
        if vertical:
            return read.read_vertical(path, **file.options)
        candidates = read.read_horizontals(path, **file.options)
        other = candidates[0] if len(candidates) == 1 else None
        if other and file.entry is None and not partners.belong_together(motion, other):
            other = None
            clue = (
                f"{path.name} has nearly the same name, but neither start, event and station nor "
                "length show that it belongs. "
            )
    if other is None:
        remedy = "leave this record out"
        remedy += ", or set motions.vertical: false for all records" * vertical
        component = "vertical" if vertical else "other horizontal"
        raise RecordError(
            f"{file.path}: record {motion.id} has no {component} component, which the study "
            f"needs. {clue}It must be in this file, in one whose name differs in the "
            "direction only (N and E; 090, 180 and UP), or in the one other row of an index "
            f"with this event and station. Without such a file, {remedy}"
        )
    return other


def _process(
    paired: Iterable[_Paired], steps: Sequence[tuple[str, dict[str, Any]]]
) -> Iterator[tuple[RecordFile, Motion]]:
    """Apply the steps of processing."""
    for file, motion, common in paired:
        for number, (name, settings) in enumerate(steps):
            place = f"{file.path}: motions.processing[{number}] ({name})"
            with at(place, kind=RecordError):
                inventory = file.options.get("inventory")
                motion = apply_step(name, settings, motion, file.path, inventory)
            if name == "rotate":
                motion = replace(motion, id=common)
        yield file, motion


def _name(
    processed: Iterable[tuple[RecordFile, Motion]], asked: Motions
) -> Iterator[Motion]:
    """Yield the selected motions, in both senses if asked; InputError if ids are not clear."""
    taken = dict[str, Path]()
    ids = list[str]()
    before = list[dict[str, Any]]()
    for file, motion in processed:
        ids.append(motion.id)
        selected = asked.select is None or motion.id in asked.select
        if selected:
            facts = partners.identity_of(motion)
            twin = next((one for one in before if partners.are_one(one, facts)), None)
            before.append(facts)
            if twin is not None:
                text = (
                    f"it is record {twin['id']} a second time (a copy, or another version), "
                    "and both count; leave one out"
                )
                motion = motion.stating(cautions=[*motion.facts.cautions, text])
        for sense in both_senses(motion) if asked.both_senses else [motion]:
            if sense.id in taken:
                raise RecordError(
                    f"{file.path}: the record id {sense.id!r} already belongs to "
                    f"{taken[sense.id]}; each record needs its own"
                )
            taken[sense.id] = file.path
            if selected:
                yield sense
    check_known(asked.select or (), ids)
    if not ids:
        raise InputError("motions: the study has no record; give an index or files")
