"""Figures, tables and sentences of the fragility part; all of it made from its tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from archfrag.evidence.fragility.peers import peers_note
from archfrag.evidence.part import Frames, Note, Section
from archfrag.evidence.speed.reference import MARGIN
from archfrag.report import canvas
from archfrag.report.canvas import Picture, faint_grid, picture
from archfrag.report.styles import METHOD_STYLES, method_style

OURS = ("time_stepping", "auto", "event_driven")
# Where the setting stands beside a point [point], so that neighbours of two methods stay apart.
SHIFT: Mapping[str, tuple[tuple[int, int], str]] = {
    "time_stepping": ((3, 3), "left"),
    "auto": ((-3, -4), "right"),
    "event_driven": ((3, -4), "left"),
}
RECORDS_OF = {"shipped": "shipped synthetic records", "real": "real records"}
SLUG = {"shipped": "fragility_cost", "real": "fragility_cost_real"}


def show(frames: Frames) -> Section:
    """Section of the guide: answer, figures, tables.

    Parameters
    ----------
    frames : mapping of str to DataFrame
        As `archfrag.evidence.fragility.error.measure` gives them, or as read from their files.
    """
    curves, dispersion = frames["curves"], frames["dispersion"]
    pictures: dict[str, Picture] = {}
    notes, lead = [], []
    for study in dict.fromkeys(curves["study"]):
        table = curves[curves["study"] == study]
        pictures[SLUG[study]] = cost_picture(study, table)
        lead += [_answer(study, table), _auto(table)]
        notes.append(_table(study, table))
        if "limit" in set(table["role"]):
            notes.append(_limits_note(table))
    pictures["fragility_dispersion"] = dispersion_picture(curves, dispersion)
    lead += [_share(row) for _, row in dispersion.iterrows()]
    notes += [_dispersion_note(dispersion), _repeated_note(frames["repeated"])]
    if "peers" in frames:
        notes.append(peers_note(frames["peers"]))
    if len(frames["left_out"]):
        rows = tuple(tuple(map(str, row)) for row in frames["left_out"].to_numpy())
        notes.append(Note("Left out", "What was not run.", ("study", "way", "reason"), rows))
    return Section(
        "Fragility: error of the curve against cost of the study", lead, pictures, notes
    )


def _known(table: pd.DataFrame) -> tuple[float, float]:
    """Error of the reference in ln theta and in beta."""
    first = table.iloc[0]
    return float(first["reference_ln_theta_error"]), float(first["reference_beta_error"])


def cost_picture(study: str, table: pd.DataFrame) -> Picture:
    """Error of theta and of beta against the cost of the study.

    Parameters
    ----------
    study : str
    table : DataFrame
        Rows of `curves` of this study.
    """
    first, known = table.iloc[0], _known(table)
    n_record, n_level = int(first["records"]), int(first["runs"] / first["records"])

    def draw(figure: Figure) -> None:
        figure.suptitle(
            f"One fragility curve: {n_record} {RECORDS_OF[study]} × {n_level} levels of PGA, "
            "arch of 7 voussoirs",
            x=0.01, ha="left", fontsize=9.0, fontweight="bold",
        )  # fmt: skip
        panels = figure.subplots(1, 2, sharex=True)
        ways = table[table["role"] == "way"]
        scale = np.array([100.0, 100.0 / _reference_beta(table)])
        titles = ("Error of the median theta (%)", "Error of the dispersion beta (%)")
        for number, (axes, name) in enumerate(zip(panels, ("ln_theta", "beta"))):
            sampling = scale[number] * first[f"sampling_{name}"]
            floor = MARGIN * scale[number] * known[number]
            _panel(axes, ways, name, scale[number], sampling, floor)
            axes.set_title(titles[number])
            axes.set_xlabel("cost of the whole study (CPU seconds, one core)")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(4, len(labels)), frameon=False,
            handlelength=1.6, columnspacing=1.4,
        )  # fmt: skip

    names = ", ".join(method_style(str(name)).label for name in dict.fromkeys(table["method"]))
    return picture(
        SLUG[study],
        (canvas.WIDTH, 4.3),
        draw,
        alternative=f"Error of theta and beta against the CPU time of the study, for {names}.",
        caption=(
            f"Each point is a whole study ({n_record * n_level:,} runs) by one method at one step "
            "or tolerance, as written beside it: lower is more accurate, further left is cheaper. "
            "Bars: 90 % interval of the difference from the reference, records resampled for both "
            f"together. The reference is known to {100 * known[0]:.2g} % in theta; grey is "
            f"{MARGIN:g} times that, and hollow points at its edge say at most. "
            "Dashed: standard error of theta or beta from having "
            f"{n_record} records only ({100 * first['sampling_ln_theta']:.1f} % in theta). "
            f"The reference: {int(first['reference_studies'])} studies of "
            f"{_reference_cost(table)} s each, by fine steps and by events at a tight tolerance."
        ),
    )


def _reference_beta(table: pd.DataFrame) -> float:
    row = table.iloc[0]
    return float(row["beta"] - row["beta_difference"])


def _panel(
    axes: Axes, ways: pd.DataFrame, name: str, scale: float, sampling: float, floor: float
) -> None:
    error = scale * ways[f"{name}_difference"].abs()
    ends = scale * ways[[f"{name}_low", f"{name}_high"]]
    # A reference that knows its curve exactly has no floor, and a scale of decades no zero.
    lowest = (floor, sampling) if floor > 0.0 else (sampling, *error[error > 0.0])
    bottom = 0.6 * min(lowest)
    highest = max(sampling, float(np.nanmax(ends.abs().to_numpy(), initial=0.0)))
    axes.axhspan(0.5 * bottom, floor, color=canvas.PALE, alpha=0.6, linewidth=0)
    axes.axhline(sampling, color=canvas.INK, linestyle=(0, (5, 3)), linewidth=1.0)
    axes.annotate(
        "error of sampling these records", (1.0, sampling), (0, 3), ha="right", fontsize=7.0,
        xycoords=("axes fraction", "data"), textcoords="offset points", color=canvas.INK,
    ).set_in_layout(False)  # fmt: skip
    axes.text(0.02, 0.015, f"grey: {MARGIN:g} times the reference's own error", fontsize=7.0,
              color=canvas.INK, transform=axes.transAxes).set_in_layout(False)  # fmt: skip
    for method, rows in ways.groupby("method", sort=False):
        label, colour, marker, _ = method_style(str(method))
        group = rows.sort_values("cpu_seconds")
        x, own = group["cpu_seconds"].to_numpy(), error[group.index].to_numpy()
        y = np.maximum(own, max(floor, bottom))
        low, high = ends.loc[group.index].to_numpy().T
        over = np.where(low * high < 0.0, floor, np.minimum(abs(low), abs(high)))
        top = np.maximum(np.maximum(abs(low), abs(high)), y)
        axes.vlines(x, np.clip(over, floor, y), top, color=colour, linewidth=1.0, alpha=0.45)
        axes.plot(x, y, color=colour, linewidth=1.0, alpha=0.6)
        within = own <= floor
        axes.plot([], [], marker, color=colour, markersize=6, label=label)
        axes.plot(x[~within], y[~within], marker, color=colour, markersize=6, zorder=5)
        axes.plot(x[within], y[within], marker, markerfacecolor="white", markeredgecolor=colour,
                  markersize=6, zorder=5)  # fmt: skip
        away, side = SHIFT.get(str(method), ((6, -3), "left"))
        for i, way in enumerate(group["way"]):
            axes.annotate(
                _setting(way), (x[i], y[i]), away, fontsize=7.0, color=colour, ha=side,
                va="top" if within[i] and away[1] < 0 else "bottom", textcoords="offset points",
                # Along the edge of the grey there is no room for them to lie down.
                rotation=50.0 if within[i] else 0.0, rotation_mode="default", zorder=6,
            ).set_in_layout(False)  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(bottom, 1.6 * highest)
    axes.yaxis.set_major_locator(LogLocator(10.0, (1.0, 3.0)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_locator(LogLocator(10.0, (1.0, 3.0)))
    axes.xaxis.set_minor_locator(NullLocator())
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_major_formatter(plain)
    axes.yaxis.set_major_formatter(plain)
    axes.margins(x=0.13)
    faint_grid(axes)


def _setting(way: str) -> str:
    """The setting of a way, without its method."""
    setting = way.split(" ", 1)[1].split(",")[0]
    return setting if setting.endswith("ms") else f"{float(setting):.0e}".replace("e-0", "e-")


def dispersion_picture(curves: pd.DataFrame, dispersion: pd.DataFrame) -> Picture:
    """Shares of beta squared, and how much of it other settings do not share.

    Parameters
    ----------
    curves, dispersion : DataFrame
        Tables of the part.
    """
    parts = (
        ("record", "from record to record", canvas.SKY),
        ("level", "from level to level of a record", canvas.PALE),
        ("numerical", "numerical: not the same when run again", canvas.VERMILION),
    )
    bars = dispersion.iloc[::-1].reset_index(drop=True)
    study = curves["study"].iloc[0]
    table = curves[(curves["study"] == study) & (curves["role"] == "way")]

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
        start = np.zeros(len(bars))
        for name, label, colour in parts:
            value = 100.0 * bars[name].to_numpy()
            left.barh(bars.index, value, left=start, color=colour, height=0.55, label=label)
            start += value
        for i, row in bars.iterrows():
            spread = 100.0 * (1.0 - row[["numerical_high", "numerical_low"]].to_numpy(float))
            left.plot(spread, [i, i], color=canvas.INK, linewidth=1.2)
            left.annotate(f"{100 * row['numerical']:.1f} %", (101.0, i), va="center", fontsize=8.0)
        left.set_yticks(bars.index, [_bar_label(row) for _, row in bars.iterrows()])
        left.set_xlim(0.0, 115.0)
        left.set_xticks([0.0, 25.0, 50.0, 75.0, 100.0])
        left.set_xlabel("share of beta² (%)")
        figure.legend(
            *left.get_legend_handles_labels(), loc="outside upper left", ncols=3, frameon=False,
            handlelength=1.2, columnspacing=1.2,
        )  # fmt: skip
        for method, group in table.groupby("method", sort=False):
            _, colour, marker, _ = method_style(str(method))
            group = group.sort_values("cpu_seconds")
            x, y = group["cpu_seconds"].to_numpy(), 100.0 * group["not_shared"].to_numpy()
            right.plot(x, y, color=colour, marker=marker, markersize=5, linewidth=1.0)
            away, side = SHIFT.get(str(method), ((6, -3), "left"))
            for i, way in enumerate(group["way"]):
                right.annotate(
                    _setting(way), (x[i], y[i]), away, fontsize=7.0, color=colour, ha=side,
                    textcoords="offset points",
                ).set_in_layout(False)  # fmt: skip
        right.set_xscale("log")
        right.set_ylim(bottom=0.0)
        right.margins(x=0.16)
        right.xaxis.set_major_locator(LogLocator(10.0, (1.0, 3.0)))
        right.xaxis.set_minor_locator(NullLocator())
        right.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        right.set_xlabel(f"cost of the study (CPU s), {study} records")
        right.set_title("Share of beta² not in common\nwith the reference (%)")
        faint_grid(right)

    return picture(
        "fragility_dispersion",
        (canvas.WIDTH, 1.8 + 0.33 * len(bars)),
        draw,
        alternative="Shares of beta squared: records, levels, numerical; and by way.",
        caption=(
            "Left: what beta² is made of. Rows of one way: the same study made again with motions "
            "larger by 1e-9, 2e-9, …; of accurate ways: one study by each of them. Black: 90 % "
            "interval of the numerical share, records resampled. Right: the part of beta² in "
            "which verdicts of a way do not agree with the reference's; colours as above."
        ),
    )


def _bar_label(row: pd.Series) -> str:
    return f"{_name(row['way'])}\n{row['study']} records"


def _name(way: str) -> str:
    """A way in words."""
    method = way.split(" ")[0]
    if method not in METHOD_STYLES:
        return way
    return f"{method_style(method).label.split(' (')[0]} {_setting(way)}"


def _answer(study: str, table: pd.DataFrame) -> str:
    first = table.iloc[0]
    sampling = first["sampling_ln_theta"]
    ways = table[table["role"] == "way"].sort_values("cpu_seconds")
    theta = ways[_within(ways, "ln_theta")]
    both = theta[_within(theta, "beta")]
    text = (
        f"{int(first['records'])} {RECORDS_OF[study]}: the sample of records leaves theta a "
        f"standard error of {100 * sampling:.1f} %, and the reference is known to "
        f"{100 * _known(table)[0]:.2g} %. "
    )
    if both.empty:
        return text + "No way stays within the sampling error of theta and of beta."
    best, cheap = both.iloc[0], theta.iloc[0]
    return text + (
        f"The cheapest way that stays within the sampling error, with the whole 90 % interval of "
        f"its difference from the reference, is for theta {_name(cheap['way'])} "
        f"({cheap['cpu_seconds']:.1f} s of CPU for {int(cheap['runs'])} runs), for theta and beta "
        f"{_name(best['way'])} ({best['cpu_seconds']:.1f} s; theta "
        f"{_signed(best, 'ln_theta', 100.0)} %, beta "
        f"{_signed(best, 'beta', 100.0 / _reference_beta(table))} %). A study of the reference "
        f"took {_reference_cost(table)} s."
    )


def _auto(table: pd.DataFrame) -> str:
    """What auto costs beside the cheapest of ours that is as good in theta and in beta."""
    ours = table[(table["role"] == "way") & table["method"].isin(OURS)]
    error = ours[["ln_theta_difference", "beta_difference"]].abs().to_numpy()
    error = np.maximum(error, MARGIN * np.array(_known(table)))
    texts = []
    for i in np.flatnonzero(ours["method"] == "auto"):
        row = ours.iloc[i]
        as_good = ours[(error <= error[i]).all(axis=1) & (ours["method"] != "auto")]
        if as_good.empty:
            texts.append(f"{_setting(row['way'])}: no other is as good")
            continue
        other = as_good.sort_values("cpu_seconds").iloc[0]
        ratio = row["cpu_seconds"] / other["cpu_seconds"]
        texts.append(f"{_setting(row['way'])}: {ratio:.1f} times {_name(other['way'])}")
    return (
        "Cost of auto beside the cheapest way of our other methods whose errors of theta and of "
        f"beta are no larger, or within {MARGIN:g} times what the reference is known to: "
        f"{'; '.join(texts)}."
    )


def _within(ways: pd.DataFrame, name: str) -> pd.Series:
    """Ways whose whole interval is no farther from the reference than the sampling error."""
    reach = ways[[f"{name}_low", f"{name}_high"]].abs().max(axis=1, skipna=False)
    return reach <= ways[f"sampling_{name}"]


def _reference_cost(table: pd.DataFrame) -> str:
    members = table[table["role"] == "reference"]
    cost = members.groupby("method", sort=False)["cpu_seconds"].mean()
    return " and ".join(f"{value:.0f}" for value in cost)


def _share(row: pd.Series) -> str:
    return (
        f"Dispersion, {row['study']} records, {_name(row['way'])}: "
        f"{100 * row['numerical']:.1f} % of beta² is numerical (90 %: "
        f"{100 * row['numerical_low']:.1f} to {100 * row['numerical_high']:.1f}), "
        f"{100 * row['record']:.0f} % from record to record "
        f"({100 * row['record_low']:.0f} to {100 * row['record_high']:.0f}), the rest from level "
        f"to level of a record; theta of the {int(row['repetitions'])} repetitions scatters by "
        f"{100 * row['sd_ln_theta']:.2g} %."
    )


def _signed(row: pd.Series, name: str, scale: float) -> str:
    value, low, high = (
        scale * row[key] for key in (f"{name}_difference", f"{name}_low", f"{name}_high")
    )
    return f"{value:+.2f} ({low:+.2f} to {high:+.2f})" if np.isfinite(value) else "no curve"


def _table(study: str, table: pd.DataFrame) -> Note:
    first = table.iloc[0]
    scale = 100.0 / _reference_beta(table)
    rows = tuple(
        (
            f"{row['way']}{' (reference)' if row['role'] == 'reference' else ''}",
            f"{row['theta_g']:.3f}", f"{row['beta']:.3f}", _signed(row, "ln_theta", 100.0),
            _signed(row, "beta", scale), str(int(row["differ"])), str(int(row["failures"])),
            str(int(row["unfinished"])), f"{100 * row['not_shared']:.1f}",
            f"{row['cpu_seconds']:.1f}",
        )
        for _, row in table.iterrows()
    )  # fmt: skip
    return Note(
        f"Every way on the {RECORDS_OF[study]}",
        f"{int(first['runs'])} runs each, PGA in g. Differences from the reference, the curve of "
        f"its {int(first['reference_studies'])} studies together, with 90 % intervals of records "
        "resampled in pairs. The two methods of the reference lie "
        f"{100 * first['reference_ln_theta_apart']:.2f} % apart in theta, "
        f"{scale * first['reference_beta_apart']:.2f} % in beta; it is taken to be known to "
        f"{100 * first['reference_ln_theta_error']:.2f} and "
        f"{scale * first['reference_beta_error']:.2f} %. Its studies disagree in "
        f"{int(first['reference_disagrees'])} verdicts, which are not counted where verdicts "
        f"differ. From the sample of records the standard error of theta is "
        f"{100 * first['sampling_ln_theta']:.1f} % (records resampled; "
        f"{100 * first['se_ln_theta']:.1f} % if runs were independent), of beta "
        f"{scale * first['sampling_beta']:.0f} %. Cost: CPU time of the process that ran it, "
        "kernels loaded before; with several processes at once memory and cores are shared, which "
        "makes it larger but never smaller.",
        ("way", "theta (g)", "beta", "theta (%)", "beta (%)", "verdicts differ", "failures",
         "unfinished", "beta² not shared (%)", "CPU (s)"),
        rows,
    )  # fmt: skip


def _limits_note(table: pd.DataFrame) -> Note:
    rows = []
    for _, row in table[table["role"] == "limit"].iterrows():
        usual = table[table["way"] == str(row["way"]).split(",")[0]].iloc[0]
        rows.append(
            (
                str(row["way"]), _signed(row, "ln_theta", 100.0),
                _signed(usual, "ln_theta", 100.0), f"{row['cpu_seconds']:.1f}",
                f"{usual['cpu_seconds']:.1f}", f"{row['cpu_seconds'] / usual['cpu_seconds']:.2f}",
            )
        )  # fmt: skip
    return Note(
        "The limits at which auto hands over, and the same curve",
        "One limit changed, all else as it is: hand_over is the mean time between events, in time "
        "steps, below which all voussoirs are stepped; above the tolerance coarse they are "
        "stepped throughout (coarse 1: never).",
        ("way", "theta (%)", "theta with the default (%)", "CPU (s)", "with the default (s)",
         "ratio"),
        tuple(rows),
    )  # fmt: skip


def _dispersion_note(dispersion: pd.DataFrame) -> Note:
    def share(row: pd.Series, name: str) -> str:
        low, high = 100.0 * row[f"{name}_low"], 100.0 * row[f"{name}_high"]
        return f"{100.0 * row[name]:.1f} ({low:.1f} to {high:.1f})"

    rows = tuple(
        (
            f"{_name(row['way'])}, {row['study']}", str(int(row["repetitions"])),
            f"{row['beta']:.3f}",
            *(share(row, name) for name in ("numerical", "level", "record")),
            f"{int(row['cases_that_flip'])} of {int(row['cases'])}",
            f"{100.0 * row['sd_ln_theta']:.2f}", f"{row['sd_beta']:.4f}",
        )
        for _, row in dispersion.iterrows()
    )  # fmt: skip
    return Note(
        "What beta² is made of",
        "Shares in per cent with 90 % intervals. The same study made again with motions larger by "
        "k × 1e-9, which acts as an initial state displaced by as much without opening or "
        "pressing a contact by itself. A method that follows a motion continuously answers most "
        "of these alike, as the difference has no time to grow, and may still be wrong; accurate "
        "ways among themselves, a study by each taken for a repetition, tell more. Verdicts are "
        "not monotone in the level, so that a record has no single capacity; the shares are "
        "correlations of a latent normal variable seen in pairs of verdicts: of the same record "
        "at the same level (what is left to 1 is numerical), and of the same record at other "
        "levels (record to record). What comes back in every repetition but changes with the "
        "level is the third part.",
        ("study", "repetitions", "beta", "numerical", "level to level", "record to record",
         "cases whose verdict flips", "sd of ln theta (%)", "sd of beta"),
        rows,
    )  # fmt: skip


def _repeated_note(repeated: pd.DataFrame) -> Note:
    rows = tuple(
        (f"{row['way']}, {row['study']}", f"{int(row['repetition'])} × 1e-9",
         f"{row['theta_g']:.4f}", f"{row['beta']:.4f}")
        for _, row in repeated.iterrows()
    )  # fmt: skip
    return Note(
        "The same study again",
        "Curve of every repetition.",
        ("study", "motion larger by", "theta (g)", "beta"),
        rows,
    )
