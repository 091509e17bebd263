"""What users ask for: theta and beta of a fragility curve, against what the whole study costs.

One study is the main job of the README: its arch, its records, the same stripes of PGA, and
`fit_stripes`. Each way makes all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd

from archfrag.errors import FitError
from archfrag.evidence.fragility.charts import show
from archfrag.evidence.fragility.partition import (
    Array,
    between_ways,
    bounds,
    draws,
    parts_of,
    resampled_parts,
)
from archfrag.evidence.fragility.peers import compare_peers
from archfrag.evidence.fragility.reference import known_to, reference_ways
from archfrag.evidence.fragility.studies import (
    Records,
    predicted_seconds,
    real_records,
    run_studies,
    shipped_records,
)
from archfrag.evidence.part import Setup
from archfrag.evidence.run import Way
from archfrag.evidence.ways import AUTO_LIMITS
from archfrag.fragility.counts import Verdict
from archfrag.fragility.fit import fit_stripes
from archfrag.methods.registry import METHODS
from archfrag.simulation.checks import available_methods

__all__ = ["measure", "show"]

STEPS = (16e-3, 8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
TOLERANCES = (1e-1, 3e-2, 1e-2, 1e-3, 1e-4)
# Steps at which the models that are there to be compared with are run, where they take one.
COMPARED = {
    "four_link": 2e-3, "penalty": 1e-3, "gauss_seidel": 4e-3, "quadratic_programme": 4e-3,
}  # fmt: skip
# A compared model is left out where the study by it would take longer [s of CPU].
LONGEST = {True: 40.0, False: 400.0}
REPEATED = (Way("auto", "rtol", 1e-3), Way("time_stepping", "dt", 5e-4))
SEED = 20250101
# Ways that are held to be right: how far they agree among themselves tells what no way knows.
ACCURATE = {"time_stepping": 5e-4, "auto": 1e-3, "event_driven": 1e-4}
AMONG = "accurate ways"
TAILS = (0.05, 0.95)


def ways_of(quick: bool) -> list[Way]:
    """Ways of ours that are compared, in the order of the table."""
    steps, tolerances = (STEPS[:6], TOLERANCES[:4]) if quick else (STEPS, TOLERANCES)
    ways = [Way("time_stepping", "dt", step) for step in steps]
    ways += [Way("auto", "rtol", tolerance) for tolerance in tolerances]
    return [*ways, Way("event_driven", "rtol", 1e-4)]


def repetitions(quick: bool, study: str) -> int:
    """How often a study is made again with a disturbed motion."""
    return {True: 4, False: 6}[quick] if study == "shipped" else 3


def compared(records: Records, quick: bool) -> tuple[list[Way], list[tuple[str, str, str]]]:
    """Models to be compared with that are there and affordable; and why others are left out."""
    ways, left_out = [], []
    for name, step in COMPARED.items():
        if name not in available_methods():
            continue
        takes_step = any(parameter.name == "dt" for parameter in METHODS[name].parameters)
        way = Way(name, "dt", step) if takes_step else Way(name, "rtol", 1e-4)
        seconds = predicted_seconds(records, way)
        if seconds > LONGEST[quick]:
            reason = f"the study would take about {seconds:.0f} s, more than {LONGEST[quick]:g} s"
            left_out.append((records.study, str(way), reason))
        else:
            ways.append(way)
    return ways, left_out


def measure(setup: Setup) -> dict[str, pd.DataFrame]:
    """Make the studies.

    Parameters
    ----------
    setup : Setup
        `quick` takes 20 of the 30 shipped records, every second level and fewer settings.

    Returns
    -------
    dict of str to DataFrame
        `runs`, every run; `curves`, a row for each study and way; `dispersion`, what beta is
        made of; `repeated`, the curve of each repetition; `left_out`, and why.
    """
    studies = [shipped_records(setup)]
    real = real_records(setup)
    left_out = []
    if real is None:
        left_out.append(("real", "all", "no folder with at2/*.AT2 was given (--real)"))
    else:
        studies.append(real)
    wanted: list[tuple[Records, Way, int]] = []
    for records in studies:
        others, missing = compared(records, setup.quick)
        left_out += missing
        # The longest first, so that no process is left alone with them at the end.
        again = repetitions(setup.quick, records.study)
        # Records of others are for a second opinion, at the quick set's price.
        members = reference_ways(setup.quick or records.study != "shipped")
        ways = [*chain(*members), *ways_of(setup.quick), *others]
        ways += AUTO_LIMITS if records.study == "shipped" else ()
        wanted += [(records, way, 0) for way in ways]
        wanted += [(records, way, k) for way in REPEATED for k in range(1, 1 + again)]
    runs = run_studies(wanted, setup.workers)
    resamples = 400 if setup.quick else 1000
    groups = tuple(tuple(map(str, ways)) for ways in reference_ways(setup.quick))
    frames: dict[str, pd.DataFrame] = {}
    if setup.peers:
        frames["peers"], missing = compare_peers(setup, studies[0])
        left_out += missing
    return frames | {
        "runs": runs,
        "curves": curves_table(runs, groups, resamples),
        "dispersion": dispersion_table(runs, resamples // 2),
        "repeated": repeated_table(runs),
        "left_out": pd.DataFrame(left_out, columns=["study", "way", "reason"]),
    }


class Outcomes:
    """Verdicts of one study by one way as counts, (n_record, n_level)."""

    def __init__(self, runs: pd.DataFrame) -> None:
        self.levels = np.sort(runs["level"].unique())
        order = list(dict.fromkeys(runs["record"]))

        def count(verdict: Verdict) -> Array:
            hit = runs.assign(hit=(runs["verdict"] == int(verdict)).astype(float))
            table = hit.pivot_table("hit", "record", "level", aggfunc="sum")
            return table.loc[order, self.levels].to_numpy()

        self.fallen, self.stood = count(Verdict.COLLAPSED), count(Verdict.STANDING)
        self.unfinished = int((runs["verdict"] == int(Verdict.UNFINISHED)).sum())
        self.failures = int((runs["verdict"] == int(Verdict.SOLVER_FAILURE)).sum())

    @property
    def counts(self) -> tuple[Array, Array]:
        """Collapsed and stood, (n_record, n_level) each."""
        return self.fallen, self.stood

    def curve(self, chosen: Any = slice(None)) -> tuple[float, float]:
        """ln theta and beta of some records; nan if there is no curve."""
        fallen, stood = self.fallen[chosen].sum(axis=0), self.stood[chosen].sum(axis=0)
        try:
            fit = fit_stripes(self.levels, fallen, fallen + stood)
        except FitError:
            return np.nan, np.nan
        return float(np.log(fit.theta)), fit.beta

    def standard_errors(self) -> tuple[float, float]:
        """Of ln theta and beta, runs taken as independent; nan if there is no curve."""
        fallen, stood = self.fallen.sum(axis=0), self.stood.sum(axis=0)
        try:
            errors = fit_stripes(self.levels, fallen, fallen + stood).standard_errors
        except FitError:
            return np.nan, np.nan
        return float(errors[0]), float(errors[1])


def curves_table(
    runs: pd.DataFrame, groups: Sequence[Sequence[str]], resamples: int
) -> pd.DataFrame:
    """Curve of each study and way beside the reference, records resampled in pairs.

    Parameters
    ----------
    runs : DataFrame
        Of `run_studies`; only those not disturbed count.
    groups : sequence of sequence of str
        Ways that the reference is made of, for each of its two methods.
    resamples : int
        Sets of records drawn, the same for the way and the reference.
    """
    rows = []
    for study, group in runs.groupby("study", sort=False):
        found = dict(iter(group[group["repetition"] == 0].groupby("way", sort=False)))
        mine = [[name for name in names if name in found] for names in groups]
        members = [name for names in mine for name in names]
        reference = Outcomes(pd.concat([found[name] for name in members]))
        alone = [[Outcomes(found[name]).curve() for name in names] for names in mine]
        halves = [Outcomes(pd.concat([found[name] for name in names])) for names in mine]
        together = [each.curve() for each in halves]
        drawn = draws(reference.fallen.shape[0], resamples, SEED)
        centre = np.array(reference.curve())
        centres = np.array([reference.curve(records) for records in drawn])
        sampling = np.nanstd(centres, axis=0, ddof=1)
        apart, known = np.abs(np.subtract(together[0], together[1])), known_to(together, alone)
        whole = len(members)
        fell, held = reference.fallen == whole, reference.stood == whole
        for way, part in found.items():
            outcomes = Outcomes(part)
            own = np.array(outcomes.curve())
            differences = np.array([outcomes.curve(records) for records in drawn]) - centres
            curved = ~np.isnan(differences).any(axis=1)
            low, high = (
                np.quantile(differences[curved], TAILS, axis=0)
                if curved.sum() > resamples // 2 else np.full((2, 2), np.nan)
            )  # fmt: skip
            differ = (fell & (outcomes.fallen < 1)) | (held & (outcomes.stood < 1))
            errors = outcomes.standard_errors()
            rows.append(
                {
                    "study": study, "way": way, "role": _role(str(way), members),
                    "method": str(way).split(" ")[0], "runs": len(part),
                    "records": reference.fallen.shape[0],
                    "theta_g": float(np.exp(own[0])), "beta": own[1],
                    "se_ln_theta": errors[0], "se_beta": errors[1],
                    "sampling_ln_theta": sampling[0], "sampling_beta": sampling[1],
                    "ln_theta_difference": own[0] - centre[0],
                    "ln_theta_low": low[0], "ln_theta_high": high[0],
                    "beta_difference": own[1] - centre[1],
                    "beta_low": low[1], "beta_high": high[1],
                    "reference_ln_theta_apart": apart[0], "reference_beta_apart": apart[1],
                    "reference_ln_theta_error": known[0], "reference_beta_error": known[1],
                    "reference_studies": whole,
                    "reference_disagrees": int(np.sum(~fell & ~held)),
                    "differ": int(differ.sum()), "unfinished": outcomes.unfinished,
                    "failures": outcomes.failures, "not_shared": _not_shared(outcomes, reference),
                    "resamples_without_curve": int(resamples - curved.sum()),
                    "cpu_seconds": float(part["cpu_seconds"].sum()),
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def _role(way: str, members: Sequence[str]) -> str:
    if way in members:
        return "reference"
    return "limit" if way in {str(each) for each in AUTO_LIMITS} else "way"


def _not_shared(outcomes: Outcomes, reference: Outcomes) -> float:
    """Share of beta squared that verdicts of a way do not have in common with the reference's."""
    try:
        scales = [bounds(each.levels, *each.counts)[0] for each in (outcomes, reference)]
    except FitError:
        return np.nan
    pairs = between_ways((*outcomes.counts, scales[0]), (*reference.counts, scales[1]))
    return 1.0 - pairs.correlation()


