"""What the figures are drawn from, and that their labels keep clear of each other."""

import re
from dataclasses import replace

import lxml.etree
import numpy as np
import pytest

import archfrag as af
from archfrag.fragility.verdicts import Verdict
from archfrag.physics.status import CollapseMode, Status
from archfrag.report import arch_figure, curve_figures, film, page, run_figures, svg
from archfrag.report.first_page import first_page
from archfrag.report.inputs import arch_results
from archfrag.simulation.response import MechanismChange
from archfrag.study.answer.curves import runs_of_cube
from archfrag.study.file.schema import Method
from tests.report import synthetic
from tests.report.conftest import TEXT, texts

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)


def results(**options):
    runs = runs_of_cube(synthetic.cube(**options), ["ring"])
    return arch_results(runs["ring"], synthetic.SCALE)


def rectangles(sheet, panel, colour):
    """Rectangles of a colour in a panel, in its units: left, right, low, high."""
    left, top, right, bottom = panel.box
    wide = np.ptp(panel.x) / (right - left)
    high = np.ptp(panel.y) / (bottom - top)
    found = []
    for d in re.findall(rf'<path d="([^"]+)" fill="{colour}"/>', "".join(sheet.parts)):
        for place in re.findall(r"M([-\d.]+) ([-\d.]+)H([-\d.]+)V([-\d.]+)H", d):
            x, y, across, down = map(float, place)
            if left - 1 <= x <= right + 1 and top - 1 <= y <= bottom + 1:
                ends = panel.x[0] + wide * (np.array([x, across]) - left)
                found.append(
                    [*ends, *(panel.y[0] + high * (bottom - np.array([down, y])))]
                )
    return np.array(found).reshape(-1, 4)


