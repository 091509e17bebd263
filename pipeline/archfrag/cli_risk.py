"""The command `archfrag risk`: nothing is imported before use."""

import json
from pathlib import Path
from typing import Any

import click

from archfrag.cli_records import echo, json_option, set_option, study_argument, takes

_path = click.Path(path_type=Path)


def _site(context: click.Context, parameter: click.Parameter, text: str | None) -> Any:
    if text is None:
        return None
    try:
        lon, lat = map(float, text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is no longitude and latitude, such as 13.35,42.35"
        ) from None
    return lon, lat


@click.command()
@study_argument
@takes(
    click.option("--hazard", "hazards", type=_path, required=True, multiple=True, metavar="FILE",
                 help="Hazard curve of the site. Repeatable: OpenQuake's mean and quantiles."),
    click.option("--unit", help="Unit of a CSV's intensities, where its header has none."),
    click.option("--years", type=float, default=50.0, show_default=True,
                 help="Time for the probability of collapse."),
    click.option("--site", callback=_site, metavar="LON,LAT",
                 help="Which site of OpenQuake's file: the nearest, at most 10 km away."),
    click.option("--confidence", type=float, default=0.9, show_default=True, help="Of the bands."),
    click.option("--members", is_flag=True, help="Rates of the arches of classes as well."),
    set_option,
    click.option("--out", type=_path, metavar="FILE", help="Write the result as JSON."),
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
    from archfrag.study.config import load_study
    from archfrag.study.curves import quoted
    from archfrag.study.files import write_text
    from archfrag.study.fits import FITS, load_answers, open_cube
    from archfrag.study.hazard import load_hazard
    from archfrag.study.risk import risk_of
    from archfrag.study.risk_output import risk_facts, risk_text
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
    text = json.dumps(facts, allow_nan=False)
    if out is not None:
        write_text(out, text + "\n")
    echo(text if as_json else risk_text(facts))
    if all("none" in arch for arch in facts["arches"].values()):
        raise FitError("there is no rate, since no arch has a curve")
