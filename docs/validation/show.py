"""Plot and tables of the validation page, from the values that tests have written."""

import csv
import re
from html import escape
from pathlib import Path

import look
import numpy as np
from IPython.display import HTML
from matplotlib.figure import Figure

from archfrag.report.svg import BLUE, GREEN, GREY, ORANGE, VERMILION

ROWS = Path(__file__).with_name("values.csv")
SOLVERS = re.compile("LMGC90|MuJoCo|pymunk|Siconos|UDEC|HybriDFEM")
PUBLISHED = re.compile(r"\b(19|20)\d\d\b|pygmm")
KINDS = {"published": (BLUE, "o"), "formula or other code": (GREEN, "s"),
         "other solver": (ORANGE, "^")}  # fmt: skip
LEAST = 1e-6  # difference that is drawn; smaller ones are at the border
HEAD = ("case", "quantity", "reference", "ours", "difference", "allowed", "source")


def rows() -> list[dict[str, str]]:
    """All rows of the committed table."""
    with ROWS.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def kind(source: str) -> str:
    """Where a reference is from."""
    if SOLVERS.search(source):
        return "other solver"
    return "published" if PUBLISHED.search(source) else "formula or other code"


def plot() -> HTML:
    """Ours against the reference, one mark a value, and the differences below."""
    figure = Figure((look.WIDTH, 6.0), layout="constrained")
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    shown = [row for row in rows() if float(row["reference"]) != 0.0]
    given, ours = (np.abs([float(row[name]) for row in shown]) for name in ("reference", "ours"))
    away = np.maximum(np.abs(ours / given - 1.0), LEAST)
    kinds = np.array([kind(row["source"]) for row in shown])
    for name, (colour, marker) in KINDS.items():
        own = kinds == name
        look_of = {"color": colour, "marker": marker, "ls": "", "ms": 4.0, "alpha": 0.8}
        top.plot(given[own], ours[own], label=f"{name} ({own.sum()})", **look_of)
        below.plot(given[own], 100.0 * away[own], **look_of)
    missed = np.array([row["holds"] == "no" for row in shown])
    ring = {"color": VERMILION, "marker": "o", "ls": "", "ms": 8.5, "mfc": "none"}
    top.plot(given[missed], ours[missed], label=f"outside its tolerance ({missed.sum()})", **ring)
    below.plot(given[missed], 100.0 * away[missed], **ring)
    ends = given.min() / 2.0, 2.0 * given.max()
    top.plot(ends, ends, color=GREY, lw=0.8, zorder=0)
    top.set(xscale="log", yscale="log", xlim=ends, ylim=ends, ylabel="our value")
    below.set(yscale="log", xlabel="reference, each in its own unit", ylabel="difference (%)")
    below.set_yticks([1e-4, 1e-2, 1.0, 100.0], ["≤ 0.0001", "0.01", "1", "100"])
    for axes in (top, below):
        axes.grid(True)
        axes.set_axisbelow(True)
        axes.minorticks_off()
    top.legend(loc="upper left")
    words = f"Our value against the reference for {len(shown)} values; {missed.sum()} miss."
    caption = (
        f"Each of the {len(shown)} marks is a value: ours against the reference, with equality as "
        "the grey line. References of zero are left out and signs are dropped. Tables below give "
        "each value with its source."
    )
    return look.picture(look.svg_of(figure), caption, words=words)


def relative(value: str, reference: str) -> str:
    """A difference in per cent of the reference; as it is where that is zero."""
    if float(value) == 0.0:
        return "0"
    if float(reference) == 0.0:
        return value
    return f"{100.0 * float(value) / abs(float(reference)):.2g} %"


def cells(row: dict[str, str]) -> list[str]:
    """What a row shows; a note goes beside the source."""
    unit = f" {row['unit']}" if row["unit"] else ""
    note = f" ({row['note']})" if row["note"] else ""
    spread = f" ± {0.5 * float(row['spread']):.2g}" if float(row["spread"]) else ""
    return [
        row["case"], row["quantity"], row["reference"] + unit, row["ours"] + spread + unit,
        relative(row["difference"], row["reference"]),
        relative(row["tolerance"], row["reference"]), row["source"] + note,
    ]  # fmt: skip


def lines(chosen: list[dict[str, str]]) -> str:
    """Rows of a table in HTML; red where a value falls short."""
    text = ""
    for row in chosen:
        style = "" if row["holds"] == "yes" else ' class="missed"'
        case, quantity, *numbers, source = (escape(cell) for cell in cells(row))
        text += f'<tr{style}><td style="min-width:11em">{case}</td><td>{quantity}</td>'
        text += "".join(f'<td class="number">{number}</td>' for number in numbers)
        text += f'<td style="min-width:9em">{source}</td></tr>'
    return text


def table(topic: str) -> HTML:
    """One topic."""
    head = "".join(
        f'<th class="number">{name}</th>' if name in HEAD[2:6] else f"<th>{name}</th>"
        for name in HEAD
    )
    body = lines([row for row in rows() if row["topic"] == topic])
    return HTML(
        '<div class="table-wrapper"><table class="docutils align-default">'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def missed() -> HTML:
    """Values outside their tolerance, and what is known of the reason."""
    body = "".join(
        f"<tr><td>{escape(row['case'])}</td><td>{escape(row['quantity'])}</td>"
        f'<td class="number">{row["reference"]}</td><td class="number">{row["ours"]}</td>'
        f"<td>{escape(row['source'])}</td><td>{escape(row['note'])}</td></tr>"
        for row in rows()
        if row["holds"] == "no"
    )
    head = "".join(f"<th>{name}</th>" for name in (*HEAD[:4], "source", "reason"))
    return HTML(
        '<div class="table-wrapper"><table class="docutils align-default">'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def overview() -> HTML:
    """Topics: how many values, how many fall short."""
    counts: dict[str, list[int]] = {}
    for row in rows():
        count = counts.setdefault(row["topic"], [0, 0])
        count[0] += 1
        count[1] += row["holds"] == "no"
    counts["all"] = [sum(count[k] for count in counts.values()) for k in (0, 1)]
    body = "".join(
        f'<tr><td>{escape(topic)}</td><td class="number">{number}</td>'
        f'<td class="number">{short}</td></tr>'
        for topic, (number, short) in counts.items()
    )
    return HTML(
        '<table class="docutils align-default"><thead><tr><th>topic</th><th class="number">values'
        f'</th><th class="number">fall short</th></tr></thead><tbody>{body}</tbody></table>'
    )
