"""The records of a study: found, read, measured and stored once for all workers."""

import difflib
import glob
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from archfrag.errors import InputError, RecordError, StudyError
from archfrag.motions.index import IndexEntry, load_index
from archfrag.study.config import FileSet, Study
from archfrag.study.digests import canonical_json, digest_of, sha256_if_there, sha256_of
from archfrag.study.files import cannot_write, make_folder, write_text
from archfrag.study.inputs import Inputs, read_inputs

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

MANIFEST = "motions.json"
_AGAIN = "`archfrag motions` on the study file makes it"


@dataclass(frozen=True)
class Source:
    """A record file, and how to read it: by its row of an index or by what the study says."""

    path: Path
    unit: str | None = None
    inventory: str | None = None
    entry: IndexEntry | None = None


@dataclass(frozen=True)
class PreparedRecord:
    """One stored motion and what results say of it."""

    id: str
    file: str  # of the stored motion, in the study's folder of work
    source: str  # name of the record file
    sha256: str  # of the record file
    prepared: str  # SHA-256 of the stored motion
    dt: float  # [s]
    duration: float  # [s]
    magnitude: float | None
    distance: float | None  # [km]
    factors: tuple[float, ...]  # (n_level,) [1]
    accepted: str = ""  # what is implausible and was accepted by a key of the study


def find_sources(study: Study) -> list[Source]:
    """Record files of a study in the order of its results.

    Raises
    ------
    StudyError
        If `select` names an id that is nowhere, or a pattern matches nothing.
    RecordError
        If an index cannot be used or a record file is missing.
    """
    sources = []
    if study.motions.index is not None:
        entries = load_index(study.motions.index)
        wanted = study.motions.select
        if wanted is not None and not study.motions.files:
            table = {entry.id: entry for entry in entries}
            for name in wanted:
                if name not in table:
                    raise _not_a_record(name, list(table))
            entries = [table[name] for name in wanted]
        sources = [Source(entry.path, entry=entry) for entry in entries]
    for number, entry in enumerate(study.motions.files):
        sources += _from_files(entry, f"motions.files[{number}]")
    for source in sources:
        if not source.path.is_file():
            raise RecordError(f"{source.path}: there is no such record file")
    return sources


def _not_a_record(name: str, known: list[str]) -> StudyError:
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {close[0]}?" if close else f"it has {', '.join(known)}"
    return StudyError(f"motions.select: {name!r} is no record of the study; {hint}")


def _from_files(entry: FileSet, key: str) -> list[Source]:
    if glob.has_magic(entry.path):
        paths = sorted(Path(name) for name in glob.glob(entry.path, recursive=True))
        paths = [path for path in paths if path.is_file()]
        if not paths:
            raise StudyError(f"{key}: no file matches {entry.path}")
    else:
        paths = [Path(entry.path)]
    return [Source(path, entry.unit, entry.inventory) for path in paths]


def read_sources(study: Study) -> Iterator["Motion"]:
    """Read the motions of a study one after the other.

    Yields
    ------
    Motion
        With its name in the study as `id`, and with what is known of it, the name and the
        SHA-256 of its file in `metadata`.

    Raises
    ------
    StudyError, RecordError
        Naming the file: see `find_sources` and `archfrag.motions.read`.
    """
    taken: dict[str, Path] = {}
    select = study.motions.select
    for source in find_sources(study):
        for motion in _read(source):
            if motion.id in taken:
                raise RecordError(
                    f"{source.path}: the record id {motion.id!r} is that of {taken[motion.id]} "
                    "too; each record needs its own"
                )
            taken[motion.id] = source.path
            if select is None or motion.id in select:
                facts = {"file": source.path.name, "file_sha256": sha256_of(source.path)}
                yield replace(motion, metadata={**motion.metadata, **facts})
    for name in select or ():
        if name not in taken:
            raise _not_a_record(name, list(taken))


def _read(source: Source) -> list["Motion"]:
    from archfrag.motions.read import load_motion, read_motions

    if source.entry is not None:
        return [load_motion(source.entry)]
    return read_motions(source.path, source.unit, inventory=source.inventory)


def scale_factors(motion: "Motion", study: Study) -> tuple[float, ...]:
    """Factors that bring a motion to the levels of a study, (n_level,) [1].

    Raises
    ------
    RecordError
        If no factor can.
    """
    from archfrag.motions.measures import parse_measure
    from archfrag.motions.scale import scale_factor

    levels, measure = study.intensity.si, study.intensity.measure
    # Measuring once: spectral measures of long records take longer than many runs.
    first = scale_factor(motion, measure, levels[0])
    power = 0.5 if parse_measure(measure).kind == "Arias" else 1.0
    return tuple(first * (level / levels[0]) ** power for level in levels)


