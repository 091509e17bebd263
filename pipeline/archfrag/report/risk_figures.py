"""Figures of risk: hazard, fragility and their product; the rate by level and by category."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from archfrag.fragility.contributions import NOT_KNOWN, Contributions
from archfrag.fragility.curve import FloatArray
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, legend_above, picture
from archfrag.report.summary import Scale, digits
from archfrag.study.hazard import Hazard
from archfrag.study.risk import OTHER, ArchRisk

_LOOKS = (
    (canvas.BLUE, ""), (canvas.ORANGE, "////"), (canvas.GREEN, "...."), (canvas.PURPLE, "xxxx"),
    (canvas.SKY, "\\\\\\\\"), (canvas.VERMILION, "----"), (canvas.INK, ""), ("#8c6d31", ""),
)  # fmt: skip
_REACH = 1e-4  # of the greatest density of the rate, where the axis ends


def hazard_and_fragility(
    arch: ArchRisk, hazard: Hazard, scale: Scale, name: str, width: float = canvas.WIDTH
) -> Picture:
    """Hazard curve, fragility curve and where the rate of collapse comes from, one over another.

    Parameters
    ----------
    arch : ArchRisk
    hazard : Hazard
    scale : Scale
        Unit in which intensities are shown.
    name : str
        Unique on the page.
    width : float
        [inch]
    """
    im = _shown(arch, hazard)
    density = _density(arch, hazard, im)

    def draw(figure: Figure) -> None:
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1.3, 1.0, 1.0))
        for i, (key, curve) in reversed(list(enumerate(hazard.curves.items()))):
            look = (
                {"color": canvas.BLUE, "lw": 1.6} if i == 0 else {"color": canvas.GREY, "lw": 0.8}
            )
            top.loglog(im * scale.factor, curve.rate_at(im), label=key, **look)  # type: ignore[arg-type]
        points = hazard.main.im
        seen = (points >= im[0]) & (points <= im[-1])
        top.plot(points[seen] * scale.factor, hazard.main.rate[seen], "o", color=canvas.BLUE, ms=3)
        top.set_ylabel("exceeded [1/year]")
        _rate_ticks(top)
        if len(hazard.curves) > 1:
            legend_above(top)
        middle.plot(im * scale.factor, arch.fit.probability(im), color=canvas.VERMILION)
        middle.set(ylabel="P(collapse) [1]", ylim=(-0.02, 1.02))
        bottom.fill_between(im * scale.factor, density, color=canvas.SKY, alpha=0.5, lw=0.0)
        bottom.plot(im * scale.factor, density, color=canvas.BLUE)
        bottom.set(ylabel="rate per ln im\n[1/year]", xlabel=scale.label, ylim=(0.0, None))
        _rate_ticks(bottom)
        _plain_ticks(bottom)
        for axes in (top, middle, bottom):
            for end in (points[0], points[-1]):
                if im[0] < end < im[-1]:
                    axes.axvline(end * scale.factor, color=canvas.GREY, ls=":", lw=0.9)
            faint_grid(axes)

    rate = arch.rate
    return picture(
        name, (width, 5.0), draw,
        alternative=f"Hazard curve, fragility curve of {arch.arch} and their product; rate of "
        f"collapse {rate.rate:.2g} a year",
        caption="From above: how often a year an intensity is exceeded (points: as given); "
        "probability of collapse; and the rate of collapse by motions of an intensity, whose "
        f"area is the rate of collapse, {rate.rate:.2g} a year. Dotted: ends of the hazard curve, "
        f"beyond which its slope goes on; {100 * rate.outside:.1f} % of the rate is from there.",
    )  # fmt: skip


def deaggregation(
    arch: ArchRisk, scale: Scale, name: str, width: float = canvas.WIDTH
) -> Picture | None:
    """The rate by level, split by mechanism, and its fractions by magnitude and distance.

    None if no run collapsed.
    """
    if not arch.by_mechanism.counts.any():
        return None
    beside = [
        (title, found)
        for title, found in (("magnitude", arch.by_magnitude), ("distance", arch.by_distance))
        if any(n.any() for c, n in zip(found.categories, found.counts) if c != NOT_KNOWN)
    ]
    narrow = width < 5.0

    def draw(figure: Figure) -> None:
        panels = 1 + len(beside)
        if narrow or not beside:
            main, *others = figure.subplots(panels, 1, squeeze=False)[:, 0]
        else:
            grid = figure.add_gridspec(len(beside), 2, width_ratios=(1.5, 1.0))
            main = figure.add_subplot(grid[:, 0])
            others = [figure.add_subplot(grid[i, 1]) for i in range(len(beside))]
        _stack(main, arch, scale)
        for axes, (title, found) in zip(others, beside):
            _bars(axes, found)
            axes.set_title(f"by {title}")

    confidence = f"{100 * arch.by_mechanism.confidence:.0f} %"
    return picture(
        name, (width, 4.2 + (2.2 * len(beside) if narrow else 0.0)), draw,
        alternative=f"Rate of collapse of {arch.arch} by level and mechanism, and its fractions "
        "by magnitude and distance of the records",
        caption="Rate of collapse by motions nearest to each level, shared out as the collapses "
        "at that level were; grey: levels at which none was seen. Beside it, fractions of the "
        f"rate by records of each magnitude and distance, with {confidence} bands from resampled "
        "records. They hold for this set of records and are no deaggregation of the hazard.",
    )  # fmt: skip


def _shown(arch: ArchRisk, hazard: Hazard) -> FloatArray:
    """Intensities from which all but a small part of the rate comes, SI unit."""
    wide = np.concatenate([arch.levels, hazard.main.im, [arch.fit.theta]])
    im = np.geomspace(0.2 * wide.min(), 5.0 * wide.max(), 1200)
    density = _density(arch, hazard, im)
    used = im[density > _REACH * density.max()]
    low, high = min(used[0], arch.levels[0]), max(used[-1], arch.levels[-1])
    return np.geomspace(low, high, 400)


def _density(arch: ArchRisk, hazard: Hazard, im: FloatArray) -> FloatArray:
    """Rate of collapse per unit of ln im [1/year]; jumps where the slope of the hazard does."""
    curve = hazard.main
    slope = curve.slopes[np.searchsorted(curve.im, im, side="right")]
    return arch.fit.probability(im) * slope * curve.rate_at(im)


def _rate_ticks(axes: Axes) -> None:
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.2g}"))
    if axes.get_yscale() == "log":
        axes.yaxis.set_minor_formatter(NullFormatter())


def _plain_ticks(axes: Axes) -> None:
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _stack(axes: Axes, arch: ArchRisk, scale: Scale) -> None:
    found = arch.by_mechanism
    base = np.zeros(arch.levels.size)
    place = np.arange(base.size)
    parts: list[tuple[str, FloatArray, tuple[str, str]]] = [
        (name, rate, (canvas.PALE, "") if name == OTHER else _LOOKS[i % len(_LOOKS)])
        for i, (name, rate) in enumerate(zip(found.categories, found.rate))
        if rate.any()
    ]
    if found.unassigned.any():
        parts.append(("no collapse seen", found.unassigned, (canvas.GREY, "")))
    for label, rate, (colour, hatch) in parts:
        axes.bar(
            place, rate, bottom=base, width=0.85, label=label, facecolor=colour, hatch=hatch,
            edgecolor="white", linewidth=0.4,
        )  # fmt: skip
        base += rate
    step = max(1, -(-base.size // 6))
    axes.set_xticks(place[::step], [digits(level * scale.factor) for level in arch.levels[::step]])
    axes.set(xlabel=scale.label, ylabel="rate of collapse [1/year]")
    axes.set_title("by level and mechanism")
    _rate_ticks(axes)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), borderaxespad=0.0, ncols=2)
    faint_grid(axes, "y")


def _bars(axes: Axes, found: Contributions) -> None:
    kept: Sequence[int] = [i for i, rate in enumerate(found.rate) if rate.any()]
    place = np.arange(len(kept))
    value, low, high = (x[kept] for x in (found.fraction, found.lower, found.upper))
    reach = np.stack([np.maximum(value - low, 0.0), np.maximum(high - value, 0.0)])
    axes.barh(place, value, height=0.7, color=canvas.SKY)
    axes.errorbar(value, place, xerr=reach, fmt="none", ecolor=canvas.INK, lw=1.0, capsize=2.0)
    axes.set_yticks(place, [found.categories[i] for i in kept])
    axes.set(xlim=(0.0, 1.0), xlabel="fraction of the rate [1]")
    faint_grid(axes, "x")
