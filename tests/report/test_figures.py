"""What the figures are drawn from, and that their labels keep clear of each other."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.motions.motion import Motion
from archfrag.report import (
    arch_figure,
    class_section,
    curve_figures,
    figures,
    ladder_figures,
    measure_figures,
    mechanism_figures,
    motion_figures,
    picture,
)
from archfrag.report.picture import NARROW, WIDE
from archfrag.report.plot import Panel, Sheet
from archfrag.report.summary import NOT_SIMULATED, arch_results, reading_scale
from archfrag.simulate import onset
from tests.report import synthetic


def results(**options):
    data = synthetic.cube(**options)
    return arch_results(data, "ring", reading_scale(data, "PGA"))


def groups_of(data, n_joint=8):
    return [
        mechanism_figures.by_mode(data, 0.9),
        mechanism_figures.by_joint(data, n_joint, 0.9),
        mechanism_figures.by_impacts(data, 0.9),
    ]


def overlaps(sheet):
    """Pairs of texts of a sheet that cover each other, and texts that leave it."""
    boxes = sheet.boxes
    covered = [
        (a[0], b[0])
        for i, a in enumerate(boxes)
        for b in boxes[i + 1 :]
        if min(a[3], b[3]) - max(a[1], b[1]) > 0.5 and min(a[4], b[4]) - max(a[2], b[2]) > 0.5
    ]
    outside = [
        (word, "edge")
        for word, left, top, right, bottom in boxes
        if left < -2.0 or top < -2.0 or right > sheet.width + 2.0 or bottom > sheet.height + 2.0
    ]
    return covered + outside


def rectangles(sheet, panel, colour):
    """Rectangles of a colour in a panel, in its units: left, right, low, high."""
    left, top, right, bottom = panel.box
    found = []
    for d in re.findall(rf'<path d="([^"]+)" fill="{colour}"/>', "".join(sheet.parts)):
        for x, y, across, down in re.findall(r"M([-\d.]+) ([-\d.]+)H([-\d.]+)V([-\d.]+)H", d):
            x, y, across, down = map(float, (x, y, across, down))
            if left - 1 <= x <= right + 1 and top - 1 <= y <= bottom + 1:
                ends = np.array([x, across, bottom, y, down])
                wide = (panel.x[1] - panel.x[0]) / (right - left)
                high = (panel.y[1] - panel.y[0]) / (bottom - top)
                found.append(
                    (
                        *(panel.x[0] + (ends[:2] - left) * wide),
                        panel.y[0] + (bottom - down) * high,
                        panel.y[0] + (bottom - y) * high,
                    )
                )
    return np.array(found).reshape(-1, 4)


class TestLabelsKeepClear:
    @pytest.mark.parametrize("n_level", [2, 9, 16, 40])
    def test_figures_over_levels(self, n_level, drawn):
        data = results(n_level=n_level)
        figures.verdict_map(data)
        figures.collapses(data, 8)
        figures.numerics(data)
        curve_figures.curve(data, synthetic.none("no run collapsed"))
        mechanism_figures.fractions(groups_of(data), data)
        ladder_figures.what_ran(data)
        assert [sheet.width for sheet in drawn] == 6 * [WIDE, NARROW]
        assert [overlaps(sheet) for sheet in drawn] == 12 * [[]]

    @pytest.mark.parametrize("n_record", [1, 60])
    def test_records_and_joints(self, n_record, drawn):
        items = synthetic.motions(n_record)
        figures.verdict_map(results(items=items if n_record > 1 else None))
        figures.collapses(results(n_joint=82 if n_record > 1 else 1), 82 if n_record > 1 else 1)
        assert [overlaps(sheet) for sheet in drawn] == 4 * [[]]
        assert motion_figures.thumbnails(items).svg.count("<svg") == n_record

    @pytest.mark.parametrize("count", [2, 12, 40])
    def test_curves_of_all_arches(self, count, drawn):
        answers = {f"arch-number-{i}": synthetic.answer_of(2.0 + 0.2 * i) for i in range(count)}
        shown = curve_figures.all_curves(answers, {}, {}, results().scale, (0.8, 0.3))
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        named = count if count <= curve_figures.MOST_NAMED else 0
        assert sum(box[0].startswith("arch-") for box in drawn[0].boxes) == named
        assert shown.svg.count("stroke-linejoin") >= count
        one = dict(list(answers.items())[:1])
        assert curve_figures.all_curves(one, {}, {}, results().scale, (1.0, None)) is None

    def test_classes_are_named_and_their_arches_thin(self, drawn):
        members = {"thin": [synthetic.answer_of(2.0 + 0.1 * i) for i in range(20)]}
        answers = {f"a{i}": a for i, a in enumerate(members["thin"])}
        answers |= {"alone": synthetic.answer_of(6.0)}
        made = {"thin": synthetic.answer_of(3.0)}
        curve_figures.all_curves(answers, made, members, results().scale, (0.8, None))
        words = [box[0] for box in drawn[0].boxes]
        assert {"thin", "alone", "each arch"} <= set(words)
        assert "a3" not in words

    def test_panels_of_a_class(self, drawn):
        members = [synthetic.answer_of(3.0 + 0.1 * i) for i in range(20)]
        values = {
            "thickness": np.linspace(1.3, 1.7, 20),
            "a parameter with a very long name indeed": np.linspace(-1e-4, 1e-4, 20),
            "material": np.array([f"a long name of a stone {i % 9}" for i in range(20)]),
        }
        class_section.theta_panels(members, values, "ring", results().scale)
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        # A point for each arch in each panel.
        assert "".join(drawn[0].parts).count("a2.4 2.4 0 1 0 4.8") == 60
        assert class_section.theta_panels(members, {}, "ring", results().scale) is None

    def test_measures(self, drawn):
        rows = [{"measure": f"Sa({i / 10:g})", "efficiency": 0.2 + 0.01 * i} for i in range(25)]
        measure_figures.measures_figure(rows, "ring", "Sa(0)")
        assert [overlaps(sheet) for sheet in drawn] == [[], []]
        assert measure_figures.measures_figure(rows[:1], "ring", "Sa(0)") is None

    def test_the_check_finds_an_overlap(self):
        sheet = Sheet(100.0)
        sheet.height = 30.0
        sheet.text(10.0, 20.0, "wide label")
        assert not overlaps(sheet)
        sheet.text(12.0, 22.0, "wide label")
        sheet.text(90.0, 5.0, "leaves")
        assert len(overlaps(sheet)) == 2

    def test_labels_that_would_touch_are_left_out(self):
        sheet = Sheet(100.0)
        sheet.height = 60.0
        panel = Panel(sheet, (10.0, 0.0, 90.0, 20.0), (0.0, 1.0), (0.0, 1.0))
        panel.axis_x(np.linspace(0, 1, 30), "")
        assert 2 <= len(sheet.boxes) < 10
        assert not overlaps(sheet)


class TestArchFigure:
    @pytest.mark.parametrize("voussoirs", [7, 27, 81])
    def test_hinges_are_drawn_at_their_corners(self, voussoirs, drawn):
        """Pixels of the hinges lie as the corners do, but for a scale and shift a direction."""
        arch, start = synthetic.arch_and_onset(voussoirs)
        arch_figure.arch_at_onset(arch, start, "ring")
        for sheet in drawn:
            dots = dots_of(sheet)
            stones = [part for part in sheet.parts if f'fill="{arch_figure.STONE}"' in part]
            assert len(stones) == 2 * arch.n_voussoir
            assert len(dots) == len(start.hinges) + len(start.hinges_minus)
            for points, hinges in ((dots[:4], start.hinges), (dots[4:], start.hinges_minus)):
                corners = np.array([getattr(arch, side)[joint] for joint, side in hinges])
                sides = [points - points[0], (corners - corners[0]) * (1.0, -1.0)]
                scale = np.linalg.norm(sides[0]) / np.linalg.norm(sides[1])
                np.testing.assert_allclose(sides[0], scale * sides[1], atol=0.3)
            assert not overlaps(sheet)

    def test_thrust_passes_through_the_hinges(self, drawn):
        """The real onset of the reference arch, ground towards +x."""
        arch, _ = synthetic.arch_and_onset()
        arch_figure.arch_at_onset(arch, onset(arch), "ring")
        thrust = next(
            part for part in drawn[0].parts
            if f'stroke="{picture.VERMILION}"' in part and "fill" in part and "h16" not in part
        )  # fmt: skip
        line = np.array(re.findall(r"([\d.]+) ([\d.]+)", thrust.split('"')[1]), dtype=float)
        hinges = dots_of(drawn[0])[:4]
        assert len(hinges) == 4
        for hinge in hinges:
            assert np.abs(line - hinge).sum(axis=1).min() < 0.3

    def test_sliding_joints_are_drawn_and_explained(self, drawn):
        arch, start = synthetic.arch_and_onset()
        shown = arch_figure.arch_at_onset(arch, replace(start, sliding=[7]), "ring")
        lines = [p for p in drawn[0].parts if f'stroke="{picture.ORANGE}"' in p]
        assert len(lines) == 1
        assert "sliding joint" in shown.svg


def dots_of(sheet):
    """Centres of the hinges that are drawn on a sheet [px]."""
    found = []
    for part in sheet.parts:
        where = re.match(r'<path d="M([\d.]+) ([\d.]+)a([\d.]+) .*stroke="#fff"/>', part)
        if where:
            x, y, radius = map(float, where.groups())
            found.append((x + radius, y))
    return np.array(found)


class TestVerdictMap:
    def test_cells_are_where_the_runs_are(self, drawn):
        data = results()
        figures.verdict_map(data)
        panel = drawn[0].panels[0]
        fell = data.verdict == Verdict.COLLAPSED
        d = "".join(
            re.findall(rf'd="([^"]+)" fill="{picture.VERMILION}"', "".join(drawn[0].parts[2:]))
        )
        bars = np.array(re.findall(r"M([\d.]+) ([\d.]+)H([\d.]+)v", d), dtype=float)
        cell = (panel.box[2] - panel.box[0]) / data.levels.size
        rows = np.unique(bars[:, 1])
        shown = [
            round(float((bars[bars[:, 1] == y][:, 2] - bars[bars[:, 1] == y][:, 0]).sum() / cell))
            for y in rows
        ]
        assert shown == sorted(int(n) for n in fell.sum(axis=1) if n)

    def test_what_was_not_simulated_is_blank_and_named(self):
        data = results()
        data.verdict[:, 3] = NOT_SIMULATED
        assert "not simulated" in figures.verdict_map(data).svg
        assert "not simulated" not in figures.verdict_map(results()).svg


class TestSummary:
    def test_unit_is_needed(self):
        data = synthetic.cube()
        assert reading_scale(data, "PGA").label == "PGA [g]"
        del data["intensity"].attrs["units"]
        with pytest.raises(InputError, match="no attribute units"):
            reading_scale(data, "PGA")

    def test_collapses_by_joint_mode_and_level(self):
        data = results()
        table = data.collapses_by_joint(8)
        assert table.sum() == (data.verdict == Verdict.COLLAPSED).sum()
        record, level = np.argwhere(data.verdict == Verdict.COLLAPSED)[0]
        joint, mode = data.collapse_joint[record, level], data.collapse_mode[record, level]
        same = (
            (data.verdict[:, level] == Verdict.COLLAPSED)
            & (data.collapse_joint[:, level] == joint)
            & (data.collapse_mode[:, level] == mode)
        )
        assert table[joint, mode, level] == same.sum() > 0
        assert not table[:, CollapseMode.LIFT_OFF].any()

    def test_resurrections(self):
        data = results()
        data.verdict[:] = [0, 0, 0, 1, 1, 1, 1, 1, 1]
        assert data.resurrections == 0
        data.verdict[2, 7] = Verdict.STANDING
        data.verdict[3, 7] = Verdict.UNFINISHED
        assert data.resurrections == 1

    def test_order_of_dimensions_does_not_matter(self):
        data = synthetic.cube()
        transposed = data.transpose("model", "level", "record", "arch")
        scale = reading_scale(data, "PGA")
        a, b = arch_results(data, "ring", scale), arch_results(transposed, "ring", scale)
        assert np.array_equal(a.verdict, b.verdict)
        assert np.array_equal(a.model_time, b.model_time)
        assert a.counts.collapsed.tolist() == b.counts.collapsed.tolist()


class TestEnvelope:
    @pytest.mark.parametrize("n", [2, 3, 200, 5000])
    def test_keeps_the_peaks(self, n):
        values = np.random.default_rng(n).standard_normal(n)
        time, low, high = motion_figures.envelope(Motion(values, 0.01))
        peak = np.abs(values).max()
        assert low.min() == pytest.approx(values.min() / peak)
        assert high.max() == pytest.approx(values.max() / peak)
        assert time.size <= 220
        assert 0.0 < time[0] < time[-1] < 0.01 * n or n <= 2

    def test_zero_record(self):
        _, low, high = motion_figures.envelope(Motion(np.zeros(50), 0.01))
        assert not low.any()
        assert not high.any()


def test_names_in_any_script_are_drawn_without_a_word_on_the_terminal():
    data = results()
    names = [f"拼音{i}" for i in range(len(data.records))]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shown = figures.verdict_map(replace(data, records=names))
    assert all(name in shown.svg for name in names)
    assert all(name in shown.narrow for name in names)
