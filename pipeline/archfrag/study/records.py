"""The records of a study: found, read, measured and stored once for all workers."""

import difflib
import glob
import hashlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import InputError, RecordError, StudyError
from archfrag.files import opened, temporary_folder
from archfrag.motions.index import IndexEntry, find_entry, goes_with_records, load_index
from archfrag.motions.plausible import LARGEST_INVENTORY, record_size
from archfrag.study.components import Components, with_partners, without_verticals
from archfrag.study.config import FileSet, Study
from archfrag.study.files import (
    Inputs,
    cannot_write,
    canonical_json,
    digest_of,
    make_folder,
    read_inputs,
    read_json,
    sha256_if_there,
    sha256_of,
    write_text,
)
from archfrag.study.synthetic import made_motions, motion_of

if TYPE_CHECKING:
    from archfrag.motions.formats.columns import Columns
    from archfrag.motions.motion import Motion

MANIFEST = "motions.json"
# Measures in which every run is known: the study's own is compared with them.
COMPARED = (
    "PGA", "PGV", "PGD", "Arias", "CAV", "HI", "ASI", "Sa(0.1)", "Sa(0.2)", "Sa(0.3)", "Sa(0.5)",
    "Sa(0.7)", "Sa(1)", "Sa(1.5)", "Sa(2)", "Sa(3)", "AvgSA(0.2,2)",
)  # fmt: skip
SEEDS = ("seed", "event_seed", "site_seed")
_AGAIN = "`archfrag motions` on the study file makes it"


@dataclass(frozen=True)
class Source:
    """A record file, and how to read it: by its row of an index or by what the study gives."""

    path: Path
    unit: str | None = None
    inventory: str | None = None
    accept: tuple[str, ...] = ()
    columns: "Columns | None" = None
    name: str | None = None  # what ids begin with, where the file's own name is not enough
    entry: IndexEntry | None = None
    upward: Path | None = None  # file of the vertical component, if it is not in the record's own
    beside: Path | None = None  # file of the other horizontal component, if both are needed


@dataclass(frozen=True)
class PreparedRecord:
    """One stored motion and what results state of it."""

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
    measures: dict[str, float]  # of the motion as it is, in SI units
    event: str = ""  # name of the earthquake, if it is known
    accepted: str = ""  # what is implausible and was accepted by a key of the study
    vertical: bool = False  # whether the motion has its vertical component
    recipe: str = ""  # of a synthetic motion, which is made and not stored, as JSON
    seed: int | None = None  # of a synthetic motion
    event_seed: int | None = None
    site_seed: int | None = None
    raw: bool = False  # whether the file states that nothing was corrected
    samples: str = ""  # SHA-256 of what moves an arch: the step in time and the samples

    def __hash__(self) -> int:
        return hash((self.id, self.prepared))


def find_sources(study: Study) -> list[Source]:
    """Record files of a study in the order of its results."""
    sources, rows = [], []
    if study.motions.index is not None:
        entries = rows = load_index(study.motions.index)
        wanted = study.motions.select
        if wanted is not None and not study.motions.files and study.motions.synthetic is None:
            table = {entry.id: entry for entry in entries}
            for name in wanted:
                if name not in table:
                    raise _not_a_record(name, list(table))
            entries = [table[name] for name in wanted]
        sources = [Source(entry.path, entry=entry) for entry in entries]
    given: dict[Path, Source] = {}
    for number, entry in enumerate(study.motions.files):
        for source in _from_files(entry, f"motions.files[{number}]"):
            # Two patterns may match the same file.
            if given.setdefault(source.path, source) != source:
                other = (
                    "by an entry before it too, with another unit, inventory, columns or accept"
                )
                raise StudyError(f"motions.files[{number}]: {source.path} is matched {other}")
    for source in (*sources, *given.values()):
        record_size(source.path)
        _check_inventory(source)
    found = without_verticals(sources) + _with_names(without_verticals(list(given.values())))
    return with_partners(found, study, rows)


def _check_inventory(source: Source) -> None:
    """See that the StationXML named for a record is a file."""
    if source.inventory is None:
        return
    try:
        with opened(source.inventory, LARGEST_INVENTORY):
            pass
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
        raise RecordError(f"the StationXML file {source.inventory} {why}") from None


def _not_a_record(name: str, known: list[str]) -> StudyError:
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(known)}"
    return StudyError(f"motions.select: {name!r} is no record of the study; {hint}")


def _from_files(entry: FileSet, key: str) -> list[Source]:
    paths = [Path(entry.path)]
    if glob.has_magic(entry.path) and not paths[0].is_file():
        names = glob.glob(_any_case(entry.path), recursive=True)
        paths = [path for path in sorted(map(Path, names)) if path.is_file()]
        paths = [path for path in paths if not goes_with_records(path)]
        if not paths:
            raise StudyError(f"{key}: no file matches {entry.path}")
    columns = entry.columns.build() if entry.columns is not None else None
    return [Source(path, entry.unit, entry.inventory, entry.accept, columns) for path in paths]


