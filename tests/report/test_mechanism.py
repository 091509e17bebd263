"""Mechanisms on the page: fractions of collapses, one run done again, its log over time."""

import json
import re
from dataclasses import replace

import lxml.html
import numpy as np
import pytest

import archfrag as af
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode, Model, Status
from archfrag.report import animation, ladder_figures, mechanism_figures, timeline
from archfrag.report.example import Example, choose, near_miss, repeat
from archfrag.report.page import render
from archfrag.report.summary import arch_results, reading_scale
from archfrag.simulation.mechanism import MechanismChange
from archfrag.study.config import Method
from tests.report import synthetic
from tests.report.test_figures import groups_of, overlaps, rectangles, results
from tests.report.test_page import text

ARCH = af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7)


def pulse(scale=1.0):
    """A run that ends in collapse, with its motion."""
    motion = af.Motion(np.where(np.arange(900) < 300, 6.8, -3.4), 1e-3, id="pulse")
    return motion, af.simulate(ARCH, motion, scale=scale, history=True)


class TestFractions:
    def test_every_grouping_has_the_same_collapses(self):
        data = results()
        fell = (data.verdict == Verdict.COLLAPSED).sum(axis=0)
        for group in groups_of(data):
            np.testing.assert_array_equal(group.counts.sum(axis=0), fell)

    def test_categories_are_what_the_cube_holds(self):
        data = results()
        fell = data.verdict == Verdict.COLLAPSED
        mode, joint, impacts = groups_of(data)
        sliding = (fell & (data.collapse_mode == CollapseMode.SLIDING)).sum()
        assert mode.counts[CollapseMode.SLIDING].sum() == sliding
        for category, count in zip(joint.categories[:-1], joint.counts[:-1]):
            number = int(category.removeprefix("joint "))
            assert count.sum() == (fell & (data.collapse_joint == number)).sum() > 0
        assert joint.categories[-1] == "other joints"
        seen = [(fell & (data.impacts == n)).sum() for n in (0, 1, 2, 50, 300)]
        assert impacts.counts.sum(axis=1).tolist() == seen

    def test_columns_are_as_high_as_the_fraction_of_collapses(self, drawn):
        data = results()
        mechanism_figures.fractions(groups_of(data), data)
        expected = data.counts.collapsed / data.counts.n
        for sheet in drawn:
            assert len(sheet.panels) == 3
            for panel in sheet.panels:
                top = np.zeros(expected.size)
                for colour, _ in mechanism_figures._LOOKS:
                    for left, right, _, high in rectangles(sheet, panel, colour):
                        level = round(0.5 * (left + right))
                        top[level] = max(top[level], high)
                np.testing.assert_allclose(top, expected, atol=1e-3)


class TestWhatRan:
    def test_table(self):
        data = results()
        rows = dict(ladder_figures.table(data).rows)
        total = data.model_time.sum()
        mega = data.model_time[..., 2].sum()
        assert rows["simulated time, mega-voussoirs"] == (
            f"{mega:,.1f} s ({100 * mega / total:.1f} %)"
        )
        assert rows["fraction of the time in motion on all voussoirs"] == "10.0 %"
        assert rows["switches to time stepping"].startswith(f"{data.switches.sum():,} (")
        assert rows["contact problems left to the general solver"] == f"{data.general.sum():,}"
        again = data.level_iterations.sum()
        part = 100 * again / data.two_level.sum()
        assert rows["of these, with more than one round"] == f"{again:,} ({part:.2g} %)"

    def test_arch_that_never_moved(self, drawn):
        data = results()
        data.model_time[..., 0] = data.model_time.sum(axis=2)
        data.model_time[..., 1:] = 0.0
        rows = dict(ladder_figures.table(data).rows)
        assert "fraction of the time in motion on all voussoirs" not in rows
        ladder_figures.what_ran(data)
        assert all("no events" in [box[0] for box in sheet.boxes] for sheet in drawn)


class TestChoice:
    def test_capacity_nearest_the_median(self):
        data = results()
        data.verdict[:] = [0, 0, 0, 0, 0, 0, 0, 0, 1]
        data.verdict[2, 4:] = 1
        data.verdict[4, 6:] = 1
        record, level, reason = choose(data, 1.02 * data.levels[4])
        assert (record, level) == (2, 4)
        assert "nearest the median" in reason
        assert choose(data, 0.99 * data.levels[6])[:2] == (4, 6)
        # The capacity is the lowest collapsing level even where the record stands above it.
        data.verdict[2, 5] = 0
        assert choose(data, data.levels[4])[:2] == (2, 4)

    def test_without_a_curve(self):
        data = results()
        data.verdict[:] = 0
        data.verdict[1, 7:] = 1
        assert choose(data, None)[:2] == (1, 7)
        data.verdict[:] = 0
        data.verdict[3, 8] = Verdict.UNFINISHED
        data.peak_displacement[3, 8] = 9.0
        data.peak_displacement[5, 2] = 7.0
        assert choose(data, None)[:2] == (5, 2)
        data.verdict[:] = Verdict.SOLVER_FAILURE
        assert choose(data, None) is None


