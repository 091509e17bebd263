"""The commands for a finished study: `export`, `film`, `risk`, `info` and `open`."""

import json
import webbrowser
from pathlib import Path

import click
import numpy as np
import xarray as xr

from archfrag.cli.options import (
    PATH,
    check_written,
    command,
    echo,
    json_option,
    option,
    pairs_of,
    refuse_given,
    show,
    svg_path,
    warn,
    wrapped,
)
from archfrag.cli.study import with_study
from archfrag.errors import FitError, InputError
from archfrag.export import CURVES, FORMATS, OF_ARCHES
from archfrag.export.command import export_study, write_vulnerability
from archfrag.export.scenes import export_arches
from archfrag.files import Named, number, opened
from archfrag.report.film import example_of, save_film
from archfrag.study.answer.fits import in_unit, updated_fits
from archfrag.study.answer.rates import losses_of, risk_facts, risk_of, risk_text
from archfrag.study.file.schema import load_study
from archfrag.study.hazard import load_hazard
from archfrag.study.provenance import CUBE, NETCDF, REPORT_FILES, finite
from archfrag.study.steps import finished

members_option = option("--members", bool, "Include the arches of classes as well.")
_USES = {name: about for name, (about, _, _) in FORMATS.items()} | OF_ARCHES
_FORMATS = (f"{name:15}  {about}" for name, about in _USES.items())


@command(epilog="\b\nFormats:\n" + "\n".join(_FORMATS))
@with_study(
    option(
        "--format formats",
        click.Choice(_USES),
        "Format to write. Repeatable.",
        multiple=True,
        required=True,
    ),
    option(
        "--limit-state limit_states",
        str,
        "Limit state to write besides collapse: motion, impact, residual, "
        "rotation or contact_lost; all if not given. Repeatable.",
        multiple=True,
        metavar="NAME",
    ),
    option(
        "--curve",
        click.Choice(CURVES),
        "Curve of the medians of theta and beta; predictive: its mean over what "
        "they may be; branches: 15 weighted curves for a logic tree.",
        "median",
    ),
    option(
        "--out",
        click.Path(path_type=Path, file_okay=False),
        "Folder to write to; `export` in the results folder if not given.",
        metavar="FOLDER",
    ),
    members_option,
    json_option,
)
def export(
    study,
    formats: tuple[str, ...],
    out: Path | None,
    members: bool,
    as_json: bool,
    **of_curves,
) -> None:
    """Export a finished study in the formats of other programs.

    The formats scene and dxf need no runs; scene needs the motions, by `archfrag motions`.

    OpenQuake, pelicun and IN-CORE get PGA, Sa and averages of Sa in g, PGV in cm/s. A class of
    arches has one curve, the mean of those of its arches. An arch without a curve is in the tables
    of runs, records and arches only, and a message states why.

    All limit states with a curve are written, and a note names the others and the reason. If the
    curve of a state lies below that of a severer one by more than 0.01 in probability, it takes up
    that one's dispersion as far as needed, and a note states it. The files hold these notes too.
    """
    made: Named = {"left_out": {}, "notes": [], "files": []}
    lines = []
    if FORMATS.keys() & formats:
        named = [name for name in formats if name in FORMATS]
        made = export_study(study, named, out, members, **of_curves)
        states = made["limit_states"]
        lines.append(
            f"limit states written: {len(states)} ({', '.join(states) or 'no curve'})"
        )
    else:
        refuse_given("scene and dxf have no curves", *of_curves)
    if OF_ARCHES.keys() & formats:
        for key, more in export_arches(study, formats, out, members).items():
            made[key] += more
    for arch, why in made["left_out"].items():
        warn(f"no curve of {arch} is exported: {why}")
    for message in made["notes"]:
        warn(f"note: {message}")
    files = [f"{each['format']}: {each['file']}" for each in made["files"]]
    show(made, "\n".join(files + lines), as_json)


@command()
@with_study(
    option(
        "--run run_name",
        str,
        "Run to show, its level in the study's unit; or median: the record with "
        "the capacity nearest the median.",
        "median",
        metavar="RECORD@LEVEL",
    ),
    option("--arch", str, "Id of the arch; the first one if not given.", metavar="ID"),
    option("--to path", svg_path, "File to write: .svg.", "film.svg", metavar="FILE"),
)
def film(study, run_name: str, arch: str | None, path: Path) -> None:
    """Film one run of a finished study, simulated again.

    A browser plays the file.

    \b
    Example:
      archfrag film study.yaml --run syn-m75-r015@0.5 --to fall.svg
    """
    check_written(path)
    example = example_of(study, run_name, arch)
    save_film(example, path)
    echo(f"film: {path}: {example.motion.id} at {example.level}, {example.reason}")


