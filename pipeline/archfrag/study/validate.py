"""A study to start from, and checks of a study before anything is computed."""

import base64
import contextlib
import errno
import os
import re
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.arch.drawing import read_drawing
from archfrag.arch.facts import facts_text, unit_cautions
from archfrag.errors import ArchfragError, InputError, OutputError
from archfrag.files import cannot_write, counted, make_folder, read_bytes
from archfrag.properties import LATER, unusual
from archfrag.simulation.rest import stays_at_rest
from archfrag.simulation.simulate import onset
from archfrag.simulation.standing import arch_cautions, joints_text
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import Members, check_standing, checked
from archfrag.study.file.prepared import PreparedRecord, described, in_order
from archfrag.study.file.schema import StudyKeys, study_schema
from archfrag.study.file.sources import (
    VERTICAL_LEFT,
    find_sources,
    first_shocks,
    read_sources,
)
from archfrag.study.hazard import level_cautions, load_hazard
from archfrag.study.products import check_outputs, step_names
from archfrag.study.provenance import OWNER, PACKAGE, read_state

# Beyond these a unit may have been mistaken: size [m], levels over the onset.
LARGEST = 300.0
FAR_BEYOND = 10.0
LARGEST_LOGO = 500_000  # [bytes]
PICTURES = {
    "png": b"\x89PNG\r\n\x1a\n",
    "jpeg": b"\xff\xd8\xff",
}  # kinds, and how they begin
MOST_ASKED = 12  # arches, records


def shipped_folder() -> Path:
    """Return the folder of Snakefile, rules and records: the checkout, or one of the package."""
    for folder in (PACKAGE.parents[1], PACKAGE / "workflow"):
        if (folder / "Snakefile").is_file() and (
            folder / "pipeline" / "rules"
        ).is_dir():
            return folder
    raise OutputError(
        f"{PACKAGE}: this installation has no Snakefile; install archfrag again"
    )


def write_starter(folder: Path) -> Path:
    """Write a commented study file, its schema and the shipped motions; the study file last."""
    records, schema, study = (
        folder / n for n in ("records", "study.schema.json", "study.yaml")
    )
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


def suspicious(records: Sequence[PreparedRecord]) -> tuple[str, ...]:
    """Return cautions on files and samples of records, each with the records that it is on."""
    alike: dict[str, list[str]] = {}
    for record in records:
        for text in record.cautions:
            # Numbers differ from record to record.
            alike.setdefault(re.sub(r"\d[\d.e+-]*", "#", text), []).append(
                f"{record.id}: {text}"
            )
    return tuple(
        f"{first} (and {len(more)} more of {counted(len(records), 'record')})"
        if more
        else first
        for first, *more in alike.values()
    )


def unit_warnings(study: StudyKeys, found: Members) -> tuple[str, ...]:
    """Warn of values so unusual that a unit may be wrong, and of what a drawing has more.

    Only the first arches are looked at.
    """
    levels = np.array(study.intensity.si) / STANDARD_GRAVITY
    known = study.intensity.measure == "PGA" and not study.motions.vertical
    found_of: dict[str, list[str]] = {}  # ids of the arches of which a text is true
    for entry in study.arches[:MOST_ASKED]:
        for text in read_from_drawing(entry)[1:] if entry.drawing else ():
            found_of.setdefault(text, []).append(entry.id)
    for member in found[:MOST_ASKED]:
        arch = member.entry.build()
        size = float(np.ptp(arch.centroids, axis=0).max())
        start = onset(arch)
        # The smallest spread lowers the onset to almost nothing, and collapse hardly.
        built = start if arch.built is None else onset(arch.built)
        least = min(start.plus, start.minus)
        most = min(built.plus, built.minus)
        where = "the onset of motion ({:.3g} g); is their unit right?"
        for wrong, text in (
            *((True, text) for text in unit_cautions(arch)),
            *(
                (True, text)
                for text in unusual("thickness_factor", member.entry.thickness_factor)
            ),
            (size > LARGEST, f"the arch is {size:.0f} m large; lengths are in m"),
            (
                known and stays_at_rest(levels.max(), start),
                f"no level is above {where.format(least)}",
            ),
            (
                known and levels.min() > FAR_BEYOND * most,
                f"all levels are more than {FAR_BEYOND:.0f} times {where.format(most)}",
            ),
            *((True, text) for text in arch_cautions(arch, start)),
        ):
            if wrong:
                found_of.setdefault(text, []).append(member.id)
    asked = study.intensity
    levels_asked = (
        [] if known else level_cautions(asked.measure, asked.si, "intensity.levels")
    )
    return tuple(levels_asked) + tuple(
        f"{first}{f' and {len(more)} more' * bool(more)}: {text}"
        for text, (first, *more) in found_of.items()
    )


