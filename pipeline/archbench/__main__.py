"""``python -m archbench``: measure cost against error; tables, charts and a page of them."""

from pathlib import Path

import click

from archfrag.errors import ArchfragError


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("parts", nargs=-1, required=True, metavar="PART...")
@click.option(
    "--output",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the tables; the same command continues in it. By default "
    "results/evidence, of quick results/quick.",
)
@click.option(
    "--cores",
    "--workers",
    "workers",
    type=click.IntRange(min=1),
    help="Number of cores to use; all by default.",
)
@click.option(
    "--hours",
    type=click.FloatRange(min=0, min_open=True),
    help="Time that all parts may take, 4 by default, and 1/3 with quick; each part "
    "has its share of it.",
)
def main(
    parts: tuple[str, ...],
    output: Path | None,
    workers: int | None,
    hours: float | None,
) -> None:
    """Measure cost against error.

    Makes tables, charts and a page, with all other solvers that are installed. PART is all, or
    some of speed, fragility, knee, growth, stability, joints, spans, corner_cases and bands.
    With quick, a reduced set of them. What is measured already with the same kernels is kept.
    """
    from archbench.page import gather

    def say(line: str) -> None:
        click.echo(line, err=True)

    try:
        page = gather(parts, output, workers, say, hours)
    except ArchfragError as error:
        click.echo(f"archbench: error: {error}", err=True)
        raise SystemExit(error.exit_code) from None
    click.echo(page)


if __name__ == "__main__":
    main(prog_name="python -m archbench")