def repeated_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Curve of every repetition of the studies that were made again."""
    again = set(runs.loc[runs["repetition"] > 0, "way"])
    rows = []
    chosen = runs[runs["way"].isin(again)]
    for (study, way, number), part in chosen.groupby(["study", "way", "repetition"], sort=False):
        ln_theta, beta = Outcomes(part).curve()
        rows.append((study, way, number, float(np.exp(ln_theta)), beta))
    return pd.DataFrame(rows, columns=["study", "way", "repetition", "theta_g", "beta"])


def dispersion_table(runs: pd.DataFrame, resamples: int) -> pd.DataFrame:
    """What beta squared is made of, for every study that was made again.

    Rows of `AMONG` take the ways of `ACCURATE`, undisturbed, for repetitions of one study.

    Parameters
    ----------
    runs : DataFrame
        Of `run_studies`.
    resamples : int
        Sets of records drawn for the intervals.
    """
    rows = []
    again = set(runs.loc[runs["repetition"] > 0, "way"])
    accurate = [way for way in dict.fromkeys(runs["way"]) if _is_accurate(way)]
    first = runs[(runs["repetition"] == 0) & runs["way"].isin(accurate)]
    numbers = {way: number for number, way in enumerate(accurate)}
    among = first.assign(way=AMONG, repetition=first["way"].map(numbers))
    chosen = pd.concat([runs[runs["way"].isin(again)], among])
    for (study, way), part in chosen.groupby(["study", "way"], sort=False):
        outcomes = Outcomes(part)
        parts = parts_of(outcomes.levels, *outcomes.counts)
        drawn = resampled_parts(outcomes.levels, *outcomes.counts, resamples, SEED)
        low, high = np.quantile(drawn, TAILS, axis=0)
        flipping = (outcomes.fallen > 0) & (outcomes.stood > 0)
        row: dict[str, Any] = {
            "study": study, "way": way, "repetitions": part["repetition"].nunique(),
            "records": outcomes.fallen.shape[0], "runs": len(part), "beta": parts.beta,
            "cases": flipping.size, "cases_that_flip": int(flipping.sum()),
        }  # fmt: skip
        for number, name in enumerate(("numerical", "level", "record")):
            row |= {
                name: getattr(parts, name), f"{name}_low": low[number],
                f"{name}_high": high[number],
            }  # fmt: skip
        curves = repeated_table(part)
        row["sd_ln_theta"] = float(np.log(curves["theta_g"]).std(ddof=1))
        row["sd_beta"] = float(curves["beta"].std(ddof=1))
        rows.append(row)
    return pd.DataFrame(rows)


def _is_accurate(way: str) -> bool:
    """Whether a way's step or tolerance is no larger than that of `ACCURATE`."""
    if _role(way, ()) == "limit":
        return False
    method, value, *unit = way.split(",")[0].split(" ")
    return float(value) * (1e-3 if unit else 1.0) <= ACCURATE.get(method, 0.0) * (1.0 + 1e-9)
