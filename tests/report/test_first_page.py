"""The first page of a study of an arch before and after a remedy, and what a film of it shows."""

import re
from dataclasses import replace

import lxml.html
import numpy as np
import pytest
from matplotlib import pyplot

import archfrag as af
from archfrag.fragility.risk import HazardCurve
from archfrag.report import film
from archfrag.report.first_page import before_and_after, first_page, ratio_text
from archfrag.report.page import render
from archfrag.study.answer.risk import risk_of
from archfrag.study.hazard import Hazard
from tests.report import synthetic
from tests.report.test_page import text


def bridge(height=3.0):
    ring = af.Arch.segmental(8.0, 3.0, 0.6, 9, 0.6)
    return ring.on_piers(height, 1.5).filled(
        0.4, 18e3, backing_height=0.8, backing_unit_weight=2e4
    )


BEFORE = bridge()
AFTER = BEFORE.tied(level=0.8, area=8e-4, prestress=2e4)


@pytest.fixture(scope="module")
def both():
    """A study of two arches with a hazard; the second one is stronger by a half."""
    arches = [(name, arch, af.onset(arch)) for name, arch in
              (("before", BEFORE), ("after", AFTER))]  # fmt: skip
    study = synthetic.inputs(("before", "after"), n_record=24, arches=arches)
    data = study.cube.copy(deep=True)
    intensity, factor = data["intensity"].values, np.array([1.0, 1.5])[:, None, None]
    spread = np.exp(0.4 * np.random.default_rng(3).standard_normal((1, 24, 1)))
    data["verdict"].values[:] = 3.0 * factor * spread < intensity
    answers = synthetic.answers_of(data)
    rate = HazardCurve(np.array([0.2, 10.0]), np.array([0.05, 0.05 / 50.0**2]))
    fits = {name: answer.curve for name, answer in answers.items()}
    risk = risk_of(data, fits, Hazard("PGA", "made", {"mean": rate}))
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
        assert text(words).startswith(f"{start}its annual rate of collapse {rate} times.")
        assert before_and_after(replace(both, risk=None))[0] == f"{start[:-2]}."

    def test_classes_that_met_the_same_motions_have_it_too(self, both):
        cube = both.cube.isel(arch=[0, 0, 1, 1]).assign_coords(arch=["b1", "b2", "a1", "a2"])
        cube["arch_class"] = ("arch", ["before", "before", "after", "after"])
        names = ("before", "before", "after", "after")
        answers = {own: both.answers[name] for own, name in zip(cube["arch"].values, names)}
        given = replace(both, cube=cube, answers=answers, classes=both.answers, risk=None)
        ((name, rows),) = given.ratios.items()
        assert name == "after"
        assert rows["theta"]["ratio"] == pytest.approx(1.5, rel=0.15)
        assert "of after is 1." in before_and_after(given)[0]

    def test_it_says_which_curve_is_higher_at_low_levels(self, both):
        wide = replace(both.answers["after"], curve=synthetic.curve_of(4.5, 0.9))
        narrow = replace(both.answers["before"], curve=synthetic.curve_of(3.0, 0.4))
        *_, last = before_and_after(replace(both, answers={"before": narrow, "after": wide}))
        # The two cross where (ln x - ln 3) / 0.4 = (ln x - ln 4.5) / 0.9.
        at = np.exp((0.9 * np.log(3.0) - 0.4 * np.log(4.5)) / 0.5) / synthetic.GRAVITY
        assert last.startswith(f"Below PGA {at:.2f} g the curve of after is the higher one")

    def test_both_are_drawn_with_fill_backing_and_tie(self, both):
        html = first_page(both, None)
        drawn = re.findall(r"<svg viewBox.*?</svg>", html, re.DOTALL)[:2]
        assert [d.count('class="earth"') + d.count('class="backing"') for d in drawn] == [2, 2]
        assert [d.count('#0072B2" stroke-width="1.6"') for d in drawn] == [0, 1]
        assert "Drawn: after. Blue: 1 tie. Dashed: the surface of the fill." in html
        alike = replace(both, arches=[(name, *both.arches[0][1:]) for name in ("before", "after")])
        assert "Drawn: after" not in first_page(alike, None)

    def test_the_other_curve_and_what_was_observed_are_drawn(self, both, drawn):
        html = first_page(both, None)
        results = both.results("before")
        levels, seen = results.levels, results.fraction
        assert np.ptp(seen) > 0.5
        (panel,) = drawn[-1].panels
        dots = "".join(drawn[-1].parts)
        for x, y in zip(panel.at_x(levels), panel.at_y(seen)):
            assert f"M{x - 2.6:.1f}".removesuffix(".0") in dots
            assert panel.box[1] <= y <= panel.box[3]
        assert "after" in dots
        assert "Points: fraction of the runs at each level that collapse." in html


