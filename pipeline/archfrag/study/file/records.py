"""The records of a study: found by index or pattern, read, processed, measured and stored."""

import fnmatch
import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import InputError, RecordError
from archfrag.files import make_folder, sha256_of
from archfrag.motions import index, partners
from archfrag.motions.calibrate import check_file
from archfrag.motions.cautions import sample_cautions
from archfrag.motions.earthquakes import earthquakes, recording_of
from archfrag.motions.measures import measure, scale_factor
from archfrag.motions.partners import VERTICAL, folder_names
from archfrag.motions.process import REVERSED, both_senses
from archfrag.study.file.motions import Motions, apply_step
from archfrag.study.file.schema import Study
from archfrag.study.keys import at, meant
from archfrag.study.provenance import (
    Inputs,
    canonical_json,
    read_json,
    sha256_if_there,
    write_text,
)
from archfrag.study.yaml_text import relative

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

MANIFEST, FOLDER = "motions.json", "motions"
# Measures in which every run is known: the study's own is compared with them.
COMPARED = (
    "PGA", "PGV", "PGD", "Arias", "CAV", "HI", "Sa(0.1)", "Sa(0.2)", "Sa(0.3)", "Sa(0.5)",
    "Sa(0.7)", "Sa(1)", "Sa(1.5)", "Sa(2)", "Sa(3)", "AvgSA(0.2,2)",
)  # fmt: skip
_AGAIN = "run `archfrag motions` on the study file"


@dataclass
class Source:
    """A record file, and how to read it."""

    path: Path
    options: dict[str, Any]  # unit, inventory, accept and columns, as of `archfrag.read_motion`
    entry: index.IndexEntry | None = None  # row of the study's index
    name: str | None = None  # what ids begin with, where the file's own name is not enough
    # Files of the components that the study asks for, unless they are in the record's own.
    others: dict[str, Path] = field(default_factory=dict)


VERTICAL_LEFT = "Vertical component left out."


@dataclass(frozen=True)
class PreparedRecord:
    """One stored motion with its facts for results."""

    id: str
    file: str  # of the stored motion, in the study's folder of work
    source: str  # name of the record file
    sha256: str  # of the record file
    prepared: str  # SHA-256 of the stored motion
    dt: float  # [s]
    duration: float  # [s]
    magnitude: float | None
    distance: float | None  # [km]
    factor: float  # that brings the study's measure to 1 in its SI unit
    measures: dict[str, float] = field(hash=False)  # of the motion as it is, in SI units
    event: str = ""  # name of the earthquake, if it is known
    accepted: str = ""  # what is implausible and was accepted by a key of the study
    vertical: bool = False  # whether the motion has its vertical component
    # What is suspicious about its samples, its sensor or its file.
    cautions: list[str] = field(default_factory=list, hash=False)
    samples: str = ""  # SHA-256 of what moves an arch: the step in time and the samples


def find_sources(asked: Motions, measure: str) -> list[Source]:
    """Find the record files that a study with this measure asks for.

    InputError or RecordError for a file or id that is missing, or is there with two settings.
    """
    rows = [] if asked.index is None else index.load_index(asked.index)
    select = None if asked.files else asked.select  # of files the ids are known when read
    check_known(select or (), [row.id for row in rows])
    given: dict[Path, Source] = {}
    for number, entry in enumerate(asked.files):
        options = entry.model_dump(exclude={"path"})
        with at(f"motions.files[{number}]"):
            if entry.columns is not None:
                from archfrag.motions.formats.columns import parse_columns

                options["columns"] = parse_columns(entry.columns)
            for path in _matching(entry.path):
                # Two patterns may match the same file.
                if given.setdefault(path, source := Source(path, options)) != source:
                    other = "another unit, inventory, columns or accept"
                    raise InputError(f"an entry before it matches {path} with {other}")
    every = [Source(row.path, {"unit": row.unit or None, "accept": row.accept}, row)
             for row in rows if select is None or row.id in select]  # fmt: skip
    every += given.values()
    for source in every:
        check_file(source.path)
        if inventory := source.options.get("inventory"):
            check_file(Path(inventory))
    # Without those that hold only the vertical component of another one's record.
    verticals = partners.vertical_files(sorted({source.path for source in every}))
    sites = {_site(source.entry) for source in every if not _is_vertical(source.entry)} - {None}
    found = [source for source in every if source.path not in verticals
             and not (_is_vertical(source.entry) and _site(source.entry) in sites)]  # fmt: skip
    _name([source for source in found if source.entry is None])
    _add_others(found, _components(asked, measure), rows)
    return found


