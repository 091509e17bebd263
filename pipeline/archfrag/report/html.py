"""Parts of the page: texts, tables and pictures, and how numbers are written on it."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from numpy.typing import NDArray

from archfrag.physics.kernels.cache import use_kernel_cache

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TEMPLATES = files("archfrag.report") / "templates"
STYLE = (_TEMPLATES / "figures.css").read_text("utf-8")
SCRIPT = (_TEMPLATES / "film.js").read_text("utf-8")
TEXTS: Mapping[str, Any] = tomllib.loads((_TEMPLATES / "texts.toml").read_text("utf-8"))
_KEPT = use_kernel_cache()  # where nobody else can put code: compiling takes a tenth of a second
_ENVIRONMENT = Environment(
    loader=PackageLoader("archfrag.report"), autoescape=True, undefined=StrictUndefined,
    trim_blocks=True, lstrip_blocks=True,
    bytecode_cache=FileSystemBytecodeCache(str(_KEPT)) if _KEPT else None,
)  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """A figure with its caption."""

    svg: str  #: or HTML
    caption: str
    narrow: str = ""  #: for narrow screens; empty where `svg` serves all widths

    def __html__(self) -> str:
        shown = self.svg
        if self.narrow:
            shown = f'<div class="broad">{shown}</div><div class="slim">{self.narrow}</div>'
        return f"<figure>\n{shown}\n<figcaption>{escape(self.caption)}</figcaption>\n</figure>"

    @property
    def file(self) -> str:
        """The figure with its caption as the text of an SVG file of its own."""
        inside = f"<desc>{escape(self.caption)}</desc><style>{STYLE}</style>"
        inside += '<rect width="100%" height="100%" fill="white"/>'
        svg = self.svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
        return svg.replace(">", f">{inside}", 1) + "\n"


def raised(power: str) -> str:
    """Write an exponent of ten: -5 as 10⁻⁵."""
    return f"10{str(int(power)).translate(_RAISED)}"


def number(value: float) -> str:
    """A coordinate to a tenth of a pixel."""
    return f"{value:.1f}".removesuffix(".0").replace("-0.", "-.").removeprefix("-0") or "0"


def css_text(words: str) -> Markup:
    """Text between quotes of a style sheet."""
    return Markup("".join(c if c.isalnum() or c == " " else f"\\{ord(c):x} " for c in words))


heading = Markup("<h3>{}</h3>").format  # of words
_ENVIRONMENT.filters |= {"px": number, "css": css_text}


def template(file: str, **values: Any) -> Markup:
    return Markup(_ENVIRONMENT.get_template(file).render(values))


def paragraph(words: str, kind: str = "") -> Markup:
    """A paragraph; `kind` is empty, note, none (for what is missing) or caution."""
    return Markup('<p class="{}">{}</p>' if kind else "<p>{1}</p>").format(kind, words)


def cautions(messages: Iterable[str]) -> Markup:
    """A paragraph for each message that begins without a capital and ends without a full stop."""
    return Markup("\n").join(paragraph(f"Caution: {each}.", "caution") for each in messages)


def folded(title: str, *parts: Markup | Picture) -> Markup:
    """Parts that a click on their title shows."""
    inside = Markup("\n").join(map(Markup.escape, parts))
    return Markup("<details><summary>{}</summary>{}</details>").format(title, inside)


def facts(rows: Iterable[Sequence[str]], kind: str) -> Markup:
    """A list of labels, each with a value in large digits and remarks on it."""
    start, remark = '<div><dt>{}</dt><dd class="large">{}</dd>', '<dd class="range">{}</dd>'
    forms = ((Markup(f"{start}{(len(row) - 2) * remark}</div>"), row) for row in rows)
    shown = Markup("\n").join(form.format(*row) for form, row in forms)
    return Markup('<dl class="{}">{}</dl>').format(kind, shown)


def table(
    label: str, heads: Sequence[str], rows: Iterable[Sequence[object]], kind: str = "",
    numeric_from: int = 1,
) -> Markup:  # fmt: skip
    """A table that scrolls by itself on a narrow screen; the first cell of each row is its head,
    and columns from `numeric_from` on are numbers, written to the right.
    """
    return template(
        "table.html.j2", label=label, heads=heads, kind=kind, numeric_from=numeric_from,
        rows=[(row[0], row[1:]) for row in rows],
    )  # fmt: skip


def pairs(label: str, rows: Iterable[Sequence[object]], head: str = "figure") -> Markup:
    """A table of names and values, written to the left."""
    return table(label, [head, "value"], rows, "pairs", 2)


def digits(value: float) -> str:
    """A level with three digits, or all before the point: 0.500, 12.0, 1250."""
    return f"{value:.0f}" if 99.95 <= abs(value) < 1e6 else f"{value:#.3g}"


def rounded(value: float, count: int = 2) -> str:
    """A number with so many significant digits, zeros at the end kept: 0.00020, 5.9·10⁻⁵, 1,400.

    A dash where it is not known.
    """
    if not np.isfinite(value):
        return "–"
    if abs(value) >= 10.0 ** (count - 1):
        return f"{float(f'{value:.{count}g}'):,.0f}"
    mantissa, _, power = f"{value:#.{count}g}".partition("e")
    return mantissa.removesuffix(".") + (f"·{raised(power)}" if power else "")


def onset_text(value: float) -> str:
    return f"{digits(value)} g" if np.isfinite(value) else "no limit"


def measured(value: float | str | None, form: str = "#.3g") -> str:
    """A number, or a dash where it is not known."""
    known = np.nan if value is None else float(value)
    return format(known, form).removesuffix(".") if np.isfinite(known) else "–"


def interval(ends: Sequence[float], form: str = ".2f") -> str:
    """Two numbers, or a dash where they are not known."""
    return f"{ends[0]:{form}} to {ends[1]:{form}}" if np.isfinite(ends[0]) else "–"


def rounded_interval(low: float, high: float) -> str:
    """Two numbers as `rounded`, or a dash where they are not known."""
    return f"{rounded(low)} to {rounded(high)}" if np.isfinite(low) else "–"


def percentages(values: Sequence[float]) -> str:
    """Probabilities in percent with two digits, each written once: 7.7 %, 2.0 to 21 %."""
    shown = []
    for value in values:
        text = f"{100.0 * value:#.{3 if value > 0.99 else 2}g}".removesuffix(".")
        text = "> 99.9" if value > 0.9995 else text
        shown.append("< 0.1" if value < 0.0005 else text)
    return f"{' to '.join(dict.fromkeys(shown))} %"


def median_and_largest(values: NDArray[np.float64]) -> str:
    """Of magnitudes, with a power of ten."""
    values = np.abs(values[np.isfinite(values)])
    return f"{np.median(values):.1e}, {values.max():.1e}" if values.size else "not known"
