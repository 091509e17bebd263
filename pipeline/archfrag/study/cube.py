"""The cube: all parts of a study in one CF-1.11 netCDF file."""

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from archfrag import __version__
from archfrag.errors import OutputError
from archfrag.files import counted, write_csv
from archfrag.fragility.counts import Verdict
from archfrag.study.config import Study
from archfrag.study.design import GRIDS
from archfrag.study.files import is_ours_damaged, make_folder, replacing
from archfrag.study.members import Members, members
from archfrag.study.outcome import COLUMNS, Column
from archfrag.study.plan import Plan, make_plan
from archfrag.study.provenance import attributes, strict_json
from archfrag.study.records import SEEDS, PreparedRecord
from archfrag.study.rounds import CASE, COARSE, FINE, Cases
from archfrag.study.store import Gathered, Results, Store, replay
from archfrag.study.vary import VARIABLE

CUBE = "cube.nc"
TIMINGS = "timings.csv"
_RUN = ("arch", "record", "level")
# Of a chunk, which is read and decompressed at once [values].
LARGEST_CHUNK = 100_000
COMPRESSION = 4
_LABELS = "arch record intensity"
_ARCH_UNITS = {"embrace": "degree", "density": "kg m-3", "friction": "1", "dead_load": "N"}
_UDUNITS = {"m/s2": "m s-2", "m/s": "m s-1", "m": "m", "s": "s"}


def refuse_foreign_cube(study: Study) -> None:
    """See that no other study's cube stands where this study's is to be; ours may be damaged."""
    path = study.folder / CUBE
    if not path.exists():
        return
    owner = None
    try:
        # A pipe would be waited for.
        with netCDF4.Dataset(path if path.is_file() else os.devnull) as cube:
            owner = cube.__dict__.get("archfrag_study")
    except OSError:
        if is_ours_damaged(study, CUBE):
            return
    if owner != study.id:
        whose = f"the cube of study {owner!r}" if owner else "a file that is no cube of archfrag"
        advice = "give the studies different output folders, or move the file"
        raise OutputError(f"{path}: {whose} is in the place of study {study.id!r}; {advice}")


def write_cube(study: Study) -> Path:
    """Gather the parts of a study into its cube, written completely or not at all.

    The same parts give the same bytes. It is written arch by arch: memory grows by about 150 bytes
    a run, whatever the results hold.
    """
    refuse_foreign_cube(study)
    plan = make_plan(study)
    results = Gathered(plan)
    path = make_folder(study.folder) / CUBE
    with replacing(path) as temporary:
        try:
            with netCDF4.Dataset(temporary, "w", format="NETCDF4") as cube:
                _write(cube, study, plan, results)
        except RuntimeError as error:  # netCDF's word for a disk that is full
            raise OSError(str(error)) from error
    return path


def write_timings(study: Study) -> Path:
    """Gather the wall times of all runs into ``timings.csv``; not part of the cube."""
    import pandas as pd

    plan = make_plan(study)
    store = Store(plan.parts)
    cases, _ = replay(plan, store)
    keys = plan.keys(cases, plan.factors(cases))
    wall_time, steps = np.full(len(cases), np.nan), np.zeros(len(cases), np.int64)
    for _, rows, part, times in store.rows(store.places(keys)):
        wall_time[rows], steps[rows] = times, part["steps"]
    table = pd.DataFrame({
        "stage": cases["stage"],
        "arch": np.array([arch["id"] for arch in plan.arches], object)[cases["arch"]],
        "record": np.array([record.id for record in plan.records], object)[cases["record"]],
        "level": cases["level"], "steps": steps, "wall_time": wall_time,
    })  # fmt: skip
    path = study.work / TIMINGS
    write_csv(path, [table])
    return path


def read_timings(study: Study) -> dict[str, list[float]] | None:
    """Wall times of the runs of each arch that `write_timings` gathered [s]; None without."""
    path = study.work / TIMINGS
    if not path.is_file():
        return None
    import pandas as pd

    table = pd.read_csv(path, usecols=["arch", "wall_time"], converters={"arch": str})
    return {str(name): own.tolist() for name, own in table.groupby("arch")["wall_time"]}


class _Layout:
    """Where runs are in the cube: (arch, record, level), with one level where each has its own."""

    def __init__(self, plan: Plan) -> None:
        self.regular = plan.design["kind"] in GRIDS
        n_level = len(plan.levels) if self.regular else 1
        self.shape = (len(plan.arches), len(plan.records), n_level)

    def fill(self, cases: Cases, values: NDArray, missing: float) -> NDArray:
        """Values of runs of one arch by their cells, with `missing` where there is no run."""
        cells = np.full((*self.shape[1:], *values.shape[1:]), missing, values.dtype)
        cells[cases["record"], cases["place"]] = values
        return cells


