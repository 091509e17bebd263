"""Figures that compare arches and classes."""

import numpy as np
import pytest

from archfrag.fragility.classes import class_curve, quantile_curves
from archfrag.report import canvas
from archfrag.report.class_figures import MOST_MEMBERS, ClassLines, class_curves, theta_panels
from tests.report.test_figures import drawn, overlaps  # noqa: F401

IM = np.linspace(0.01, 3.0, 200)


def lines(label, n_arch, centre):
    rng = np.random.default_rng(n_arch)
    found = class_curve(centre * np.exp(0.2 * rng.normal(size=n_arch)), np.full(n_arch, 0.3))
    curves = found.members(IM)
    low, high = quantile_curves(curves, [0.05, 0.95])
    return ClassLines(label, curves, found.probability(IM), low, high)


@pytest.mark.parametrize("width", [canvas.WIDTH, 3.6])
def test_curves_of_three_classes(drawn, width):  # noqa: F811
    shown = [lines("thin", 200, 0.8), lines("thick rings", 16, 1.3), lines("one", 1, 1.0)]
    made = class_curves(shown, IM, name="classes", axis_label="PGA [g]", width=width)
    assert overlaps(drawn[0]) == []
    axes = drawn[0].axes[0]
    # One line for all arches of a class, and the class's own; one arch has no thin line.
    assert len(axes.lines) == 5
    assert np.isnan(axes.lines[0].get_ydata()).sum() == MOST_MEMBERS
    assert "thick rings" in made.svg
    assert len(made.svg) < 250_000
    assert "60 of them" in made.caption


@pytest.mark.parametrize("width", [canvas.WIDTH, 3.6])
def test_panels_of_numbers_and_texts(drawn, width):  # noqa: F811
    rng = np.random.default_rng(1)
    theta = np.exp(rng.normal(size=50))
    theta[3] = np.nan
    regions = rng.choice(["Umbria", "Marche", "a region of a long name", ""], 50).tolist()
    made = theta_panels(
        theta,
        {
            "thickness [m]": rng.normal(1.5, 0.1, 50),
            "region": regions,
            "year": rng.normal(size=50),
        },
        name="panels",
        theta_label="median PGA [g]",
        classes=["old"] * 25 + ["new"] * 25,
        notes={"thickness [m]": "rank correlation 0.31"},
        width=width,
    )
    figure = drawn[0]
    assert overlaps(figure) == []
    assert "not stated" in made.svg
    assert "rank correlation 0.31" in made.svg


def test_many_texts_are_gathered(drawn):  # noqa: F811
    theta_panels(
        np.ones(40), {"town": [f"t{i // 2:02d}" for i in range(40)]}, name="p", theta_label="theta"
    )
    labels = [tick.get_text() for tick in drawn[0].axes[0].get_xticklabels()]
    assert len(labels) == 7
    assert labels[-1] == "others"


def test_same_numbers_give_the_same_bytes():
    made = [
        class_curves([lines("a", 5, 1.0)], IM, name="n", axis_label="PGA [g]").svg
        for _ in range(2)
    ]
    assert made[0] == made[1]