def study_inputs(study: Study) -> Inputs:
    """What the motions of a study follow from, by content; errors are those of `find_sources`."""
    return read_inputs(study.motions.index, find_sources(study))


def prepare_motions(study: Study, progress: Any = None) -> list[PreparedRecord]:
    """Store the motions of a study, one file each, with a manifest.

    They take the place of older ones together, when the last is stored, or not at all.

    Parameters
    ----------
    study : Study
    progress : callable, optional
        Called with the number of motions stored so far.

    Raises
    ------
    StudyError, RecordError
        See `read_sources` and `scale_factors`.
    OutputError
        If the output folder cannot be written.
    """
    inputs = study_inputs(study)
    folder = make_folder(study.work / "motions")
    try:
        with tempfile.TemporaryDirectory(
            dir=folder, prefix=".new-", ignore_cleanup_errors=True
        ) as new:
            records = _store(study, Path(new), progress)
            name = digest_of([record.prepared for record in records])[:12]
            records = [replace(r, file=f"motions/{name}/{r.file}") for r in records]
            _take_place(Path(new), folder / name)
    except OSError as error:
        raise cannot_write(folder, error) from error
    manifest = {
        "study": study.id,
        "key": motions_key(study),
        "inputs": inputs,
        "records": [asdict(record) for record in records],
    }
    write_text(study.work / MANIFEST, canonical_json(manifest) + "\n")
    for old in folder.iterdir():
        if old.name != name:
            shutil.rmtree(old, ignore_errors=True)
    return records


def _store(study: Study, folder: Path, progress: Any) -> list[PreparedRecord]:
    """Store all motions in a folder, and tell of each in the order of the study."""
    from archfrag.motions.store import save_motions

    records: list[PreparedRecord] = []
    for motion in read_sources(study):
        path = folder / f"{len(records):05d}.npz"
        factors = scale_factors(motion, study)
        save_motions(path, [motion])
        records.append(
            PreparedRecord(
                id=motion.id,
                file=path.name,
                source=motion.metadata["file"],
                sha256=motion.metadata["file_sha256"],
                prepared=sha256_of(path),
                dt=motion.dt,
                duration=motion.duration,
                magnitude=_number(motion.metadata.get("Mw")),
                distance=_number(motion.metadata.get("distance_km")),
                factors=factors,
                accepted=str(motion.metadata.get("accepted") or ""),
            )
        )
        if progress is not None:
            progress(len(records))
    if not records:
        raise StudyError("motions: the study has no record")
    if study.motions.select is not None:
        order = {name: i for i, name in enumerate(study.motions.select)}
        records.sort(key=lambda record: order[record.id])
    return records


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
    """What `prepare_motions` wrote of its work.

    Raises
    ------
    InputError
        If there is nothing, or it is damaged.
    """
    path = study.work / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
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
        If there are none yet, they belong to other levels or another study, or a stored motion
        is not the one that was prepared.
    """
    manifest, path = read_manifest(study), study.work / MANIFEST
    if manifest["key"] != motions_key(study):
        raise InputError(
            f"{path}: was made for other records or levels than the study now has; {_AGAIN} anew"
        )
    try:
        records = [
            PreparedRecord(**(entry | {"factors": tuple(entry["factors"])}))
            for entry in manifest["records"]
        ]
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); {_AGAIN} anew") from None
    for record in records:
        if sha256_if_there(study.work / record.file) != record.prepared:
            raise InputError(
                f"{study.work / record.file}: is not the motion that was prepared of record "
                f"{record.id!r}, but missing, changed or damaged; {_AGAIN} anew"
            )
    return records


def load_record(study: Study, record: PreparedRecord) -> "Motion":
    """The stored motion of a record; see `load_stored`."""
    return load_stored(study.work / record.file, record.prepared)


def load_stored(path: Path, prepared: str) -> "Motion":
    """A stored motion, if it is still the one that was prepared.

    Raises
    ------
    InputError
        If it is not, by its SHA-256.
    """
    from archfrag.motions.store import load_motions

    if sha256_if_there(path) != prepared:
        raise InputError(
            f"{path}: is not the motion that was prepared, but missing, changed or damaged; "
            f"{_AGAIN} anew"
        )
    return load_motions(path)[0]


def motions_key(study: Study) -> dict[str, Any]:
    """What a study says of its motions and levels."""
    return {
        "motions": study.motions.model_dump(mode="json"),
        "measure": study.intensity.measure,
        "levels": list(study.intensity.si),
    }


def _number(value: Any) -> float | None:
    try:
        return None if value in (None, "") else float(value)
    except (TypeError, ValueError):
        return None
