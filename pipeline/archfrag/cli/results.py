"""The commands that use the results of a finished study: `export` and `risk`."""

import json
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import (
    PATH,
    json_option,
    members_option,
    show,
    takes,
    takes_study,
    warn,
)

FORMATS = ("nrml-continuous", "nrml-discrete", "pelicun", "in-core", "csv", "parquet")


@click.command()
@takes_study
@takes(
    click.option("--format", "formats", multiple=True, required=True, type=click.Choice(FORMATS),
                 help="Format to write. Repeatable."),
    click.option("--out", type=click.Path(path_type=Path, file_okay=False), metavar="FOLDER",
                 help="Folder to write to; `export` in the results folder if not given."),
    members_option, json_option,
)  # fmt: skip
def export(
    study_file: Path, overrides: tuple[str, ...], formats: tuple[str, ...], out: Path | None,
    members: bool, as_json: bool,
) -> None:  # fmt: skip
    """Export a finished study in the formats of other programs.

    \b
    nrml-continuous  OpenQuake: lognormal curves by mean and standard deviation
    nrml-discrete    OpenQuake: probabilities at levels
    pelicun          damage database: CSV of medians and dispersions, and JSON
    in-core          IN-CORE: a DFR3 set in JSON for each arch
    csv              curves, parameters, runs, records and arches; JSON on columns
    parquet          the same tables: pip install 'archfrag[parquet]'

    OpenQuake, pelicun and IN-CORE get PGA, Sa and AvgSA in g, and PGV in cm/s. A class of arches
    has one curve, the mean of those of its arches. An arch without a curve is in the tables of
    runs, records and arches only, and a message states why.
    """
    from archfrag.export.command import export_study
    from archfrag.study.file.schema import load_study

    made = export_study(load_study(study_file, overrides), formats, out, members)
    for arch, why in made["left_out"].items():
        warn(f"no curve of {arch} is exported: {why}")
    for note in made["notes"]:
        warn(f"note: {note}")
    show(made, "\n".join(f"{each['format']}: {each['file']}" for each in made["files"]), as_json)


def _site(context: click.Context, parameter: click.Parameter, text: str | None) -> Any:
    if text is None:
        return None
    try:
        lon, lat = map(float, text.split(","))
        return lon, lat
    except ValueError:
        raise click.BadParameter(
            f"{text!r} must be longitude and latitude, such as 13.35,42.35"
        ) from None


@click.command()
@takes_study
@takes(
    click.option("--hazard", "hazards", type=PATH, required=True, multiple=True, metavar="FILE",
                 help="Hazard curve of the site. Repeatable: OpenQuake's mean and quantiles."),
    click.option("--unit", help="Unit of the intensities of a CSV whose header has none."),
    click.option("--years", type=float, default=50.0, show_default=True,
                 help="Period for the probability of collapse [years]."),
    click.option("--site", callback=_site, metavar="LON,LAT",
                 help="Place: the nearest site of OpenQuake's file within 10 km."),
    click.option("--confidence", type=float, default=0.9, show_default=True, help="Of all bands."),
    members_option,
    click.option("--out", type=PATH, metavar="FILE", help="Write the result as JSON."),
    json_option,
)  # fmt: skip
def risk(
    study_file: Path, overrides: tuple[str, ...], out: Path | None, as_json: bool, **options: Any
) -> None:
    """Find the rate of collapse of a finished STUDY at a site.

    A class of arches has one rate, the mean of those of its arches.

    FILE is a CSV file with a column `im [g]` or of the measure's name, such as `PGA [g]`, a column
    `rate` (annual frequency of exceedance) or `poe_50` (probability of exceedance in 50 years),
    and a column `rate_NAME` or `poe_50_NAME` for each quantile. Files of OpenQuake's hazard curves
    (CSV or NRML) work too. The measure must be that of the study.

    \b
    Example:
      archfrag risk study.yaml --hazard hazard_curve-mean-PGA_1.csv --site 13.35,42.35
    """
    from archfrag.errors import FitError
    from archfrag.study.answer.curves import quoted
    from archfrag.study.answer.fits import FITS, load_answers, open_cube
    from archfrag.study.answer.risk import risk_facts, risk_of, risk_text
    from archfrag.study.file.hazard import load_hazard
    from archfrag.study.file.schema import load_study
    from archfrag.study.files import write_text
    from archfrag.study.steps import require

    study = load_study(study_file, overrides)
    measure = study.intensity.measure
    hazard = load_hazard(options["hazards"], measure, options["unit"], options["site"])
    require(study, "cube")
    require(study, "fit")
    with open_cube(study) as cube:
        arches, classes = (load_answers(study.folder / FITS, of) for of in ("arches", "classes"))
        answers = quoted(cube, arches, classes, options["members"])
        fits = {name: answer.curve for name, answer in answers.items()}
        found = risk_of(cube, fits, hazard, options["years"], options["confidence"])
    facts = risk_facts(found, study)
    if out is not None:
        write_text(out, json.dumps(facts, allow_nan=False) + "\n")
    show(facts, risk_text(facts), as_json)
    if all("none" in arch for arch in facts["arches"].values()):
        raise FitError("no arch has a curve, so there is no rate")