def _site(text: str) -> tuple[float, float]:
    try:
        lon, lat = map(number, text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} must be longitude and latitude, such as 13.35,42.35"
        ) from None
    return lon, lat


@command()
@with_study(
    option(
        "--hazard hazards",
        PATH,
        "Hazard curve of the site. Repeatable: OpenQuake's mean and quantiles.",
        required=True,
        multiple=True,
        metavar="FILE",
    ),
    option("--unit", str, "Unit of the intensities of a CSV whose header has none."),
    option("--years", float, "Period for the probability of collapse [years].", 50.0),
    option(
        "--site",
        _site,
        "Place: the nearest site of OpenQuake's file within 10 km.",
        metavar="LON,LAT",
    ),
    option("--confidence", float, "Of all bands.", 0.9),
    option(
        "--consequence",
        str,
        "Cost of limit states as parts of the arch's value, 0 to 1: the average "
        "annual loss is given too.",
        metavar="NAME=RATIO,...",
        callback=pairs_of,
    ),
    option(
        "--vulnerability",
        PATH,
        "File for mean loss against intensity: .csv, or .xml for OpenQuake.",
        metavar="FILE",
    ),
    members_option,
    json_option,
)
def risk(
    study,
    hazards: tuple[Path, ...],
    unit: str | None,
    site: tuple[float, float] | None,
    years: float,
    confidence: float,
    consequence: Named,
    vulnerability: Path | None,
    members: bool,
    as_json: bool,
) -> None:
    """Find the rate of collapse of a finished STUDY at a site.

    A class of arches has one rate, the mean of those of its arches.

    FILE is a CSV file with a column `im [g]` or of the measure's name, such as `PGA [g]`, a column
    `rate` (also `annual rate`, `annual rate of exceedance`, `annual frequency of exceedance`,
    `afe`, `mafe`, `lambda`), `poe_50` (probability of exceedance in 50 years) or `return period`
    [years], and a column `rate_NAME` or `poe_50_NAME` for each quantile. Upper and lower case,
    brackets [ ] or ( ), and the separators , ; and tab are all read. OpenQuake's hazard curves in
    CSV work too. The measure must be that of the study.

    \b
    Example:
      archfrag risk study.yaml --hazard hazard_curve-mean-PGA_1.csv --site 13.35,42.35
    """
    if vulnerability and not consequence:
        raise InputError(
            "--vulnerability needs --consequence, such as rotation=0.1,collapse=1"
        )
    check_written(vulnerability)
    hazard = load_hazard(hazards, study.intensity.measure, unit, site)
    fitted = finished(study)
    curves = fitted.quoted(members)
    rates = risk_of(fitted.cube, curves, hazard, years, confidence)
    facts = risk_facts(rates, study) | {"confidence": confidence}
    if consequence:
        losses = losses_of(fitted.cube, curves, hazard, consequence, confidence)
        if vulnerability:
            write_vulnerability(vulnerability, losses, study)
        facts["losses"] = finite(losses, None)
    show(facts, risk_text(facts), as_json)
    if all("none" in arch for arch in facts["arches"].values()):
        raise FitError("no arch has a curve, so there is no rate")


