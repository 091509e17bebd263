"""The commands before a study: `init` and `warmup`."""

import shlex
import sys
from pathlib import Path

import click

from archfrag.cli.options import PATH, Once, echo, method_option
from archfrag.simulation.warmup import warmup as compile_kernels
from archfrag.study.validate import write_starter


@click.command(cls=Once)
@click.argument("folder", type=PATH, default=".")
def init(folder: Path) -> None:
    """Write a commented study into FOLDER (.), to start from.

    The shipped motions come with it.
    """
    echo(f"run it with: archfrag run {shlex.quote(str(write_starter(folder)))}")


@click.command(cls=Once)
@method_option(None, "Only the kernels of this method; all methods if not given.")
def warmup(method: str | None) -> None:
    """Compile the kernels now, so that later commands start at once."""

    def show(message: str) -> None:
        click.echo(f"\r{message}\033[K", err=True, nl=False)

    seconds = compile_kernels(method, show if sys.stderr.isatty() else None)
    click.echo("\r\033[K" if sys.stderr.isatty() else "", err=True, nl=False)
    echo(f"kernels ready after {seconds:.1f} s")
