"""The motions of a study: measured, and stored once for all workers."""

import hashlib
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from archfrag.errors import InputError
from archfrag.files import make_folder, sha256_of
from archfrag.study.file.schema import Study
from archfrag.study.file.sources import read_sources, study_inputs
from archfrag.study.files import canonical_json, read_json, sha256_if_there, write_text

if TYPE_CHECKING:
    from archfrag.motions.motion import Motion

MANIFEST, FOLDER = "motions.json", "motions"
# Measures in which every run is known: the study's own is compared with them.
COMPARED = (
    "PGA", "PGV", "PGD", "Arias", "CAV", "HI", "Sa(0.1)", "Sa(0.2)", "Sa(0.3)", "Sa(0.5)",
    "Sa(0.7)", "Sa(1)", "Sa(1.5)", "Sa(2)", "Sa(3)", "AvgSA(0.2,2)",
)  # fmt: skip
_AGAIN = "run `archfrag motions` on the study file"


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
    raw: bool = False  # whether the file states that nothing was corrected
    samples: str = ""  # SHA-256 of what moves an arch: the step in time and the samples


def measured(motion: "Motion", study: Study) -> tuple[float, dict[str, float]]:
    """Factor that brings a motion to 1 in the study's measure, and its value in all measures."""
    from archfrag.motions.measures import factor_of, measure_all

    own = study.intensity.measure
    values = measure_all(motion, dict.fromkeys((own, *COMPARED)))
    return factor_of(motion, own, values[own], 1.0), values


def is_raw(motion: "Motion") -> bool:
    """Whether a record is in counts, or its header states that it is uncorrected."""
    about = motion.metadata
    return about.get("level") == "raw" or about.get("unit_in_file") == "counts"


def prepare_motions(study: Study) -> list[PreparedRecord]:
    """Store the motions of a study, one file each, with a manifest.

    New motions count when the manifest is written, which is last; until then the old ones do.
    """
    from archfrag.motions.motion import save_motions

    inputs, records = study_inputs(study), list[PreparedRecord]()
    folder = make_folder(study.work / FOLDER)
    for motion in read_sources(study):
        (factor, measures), about = measured(motion, study), motion.metadata
        save_motions(folder / "new.npz", [motion])
        prepared = sha256_of(folder / "new.npz")
        os.replace(folder / "new.npz", folder / f"{prepared[:16]}.npz")
        samples = hashlib.sha256(float(motion.dt).hex().encode())
        for part in (motion.acceleration, motion.vertical):
            samples.update(b"/" if part is None else np.ascontiguousarray(part, "<f8").data)
        records.append(PreparedRecord(
            motion.id, f"{FOLDER}/{prepared[:16]}.npz", about["file"], about["file_sha256"],
            prepared, motion.dt, motion.duration, about.get("Mw") or about.get("magnitude"),
            about.get("distance_km"), factor, measures,
            event=str(about.get("event") or about.get("event_id") or ""),
            accepted=str(about.get("accepted") or ""), vertical=motion.vertical is not None,
            raw=is_raw(motion), samples=samples.hexdigest(),
        ))  # fmt: skip
    if not records:
        raise InputError("motions: the study has no record; give an index or files")
    if (select := study.motions.select) is not None:
        records.sort(key=lambda record: select.index(record.id))
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
    motions = study.motions.model_dump(mode="json")
    for given in (motions, *motions["files"]):
        for name in ("index", "path", "inventory"):
            if given.get(name) is not None:
                given[name] = os.path.relpath(given[name], study.folder)
    return {"motions": motions, "measure": study.intensity.measure}
