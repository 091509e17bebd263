"""The cube: all parts of a study in one CF-1.11 netCDF file."""

import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import archfrag
from archfrag.files import counted, make_folder, replacing
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import Model
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import Members
from archfrag.study.file.records import read_manifest
from archfrag.study.file.schema import Study
from archfrag.study.file.vary import VARIABLE
from archfrag.study.files import (
    CUBE,
    commit,
    digest_of,
    refuse_foreign_cube,
    sha256_if_there,
    strict_json,
    versions,
)
from archfrag.study.runs import CASE, Cases
from archfrag.study.runs.outcome import COLUMNS, VARIABLES, Variable
from archfrag.study.runs.store import Plan, Table, gather, make_plan

if TYPE_CHECKING:
    import xarray as xr

_RUN = ("arch", "record", "level")
# Of a chunk, which is read and decompressed at once [values].
LARGEST_CHUNK = 100_000
COMPRESSION = 4
_ARCH_UNITS = dict.fromkeys(VARIABLE, "m") | {
    "embrace": "degree", "density": "kg m-3", "friction": "1", "dead_load": "N",
}  # fmt: skip
_UDUNITS = {"m/s2": "m s-2", "m/s": "m s-1", "m": "m", "s": "s"}


def write_cube(study: Study, plan: Plan | None = None) -> Path:
    """Gather the parts of a study into its cube, written completely or not at all.

    InputError if results of runs are missing, OutputError if the file cannot be written. `plan`
    is that of the study, if it is known.
    """
    refuse_foreign_cube(study)
    plan = plan or make_plan(study)
    cube = build_cube(study, plan, *gather(plan))
    path = make_folder(study.folder) / CUBE
    with replacing(path) as temporary:
        try:
            cube.to_netcdf(temporary, engine="netcdf4", format="NETCDF4")
        except RuntimeError as error:  # netCDF's word for a disk that is full
            raise OSError(str(error)) from error
    return path


def build_cube(
    study: Study, plan: Plan, cases: Cases, table: Table, notes: dict[int, dict[str, Any]]
) -> "xr.Dataset":
    """The cube of a study's runs, as `gather` returns them, with facts on arches and records.

    Memory grows by about 600 bytes a run.
    """
    import xarray as xr

    from archfrag.motions.measures import measure_unit, scaling_exponent

    regular, measure = study.design.on_levels, study.intensity.measure
    levels, factors = plan.levels, plan.factors(cases)
    shape = (len(plan.arches), len(plan.records), len(levels) if regular else 1)
    cells = cases["arch"], cases["record"], cases["place"]

    def filled(values: NDArray, missing: float) -> NDArray:
        cube = np.full((*shape, *values.shape[1:]), missing, values.dtype)
        cube[cells] = values
        return cube

    intensity = VARIABLES["intensity"]._replace(
        units=_UDUNITS[measure_unit(measure)], long_name=f"{measure} of the scaled record"
    )
    scale = VARIABLES["scale_factor"]
    if regular:
        grid = np.zeros(shape[1:], CASE)
        grid["record"], grid["level"] = np.arange(shape[1])[:, None], levels
        scales = plan.factors(grid.ravel()).reshape(grid.shape)
    else:
        intensity, scale = (each._replace(dimensions="run") for each in (intensity, scale))
        levels, scales = filled(cases["level"], np.nan), filled(factors, np.nan)
    facts = _arch_facts(plan.arches) | {
        "intensity": _variable(intensity, levels), "scale_factor": _variable(scale, scales),
    }  # fmt: skip
    facts["intensity"].attrs["measure"] = measure
    names = list(plan.records[0].measures)
    values: dict[str, Sequence[Any] | NDArray] = {
        "level": np.arange(shape[2]),
        "model": [model.name.lower() for model in Model],
        "measure": names,
        "measure_unit": [measure_unit(name) for name in names],
        "measure_exponent": [scaling_exponent(name) for name in names],
        "record_measure": [[record.measures[name] for name in names] for record in plan.records],
    }
    for each in VARIABLES.values():
        if each.dimensions == "record":
            found = [getattr(record, each.source) for record in plan.records]
            values[each.name] = [np.nan if value is None else value for value in found]
    for each in (*COLUMNS, VARIABLES["model_time"]):
        values[each.name] = filled(table[each.name], float(each.missing))
    survived = values["verdict"] == Verdict.STANDING
    lost = np.isfinite(values["lost_contact_time"])
    values["lost_contact_and_stand"] = (survived & lost).sum(axis=1)
    facts |= {name: _variable(VARIABLES[name], each) for name, each in values.items()}
    of_arches = {plan.arches[arch].id: note for arch, note in sorted(notes.items())}
    design = study.design.model_dump(mode="json") | {"arches": of_arches}
    stated = attributes(study, plan) | {"archfrag_design": strict_json(design)}
    return xr.Dataset(facts, attrs=stated)


