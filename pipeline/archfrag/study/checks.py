"""A study to start from, and checks of a study before anything is computed."""

import base64
import errno
import math
import os
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.errors import InputError, OutputError
from archfrag.files import cannot_write, counted, make_folder
from archfrag.study.file.members import Members, check_standing, checked
from archfrag.study.file.records import (
    VERTICAL_LEFT,
    PreparedRecord,
    described,
    find_sources,
    read_sources,
)
from archfrag.study.file.schema import Study, study_schema
from archfrag.study.files import PACKAGE, read_owner, refuse_foreign_cube

# Beyond these a unit may have been mistaken: friction, size [m], levels over the onset.
MOST_FRICTION, LARGEST, FAR_BEYOND = 2.0, 300.0, 10.0
LARGEST_LOGO = 500_000  # [bytes]
MOST_ASKED = 12  # arches, records
CORRECTING = {"detrend", "bandpass", "baseline", "response"}  # steps of processing


def shipped_folder() -> Path:
    """Folder with Snakefile, rules and records: the checkout, or one of the installed package."""
    for folder in (PACKAGE.parents[1], PACKAGE / "workflow"):
        if (folder / "Snakefile").is_file() and (folder / "pipeline" / "rules").is_dir():
            return folder
    raise OutputError(f"{PACKAGE}: this installation has no Snakefile; install archfrag again")


def write_starter(folder: Path) -> Path:
    """Write a commented study file, its schema and the shipped motions; the study file last."""
    records, schema, study = (folder / n for n in ("records", "study.schema.json", "study.yaml"))
    for path in (records, schema, study):
        if os.path.lexists(path):
            raise OutputError(f"{path}: exists already; choose a folder without it")
    make_folder(folder)
    try:
        shutil.copytree(shipped_folder() / records.name / "near_source", records)
        schema.write_text(study_schema())
        shutil.copyfile(PACKAGE / "study" / "templates" / study.name, study)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return study


def uncorrected(study: Study, records: Sequence[PreparedRecord]) -> tuple[str, ...]:
    """Message on raw records that the study does not correct."""
    names = [record.id for record in records if record.raw]
    if not names or CORRECTING & dict(study.motions.steps).keys():
        return ()
    return (
        f"{len(names)} of {counted(len(records), 'record')} raw, as recorded ("
        f"{', '.join(names[:MOST_ASKED])}{', …' * (len(names) > MOST_ASKED)}): their drift counts "
        "as motion; correct them by motions.processing, such as [detrend, {bandpass: {lowest: "
        "0.1, highest: 25}}]",
    )


def unit_warnings(study: Study, found: Members) -> tuple[str, ...]:
    """Warn of values so unusual that a unit may be wrong; of the first arches."""
    from archfrag.simulate import onset
    from archfrag.simulation.rest import stays_at_rest

    levels = np.array(study.intensity.si) / STANDARD_GRAVITY
    known = study.intensity.measure == "PGA" and not study.motions.vertical
    messages = []
    for member in found[:MOST_ASKED]:
        arch = member.entry.build()
        friction = max(filter(math.isfinite, arch.chain.friction.tolist()), default=0.0)
        size, start = float(np.ptp(arch.chain.centroid, axis=0).max()), onset(arch)
        least = min(start.plus, start.minus)
        where = f"the onset of motion ({least:.3g} g); is their unit right?"
        messages += [f"{member.id}: {text}" for wrong, text in (
            (friction > MOST_FRICTION, f"the coefficient of friction {friction:.3g} is greater "
             "than that of any masonry; was an angle meant?"),
            (size > LARGEST, f"the arch is {size:.0f} m large; lengths are in m"),
            (known and stays_at_rest(levels.max(), start), f"no level is above {where}"),
            (known and levels.min() > FAR_BEYOND * least,
             f"all levels are more than {FAR_BEYOND:.0f} times {where}"),
        ) if wrong]  # fmt: skip
    return tuple(messages)


def logo_url(logo: str) -> str:
    """A picture as a data URL; InputError if it is missing, too large or of another kind."""
    path = Path(logo)
    kind = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".svg": "svg+xml"}.get(path.suffix)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"report.logo: {path}: {error.strerror}") from None
    if kind is None or len(content) > LARGEST_LOGO:
        raise InputError(f"report.logo: {path}: must be PNG, JPEG or SVG of at most 500 kB")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def check_start(study: Study) -> None:
    """Check hazard, logo, and that the output folder may take results; nothing is created."""
    if (risk := study.risk) is not None:
        from archfrag.hazard import load_hazard

        load_hazard([Path(risk.hazard)], study.intensity.measure, risk.unit, risk.site)
    if study.report.logo is not None:
        logo_url(study.report.logo)
    folder = study.folder
    try:
        place = next(path for path in (folder, *folder.parents) if path.exists())
        if not place.is_dir() or not os.access(place, os.W_OK | os.X_OK):
            code = errno.EACCES if place.is_dir() else errno.ENOTDIR
            raise OSError(code, os.strerror(code))
    except OSError as error:
        raise cannot_write(folder, error) from error
    refuse_foreign_cube(study)
    owner = read_owner(study).get("id", study.id)
    if owner != study.id:
        whose = f"holds results of study {owner!r}, not of study {study.id!r}"
        raise OutputError(f"{study.folder}: {whose}; give the studies different output folders")


def check_study(study: Study) -> dict[str, Any]:
    """Check all of a study without running it: arches stand, records are read and scaled.

    Returned are numbers of things, of runs exactly, about or at most (``extent``), and texts.
    """
    check_start(study)
    records, partners, unused = [], [], set[str]()
    every = study.motions.model_copy(update={"vertical": True})
    beside = {source.path.name for source in find_sources(every, study.intensity.measure)
              if "vertical" in source.others}  # fmt: skip
    for motion in read_sources(study.motions, study.intensity.measure):
        records.append(described(study, motion))
        about = motion.metadata
        others = [about.get("file_transverse"), about.get("vertical_file")]
        if used := " and ".join(name for name in others if name and name != about["file"]):
            partners.append(f"{about['file']} with {used}")
        if motion.vertical is None and (about["file"] in beside or VERTICAL_LEFT in motion.log):
            unused.add(records[-1].id)
    if unused:
        partners.append(f"{len(unused)} of {counted(len(records), 'record')} have a vertical "
                        "component that is not used; motions.vertical: true uses it")
    found, design, levels = study.members, study.design, len(study.intensity.si)
    some = checked(found)
    check_standing(some)
    size, extent = design.size(len(records), levels)
    sizes_of, ids = Counter(member.arch_class for member in found), {member.id for member in found}
    cautions = unit_warnings(study, found) + uncorrected(study, records)
    if unchecked := len(found) - len(some):
        left = f"{unchecked} of {len(found)} arches were not checked"
        cautions += (f"{left}; the run checks all of them before it simulates",)
    return {
        "study": study.id, "arches": len(found), "records": len(records), "levels": levels,
        "design": design.kind, "runs": size * len(found), "extent": extent,
        "classes": tuple(f"{name}: {counted(n, 'arch')}" for name, n in sizes_of.items()
                         if name not in ids),
        "cautions": cautions, "partners": tuple(partners),
    }  # fmt: skip
