"""How each method looks in every chart: ours in colours of their own, other solvers in grey."""

from typing import Literal, NamedTuple

from archfrag.report import canvas


class Style(NamedTuple):
    """Words, colour, marker and stroke of a method."""

    label: str
    colour: str
    marker: str
    stroke: Literal["-", ":"]


METHOD_STYLES = {
    "time_stepping": Style("time stepping", canvas.BLUE, "o", "-"),
    "event_driven": Style("event-driven", canvas.VERMILION, "s", "-"),
    "auto": Style("auto (the ladder)", canvas.GREEN, "^", "-"),
    "penalty": Style("penalty springs", canvas.ORANGE, "D", "-"),
    "four_link": Style("four-link, one degree of freedom", canvas.INK, "P", "-"),
    "gauss_seidel": Style("Gauss–Seidel", canvas.PURPLE, "X", "-"),
    "quadratic_programme": Style("quadratic programme", canvas.SKY, "p", "-"),
    "mujoco": Style("mujoco", canvas.GREY, "<", ":"),
    "mujoco_corners": Style("mujoco_corners", canvas.GREY, ">", ":"),
    "pymunk": Style("pymunk", canvas.GREY, "x", ":"),
    "lmgc90": Style("lmgc90", canvas.GREY, "*", ":"),
    "siconos": Style("siconos", canvas.GREY, "h", ":"),
}


def method_style(name: str) -> Style:
    """Style of a method or of another solver; one that is unknown is told by its name."""
    return METHOD_STYLES.get(name, Style(name, canvas.GREY, ".", ":"))
