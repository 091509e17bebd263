"""The first page of a study of an arch before and after a remedy, and what a film of it shows."""

import re
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

import archfrag as af
from archfrag.fragility.risk import HazardCurve
from archfrag.report import film
from archfrag.report.first_page import before_and_after, first_page, leading, ratio_text
from archfrag.report.html import percentages
from archfrag.report.page import render
from archfrag.study.answer.rates import risk_of
from archfrag.study.hazard import Hazard
from tests.arch.test_marks import BRIDGE as AFTER
from tests.arch.test_marks import FILLED as BEFORE
from tests.report import synthetic
from tests.report.test_page import text


@pytest.fixture(scope="module")
def both():
    """A study of two arches with a hazard; the second one is stronger by a half."""
    arches = {"before": af.onset(BEFORE), "after": af.onset(AFTER)}
    study = synthetic.inputs(("before", "after"), n_record=24, arches=arches)
    data = study.cube.copy(deep=True)
    intensity = data["intensity"].values
    factor = np.array([1.0, 1.5])[:, None, None]
    spread = np.exp(0.4 * np.random.default_rng(3).standard_normal((1, 24, 1)))
    data["verdict"].values[:] = 3.0 * factor * spread < intensity
    answers = synthetic.answers_of(data)
    rate = HazardCurve(np.array([0.2, 10.0]), np.array([0.05, 0.05 / 50.0**2]))
    risk = risk_of(data, answers, Hazard("PGA", "made", {"mean": rate}))
    return replace(study, cube=data, answers=answers, risk=risk)


@pytest.fixture(scope="module")
def page(both):
    return lxml.html.document_fromstring(render(both)[0])


class TestBeforeAndAfter:
    def test_the_ratio_stands_on_the_first_page(self, both, page):
        """All capacities are 1.5 times as large; the rate falls as the hazard, by 1.5 squared."""
        found = both.ratios["after"]
        for what, expected in (("theta", 1.5), ("rate", 1.5**-2)):
            row = found[what]
            assert row["ratio"] == pytest.approx(expected, rel=0.25)
            assert row["lower"] <= row["ratio"] <= row["upper"]
        (words,) = page.xpath('//section[@id="first"]/p[@class="compared"]')
        median, rate = (ratio_text(row, "90 %") for row in found.values())
        assert re.fullmatch(r"1\.\d\d \(90 %: \d\.\d\d to \d\.\d\d\)", median)
        start = f"The median capacity of after is {median} times that of before, "
        assert text(words).startswith(
            f"{start}its annual rate of collapse {rate} times."
        )
        assert before_and_after(replace(both, risk=None))[0] == f"{start[:-2]}."

    def test_classes_that_met_the_same_motions_have_it_too(self, both):
        cube = both.cube.isel(arch=[0, 0, 1, 1]).assign_coords(
            arch=["b1", "b2", "a1", "a2"]
        )
        cube["arch_class"] = ("arch", ["before", "before", "after", "after"])
        names = ("before", "before", "after", "after")
        answers = {
            own: both.answers[name] for own, name in zip(cube["arch"].values, names)
        }
        given = replace(
            both, cube=cube, answers=answers, classes=both.answers, risk=None
        )
        ((name, rows),) = given.ratios.items()
        assert name == "after"
        assert rows["theta"]["ratio"] == pytest.approx(1.5, rel=0.15)
        assert "of after is 1." in before_and_after(given)[0]

    def test_it_says_which_curve_is_higher_at_low_levels(self, both):
        wide = replace(both.answers["after"], theta=4.5, beta=0.9)
        narrow = replace(both.answers["before"], theta=3.0, beta=0.4)
        *_, last = before_and_after(
            replace(both, answers={"before": narrow, "after": wide})
        )
        # The two cross where (ln x - ln 3) / 0.4 = (ln x - ln 4.5) / 0.9.
        at = np.exp((0.9 * np.log(3.0) - 0.4 * np.log(4.5)) / 0.5) / synthetic.GRAVITY
        assert last.startswith(
            f"Below PGA {at:.2f} g the curve of after is the higher one"
        )

    def test_both_are_drawn_with_fill_backing_and_tie(self, both):
        html = first_page(both, None)
        drawn = re.findall(r"<svg viewBox.*?</svg>", html, re.DOTALL)[:2]
        assert [
            d.count('class="earth"') + d.count('class="backing"') for d in drawn
        ] == [2, 2]
        assert [d.count('#0072B2" stroke-width="1.6"') for d in drawn] == [0, 1]
        assert "Drawn: after. Blue: 1 tie. Dashed: the surface of the fill." in html
        alike = replace(both, arches=dict.fromkeys(both.arches, both.arches["before"]))
        assert "Drawn: after" not in first_page(alike, None)

    def test_the_other_curve_and_what_was_observed_are_drawn(self, both, drawn):
        html = first_page(both, None)
        results = both.results("before")
        levels = results.levels
        seen = results.fraction
        assert np.ptp(seen) > 0.5
        (panel,) = drawn[-1].panels
        dots = "".join(drawn[-1].parts)
        for x, y in zip(panel.at_x(levels), panel.at_y(seen)):
            assert f"M{x - 2.6:.1f}".removesuffix(".0") in dots
            assert panel.box[1] <= y <= panel.box[3]
        assert "after" in dots
        assert "Points: fraction of the runs at each level that collapse." in html