class TestLabelsKeepClear:
    @pytest.mark.parametrize("n_level", [2, 9, 40])
    def test_figures_over_levels(self, n_level, drawn):
        data = results(n_level=n_level)
        run_figures.verdict_map(data)
        curve_figures.curve(data, synthetic.none("no run collapsed"))
        curve_figures.curve(data, synthetic.in_g(synthetic.answer_of(4.0)))
        run_figures.fractions(run_figures.groupings(data, 0.9, ARCH), data, "the base")
        assert "θ = 0.408 g" in {words for words, *_ in texts(drawn[2])}

    @pytest.mark.parametrize("n_record", [6, 60])
    def test_records(self, n_record, drawn):
        items = synthetic.motions(n_record)
        names = [f"拼音{i}" for i in range(n_record)]
        shown = run_figures.verdict_map(replace(results(items=items), records=names))
        assert all(name in shown.svg for name in names)
        assert page.thumbnails(items).svg.count("<svg") == n_record

    def test_capacities_are_between_the_runs_that_bound_them(self, monkeypatch):
        lines = []
        drawn = svg.Panel.line
        monkeypatch.setattr(
            svg.Panel, "line", lambda *given: lines.append(given[1:3]) or drawn(*given)
        )
        data = results(n_level=9)
        run_figures.verdict_map(data)
        x, y = lines[-1]
        collapsed = data.verdict == Verdict.COLLAPSED
        lowest = np.sort(np.where(collapsed.any(axis=1), collapsed.argmax(axis=1), 9))[
            ::-1
        ]
        assert (y[0], y[-1]) == (-0.5, len(lowest) - 0.5)
        for row, place in zip(lowest, x[::2]):
            assert row - 1.0 <= place <= row

    @pytest.mark.parametrize("count", [2, 12, 40])
    def test_curves_of_all_arches(self, count, drawn):
        answers = {
            f"arch-number-{i}": synthetic.answer_of(2.0 + 0.2 * i) for i in range(count)
        }
        given = synthetic.inputs(tuple(answers), answers=answers, at=0.3)
        shown = curve_figures.all_curves(given, answers, [])
        assert shown.svg.count("stroke-linejoin") >= count

    def test_classes_and_their_parameters(self, drawn):
        members = [synthetic.answer_of(2.0 + 0.1 * i) for i in range(20)]
        answers = {f"a{i}": a for i, a in enumerate(members)} | {
            "alone": synthetic.answer_of(6.0)
        }
        made = {"thin": synthetic.answer_of(3.0)}
        data = synthetic.cube(list(answers))
        data["arch_class"] = ("arch", ["thin"] * 20 + ["alone"])
        key = "a parameter with a very long name indeed"
        data[f"arch_{key}"] = "arch", np.linspace(-1e-4, 1e-4, 21)
        given = synthetic.inputs(cube=data, answers=answers, classes=made)
        curve_figures.all_curves(given, answers, ["thin"])
        words = {words for words, *_ in texts(drawn[0])}
        assert {"thin", "alone", "each arch"} <= words
        assert "a3" not in words
        curve_figures.theta_panels(given, list(answers)[:20], "thin")
        # A point for each arch.
        assert "".join(drawn[1].parts).count("a2.4 2.4 0 1 0 4.8") == 20

    def test_limit_states_are_named_at_their_curves(self, drawn):
        """Each name once, at a point of its curve; states with one curve share a label."""
        thetas = {
            "motion": 0.5,
            "impact": 0.502,
            "residual": 2.0,
            "contact_lost": 3.5,
            "collapse": 6,
        }
        states = [
            replace(synthetic.curve_of(theta), state=name)
            for name, theta in thetas.items()
        ]
        answer = replace(synthetic.answer_of(6.0), states=tuple(states))
        given = synthetic.inputs()
        curve_figures.limit_states(given, synthetic.in_g(answer), "ring")
        named = ["motion, impact", "residual", "contact lost", "collapse"]
        for sheet in drawn:
            (panel,) = sheet.panels
            shown = {
                found[4]: found[:3] for found in re.findall(TEXT, "".join(sheet.parts))
            }
            assert [words for words in shown if words[0].isalpha()][-4:] == named
            for words, theta in zip(named, (0.5, 2.0, 3.5, 6.0)):
                x, y, kind = shown[words]
                place = float(x) + (6.0 if "e" in kind.split() else -6.0)
                level = np.interp(place, panel.box[::2], panel.x) * synthetic.GRAVITY
                chance = synthetic.curve_of(theta).probability(level)
                assert float(panel.at_y(chance)) + 4.0 == pytest.approx(
                    float(y), abs=4.0
                )

    @pytest.mark.parametrize(
        ("voussoirs", "thickness"), [(7, 3.0), (21, 1.5), (21, 0.8)]
    )
    def test_joints_that_are_lost(self, voussoirs, thickness, drawn):
        """Fractions of neighbouring joints keep clear; the largest always has its own."""
        arch = af.Arch.circular(10.0, thickness, 157.5, voussoirs, 0.7)
        found = results(n_level=40, n_joint=arch.n_joint)
        arch_figure.lost_joints(arch, found)
        counts = np.bincount(
            found["collapse_joint"][found.verdict == Verdict.COLLAPSED]
        )
        for sheet in drawn:
            shown = [words for words, *_ in texts(sheet)]
            assert f"{100 * counts.max() / counts.sum():.0f} %" in shown
            assert len(shown) >= 0.4 * arch.n_joint

    def test_a_number_stands_on_the_other_side_where_there_is_room(self, drawn):
        """Of neighbours at the crown one has its fraction outside and one inside."""
        arch = af.Arch.segmental(10.0, 4.0, 0.45, 21, 0.6)
        found = results(n_level=40)
        found["collapse_joint"][:] = np.where(found["collapse_joint"] % 2, 10, 11)
        arch_figure.lost_joints(arch, found)
        assert [len(list(texts(sheet))) for sheet in drawn] == [2]

    @pytest.mark.parametrize(
        ("levels", "expected"),
        [
            (np.linspace(0.1, 0.9, 15), ["0.1", "0.2", "0.3", "0.4"]),
            (np.geomspace(0.05, 1.6, 6), ["0.05", "0.1", "0.2", "0.5", "1"]),
            (np.array([0.371, 0.52]), ["0.38", "0.4"]),
        ],
    )
    def test_ticks_are_round_whatever_the_levels(self, levels, expected, drawn):
        data = results(n_level=levels.size)
        run_figures.verdict_map(replace(data, levels=levels))
        for sheet in drawn:
            (panel,) = sheet.panels
            below = {
                w: box
                for w, *box in texts(sheet)
                if box[1] > panel.box[3] and w[0].isdigit()
            }
            assert list(below)[: len(expected)] == expected
            for words, (left, _, right, _) in below.items():
                place = np.interp(0.5 * (left + right), panel.box[::2], panel.x)
                at = np.interp(place, np.arange(levels.size), np.log(levels))
                assert np.exp(at) == pytest.approx(float(words), rel=0.02)

    @pytest.mark.parametrize("level", [0.02, 0.41, 0.85])
    def test_levels_and_theta_stay_in_the_panel(self, level, drawn):
        given = synthetic.inputs(at=level, answers={"ring": synthetic.answer_of(8.0)})
        first_page(given, None)
        (sheet,) = [sheet for sheet in drawn if sheet.panels[0].y == (0.0, 1.0)]
        boxes = {words: box for words, *box in texts(sheet)}
        left, _, right, _ = sheet.panels[0].box
        for words in ("asked for", "θ = 0.816 g"):
            assert left < boxes[words][0] < boxes[words][2] < right

    @pytest.mark.parametrize("voussoirs", [1, 7, 81])
    def test_timeline(self, voussoirs, drawn, fallen):
        arch = (
            synthetic.arch_and_onset(voussoirs)[0]
            if voussoirs > 1
            else af.Block(1.0, 4.0, 0.7)
        )
        log = (
            change(0.0, 1.0, {}, "rest"),
            change(
                1.0, 3.0, {0: "hinge extrados", arch.n_joint - 1: "open"}, "four_hinges"
            ),
            change(3.0, 7.0, {0: "slides towards intrados"}, "all_voussoirs"),
        )
        shown = replace(fallen.response, mechanism=log, end_time=7.0, collapse_time=6.5)
        run_figures.timeline(replace(fallen, arch=arch, response=shown))
        assert drawn[0].panels[1].x[0] == pytest.approx(1.0 - 0.03 * 6.0)


