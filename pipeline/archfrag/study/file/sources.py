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
from archfrag.files import Named, portable, sha256_of
from archfrag.motions import index, partners, read
from archfrag.motions.channel import VERTICAL
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
        None  # how ids of its motions begin, if the name of the file is not unique
    )
    # Files of the components that the study needs, unless they are in the record's own.
    others: dict[str, Path] = field(default_factory=dict)
    twin: str | None = None  # name of the file of the other horizontal component

    @property
    def is_vertical(self) -> bool:
        """Whether the index lists this file as a vertical component."""
        code = self.entry.metadata.get("component") if self.entry else ""
        return bool(VERTICAL.fullmatch(str(code or "")))

    @property
    def site(self) -> tuple[Any, ...] | None:
        """Event and station of the record by the index; None if either is unknown."""
        about = self.entry.metadata if self.entry else {}
        site = (about.get("event"), about.get("station"))
        return site if all(site) else None


def find_sources(asked: Motions, measure: str) -> list[RecordFile]:
    """Find the record files that a study needs, with the files of their other components.

    `asked` and `measure` are the motions and the intensity measure of the study. InputError or
    RecordError if a file or id is missing, or if two entries give one file different settings.
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
                    raise InputError(
                        f"an earlier entry matches {path} with another unit, inventory, columns "
                        "or accept"
                    )
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
    """Return the files that the motions of a study depend on, by kind: record, index, inventory.

    An index that does not exist is included where it would be used if it appeared.
    """
    records = list[Path]()
    indices = list[Path]()
    inventories = list[Path]()
    for asked in filter(None, (study.motions, study.motions.first)):
        if asked.index:
            name = index.INDEX_NAME * os.path.isdir(asked.index)
            indices.append(Path(asked.index, name))
        for source in find_sources(asked, study.intensity.measure):
            records += (source.path, *source.others.values())
            if source.options.get("inventory"):
                inventories.append(Path(source.options["inventory"]))
    names = {name for path in records for name in (path.stem, path.name)}
    for folder in dict.fromkeys(path.parent for path in records):
        indices += (place / index.INDEX_NAME for place in (folder, folder.parent))
        # NAME.xml, or NET.STA.xml with codes that only the record's content gives.
        tables = sorted(folder.glob("*.xml"))
        inventories += [p for p in tables if p.stem in names or p.stem.count(".") == 1]
    return {"record": records, "index": indices, "inventory": inventories}


def check_known(
    selected: Iterable[str], ids: Sequence[str], key: str = "motions.select"
) -> None:
    """Raise InputError for the first of the `selected` record ids that is not in `ids`.

    `key` is the key of the study that selects them.
    """
    for name in selected:
        if name not in ids:
            hint = meant(name, ids) or f"the study has {', '.join(ids)}"
            raise InputError(f"{key}: {name!r} is not a record of the study; {hint}")


def following(asked: Motions, make: Callable[[Motions], list[Any]]) -> list[Any]:
    """Return the records that `make` makes, each with its first shock if the study has them.

    `make` is called with the motions to read. First shocks are some of the records, or those of an
    index of their own; if they are fewer than the records, they begin again. A reversed record has
    the first shock of the record itself, in the opposite sense.
    """
    records = make(asked)
    if asked.before is None:
        return records
    firsts = make(asked.first) if asked.first else records
    ids = [each.id for each in firsts]
    senses = 1 + asked.both_senses  # each beside its reverse, as `_name` yields them
    names = asked.before.records or ids[::senses]
    check_known(names, ids, "motions.before.records")
    found = []
    for number, record in enumerate(records):
        turn, sense = divmod(number, senses)
        found.append(
            replace(record, first=firsts[(ids.index(names[turn % len(names)]) ^ sense)])
        )
    return found


def _matching(text: str) -> list[Path]:
    """Return the file at a path, or the files that match a pattern.

    Upper and lower case of the file's name do not matter in a pattern. InputError if no file
    matches it.
    """
    pattern = Path(text)
    if not glob.has_magic(text) or pattern.is_file():
        return [pattern]
    place = portable(str(pattern.parent))
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
    """Set different names for files whose ids would be equal.

    Such a name begins with the folders of the file, without those that all these files share.
    """
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
    """Return whether motions need a vertical component, and whether they need a transverse one.

    The transverse component is needed if motions are rotated, or if the measure is of both
    horizontal components.
    """
    pairs = "rotate" in dict(asked.steps) or measure.strip().startswith("RotD")
    return {"vertical": asked.vertical, "transverse": pairs}


def _find_components(
    files: Sequence[RecordFile], needed: dict[str, bool], listed: Sequence[RecordFile]
) -> None:
    """Set the files of the other components that each of `files` needs.

    A row of the index (`listed`) with the same event and station is preferred to a file of nearly
    the same name, if there is just one such row.
    """
    folders = {file.path.parent for file in files}
    by_name = {folder: partners.partners(folder_names(folder)) for folder in folders}
    for file in files:
        transverse, vertical = (
            own.get(file.path.name) for own in by_name[file.path.parent]
        )
        file.twin = transverse
        for kind, name in (("vertical", vertical), ("transverse", transverse)):
            if not needed[kind]:
                continue
            paths = [
                row.path
                for row in listed
                if file.site
                and row.site == file.site
                and row.entry is not file.entry
                and row.is_vertical == (kind == "vertical")
            ]
            if len(paths) != 1 and name:
                paths = [file.path.with_name(name)]
            if len(paths) == 1:
                file.others[kind] = paths[0]


_Paired = tuple[RecordFile, Motion, str]  # the id of the motion, if it is rotated


def read_sources(asked: Motions, measure: str) -> Iterator[Motion]:
    """Yield the motions that a study asks for, read and processed one after the other."""
    steps = dict(asked.steps)
    chosen = steps.get("choose", {}).get("components", ())
    recordings = _read(find_sources(asked, measure), chosen)
    yield from _name(
        _pair(recordings, _needed(asked, measure), "rotate" in steps), asked
    )


def _read(
    files: Iterable[RecordFile], components: Sequence[str]
) -> Iterator[tuple[RecordFile, Motion, list[Motion]]]:
    """Yield each chosen horizontal component: file, motion, and all motions of the file.

    `components` are codes of the components to choose; all are chosen if it is empty. Motions get
    the digests by which records of one earthquake are recognised. RecordError for a record that
    has none of the components.
    """
    letters = {code.upper() for code in components}
    left_out = dict[Any, str]()
    used = set[Any]()
    for file in files:
        path = file.path
        if file.entry is None:
            motions = read.read_horizontals(path, name=file.name, **file.options)
        else:
            motions = [read.load_motion(file.entry)]
        digest = sha256_of(path)
        pair = ""
        for place, motion in enumerate(motions):
            if file.twin and not partners.numbered(path.name, file.twin):
                first = sha256_of(path.with_name(min(path.name, file.twin)))[:16]
                pair = f"{first} {motion.acceleration.size} {motion.dt:g}"
            motions[place] = motion.stating(file_sha256=digest, pair=pair)
        for motion in motions:
            facts = motion.facts
            code = facts.component
            record = facts.event, facts.station, facts.start_time
            if not any(record):
                record = str(path), "", ""
            if letters and not {code.upper(), code[-1:].upper()} & letters:
                left_out.setdefault(record, f"{path}: record {motion.id} ({code})")
            else:
                used.add(record)
                yield file, motion, motions
    for lost in (left_out[each] for each in left_out if each not in used):
        raise RecordError(
            f"{lost}: has none of the components {', '.join(components)} that "
            "motions.processing chooses"
        )


def _pair(
    recordings: Iterable[tuple[RecordFile, Motion, list[Motion]]],
    needed: dict[str, bool],
    rotates: bool,
) -> Iterator[_Paired]:
    """Yield motions with the components that are needed, and without a vertical that is not.

    If motions are rotated (`rotates`), the two horizontal components of a record give one motion.
    """
    turned = set[Any]()
    for file, motion, motions in recordings:
        if (file.path, motion.facts.component) in turned:
            continue
        paired = motion
        ids = [motion.id, ""]
        if motion.vertical is not None and not needed["vertical"]:
            log = (*motion.log, VERTICAL_LEFT)
            paired = replace(motion.stating(of_vertical=None), vertical=None, log=log)
        for kind in filter(needed.get, needed):
            if kind == "transverse" or motion.vertical is None:
                other = _component(kind, file, motion, motions)
                if file.entry is not None:  # whose spelling headers need not have
                    other = other.stating(event="", date="", station="")
                paired = with_component(paired, other, kind)
                ids[1] = other.id  # of the transverse, which comes last
        part = paired.facts.of_transverse
        if rotates and part:
            other_file = (
                file.path
                if (part.file == file.path.name)
                else file.others.get("transverse")
            )
            turned.add((other_file, part.component))
        # What is rotated is named after both horizontal components.
        common = os.path.commonprefix(ids).rstrip(" -+_.:")  # noqa: RUF071
        yield file, paired, common or "+".join(ids)


def _component(
    kind: str, file: RecordFile, motion: Motion, motions: Sequence[Motion]
) -> Motion:
    """Return another component of a motion; `kind` is "vertical" or "transverse".

    `motions` are all horizontal motions of the file. RecordError if there is no such component.
    """
    path = file.others.get(kind)
    clue = ""
    if kind == "transverse":
        own = partners.other_horizontal(motion, motions)
        if own is not None:
            return own
        found = read.read_horizontals(path, **file.options) if path else []
        if len(found) == 1:
            if file.entry is not None or partners.belong_together(motion, found[0]):
                return found[0]
            clue = (
                f"{file.others[kind].name} has nearly the same name, but neither start, event and "
                "station nor length show that it belongs. "
            )
    elif path is not None:
        return read.read_vertical(path, **file.options)
    raise RecordError(
        f"{file.path}: record {motion.id} has no {kind} component, which the study needs. "
        f"{clue}It must be in this file, in one whose name differs in the direction only (N and "
        "E; 090, 180 and UP), or in the one other row of an index with this event and station. "
        "Without such a file, leave this record out, or ask for no such component: "
        "motions.vertical: false, no rotate and no RotD measure"
    )


def _processed(file: RecordFile, motion: Motion, common: str, asked: Motions) -> Motion:
    """Apply all steps of processing to a motion, and return it.

    If it is rotated, its id becomes `common`. RecordError names the step that fails.
    """
    for number, (name, settings) in enumerate(asked.steps):
        place = f"{file.path}: motions.processing[{number}] ({name})"
        with at(place, kind=RecordError):
            motion = apply_step(
                name, settings, motion, file.path, file.options.get("inventory")
            )
        if name == "rotate":
            motion = replace(motion, id=common)
    return motion


def _name(paired: Iterable[_Paired], asked: Motions) -> Iterator[Motion]:
    """Yield the selected motions, processed, and in both senses if the study asks for them.

    A motion that is there a second time gets a caution. RecordError if two motions have the same
    id; InputError if a selected id does not exist, or if there is no motion at all.
    """
    taken = dict[str, Path]()
    ids = list[str]()
    before = list[Named]()
    for file, recorded, common in paired:
        motion = _processed(file, recorded, common, asked)
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
