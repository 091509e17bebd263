"""Tables of the validation page, from the values that tests have written."""

import csv
from html import escape
from pathlib import Path


class HTML(str):
    """What a notebook shows as it is."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return str(self)


ROWS = Path(__file__).with_name("values.csv")
HEAD = ("case", "quantity", "reference", "ours", "difference", "allowed", "source")


def rows() -> list[dict[str, str]]:
    """All rows of the committed table."""
    with ROWS.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


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
    return [
        row["case"], row["quantity"], row["reference"] + unit, row["ours"] + unit,
        relative(row["difference"], row["reference"]),
        relative(row["tolerance"], row["reference"]), row["source"] + note,
    ]  # fmt: skip


def lines(chosen: list[dict[str, str]]) -> str:
    """Rows of a table in HTML; red where a value falls short."""
    text = ""
    for row in chosen:
        style = "" if row["holds"] == "yes" else ' style="background:#b3261e;color:#fff"'
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
