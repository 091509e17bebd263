"""The cube: all parts of a study in one CF-1.11 netCDF file."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from archfrag import __version__
from archfrag.files import counted, make_folder, replacing
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import Model
from archfrag.study.file.members import Members
from archfrag.study.file.schema import Study
from archfrag.study.file.vary import VARIABLE
from archfrag.study.files import CUBE, refuse_foreign_cube
from archfrag.study.provenance import attributes, strict_json
from archfrag.study.runs.design import CASE
from archfrag.study.runs.outcome import COLUMNS, Column
from archfrag.study.runs.plan import Plan, make_plan
from archfrag.study.runs.store import Gathered, gather

_RUN = ("arch", "record", "level")
# Of a chunk, which is read and decompressed at once [values].
LARGEST_CHUNK = 100_000
COMPRESSION = 4
_LABELS = "arch record intensity"
_ARCH_UNITS = {"embrace": "degree", "density": "kg m-3", "friction": "1", "dead_load": "N"}
_UDUNITS = {"m/s2": "m s-2", "m/s": "m s-1", "m": "m", "s": "s"}


def write_cube(study: Study, plan: Plan | None = None) -> Path:
    """Gather the parts of a study into its cube, written completely or not at all.

    Parameters
    ----------
    study : Study
    plan : Plan, optional
        Of the study, where it is known.

    Raises
    ------
    InputError
        If results of runs are missing.
    OutputError
        If the file cannot be written.
    """
    refuse_foreign_cube(study)
    plan = plan or make_plan(study)
    cube = build_cube(study, plan, gather(plan))
    path = make_folder(study.folder) / CUBE
    with replacing(path) as temporary:
        try:
            cube.to_netcdf(temporary, engine="netcdf4", format="NETCDF4")
        except RuntimeError as error:  # netCDF's word for a disk that is full
            raise OSError(str(error)) from error
    return path


def build_cube(study: Study, plan: Plan, runs: Gathered) -> xr.Dataset:
    """The cube of a study's runs, with all facts on arches and records.

    Memory grows by about 600 bytes a run.
    """
    found = study.members(len(plan.records))
    regular = plan.asks.on_levels
    shape = (len(plan.arches), len(plan.records), len(plan.levels) if regular else 1)
    cells = runs.cases["arch"], runs.cases["record"], runs.cases["place"]

    def filled(values: NDArray, missing: float) -> NDArray:
        table = np.full((*shape, *values.shape[1:]), missing, values.dtype)
        table[cells] = values
        return table

    notes = {plan.arches[arch]["id"]: note for arch, note in sorted(runs.notes.items())}
    facts: dict[str, xr.Variable] = {
        "arch": _texts("arch", found.ids, "name of the arch"),
        "arch_class": _texts("arch", found.classes, "entry of the study it is of", "arch"),
        "record": _texts("record", [r.id for r in plan.records], "name of the record"),
        "model": _texts(
            "model", [model.name.lower() for model in Model],
            "model of the ladder that a time was simulated with",
        ),
        **_levels(study, plan, shape, filled, runs),
        **_arch_facts(found),
        **_record_facts(plan),
    }  # fmt: skip
    for column in COLUMNS:
        values = filled(runs.table[column.name], column.missing)
        facts[column.name] = _variable(column, _RUN, values, _LABELS)
    lost = (facts["verdict"] == Verdict.STANDING) & np.isfinite(facts["lost_contact_time"])
    column = Column(
        "lost_contact_and_stand", "i4", "1",
        "number of runs of all records that lost contact at a joint and stand",
    )  # fmt: skip
    facts[column.name] = _variable(column, ("arch", "level"), lost.sum("record"), "arch level")
    column = Column(
        "model_time", "f8", "s", "simulated time in each model",
        comment="They add up to end_time: from rest through mega-voussoirs to all voussoirs.",
    )  # fmt: skip
    times = filled(runs.table["model_time"], np.nan)
    facts[column.name] = _variable(column, (*_RUN, "model"), times, f"{_LABELS} model")
    design = {**plan.design, "arches": notes}
    return xr.Dataset(facts, attrs=_global_attributes(study, plan, design))


def _global_attributes(study: Study, plan: Plan, design: dict[str, Any]) -> dict[str, str]:
    count, of = sum(record.vertical for record in plan.records), len(plan.records)
    some = f"used for {count} of {of} records"
    return {
        "Conventions": "CF-1.11",
        "title": study.title,
        "institution": study.institution,
        "source": f"rigid-block simulations with archfrag {__version__}, method "
        f"{study.method.name}",
        "vertical_component": some if 0 < count < of else "used" if count else "not used",
        "history": "Records read, processed and scaled to levels of the intensity measure; "
        f"simulations as the design {study.design.kind} asks for them; results gathered by "
        "archfrag.",
        "references": "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; the "
        "README of archfrag",
        "comment": f"{counted(len(plan.arches), 'arch')} under "
        f"{counted(len(plan.records), 'record')} scaled by {study.intensity.measure}. "
        "Wall times and machine are in a log beside this file.",
        "loss_limit": f"{study.method.loss_limit:g}",
        "archfrag_design": strict_json(design),
        "archfrag_design_kind": str(design["kind"]),
        **attributes(study, plan),
    }


def _variable(
    column: Column, dimensions: Sequence[str], values: Any, labels: str = ""
) -> xr.Variable:
    """Values with CF's attributes; `labels` names the coordinates that they belong to."""
    array = np.asarray(values, dtype=column.dtype)
    attrs: dict[str, Any] = {"long_name": column.long_name}
    if column.units:
        attrs["units"] = column.units
    if column.flags:
        attrs["flag_values"] = np.array([code for code, _ in column.flags], dtype=column.dtype)
        attrs["flag_meanings"] = " ".join(meaning for _, meaning in column.flags)
    if column.comment:
        attrs["comment"] = column.comment
    # One arch at a time, so that who reads one reads no more; of very many runs some records.
    sizes = list(array.shape)
    if tuple(dimensions[: len(_RUN)]) == _RUN:
        of_record = max(1, int(np.prod(sizes[2:])))
        sizes[:2] = [1, min(sizes[1], max(1, LARGEST_CHUNK // of_record))]
    encoding = {
        "zlib": True, "complevel": COMPRESSION, "_FillValue": column.fill,
        "chunksizes": tuple(max(1, size) for size in sizes), "coordinates": labels or None,
    }  # fmt: skip
    return xr.Variable(dimensions, array, attrs, encoding)


def _texts(dimension: str, texts: Sequence[str], about: str, labels: str = "") -> xr.Variable:
    """Text as characters: CF's form that every version of every reader knows."""
    length = max(1, *(len(text.encode()) for text in texts))
    encoding = {"dtype": "S1", "char_dim_name": f"text{length}", "coordinates": labels or None}
    return xr.Variable(dimension, np.array(texts, object), {"long_name": about}, encoding)


def _levels(
    study: Study, plan: Plan, shape: tuple[int, ...], filled: Any, runs: Gathered
) -> dict[str, xr.Variable]:
    from archfrag.motions.measures import measure_unit

    level = Column("level", "i4", "1", "number of the intensity level, counted from 0")
    measure = study.intensity.measure
    intensity = Column(
        "intensity", "f8", _UDUNITS[measure_unit(measure)], f"{measure} of the scaled record"
    )
    scale = Column("scale_factor", "f8", "1", "factor on the record that reaches the level")
    if plan.asks.on_levels:
        record, place = np.indices(shape[1:])
        cases = np.zeros(record.size, CASE)
        cases["record"], cases["level"] = record.ravel(), np.array(plan.levels)[place.ravel()]
        levels = _variable(intensity, ("level",), plan.levels)
        factors = plan.factors(cases).reshape(shape[1:])
        scales = _variable(scale, ("record", "level"), factors, "record intensity")
    else:
        levels = _variable(intensity, _RUN, filled(runs.cases["level"], np.nan), "arch record")
        scales = _variable(scale, _RUN, filled(runs.factors, np.nan), _LABELS)
    levels.attrs["measure"] = measure
    numbers = _variable(level, ("level",), np.arange(shape[2]))
    return {"level": numbers, "intensity": levels, "scale_factor": scales}


def _facts(dimension: str, facts: Sequence[tuple[Column, Any]]) -> dict[str, xr.Variable]:
    """One value for each arch or record, nan if there is none."""
    return {
        column.name: _variable(
            column, (dimension,), [np.nan if value is None else value for value in values],
            dimension,
        )
        for column, values in facts
    }  # fmt: skip


def _arch_facts(found: Members) -> dict[str, xr.Variable]:
    from archfrag.simulate import onset
    from archfrag.simulation.rest import static_limit

    arches = [entry.build() for entry in found.entries]
    starts = [onset(arch) for arch in arches]
    text = "largest steady ground acceleration towards {} that leaves the arch at rest"
    gravity = "In multiples of standard gravity, 9.80665 m s-2."
    units = dict.fromkeys(VARIABLE, "m") | _ARCH_UNITS
    facts = _facts("arch", [
        (Column("onset_plus", "f8", "1", text.format("+x"), comment=gravity),
         [start.plus for start in starts]),
        (Column("onset_minus", "f8", "1", text.format("-x"), comment=gravity),
         [start.minus for start in starts]),
        (Column("static_limit", "f8", "rad",
                "rotation at which the mechanism of onset is in unstable equilibrium", np.nan),
         [static_limit(arch, start) for arch, start in zip(arches, starts)]),
        (Column("joint_length", "f8", "m", "mean length of the joints"),
         [np.linalg.norm(arch.extrados - arch.intrados, axis=1).mean() for arch in arches]),
        *((Column(f"arch_{name}", "f8", units.get(name, "1"), f"{name} of the arch", np.nan), each)
          for name, each in found.parameters().items()),
    ])  # fmt: skip
    for name, texts in found.attributes().items():
        # Names in files have letters, digits and _ only; long_name is as in the table.
        plain = re.sub("[^A-Za-z0-9_]", "_", f"attribute_{name}")
        while plain in facts:
            plain += "_"
        facts[plain] = _texts("arch", texts, f"{name} of the arch", "arch")
    return facts


def _record_facts(plan: Plan) -> dict[str, xr.Variable]:
    """Facts on records; in a run their measures are these times factor ** exponent."""
    from archfrag.motions.measures import measure_unit, scaling_exponent

    records = plan.records

    def of(name: str) -> list[Any]:
        return [getattr(record, name) for record in records]

    facts = _facts("record", [
        (Column("record_dt", "f8", "s", "time between samples of the record"), of("dt")),
        (Column("record_duration", "f8", "s", "time from the first to the last sample"),
         of("duration")),
        (Column("magnitude", "f8", "1", "moment magnitude of the earthquake", np.nan),
         of("magnitude")),
        (Column("distance", "f8", "km", "distance from the source to the station", np.nan),
         of("distance")),
        (Column("record_vertical", "i1", "", "whether the vertical component moves the arch too",
                flags=((0, "horizontal_only"), (1, "with_vertical")),
                comment="Scaled by the factor of the horizontal component."), of("vertical")),
    ])  # fmt: skip
    doubt = "what is implausible in the record and was accepted by a key of the study"
    for name, key, about in (
        ("event", "event", "earthquake"),
        ("record_file", "source", "name of the record file"),
        ("record_sha256", "sha256", "SHA-256 of the record file"),
        ("accepted", "accepted", doubt),
    ):
        facts[name] = _texts("record", of(key), about, "record")
    names = list(records[0].measures)
    units = [measure_unit(name) for name in names]
    facts["measure"] = _texts("measure", names, "intensity measure")
    facts["measure_unit"] = _texts("measure", units, "unit of the intensity measure", "measure")
    column = Column("measure_exponent", "i4", "1", "power of the scale factor in the measure")
    facts |= _facts("measure", [(column, [scaling_exponent(name) for name in names])])
    about = "intensity of the record as it is, in the unit of each measure"
    values = [[record.measures[name] for name in names] for record in records]
    column = Column("record_measure", "f8", "", about)
    facts[column.name] = _variable(column, ("record", "measure"), values, "record measure")
    return facts
