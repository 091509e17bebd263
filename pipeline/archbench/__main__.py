"""``python -m archbench``: measure cost against error; tables, charts and a page of them."""

from pathlib import Path
from typing import Any

import click

from archfrag.errors import ArchfragError

_folder = click.Path(path_type=Path, exists=True, file_okay=False)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("parts", nargs=-1, metavar="[PART]...")
@click.option("--quick", is_flag=True, help="The reduced set: 12 minutes on two cores.")
@click.option(
    "--output",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("results/evidence"),
    show_default=True,
    help="Folder of the tables; the same command continues in it.",
)
@click.option(
    "--records", type=_folder, help="Folder of the shipped records, if not records/."
)
@click.option(
    "--real",
    type=_folder,
    help="Folder with real records (at2/*.AT2); without it their test cases are "
    "skipped.",
)
@click.option(
    "--solvers",
    multiple=True,
    metavar="NAME",
    help="Another solver to compare with, or all that are installed. Repeatable.",
)
@click.option(
    "--cores",
    "--workers",
    "workers",
    type=click.IntRange(min=1),
    help="Number of cores to use; all by default.",
)
def main(parts: tuple[str, ...], output: Path, **options: Any) -> None:
    """Measure cost against error.

    Makes tables, charts and a page. PARTS are speed, fragility, knee, growth, stability,
    corner_cases and bands; all of them by default.
    """
    from archbench.page import gather

    try:
        page = gather(
            parts, output, report=lambda line: click.echo(line, err=True), **options
        )
    except ArchfragError as error:
        click.echo(f"archbench: error: {error}", err=True)
        raise SystemExit(error.exit_code) from None
    click.echo(page)


if __name__ == "__main__":
    main(prog_name="python -m archbench")
