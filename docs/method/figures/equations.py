"""Twin, kernel and test of each equation, from the table that has them: pipeline/METHOD.md."""

import re
from html import escape
from pathlib import Path

from IPython.display import HTML

TABLE = Path(__file__).parents[3] / "pipeline" / "METHOD.md"
ROW = re.compile(r"^\| (\d+) \| ([^|]+) \| `([^`]+)` \| `([^`]+)` \| `([^`]+)` \|$", re.M)


def rows() -> dict[int, tuple[str, ...]]:
    """What an equation is, its slow twin, its kernel and their test, by its number."""
    found = ROW.findall(TABLE.read_text(encoding="utf-8"))
    return {int(number): tuple(others) for number, *others in found}


def holds(*numbers: int) -> HTML:
    """The rows of some equations."""
    body = ""
    for number in numbers:
        what, *places = rows()[number]
        body += f"<tr><td>{number}</td><td>{escape(what)}</td>"
        for place in places:
            body += f"<td><code>{escape(place).replace(':', ':<wbr>')}</code></td>"
        body += "</tr>"
    return HTML(
        '<div style="overflow-x:auto"><table class="docutils align-default"><thead><tr>'
        "<th>Eq</th><th>what</th><th>formula</th><th>kernel</th><th>test</th></tr></thead>"
        f"<tbody>{body}</tbody></table></div>"
    )
