"""The cube: all parts of a study in one CF-1.11 netCDF file, which states how it was made."""

import contextlib
import platform
import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends.locks import HDF5_LOCK, NETCDFC_LOCK, combine_locks

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.files import Named, counted, make_folder, replacing
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.measures import measure_unit, scaling_exponent
from archfrag.physics.status import CollapseMode, Level, Status
from archfrag.properties import UNITS
from archfrag.simulation.rest import static_limit
from archfrag.simulation.simulate import onset
from archfrag.study import provenance
from archfrag.study.designs import Cases
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import Members
from archfrag.study.file.prepared import read_manifest
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import strict_json
from archfrag.study.runs.store import COLUMNS, VARIABLES, Plan, Table, gather, make_plan
from archfrag.system import give_back_memory
from archfrag.version import __version__

COMPRESSION = 4
LARGE = 2 * 10**7  # bytes of a cube: 10^5 runs, below which memory does not matter
_LOCK = combine_locks([HDF5_LOCK, NETCDFC_LOCK])  # as xarray takes for each file
# cells of a variable that the file stores together: whole arches, up to 1 MB
CHUNK = 2**17
_CODES: Named = {codes.__name__: codes for codes in (Verdict, Status, CollapseMode)}
_UDUNITS = {
    "m/s2": "m s-2",
    "cm/s2": "cm s-2",
    "gal": "cm s-2",
    "g": "9.80665 m s-2",
    "m/s": "m s-1",
    "cm/s": "cm s-1",
    "m": "m",
    "cm": "cm",
    "s": "s",
}


def write_cube(study: StudyKeys) -> Path:
    """Gather the parts of a study into its cube, written completely or not at all.

    InputError if results of runs are missing, OutputError if the file cannot be written.
    """
    provenance.refuse_foreign_cube(study)
    plan = make_plan(study)
    cube = build_cube(plan, *gather(plan))
    path = make_folder(study.folder) / provenance.CUBE
    with replacing(path) as temporary, provenance.NETCDF:
        try:
            # xarray's own way imports distributed, to see whether a client writes.
            store = xr.backends.NetCDF4DataStore.open(temporary, "w", lock=_LOCK)
            with contextlib.closing(store):
                cube.dump_to_store(store)
        except RuntimeError as error:  # netCDF's word for a disk that is full
            raise OSError(str(error)) from error
    large = cube.nbytes > LARGE
    del cube
    if large:
        give_back_memory()
    return path