def test_fill_lies_between_the_extrados_and_its_surface():
    earth, backing = (s.points for s in BEFORE.shapes if s.role in ("earth", "backing"))
    crown = np.concatenate(BEFORE.outlines)[:, 1].max()
    assert earth[:, 1].max() == pytest.approx(crown + 0.4)
    assert np.ptp(earth[:, 0]) == pytest.approx(np.ptp(np.concatenate(BEFORE.outlines)[:, 0]))
    first, last = BEFORE.springings
    middle = 0.5 * (BEFORE.intrados + BEFORE.extrados)[[first, last], 1].min()
    assert backing[:, 1].max() == pytest.approx(middle + 0.8)
    bare = af.Arch.segmental(8.0, 3.0, 0.6, 9, 0.6)
    assert {shape.role for shape in bare.shapes} == {"stone", "ground"}
    ax = af.Arch.plot(AFTER)
    assert len(ax.patches) == AFTER.n_voussoir + 2
    pyplot.close(ax.figure)


@pytest.fixture(scope="module")
def fall():
    """A run of the tied bridge in which a pier turns outwards."""
    motion = af.Motion(np.where(np.arange(1500) < 900, 9.0, -6.0), 1e-3, id="pulse")
    response = af.simulate(AFTER, motion, history=True)
    return film.Example(AFTER, motion, 1.0, "PGA = 0.92 g", response, "chosen", True)


def matrices(found):
    """Place and angle [rad] of transforms."""
    x, y, angle = np.array(found, dtype=float).T
    return np.column_stack([x, y]), np.deg2rad(angle)


def test_weights_tie_and_springings_stand_under_the_arch(page):
    (own,) = page.xpath('//section[@id="arch1"]')
    weights, tie, places = re.search(r"The ring weighs .*\(intrados\)\.", text(own))[0].split("; ")
    assert re.fullmatch(r"The ring weighs \S+ kN, piers \S+ kN, fill \S+ kN", weights)
    assert tie == "the tie pulls with 20 kN"
    assert places.startswith("springings at (")


class TestFilm:
    def test_all_bodies_stay_in_the_frame_in_motion_and_in_the_strip(self, fall):
        shown, strip = film.film(fall, "fall", "A collapse")
        width, height = map(float, re.search(r'viewBox="0 0 (\S+) (\S+)"', shown.svg).groups())
        height -= 40.0 + film._STRIP
        shapes = re.findall(r'<path id="fall-\d+" d="M([^"]+)z"/>', shown.svg)
        number = r"(-?[\d.]+)"
        moved = 0.0
        for body, shape in enumerate(shapes):
            points = np.array(re.findall(r"-?[\d.]+", shape), dtype=float).reshape(-1, 2)
            frames = re.search(rf"@keyframes fall-k{body}\{{(.*)\}}", shown.svg)[1]
            form = rf"translate\({number}px,{number}px\)rotate\({number}deg\)"
            for place, angle in zip(*matrices(re.findall(form, frames))):
                turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                corners = points @ turn.T + place
                assert (corners > -0.5).all()
                assert (corners < np.array([width, height]) + 0.5).all()
                moved = max(moved, abs(angle))
        assert moved > 0.1
        # Frames of the strip stand beside each other, each as wide as its part of the strip.
        assert strip.svg.count("scale(0.25)") == 4

    def test_the_tie_moves_with_its_voussoirs(self, fall):
        shown, strip = film.film(fall, "fall", "A collapse")
        assert strip.svg.count('class="tie"') == 4
        body = AFTER.tie_bodies[0, 0]
        tie, voussoir = (
            re.search(rf"@keyframes fall-{name}\{{(.*)\}}", shown.svg)[1]
            for name in ("s0", f"k{body}")
        )
        ends = np.array(re.findall(r"translate\((-?[\d.]+)px,(-?[\d.]+)px", tie), dtype=float)
        form = r"translate\((-?[\d.]+)px,(-?[\d.]+)px\)rotate\((-?[\d.]+)deg"
        place, angle = matrices(re.findall(form, voussoir))
        shape = re.search(rf'id="fall-{body}" d="M([^"]+)z"', shown.svg)[1]
        points = np.array(re.findall(r"-?[\d.]+", shape), dtype=float).reshape(-1, 2)
        scale = np.ptp(points[:, 0]) / np.ptp(AFTER.outlines[body][:, 0])
        x, y = scale * (AFTER.tie_lines[0, 0] - AFTER.centroids[body]) * (1.0, -1.0)
        cosine, sine = np.cos(angle), np.sin(angle)
        expected = place + np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
        assert np.abs(ends - expected).max() < 0.5
        assert np.ptp(ends, axis=0).max() > 20.0

    def test_so_it_does_in_a_film_of_matplotlib(self, fall):
        played = fall.response.animate()
        tie = played._func(0)[AFTER.n_voussoir]
        rest = np.transpose(tie.get_data())
        assert rest == pytest.approx(AFTER.tie_lines[0], abs=0.05)
        *stones, tie = played._func(10**6)[: AFTER.n_voussoir + 1]
        assert np.abs(np.transpose(tie.get_data()) - rest).max() > 0.5
        low, high = np.transpose([tie.axes.get_xlim(), tie.axes.get_ylim()])
        corners = np.concatenate([stone.get_xy() for stone in stones])
        assert (corners > low).all()
        assert (corners < high).all()
        played._draw_was_started = True  # else matplotlib warns that nobody saw it
        pyplot.close(played._fig)

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