def attributes(study: Study, plan: Plan) -> dict[str, str]:
    """Global attributes of the cube: the same on every run of the same study with this code."""
    config = {
        "id": study.id,
        "title": study.title,
        "arches": [_portable_arch(entry) for entry in study.arches],
        "intensity": {**study.intensity.model_dump(), "levels": list(study.intensity.given)},
        "method": study.method.model_dump(),
        "design": study.design.model_dump(),
    }
    inputs = read_manifest(study)["inputs"]
    count, of = sum(record.vertical for record in plan.records), len(plan.records)
    some = f"used for {count} of {of} records"
    counts = f"{counted(len(plan.arches), 'arch')} under {counted(of, 'record')}"
    return {
        "Conventions": "CF-1.11",
        "title": study.title,
        "institution": study.institution,
        "source": f"rigid-block simulations with archfrag {archfrag.__version__}, method "
        f"{study.method.name}",
        "vertical_component": some if 0 < count < of else "used" if count else "not used",
        "history": "Records read, processed and scaled to levels of the intensity measure; "
        f"simulations as the design {study.design.kind} asks for them; results gathered by "
        "archfrag.",
        "references": "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; the "
        "README of archfrag",
        "comment": f"{counts} scaled by {study.intensity.measure}. Wall times and machine are in "
        "a log beside this file.",
        "loss_limit": f"{study.method.loss_limit:g}",
        "archfrag_study": study.id,
        "archfrag_config": strict_json(config),
        "archfrag_inputs_sha256": strict_json(_by_name(inputs["record"])),
        "archfrag_index_sha256": strict_json(_by_name(inputs["index"])),
        "archfrag_inventories_sha256": strict_json(_by_name(inputs["inventory"])),
        "archfrag_processing": strict_json(
            [{"step": step.name, "settings": step.settings} for step in study.motions.processing]
        ),
        "archfrag_versions": strict_json(versions()),
        "archfrag_commit": commit(),
        "archfrag_machine": platform.machine(),
        "archfrag_plan": digest_of(plan.digests),
    }


def _portable_arch(entry: ArchEntry) -> dict[str, Any]:
    """An entry as a study gives it, defaults filled in, without folders."""
    if entry.table is not None:
        return {**entry.parameters, "table": Path(entry.table).name}
    facts = {"id": entry.id, **entry.build().parameters}
    if entry.drawing is not None:
        facts |= {"drawing": Path(entry.drawing).name, "sha256": sha256_if_there(entry.drawing)}
    if entry.vary is not None:
        facts["vary"] = entry.vary.model_dump(exclude_none=True)
    return facts


def _by_name(digests: dict[str, str]) -> dict[str, str]:
    """Digests by the shortest ends of their paths that distinguish all: no place, only names."""
    paths = [Path(path).parts for path in digests]
    for size in range(1, max(map(len, paths), default=1) + 1):
        ends = ["/".join(parts[-size:]) for parts in paths]
        if len(set(ends)) == len(ends):
            break
    return dict(zip(ends, digests.values()))


def _variable(about: Variable, values: Any) -> "xr.Variable":
    """Values with CF's attributes and the names of the coordinates that they belong to."""
    import xarray as xr

    dimensions = about.dimensions.replace("run", " ".join(_RUN)).split()
    stated = {"long_name": about.long_name, "units": about.units, "comment": about.comment}
    attrs: dict[str, Any] = {name: text for name, text in stated.items() if text}
    level = "intensity" if "record" in dimensions else "level"
    labels = [level if name == "level" else name for name in dimensions]
    labels = [name for name in labels if name != about.name]
    encoding: dict[str, Any] = {"coordinates": " ".join(labels) or None}
    if about.dtype == "S":
        # Text as characters: CF's form that every version of every reader knows.
        length = max(1, *(len(text.encode()) for text in values))
        encoding |= {"dtype": "S1", "char_dim_name": f"text{length}"}
        return xr.Variable(dimensions, np.array(values, object), attrs, encoding)
    array = np.asarray(values, dtype=about.dtype)
    if about.flags:
        attrs["flag_values"] = np.array(list(about.meanings), dtype=about.dtype)
        attrs["flag_meanings"] = " ".join(about.meanings.values())
    # One arch at a time, so that who reads one reads no more; of very many runs some records.
    sizes = list(array.shape)
    if tuple(dimensions[: len(_RUN)]) == _RUN:
        of_record = max(1, int(np.prod(sizes[2:])))
        sizes[:2] = [1, min(sizes[1], max(1, LARGEST_CHUNK // of_record))]
    encoding |= {
        "zlib": True, "complevel": COMPRESSION,
        "chunksizes": tuple(max(1, size) for size in sizes),
        "_FillValue": float(about.fill) if about.fill else None,
    }  # fmt: skip
    return xr.Variable(dimensions, array, attrs, encoding)


def _arch_facts(arches: Members) -> dict[str, "xr.Variable"]:
    from archfrag.simulate import onset
    from archfrag.simulation.rest import static_limit

    built = [entry.build() for entry in arches.entries]
    starts = [onset(arch) for arch in built]
    values = {
        "arch": arches.ids,
        "arch_class": arches.classes,
        "onset_plus": [start.plus for start in starts],
        "onset_minus": [start.minus for start in starts],
        "static_limit": [static_limit(arch, start) for arch, start in zip(built, starts)],
        "joint_length": [
            np.linalg.norm(arch.extrados - arch.intrados, axis=1).mean() for arch in built
        ],
    }
    facts = {name: _variable(VARIABLES[name], each) for name, each in values.items()}
    for name, numbers in arches.parameters().items():
        units, text = _ARCH_UNITS.get(name, "1"), f"{name} of the arch"
        about = Variable(f"arch_{name}", "arch", "f8", units, "nan", long_name=text)
        facts[about.name] = _variable(about, numbers)
    for name, texts in arches.attributes().items():
        # Names in files have letters, digits and _ only; long_name is as in the table.
        plain = re.sub("[^A-Za-z0-9_]", "_", f"attribute_{name}")
        while plain in facts:
            plain += "_"
        about = Variable(plain, "arch", "S", long_name=f"{name} of the arch")
        facts[plain] = _variable(about, texts)
    return facts
