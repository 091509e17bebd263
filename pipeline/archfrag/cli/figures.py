"""Commands for papers: figures of a finished study, and curves by number of voussoirs."""

from pathlib import Path

import click

from archfrag.cli.options import PATH, echo, takes, takes_study, warn


@click.command()
@takes_study
@click.option("--to", "folder", type=PATH, metavar="DIR",
              help="Folder to write to; `figures` in the results folder by default.")  # fmt: skip
def figures(study_file: Path, overrides: tuple[str, ...], folder: Path | None) -> None:
    """Draw a finished study for a paper, as PDF and PNG.

    \b
    fragility   curves with their bands
    ida-ARCH    peak and residual rotation of each record against intensity
    runs-ARCH   verdict of every run
    onset-ARCH  hinges and thrust at the onset of motion
    """
    from archfrag.report.inputs import report_inputs
    from archfrag.report.printed import save_figures
    from archfrag.study.file.schema import load_study

    study = load_study(study_file, overrides)
    for path in save_figures(report_inputs(study), folder or study.folder / "figures"):
        echo(str(path))


def _counts(context: click.Context, parameter: click.Parameter, text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"{text!r} must be numbers such as 7,14,28") from None


@click.command()
@takes(
    takes_study,
    click.option("--voussoirs", "counts", callback=_counts, required=True, metavar="N,N,...",
                 help="Numbers of voussoirs; the others are compared with the last."),
    click.option("--cores", type=click.IntRange(min=1), help="Number of cores; all by default."),
)  # fmt: skip
def converge(
    study_file: Path, overrides: tuple[str, ...], counts: list[int], cores: int | None
) -> None:
    """Compare the curves of a study by number of voussoirs.

    The study is run with each number, in `converge/voussoirs-N` in the results folder, and these
    runs are kept. converge.csv in the results folder has theta and beta with intervals, the ratio
    of theta to that of the last number, and its scatter: the standard deviation of the logarithm
    of the same ratio of capacities, from record to record.

    \b
    Example:
      archfrag converge study.yaml --voussoirs 7,14,28
    """
    from archfrag.report import make_report
    from archfrag.study.converge import CONVERGE, with_voussoirs, write_convergence
    from archfrag.study.file.schema import load_study
    from archfrag.study.running import stoppable
    from archfrag.study.steps import run_study

    study = load_study(study_file, overrides)
    made = with_voussoirs(study, counts)
    with stoppable() as check:
        for count, own in made.items():
            warn(f"{count} voussoirs")
            run_study(own, study_file, check, make_report, cores)
    table = write_convergence(study, made)
    echo(table.to_string(index=False, na_rep="", float_format="{:.4g}".format))
    echo(f"table: {study.folder / CONVERGE}")
