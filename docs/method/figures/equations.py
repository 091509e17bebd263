"""Function and test of each equation, from the one table that has them: pipeline/METHOD.md."""

import re
from html import escape
from pathlib import Path

from figures.drawing import HTML

TABLE = Path(__file__).parents[3] / "pipeline" / "METHOD.md"
ROW = re.compile(r"^\| (\d+) \| ([^|]+) \| `([^`]+)` \| `([^`]+)` \|$", re.M)


def rows() -> dict[int, tuple[str, str, str]]:
    """What an equation is, its function and its test, by its number."""
    found = ROW.findall(TABLE.read_text(encoding="utf-8"))
    return {int(number): (what, function, test) for number, what, function, test in found}


def holds(*numbers: int) -> HTML:
    """The rows of some equations."""
    body = ""
    for number in numbers:
        what, function, test = rows()[number]
        body += (
            f"<tr><td>{number}</td><td>{escape(what)}</td>"
            f"<td><code>{escape(function.replace(':', '.<wbr>')).replace('&lt;wbr&gt;', '<wbr>')}"
            f"</code></td><td><code>{escape(test)}</code></td></tr>"
        )
    return HTML(
        '<div style="overflow-x:auto"><table class="docutils align-default"><thead><tr>'
        "<th>Eq</th><th>what</th><th>function</th><th>test</th></tr></thead>"
        f"<tbody>{body}</tbody></table></div>"
    )
