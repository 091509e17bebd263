"""The commands for one arch: `onset`, `draw` and `simulate`."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import PATH, echo, json_option, show, takes, takes_record

_PROFILES = ("circular", "segmental", "pointed", "elliptic", "catenary", "block")
_TEXTS = {
    "drawing": "take the blocks from a DXF file: closed polylines, and lines on the ground",
    "layer": "of the drawing; the only one with polylines if not given",
    "drawing_unit": "m, dm, cm, mm, in or ft; what the drawing states if not given",
}
_NUMBERS = {
    "radius": "mid-thickness radius of a circular arch [m]",
    "embrace": "angle between the springings [degrees]",
    "span": "of the centre line [m]",
    "rise": "of the centre line [m]",
    "thickness": "of the ring [m]",
    "width": "of a block [m]",
    "height": "of a block [m]",
    "density": "of the masonry [kg/m3]",
    "depth": "across the plane [m]",
    "thickness_factor": "of a drawing: its joints are longer by it",
}


def _takes_arch(command: Callable) -> Callable:
    """Give a command the options of an arch: its dimensions, or its id in a study file."""

    @functools.wraps(command)
    def wrapped(study: Path | None, arch_id: str | None, **options: Any) -> None:
        names = ("profile", "voussoirs", "friction", "straight", *_TEXTS, *_NUMBERS)
        given = {name: options.pop(name) for name in names}
        from archfrag.cli.facts import arch_by_numbers, arch_of_study

        command(
            arch_by_numbers(given) if study is None else arch_of_study(study, arch_id), **options
        )

    return takes(
        click.option("--study", type=PATH, metavar="STUDY", help="take the arch of a study file"),
        click.option("--arch", "arch_id", metavar="ID", help="id of the arch in the study"),
        click.option("--profile", type=click.Choice(_PROFILES), default="circular",
                     show_default=True),
        click.option("--voussoirs", type=int, help="number of voussoirs"),
        click.option("--friction", type=float, help="Coulomb coefficient; inf allowed"),
        click.option("--straight", is_flag=True, help="straight-sided voussoirs"),
        *(click.option(f"--{name.replace('_', '-')}", type=kind, help=text)
          for kind, texts in ((str, _TEXTS), (float, _NUMBERS)) for name, text in texts.items()),
    )(wrapped)  # fmt: skip


@click.command()
@_takes_arch
@json_option
def onset(arch: Any, as_json: bool) -> None:
    """Find the ground acceleration that starts to move an arch.

    A steady acceleration, with the mechanism in which the arch begins to move.
    """
    from archfrag.cli.facts import onset_facts, onset_text
    from archfrag.simulate import onset as find_onset

    start = find_onset(arch)
    show(onset_facts(start), onset_text(start), as_json)


@click.command()
@_takes_arch
@click.option("--output", type=PATH, required=True, metavar="FILE", help="DXF file to write.")
@click.option("--output-unit", default="m", show_default=True, help="m, dm, cm, mm, in or ft")
def draw(arch: Any, output: Path, output_unit: str) -> None:
    """Draw an arch as DXF.

    Blocks are closed polylines, what they stand on are lines.
    """
    arch.to_dxf(output, output_unit)
    echo(f"drawing: {output}")


@click.command()
@_takes_arch
@click.argument("record", type=PATH)
@takes_record
@takes(
    click.option("--component", help="horizontal component to take, e.g. E"),
    click.option("--scale", type=float, default=1.0, show_default=True,
                 help="factor on the record"),
    click.option("--pga", type=float, help="peak to scale the record to [g], instead of --scale"),
    click.option("--method", default="auto", show_default=True),
    click.option("--dt", type=float, help="time step [s]; the method's default if not given"),
    click.option("--rtol", type=float, help="relative error; the method's default if not given"),
    click.option("--follow", type=float, default=20.0, show_default=True,
                 help="longest time to simulate after the record while the arch moves [s]"),
    click.option("--mechanism", "history", is_flag=True, help="show how the mechanism changed"),
    json_option,
)  # fmt: skip
def simulate(
    arch: Any, record: Path, scale: float, pga: float | None, as_json: bool, **options: Any
) -> None:
    """Simulate one arch under one record, until it rests or collapses."""
    from archfrag.arch import STANDARD_GRAVITY
    from archfrag.cli.facts import response_facts, response_text
    from archfrag.motions.measures import scale_factor
    from archfrag.motions.read import read_motion
    from archfrag.simulate import simulate as run_simulation

    keys = ("unit", "component", "inventory", "accept", "columns")
    reading = {key: options.pop(key) for key in keys}
    motion = read_motion(record, **reading)
    if pga is not None:
        scale = scale_factor(motion, "PGA", pga * STANDARD_GRAVITY)
    response = run_simulation(arch, motion, scale=scale, **options)
    show(response_facts(response, scale), response_text(response, scale), as_json)