class TestWeakest:
    """Of two curves that cross the first sentence names the higher one at its level."""

    @pytest.fixture
    def crossing(self, both):
        wide = replace(both.answers["before"], theta=3.4, beta=1.0)
        narrow = replace(both.answers["after"], theta=3.0, beta=0.2)
        return replace(both, answers={"before": wide, "after": narrow}, risk=None)

    @pytest.mark.parametrize(
        ("at", "name"),
        [(0.15, "before"), (0.25, "before"), (0.34, "after"), (None, "after")],
    )
    def test_it_is_the_one_most_likely_to_collapse_there(self, crossing, at, name):
        given = replace(crossing, at=at)
        html = first_page(given, None)
        assert leading(given)[0] == name
        there = "" if at is None else " at this level"
        assert f"{name}, the weakest of 2 arches or classes{there}," in html
        if at is not None:
            chances = [
                answer(at * synthetic.GRAVITY) for answer in given.answers.values()
            ]
            assert f"<strong>{percentages([max(chances)])}</strong>" in html

    def test_it_is_so_at_the_level_of_the_site(self, crossing):
        rate = HazardCurve(np.array([0.5, 10.0]), np.array([0.05, 1e-5]))
        risk = risk_of(
            crossing.cube, crossing.answers, Hazard("PGA", "made", {"mean": rate})
        )
        html = first_page(replace(crossing, risk=risk), None)
        assert "motion of the site" in html
        assert "before, the weakest of 2 arches or classes at this level," in html


@pytest.fixture(scope="module")
def fall():
    """A run of the tied bridge in which a pier turns outwards."""
    motion = af.Motion(np.where(np.arange(1500) < 900, 9.0, -6.0), 1e-3, id="pulse")
    response = af.simulate(AFTER, motion, history=True)
    return film.Example(AFTER, motion, 1.0, "PGA = 0.92 g", response, "chosen", True)


def test_weights_tie_and_springings_stand_under_the_arch(page):
    (own,) = page.xpath('//section[@id="arch1"]')
    weights, tie, places = re.search(r"The ring weighs .*\(intrados\)\.", text(own))[
        0
    ].split("; ")
    assert re.fullmatch(r"The ring weighs \S+ kN, piers \S+ kN, fill \S+ kN", weights)
    assert tie == "the tie pulls with 20 kN"
    assert places.startswith("springings at (")


class TestFilm:
    def test_bodies_and_ties_stay_in_the_frame_and_in_the_strip(self, fall):
        shown, strip = film.film(fall, "fall", "A collapse")
        width, height = map(
            float, re.search(r'viewBox="0 0 (\S+) (\S+)"', shown.svg).groups()
        )
        height -= 40.0 + film._STRIP
        shapes = re.findall(r'<path id="fall-\d+" d="M([^"]+)z"/>', shown.svg)
        form = r"translate\((\S+?)px,(\S+?)px\)rotate\((\S+?)deg\)"
        frames = re.findall(r"@keyframes fall-(\w\d+)\{(.*)\}", shown.svg)
        moves = {
            name: np.array(re.findall(form, text), dtype=float) for name, text in frames
        }
        for body, shape in enumerate(shapes):
            points = np.array(re.findall(r"-?[\d.]+", shape), dtype=float).reshape(
                -1, 2
            )
            place = moves[f"k{body}"][:, :2]
            angle = np.deg2rad(moves[f"k{body}"][:, 2])
            corners = (points @ [1, 1j])[:, None] * np.exp(1j * angle) + place @ [1, 1j]
            assert -0.5 < corners.real.min() < corners.real.max() < width + 0.5
            assert -0.5 < corners.imag.min() < corners.imag.max() < height + 0.5
        assert (
            max(np.abs(np.deg2rad(move[:, 2])).max() for move in moves.values()) > 0.1
        )
        assert np.ptp(moves["s0"], axis=0).max() > 20.0
        # Frames of the strip stand beside each other, each as wide as its part of the strip.
        assert (strip.svg.count("scale(0.25)"), strip.svg.count('class="tie"')) == (
            4,
            4,
        )

    def test_the_slider_ends_where_the_film_does(self, fall):
        shown, _ = film.film(fall, "fall", "A collapse")
        end = float(re.search(r'type="range" min="0" max="([\d.]+)"', shown.svg)[1])
        duration = float(re.search(r"animation-duration:([\d.]+)s", shown.svg)[1])
        assert end * duration == pytest.approx(duration - film._HOLD, abs=0.02)

    def test_the_ground_has_a_line_of_zero_and_says_whose_peak_it_tells(self, fall):
        shown, _ = film.film(fall, "fall", "A collapse")
        assert 'class="ground"' in shown.svg
        assert "(peak 0.92 g)" in shown.svg
        early = np.concatenate([[12.0, 0.0], fall.motion.acceleration])
        longer = replace(fall, motion=af.Motion(early, 1e-3, id="pulse"))
        later, _ = film.film(longer, "fall", "A collapse")
        start = film.key_frames(longer)[0][0]
        assert ("(peak of the window" in later.svg) == (start > 0.002)