@pytest.mark.parametrize("voussoirs", [7, 81])
def test_hinges_are_drawn_at_their_corners(voussoirs, drawn):
    """Pixels of the hinges lie as the corners do, but for a scale and shift a direction."""
    arch, start = synthetic.arch_and_onset(voussoirs)
    assert (
        "sliding joint"
        in arch_figure.arch_at_onset(replace(start, sliding=[7]), "ring").svg
    )
    pattern = r'<path d="M([\d.]+) ([\d.]+)a([\d.]+) [^>]*stroke="#fff"/>'
    for sheet in drawn:
        found = np.array(re.findall(pattern, "".join(sheet.parts)), dtype=float)
        dots = found[:, :2] + found[:, 2:] * (1.0, 0.0)
        for points, hinges in (
            (dots[:4], start.hinges),
            (dots[4:], start.hinges_minus),
        ):
            corners = np.array([getattr(arch, side)[joint] for joint, side in hinges])
            sides = [points - points[0], (corners - corners[0]) * (1.0, -1.0)]
            scale = np.linalg.norm(sides[0]) / np.linalg.norm(sides[1])
            np.testing.assert_allclose(sides[0], scale * sides[1], atol=0.3)


@pytest.mark.parametrize("n", [2, 200, 5000])
def test_envelope_keeps_the_peaks(n):
    values = np.random.default_rng(n).standard_normal(n)
    place, low, high = svg.envelope(values, 220)
    assert (low.min(), high.max()) == (values.min(), values.max())
    assert place.size <= 220


