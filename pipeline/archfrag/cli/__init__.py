"""The command `archfrag`: quick to answer, because a command is imported when it is asked for."""

import errno
import os
import warnings
from importlib import import_module

import click

from archfrag.cli.options import echo, warn
from archfrag.errors import ArchfragError
from archfrag.study.provenance import commit
from archfrag.version import __version__

# Module, and the first line of the help.
COMMANDS = {
    "init": ("study", "Write a commented study into FOLDER (.), to start from."),
    "warmup": (
        "study",
        "Compile the kernels now, so that later commands start at once.",
    ),
    "validate": ("study", "Check a study file and all files that it names."),
    "run": ("run_study", "Run a study, or continue it, from records to report."),
    "motions": ("study", "Read the study's records and store them for the workers."),
    "batch": ("study", "Run the simulations of a batch that are missing."),
    "cube": ("study", "Gather the results into one CF netCDF cube."),
    "fit": ("study", "Fit fragility curves to a table of verdicts, or to a study."),
    "report": ("study", "Write the report: one HTML file that needs no network."),
    "clean": ("study", "Remove stored runs that a study does not use."),
    "export": ("answers", "Export a finished study in the formats of other programs."),
    "film": ("answers", "Film one run of a finished study, simulated again."),
    "risk": ("answers", "Find the rate of collapse of a finished STUDY at a site."),
    "update": (
        "answers",
        "Update the curve of a finished STUDY by damage that was seen.",
    ),
    "info": ("answers", "Describe FILE: a cube, a study file or a folder of results."),
    "open": ("answers", "Open the report of STUDY in the browser."),
    "onset": (
        "arch",
        "Find the steady ground acceleration that starts to move an arch.",
    ),
    "simulate": (
        "arch",
        "Simulate one arch under one record, until it rests or collapses.",
    ),
    "records": ("records", "Inspect, measure, select, fetch and make records."),
}


class _Commands(click.Group):
    """Group of commands, each imported from its module when it is called.

    An error of the user or of the machine ends in one message and an exit code. Errors of archfrag
    itself keep their traceback.
    """

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; None if there is none of this name."""
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"archfrag.cli.{COMMANDS[cmd_name][0]}")
        command: click.Command = getattr(
            module, f"{cmd_name}_command", None
        ) or getattr(module, cmd_name)
        return command

    def format_commands(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        """Write the names of all commands with the first lines of their help."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name][1]) for name in sorted(COMMANDS)])

    def invoke(self, ctx: click.Context):
        """Run a command; print one message for an error of the user or of the machine."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:  # of a command that has nothing to continue
            warn("stopped by SIGINT")
            ctx.exit(130)
        except MemoryError:
            failed = ArchfragError("the memory of this machine does not suffice")
        except ArchfragError as error:
            failed = error
        except OSError as error:
            if not error.strerror or error.errno == errno.EPIPE:
                raise
            place = f"{os.fsdecode(error.filename)}: " if error.filename else ""
            failed = ArchfragError(f"{place}{error.strerror}")
        warn(f"error: {failed}")
        ctx.exit(failed.exit_code)


def _version(ctx: click.Context, parameter: click.Parameter, requested: bool) -> None:
    if requested and not ctx.resilient_parsing:
        echo(f"archfrag {__version__} (commit {commit()})")
        ctx.exit()


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Show version and commit, and end.",
)
def main() -> None:
    """From earthquake records to collapse probabilities of masonry arches.

    A study file names arches, records and levels; `archfrag run STUDY` makes its report. The
    other commands are steps of a run, tools for records, and answers for one arch.
    """
    warnings.showwarning = lambda message, *_: warn(f"warning: {message}")
    # Processes that this one starts load no modules from the current folder.
    os.environ["PYTHONSAFEPATH"] = "1"
