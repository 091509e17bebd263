"""The cube: all parts of a study in one CF-1.11 netCDF file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from archfrag.errors import InputError, OutputError
from archfrag.fragility.counts import Verdict
from archfrag.study.config import Study
from archfrag.study.files import make_folder, replacing
from archfrag.study.outcome import COLUMNS, Column
from archfrag.study.parts import read_part
from archfrag.study.plan import Plan, make_plan, run_table
from archfrag.study.provenance import attributes
from archfrag.study.records import SEEDS
from archfrag.study.written import is_ours_damaged

CUBE = "cube.nc"
TIMINGS = "timings.csv"
_RUN = ("arch", "record", "level")
_LABELS = "arch record intensity"
_UDUNITS = {"m/s2": "m s-2", "m/s": "m s-1", "m": "m", "s": "s"}


def refuse_foreign_cube(study: Study) -> None:
    """See that no other study's cube stands where this study's is to be; ours may be damaged.

    Raises
    ------
    OutputError
        Naming both studies.
    """
    path = study.folder / CUBE
    if not path.exists():
        return
    try:
        with netCDF4.Dataset(path) as cube:
            owner = cube.__dict__.get("archfrag_study")
    except OSError:
        if is_ours_damaged(study, CUBE):
            return
        owner = None
    if owner != study.id:
        whose = f"the cube of study {owner!r}" if owner else "a file that is no cube of archfrag"
        raise OutputError(
            f"{path}: {whose} is in the way of study {study.id!r}; give the studies different "
            "output folders, or move the file"
        )


def write_cube(study: Study) -> Path:
    """Gather the parts of a study into its cube, written whole or not at all.

    The same parts give the same bytes. Memory: about 200 bytes a run.

    Returns
    -------
    Path
        ``cube.nc`` in the study's folder.

    Raises
    ------
    InputError
        If the motions are not prepared or parts are missing.
    StabilityError
        If an arch does not stand.
    OutputError
        If another study's cube is in the way, or the file cannot be written.
    """
    refuse_foreign_cube(study)
    plan = make_plan(study)
    table = gather(plan)
    path = make_folder(study.folder) / CUBE
    with replacing(path) as temporary:
        try:
            with netCDF4.Dataset(temporary, "w", format="NETCDF4") as cube:
                _write(cube, study, plan, table)
        except RuntimeError as error:  # netCDF's word for a disk that is full
            raise OSError(str(error)) from error
    return path


def gather(plan: Plan) -> dict[str, NDArray]:
    """Columns of all runs in the order of the plan, each (n_run,); `model_time` (n_run, n_model).

    Raises
    ------
    InputError
        If parts are missing or were made by different ladders of models.
    """
    table: dict[str, NDArray] = {c.name: np.empty(plan.n_run, c.dtype) for c in COLUMNS}
    missing = []
    for chunk in range(plan.n_chunk):
        part = read_part(plan, chunk)
        if part is None:
            missing.append(chunk)
            continue
        if "model" not in table:
            table["model"] = part["model"]
            table["model_time"] = np.empty((plan.n_run, part["model"].size))
        if part["model"].tolist() != table["model"].tolist():
            raise InputError(f"{plan.part(chunk)}: tells of other models than the parts before")
        rows = plan.rows(chunk)
        for name in (*(c.name for c in COLUMNS), "model_time"):
            table[name][rows.start : rows.stop] = part[name]
    if missing:
        raise InputError(
            f"{plan.part(0).parent}: {len(missing)} of {plan.n_chunk} parts are missing or "
            f"damaged; `archfrag run STUDY --resume` with the file of study {plan.study!r} makes "
            "them and the cube"
        )
    return table


def write_timings(study: Study) -> Path:
    """Gather the wall times of all runs into ``timings.csv``; not part of the cube.

    Raises
    ------
    InputError
        If the motions are not prepared.
    OutputError
        If the file cannot be written.
    """
    import pandas as pd

    plan = make_plan(study)
    table = run_table(plan)[["run", "arch", "record", "level"]]
    names = ["run", "steps", "wall_time"]
    files = [plan.timing(chunk) for chunk in range(plan.n_chunk)]
    times = [pd.read_csv(file, names=names) for file in files if file.is_file()]
    path = study.work / TIMINGS
    if times:
        table = table.merge(pd.concat(times), on="run", how="left")
    with replacing(path) as temporary:
        table.to_csv(temporary, index=False)
    return path


def _write(cube: Any, study: Study, plan: Plan, table: dict[str, NDArray]) -> None:
    arches = [entry.build() for entry in study.arches]
    shape = (len(arches), len(plan.records), len(plan.levels))
    models = [str(name) for name in table["model"]]
    for name, size in zip((*_RUN, "model"), (*shape, len(models))):
        cube.createDimension(name, size)
    cube.setncatts(_global_attributes(study, plan))
    _labels(cube, "arch", "arch", [entry.id for entry in study.arches], "name of the arch")
    _labels(cube, "record", "record", [r.id for r in plan.records], "name of the record")
    _labels(cube, "model", "model", models, "model of the ladder that a time was simulated with")
    _levels(cube, study)
    _arch_facts(cube, arches)
    _record_facts(cube, plan)
    for column in COLUMNS:
        variable = _create(cube, column, _RUN)
        variable[:] = table[column.name].reshape(shape)
    column = Column(
        "lost_contact_and_stand", "i4", "1",
        "number of runs of all records that lost contact at a joint and stand",
    )  # fmt: skip
    regained = np.isfinite(table["lost_contact_time"]) & (table["verdict"] == Verdict.STANDING)
    variable = _create(cube, column, (_RUN[0], _RUN[2]), "arch intensity")
    variable[:] = regained.reshape(shape).sum(axis=1)
    column = Column(
        "model_time", "f8", "s", "simulated time in each model",
        comment="The models add up to end_time: from rest through few bodies to all voussoirs.",
    )  # fmt: skip
    variable = _create(cube, column, (*_RUN, "model"), f"{_LABELS} model")
    variable[:] = table["model_time"].reshape(*shape, len(models))


def _global_attributes(study: Study, plan: Plan) -> dict[str, str]:
    names = ", ".join(entry.id for entry in study.arches)
    return {
        "Conventions": "CF-1.11",
        "title": study.title,
        "institution": study.institution,
        "source": (
            f"rigid-block simulations with archfrag {_version()}, method {study.method.name}"
        ),
        "vertical_component": _vertical_component(plan),
        "history": (
            "Records read, processed and scaled to the levels of the intensity measure; one "
            "simulation for each arch, record and level; results gathered by archfrag."
        ),
        "references": (
            "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; the README of "
            "archfrag"
        ),
        "comment": (
            f"Arches {names} under {len(plan.records)} records at {len(plan.levels)} levels of "
            f"{study.intensity.measure}. Wall times and machine are in a log beside this file."
        ),
        "loss_limit": f"{study.method.loss_limit:g}",
        **attributes(study, plan),
    }


def _vertical_component(plan: Plan) -> str:
    """What was used, not what was asked for: synthetic motions have a key of their own."""
    count, of = sum(record.vertical for record in plan.records), len(plan.records)
    if 0 < count < of:
        return f"used for {count} of {of} records"
    return "used" if count else "not used"


def _version() -> str:
    from archfrag import __version__

    return __version__


def _create(cube: Any, column: Column, dimensions: Sequence[str], labels: str = _LABELS) -> Any:
    variable = cube.createVariable(
        column.name,
        column.dtype,
        dimensions,
        zlib=True,
        complevel=4,
        fill_value=False if column.fill is None else column.fill,
    )
    variable.long_name = column.long_name
    if column.units:
        variable.units = column.units
    if column.flags:
        variable.flag_values = np.array([code for code, _ in column.flags], dtype=column.dtype)
        variable.flag_meanings = " ".join(meaning for _, meaning in column.flags)
    if column.comment:
        variable.comment = column.comment
    if labels:
        variable.coordinates = labels
    return variable


def _labels(
    cube: Any, name: str, dimension: str, texts: Sequence[str], long_name: str, labels: str = ""
) -> None:
    """Text as characters: CF's form that every version of every reader knows."""
    encoded = [text.encode("utf-8") for text in texts]
    length = max(1, *map(len, encoded))
    width = f"text{length}"
    if width not in cube.dimensions:
        cube.createDimension(width, length)
    variable = cube.createVariable(name, "S1", (dimension, width), fill_value=False)
    variable.long_name = long_name
    variable._Encoding = "utf-8"
    if labels:
        variable.coordinates = labels
    variable.set_auto_chartostring(False)
    variable[:] = np.array(encoded, dtype=f"S{length}").view("S1").reshape(len(texts), length)