def study_of_pulses(settings=None):
    """A cube of real runs: one arch, the pulse of `pulse` at two levels."""
    motion, _ = pulse()
    standing, fallen = (
        af.simulate(ARCH, motion, scale=scale, settings=settings, history=True)
        for scale in (0.5, 1.0)
    )
    items = [motion, synthetic.motions(1)[0]]
    data = synthetic.cube(items=items).isel(record=[0], level=[0, 1]).copy(deep=True)
    for level, response in enumerate((standing, fallen)):
        data["verdict"][0, 0, level] = int(response.collapsed)
        data["status"][0, 0, level] = int(response.status)
        data["steps"][0, 0, level] = response.steps
        data["collapse_time"][0, 0, level] = response.collapse_time
        data["scale_factor"][0, level] = (0.5, 1.0)[level]
    method = Method(settings=settings or {}).model_dump()
    data.attrs["archfrag_config"] = json.dumps({"method": method})
    return data, motion, fallen


class TestRepetition:
    @pytest.mark.parametrize("settings", [None, {"coarse": 0.01}])
    def test_is_the_run_of_the_study_with_its_log(self, settings):
        data, motion, fallen = study_of_pulses(settings)
        scale = reading_scale(data, "PGA")
        results_ = arch_results(data, "ring", scale)
        again = repeat(data, results_, ARCH, [motion], choose(results_, None))
        assert fallen.status is Status.COLLAPSED
        assert again.same
        assert again.response.mechanism == fallen.mechanism
        assert again.factor == 1.0
        if settings:
            assert fallen.steps != pulse()[1].steps

    def test_another_end_is_stated(self, drawn):
        data, motion, _ = study_of_pulses()
        data["steps"][0, 0, 1] += 1
        results_ = arch_results(data, "ring", reading_scale(data, "PGA"))
        again = repeat(data, results_, ARCH, [motion], choose(results_, None))
        assert not again.same
        assert "did not end as the run in the cube did" in timeline.timeline(again).caption

    def test_a_cube_without_its_method(self):
        data = results()
        given = synthetic.cube(), data, ARCH, synthetic.motions()
        assert repeat(*given, choose(data, None)) is None

    def test_page_shows_it_with_the_log_in_words(self):
        data, motion, fallen = study_of_pulses()
        arch, onset = synthetic.arch_and_onset()
        study = synthetic.inputs(
            cube=data, motions=[motion], arches=[("ring", arch, onset)],
            answers={"ring": synthetic.none("none")},
            timings=None,
        )  # fmt: skip
        page = lxml.html.document_fromstring(render(study))
        assert "The mechanism in one run" in [text(head) for head in page.xpath("//h3")]
        (log,) = page.xpath("//details/pre")
        lines = log.text_content().strip().splitlines()
        assert lines[1] == str(fallen.mechanism[1])
        wide, narrow = page.xpath('//svg[contains(@aria-label, "Mechanism over time")]')
        assert "pulse" in wide.get("aria-label")
        assert wide.get("aria-label") == narrow.get("aria-label")


def change(time, until, joints, model="mega_voussoirs"):
    return MechanismChange(time, until, "impact", -1, model, joints)


