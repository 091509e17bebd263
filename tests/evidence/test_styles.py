"""A method looks the same wherever it is drawn."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from tests.evidence.test_growth import made_up

from archfrag.evidence import growth
from archfrag.evidence.fragility.charts import cost_picture
from archfrag.evidence.peers.client import NAMES
from archfrag.evidence.speed.charts import chart
from archfrag.methods.registry import METHODS
from archfrag.report.styles import METHOD_STYLES, method_style


@pytest.fixture
def drawn(monkeypatch):
    """Figures that are drawn during a test, in order."""
    kept = []
    original = Figure.savefig

    def keep(figure, *args, **options):
        kept.append(figure)
        return original(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    return kept


def growth_chart():
    runs = pd.concat([made_up(1.0 + 0.1 * i, method=name) for i, name in enumerate(METHODS)])
    exponents = growth.exponents_table(runs)
    growth.show({"runs": runs, "exponents": exponents, "left_out": pd.DataFrame()})


def speed_chart():
    rows = [
        {"scene": "a", "quantity": "position", "line": name, "who": "ours", "place": place,
         "error": 10.0**-place * (i + 1), "cost": 10.0**place, "floor": 1e-9, "at_floor": False,
         "charted": True}
        for i, name in enumerate(METHODS) for place in (1, 2)
    ]  # fmt: skip
    errors = pd.DataFrame({"scene": ["a"], "quantity": ["position"], "error": [1e-9]})
    chart(pd.DataFrame(rows), errors, "position")


def fragility_chart():
    known = {
        "records": 10, "runs": 80, "sampling_ln_theta": 0.1, "sampling_beta": 0.1, "beta": 0.3,
        "reference_ln_theta_error": 1e-3, "reference_beta_error": 1e-3, "reference_studies": 2,
    }  # fmt: skip
    rows = [
        {**known, "method": name, "way": f"{name} 0.001", "role": role}
        | {"cpu_seconds": cost * (i + 1)}
        | {f"{of}_{what}": 0.01 * (i + 1) for of in ("ln_theta", "beta")
           for what in ("difference", "low", "high")}
        for i, name in enumerate(METHODS) for role, cost in (("way", 1.0), ("reference", 9.0))
    ]  # fmt: skip
    cost_picture("shipped", pd.DataFrame(rows))


@pytest.mark.parametrize("draw", [growth_chart, speed_chart, fragility_chart])
def test_every_chart_draws_a_method_in_its_own_colour_and_marker(draw, drawn):
    draw()
    figure = drawn[0]
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    shown = {
        words.get_text().split(":")[0]: (to_hex(mark.get_color()), mark.get_marker())
        for legend in legends
        if legend is not None
        for mark, words in zip(legend.get_lines(), legend.get_texts())
    }
    for name in METHODS:
        label, colour, marker, _ = method_style(name)
        assert shown[label] == (colour.lower(), marker)


def test_methods_and_other_solvers_are_told_apart():
    assert {*METHODS, *NAMES} - {"archfrag"} <= set(METHOD_STYLES)
    marks = [(style.colour, style.marker) for style in METHOD_STYLES.values()]
    assert len(set(marks)) == len(marks)
    assert np.unique([METHOD_STYLES[name].colour for name in METHODS]).size == len(METHODS)
    assert method_style("another").label == "another"