def input_paths(study: Study) -> dict[str, list[Path]]:
    """Files that the motions of a study follow from, by kind, and those that would count too."""
    sources = find_sources(study.motions, study.intensity.measure)
    given = study.motions.index
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
    return {"record": records, "index": indices, "inventory": inventories}


def study_inputs(study: Study) -> Inputs:
    """All files that the motions of a study follow from, with their digests.

    Paths are relative to the folder of the results, so that a study may be moved with them.
    """
    return {
        kind: {os.path.relpath(path, study.folder): digest for path in paths
               if (digest := sha256_if_there(path)) is not None}
        for kind, paths in input_paths(study).items()
    }  # fmt: skip


def check_known(selected: Iterable[str], known: Iterable[str]) -> None:
    """Check that all selected records exist; `InputError` names the first that does not."""
    names = list(known)
    for name in selected:
        if name not in names:
            hint = meant(name, names) or f"the study has {', '.join(names)}"
            raise InputError(f"motions.select: {name!r} is not a record of the study; {hint}")


def _matching(text: str) -> list[Path]:
    """The file of a path, or those of a pattern: in folders as written, with names in any case."""
    pattern = Path(text)
    if not glob.has_magic(text) or pattern.is_file():
        return [pattern]
    place, name = str(pattern.parent), re.compile(fnmatch.translate(pattern.name), re.I)
    folders = [place] if os.path.isdir(place) else glob.glob(place, recursive=True)
    every = [Path(folder, each) for folder in folders for each in folder_names(Path(folder))]
    paths = sorted(p for p in every if name.match(p.name) and not index.goes_with_records(p))
    if not paths:
        raise InputError(f"no file matches {text}")
    return paths


def _name(sources: Sequence[Source]) -> None:
    """Give sources whose ids would be equal the names of their folders too, but common ones."""
    stems, alike = Counter(source.path.stem for source in sources), dict[str, list[Source]]()
    for source in sources:
        if stems[source.path.stem] > 1 and index.find_entry(source.path) is None:
            from archfrag.motions.read import record_name  # imports obspy

            alike.setdefault(record_name(source.path), []).append(source)
    for name, own in alike.items():
        parents = [source.path.parent for source in own]
        common = os.path.commonpath(parents)
        for source, parent in zip(own, parents) if own[1:] else ():
            last = source.path.name if parents.count(parent) > 1 else name
            source.name = "+".join((*parent.relative_to(common).parts, last))


def _components(asked: Motions, measure: str) -> dict[str, bool]:
    """Whether motions need a vertical, and both horizontal components at once."""
    pairs = any(name == "rotate" for name, _ in asked.steps)
    pairs = pairs or measure.strip().startswith("RotD")
    return {"vertical": asked.vertical, "transverse": pairs}


def _add_others(
    sources: Sequence[Source], needed: dict[str, bool], rows: Sequence[index.IndexEntry]
) -> None:
    """Find the files of the other components that are asked for.

    A row of the index with the same event and station comes before a file of nearly the same name.
    """
    asked = [kind for kind, is_needed in needed.items() if is_needed]
    places = {source.path.parent for source in sources} if asked else ()
    by_name = {place: partners.partners(folder_names(place)) for place in places}
    for source in sources if asked else ():
        site = _site(source.entry)
        alike = [row for row in rows if site and _site(row) == site and row is not source.entry]
        for kind in asked:
            vertical = kind == "vertical"
            paths = [row.path for row in alike if _is_vertical(row) == vertical]
            named = by_name[source.path.parent][vertical].get(source.path.name)
            if len(paths) != 1 and named:
                paths = [source.path.with_name(named)]
            if len(paths) == 1:
                source.others[kind] = paths[0]


def _is_vertical(row: index.IndexEntry | None) -> bool:
    return row is not None and bool(VERTICAL.fullmatch(str(row.metadata.get("component") or "")))


def _site(row: index.IndexEntry | None) -> tuple[Any, Any] | None:
    """Event and station of a row of an index, if both are known."""
    found = (row.metadata.get("event"), row.metadata.get("station")) if row else (None, None)
    return found if all(found) else None