def test_every_grouping_has_the_collapses_of_the_cube(drawn):
    data = results()
    fell = data.verdict == Verdict.COLLAPSED
    groups = mode, joint = run_figures.groupings(data, 0.9, ARCH)
    for group in groups:
        np.testing.assert_array_equal(group.counts.sum(axis=0), fell.sum(axis=0))
    sliding = (fell & (data["collapse_mode"] == CollapseMode.SLIDING)).sum()
    assert mode.counts[CollapseMode.SLIDING].sum() == sliding
    for category, count in zip(joint.categories[:-1], joint.counts[:-1]):
        number = int(category.removeprefix("joint "))
        assert count.sum() == (fell & (data["collapse_joint"] == number)).sum() > 0
    run_figures.fractions(groups, data, "the base")
    for sheet in drawn:
        for panel in sheet.panels:
            top = np.zeros(data.levels.size)
            for colour, _ in run_figures.LOOKS:
                for left, right, _, high in rectangles(sheet, panel, colour):
                    level = round(0.5 * (left + right))
                    top[level] = max(top[level], high)
            np.testing.assert_allclose(
                top, data.counts["collapsed"] / data.counts["n"], atol=1e-3
            )


def test_run_that_is_shown():
    data = results()
    data.verdict[:] = [0, 0, 0, 0, 0, 0, 0, 0, 1]
    data.verdict[2, 4:] = 1
    data.verdict[4, 6:] = 1
    # The capacity is the lowest collapsing level even where the record stands above it.
    data.verdict[2, 5] = 0
    assert film.choose(data, 1.02 * data.levels[4])[:2] == (2, 4)
    assert film.choose(data, 0.99 * data.levels[6])[:2] == (4, 6)
    assert film.choose(data)[:2] == (0, 8)
    data.verdict[:] = 0
    data.verdict[3, 8] = Verdict.UNFINISHED
    data["peak_rotation"][3, 8] = 9.0
    data["peak_rotation"][5, 2] = 8.0
    assert film.choose(data)[:2] == film.farthest(data)[:2] == (5, 2)
    data["peak_rotation"][:] = 0.0
    assert film.farthest(data) is None
    data.verdict[:] = Verdict.FAILED
    assert film.choose(data) is None


def pulse(scale=1.0):
    """A run that ends in collapse, with its motion."""
    motion = af.Motion(np.where(np.arange(900) < 300, 6.8, -3.4), 1e-3, id="pulse")
    return motion, af.simulate(ARCH, motion, scale=scale, history=True)


@pytest.fixture(scope="module")
def fallen():
    motion, response = pulse()
    return film.Example(ARCH, motion, 1.0, "PGA = 0.69 g", response, "chosen", True)


def change(time, until, joints, model):
    return MechanismChange(time, until, "impact", -1, model, joints)


