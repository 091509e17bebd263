"""Results of a study that has been run: curves, runs, capacities, risk, and files for others."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from markupsafe import escape
from numpy.typing import ArrayLike

from archfrag.errors import FitError, InputError
from archfrag.export.command import export_study
from archfrag.files import WORK, check_targets, make_folder
from archfrag.fragility.curve import Curve
from archfrag.fragility.plane import Plane
from archfrag.fragility.verdicts import DECIDED, Verdict, count_verdicts
from archfrag.report import make_report
from archfrag.report.film import example_of
from archfrag.study.answer.compare import compare, part_curves, plane_of
from archfrag.study.answer.cube import stored_cube
from archfrag.study.answer.curves import Fitted
from archfrag.study.answer.fits import in_unit, updated_fits
from archfrag.study.answer.rates import (
    answer_lines,
    losses_of,
    parts_of,
    risk_facts,
    risk_of,
    vulnerability_table,
)
from archfrag.study.answer.surface import Surface, surface_of
from archfrag.study.answer.tables import code_table
from archfrag.study.file.schema import CodeKeys, StudyKeys, load_study
from archfrag.study.hazard import Hazard, hazard_of_table, load_hazard
from archfrag.study.keys import at
from archfrag.study.provenance import (
    CUBE,
    OWNER,
    out_of_date,
    read_stamp,
    read_state,
    write_text,
)
from archfrag.study.steps import finished, make_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from archfrag.plots import Film
    from archfrag.simulation.simulate import Response

PathLike = str | os.PathLike[str]
Hazards = Any  # PathLike, sequence of PathLike, or a table (n, 2)
_RISK = [
    "rate",
    "rate_lower",
    "rate_upper",
    "return_period",
    "probability",
    "probability_lower",
    "probability_upper",
]


def open(path: PathLike) -> Results:
    """Open the results of a study that has been run.

    Parameters
    ----------
    path : path
        Study file, or folder of the results.

    Raises
    ------
    InputError
        If there are no results, or they are not those of the study file as it is now.

    Examples
    --------
    >>> import numpy as np, archfrag as af
    >>> wave = np.sin(np.arange(100) / 5.0) * np.hanning(100)
    >>> motions = [af.Motion(factor * wave, 0.01, id=f"wave{factor}") for factor in (1, 2)]
    >>> study = af.Study(af.Block(0.4, 2.0, 0.8), motions, levels=[0.2, 0.8, 3.2], id="block")
    >>> _ = study.run(progress=False)
    >>> af.open("results/block").runs.collapsed.shape
    (1, 2, 3)
    """
    file = given = Path(path)
    if given.suffix == ".nc":
        raise InputError(
            f"{given}: is a cube; give its folder {given.parent}, or the study file"
        )
    if given.is_dir():
        owner = read_state(given / WORK / OWNER)
        if "file" not in owner:
            raise InputError(
                f"{given}: is not a folder with the results of a study; give "
                "results/ID, or the study file"
            )
        file = given / str(owner["file"])
    study = load_study(file)
    # The folder is another one if it is of Snakemake, or was given by --set output.
    if given.is_dir() and study.folder.resolve() != given.resolve():
        study = load_study(file, [f"output={json.dumps(str(given.resolve()))}"])
    return Results(study)


class Results:
    """Results of a study, from `Study.run` or `archfrag.open`, or of a table, from `archfrag.fit`.

    Intensities are in the unit of the study. InputError if results are missing, or are not those
    of the study file as it is.

    Attributes
    ----------
    curves : dict of str to Curve
        Curves by name, first of classes of arches, then of arches; only those that were fitted.
    folder : Path
        Folder of the results.
    """

    def __init__(self, study: StudyKeys, table: Fitted | None = None) -> None:
        self._study = study
        self._table = table
        self.folder = study.folder
        self._made = read_stamp(study.folder)["files"].get(CUBE)
        self._fitted = table or finished(study)
        self.curves = {
            name: in_unit(curve, study.intensity)
            for name, curve in self._fitted.curves.items()
            if curve.fitted
        }

    @property
    def cautions(self) -> list[str]:
        """Why arches have no curve, and reasons for caution, as commands print them."""
        quoted = self._fitted.quoted().values()
        none = [
            f"{each.name}: no curve: {each.reason}"
            for each in quoted
            if not each.fitted
        ]
        return none + answer_lines(self._study, self._fitted)[1]

    @property
    def curve(self) -> Curve:
        """The only curve of a study.

        InputError if there are several arches or classes, FitError if there is no curve.
        """
        (name, curve), *others = self._fitted.quoted().items()
        if others:
            raise InputError(
                "the study has several curves; take one of .curves by name: "
                f"{', '.join(self._fitted.quoted())}"
            )
        if not curve.fitted:
            raise FitError(f"{name}: there is no curve: {curve.reason}")
        return self.curves[name]

    @property
    def runs(self) -> xr.Dataset:
        """All runs along arch, record and intensity (level, if each run has its own).

        This is the cube of the study, ``cube.nc``, with `collapsed`: 1 if a run collapsed, 0 if it
        survived, and nan if it is not run, unfinished or failed; `verdict` is nan if it is not
        run. An adaptive design runs each record at levels of its own, so that their mean at a
        level is no probability: see `fractions`. Runs of a table of verdicts are along level, and
        in SI units.
        """
        self._check_there()
        cube = self._table.cube if self._table else stored_cube(self._study)
        decided = cube["verdict"].isin(DECIDED)
        return cube.assign(
            collapsed=(cube["verdict"] == Verdict.COLLAPSED).where(decided)
        )

    @property
    def fractions(self) -> pd.DataFrame:
        """Fraction of the records that make each arch collapse, (n_level, n_arch).

        Rows are levels in the unit of the study. In an adaptive design it is the fraction of the
        records whose capacity lies below the level, as in the report. It is nan if no verdict is
        known. InputError if runs have intensities of their own, as in a cloud.
        """
        intensity = self._study.intensity
        if not self._study.design.on_levels:
            raise InputError(
                "fractions: runs have intensities of their own, so that no level has "
                "a fraction; see the curve"
            )
        index = pd.Index(intensity.given, name=intensity.measure)
        runs = {name: self._fitted.runs[name] for name in self._fitted.arches}
        columns = {k: count_verdicts(own.filled)["fraction"] for k, own in runs.items()}
        return pd.DataFrame(columns, index)

    @property
    def parts(self) -> pd.DataFrame:
        """Fraction of the records that make each bridge collapse in each part, by level.

        Columns are arch and part: the span or pier in which a joint lost contact for good. Those
        of an arch add up to its column of `fractions`. Arches of one part have no column.
        """
        fractions = self.fractions
        found = dict[tuple[str, str], Any]()
        for name, whole in fractions.items():
            split = parts_of(self._fitted.runs[str(name)])
            if split is not None:
                of_all = np.maximum(split.counts.sum(axis=0), 1)
                for part, count in zip(split.categories, split.counts):
                    found[str(name), part] = whole * count / of_all
        return pd.DataFrame(found, fractions.index)

    def part_curves(
        self, name: str | None = None, im: ArrayLike | None = None
    ) -> pd.DataFrame:
        """Tabulate P(the collapse takes a part of a bridge) against intensity, with its band.

        A collapse has one part, the span or pier in which a joint lost contact for good, so that
        the parts add up to the curve. `name` is an arch or a class, needed if there are several;
        `im`, (n,), are the levels of the study if not given. Columns are part, im, probability,
        lower, upper, and collapses, the number of the part in all runs. Parts without a collapse
        have no rows. InputError if the name is not known.
        """
        if name is None:
            name = self.curve.name
        if name not in self.curves:
            raise InputError(
                f"part_curves: {name!r} has no curve; take one of {', '.join(self.curves)}"
            )
        curve = self.curves[name]
        at = curve.levels if im is None else im
        return part_curves(self._fitted.runs[name], curve, np.asarray(at, float))

    @property
    def capacities(self) -> pd.DataFrame:
        """Capacity of each record for each arch, and the levels between which it lies.

        `lower` is the highest level that the arch withstands, 0 if there is none; `upper` the
        lowest at which it collapses, inf if there is none; `capacity` their geometric mean.
        """
        return self._fitted.capacities(1.0 / self._study.intensity.factor)

    def risk(
        self,
        hazard: Hazards | None = None,
        *,
        years: float | None = None,
        unit: str | None = None,
        site: Sequence[float] | None = None,
    ) -> pd.DataFrame:
        """Find the annual rate of collapse at a site, for classes and for arches without a class.

        Parameters
        ----------
        hazard : path, sequence of path, or table, optional
            Hazard curve as `archfrag risk --help` describes it; that of the study if not given. A
            table, (n, 2), such as a DataFrame, has intensities and annual rates of exceedance.
        years : float, optional
            Period for the probability of collapse, that of the study or 50 if not given.
        unit : str, optional
            Unit of the intensities in a table (that of the study if not given), or in a CSV file
            whose header has none.
        site : (longitude, latitude), optional
            Nearest site of OpenQuake's file [degrees].

        Returns
        -------
        pandas.DataFrame
            Rates in 1/year, periods in years; ``attrs`` holds what `archfrag risk --json` prints.
        """
        study = self._study
        fitted = self._fitted
        curve, years = self._hazard(hazard, years, unit, site)
        rates = risk_of(
            fitted.cube, fitted.quoted(), curve, years, study.report.confidence
        )
        facts = risk_facts(rates, study)
        columns = (
            "rate",
            "rate_band",
            "return_period",
            "probability",
            "probability_band",
        )
        known = {k: each for k, each in facts["arches"].items() if "none" not in each}
        rows = {k: np.hstack([each[c] for c in columns]) for k, each in known.items()}
        if not rows:
            raise FitError("no arch has a curve, so there is no rate")
        table = pd.DataFrame.from_dict(rows, orient="index", columns=_RISK, dtype=float)
        table.attrs.update(facts)
        return table

    def update(self, observed: Any, arch: str | None = None, **given) -> Results:
        """Return results with the curve of an arch or class after damage that was seen.

        Exports, rates and plots are then those of the updated curve. `observed` and `given` are as
        for `Curve.update`; `arch` is needed if there are several curves. Runs stay the study's.
        """
        return Results(
            self._study,
            updated_fits(self._study, self._fitted, observed, arch, **given),
        )

    def code(
        self, hazard: Hazards | None = None, *, code: Mapping[str, Any], **given
    ) -> pd.DataFrame:
        """Find demand and capacity for the limit states of a building code.

        `code` has the keys of ``report.code``: norm (ntc2018 or eurocode8), probability, and for
        ntc2018 life and use_class; `hazard` and `given` are as for `risk`. Rows are arches or
        classes, limit states of the code, and limit states that have a curve; intensities are in
        the unit of the study, `ratio` is capacity over demand, `rate` a year.

        Examples
        --------
        >>> import archfrag as af
        >>> table = {"PGA [g]": [0.3, 0.4, 0.5, 0.6], "collapsed": [0, 0, 1, 1]}
        >>> hazard = [[0.05, 0.02], [0.2, 2e-3], [1.0, 1e-4]]
        >>> results = af.fit({**table, "PGA [g]": [0.3, 0.5, 0.4, 0.6]})
        >>> rows = results.code(hazard, code={"norm": "eurocode8", "probability": 0.1})
        >>> rows[["code_state", "return_period"]].values.tolist()
        [['SD', 475.0], ['NC', 2475.0]]
        """
        study = self._study
        with at("code", code):
            keys = CodeKeys.model_validate(code)
        site, years = self._hazard(hazard, **given)
        fitted = self._fitted
        quoted = fitted.quoted()
        risk = risk_of(fitted.cube, quoted, site, years, study.report.confidence)
        curves = {name: in_unit(each, study.intensity) for name, each in quoted.items()}
        return code_table(curves, risk, keys)

    def losses(
        self,
        hazard: Hazards | None = None,
        *,
        consequence: Mapping[str, float],
        **given,
    ) -> pd.DataFrame:
        """Find the average annual loss at a site, as a part of the value of each arch or class.

        `consequence` gives the cost of each limit state, collapse among them, as a part of the
        value; `hazard` and `given` are as for `risk`. Columns are aal, aal_mean, aal_lower and
        aal_upper in 1/year, and aal_is_lower_bound; ``attrs["vulnerability"]`` has the mean loss
        ratio against intensity, which `archfrag risk --vulnerability` writes for OpenQuake.
        """
        study = self._study
        fitted = self._fitted
        site = self._hazard(hazard, **given)[0]
        confidence = study.report.confidence
        losses = losses_of(fitted.cube, fitted.quoted(), site, consequence, confidence)
        points = vulnerability_table(losses, study)
        known = {name: each for name, each in losses.items() if "none" not in each}
        table = pd.DataFrame.from_dict(known, orient="index")
        table = table.drop(columns="vulnerability")
        table.attrs["vulnerability"] = points
        return table

    def plane(self, second: str = "best", arch: str | None = None) -> Plane:
        """Find P(collapse | two intensities), and test what the second intensity gains.

        `second` is a measure such as PGV, or "best", which tries all that the cube has; `arch` is
        needed if there are several. The test holds earthquakes back. FitError with fewer than 8
        earthquakes (records, if these have none), or if both measures say the same.
        """
        return plane_of(self._fitted, self._study.intensity, second, arch)

    def surface(self, name: str | None = None) -> Surface:
        """Return P(collapse | movement of a springing, intensity), with its border.

        The arches of the class `name`, or all arches if it is not given, differ in the spread, the
        settlement or the rotation of a springing, and in nothing else. At the movement of an arch
        it is the curve of this arch; between two it is linear. The border is the movement at which
        the arch falls without an earthquake. InputError if the arches differ in more, FitError if
        one has no curve.
        """
        if self._table:
            raise InputError("surface: a table has no arches, and so no springings")
        return surface_of(self._study, self._fitted, name)

    def compare(
        self,
        before: str,
        after: str,
        hazard: Hazards | None = None,
        *,
        other: Results | None = None,
        **given,
    ) -> pd.DataFrame:
        """Compare two arches, or two classes, such as an arch without a tie and with one.

        Both met the same motions, so the interval of their ratio is narrower than those of the two
        numbers. The interval is by the jackknife over motions, or over earthquakes with all their
        records. InputError if the motions, or the samples of two classes, differ; FitError if one
        of the two has no curve, or if there are fewer than three motions or earthquakes.

        Parameters
        ----------
        before, after : str
            Names of arches or of classes of arches.
        hazard, **given
            As for `risk`; without a hazard there is no row of rates.
        other : Results, optional
            Results of another study on the same motions, in which `after` is.

        Returns
        -------
        pandas.DataFrame
            Rows theta and, with a hazard, rate; columns before, after, ratio, lower, upper.
        """
        site = None
        if hazard is not None or given or self._study.risk is not None:
            site = self._hazard(hazard, **given)[0].main
        both = self._fitted, (other or self)._fitted
        ratios = compare(both, (before, after), site, self._study.report.confidence)
        table = pd.DataFrame(ratios).T
        table.loc["theta", ["before", "after"]] /= self._study.intensity.factor
        return table

    def _hazard(
        self,
        hazard: Hazards | None,
        years: float | None = None,
        unit: str | None = None,
        site: Sequence[float] | None = None,
    ) -> tuple[Hazard, float]:
        """Return the given hazard curve, or the study's, and the years of its probabilities."""
        intensity = self._study.intensity
        period = 50.0
        if hazard is None:
            if unit or site:
                raise InputError(
                    "unit and site are of a hazard; give it too, or leave them out"
                )
            given = self._study.risk
            if given is None:
                raise InputError(
                    "the study has no hazard; give the file of a hazard curve"
                )
            hazard = given.hazard
            unit = given.unit
            site = given.site
            period = given.years
        period = period if years is None else years
        files = hazard if isinstance(hazard, list | tuple) else [hazard]
        if not files or not all(isinstance(each, str | os.PathLike) for each in files):
            if site is not None:
                raise InputError(
                    "a table has no sites, so site cannot choose one; leave it out"
                )
            unit = unit or intensity.unit
            return hazard_of_table(hazard, intensity.measure, unit), period
        paths = list(map(Path, files))
        return load_hazard(paths, intensity.measure, unit, site), period

    def _check_there(self) -> None:
        """Raise InputError if the folder holds other results by now."""
        if read_stamp(self.folder)["files"].get(CUBE) != self._made:
            raise InputError(
                f"{self.folder}: holds other results than these, made since by "
                "another study or run; open them with archfrag.open"
            )

    def response(self, run: str = "median", arch: str | None = None) -> Response:
        """Simulate a run again, with its history.

        Parameters
        ----------
        run : str
            "median", the record whose capacity is nearest to the median; or RECORD@LEVEL, such as
            "syn-m75-r015@0.5", the level in the unit of the study.
        arch : str, optional
            If not given, the first arch of the report.
        """
        self._check_there()
        if self._table:
            raise InputError(
                "a table has no arch and no motions, so no run can be shown"
            )
        if not isinstance(arch, str | None) or not isinstance(run, str):
            raise InputError(
                f"response: cannot use run {run!r} and arch {arch!r}; a run is a text "
                "such as 'syn-m75-r015@0.5', and an arch is given by its name"
            )
        return example_of(self._study, run, arch).response

    def film(self, run: str = "median", arch: str | None = None) -> Film:
        """Make a film of a run; its method `save` writes it as .gif or .mp4.

        `run` and `arch` are as for `response`.
        """
        return self.response(run, arch).animate()

    def report(self) -> Path:
        """Make the report if it is not up to date, and return its path."""
        self._check_there()
        if self._table:
            return make_report(self._study, self._table)
        if out_of_date(self._study, "report"):
            make_step(self._study, "report", None, report=make_report)
        return self.folder / "report.html"

    def to_nrml(
        self,
        path: PathLike,
        discrete: bool = False,
        members: bool = False,
        limit_states: Sequence[str] = (),
        curve: str = "median",
    ) -> Path:
        """Write the curves for OpenQuake as a fragility model in NRML, and return its path.

        The model has lognormal curves, or probabilities at levels if `discrete`. A class has one
        curve; with `members` its arches have curves too. `limit_states` are written besides
        collapse; if none is given, all that have curves. `curve` is "median"; "predictive", the
        mean over uncertain theta and beta; or "branches", 15 curves, with their weights in a
        second file, in CSV. Warnings name what is left out and what to heed.
        """
        kind = f"nrml-{'discrete' if discrete else 'continuous'}"
        self._export(kind, path, members, limit_states, curve)
        return Path(path)

    def to_pelicun(self, path: PathLike, **options) -> list[Path]:
        """Write the curves into a folder as a damage database of pelicun: a CSV and a JSON.

        `options` are members, limit_states and curve, as for `to_nrml`.
        """
        return self._export("pelicun", path, **options)

    def to_incore(self, path: PathLike, **options) -> list[Path]:
        """Write the curves for IN-CORE into a folder: a DFR3 set in JSON for each arch.

        `options` are as for `to_pelicun`.
        """
        return self._export("in-core", path, **options)

    def to_csv(self, path: PathLike, **options) -> list[Path]:
        """Write tables of curves, parameters, runs, records and arches into a folder.

        `options` are as for `to_pelicun`.
        """
        return self._export("csv", path, **options)

    def _export(
        self,
        kind: str,
        path: PathLike,
        members: bool = False,
        limit_states: Sequence[str] = (),
        curve: str = "median",
    ) -> list[Path]:
        """Export to the file `path` in NRML, or to the folder `path` in other formats."""
        self._check_there()
        path = Path(path)
        single = kind.startswith("nrml")
        ends = ("", "-rdls.json", "-branches.csv")
        check_targets([_named(path, end) for end in ends] if single else [])
        if not single and path.suffix in (".csv", ".json") and not path.is_dir():
            raise InputError(
                f"{path}: {kind} is written into a folder; give the folder, such as "
                f"{path.stem}; the files in it are named after the study"
            )
        with tempfile.TemporaryDirectory() as temporary:
            to = Path(temporary) if single else path
            made = export_study(
                self._study, [kind], to, members, limit_states, curve, self._table
            )
            files = [Path(each["file"]) for each in made["files"]]
            if single:
                make_folder(path.parent)
                for file in files:
                    end = f"-{file.name.rpartition('-')[2]}" if file != files[0] else ""
                    text = file.read_text("utf-8").replace(files[0].name, path.name)
                    write_text(_named(path, end), text)
        left = made["left_out"].items()
        messages = [f"no curve of {arch} is exported: {why}" for arch, why in left]
        messages += made["notes"]
        if messages:
            warnings.warn("; ".join(messages), stacklevel=3)
        return files

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the curves of classes, and of arches without a class."""
        from archfrag.plots import axes_of, legend

        ax = axes_of(ax)
        for name in self._fitted.quoted():
            if name in self.curves:
                self.curves[name].plot(ax)
        legend(ax)
        return ax

    def __repr__(self) -> str:
        texts = [
            repr(curve).removeprefix("<Curve ")[:-1] for curve in self.curves.values()
        ]
        more = f"\nand {len(texts) - 1} more" if texts[1:] else ""
        return f"<Results of {self._study.id!r}: {texts[0] if texts else 'no curve'}{more}>"

    def _repr_html_(self) -> str:
        from archfrag.plots import html_of

        return html_of(self) + "".join(
            f"<p>{escape(each)}</p>" for each in self.cautions
        )


def _named(path: Path, end: str) -> Path:
    """Return the path of a file that goes with `path`, or `path` itself if `end` is empty."""
    return path.with_name(f"{path.stem}{end}") if end else path
