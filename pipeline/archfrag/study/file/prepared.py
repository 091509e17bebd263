"""The stored records of a study: measured motions, and a manifest that lists them."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError
from archfrag.files import Named, make_folder, relative_path, sha256_of
from archfrag.motions.channel import Facts
from archfrag.motions.measures import measures_of, sample_cautions, scale_factor
from archfrag.motions.motion import REVERSED, Motion, load_stored, store
from archfrag.motions.partners import earthquakes
from archfrag.study import provenance
from archfrag.study.file.motions import Motions
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import MANIFEST
from archfrag.study.yaml_text import relative

FOLDER = "motions"
# Measures found for each stored motion, to compare the study's measure with them.
COMPARED = (
    "PGA",
    "PGV",
    "PGD",
    "Arias",
    "CAV",
    "HI",
    "Sa(0.1)",
    "Sa(0.2)",
    "Sa(0.3)",
    "Sa(0.5)",
    "Sa(0.7)",
    "Sa(1)",
    "Sa(1.5)",
    "Sa(2)",
    "Sa(3)",
    "AvgSA(0.2,2)",
    "Sa_avg2(0.5)",
    "Sa_avg3(0.5)",
    "FIV3(0.5)",
    "FIV3(1)",
)
_AGAIN = "run `archfrag motions` on the study file"


@dataclass(frozen=True, kw_only=True)
class PreparedRecord(Facts):
    """One stored motion: facts of its record, and measures and digests of its samples."""

    id: str
    dt: float  # [s]
    duration: float  # [s]
    factor: float  # on the motion, to bring the study's measure to 1 in its SI unit
    measures: dict[str, float] = field(hash=False)  # values by measure, in SI units
    vertical: bool  # whether the motion has its vertical component
    log: list[str] = field(hash=False)  # what was done to the samples
    samples: str  # SHA-256 of the time step and the samples
    stored: str = ""  # file of the motion, in the study's folder of work
    prepared: str = ""  # SHA-256 of that file
    # The first shock before this record; None if the study has no first shocks.
    first: "PreparedRecord | None" = None

    @property
    def waivers(self) -> str:
        """Implausible facts of the record that the study accepts, as text; else empty."""
        return str(self.accepted or "")

    @property
    def motions(self) -> tuple["PreparedRecord", ...]:
        """The stored motions that its runs need: the first shock, if there is one, and itself."""
        return (self,) if self.first is None else (self.first, self)


def _sources():
    """Return the module that reads records."""
    from archfrag.study.file import sources  # start-up: workers load no obspy

    return sources


def study_inputs(study: StudyKeys) -> provenance.Inputs:
    """Return the SHA-256 of the files that the motions of a study depend on, by kind and path.

    Missing files are left out. Paths are relative to the folder of the results, so that a study
    may be moved with them.
    """
    return {
        kind: {
            relative_path(path, study.folder): digest
            for path in paths
            if (digest := provenance.sha256_if_there(path)) is not None
        }
        for kind, paths in _sources().input_paths(study).items()
    }


def described(
    study: StudyKeys, motion: Motion, measures: dict[str, float]
) -> PreparedRecord:
    """Return the record of a motion that is not stored yet; InputError if it cannot be scaled."""
    asked = study.intensity.measure
    samples = hashlib.sha256(float(motion.dt).hex().encode())
    cautions = list(motion.facts.cautions)
    for part, prefix in ((motion.acceleration, ""), (motion.vertical, "vertical: ")):
        if part is None:
            samples.update(b"/")
            continue
        samples.update(np.ascontiguousarray(part, "<f8").data)
        cautions += (prefix + text for text in sample_cautions(part, motion.dt))
    return PreparedRecord(
        **vars(motion.facts) | {"cautions": cautions},
        id=motion.id,
        dt=motion.dt,
        duration=motion.duration,
        factor=scale_factor(motion, asked, 1.0, measures[asked]),
        measures=measures,
        vertical=motion.vertical is not None,
        log=list(motion.log),
        samples=samples.hexdigest(),
    )


def prepare_motions(study: StudyKeys) -> list[PreparedRecord]:
    """Store the motions of a study, one file each, and their manifest; return the records.

    The manifest is written last. Until then the old motions are valid; afterwards those that no
    record needs are removed.
    """
    inputs = study_inputs(study)
    folder = make_folder(study.work / FOLDER)
    records = read_records(study, keep=True)
    manifest = {
        "key": motions_key(study),
        "inputs": inputs,
        "code": provenance.code(),
        "records": list(map(asdict, records)),
    }
    provenance.write_text(
        study.work / MANIFEST, provenance.canonical_json(manifest) + "\n"
    )
    kept = {study.work / each.stored for record in records for each in record.motions}
    for path in {*folder.glob("*.npz")} - kept:
        path.unlink()
    return records


def read_records(study: StudyKeys, keep: bool = False) -> list[PreparedRecord]:
    """Read the records of a study in its order, each with its first shock if the study has them.

    If `keep` is true, their motions are stored, and the measures `COMPARED` are found for them.
    """
    new = study.work / FOLDER / "new.npz"

    measured = study.intensity.measure
    names = dict.fromkeys((measured, *(COMPARED if keep else ())))

    def read(asked: Motions) -> list[PreparedRecord]:
        records = list[PreparedRecord]()
        motions = _sources().read_sources(asked, measured)
        while pair := [*islice(motions, 2)]:  # few motions in memory
            for motion, values in zip(pair, measures_of(pair, names)):
                record = described(study, motion, values)
                if keep:
                    store(new, motion)
                    prepared = sha256_of(new)
                    stored = f"{FOLDER}/{prepared[:16]}.npz"
                    record = replace(record, stored=stored, prepared=prepared)
                    new.replace(study.work / stored)
                records.append(record)
        order = [name + end for name in asked.select or () for end in ("", REVERSED)]
        events = dict(zip((each.id for each in records), earthquakes(records)))
        if order:
            records.sort(key=lambda record: order.index(record.id))
        return [replace(each, event=events[each.id]) for each in records]

    found: list[PreparedRecord] = _sources().following(study.motions, read)
    levels_asked(study, found)
    return found


def levels_asked(
    study: StudyKeys, records: Sequence[PreparedRecord]
) -> NDArray[np.bool_]:
    """Return at which levels of a study each record is run, (n_record, n_level).

    They are those that the study's index gives it, or all. InputError if the design, the levels of
    the study and those of the index do not agree.
    """
    given = np.array(study.intensity.given)
    asked = np.ones((len(records), given.size), bool)
    if not any(record.levels for record in records):
        return asked
    where = "motions.index: column level"
    kind = study.design.kind
    if kind != "stripes":
        raise InputError(
            f"{where}: records at levels of their own need design: stripes, not {kind}; change "
            "design, or leave the column out"
        )
    for row, record in zip(asked, records):
        at = np.isclose(given, np.reshape(record.levels, (-1, 1)), rtol=1e-9, atol=0.0)
        for level in np.array(record.levels)[~at.any(axis=1)]:
            raise InputError(
                f"{where}: {level:.12g} of record {record.id} is none of intensity.levels; add "
                "it there, or leave the row out"
            )
        row[:] = at.any(axis=0)
        if not row.any():
            raise InputError(
                f"{where}: record {record.id} has no level, but others have; give it one, or "
                "leave it out"
            )
    for level in given[~asked.any(axis=0)]:
        raise InputError(
            f"intensity.levels: no record has the level {level:.12g} in the column level of "
            "motions.index; leave the level out, or add records"
        )
    return asked


def read_manifest(study: StudyKeys) -> Named:
    """Return the manifest that `prepare_motions` wrote: key, inputs, code and records.

    InputError if it is missing or damaged.
    """
    path = study.work / MANIFEST
    try:
        stored = {"code": "", **provenance.read_json(path)}
        records = list(map(PreparedRecord.of, stored["records"]))
        for place, record in enumerate(records):
            first: Any = record.first
            if first:
                records[place] = replace(record, first=PreparedRecord.of(first))
        return {**stored, "inputs": dict(stored["inputs"]), "records": records}
    except FileNotFoundError:
        raise InputError(
            f"{path}: the motions are not prepared yet; {_AGAIN}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); {_AGAIN}") from None


def load_prepared(study: StudyKeys) -> list[PreparedRecord]:
    """Return the stored records of a study.

    InputError if they are missing or damaged, or were made for other records or another measure.
    """
    manifest = read_manifest(study)
    records: list[PreparedRecord] = manifest["records"]
    alone = study.motions.before is None
    unlike = any((record.first is None) != alone for record in records)
    if unlike or manifest["key"] != motions_key(study):
        raise InputError(
            f"{study.work / MANIFEST}: was made for other records or another measure than the "
            f"study now has; {_AGAIN}"
        )
    for record in records:
        for each in record.motions:
            _check_stored(study.work, each)
    return records


def load_record(work: Path, record: PreparedRecord) -> Motion:
    """Load the motion of a record from a study's folder of work.

    InputError if its file is missing or changed.
    """
    about = {"dt": record.dt, "id": record.id, "log": record.log, "metadata": record}
    return load_stored(_check_stored(work, record), **about)


def _check_stored(work: Path, record: PreparedRecord) -> Path:
    """Return the path of a stored motion; InputError if it is missing or changed."""
    path = work / record.stored
    if provenance.sha256_if_there(path) != record.prepared:
        raise InputError(
            f"{path}: the prepared motion of record {record.id!r} is missing, changed or "
            f"damaged; {_AGAIN}"
        )
    return path


def motions_key(study: StudyKeys) -> Named:
    """Return the keys of a study that decide its motions: those of `motions`, and the measure.

    Paths are relative to the folder of the results.
    """
    motions = relative(study.motions.model_dump(mode="json"), study.folder)
    return {"motions": motions, "measure": study.intensity.measure}
