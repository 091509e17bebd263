"""What the figures are drawn from, and that their labels keep clear of each other."""

import warnings
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.motions.motion import Motion
from archfrag.report import arch_figure, canvas, figures, motion_figures
from archfrag.report.summary import arch_results, reading_scale
from archfrag.simulate import onset
from tests.report import synthetic


def results(**options):
    data = synthetic.cube(**options)
    return arch_results(data, "ring", reading_scale(data, "PGA"))


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


def overlaps(figure):
    """Pairs of tick labels, titles and axis labels of a figure that cover each other."""
    FigureCanvasAgg(figure)
    figure.draw_without_rendering()
    boxes = []
    for axes in figure.axes:
        labels = list(axes.texts)
        for axis in (axes.xaxis, axes.yaxis) if axes.axison else ():
            low, high = sorted(axis.get_view_interval())
            labels += [t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
        labels += [axes.xaxis.label, axes.yaxis.label, axes.title, axes._left_title]
        boxes += [
            (t.get_text(), t.get_window_extent())
            for t in labels
            if t.get_text() and t.get_visible()
        ]
    return [
        (a, b)
        for i, (a, box) in enumerate(boxes)
        for b, other in boxes[i + 1 :]
        if box.padded(-0.5).overlaps(other.padded(-0.5))
    ]


class TestLabelsKeepClear:
    @pytest.mark.parametrize("n_level", [2, 9, 16, 40])
    def test_figures_over_levels(self, n_level, drawn):
        data = results(n_level=n_level)
        figures.verdict_map(data, "a")
        figures.collapses(data, 8, "b")
        figures.numerics(data, "c")
        figures.curve(data, None, "d", 0.9)
        assert len(drawn) == 4
        assert [overlaps(figure) for figure in drawn] == [[], [], [], []]

    def test_many_joints(self, drawn):
        figures.collapses(results(n_joint=82), 82, "a")
        assert overlaps(drawn[0]) == []

    @pytest.mark.parametrize("n_record", [1, 6, 60])
    def test_records(self, n_record, drawn):
        items = synthetic.motions(n_record)
        figures.verdict_map(results(items=items if n_record > 1 else None), "a")
        motion_figures.thumbnails(items, "b")
        assert [overlaps(figure) for figure in drawn] == [[], []]

    def test_single_joint(self, drawn):
        figures.collapses(results(n_joint=1), 1, "a")
        for axes in drawn[0].axes:
            assert [label.get_text() for label in axes.get_yticklabels()] == ["0"]

    def test_the_check_finds_an_overlap(self):
        figure = Figure(figsize=(1.0, 1.0))
        axes = figure.subplots()
        axes.set_xticks([0.0, 0.01], ["wide label", "wide label"])
        axes.set_xlim(0.0, 1.0)
        assert overlaps(figure)


class TestArchFigure:
    @pytest.mark.parametrize("voussoirs", [7, 27])
    def test_hinges_are_drawn_at_their_corners(self, voussoirs, drawn):
        arch, start = synthetic.arch_and_onset(voussoirs)
        arch_figure.arch_at_onset(arch, start, "ring", "a")
        left, right = drawn[0].axes
        for axes, hinges in ((left, start.hinges), (right, start.hinges_minus)):
            points = {
                tuple(line.get_xydata()[0]) for line in axes.lines if line.get_marker() == "o"
            }
            assert points == {tuple(getattr(arch, side)[joint]) for joint, side in hinges}
            assert len(axes.patches) == arch.n_voussoir

    def test_thrust_passes_through_the_hinges(self, drawn):
        """The real onset of the reference arch, ground towards +x."""
        arch, _ = synthetic.arch_and_onset()
        arch_figure.arch_at_onset(arch, onset(arch), "ring", "a")
        lines = drawn[0].axes[0].lines
        hinges = [line.get_xydata()[0] for line in lines if line.get_marker() == "o"]
        (thrust,) = [line for line in lines if line.get_color() == canvas.VERMILION]
        assert len(hinges) == 4
        for hinge in hinges:
            assert np.abs(thrust.get_xydata() - hinge).sum(axis=1).min() < 1e-6

    def test_sliding_joints_are_drawn_and_explained(self, drawn):
        arch, start = synthetic.arch_and_onset()
        shown = arch_figure.arch_at_onset(arch, replace(start, sliding=[7]), "ring", "a")
        ends = np.stack([arch.intrados[7], arch.extrados[7]])
        assert any(np.array_equal(line.get_xydata(), ends) for line in drawn[0].axes[0].lines)
        assert "sliding joint" in shown.svg

    @pytest.mark.parametrize("voussoirs", [7, 27, 81])
    def test_joint_numbers_keep_clear(self, voussoirs, drawn):
        arch_figure.arch_at_onset(*synthetic.arch_and_onset(voussoirs), "ring", "a")
        assert len(drawn[0].axes[0].texts) >= 8
        assert overlaps(drawn[0]) == []


class TestSummary:
    def test_reader_units(self):
        data = synthetic.cube()
        scale = reading_scale(data, "PGA")
        assert scale.label == "PGA [g]"
        assert scale.text(9.80665) == "1.00 g"
        data["intensity"].attrs["units"] = "m s-1"
        assert reading_scale(data, "PGV").text(0.25) == "0.250 m/s"
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
        turned = data.transpose("model", "level", "record", "arch")
        scale = reading_scale(data, "PGA")
        a, b = arch_results(data, "ring", scale), arch_results(turned, "ring", scale)
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


def test_settings_of_the_caller_are_left_alone():
    matplotlib.rcParams["font.size"] = 23.0
    try:
        figures.numerics(results(), "a")
        assert matplotlib.rcParams["font.size"] == 23.0
    finally:
        matplotlib.rcdefaults()


def test_names_in_any_script_are_drawn_without_a_word_on_the_terminal():
    data = results()
    names = [f"拼音{i}" for i in range(len(data.records))]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shown = figures.verdict_map(replace(data, records=names), "a")
    assert all(name in shown.svg for name in names)
