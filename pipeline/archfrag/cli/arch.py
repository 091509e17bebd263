"""The commands for one arch: `onset` and `simulate`."""

import functools
import math
from collections.abc import Callable
from pathlib import Path

import click
from pydantic import ValidationError

from archfrag.arch import STANDARD_GRAVITY
from archfrag.arch.facts import facts_of, facts_text, unit_cautions
from archfrag.cli.options import (
    PATH,
    check_written,
    command,
    figure_option,
    json_option,
    method_option,
    option,
    refuse_given,
    show,
    takes,
    takes_record,
    warn,
)
from archfrag.errors import InputError
from archfrag.files import Named
from archfrag.motions.measures import scale_factor
from archfrag.motions.read import read_motion
from archfrag.plots import svg_of
from archfrag.simulation import standing
from archfrag.simulation.response import STATUS_MESSAGE, UNITS, Response, summary
from archfrag.simulation.simulate import onset as find_onset
from archfrag.simulation.simulate import simulate as run_simulation
from archfrag.simulation.springings import springing_path
from archfrag.study.file.arches import ArchEntry
from archfrag.study.file.schema import load_study
from archfrag.study.keys import first_message
from archfrag.study.provenance import finite, write_text
from archfrag.study.validate import read_from_drawing

_SHOWN = 40  # entries of a log that fit a screen
_NAMES = 12  # of arches, in a message
_SPREADS = 10  # parts of a spread in a table
_PROFILES = ("circular", "segmental", "pointed", "elliptic", "catenary", "block")
_TYPES = {
    "voussoirs": int,
    "spans": int,
    "pier_courses": int,
    "drawing": str,
    "drawing_unit": str,
}  # others: float
_OPTIONS = {
    "voussoirs": "Number of voussoirs.",
    "friction": "Coulomb coefficient; inf is allowed.",
    "radius": "Mid-thickness radius of a circular arch [m].",
    "embrace": "Angle between the springings [degrees].",
    "span": "Span of the centre line [m].",
    "rise": "Rise of the centre line [m].",
    "thickness": "Thickness of the ring [m].",
    "width": "Width of a block [m].",
    "height": "Height of a block [m].",
    "spans": "Number of equal spans of a bridge.",
    "pier_height": "Height of the piers between spans, from base to springing [m].",
    "pier_width": "Width of these piers [m].",
    "pier_courses": "Bodies of each of these piers; 1 if not given.",
    "drawing": "DXF file with the blocks: closed polylines, and lines on the ground.",
    "drawing_unit": "Unit of the drawing: m, dm, cm, mm, in or ft; what it states if not given.",
}


def _takes_arch(command: Callable) -> Callable:
    """Give a command the options of an arch: its dimensions, or its id in a study file."""

    @functools.wraps(command)
    def wrapped(study: Path | None, arch_id: str | None, **options) -> None:
        given = {name: options.pop(name) for name in ("profile", *_OPTIONS, "layer")}
        if study is None:
            refuse_given("an arch of a study needs --study", "arch_id")
            entry = _by_numbers(given)
        else:
            refuse_given("--study gives the arch", *given)
            entry = _of_study(study, arch_id)
        if entry.drawing is not None:
            warn("\narchfrag: caution: ".join(read_from_drawing(entry)))
        if entry.vary is not None:
            warn(
                f"{entry.id} as given, without vary; its {entry.vary.samples} samples "
                f"are --arch {entry.id}-0001 and so on"
            )
        arch = entry.build()
        for caution in unit_cautions(arch):
            warn(f"caution: {caution}")
        command(arch, **options)

    return takes(
        option("--study", PATH, "Study file with the arch.", metavar="STUDY"),
        option(
            "--arch arch_id",
            str,
            "Id of the arch in the study; ID-0001 is the first sample of one that "
            "varies, ID the arch as given.",
            metavar="ID",
        ),
        option("--profile", click.Choice(_PROFILES), None, "circular"),
        *(
            option(f"--{name.replace('_', '-')}", _TYPES.get(name, float), text)
            for name, text in _OPTIONS.items()
        ),
        option(
            "--layer",
            str,
            "Layer of the drawing; the only one with polylines if not given. Repeatable.",
            multiple=True,
            metavar="NAME,...",
        ),
    )(wrapped)


