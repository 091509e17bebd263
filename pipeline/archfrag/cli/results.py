"""Commands for results: `info`, `open`, `figures` and `converge`."""

import json
from pathlib import Path
from typing import Any

import click

from archfrag.cli.options import PATH, echo, json_option, show, warn, with_study, wrapped
from archfrag.cli.study import cores_option
from archfrag.errors import InputError
from archfrag.files import opened
from archfrag.report import make_report
from archfrag.study.provenance import CUBE

_MOST_NAMED = 12  # entries of a list


def _folder(path: Path) -> Path:
    """Folder of the results of a study, which is given itself or by the study file."""
    from archfrag.study.file.schema import load_study

    return path if path.is_dir() else load_study(path).folder


@click.command()
@click.argument("file", type=PATH)
@json_option
def info(file: Path, as_json: bool) -> None:
    """Describe FILE: a cube, a study file or a folder of results.

    Shown are dimensions, arches, records, levels, numbers of runs by verdict, and how the cube was
    made.
    """
    facts = _facts(file if file.suffix == ".nc" else _folder(file) / CUBE)
    lines = [line for name, value in facts.items()
             for line in wrapped(f"{name.replace('_', ' '):18}  {_text(value)}", 20)]  # fmt: skip
    show(facts, "\n".join(lines), as_json)


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {entry}" for name, entry in value.items() if entry != 0)
    if isinstance(value, list):
        named = [each if isinstance(each, str) else f"{each:.4g}" for each in value[:_MOST_NAMED]]
        return f"{len(value)}: {', '.join(named)}{', …' * (len(value) > _MOST_NAMED)}"
    return str(value)


def _facts(path: Path) -> dict[str, Any]:
    """Facts of a cube, levels in the unit of its study; InputError if it is none of archfrag."""
    import numpy as np
    import xarray as xr

    try:
        with opened(path), xr.open_dataset(path) as cube:  # a pipe would be waited for
            stated, level, verdict = cube.attrs, cube["intensity"], cube["verdict"]
            names = verdict.attrs["flag_meanings"].split()
            counts = [int((verdict == code).sum()) for code in verdict.attrs["flag_values"]]
            names, counts = [*names, "not_run"], [*counts, int(verdict.isnull().sum())]
            return {
                "file": str(path), "study": stated["archfrag_study"], "title": stated["title"],
                "dimensions": {str(name): size for name, size in cube.sizes.items()},
                "arches": cube["arch"].values.astype(str).tolist(),
                "records": cube["record"].values.astype(str).tolist(),
                "vertical_component": stated["vertical_component"],
                "measure": level.attrs["measure"], "unit": level.attrs["unit"],
                "levels": np.unique(level.values[np.isfinite(level.values)]).tolist(),
                "design": json.loads(stated["archfrag_design"])["kind"],
                "verdicts": dict(zip(names, counts)),
                "source": stated["source"], "commit": stated["archfrag_commit"],
                "versions": json.loads(stated["archfrag_versions"]),
            }  # fmt: skip
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: is missing, damaged or no cube of archfrag") from error


@click.command("open")
@click.argument("study", type=PATH)
def open_report(study: Path) -> None:
    """Open the report of STUDY in the browser.

    STUDY is a study file or its folder of results. Without a browser the path of the report is
    printed.
    """
    import webbrowser

    from archfrag.study.steps import REPORT_FILES

    report = _folder(study) / REPORT_FILES[0]
    if not report.is_file():
        raise InputError(f"{report}: is missing; `archfrag run` on the study file makes it")
    if not webbrowser.open(report.resolve().as_uri()):
        echo(str(report))


@click.command()
@with_study(
    click.option("--to", "folder", type=PATH, metavar="DIR",
                 help="Folder to write to; `figures` in the results folder by default."),
)  # fmt: skip
def figures(study: Any, folder: Path | None) -> None:
    """Draw a finished study for a paper, as PDF and PNG.

    \b
    fragility   curves with their bands
    ida-ARCH    peak and residual rotation of each record against intensity
    runs-ARCH   verdict of every run
    onset-ARCH  hinges and thrust at the onset of motion
    """
    from archfrag.report.inputs import report_inputs
    from archfrag.report.printed import save_figures

    for path in save_figures(report_inputs(study), folder or study.folder / "figures"):
        echo(str(path))


def _counts(context: click.Context, parameter: click.Parameter, text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"{text!r} must be numbers such as 7,14,28") from None


@click.command()
@with_study(
    click.option("--voussoirs", "counts", callback=_counts, required=True, metavar="N,N,...",
                 help="Numbers of voussoirs; the others are compared with the last."),
    cores_option,
)  # fmt: skip
def converge(study: Any, counts: list[int], cores: int | None) -> None:
    """Compare the curves of a study by number of voussoirs.

    The study is run with each number, in `converge/voussoirs-N` in the results folder, and these
    runs are kept. converge.csv in the results folder has theta and beta with intervals, the ratio
    of theta to that of the last number, and its scatter: the standard deviation of the logarithm
    of the same ratio of capacities, from record to record.

    \b
    Example:
      archfrag converge study.yaml --voussoirs 7,14,28
    """
    from archfrag.study.converge import CONVERGE, with_voussoirs, write_convergence
    from archfrag.study.running import stoppable
    from archfrag.study.steps import run_study

    made = with_voussoirs(study, counts)
    study_file = click.get_current_context().params["study_file"]
    with stoppable() as check:
        for count, own in made.items():
            warn(f"{count} voussoirs")
            run_study(own, study_file, check, make_report, cores)
    table = write_convergence(study, made)
    echo(table.to_string(index=False, na_rep="", float_format="{:.4g}".format))
    echo(f"table: {study.folder / CONVERGE}")
