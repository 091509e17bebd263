"""Rates of collapse as JSON and as text."""

from typing import Any

from archfrag.fragility.contributions import Contributions
from archfrag.study.answer.risk import ArchRisk, StudyRisk
from archfrag.study.file.schema import Study
from archfrag.study.provenance import finite

ASSUMPTIONS = (
    "hazard: ln rate linear in ln intensity between its points, the first and the last slope "
    "beyond them",
    "band: of the fragility curve's parameters only, from draws; none of the hazard, whose curves "
    "are listed one by one",
    "mean rate: over the same draws; what the hazard's extension below its first point adds to "
    "each is at most the hazard's rate at that point",
    "collapses: a Poisson process, the arch being put up again each time",
    "a class: the mean of the rates of its arches, if all of them have a curve",
    "by mechanism, magnitude and distance: as the collapses of this set of records, level by "
    "level; this is no deaggregation of the hazard",
)


def risk_facts(risk: StudyRisk, study: Study) -> dict[str, Any]:
    """All of a result in plain numbers; intensities in the unit of the study.

    ``arches`` holds classes too; ``classes`` is the number of arches of each.
    """
    factor = study.intensity.factor
    facts = {
        "study": risk.study,
        "measure": risk.hazard.measure,
        "unit": study.intensity.unit,
        "years": risk.years,
        "hazard": {
            "source": risk.hazard.source,
            "notes": list(risk.hazard.notes),
            "curves": {
                name: {"im": (curve.im / factor).tolist(), "rate": curve.rate.tolist()}
                for name, curve in risk.hazard.curves.items()
            },
        },
        "assumptions": list(ASSUMPTIONS),
        "arches": {
            name: {"none": arch} if isinstance(arch, str) else _arch(arch, risk.years, factor)
            for name, arch in risk.arches.items()
        },
        "classes": risk.classes,
    }
    plain: dict[str, Any] = finite(facts, None)
    return plain


def _arch(arch: ArchRisk, years: float, factor: float) -> dict[str, Any]:
    rate = arch.rate
    value, low, high = rate.probability_in(years)
    return {
        "theta": arch.fit.theta / factor,
        "beta": arch.fit.beta,
        "rate": rate.quoted,
        "rate_is_lower_bound": rate.is_bound,
        "rate_mean": rate.mean,
        "rate_band": [rate.lower, rate.upper],
        "confidence": rate.confidence,
        "return_period": rate.return_period if rate.quoted > 0.0 else None,
        "probability": value,
        "probability_band": [low, high],
        "below_hazard_curve": rate.below,
        "above_hazard_curve": rate.above,
        "below_levels": arch.below_levels,
        "above_levels": arch.above_levels,
        "rate_by_hazard_curve": arch.by_curve,
        "levels": (arch.levels / factor).tolist(),
        "edges": (arch.edges / factor).tolist(),
        "rate_by_level": arch.level_rate.tolist(),
        "by_mechanism": _split(arch.by_mechanism),
        "by_magnitude": _split(arch.by_magnitude),
        "by_distance": _split(arch.by_distance),
        "cautions": list(arch.cautions),
    }


def _split(found: Contributions) -> list[dict[str, Any]]:
    return [
        {
            "category": name, "collapses": int(found.counts[i].sum()),
            "fraction": float(found.fraction[i]),
            "band": [float(found.lower[i]), float(found.upper[i])],
            "rate_by_level": found.rate[i].tolist(),
        }
        for i, name in enumerate(found.categories) if found.shown[i]
    ]  # fmt: skip


def risk_text(facts: dict[str, Any]) -> str:
    """What `risk_facts` gives, as lines for a terminal."""
    hazard = facts["hazard"]
    lines = [f"hazard: {hazard['source']}, curve {next(iter(hazard['curves']))!r}"]
    lines += [f"note: {note}" for note in hazard["notes"]]
    for name, arch in facts["arches"].items():
        lines += ["", *_lines(name, arch, facts)]
    return "\n".join([*lines, "", *(f"assumed: {each}" for each in facts["assumptions"])])


def _lines(name: str, arch: dict[str, Any], facts: dict[str, Any]) -> list[str]:
    title = f"class {name}, {facts['classes'][name]} arches" if name in facts["classes"] else name
    if "none" in arch:
        return [f"{title}: no rate, since there is no curve: {arch['none']}"]
    percent, unit = f"{100 * arch['confidence']:.0f} %", facts["unit"]
    low, high = arch["rate_band"]
    p_low, p_high = arch["probability_band"]
    period = arch["return_period"]
    bound = arch["rate_is_lower_bound"]
    least = "at least " if bound else ""
    band = " (within the hazard curve)" if bound else f" ({percent}: {low:.3g} to {high:.3g})"
    likely = "" if bound else f" ({percent}: {p_low:.3g} to {p_high:.3g})"
    longest = "at most " if bound else ""
    lines = [
        f"{title}: median {arch['theta']:.4g} {unit} of {facts['measure']}, dispersion "
        f"{arch['beta']:.3g}",
        f"  rate of collapse of these medians {least}{arch['rate']:.3g} a year{band}, "
        + ("never" if period is None else f"return period {longest}{period:.4g} years"),
        f"  probability in {facts['years']:g} years {least}{arch['probability']:.3g}{likely}",
    ]
    if not bound:
        lines.insert(2, f"  mean over theta and beta as uncertain as they are "
                     f"{arch['rate_mean']:.3g} a year")  # fmt: skip
    others = list(arch["rate_by_hazard_curve"].items())[1:]
    lines += [f"  with the hazard {key!r}: {value:.3g} a year" for key, value in others]
    lines.append(f"  {'from ' + unit:>14s} {'rate':>10s} {'fraction':>9s}")
    starts = [0.0, *arch["edges"]]
    total = sum(arch["rate_by_level"]) or 1.0
    lines += [
        f"  {start:14.3g} {rate:10.2e} {rate / total:9.3f}"
        for start, rate in zip(starts, arch["rate_by_level"])
    ]
    for key in ("by_mechanism", "by_magnitude", "by_distance"):
        lines.append(f"  {key.replace('_', ' ')}")
        for part in arch[key]:
            (low, high), count = part["band"], part["collapses"]
            band = f" ({percent}: {low:.3f} to {high:.3f}), {count} collapses"
            if low is None:  # one collapse has no interval
                band = ", 1 collapse"
            lines.append(f"    {part['category']:24s} {part['fraction']:6.3f}{band}")
    return lines + [f"  caution: {caution}" for caution in arch["cautions"]]
