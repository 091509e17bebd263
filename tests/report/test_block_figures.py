"""The figures of the single block: drawn from the kernels, legible, and written by the command."""

import re
import xml.etree.ElementTree as ET

import matplotlib
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from archfrag.cli import main
from archfrag.errors import InputError
from archfrag.mechanics.block import formulas
from archfrag.mechanics.block.formulas import CORNER_A, uniform_block
from archfrag.mechanics.block.motion import Mechanism
from archfrag.mechanics.block.regions import starting_region
from archfrag.report import block_figures, canvas
from archfrag.study.workflow import snakefile


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


def shade_at(axes, x, y):
    """Colour of the region that is drawn at a point."""
    found = [
        to_hex(shape.get_facecolor()[0] if np.ndim(shape.get_facecolor()) > 1
               else shape.get_facecolor())
        for shape in [*axes.collections, *axes.patches]
        for path in (shape.get_paths() if hasattr(shape, "get_paths")
                     else [shape.get_path().transformed(shape.get_patch_transform())])
        if path.contains_point((x, y))
    ]  # fmt: skip
    return set(found)


class TestRegions:
    @pytest.mark.parametrize("slenderness", [0.2, 0.4, 1.0])
    def test_the_shade_of_a_point_is_that_of_its_motion(self, slenderness, drawn):
        block_figures.starting_regions(slenderness, "a", 1.5 * slenderness)
        first, second, third, _ = drawn[0].axes
        block = uniform_block(slenderness, 1.0, 1.0)
        rng = np.random.default_rng(1)
        reach = 2.5 * slenderness
        seen = set()
        for x, y in rng.uniform([-reach, 0.0], [reach, reach], (400, 2)):
            for axes, ground_y in ((first, 0.0), (second, -0.4)):
                mechanism = starting_region(block, x, ground_y, y)[0]
                assert block_figures._SHADE[mechanism] in shade_at(axes, x, y)
                seen.add(mechanism)
        for x, y in rng.uniform([-reach, -1.4], [reach, 0.8], (400, 2)):
            mechanism = starting_region(block, x, y, 1.5 * slenderness)[0]
            if mechanism != Mechanism.LIFT_OFF:
                assert block_figures._SHADE[mechanism] in shade_at(third, x, y)
        assert seen == set(Mechanism) - {Mechanism.LIFT_OFF}

    def test_a_block_that_only_slides_when_its_friction_is_low(self, drawn):
        block_figures.starting_regions(1.0, "a", 0.5)
        words = [text.get_text() for text in drawn[0].axes[2].texts]
        assert "slide" in words
        assert not any("rock" in word for word in words)

    @pytest.mark.parametrize("slenderness", [0.1, 0.4, 2.0])
    def test_labels_keep_clear(self, slenderness, drawn):
        block_figures.starting_regions(slenderness, "a", 1.5 * slenderness)
        assert overlaps(drawn[0]) == []


class TestReactions:
    def test_labels_keep_clear(self, drawn):
        block_figures.reactions_in_cone("a")
        assert overlaps(drawn[0]) == []

    def test_titles_say_what_happens(self, drawn):
        """Whether each state does what its title says, by the arrows that only then are drawn."""
        block_figures.reactions_in_cone("a")
        labels = [{text.get_text() for text in axes.texts} for axes in drawn[0].axes]
        assert "missing" not in labels[0] | labels[1]
        assert {"missing", "Ψ", "−S"} <= labels[2]
        assert "centripetal" in labels[1]
        assert "along u̇" in labels[3]

    def test_plane_keeps_lengths_and_angles(self):
        block = uniform_block(0.4, 1.0, 1.0)
        arm = formulas.corner_arm(block, CORNER_A, 0.1)
        n_t = formulas.tangential_gradient(block, arm)
        n_n = formulas.normal_gradient(block, arm)
        flat = block_figures._Plane(n_t, n_n)
        for a in (n_t, n_n):
            for b in (n_t, n_n):
                assert flat(a) @ flat(b) == pytest.approx(formulas.dot(a, b))
        assert flat(n_n)[0] == pytest.approx(0.0, abs=1e-12)


class TestCommand:
    def test_writes_whole_svg_files(self, tmp_path):
        out = tmp_path / "new" / "figures"
        result = CliRunner().invoke(main, ["figures", "method", str(out)])
        assert result.exit_code == 0, result.output
        names = ["block_regions.svg", "block_reactions.svg"]
        assert result.output.split() == [str(out / name) for name in names]
        assert sorted(path.name for path in out.iterdir()) == sorted(names)
        for name in names:
            root = ET.parse(out / name).getroot()
            assert root.tag == "{http://www.w3.org/2000/svg}svg"
            assert root.find("{http://www.w3.org/2000/svg}desc").text
            assert "20" not in re.findall(r"<dc:date>(.*?)</dc:date>", (out / name).read_text())

    def test_same_bytes_from_the_same_numbers(self, tmp_path):
        first, second = (
            block_figures.write_method_figures(tmp_path / name) for name in ("a", "b")
        )
        assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]

    def test_what_cannot_be_drawn_is_refused(self, tmp_path):
        result = CliRunner().invoke(
            main, ["figures", "method", str(tmp_path), "--slenderness", "0"]
        )
        assert result.exit_code == InputError.exit_code
        assert "b/h must be between" in result.stderr
        assert not list(tmp_path.iterdir())

    def test_rule_calls_the_command(self):
        text = snakefile().read_text()
        assert 'include: "pipeline/rules/method.smk"' in text
        rule = snakefile().parent / "pipeline" / "rules" / "method.smk"
        assert "archfrag figures method" in rule.read_text()


def test_settings_of_the_caller_are_left_alone():
    before = matplotlib.rcParams["font.size"]
    block_figures.reactions_in_cone("a")
    assert matplotlib.rcParams["font.size"] == before
    assert canvas.WIDTH > 0
