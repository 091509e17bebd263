"""What the page shows of risk, by the names that its template uses."""

from typing import Any

from archfrag.fragility.contributions import Contributions
from archfrag.report import tables
from archfrag.report.axes import digits
from archfrag.report.risk_figures import deaggregation, hazard_and_fragility
from archfrag.report.summary import Scale
from archfrag.study.members import SHOWN
from archfrag.study.risk import ArchRisk, StudyRisk
from archfrag.study.risk_output import ASSUMPTIONS


def risk_section(risk: StudyRisk | None, scale: Scale) -> dict[str, Any] | None:
    """Rates of collapse, their tables and figures, by the names of the page's template.

    Of many arches only the first have figures: each takes 0.3 MB. None without a risk.
    """
    if risk is None:
        return None
    shown = SHOWN if len(risk.arches) <= SHOWN else 3
    arches = [
        {"name": name, "none": arch, "cautions": ()}
        if isinstance(arch, str)
        else _arch(arch, risk, scale)
        for name, arch in list(risk.arches.items())[:shown]
    ]
    return {
        "years": f"{risk.years:g}",
        "hazard": risk.hazard.source,
        "curve": risk.hazard.main_name,
        "notes": risk.hazard.notes,
        "assumptions": ASSUMPTIONS,
        "table": _answers(risk),
        "arches": arches,
    }


def _arch(arch: ArchRisk, risk: StudyRisk, scale: Scale) -> dict[str, Any]:
    return {
        "name": arch.arch,
        "none": None,
        "cautions": arch.cautions,
        "picture": hazard_and_fragility(arch, risk.hazard, scale),
        "fractions": deaggregation(arch, scale),
        "levels": _levels(arch, scale),
        "contributions": _contributions(arch),
    }


def _answers(risk: StudyRisk) -> tables.Table:
    """Rates with their bands, and the rates with the other curves of the hazard."""
    others = list(risk.hazard.curves)[1:]
    known = [arch for arch in risk.arches.values() if not isinstance(arch, str)]
    percent = f"{100 * known[0].rate.confidence:.0f} %" if known else "band"
    heads = [
        "arch", "collapses a year", percent, "return period [years]",
        f"probability in {risk.years:g} years", percent, "beyond the hazard curve",
        *(f"a year, {name}" for name in others),
    ]  # fmt: skip
    rows = []
    for name, arch in risk.arches.items():
        if isinstance(arch, str):
            rows.append([name, "no curve", *["–"] * (len(heads) - 2)])
            continue
        rate = arch.rate
        value, low, high = rate.probability_in(risk.years)
        rows.append([
            name, f"{rate.rate:.2g}", f"{rate.lower:.2g} to {rate.upper:.2g}",
            _years(rate.return_period),
            f"{value:.2g}", f"{low:.2g} to {high:.2g}", f"{100 * rate.outside:.1f} %",
            *(f"{arch.by_curve[key]:.2g}" for key in others),
        ])  # fmt: skip
    return tables.Table(heads, rows)


def _levels(arch: ArchRisk, scale: Scale) -> tables.Table:
    edges = [0.0, *(arch.edges * scale.factor), float("inf")]
    total = arch.rate.rate or 1.0
    rows = [
        [
            f"{digits(low) if low else '0'} to {digits(high)}" if high < float("inf")
            else f"from {digits(low)} on",
            f"{rate:.2g}", f"{rate / total:.3f}", str(fell),
        ]
        for low, high, rate, fell in zip(
            edges[:-1], edges[1:], arch.level_rate, arch.by_mechanism.counts.sum(axis=0)
        )
    ]  # fmt: skip
    return tables.Table([scale.label, "rate [1/year]", "fraction", "collapses"], rows)


def _contributions(arch: ArchRisk) -> tables.Table:
    groups = (
        ("mechanism", arch.by_mechanism), ("magnitude", arch.by_magnitude),
        ("distance", arch.by_distance),
    )  # fmt: skip
    percent = f"{100 * arch.by_mechanism.confidence:.0f} %"
    rows = [row for title, found in groups for row in _rows(title, found)]
    heads = ["by", "category", "fraction of the rate", percent, "collapses"]
    return tables.Table(heads, rows, numeric_from=2)


def _rows(title: str, found: Contributions) -> list[list[str]]:
    return [
        [
            title, name, f"{found.fraction[i]:.2f}",
            f"{found.lower[i]:.2f} to {found.upper[i]:.2f}", str(found.counts[i].sum()),
        ]
        for i, name in enumerate(found.categories)
        if found.rate[i].any()
    ]  # fmt: skip


def _years(period: float) -> str:
    """Three digits, never as a power of ten."""
    if period > 1e9:
        return "more than 1e9"
    return f"{float(f'{period:.3g}'):,.{0 if period >= 100.0 else 1}f}"
