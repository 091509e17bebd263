"""The commands that hand results of a finished study on: `export` and `risk`."""

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
    nrml-continuous  OpenQuake: lognormal curves by mean and standard deviation;
                     PGA, Sa, AvgSA in g, PGV in cm/s, PGD in cm. The
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
            f"{text!r} is no longitude and latitude, such as 13.35,42.35"
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

    FILE is a CSV with the header `im [g]` or the measure's name, as in `PGA [g]`, then `rate`
    (annual frequency of exceedance) or `poe_50` (probability of exceedance in 50 years), and as
    many `rate_NAME` or `poe_50_NAME` as there are quantiles; or a CSV or XML (NRML) of OpenQuake's
    hazard curves, known by their content. Its measure must be the study's.

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
        raise FitError("there is no rate, since no arch has a curve")