class TestRepeated:
    def test_it_is_the_run_of_the_study(self):
        motion, fell = pulse()
        data = synthetic.cube(items=[motion], n_level=2).copy(deep=True)
        for level, (factor, run) in enumerate([(0.5, pulse(0.5)[1]), (1.0, fell)]):
            data["scale_factor"][0, level] = factor
            data["verdict"][0, 0, level] = run.collapsed
            for name in ("status", "steps", "collapse_time"):
                data[name][0, 0, level] = getattr(run, name)

        def again():
            given = synthetic.inputs(cube=data, motions=[motion])
            return film.repeat(given, "ring", film.choose(given.results("ring")))

        assert again() is None  # the cube does not hold its method
        data.attrs["archfrag_config"] = f'{{"method": {Method().model_dump_json()}}}'
        assert fell.status is Status.COLLAPSED
        assert (again().same, again().factor) == (True, 1.0)
        assert again().response.mechanism == fell.mechanism
        data["steps"][0, 0, 1] += 1
        assert not again().same

    @pytest.mark.parametrize(("scale", "what"), [(1.0, "collapse"), (0.9, "near miss")])
    def test_the_first_page_calls_only_a_collapse_one(self, scale, what):
        motion, response = pulse(scale)
        assert response.collapsed == (what == "collapse")
        example = film.Example(ARCH, motion, scale, "PGA", response, "chosen", True)
        page = str(first_page(synthetic.inputs(), example))
        assert f"Four frames of the {what} under {motion.id}, PGA." in page
        assert f"A {what}: 7 voussoirs" in page

    @pytest.mark.parametrize("scale", [0.9, 0.6])
    def test_a_small_motion_that_stands_is_drawn_three_times_as_large(self, scale):
        motion, response = pulse(scale)
        example = film.Example(ARCH, motion, scale, "PGA", response, "chosen", True)
        turned = []
        captions = []
        for enlarged in (False, True):
            shown, strip = film.film(example, "film", "A near miss", enlarged)
            frames = re.findall(r"@keyframes film-k\d+\{.*", shown.svg)
            turned.append(
                np.array(re.findall(r"rotate\(([-.\d]+)deg", "".join(frames)), float)
            )
            captions.append(shown.caption)
            stills = [float(time) for time in re.findall(r">([\d.]+) s<", strip.svg)]
            assert sorted(set(stills)) == stills  # one in each part of the run
            time, _, rotation = response._arrays()
            assert stills[-1] > time[np.abs(rotation).max(axis=1).argmax()] + 0.05
        small = np.deg2rad(np.abs(turned[0]).max()) < 0.1
        assert small == (scale == 0.6)
        np.testing.assert_allclose(
            turned[1], (3.0 if small else 1.0) * turned[0], atol=0.16
        )
        assert "true to scale" in captions[0]
        assert ("three times as large" in captions[1]) == small

    def test_bars_stand_where_the_log_has_them(self, drawn, fallen):
        """Coloured length of each joint in the figure against its time in the log."""
        run_figures.timeline(fallen)
        shown = np.zeros(8)
        logged = np.zeros(8)
        for colour in {entry.colour for entry in run_figures.JOINT_STATES}:
            for left, right, low, high in rectangles(
                drawn[0], drawn[0].panels[1], colour
            ):
                shown[round(0.5 * (low + high))] += right - left
        response = fallen.response
        start, end = drawn[0].panels[1].x
        for entry in response.mechanism:
            for joint in entry.joints:
                logged[joint] += max(
                    0.0, min(entry.until, end) - max(entry.time, start)
                )
        np.testing.assert_allclose(shown, logged, atol=0.02 * (end - start))
        assert logged.max() > 0.5 * (end - start)

    def test_film(self, fallen, tmp_path):
        """Small, without a script, and in the last frame where the run ends, clockwise [deg]."""
        shown, strip = film.film(fallen, "fall0", "A collapse")
        assert strip.svg.count("<text") == 4
        assert len(shown.svg) < 150_000
        assert not re.search(r"<script|\son\w+=", shown.svg)
        used = set(re.findall(r'href="#([^"]+)"', shown.svg))
        assert used <= set(re.findall(r'\bid="([^"]+)"', shown.svg))
        names = set(re.findall(r"animation-name:([\w-]+)", shown.svg))
        assert names == set(re.findall(r"@keyframes ([\w-]+)", shown.svg))
        last = np.rad2deg(fallen.response.history["rotation"].values[-1])
        for body in range(ARCH.n_voussoir):
            rule = re.search(rf"@keyframes fall0-k{body}\{{(.*?)\}}\}}", shown.svg)[1]
            rotation = float(re.findall(r"rotate\(([-.\d]+)deg", rule)[-1])
            assert rotation == pytest.approx(-last[body], abs=0.06)
        film.save_film(fallen, tmp_path / "made" / "fall.svg")
        root = lxml.etree.parse(tmp_path / "made" / "fall.svg").getroot()
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert len(root.findall(".//{*}use[@id]")) == ARCH.n_voussoir
        assert [path.name for path in (tmp_path / "made").iterdir()] == ["fall.svg"]