def _of_study(path: Path, name: str | None) -> ArchEntry:
    """Return an arch of a study file, or a sample of it, by its name.

    If `name` is None, it is the only arch. InputError if there are several, or none of this name.
    """

    study = load_study(path)
    entries = {entry.id: entry for entry in study.arches if entry.table is None}
    single = len(study.arches) == len(entries) == 1
    for member in study.members:
        entries.setdefault(member.id, member.entry)
    if name is None and (single or len(entries) == 1):
        name = next(iter(entries))
    if name not in entries:
        wrong = (
            "--arch is missing"
            if name is None
            else f"--arch {name}: there is no such arch"
        )
        some = ", ".join(list(entries)[:_NAMES]) + ", ..." * (len(entries) > _NAMES)
        raise InputError(f"{path}: {wrong}; the study has {some}")
    return entries[name]


def _by_numbers(options: Named) -> ArchEntry:
    """Return an arch from the options of a command; options that were not given are None."""
    layers = [name for text in options["layer"] for name in text.split(",")]
    given = options | {"id": "arch", "layer": layers or None}
    given["unit"] = given.pop("drawing_unit")
    pier = {key: given.pop(f"pier_{key}") for key in ("height", "width", "courses")}
    pier = {key: value for key, value in pier.items() if value is not None}
    given = {key: value for key, value in given.items() if value is not None}
    given |= {"piers": pier} if pier else {}
    if "drawing" in given:
        refuse_given("--drawing gives the shape", "profile")
        del given["profile"]
    try:
        return ArchEntry.model_validate(given)
    except ValidationError as error:

        def option(at) -> str:
            names = {"unit": "drawing_unit", "piers": "pier_height"}
            name = f"pier_{at[-1]}" if len(at) > 1 else names.get(at[0], str(at[0]))
            return "--" + name.replace("_", "-")

        what = f"--profile {given['profile']}" if "profile" in given else "--drawing"
        raise InputError(
            f"{what}: {first_message(error, given, option)}; or take an arch of a study by "
            "--study STUDY --arch ID"
        ) from error


