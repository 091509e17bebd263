"""The command `fit`, for a table of verdicts or a study."""

from functools import partial
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import PATH, echo, json_option, takes_study
from archfrag.cli.study import fit_study, print_answers
from archfrag.errors import FitError, InputError, attempt
from archfrag.export import FORMATS
from archfrag.export.command import export_study
from archfrag.report.page import make_table_report
from archfrag.study.answer.fits import FITS, answer_lines, fit_runs, run_cautions
from archfrag.study.answer.outside import read_runs
from archfrag.study.answer.rates import risk_of
from archfrag.study.hazard import load_hazard


def _mapping(context: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> Any:
    pairs = [pair.partition("=") for text in texts for pair in text.split(",")]
    for what, sign, name in pairs:
        if not (what and sign and name):
            raise InputError(f"--columns {what + sign + name}: write it as intensity=PGA")
    return {what.strip(): name.strip() for what, _, name in pairs}


@click.command("fit")
@takes_study
@click.option("--columns", multiple=True, callback=_mapping, metavar="WHAT=NAME,...",
              help="Names of columns by what they hold: intensity=PGA,verdict=fell.")  # fmt: skip
@click.option("--measure", help="Measure of the intensity, if its column does not state it.")
@click.option("--unit", help="Unit of the intensity, if its column does not state it.")
@click.option("--states", metavar="NAME,...", default="",
              help="Damage states of a column, in order, from none to collapse.")  # fmt: skip
@click.option("--confidence", type=float, default=0.9, show_default=True, help="Of all bands.")
@click.option("--hazard", type=PATH, help="Hazard curve of a site, for the rate of collapse.")
@click.option("--output", type=PATH, help="Folder to write to; results/NAME if not given.")
@click.option("--format", "formats", multiple=True, type=click.Choice(FORMATS),
              help="Format to export to, as `archfrag export` does. Repeatable.")  # fmt: skip
@json_option
def fit_command(study_file: Path, overrides: tuple[str, ...], as_json: bool, **given: Any) -> None:
    """Fit fragility curves to a table of verdicts, or to a study.

    STUDY is a CSV file of verdicts of any program or experiment: a row for each run, with columns
    record, event, `PGA [g]` (or intensity) and verdict (collapsed or survived, 1 or 0); or for
    each record, with columns lower and upper. Of a study only --set and --json have a meaning.

    \b
    Example:
      archfrag fit tests.csv --columns "intensity=table PGA,verdict=fell" --measure PGA --unit g
    """
    if study_file.suffix.lower() not in (".csv", ".tsv", ".txt"):
        assert fit_study.callback is not None
        return fit_study.callback(study_file, overrides, as_json=as_json)
    hazard, formats = given.pop("hazard"), given.pop("formats")
    states = [name.strip() for name in given.pop("states").split(",") if name.strip()]
    study, cube = read_runs(study_file, states=states, **given)
    fitted, risk = fit_runs(study, cube), None
    cautions = run_cautions(study, fitted)
    if hazard is not None:
        site, confidence = load_hazard([hazard], study.intensity.measure), given["confidence"]
        risk = attempt(partial(risk_of, cube, fitted.quoted(), site, 50.0, confidence))
    report = make_table_report(study, fitted, cautions, risk)
    made = export_study(study, formats, fitted=fitted) if formats else {"files": ()}
    if as_json:
        return echo((study.folder / FITS).read_text("utf-8"))
    print_answers(*answer_lines(study, fitted, cautions), risk)
    for each in made["files"]:
        echo(f"{each['format']}: {each['file']}")
    echo(f"report  {report}")
    if not any(curve.fitted for curve in fitted.curves.values()):
        raise FitError("the table gives no curve")
    return None