def build_cube(
    plan: Plan, cases: Cases, table: Table, facts: dict[int, Named]
) -> xr.Dataset:
    """Return the cube of a study's runs in the form that is stored.

    `cases`, `table` and `facts` are what `gather` returns. The dimension of levels is intensity in
    the study's unit, beside ``intensity_si``; it is level if each run has an intensity of its own.
    The cube takes about 600 bytes of memory a run.
    """
    study = plan.study
    regular = study.design.on_levels
    asked = study.intensity
    records = plan.records
    names = list(records[0].measures)
    shape = (len(plan.arches), len(records), len(plan.levels) if regular else 1)

    def filled(values: NDArray, missing: float) -> NDArray:
        cube = np.full((*shape, *values.shape[1:]), missing, values.dtype)
        cube[cases["arch"], cases["record"], cases["place"]] = values
        return cube

    values: Named = {
        "level": np.arange(shape[2]),
        "model": [model.name.lower() for model in Level],
        "measure": names,
        "measure_unit": list(map(measure_unit, names)),
        "measure_exponent": list(map(scaling_exponent, names)),
        "record_measure": [list(record.measures.values()) for record in records],
        "intensity": plan.levels,
        "scale_factor": plan.unscaled[:, None] * plan.levels**plan.power,
    }
    unit = _UDUNITS[measure_unit(asked.measure)]
    name = f"{asked.measure} of the scaled record"
    about = dict(VARIABLES)
    about["first_shock"] = about["first_shock"]._replace(units=unit)
    about["intensity"] = about["intensity"]._replace(units=unit, long_name=name)
    if study.motions.before is not None:
        values["first_shock"] = [sum(member.shock[:1]) for member in plan.arches]
        if any(values["first_shock"]):
            before = [record.first for record in records if record.first]
            values["first_record"] = [each.id for each in before]
            values["first_event"] = [each.event or each.id for each in before]
    if not regular:
        values["intensity"] = filled(cases["level"], np.nan)
        values["scale_factor"] = filled(plan.factors(cases), np.nan)
        for name in ("intensity", "scale_factor"):
            about[name] = about[name]._replace(dimensions="run")
    for each in VARIABLES.values():
        if each.dimensions == "record" and each.source:
            found = [getattr(record, each.source) for record in records]
            values[each.name] = [np.nan if value is None else value for value in found]
    for each in (*COLUMNS, VARIABLES["model_time"]):
        values[each.name] = filled(table[each.name], float(each.missing))
    built = [member.entry.build() for member in plan.arches]
    if any(arch.places for arch in built):
        values |= _places(built, values)
    if not (values["moving_before"] == 1).any():
        del values["moving_before"]
    values["lost_contact_and_stand"] = (
        np.isfinite(values["lost_contact_time"])
        & (values["verdict"] == Verdict.SURVIVED)
    ).sum(axis=1)
    variables = _arch_variables(plan.arches, built)
    variables |= {name: _variable(about[name], each) for name, each in values.items()}
    si = variables["intensity"]
    si.attrs["measure"] = asked.measure
    variables["intensity_si"] = si
    variables["intensity"] = xr.Variable(
        si.dims,
        [*asked.given] if regular else si.values / asked.factor,
        si.attrs | {"units": _UDUNITS[asked.unit], "unit": asked.unit},
        {"_FillValue": None},  # CF's rule for a variable of a dimension
    )
    of_arches = {plan.arches[arch].id: own for arch, own in sorted(facts.items())}
    design = study.design.model_dump(mode="json") | {"arches": of_arches}
    stated = attributes(study, plan) | {"archfrag_design": strict_json(design)}
    cube = xr.Dataset(variables, attrs=stated)
    return cube.swap_dims(level="intensity") if regular else cube


def open_cube(study: StudyKeys) -> xr.Dataset:
    """Read the cube of a study into memory, in the form in which this package uses it.

    The dimension of levels is level, intensities are in SI units, and verdicts are codes without a
    missing value. InputError if there is none or it is damaged, OutputError if it is another
    study's.
    """
    cube = stored_cube(study)
    if "intensity" in cube.dims:
        cube = cube.swap_dims(intensity="level")
    stored = cube["verdict"]
    codes = stored.fillna(Verdict.NOT_RUN).astype("i1").assign_attrs(stored.attrs)
    codes.encoding = stored.encoding
    cube["verdict"] = codes
    return cube.drop_vars("intensity").rename(intensity_si="intensity")


def stored_cube(study: StudyKeys) -> xr.Dataset:
    """Read the cube of a study into memory, as it is stored; errors as for `open_cube`."""
    path = study.folder / provenance.CUBE
    provenance.refuse_foreign_cube(study)
    try:
        with provenance.NETCDF, xr.open_dataset(path) as cube:
            if cube.nbytes > LARGE:
                give_back_memory()  # of steps before
            cube.load()
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: is missing or damaged; `archfrag cube` on the study file makes it"
        ) from error
    if cube.nbytes > LARGE:
        give_back_memory()  # of the netCDF library, half as much as the cube takes
    return cube