@command()
@_takes_arch
@option(
    "--spread",
    float,
    "Let the right springing move away by this much, and show the onset against it [m].",
)
@figure_option
@json_option
def onset(arch, spread: float | None, figure: Path | None, as_json: bool) -> None:
    """Find the steady ground acceleration that starts to move an arch.

    The figure shows the arch with hinges and thrust line at onset.
    """

    check_written(figure)
    start = find_onset(arch)
    names = (
        "stands",
        "plus",
        "minus",
        "hinges",
        "sliding",
        "hinges_minus",
        "sliding_minus",
    )
    lines = []
    for towards in ("+x", "-x"):
        value, *found = start.mechanism(towards)
        how = f": {start.places(towards)}" if any(found) else ""
        moves = "never moves" if math.isinf(value) else f"moves from {value:.4f} g"
        lines.append(f"ground towards {towards}: {moves}{how}")
    loss = standing.edge_loss(arch)
    cautions = standing.arch_cautions(arch, start)
    texts = (
        start.transverse_text,
        standing.edge_text(arch, loss),
        standing.joints_text(arch),
    )
    lines += filter(None, texts)
    text = "\n".join(lines)
    if not start.stands:
        text = standing.prestress_text(arch) or "does not stand under its own weight"
    text += f"\n{facts_text(arch)}"
    facts = {name: getattr(start, name) for name in names} | {"arch": facts_of(arch)}
    facts |= {"places": arch.places} if arch.places else {}
    facts |= {"loss_10_mm": loss, "cautions": cautions}
    if start.transverse is not None:
        name, column = start.transverse
        facts["transverse"] = {"pier": name, "onset": column.least}
    if start.stands and spread is not None:
        path = springing_path(arch, spread=spread)
        last = path.part.size - 1
        kept = [*range(0, last, max(1, last // _SPREADS)), last]
        rows = {
            "spread": spread * path.part[kept],
            "plus_at": path.plus[kept],
            "minus_at": path.minus[kept],
        }
        text += "\nspread [m]  onset +x [g]  onset -x [g]"
        for row in zip(*rows.values()):
            text += "\n{:10.4f}  {:12.4f}  {:12.4f}".format(*row)
        falls = spread * path.limit
        text += "" if math.isinf(falls) else f"\nfalls at a spread of {falls:.4g} m"
        facts |= rows | {"falls_at": falls}
    if figure is not None:
        write_text(figure, svg_of(start.plot().figure) + "\n")
    show(finite(facts), text, as_json)
    for caution in () if as_json else cautions:
        warn(f"caution: {caution}")


@command()
@_takes_arch
@click.argument("record", type=PATH)
@takes_record
@takes(
    option("--component", str, "Horizontal component to use, e.g. E."),
    option("--scale", float, "Factor on the record.", 1.0),
    option("--pga", float, "Peak to scale the record to [g], instead of --scale."),
    method_option("auto", "Method of integration."),
    option("--dt", float, "Time step [s]; the method's default if not given."),
    option("--rtol", float, "Relative error; the method's default if not given."),
    option(
        "--follow",
        float,
        "Longest time to simulate after the record while the arch moves [s].",
        20.0,
    ),
    option("--mechanism history", bool, "Show how the mechanism changed."),
    json_option,
)
def simulate(
    arch,
    record: Path,
    scale: float,
    pga: float | None,
    as_json: bool,
    **options,
) -> None:
    """Simulate one arch under one record, until it rests or collapses."""

    keys = ("unit", "component", "inventory", "accept", "columns")
    motion = read_motion(record, **{key: options.pop(key) for key in keys})
    if pga is not None:
        refuse_given("--pga scales the record", "scale")
        scale = scale_factor(motion, "PGA", pga * STANDARD_GRAVITY)
    response = run_simulation(arch, motion, scale=scale, **options)
    facts = {**vars(response), "steps": response.steps, "fallbacks": response.fallbacks}
    for name in ("history", "arch", "motion", "scale"):
        del facts[name]
    facts |= {"status": response.status.name.lower(), "scale": scale}
    if response.mechanism is not None:
        facts["mechanism"] = [
            {key: own for key, own in vars(change).items() if key != "places"}
            for change in response.mechanism
        ]
    if arch.places:
        named = "collapse_place", "lost_contact_place"
        facts |= {name: getattr(response, name) or None for name in named}
        facts["places"] = arch.places
    facts = finite(facts, None)
    show(facts, _text(response, facts), as_json)


def _text(response: Response, facts: Named) -> str:
    lines = [f"{facts['status']}: {STATUS_MESSAGE[response.status]}"]
    for key, value in facts.items():
        unit = UNITS.get(key.split("_")[-1], "")
        if isinstance(value, dict):
            parts = (
                f"{k} {each:.4g} {unit}".strip() for k, each in value.items() if each
            )
            value = ", ".join(parts).replace("_", " ") or None
        elif isinstance(value, float):
            value = f"{value:.4g} {unit}"
        told = key in ("status", "collapsed", "mechanism", "places")
        if not told and value not in (None, -1, "none"):
            lines.append(f"{key.replace('_', ' ')}: {value}".rstrip())
    if response.mechanism is not None:
        lines.append(summary(response.mechanism))
        lines += [f"  {change}" for change in response.mechanism[:_SHOWN]]
        lines += ["  ..."] * (len(response.mechanism) > _SHOWN)
    return "\n".join(lines)