@command()
@with_study(
    click.argument("damage", type=PATH),
    option("--arch", str, "Arch or class; needed if there are several.", metavar="ID"),
    option(
        "--beta-model",
        float,
        "Part of beta that differs from arch to arch; a class of arches knows it.",
    ),
    option("--stations", PATH, "CSV of what stations recorded.", metavar="FILE"),
    option(
        "--shakemap",
        PATH,
        "ShakeMap's grid.xml and uncertainty.xml, for DAMAGE without intensities. Repeatable.",
        multiple=True,
        metavar="FILE",
    ),
    option(
        "--length", float, "Distance at which intensities correlate by exp(-3) [km]."
    ),
    option("--share", float, "Part of sd^2 that all places of an earthquake share."),
    option(
        "--format formats",
        click.Choice(FORMATS),
        "Format to export the updated curve in. Repeatable.",
        multiple=True,
    ),
    option("--out", PATH, "Folder for these files.", metavar="FOLDER"),
    json_option,
)
def update(
    study,
    damage: Path,
    arch: str | None,
    formats: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    **given,
) -> None:
    """Update the curve of a finished STUDY by damage that was seen.

    Nothing of the study changes. DAMAGE is a CSV file with a row for each arch: `state` (survived,
    collapsed or a limit state), `median` intensity in the study's unit, `tau` and `phi` (standard
    deviations of its ln between and within earthquakes) or `sd` for both; `lon` and `lat` for
    several places, `event` for several earthquakes. Stations have lon, lat, median, tau, phi,
    event, and what they `observed`.

    \b
    Example:
      archfrag update study.yaml damage.csv --beta-model 0.3
    """
    if bool(formats) != bool(out):
        raise InputError("--format and --out go together; give both or none")
    before = finished(study)
    after = updated_fits(study, before, damage, arch, **given)
    name = next(iter(before.quoted())) if arch is None else arch
    first, last = (
        in_unit(each.curves[name], study.intensity) for each in (before, after)
    )
    curves = {"before": first, **last.limit_states}
    files = []
    if out is not None:
        made = export_study(study, formats, out, fitted=after)
        files = [f"{each['format']}: {each['file']}" for each in made["files"]]
    lines = [f"{word:9} {'  '.join(curve.words())}" for word, curve in curves.items()]
    lines.append(f"{name}: {last.method}")
    names = (
        "theta",
        "theta_interval",
        "beta",
        "beta_interval",
        "n_independent",
        "method",
    )
    facts = {
        k: {name: getattr(each, name) for name in names} for k, each in curves.items()
    }
    show(facts, "\n".join(lines + files), as_json)


_MOST_NAMED = 12  # entries of a list


def _folder(path: Path) -> Path:
    """Return the folder of results; `path` is this folder or the study file."""
    if path.is_file() and path.suffix.lower() not in ("", ".yaml", ".yml"):
        raise InputError(f"{path}: is no study file (.yaml), and no folder of results")
    return path if path.is_dir() else load_study(path).folder


@command()
@click.argument("file", type=PATH)
@json_option
def info(file: Path, as_json: bool) -> None:
    """Describe FILE: a cube, a study file or a folder of results.

    Shown are dimensions, arches, records, levels, numbers of runs by verdict, and how the cube was
    made.
    """
    facts = _facts(file if file.suffix == ".nc" else _folder(file) / CUBE)
    texts = (f"{k.replace('_', ' '):18}  {_text(v)}" for k, v in facts.items())
    lines = [line for text in texts for line in wrapped(text, 20)]
    show(facts, "\n".join(lines), as_json)


def _text(value) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {each}" for name, each in value.items() if each != 0)
    if isinstance(value, list):
        some = value[:_MOST_NAMED]
        named = [each if isinstance(each, str) else f"{each:.4g}" for each in some]
        return f"{len(value)}: {', '.join(named)}{', …' * (len(value) > _MOST_NAMED)}"
    return str(value)


def _facts(path: Path) -> Named:
    """Return the facts of a cube, with levels in the unit of its study.

    InputError if the file is no cube of archfrag.
    """
    try:
        # A pipe would be waited for.
        with opened(path), NETCDF, xr.open_dataset(path) as cube:
            stated = cube.attrs
            level = cube["intensity"]
            verdict = cube["verdict"]
            names = verdict.attrs["flag_meanings"].split()
            runs = {
                name: int((verdict == code).sum())
                for name, code in zip(names, verdict.attrs["flag_values"])
            }
            return {
                "file": str(path),
                "study": stated["archfrag_study"],
                "title": stated["title"],
                "dimensions": {str(name): size for name, size in cube.sizes.items()},
                "arches": cube["arch"].values.astype(str).tolist(),
                "records": cube["record"].values.astype(str).tolist(),
                "vertical_component": stated["vertical_component"],
                "measure": level.attrs["measure"],
                "unit": level.attrs["unit"],
                "levels": np.unique(level.values[np.isfinite(level.values)]).tolist(),
                "design": json.loads(stated["archfrag_design"])["kind"],
                "verdicts": runs | {"not_run": int(verdict.isnull().sum())},
                "source": stated["source"],
                "commit": stated["archfrag_commit"],
                "versions": json.loads(stated["archfrag_versions"]),
            }
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path}: is missing, damaged or no cube of archfrag"
        ) from error


@command("open")
@click.argument("study", type=PATH)
def open_command(study: Path) -> None:
    """Open the report of STUDY in the browser.

    STUDY is a study file or its folder of results. Without a browser the path of the report is
    printed.
    """
    report = _folder(study) / REPORT_FILES[0]
    if not report.is_file():
        raise InputError(
            f"{report}: is missing; `archfrag run` on the study file makes it"
        )
    if not webbrowser.open(report.resolve().as_uri()):
        echo(str(report))
