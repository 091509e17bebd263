"""The command `archfrag`: thin, and quick to answer because nothing is imported before use."""

import errno
import os
import shlex
import sys
from pathlib import Path
from typing import Any

import click

from archfrag.cli import arch, records, results, study
from archfrag.cli.options import PATH, echo, warn
from archfrag.errors import ArchfragError
from archfrag.study.provenance import commit
from archfrag.version import __version__


class _Group(click.Group):
    """Commands whose errors are one message and an exit code; errors of ours keep a traceback."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MemoryError:
            text, code = "the memory of this machine does not suffice", 1
        except ArchfragError as error:
            text, code = str(error), error.exit_code
        except OSError as error:
            if not error.strerror or error.errno == errno.EPIPE:
                raise
            place = f"{os.fsdecode(error.filename)}: " if error.filename else ""
            text, code = f"{place}{error.strerror}", 1
        warn(f"error: {text}")
        ctx.exit(code)


def _version(ctx: click.Context, parameter: click.Parameter, requested: bool) -> None:
    if requested and not ctx.resilient_parsing:
        echo(f"archfrag {__version__} (commit {commit()})")
        ctx.exit()


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version,
              help="Show version and commit, and end.")  # fmt: skip
def main() -> None:
    """From earthquake records to collapse probabilities of masonry arches.

    A study file names arches, records and levels; `archfrag run STUDY` makes its report. The
    other commands are steps of a run, tools for records, and answers for one arch.
    """
    # Processes that this one starts load no modules from the current folder.
    os.environ["PYTHONSAFEPATH"] = "1"


@main.command()
@click.argument("folder", type=PATH, default=".")
def init(folder: Path) -> None:
    """Write a commented study into FOLDER (.), to start from.

    The shipped motions come with it.
    """
    from archfrag.study.validate import write_starter

    echo(f"run it with: archfrag run {shlex.quote(str(write_starter(folder)))}")


@main.command()
@click.option("--method", help="Only the kernels of this method; all methods if not given.")
def warmup(method: str | None) -> None:
    """Compile the kernels now, so that later commands start at once."""
    from archfrag.simulation.warmup import warmup as compile_kernels

    def show(message: str) -> None:
        click.echo(f"\r{message}\033[K", err=True, nl=False)

    seconds = compile_kernels(method, show if sys.stderr.isatty() else None)
    click.echo("\r\033[K" if sys.stderr.isatty() else "", err=True, nl=False)
    echo(f"kernels ready after {seconds:.1f} s")


for command in (
    records.records, study.export, study.film, study.risk, arch.onset, arch.simulate,
    study.validate, study.run, study.clean, *study.STEPS, results.info, results.open_report,
    results.figures, results.converge,
):  # fmt: skip
    main.add_command(command)
