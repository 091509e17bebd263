"""Options that several commands share, and how commands print."""

import functools
import json
import shlex
import shutil
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from archfrag.errors import InputError
from archfrag.files import check_targets, number, printable
from archfrag.physics.methods.registry import METHODS

PATH = click.Path(path_type=Path)


def takes(*options: Callable) -> Callable:
    """Return a decorator that gives a command options, in the order of its help."""

    def decorate(command: Callable) -> Callable:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def option(
    names: str, kind, text: str | None, default=None, **more
) -> Callable[..., Any]:
    """Return an option by its names; it is a flag if `kind` is bool.

    Its help shows the default, if there is one.
    """
    if default is not None:
        more |= {"default": default, "show_default": True}
    more |= {"is_flag": True} if kind is bool else {"type": kind}
    return click.option(*names.split(), help=text, **more)


def _columns(text: str):
    from archfrag.motions.formats.columns import parse_columns

    return parse_columns(text)


def _accept(context: click.Context, parameter: click.Parameter, words: tuple[str, ...]):
    from archfrag.motions.calibrate import accepted_words

    return accepted_words(words, "--accept")


cores_option = option(
    "--cores --workers",
    click.IntRange(min=1),
    "Number of cores to use; all by default.",
)
json_option = option("--json as_json", bool, "Print JSON.")
takes_study = takes(
    click.argument("study_file", metavar="STUDY", type=PATH),
    option(
        "--set overrides",
        str,
        "Override a key of the study file, e.g. --set method.dt=0.0005; "
        "paths are relative to the study file. Repeatable.",
        multiple=True,
        metavar="KEY=VALUE",
    ),
)


takes_format = takes(
    option("--unit", str, "Unit of the samples if the file does not state it."),
    option(
        "--inventory",
        PATH,
        "StationXML of a record in counts, if it is not NAME.xml in its folder.",
    ),
    option(
        "--columns",
        _columns,
        "Columns of plain text files: time=1,acceleration=2, or acceleration=1,dt=0.01; dt=0.01 "
        "alone takes all numbers, row after row; also vertical=COLUMN and skip=LINES.",
        metavar="KEY=N,...",
    ),
)
takes_record = takes(
    takes_format,
    option(
        "--accept",
        str,
        "Let pass a peak outside 1e-5 to 5 g (pga), a time step outside 1e-4 to 0.1 s "
        "(time_step), another number of samples than announced (samples), another peak than the "
        "header states (header), a sensor in a borehole or a structure (sensor).",
        multiple=True,
        callback=_accept,
        metavar="WORD,...",
    ),
)


class Once(click.Command):
    """Command that refuses an option given twice, unless the option may be repeated.

    Numbers must be such as `archfrag.files.number` takes.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse options; InputError if one is given twice, as its first value would be lost."""
        values, _, order = self.make_parser(ctx).parse_args(list(args))
        for each in {*order}:
            if (
                isinstance(each, click.Option)
                and not each.multiple
                and order.count(each) > 1
            ):
                raise InputError(f"{each.opts[0]} is given twice; give it once")
            if isinstance(
                each.type, click.types.FloatParamType | click.types.IntParamType
            ):
                try:
                    number(str(values[str(each.name)]))
                except ValueError as error:
                    raise click.BadParameter(str(error), ctx, each) from None
        return super().parse_args(ctx, args)


command = functools.partial(click.command, cls=Once)


def pairs_of(
    context: click.Context, parameter: click.Parameter, given
) -> dict[str, str]:
    """Return names with values, from a text such as a=1,b=2 or from several such texts.

    InputError if a pair is incomplete or a name occurs twice.
    """
    text = given if isinstance(given, str) else ",".join(given or ())
    pairs = [pair.partition("=") for pair in text.split(",") if text]
    name = parameter.opts[0]
    for wrong in ("".join(pair) for pair in pairs if not all(pair)):
        raise InputError(f"{name} {wrong}: write it as {parameter.metavar}")
    named = {key.strip(): value.strip() for key, _, value in pairs}
    if len(named) < len(pairs):
        raise InputError(f"{name} {text}: names one thing twice")
    return named


def refuse_given(why: str, *names: str) -> None:
    """Raise InputError if the user gave one of some options, named by their parameters.

    `why` completes the message.
    """
    context = click.get_current_context()
    for each in context.command.params:
        source = context.get_parameter_source(str(each.name))
        if each.name in names and source not in (None, ParameterSource.DEFAULT):
            raise InputError(
                f"{each.opts[0]} is given, but {why}; leave one of them out"
            )


_WRITTEN = ("out", "figure", "path", "folder", "vulnerability", "output")  # parameters


def check_written(*targets: Path | None) -> None:
    """Check that files to be written replace no input of the current command.

    OutputError also if one would replace a file that archfrag did not make.
    """
    given = list[Any]()
    for name, value in click.get_current_context().params.items():
        if name not in _WRITTEN:
            given += value if isinstance(value, tuple) else [value]
    check_targets(targets, (each for each in given if isinstance(each, Path)))


def method_option(default: str | None, text: str) -> Callable:
    """Return the option of a method of integration."""
    return option("--method", click.Choice(METHODS), text, default)


def echo(text: str, err: bool = False) -> None:
    """Print a line, without the characters of foreign text that a terminal obeys."""
    click.echo(printable(text), err=err)


def warn(message: str) -> None:
    echo(f"archfrag: {message}", err=True)


def wrapped(text: str, indent: int) -> list[str]:
    """Return the lines of a text, broken between words at the width of the terminal."""
    width = max(shutil.get_terminal_size().columns, indent + 20)
    return textwrap.wrap(
        text,
        width,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def show(facts, text: str, as_json: bool) -> None:
    echo(json.dumps(facts, allow_nan=False) if as_json else text)


def point_to_report(folder: Path, named: Path, anything: bool) -> None:
    """Print the path of the report; before it a message if not `anything` had to be done.

    `named` is the study file or the folder, for the command that opens the report.
    """
    if not anything:
        warn("nothing to do: all results are up to date")
    report = folder / "report.html"
    if report.is_relative_to(Path.cwd()):
        report = report.relative_to(Path.cwd())
    echo(f"report  {report}  ({shlex.join(['archfrag', 'open', str(named)])})")


def svg_path(text: str) -> Path:
    """Return the path of a figure or film; InputError unless it ends in .svg."""
    if not text.lower().endswith(".svg"):
        raise InputError(
            f"{text}: figures and films are written as .svg; name such a file"
        )
    return Path(text)


figure_option = option("--figure", svg_path, "Draw a figure.", metavar="FILE.svg")