def _levels(cube: Any, study: Study) -> None:
    level = Column("level", "i4", "1", "number of the intensity level, counted from 0")
    _create(cube, level, ("level",), "")[:] = np.arange(len(study.intensity.si))
    from archfrag.motions.measures import measure_unit

    intensity = Column(
        "intensity", "f8", _UDUNITS[measure_unit(study.intensity.measure)],
        f"{study.intensity.measure} of the scaled record",
    )  # fmt: skip
    variable = _create(cube, intensity, ("level",), "")
    variable.measure = study.intensity.measure
    variable[:] = study.intensity.si


def _arch_facts(cube: Any, arches: Sequence[Any]) -> None:
    from archfrag.simulate import onset

    starts = [onset(arch) for arch in arches]
    comment = "In multiples of standard gravity, 9.80665 m s-2."
    for name, towards in (("plus", "+x"), ("minus", "-x")):
        column = Column(
            f"onset_{name}", "f8", "1",
            f"largest steady ground acceleration towards {towards} that leaves the arch at rest",
            comment=comment,
        )  # fmt: skip
        variable = _create(cube, column, ("arch",), "arch")
        variable[:] = [getattr(start, name) for start in starts]


def _record_facts(cube: Any, plan: Plan) -> None:
    records = plan.records
    scale = Column("scale_factor", "f8", "1", "factor on the record that reaches the level")
    variable = _create(cube, scale, ("record", "level"), "record intensity")
    variable[:] = [record.factors for record in records]
    facts = (
        Column("record_dt", "f8", "s", "time between samples of the record"),
        Column("record_duration", "f8", "s", "time from the first to the last sample"),
        Column("magnitude", "f8", "1", "moment magnitude of the earthquake", np.nan),
        Column("distance", "f8", "km", "distance from the source to the station", np.nan),
    )
    keys = ("dt", "duration", "magnitude", "distance")
    for column, key in zip(facts, keys):
        given = [getattr(record, key) for record in records]
        variable = _create(cube, column, ("record",), "record")
        variable[:] = [np.nan if value is None else value for value in given]
    vertical = Column(
        "record_vertical", "i1", "", "whether the vertical component moves the arch too",
        flags=((0, "horizontal_only"), (1, "with_vertical")),
        comment="Scaled by the factor of the horizontal component.",
    )  # fmt: skip
    _create(cube, vertical, ("record",), "record")[:] = [record.vertical for record in records]
    for key in SEEDS if any(record.recipe for record in records) else ():
        column = Column(
            f"record_{key}", "f8", "1", f"{key.replace('_', ' ')} of a synthetic record", np.nan,
            comment="A whole number; the record follows from its seeds, magnitude and distance.",
        )  # fmt: skip
        variable = _create(cube, column, ("record",), "record")
        variable[:] = [np.nan if (seed := getattr(r, key)) is None else seed for r in records]
    _labels(cube, "record_file", "record", [r.source for r in records],
            "name of the record file", "record")  # fmt: skip
    _labels(cube, "record_sha256", "record", [r.sha256 for r in records],
            "SHA-256 of the record file", "record")  # fmt: skip
    _labels(cube, "accepted", "record", [r.accepted for r in records],
            "what is implausible in the record and was accepted by a key of the study",
            "record")  # fmt: skip