def read_from_drawing(entry: ArchEntry) -> list[str]:
    """Return a text on the blocks of a drawing, span first, and a caution if it shows more."""
    path = Path(str(entry.drawing))
    drawn = read_drawing(path, entry.layer, entry.unit)
    layer = f"layer {drawn.layer}"
    unit = drawn.unit
    added = ("piers", "fill", *LATER, "vary")
    arch = entry.model_copy(update=dict.fromkeys(added)).build()
    size, high, thick = arch.dimensions
    kind = "clear span"
    rise = f", rise {high:.3g} m"
    if arch.free_end:
        kind = "height"
        rise = ""
        size = float(np.ptp(np.concatenate(arch.outlines)[:, 1]))
    whole = repr(arch)[1:-1].partition(": ")[2]
    text = f"{kind} {size:.3g} m{rise}, mean thickness {thick:.3g} m; {whole}"
    text += f"; from {path.name}, {layer}, in {unit}"
    return [text, *filter(None, [drawn.caution])]


def arch_texts(study: StudyKeys) -> tuple[str, ...]:
    """Return weights, forces and places of the first arches of a study, one of each class."""
    first = {
        each.arch_class: each for each in reversed(study.members) if not each.shock
    }
    texts = list[str]()
    for member in list(reversed(first.values()))[:MOST_ASKED]:
        arch = member.entry.build()
        names = ", ".join(member.attributes)
        other = f"columns that change no arch: {names}" if names else ""
        told = "; ".join(filter(None, (facts_text(arch), joints_text(arch), other)))
        texts.append(f"{member.id}: {told}")
    return tuple(texts)


def logo_url(logo: str) -> str:
    """Return a picture as a data URL; InputError if it is missing, too large or of another kind.

    Its kind follows from its content: the first bytes of PNG and JPEG, the root element of SVG.
    """
    content = read_bytes(
        Path(logo), LARGEST_LOGO, InputError, "report.logo: the picture"
    )
    kind = next(
        (kind for kind, start in PICTURES.items() if content.startswith(start)), None
    )
    if kind is None:
        roots = list[str]()
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler = lambda name, attributes: roots.append(name)
        with contextlib.suppress(expat.ExpatError):
            parser.Parse(content, True)
            kind = "svg+xml" if roots[0] == "http://www.w3.org/2000/svg svg" else None
    if kind is None:
        kinds = f"PNG, JPEG or SVG of at most {LARGEST_LOGO / 1000:g} kB"
        raise InputError(f"report.logo: {logo} holds no picture; it must be {kinds}")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def check_start(study: StudyKeys) -> tuple[str, ...]:
    """Check hazard, logo, and that the output folder may take results; nothing is created.

    Returned is what was assumed of the hazard, and what is unusual in it.
    """
    messages: tuple[str, ...] = ()
    if (risk := study.risk) is not None:
        hazard = load_hazard(
            [Path(risk.hazard)], study.intensity.measure, risk.unit, risk.site
        )
        messages = hazard.messages
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
    check_outputs(study, step_names(study))
    owner = read_state(study.work / OWNER).get("id", study.id)
    if owner != study.id:
        whose = f"holds results of study {owner!r}, not of study {study.id!r}"
        raise OutputError(
            f"{study.folder}: {whose}; give the studies different output folders"
        )
    return messages


