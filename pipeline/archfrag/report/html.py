"""Parts of the page: texts, tables and pictures, and how numbers are written."""

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
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
ERRORS = str(_TEMPLATES / "errors.csv")  # of the page on evidence
SCRIPT = (_TEMPLATES / "film.js").read_text("utf-8")
TEXTS: Mapping[str, Any] = tomllib.loads((_TEMPLATES / "texts.toml").read_text("utf-8"))
# where nobody else can put code: compiling takes a tenth of a second
_KEPT = use_kernel_cache()
_ENVIRONMENT = Environment(
    loader=PackageLoader("archfrag.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    bytecode_cache=FileSystemBytecodeCache(str(_KEPT)) if _KEPT else None,
)


@dataclass(frozen=True)
class Picture:
    """A figure with its caption."""

    svg: str  #: or HTML
    caption: str

    def __html__(self) -> str:
        return f"<figure>\n{self.svg}\n<figcaption>{escape(self.caption)}</figcaption>\n</figure>"

    @property
    def file(self) -> str:
        """Text of an SVG file of the figure with its caption."""
        inside = f"<desc>{escape(self.caption)}</desc><style>{STYLE}</style>"
        inside += '<rect width="100%" height="100%" fill="white"/>'
        svg = self.svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
        return svg.replace(">", f">{inside}", 1) + "\n"


def raised(power: str) -> str:
    """Write an exponent of ten: -5 as 10⁻⁵."""
    return f"10{str(int(power)).translate(_RAISED)}"


def px(value: float) -> str:
    """Write a coordinate to a tenth of a pixel."""
    return (
        f"{value:.1f}".removesuffix(".0").replace("-0.", "-.").removeprefix("-0") or "0"
    )


def css_text(words: str) -> Markup:
    """Escape a text for use between quotes in a style sheet."""
    return Markup(
        "".join(c if c.isalnum() or c == " " else f"\\{ord(c):x} " for c in words)
    )


_ENVIRONMENT.filters |= {"px": px, "css": css_text}
heading = Markup("<h3>{}</h3>").format  # of words
three = "{:#.3g}".format  # digits


def lines(parts: Iterable[Any]) -> Markup:
    """Return parts as one text, each on a line of its own."""
    return Markup("\n").join(map(Markup.escape, parts))


def template(file: str, **values) -> Markup:
    """Fill in a template of the page."""
    return Markup(_ENVIRONMENT.get_template(file).render(values))


def paragraph(words: str, kind: str = "") -> Markup:
    """Return a paragraph; `kind` is empty, note, none (for what is missing) or caution."""
    return Markup('<p class="{}">{}</p>' if kind else "<p>{1}</p>").format(kind, words)


def cautions(messages: Iterable[str]) -> Markup:
    """Return a paragraph for each message; messages have neither a capital nor a full stop."""
    return lines(paragraph(f"Caution: {each}.", "caution") for each in messages)


def folded(title: str, *parts: Markup | Picture | None) -> Markup | None:
    """Return parts that are folded under a title until a click; None without a part."""
    inside = lines(part for part in parts if part)
    form = Markup("<details><summary>{}</summary>{}</details>")
    return form.format(title, inside) if inside else None


def facts(rows: Iterable[Sequence[str]], kind: str) -> Markup:
    """Return a list of labels, each with a value in large digits and maybe a remark on it."""
    form = Markup('<div><dt>{}</dt><dd class="large">{}</dd>{}</div>')
    remark = Markup('<dd class="range">{}</dd>').format
    entries = (
        form.format(a, b, Markup().join(map(remark, more))) for a, b, *more in rows
    )
    return Markup('<dl class="{}">{}</dl>').format(kind, lines(entries))


def table(
    label: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[object]],
    kind: str = "",
    numeric_from: int = 1,
) -> Markup:
    """Return a table that scrolls by itself on a narrow screen.

    The first cell of each row is its head. Columns from `numeric_from` on hold numbers.
    """
    return template(
        "table.html.j2",
        label=label,
        heads=heads,
        rows=rows,
        kind=kind,
        numeric_from=numeric_from,
    )


def pairs(label: str, rows: Iterable[Sequence[object]], head: str = "figure") -> Markup:
    """Return a table of names and values, both written to the left."""
    return table(label, [head, "value"], rows, "pairs", 2)


def digits(value: float) -> str:
    """Write a level with three digits, or with all before the point: 0.500, 12.0, 1250."""
    return f"{value:.0f}" if 99.95 <= abs(value) < 1e6 else f"{value:#.3g}"


def rounded(value: float) -> str:
    """Write a number with two digits: 0.00020, 5.9·10⁻⁵, 1,400; nan as a dash."""
    if not np.isfinite(value):
        return "–"
    if abs(value) >= 10.0:
        return f"{float(f'{value:.2g}'):,.0f}"
    mantissa, _, power = f"{value:#.2g}".partition("e")
    return mantissa.removesuffix(".") + (f"·{raised(power)}" if power else "")


def onset_text(value: float) -> str:
    """Write an onset acceleration with its unit."""
    return f"{digits(value)} g" if np.isfinite(value) else "no limit"


def measured(value: float | str | None, form: str = "#.3g") -> str:
    """Write a number, or a dash for None and nan."""
    value = np.nan if value is None else float(value)
    return format(value, form).removesuffix(".") if np.isfinite(value) else "–"


def interval(
    ends: Sequence[float], write: Callable[[float], str] = "{:.2f}".format
) -> str:
    """Return two numbers as a text, such as 0.20 to 0.35; a dash for nan."""
    return " to ".join(map(write, ends)) if np.isfinite(ends[0]) else "–"


def percentages(values: Sequence[float]) -> str:
    """Write probabilities in percent with two digits, each once: 7.7 %, 2.0 to 21 %."""
    shown = []
    for value in values:
        text = f"{100.0 * value:#.{3 if value > 0.99 else 2}g}".removesuffix(".")
        text = "> 99.9" if value > 0.9995 else text
        shown.append("< 0.1" if value < 0.0005 else text)
    return f"{' to '.join(dict.fromkeys(shown))} %"


def median_and_largest(values: NDArray[np.float64]) -> str:
    """Return the median and the largest absolute value as text, with powers of ten."""
    values = np.abs(values[np.isfinite(values)])
    return (
        f"{np.median(values):.1e}, {values.max():.1e}" if values.size else "not known"
    )