def _any_case(pattern: str) -> str:
    """The pattern with each letter in both cases.

    Leading folders that exist by their very name are meant so, whatever characters it has.
    """
    folder = Path(pattern).anchor
    parts = list(Path(pattern).relative_to(folder).parts)
    while parts and os.path.isdir(os.path.join(folder, parts[0])):
        folder = os.path.join(folder, parts.pop(0))
    pieces = re.split(r"(\[!?\]?[^]]*\])", "/".join(parts))
    return os.path.join(glob.escape(folder), "".join(map(_in_both_cases, pieces)))


def _in_both_cases(piece: str) -> str:
    if piece.startswith("[") and piece.endswith("]"):
        inner = piece[1:-1]
        return f"[{inner}{inner.strip('!]').swapcase()}]"
    return "".join(
        f"[{letter.lower()}{letter.upper()}]"
        if letter.isalpha() and len(letter.lower() + letter.upper()) == 2
        else letter
        for letter in piece
    )


def _with_names(sources: list[Source]) -> list[Source]:
    """The same sources, with names for those whose ids would be the same."""
    from archfrag.motions.read import record_name

    stems = Counter(source.path.stem for source in sources)
    groups: dict[str, list[Path]] = {}
    for source in sources:
        if stems[source.path.stem] > 1 and find_entry(source.path) is None:
            groups.setdefault(record_name(source.path), []).append(source.path)
    names: dict[Path, str] = {}
    for name, paths in groups.items():
        if len(paths) > 1:
            names |= zip(paths, _distinct_names(name, paths))
    return [replace(source, name=names.get(source.path)) for source in sources]


def _distinct_names(name: str, paths: list[Path]) -> list[str]:
    """The name of several files with as many of their folders before it as distinguish them.

    Folders that they have in common do not count, so that a study can be moved.
    """
    parents = [Path(os.path.abspath(path)).parent for path in paths]
    common = Path(os.path.commonpath(parents))
    rows = []
    for path, parent in zip(paths, parents):
        end = path.name if parents.count(parent) > 1 else name
        rows.append((*parent.relative_to(common).parts, end))
    depth = 1
    while len({row[-depth:] for row in rows}) < len(rows):
        depth += 1
    return ["+".join(row[-depth:]) for row in rows]


def read_sources(study: Study) -> Iterator["Motion"]:
    """Read the motions of a study one after the other."""
    taken: dict[str, Path | str] = {}
    select = study.motions.select
    for source, motion in _all_motions(study):
        if motion.id in taken:
            twice = f"{motion.id!r} is that of {taken[motion.id]} too; each record needs its own"
            raise RecordError(f"{source}: the record id {twice}")
        taken[motion.id] = source
        if select is None or motion.id in select:
            yield motion
    for name in select or ():
        if name not in taken:
            raise _not_a_record(name, list(taken))


def _all_motions(study: Study) -> Iterator[tuple[Path | str, "Motion"]]:
    """Each motion with its file, or with the key that has it made."""
    components = Components(study)
    for source in find_sources(study):
        facts = {"file": source.path.name, "file_sha256": sha256_of(source.path)}
        for motion in components.read(source):
            yield source.path, motion._replaced(metadata={**motion.metadata, **facts})
    components.check_choice()
    if study.motions.synthetic is not None:
        for motion in made_motions(study.motions.synthetic):
            yield "motions.synthetic", motion


def measured(motion: "Motion", study: Study) -> tuple[float, dict[str, float]]:
    """Factor that brings a motion to 1 in the study's measure, and its value in all measures."""
    from archfrag.motions.measures import factor_of, measure_all

    own = study.intensity.measure
    values = measure_all(motion, dict.fromkeys((own, *COMPARED)))
    return factor_of(motion, own, values[own], 1.0), values


def is_raw(motion: "Motion") -> bool:
    """Whether a record is uncorrected by its header, or in counts."""
    about = motion.metadata
    return about.get("level") == "raw" or about.get("unit_in_file") == "counts"


def study_inputs(study: Study) -> Inputs:
    """What the motions of a study follow from, by content; errors are those of `find_sources`."""
    return read_inputs(study.motions.index, find_sources(study), study.folder)


def prepare_motions(study: Study, progress: Any = None) -> list[PreparedRecord]:
    """Store the motions of a study, one file each, with a manifest.

    They take the place of older ones together, when the last is stored, or not at all.
    """
    inputs = study_inputs(study)
    folder = make_folder(study.work / "motions")
    try:
        with temporary_folder(folder) as made:
            found = _store(study, Path(made), progress)
            name = digest_of([record.prepared for record in found])[:12]
            place = f"motions/{name}"
            records = [r if r.recipe else replace(r, file=f"{place}/{r.file}") for r in found]
            _take_place(Path(made), folder / name)
    except OSError as error:
        raise cannot_write(folder, error) from error
    listed = [asdict(record) for record in records]
    manifest = {"study": study.id, "key": motions_key(study), "inputs": inputs, "records": listed}
    write_text(study.work / MANIFEST, canonical_json(manifest) + "\n")
    for old in folder.iterdir():
        if re.fullmatch("[0-9a-f]{12}", old.name) and old.name != name:
            shutil.rmtree(old, ignore_errors=True)
    return records