def _write(cube: Any, study: Study, plan: Plan, results: Gathered) -> None:
    found = members(study, len(plan.records))
    grid = _Layout(plan)
    for name, size in zip((*_RUN, "model"), (*grid.shape, len(results.models))):
        cube.createDimension(name, size)
    notes = {plan.arches[arch]["id"]: note for arch, note in sorted(results.notes.items())}
    cube.setncatts(_global_attributes(study, plan, {**plan.design, "arches": notes}))
    _labels(cube, "arch", "arch", found.ids, "name of the arch")
    _labels(cube, "arch_class", "arch", found.classes, "entry of the study it is of", "arch")
    _labels(cube, "record", "record", [r.id for r in plan.records], "name of the record")
    about = "model of the ladder that a time was simulated with"
    _labels(cube, "model", "model", results.models, about)
    _levels(cube, study, plan, grid)
    _arch_facts(cube, found)
    _record_facts(cube, plan)
    for column in COLUMNS:
        _create(cube, column, _RUN)
    two_stage = bool((results.cases["stage"] == COARSE).any())
    if two_stage:
        about = "outcome of a run by the coarse method"
        _create(cube, replace(COLUMNS[0], name="coarse_verdict", long_name=about), _RUN)
    column = Column(
        "lost_contact_and_stand", "i4", "1",
        "number of runs of all records that lost contact at a joint and stand",
    )  # fmt: skip
    _create(cube, column, (_RUN[0], _RUN[2]), "arch level")
    column = Column(
        "model_time", "f8", "s", "simulated time in each model",
        comment="They add up to end_time: from rest through mega-voussoirs to all voussoirs.",
    )  # fmt: skip
    _create(cube, column, (*_RUN, "model"), f"{_LABELS} model")
    for arch in range(len(found)):
        _write_arch(cube, grid, arch, results.read(arch, FINE))
        if two_stage:
            coarse = results.read(arch, COARSE)
            verdict, missing = coarse.table["verdict"], COLUMNS[0].missing
            cube["coarse_verdict"][arch] = grid.fill(coarse.cases, verdict, missing)


def _write_arch(cube: Any, grid: _Layout, arch: int, own: Results) -> None:
    """All that the cube holds of the runs of one arch by the study's method."""
    for column in COLUMNS:
        values = own.table[column.name]
        cube[column.name][arch] = grid.fill(own.cases, values, column.missing)
    lost = np.isfinite(own.table["lost_contact_time"])
    stood = own.table["verdict"] == Verdict.STANDING
    regained = grid.fill(own.cases, lost & stood, False)
    cube["lost_contact_and_stand"][arch] = regained.sum(axis=0)
    cube["model_time"][arch] = grid.fill(own.cases, own.table["model_time"], np.nan)
    if not grid.regular:
        cube["intensity"][arch] = grid.fill(own.cases, own.cases["level"], np.nan)
        cube["scale_factor"][arch] = grid.fill(own.cases, own.factors, np.nan)


def _global_attributes(study: Study, plan: Plan, design: dict[str, Any]) -> dict[str, str]:
    # What was used, not what was asked for: synthetic motions have a key of their own.
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