def read_sources(asked: Motions, measure: str) -> Iterator["Motion"]:
    """Read the motions that a study asks for one after the other, processed as it states."""
    from archfrag.motions.formats import one_reader
    from archfrag.motions.read import load_motion, read_horizontals

    select, steps, needed = asked.select, asked.steps, _components(asked, measure)
    chosen = dict(steps).get("choose", {}).get("components", ())
    taken: dict[str, Path] = {}
    left_out: dict[Any, str] = {}  # records by their facts, with a component not chosen
    used, turned, known = set[Any](), set[Any](), list[str]()
    pairs: dict[Path, dict[str, str]] = {}
    with one_reader():
        for source in find_sources(asked, measure):
            path, entry, options = source.path, source.entry, source.options
            if entry is None:
                every = read_horizontals(path, name=source.name, **options)
            else:
                every = [load_motion(entry)]
            facts = {"file": path.name, "file_sha256": sha256_of(path)}
            pairs.setdefault(path.parent, partners.partners(folder_names(path.parent))[0])
            for motion in every:
                about, code = motion.metadata, str(motion.metadata.get("component", ""))
                shared = tuple(str(about.get(k) or "") for k in ("event", "station", "start_time"))
                record = shared if any(shared) else path
                if chosen and not {code.upper(), code[-1:].upper()} & {c.upper() for c in chosen}:
                    left_out.setdefault(record, f"{path}: record {motion.id} ({code})")
                    continue
                used.add(record)
                other = pairs[path.parent].get(path.name)
                if other and not partners.numbered(path.name, other):
                    first = sha256_of(path.with_name(min(path.name, other)))
                    facts["pair"] = f"{first[:16]} {motion.acceleration.size} {motion.dt:g}"
                if (path, code) in turned:  # the other component of a motion that was rotated
                    continue
                motion = _with_components(needed, motion, every, source)
                if "rotate" in dict(steps):
                    same = motion.metadata.get("file_transverse", "") == path.name
                    file = path if same else source.others.get("transverse")
                    turned.add((file, motion.metadata.get("component_transverse", "")))
                for number, (name, settings) in enumerate(steps):
                    with at(f"{path}: motions.processing[{number}] ({name})", kind=RecordError):
                        motion = apply_step(name, settings, motion, path, options.get("inventory"))
                    if name == "rotate":
                        one, other = motion.id, str(motion.metadata.get("id_transverse", ""))
                        common = os.path.commonprefix([one, other]).rstrip(" -+_.:")  # noqa: RUF071
                        motion = motion._replaced(id=common or f"{one}+{other}")
                known.append(motion.id)
                for each in both_senses(motion) if asked.both_senses else [motion]:
                    if each.id in taken:
                        whose = f"already belongs to {taken[each.id]}; each record needs its own"
                        raise RecordError(f"{path}: the record id {each.id!r} {whose}")
                    taken[each.id] = path
                    if select is None or motion.id in select:
                        yield each._replaced(metadata={**each.metadata, **facts})
    if lost := [name for record, name in left_out.items() if record not in used]:
        text = f"has none of the components {', '.join(chosen)} that motions.processing chooses"
        raise RecordError(f"{lost[0]}: {text}")
    check_known(select or (), known)
    if not known:
        raise InputError("motions: the study has no record; give an index or files")


def _with_components(
    asked: dict[str, bool], motion: "Motion", every: Sequence["Motion"], source: Source
) -> "Motion":
    """Give a motion the components that are asked for, and no others."""
    from archfrag.motions.read import read_horizontals, read_vertical

    own = motion
    if own.vertical is not None and not asked["vertical"]:
        labels = {**own.metadata, "vertical_component": ""}
        log = (*own.log, VERTICAL_LEFT)
        motion = own._replaced(vertical=None, metadata=labels, log=log)
    for kind, needed in asked.items():
        if not needed or (kind == "vertical" and own.vertical is not None):
            continue
        file, also = source.others.get(kind), ""
        other = None if kind == "vertical" else partners.other_horizontal(own, every)
        if other is None and file is not None:
            if kind == "vertical":
                other = read_vertical(file, **source.options)
            else:
                found = read_horizontals(file, **source.options)
                other = found[0] if len(found) == 1 else None
                if other and source.entry is None and not partners.belong_together(own, other):
                    other, alike = None, f"{file.name} has nearly the same name, but neither"
                    also = f"{alike} start, event and station nor length show that it belongs. "
        if other is None:
            component, how = "other horizontal", "leave this record out"
            if kind == "vertical":
                component, how = kind, f"{how}, or set motions.vertical: false for all records"
            raise RecordError(
                f"{source.path}: record {own.id} has no {component} component, which the study "
                f"needs. {also}It must be in this file, in one whose name differs in the "
                "direction only (N and E; 090, 180 and UP), or in the one other row of an index "
                f"with this event and station. Without such a file, {how}"
            )
        if source.entry is not None:  # an index states what the headers may spell differently
            labels = {**other.metadata, **dict.fromkeys(("event", "date", "station"), "")}
            other = other._replaced(metadata=labels)
        motion = partners.joined(motion, other, kind)
    return motion