class TestTimeline:
    def test_bins_hold_what_lasts_longest_in_them(self):
        log = [
            change(0.0, 0.99, {0: "hinge extrados", 2: "slides towards intrados"}, "four_hinges"),
            change(0.99, 1.1, {1: "open"}),
            change(1.1, 2.0, {0: "hinge intrados sliding towards extrados"}, "all_voussoirs"),
        ]
        joints, models = timeline.sampled(log, 3, np.linspace(0.0, 2.0, 5))
        names = ("closed", *timeline.LOOK)
        assert [[names[k] for k in row] for row in joints] == [
            ["hinge at extrados", "closed", "slides"],
            ["hinge at extrados", "closed", "slides"],
            ["sliding hinge at intrados", "closed", "closed"],
            ["sliding hinge at intrados", "closed", "closed"],
        ]
        assert [Model(m) for m in models] == [Model.FOUR_HINGES] * 2 + [Model.ALL_VOUSSOIRS] * 2
        fine, _ = timeline.sampled(log, 3, np.linspace(0.98, 1.12, 15))
        assert [names[k] for k in fine[:, 1]] == ["closed"] + ["open"] * 11 + ["closed"] * 2

    def test_bars_stand_where_the_log_has_them(self, drawn):
        """Coloured length of each joint in the figure against its time in the log."""
        motion, response = pulse()
        example = Example(ARCH, motion, 1.0, "PGA = 0.69 g", response, "chosen", True)
        timeline.timeline(example)
        sheet, middle = drawn[0], drawn[0].panels[1]
        shown = np.zeros(8)
        for colour, _ in {look[0]: look for look in timeline.LOOK.values()}.values():
            for left, right, low, high in rectangles(sheet, middle, colour):
                shown[round(0.5 * (low + high))] += right - left
        start, end = timeline.window(response.mechanism, response.end_time)
        logged = np.zeros(8)
        for entry in response.mechanism:
            for joint in entry.joints:
                logged[joint] += max(0.0, min(entry.until, end) - max(entry.time, start))
        np.testing.assert_allclose(shown, logged, atol=0.02 * (end - start))
        assert logged.max() > 0.5 * (end - start)

    @pytest.mark.parametrize("voussoirs", [1, 7, 27, 81])
    def test_labels_keep_clear(self, voussoirs, drawn):
        arch = (
            af.Arch.circular(10.0, 1.5, 157.5, voussoirs, 0.7) if voussoirs > 1
            else af.Block(1.0, 4.0, 0.7)
        )  # fmt: skip
        motion, response = pulse()
        last = arch.n_joint - 1
        log = (
            change(0.0, 1.0, {}, "rest"),
            change(1.0, 3.0, {0: "hinge extrados", last: "open"}, "four_hinges"),
            change(3.0, 7.0, {0: "slides towards intrados"}, "all_voussoirs"),
        )
        shown = replace(response, mechanism=log, end_time=7.0, collapse_time=6.5)
        timeline.timeline(Example(arch, motion, 1.0, "PGA = 1 g", shown, "x", True))
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        assert drawn[0].panels[2].x[0] == pytest.approx(1.0 - 0.03 * 6.0)

    def test_nothing_moved(self):
        motion, response = pulse(0.2)
        example = Example(ARCH, motion, 0.2, "PGA", response, "x", True)
        assert response.peak_displacement == 0.0
        assert timeline.timeline(example) is None
        assert animation.animation(example, "a", "A near miss") is None


@pytest.fixture(scope="module")
def fallen():
    motion, response = pulse()
    return Example(ARCH, motion, 1.0, "PGA = 0.69 g", response, "chosen", True)


class TestAnimation:
    def test_linear_motion_between_key_frames_is_close_to_the_run(self, fallen):
        frames, history = animation.key_frames(fallen), fallen.response.history
        time = history["time"].values
        inside = (time >= frames.time[0]) & (time <= frames.time[-1])
        for body in range(ARCH.n_voussoir):
            interpolated = np.interp(time[inside], frames.time, frames.rotation[:, body])
            true = history["rotation"].values[inside, body]
            assert (
                np.abs(interpolated - true).max() < 0.02 * np.abs(history["rotation"].values).max()
            )
        assert 12 <= frames.time.size <= 40
        assert frames.time[-1] == time[-1]

    def test_no_script_small_and_all_names_defined(self, fallen):
        shown = animation.animation(fallen, "fall0", "A collapse")
        assert len(shown.svg) < 150_000
        assert "<script" not in shown.svg
        assert not re.search(r"\son\w+=", shown.svg)
        assert 'class="still"' in shown.svg
        used = set(re.findall(r'href="#([^"]+)"', shown.svg))
        assert used <= set(re.findall(r'\bid="([^"]+)"', shown.svg))
        names = set(re.findall(r"animation-name:([\w-]+)", shown.svg))
        assert names == set(re.findall(r"@keyframes ([\w-]+)", shown.svg))
        assert f"to {fallen.response.end_time:.2f} s" in shown.caption

    def test_key_frames_end_where_the_run_ends(self, fallen):
        """Rotation of each voussoir in the last key frame, clockwise in the drawing [deg]."""
        shown = animation.animation(fallen, "fall0", "A collapse")
        last = np.rad2deg(fallen.response.history["rotation"].values[-1])
        for body in range(ARCH.n_voussoir):
            rule = re.search(rf"@keyframes fall0-k{body}\{{(.*?)\}}\}}", shown.svg)[1]
            rotation = float(re.findall(r"rotate\(([-.\d]+)deg", rule)[-1])
            assert rotation == pytest.approx(-last[body], abs=0.06)
            percents = [float(p) for p in re.findall(r"([.\d]+)%", rule)]
            assert percents == sorted(percents)
            assert percents[0] == 0.0

    def test_near_miss_is_the_standing_run_with_the_largest_rotation(self):
        data = results()
        reach = np.zeros(data.verdict.shape)
        stood, fell = np.argwhere(data.verdict == 0), np.argwhere(data.verdict == 1)
        for run, value in ((stood[2], 0.08), (stood[1], 0.03), (fell[0], 0.9)):
            reach[tuple(run)] = value
        assert near_miss(replace(data, peak_rotation=reach))[:2] == tuple(stood[2])
        assert near_miss(replace(data, peak_rotation=None)) is None
        assert near_miss(replace(data, peak_rotation=0.0 * reach)) is None