def _create(cube: Any, column: Column, dimensions: Sequence[str], labels: str = _LABELS) -> Any:
    variable = cube.createVariable(
        column.name,
        column.dtype,
        dimensions,
        zlib=True,
        complevel=COMPRESSION,
        chunksizes=_chunks(cube, dimensions),
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


def _chunks(cube: Any, dimensions: Sequence[str]) -> list[int]:
    """One arch at a time, so that fits and report read no more than they need.

    Of an arch with very many runs, so many records that a chunk holds at most `LARGEST_CHUNK`.
    """
    sizes = [len(cube.dimensions[name]) for name in dimensions]
    if tuple(dimensions[: len(_RUN)]) == _RUN:
        of_record = max(1, int(np.prod(sizes[2:])))
        sizes[:2] = [1, min(sizes[1], max(1, LARGEST_CHUNK // of_record))]
    return [max(1, size) for size in sizes]


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


def _levels(cube: Any, study: Study, plan: Plan, grid: "_Layout") -> None:
    from archfrag.motions.measures import measure_unit

    level = Column("level", "i4", "1", "number of the intensity level, counted from 0")
    _create(cube, level, ("level",), "")[:] = np.arange(grid.shape[2])
    measure = study.intensity.measure
    intensity = Column(
        "intensity", "f8", _UDUNITS[measure_unit(measure)], f"{measure} of the scaled record"
    )
    scale = Column("scale_factor", "f8", "1", "factor on the record that reaches the level")
    if grid.regular:
        variable = _create(cube, intensity, ("level",), "")
        variable[:] = plan.levels
        record, place = np.indices(grid.shape[1:])
        cases = np.zeros(record.size, CASE)
        cases["record"], cases["level"] = record.ravel(), np.array(plan.levels)[place.ravel()]
        factors = _create(cube, scale, ("record", "level"), "record intensity")
        factors[:] = plan.factors(cases).reshape(grid.shape[1:])
    else:
        variable = _create(cube, intensity, _RUN, "arch record")
        _create(cube, scale, _RUN)
    variable.measure = measure


def _facts(cube: Any, dimension: str, facts: Sequence[tuple[Column, Any]]) -> None:
    """One value for each arch or record, nan where there is none."""
    for column, values in facts:
        variable = _create(cube, column, (dimension,), dimension)
        variable[:] = [np.nan if value is None else value for value in values]


def _arch_facts(cube: Any, found: Members) -> None:
    from archfrag.simulate import onset
    from archfrag.simulation.static_limit import static_limit

    arches = [entry.build() for entry in found.entries]
    starts = [onset(arch) for arch in arches]
    text = "largest steady ground acceleration towards {} that leaves the arch at rest"
    gravity = "In multiples of standard gravity, 9.80665 m s-2."
    units = dict.fromkeys(VARIABLE, "m") | _ARCH_UNITS
    _facts(cube, "arch", [
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
        while plain in cube.variables:
            plain += "_"
        _labels(cube, plain, "arch", texts, f"{name} of the arch", "arch")


def _record_facts(cube: Any, plan: Plan) -> None:
    records = plan.records

    def of(name: str) -> list[Any]:
        return [getattr(record, name) for record in records]

    _facts(cube, "record", [
        (Column("record_dt", "f8", "s", "time between samples of the record"), of("dt")),
        (Column("record_duration", "f8", "s", "time from the first to the last sample"),
         of("duration")),
        (Column("magnitude", "f8", "1", "moment magnitude of the earthquake", np.nan),
         of("magnitude")),
        (Column("distance", "f8", "km", "distance from the source to the station", np.nan),
         of("distance")),
    ])  # fmt: skip
    _record_measures(cube, records)
    _labels(cube, "event", "record", of("event"), "earthquake", "record")
    vertical = Column(
        "record_vertical", "i1", "", "whether the vertical component moves the arch too",
        flags=((0, "horizontal_only"), (1, "with_vertical")),
        comment="Scaled by the factor of the horizontal component.",
    )  # fmt: skip
    _facts(cube, "record", [(vertical, of("vertical"))])
    for key in SEEDS if any(of("recipe")) else ():
        column = Column(
            f"record_{key}", "f8", "1", f"{key.replace('_', ' ')} of a synthetic record", np.nan,
            comment="An integer; the record follows from its seeds, magnitude and distance.",
        )  # fmt: skip
        _facts(cube, "record", [(column, of(key))])
    doubt = "what is implausible in the record and was accepted by a key of the study"
    for name, key, about in (
        ("record_file", "source", "name of the record file"),
        ("record_sha256", "sha256", "SHA-256 of the record file"),
        ("accepted", "accepted", doubt),
    ):
        _labels(cube, name, "record", of(key), about, "record")


def _record_measures(cube: Any, records: Sequence[PreparedRecord]) -> None:
    """Values of the records as they are in all measures: times factor ** exponent in a run."""
    from archfrag.motions.measures import measure_unit, scaling_exponent

    names = list(records[0].measures)
    cube.createDimension("measure", len(names))
    _labels(cube, "measure", "measure", names, "intensity measure")
    units = [measure_unit(name) for name in names]
    _labels(cube, "measure_unit", "measure", units, "unit of the intensity measure", "measure")
    exponent = Column("measure_exponent", "i4", "1", "power of the scale factor in the measure")
    _facts(cube, "measure", [(exponent, [scaling_exponent(name) for name in names])])
    about = "intensity of the record as it is, in the unit of each measure"
    column = Column("record_measure", "f8", "", about)
    variable = _create(cube, column, ("record", "measure"), "record measure")
    variable[:] = [[record.measures[name] for name in names] for record in records]