def check_study(study: StudyKeys) -> dict[str, Any]:
    """Check all of a study without running it: arches stand, records are read and scaled.

    Returned are numbers of things, of runs exactly, about or at most (``extent``), and texts.
    Errors of hazard or folder, of records and of arches are raised together.
    """
    errors = list[ArchfragError]()
    some = checked(study.members)
    records = list[PreparedRecord]()
    partners = list[str]()
    hazard = list[str]()
    for check in (
        lambda: hazard.extend(check_start(study)),
        lambda: check_standing(some, study.method),
        lambda: _read_records(study, records, partners),
    ):
        try:
            check()
        except ArchfragError as error:
            errors.append(error)
    if errors:
        several = "\n  ".join([f"{len(errors)} errors:", *map(str, errors)])
        raise type(errors[0])(several) if errors[1:] else errors[0]
    found = study.members
    design = study.design
    levels = len(study.intensity.si)
    size, extent = design.size(len(records), levels)
    sizes_of = Counter(member.arch_class for member in found)
    ids = {member.id for member in found}
    cautions = unit_warnings(study, found) + suspicious(records) + tuple(hazard)
    if unchecked := len(found) - len(some):
        left = f"{unchecked} of {len(found)} arches were not checked"
        cautions += (f"{left}; the run checks all of them before it simulates",)
    drawn = [
        entry
        for entry in (*study.arches, *(member.entry for member in some))
        if entry.drawing and not entry.table
    ][:MOST_ASKED]
    drawings = [f"{entry.id}: {read_from_drawing(entry)[0]}" for entry in drawn]
    return {
        "study": study.id,
        "arches": len(found),
        "records": len(records),
        "levels": levels,
        "design": design.kind,
        "runs": size * len(found),
        "extent": extent,
        "classes": tuple(
            f"{name}: {counted(n, 'arch')}"
            for name, n in sizes_of.items()
            if name not in ids
        ),
        "cautions": cautions,
        "partners": tuple(partners),
        "drawings": tuple(drawings),
        "facts": arch_texts(study),
    }


def _read_records(
    study: StudyKeys, records: list[PreparedRecord], partners: list[str]
) -> None:
    """Read the records of a study, and say which files belong together."""
    unused = set[str]()
    every = study.motions.model_copy(update={"vertical": True})
    partnered = {
        source.path.name
        for source in find_sources(every, study.intensity.measure)
        if "vertical" in source.others
    }
    for motion in read_sources(study.motions, study.intensity.measure):
        records.append(described(study, motion, ()))
        about = motion.metadata
        others = [about.get("file_transverse"), about.get("vertical_file")]
        if used := " and ".join(
            name for name in others if name and name != about["file"]
        ):
            partners.append(f"{about['file']} with {used}")
        if motion.vertical is None and (
            about["file"] in partnered or VERTICAL_LEFT in motion.log
        ):
            unused.add(records[-1].id)
    records[:] = in_order(study.motions, records)
    first = first_shocks(
        study.motions,
        records,
        lambda asked: [
            described(study, motion, ())
            for motion in read_sources(asked, study.intensity.measure)
        ],
    )
    if pairs := [f"{one.id} before {record.id}" for one, record in zip(first, records)]:
        more = len(pairs) - MOST_ASKED
        listed = ", ".join(pairs[:MOST_ASKED]) + f" and {more} more" * (more > 0)
        partners.append(f"first shocks: {listed}")
    if unused:
        what = (
            "have a vertical component that is not used; motions.vertical: true uses it"
        )
        partners.append(f"{len(unused)} of {counted(len(records), 'record')} {what}")
