"""A study to start from, and checks of a study before anything is computed."""

import base64
import contextlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.parsers import expat

import numpy as np

from archfrag.arch import STANDARD_GRAVITY
from archfrag.arch.drawing import read_drawing
from archfrag.arch.facts import facts_text, unit_cautions
from archfrag.errors import ArchfragError, InputError, OutputError
from archfrag.files import Named, cannot_write, counted, make_folder, read_bytes
from archfrag.properties import LATER, unusual
from archfrag.simulation.rest import stays_at_rest
from archfrag.simulation.simulate import onset
from archfrag.simulation.standing import arch_cautions, joints_text
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.members import Member, Members, check_standing, checked
from archfrag.study.file.motions import pairs_text
from archfrag.study.file.prepared import PreparedRecord, levels_asked, read_records
from archfrag.study.file.schema import StudyKeys, study_schema
from archfrag.study.file.sources import VERTICAL_LEFT, find_sources
from archfrag.study.hazard import level_cautions, load_hazard
from archfrag.study.provenance import OWNER, PACKAGE, check_outputs, read_state

# Beyond these a unit may have been mistaken: size [m], levels over the onset.
LARGEST = 300.0
FAR_BEYOND = 10.0
LARGEST_LOGO = 500_000  # [bytes]
PICTURES = {
    "png": b"\x89PNG\r\n\x1a\n",
    "jpeg": b"\xff\xd8\xff",
}  # kinds, and how they begin
MOST_ASKED = 12  # arches that are described or examined for wrong units
_LEVELS = "intensity.levels"


def shipped_folder() -> Path:
    """Return the folder of Snakefile, rules and records: the checkout, or a folder of the package.

    OutputError if there is none.
    """
    for folder in (PACKAGE.parents[1], PACKAGE / "workflow"):
        if (folder / "Snakefile").is_file() and (folder / "pipeline/rules").is_dir():
            return folder
    raise OutputError(
        f"{PACKAGE}: this installation has no Snakefile; install archfrag again"
    )


def write_starter(folder: Path) -> Path:
    """Write a commented study file, its schema and the shipped motions into a folder.

    The study file is written last, and its path is returned. OutputError if one of the files
    exists or cannot be written.
    """
    names = ("records", "study.schema.json", "study.yaml")
    records, schema, study = (folder / name for name in names)
    for path in (records, schema, study):
        if os.path.lexists(path):
            raise OutputError(f"{path}: exists already; choose a folder without it")
    make_folder(folder)
    try:
        shutil.copytree(shipped_folder() / records.name / "near_source", records)
        schema.write_text(study_schema(), "utf-8", newline="\n")
        shutil.copyfile(PACKAGE / "study" / "templates" / study.name, study)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return study


def suspicious(records: Sequence[PreparedRecord]) -> list[str]:
    """Return the cautions on files and samples of records.

    If cautions differ in numbers only, the first is returned with its record and the number of
    others.
    """
    alike: dict[str, list[str]] = {}
    for record in records:
        for text in record.cautions:
            kind = re.sub(r"\d[\d.e+-]*", "#", text)  # numbers differ
            alike.setdefault(kind, []).append(f"{record.id}: {text}")
    return [
        first + f" (and {len(more)} more of {len(records)} records)" * bool(more)
        for first, *more in alike.values()
    ]