def described(
    study: Study, motion: "Motion", compared: Sequence[str] = COMPARED
) -> PreparedRecord:
    """Facts of a motion that is not stored yet; InputError if it cannot be scaled.

    Its `measures` are that of the study and those that are `compared` with it.
    """
    own, about = study.intensity.measure, motion.metadata
    measures = {name: measure(motion, name) for name in dict.fromkeys((own, *compared))}
    samples = hashlib.sha256(float(motion.dt).hex().encode())
    for part in (motion.acceleration, motion.vertical):
        samples.update(b"/" if part is None else np.ascontiguousarray(part, "<f8").data)
    cautions = [*about.get("cautions", ()), *sample_cautions(motion.acceleration, motion.dt)]
    if motion.vertical is not None:
        found = sample_cautions(motion.vertical, motion.dt)
        cautions += [f"vertical: {text}" for text in found]
    return PreparedRecord(
        motion.id, "", about["file"], about["file_sha256"], "", motion.dt, motion.duration,
        about.get("Mw") or about.get("magnitude"), about.get("distance_km"),
        scale_factor(motion, own, 1.0, measures[own]), measures,
        event=str(about.get("event") or about.get("event_id") or ""),
        accepted=str(about.get("accepted") or ""), vertical=motion.vertical is not None,
        cautions=cautions, samples=samples.hexdigest(),
    )  # fmt: skip


def prepare_motions(study: Study) -> list[PreparedRecord]:
    """Store the motions of a study, one file each, with a manifest.

    New motions count when the manifest is written, which is last; until then the old ones do.
    """
    from archfrag.motions.motion import save_motions

    inputs, records, facts = study_inputs(study), list[PreparedRecord](), list[dict[str, Any]]()
    folder = make_folder(study.work / FOLDER)
    for motion in read_sources(study.motions, study.intensity.measure):
        record = described(study, motion)
        save_motions(folder / "new.npz", [motion])
        prepared = sha256_of(folder / "new.npz")
        records.append(replace(record, file=f"{FOLDER}/{prepared[:16]}.npz", prepared=prepared))
        facts.append(recording_of(motion))
        os.replace(folder / "new.npz", study.work / records[-1].file)
    records = [replace(record, event=name) for record, name in zip(records, earthquakes(facts))]
    if (select := study.motions.select) is not None:
        ends = ["", REVERSED][: 1 + study.motions.both_senses]
        order = [name + end for name in select for end in ends]
        records.sort(key=lambda record: order.index(record.id))
    manifest = {"study": study.id, "key": motions_key(study), "inputs": inputs,
                "records": [asdict(record) for record in records]}  # fmt: skip
    write_text(study.work / MANIFEST, canonical_json(manifest) + "\n")
    for path in set(folder.glob("*.npz")) - {study.work / record.file for record in records}:
        path.unlink()
    return records


def read_manifest(study: Study) -> dict[str, Any]:
    """The manifest that `prepare_motions` wrote: key, inputs and `PreparedRecord`s."""
    path = study.work / MANIFEST
    try:
        found = read_json(path)
        records = [PreparedRecord(**record) for record in found["records"]]
        return {"key": found["key"], "inputs": dict(found["inputs"]), "records": records}
    except FileNotFoundError:
        raise InputError(f"{path}: the motions are not prepared yet; {_AGAIN}") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); {_AGAIN}") from None


def load_prepared(study: Study) -> list[PreparedRecord]:
    """Records that `prepare_motions` stored; InputError if they are not the study's or damaged."""
    manifest = read_manifest(study)
    if manifest["key"] != motions_key(study):
        other = "other records or another measure than the study now has"
        raise InputError(f"{study.work / MANIFEST}: was made for {other}; {_AGAIN}")
    for record in manifest["records"]:
        _check_stored(study.work, record)
    return list(manifest["records"])


def load_record(work: Path, record: PreparedRecord) -> "Motion":
    """The motion of a record, stored in a study's folder of work."""
    from archfrag.motions.motion import load_motions

    return load_motions(_check_stored(work, record))[0]


def _check_stored(work: Path, record: PreparedRecord) -> Path:
    path = work / record.file
    if sha256_if_there(path) != record.prepared:
        what = f"the motion prepared of record {record.id!r} is missing, changed or damaged"
        raise InputError(f"{path}: {what}; {_AGAIN}")
    return path


def motions_key(study: Study) -> dict[str, Any]:
    """Settings of a study on its motions and its measure; paths are as in `study_inputs`."""
    motions = relative(study.motions.model_dump(mode="json"), study.folder)
    return {"motions": motions, "measure": study.intensity.measure}