def _store(study: Study, folder: Path, progress: Any) -> list[PreparedRecord]:
    """Store all motions of files in a folder, and describe each in the order of the study."""
    from archfrag.motions.store import save_motions

    records: list[PreparedRecord] = []
    for motion in read_sources(study):
        path = folder / f"{len(records):05d}.npz"
        (factor, measures), metadata = measured(motion, study), motion.metadata
        recipe, sha256 = metadata.get("recipe", ""), metadata["file_sha256"]
        if not recipe:
            save_motions(path, [motion])
        records.append(PreparedRecord(
            motion.id, "" if recipe else path.name, metadata["file"], sha256,
            sha256 if recipe else sha256_of(path), motion.dt, motion.duration,
            _number(metadata.get("Mw") or metadata.get("magnitude")),
            _number(metadata.get("distance_km")), factor, measures,
            event=str(metadata.get("event") or metadata.get("event_id") or ""),
            accepted=str(metadata.get("accepted") or ""),
            vertical=motion.vertical is not None, recipe=recipe, raw=is_raw(motion),
            samples=_samples_hash(motion),
            **{name: metadata.get(name) for name in SEEDS},
        ))  # fmt: skip
        if progress is not None:
            progress(len(records))
    if not records:
        raise StudyError("motions: the study has no record")
    if study.motions.select is not None:
        order = {name: i for i, name in enumerate(study.motions.select)}
        records.sort(key=lambda record: order[record.id])
    return records


def _samples_hash(motion: "Motion") -> str:
    digest = hashlib.sha256(float(motion.dt).hex().encode())
    for part in (motion.acceleration, motion.vertical):
        digest.update(b"/" if part is None else np.ascontiguousarray(part, "<f8").data)
    return digest.hexdigest()


def _take_place(new: Path, place: Path) -> None:
    """Give a folder of motions its name, which is that of its content."""
    if place.is_dir():
        if all(sha256_if_there(place / path.name) == sha256_of(path) for path in new.iterdir()):
            return
        shutil.rmtree(place)
    for path in new.iterdir():
        with open(path, "rb+") as file:
            os.fsync(file.fileno())
    new.chmod(0o755)
    os.rename(new, place)


def read_manifest(study: Study) -> dict[str, Any]:
    """What `prepare_motions` wrote of its work."""
    path = study.work / MANIFEST
    try:
        manifest = read_json(path)
        if not isinstance(manifest["inputs"], dict):
            raise TypeError("inputs")
        return {name: manifest[name] for name in ("key", "inputs", "records")}
    except FileNotFoundError:
        raise InputError(f"{path}: the motions are not prepared yet; {_AGAIN}") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); {_AGAIN} anew") from None


def load_prepared(study: Study) -> list[PreparedRecord]:
    """Records that `prepare_motions` stored, each as it was stored.

    Raises
    ------
    InputError
        If there are none yet, they are of other records or another measure, or a stored motion
        is not the one that was prepared.
    """
    manifest, path = read_manifest(study), study.work / MANIFEST
    if manifest["key"] != motions_key(study):
        other = "other records or another measure than the study now has"
        raise InputError(f"{path}: was made for {other}; {_AGAIN} anew")
    try:
        records = [PreparedRecord(**entry) for entry in manifest["records"]]
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); {_AGAIN} anew") from None
    for record in records:
        if record.recipe:
            continue
        if sha256_if_there(study.work / record.file) != record.prepared:
            raise _other_motion(study.work / record.file, f" of record {record.id!r}")
    return records


def load_record(work: Path, record: PreparedRecord) -> "Motion":
    """The motion of a record: stored in a study's folder of work, or made by its recipe."""
    from archfrag.motions.store import load_motions

    if record.recipe:
        return motion_of(record.recipe, record.prepared)
    path = work / record.file
    if sha256_if_there(path) != record.prepared:
        raise _other_motion(path)
    return load_motions(path)[0]


def _other_motion(path: Path, of: str = "") -> InputError:
    what = f"is not the motion that was prepared{of}, but missing, changed or damaged"
    return InputError(f"{path}: {what}; {_AGAIN} anew")


def motions_key(study: Study) -> dict[str, Any]:
    """Settings of a study on its motions and its measure; paths are as in `read_inputs`."""
    motions = study.motions.model_dump(mode="json")
    for given, name in ((motions, "index"), *((each, "path") for each in motions["files"]),
                        *((each, "inventory") for each in motions["files"])):  # fmt: skip
        if given[name] is not None:
            given[name] = os.path.relpath(given[name], study.folder)
    return {"motions": motions, "measure": study.intensity.measure}


def _number(value: Any) -> float | None:
    try:
        return None if value in (None, "") else float(value)
    except (TypeError, ValueError):
        return None