def _variable(about, values) -> xr.Variable:
    """Return values as a variable with CF's attributes; `about` is its row of `VARIABLES`."""
    dimensions = about.dimensions.replace("run", "arch record level").split()
    attrs: Named = {
        name: getattr(about, name)
        for name in ("long_name", "units", "comment")
        if getattr(about, name)
    }
    labels = [name for name in dimensions if name not in (about.name, "level")]
    if {"level", "record"} <= {*dimensions}:
        labels += ["intensity_si", "level"]
    encoding: Named = {"coordinates": " ".join(labels) or None}
    if about.dtype == "S":
        # Text as characters: CF's form that every version of every reader knows.
        texts = np.array(values, object)
        length = max(1, *(len(text.encode()) for text in texts.flat))
        encoding |= {"dtype": "S1", "char_dim_name": f"text{length}"}
        return xr.Variable(dimensions, texts, attrs, encoding)
    array = np.asarray(values, dtype=about.dtype)
    fill: Any = array.dtype.type(about.fill) if about.fill else None
    if about.flags:
        meanings = dict(enumerate(about.flags.split()))
        if about.flags in _CODES:
            codes = {int(code): code.name.lower() for code in _CODES[about.flags]}
            meanings = {int(about.missing): "not_run"} | codes
        meanings.pop(fill, None)
        kept = sorted(meanings)
        attrs["flag_values"] = np.array(kept, dtype=about.dtype)
        attrs["flag_meanings"] = " ".join(meanings[code] for code in kept)
    sizes = list[int]()
    cells = CHUNK
    for size in reversed(array.shape):
        sizes.insert(0, min(size, cells))
        cells = max(cells // size, 1)
    encoding |= {"zlib": True, "complevel": COMPRESSION, "chunksizes": tuple(sizes)}
    encoding["_FillValue"] = fill
    return xr.Variable(dimensions, array, attrs, encoding)


def _places(built: Sequence[Arch], values: Named) -> Named:
    """Return the places and parts of the joints in the columns of a cube, by variable."""
    found = defaultdict(list)
    for number, arch in enumerate(built):
        place = [*map(arch.place, range(arch.n_joint))]
        part = [each.rpartition(", ")[0] or arch.parts[0].name for each in place]
        for name, names in (
            ("collapse_place", place),
            ("collapse_part", part),
            ("lost_contact_place", place),
        ):
            joint = values[f"{name.rpartition('_')[0]}_joint"][number]
            found[name].append(np.array([*names, ""])[joint])  # -1 where none was lost
    return {name: np.stack(each) for name, each in found.items()}


def _arch_variables(arches: Members, built: Sequence[Arch]) -> dict[str, xr.Variable]:
    """Return the variables of arches: names, onsets, and the values and texts of their entries."""
    rows = [member.row for member in arches]
    spans = [len(arch.spans) for arch in built]
    starts = [onset(arch) for arch in built]
    # What a joint of rigid bodies would bear is no bound of one that gives.
    gives = [arch.chain.joint is not None for arch in built]
    values = {
        "arch": [member.id for member in arches],
        "arch_class": [member.arch_class for member in arches],
        **({"stock_row": rows} if any(rows) else {}),
        "onset_plus": np.where(gives, np.nan, [start.plus for start in starts]),
        "onset_minus": np.where(gives, np.nan, [start.minus for start in starts]),
        **({"spans": spans} if max(spans) > 1 else {}),
        "static_limit": list(map(static_limit, built, starts)),
        "joint_length": [arch.dimensions[2] for arch in built],
    }
    found = {name: _variable(VARIABLES[name], each) for name, each in values.items()}
    about = VARIABLES["arch"]
    for name in dict.fromkeys(name for member in arches for name in member.values):
        plain = f"arch_{name}".replace(".", "_")
        own = about._replace(
            name=plain,
            dtype="f8",
            units=UNITS.get(name, "1"),
            fill="nan",
            long_name=f"{name} of the arch",
        )
        numbers = [each.values.get(name, each.entry.number(name)) for each in arches]
        found[plain] = _variable(own, numbers)
    for name in dict.fromkeys(name for member in arches for name in member.attributes):
        # Names in files have letters, digits and _ only; long_name is as in the table.
        plain = re.sub("[^A-Za-z0-9_]", "_", f"attribute_{name}")
        while plain in found:
            plain += "_"
        own = about._replace(name=plain, long_name=f"{name} of the arch")
        found[plain] = _variable(
            own, [each.attributes.get(name, "") for each in arches]
        )
    return found


def attributes(study: StudyKeys, plan: Plan) -> dict[str, str]:
    """Return the global attributes of a cube.

    They are the same on every run of the same study with this code.
    """
    inputs = read_manifest(study)["inputs"]
    about = study.intensity
    facts = {
        "config": {
            "id": study.id,
            "title": study.title,
            "arches": [_portable_arch(entry) for entry in study.arches],
            "intensity": {**about.model_dump(), "levels": list(about.given)},
            "method": study.method.model_dump(),
            "design": study.design.model_dump(),
        },
        "inputs_sha256": _by_name(inputs["record"]),
        "index_sha256": _by_name(inputs["index"]),
        "inventories_sha256": _by_name(inputs["inventory"]),
        "processing": [
            {"step": name, "settings": given} for name, given in study.motions.steps
        ],
        "versions": provenance.versions(),
    }
    if study.motions.before:
        pairs = {each.id: each.first.id for each in plan.records if each.first}
        facts["first_shocks"] = {
            "gap": study.motions.before.gap,
            "records": list(dict.fromkeys(pairs.values())),
            "before": pairs,
        }
    own = any(record.levels for record in plan.records)
    count = sum(record.vertical for record in plan.records)
    of = len(plan.records)
    vertical = "used" if count else "not used"
    if 0 < count < of:
        vertical = f"used for {count} of {of} records"
    return {
        "Conventions": "CF-1.11",
        "title": study.title,
        "institution": study.institution,
        "source": f"rigid-block simulations with archfrag {__version__}, method "
        f"{study.method.name}",
        "vertical_component": vertical,
        "history": "Records read, processed and scaled to levels of the intensity measure; "
        f"simulations as the design {study.design.kind} asks for them; results gathered by "
        "archfrag.",
        "references": "A. Sinopoli, A semi-analytical approach for masonry arch dynamics; the "
        "README of archfrag",
        "comment": f"{counted(len(plan.arches), 'arch')} under {counted(of, 'record')} scaled by "
        f"{about.measure}. Wall times and machine are in a log beside this file.",
        "loss_limit": f"{study.method.loss_limit:g}",
        "archfrag_study": study.id,
        **({"archfrag_levels": "each record at those of its index"} if own else {}),
        **{f"archfrag_{name}": strict_json(fact) for name, fact in facts.items()},
        "archfrag_commit": provenance.commit(),
        "archfrag_machine": platform.machine(),
        "archfrag_plan": provenance.digest_of(
            [plan.identity, facts, [member.chain for member in plan.arches]]
        ),
    }


def _portable_arch(entry: ArchEntry) -> Named:
    """Return the keys of an entry with defaults filled in; files are named without folders."""
    if entry.table is not None:
        return {**entry.parameters, "table": Path(entry.table).name}
    facts = {"id": entry.id, **entry.build().parameters}
    if entry.drawing is not None:
        sha256 = provenance.sha256_if_there(entry.drawing)
        facts |= {"drawing": Path(entry.drawing).name, "sha256": sha256}
    if entry.vary is not None:
        facts["vary"] = entry.vary.model_dump(exclude_none=True)
    return facts


def _by_name(digests: dict[str, str]) -> dict[str, str]:
    """Return digests by the ends of their paths, as short as possible while all ends differ.

    So the names of the digests do not depend on where the files are.
    """
    size = 0
    ends = list[str]()
    while len({*ends}) < len(digests):
        size += 1
        ends = ["/".join(Path(path).parts[-size:]) for path in digests]
    return dict(zip(ends, digests.values()))
