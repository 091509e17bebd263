"""The command `archfrag export`: nothing is imported before use."""

import json
from pathlib import Path

import click

from archfrag.cli_records import echo, json_option, set_option, study_argument

FORMATS = ("nrml-continuous", "nrml-discrete", "pelicun", "in-core", "csv", "parquet")


@click.command()
@study_argument
@click.option("--format", "formats", multiple=True, required=True, type=click.Choice(FORMATS),
              help="Format to write. Repeatable.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), metavar="FOLDER",
              help="Folder to write to; `export` among the results if not given.")  # fmt: skip
@click.option("--members", is_flag=True, help="Curves of the arches of classes as well.")
@set_option
@json_option
def export(
    study_file: Path,
    formats: tuple[str, ...],
    out: Path | None,
    members: bool,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Export a finished study in the formats of other programs.

    \b
    nrml-continuous  OpenQuake: lognormal curves by mean and standard deviation;
                     PGA, Sa, AvgSA in g, PGV and FIV3 in cm/s, PGD in cm. The
                     ids of the functions are the arches and classes: use them
                     as taxonomies.
    nrml-discrete    OpenQuake: probabilities at levels, units as above.
    pelicun          damage database: CSV of medians and dispersions, and JSON that
                     describes it; PGA and Sa in g, PGV in cm/s (cmps).
    in-core          IN-CORE: a DFR3 set in JSON for each arch; PGA and Sa in g,
                     PGV in cm/s, PGD in m. The severest limit state is repeated
                     up to the four that IN-CORE takes for bridges.
    csv              curves (with bands) and their parameters in the unit of the
                     study and in SI; runs, records and arches in SI; and JSON
                     that describes the columns.
    parquet          the same tables: pip install 'archfrag[parquet]'

    A class of arches has one curve, the mean of those of its arches; formats of a median and a
    dispersion hold the lognormal curve with its mean and standard deviation of ln capacity.

    An arch without a curve is left out of all but the tables of runs, records and arches; a
    message states why.
    """
    from archfrag.export.command import export_study
    from archfrag.study.config import load_study

    made = export_study(load_study(study_file, overrides), formats, out, members)
    for arch, why in made.left_out.items():
        echo(f"archfrag: no curve of {arch} is exported: {why}", err=True)
    for note in made.notes:
        echo(f"archfrag: note: {note}", err=True)
    if as_json:
        echo(json.dumps(made.facts, allow_nan=False))
    else:
        echo("\n".join(f"{name}: {path}" for name, path in made.files))