def unit_warnings(study: StudyKeys, found: Members) -> list[str]:
    """Return warnings of values so unusual that a unit may be wrong.

    Included are cautions on arches, and on what a drawing shows beyond its blocks. `found` are the
    arches of the study; only the first `MOST_ASKED` are examined.
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
        least = start.least
        most = min(built.plus, built.minus)
        where = "the onset of motion ({:.3g} g); is their unit right?"
        texts = list(unit_cautions(arch))
        texts += unusual("thickness_factor", member.entry.thickness_factor)
        if size > LARGEST:
            texts.append(f"the arch is {size:.0f} m large; lengths are in m")
        if known and stays_at_rest(levels.max(), start):
            texts.append(f"no level is above {where.format(least)}")
        if known and levels.min() > FAR_BEYOND * most:
            texts.append(
                f"all levels are more than {FAR_BEYOND:.0f} times {where.format(most)}"
            )
        for text in (*texts, *arch_cautions(arch, start)):
            found_of.setdefault(text, []).append(member.id)
    asked = study.intensity
    cautions = [] if known else level_cautions(asked.measure, asked.si, _LEVELS)
    for text, (first, *more) in found_of.items():
        cautions.append(f"{first}{f' and {len(more)} more' * bool(more)}: {text}")
    return cautions


def read_from_drawing(entry: ArchEntry) -> list[str]:
    """Return a text on the blocks of a drawing, then the caution on what was not read, if any."""
    path = Path(str(entry.drawing))
    drawn = read_drawing(path, entry.layer, entry.unit)
    arch = entry.model_copy(
        update=dict.fromkeys(("ends", "transverse", "fill", *LATER, "vary"))
    ).build()
    size, high, thick = arch.dimensions
    text = f"clear span {size:.3g} m, rise {high:.3g} m"
    if arch.free_end:
        text = f"height {np.ptp(np.concatenate(arch.outlines)[:, 1]):.3g} m"
    whole = repr(arch)[1:-1].partition(": ")[2]
    text += (
        f", mean thickness {thick:.3g} m; {whole}; from {path.name}, layer {drawn.layer}, in "
        f"{drawn.unit}"
    )
    return [text, *filter(None, [drawn.caution])]


def arch_texts(study: StudyKeys) -> list[str]:
    """Return a line on weights, forces and joints of the first intact arch of each class.

    At most `MOST_ASKED` classes have a line.
    """
    first: dict[str, Member] = {}
    for member in study.members:
        if member.intact:
            first.setdefault(member.arch_class, member)
    texts = []
    for member in list(first.values())[:MOST_ASKED]:
        arch = member.entry.build()
        names = ", ".join(member.attributes)
        other = f"columns that change no arch: {names}" * bool(names)
        columns = onset(arch).transverse_text
        told = filter(None, (facts_text(arch), columns, joints_text(arch), other))
        texts.append(f"{member.id}: {'; '.join(told)}")
    return texts


def logo_url(logo: str) -> str:
    """Return a picture as a data URL; InputError if it is missing, too large or of another kind.

    Its kind follows from its content: the first bytes of PNG and JPEG, the root element of SVG.
    """
    content = read_bytes(
        Path(logo), LARGEST_LOGO, InputError, "report.logo: the picture"
    )
    kinds = [kind for kind, start in PICTURES.items() if content.startswith(start)]
    roots = list[str]()
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler = lambda name, attributes: roots.append(name)
    with contextlib.suppress(expat.ExpatError):
        parser.Parse(content, True)
        kinds += ["svg+xml"] * (roots[0] == "http://www.w3.org/2000/svg svg")
    if not kinds:
        raise InputError(
            f"report.logo: {logo} holds no picture; it must be PNG, JPEG or SVG of at most "
            f"{LARGEST_LOGO / 1000:g} kB"
        )
    return f"data:image/{kinds[0]};base64,{base64.b64encode(content).decode()}"


def check_start(study: StudyKeys) -> tuple[str, ...]:
    """Check hazard, logo and output folder of a study; nothing is created.

    InputError if hazard or logo cannot be used; OutputError if the folder cannot take the results.
    Returned are messages on what was assumed of the hazard, and on what is unusual in it.
    """
    risk = study.risk
    messages: tuple[str, ...] = ()
    if risk is not None:
        messages = load_hazard(
            [Path(risk.hazard)], study.intensity.measure, risk.unit, risk.site
        ).messages
    if study.report.logo is not None:
        logo_url(study.report.logo)
    folder = study.folder
    try:
        place = next(path for path in (folder, *folder.parents) if path.exists())
        if not place.is_dir() or not os.access(place, os.W_OK | os.X_OK):
            raise OSError(0, f"{place} is no folder that allows it")
    except OSError as error:
        raise cannot_write(folder, error) from error
    check_outputs(study, "cube", "fit", "report")
    owner = read_state(study.work / OWNER).get("id", study.id)
    if owner != study.id:
        raise OutputError(
            f"{study.folder}: holds results of study {owner!r}, not of study {study.id!r}; give "
            "the studies different output folders"
        )
    return messages


def check_study(study: StudyKeys) -> Named:
    """Check a study without running it: arches stand, and records can be read and scaled.

    Returned are the numbers of arches, records, levels and runs, and texts for the user.
    ``extent`` says how exact the number of runs is: exactly, about or at most. Errors of hazard or
    folder, of records and of arches are raised together.
    """
    errors = list[ArchfragError]()
    found = study.members
    some = checked(found)
    records = list[PreparedRecord]()
    cautions = list[str]()
    for check in (
        lambda: cautions.extend(check_start(study)),
        lambda: check_standing(some, study.method),
        lambda: records.extend(read_records(study)),
    ):
        try:
            check()
        except ArchfragError as error:
            errors.append(error)
    if errors:
        several = "\n  ".join([f"{len(errors)} errors:", *map(str, errors)])
        raise type(errors[0])(several) if errors[1:] else errors[0]
    levels = len(study.intensity.si)
    size, extent = study.design.size(len(records), levels)
    asked = levels_asked(study, records)
    if not asked.all():
        size = int(asked.sum())
    sizes_of = Counter(member.arch_class for member in found)
    for member in found:
        del sizes_of[member.id]
    cautions[:0] = unit_warnings(study, found) + suspicious(records)
    if len(found) > len(some):
        cautions.append(
            f"{len(found) - len(some)} of {len(found)} arches were not checked; the run checks "
            "all of them before it simulates"
        )
    entries = (*study.arches, *(member.entry for member in some))
    drawn = [each for each in entries if each.drawing and not each.table][:MOST_ASKED]
    return {
        "study": study.id,
        "arches": len(found),
        "records": len(records),
        "levels": levels,
        "design": study.design.kind,
        "runs": size * len(found),
        "extent": extent,
        "classes": [f"{name}: {counted(n, 'arch')}" for name, n in sizes_of.items()],
        "cautions": cautions,
        "partners": record_texts(study, records),
        "drawings": [f"{each.id}: {read_from_drawing(each)[0]}" for each in drawn],
        "facts": arch_texts(study),
    }


def record_texts(study: StudyKeys, records: Sequence[PreparedRecord]) -> list[str]:
    """Return lines on which files and first shocks belong together, and on unused verticals."""
    every = study.motions.model_copy(update={"vertical": True})
    partnered = {
        source.path.name
        for source in find_sources(every, study.intensity.measure)
        if "vertical" in source.others
    }
    texts = list[str]()
    unused = 0
    for record in records:
        parts = filter(None, (record.of_transverse, record.of_vertical))
        others = [part.file for part in parts if part.file != record.file]
        if others:
            texts.append(f"{record.file} with {' and '.join(others)}")
        unused += (
            record.file in partnered or VERTICAL_LEFT in record.log
        ) and not record.vertical
    texts += pairs_text(records)
    if unused:
        texts.append(
            f"{unused} of {counted(len(records), 'record')} have a vertical component that is not "
            "used; motions.vertical: true uses it"
        )
    return texts
