"""Drawings: blocks of a DXF file make a chain, or are refused by handle."""

import json
import math

import ezdxf
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, reject, settings
from hypothesis import strategies as st

import archfrag as af
from archfrag.arch.drawing import UNITS, read_drawing
from archfrag.arch.outlines import outline_section
from archfrag.cli import main
from archfrag.errors import GeometryError, StudyError
from archfrag.study.config import load_study
from archfrag.study.members import members

# A pier of three blocks, each half as high as wide, on the ground at y = 0.
PIER = [[(0, h), (1, h), (1, h + 0.5), (0, h + 0.5)] for h in (0.0, 0.5, 1.0)]
GROUND = ((0, 0), (1, 0))


def draw(path, blocks, ground=(GROUND,), unit=6, closed=True, layer="STONE", old=False):
    """A drawing by hand, of corners (x, y) or (x, y, bulge)."""
    document = ezdxf.new("R2000" if not old else "R12")
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    for block in blocks:
        add = space.add_polyline2d if old else space.add_lwpolyline
        rows = [(*corner, 0.0)[:3] for corner in block]
        add(rows, format="xyb", close=closed, dxfattribs={"layer": layer})
    for start, end in ground:
        space.add_line(start, end, dxfattribs={"layer": layer})
    document.saveas(path)
    return document


RISES = {"segmental": (0.1, 0.5), "pointed": (0.55, 1.0), "elliptic": (0.3, 0.5)}


@st.composite
def arches(draw_):
    """Any arch, column or block that archfrag makes."""
    kind = draw_(st.sampled_from(["circular", "block", "wall", *RISES]))
    count, part = draw_(st.integers(2, 30)), draw_(st.floats(0.0, 1.0))
    span, thick, mu = (draw_(st.floats(*r)) for r in ((1.0, 40.0), (0.06, 0.15), (0.3, 1.5)))
    if kind == "block":
        return af.Block(span, (1.0 + 5.0 * part) * span, mu)
    if kind == "wall":
        height = np.linspace(0.0, span, count + 1)
        right = np.column_stack([thick * span * (1.0 + part - part * height / span), height])
        return af.Arch.from_joints(right, right * [-1, 1], mu, free_end=True)
    curved = {} if kind in ("pointed", "elliptic") else {"sector": draw_(st.booleans())}
    if kind == "circular":
        return af.Arch.circular(span / 2, thick * span, 60 + 240 * part, count, mu, **curved)
    low, high = RISES[kind]
    rise = (low + (high - low) * part) * span
    try:
        return getattr(af.Arch, kind)(span, rise, thick * span, count, mu, **curved)
    except GeometryError:  # joints that cross, mostly beside a pointed crown
        reject()


class TestRoundTrip:
    @given(arches(), st.sampled_from(sorted(UNITS)))
    @settings(max_examples=60, deadline=None)
    def test_same_arch(self, tmp_path_factory, arch, unit):
        path = tmp_path_factory.mktemp("drawn") / "arch.dxf"
        arch.to_dxf(path, unit)
        again = af.Arch.from_dxf(path, arch.parameters["friction"])
        assert again.free_end == arch.free_end
        for name in ("mass", "inertia", "centroid", "face_before", "face_after"):
            ours, theirs = getattr(arch.chain, name), getattr(again.chain, name)
            np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-13 * np.abs(ours).max())
        before, after = ([o.plus, o.minus] for o in map(af.onset, (arch, again)))
        np.testing.assert_allclose(after, before, rtol=1e-10, atol=1e-12)
        content = path.read_bytes()
        arch.to_dxf(path, unit)
        assert path.read_bytes() == content


class TestSection:
    """Arcs of outlines against closed forms."""

    def test_half_disk(self):
        # Half a disk: centroid 4 r/(3 pi) above its base, pi r^4/4 about the middle of it.
        found = outline_section(np.array([[-2.0, 0, 0], [2.0, 0, 1.0]]))
        away = 4 * 2.0 / (3 * math.pi)
        area = math.pi * 2.0
        assert found.area == pytest.approx(area, rel=1e-14)
        np.testing.assert_allclose(found.centroid, [0, away], atol=1e-14)
        assert found.polar == pytest.approx(math.pi * 16 / 4 - area * away**2, rel=1e-13)


class TestChain:
    @pytest.mark.parametrize("old", [False, True])
    def test_pier(self, tmp_path, old):
        # In any order, one clockwise, in centimetres, as an old POLYLINE or seen from behind.
        sign = 1 if old else -1
        blocks = [[(sign * 100 * x, 100 * y) for x, y in PIER[i]] for i in (1, 2, 0)]
        ground = [((0, 0), (100, 0))]
        drawn = draw(tmp_path / "a.dxf", [blocks[0][::-1], *blocks[1:]], ground, 5, old=old)
        for polyline in drawn.modelspace().query("LWPOLYLINE"):
            polyline.dxf.extrusion = (0, 0, -1)
        drawn.saveas(tmp_path / "a.dxf")
        pier = af.Arch.from_dxf(tmp_path / "a.dxf", 0.9, unit="cm")
        assert (pier.n_voussoir, pier.n_joint, pier.free_end) == (3, 3, True)
        assert af.onset(pier).plus == pytest.approx(1.0 / 1.5)
        assert pier.chain.centroid[:, 1] == pytest.approx([0.25, 0.75, 1.25])

    def test_blocks_wider_than_joints(self):
        # A drum on a plinth: the joint is what both have in common.
        plinth = [(-1, 0), (1, 0), (1, 1), (-1, 1)]
        drum, ground = [(-0.5, 1), (0.5, 1), (0.5, 3), (-0.5, 3)], [[(-1, 0), (1, 0)]]
        column = af.Arch.from_polygons([drum, plinth], 5.0, ground=ground)
        np.testing.assert_allclose(column.intrados[1], [0.5, 1])
        assert af.onset(column).plus == pytest.approx(0.5)
        with pytest.raises(GeometryError, match=r"thickness_factor = 1\.1"):
            af.Arch.from_polygons([drum, plinth], 5.0, ground=ground, thickness_factor=1.1)

    def test_thickness_factor(self, tmp_path):
        af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7).to_dxf(tmp_path / "a.dxf")
        drawn = af.Arch.from_dxf(tmp_path / "a.dxf", 0.7, thickness_factor=1.1, dead_load=1e4)
        thick = af.Arch.circular(10.0, 1.65, 157.5, 7, 0.7, dead_load=1e4)
        for pair in zip(thick.chain[:6], drawn.chain[:6]):
            np.testing.assert_allclose(*pair, rtol=1e-13, atol=1e-12)


LOW, MIDDLE, HIGH = PIER
# Blocks with a fault, which of them is to be named, and what the message has to contain.
FAULTS = {
    "gap": ([LOW, MIDDLE, [(x, y + 0.01) for x, y in HIGH]], 1, "0.01 m away"),
    "branch": ([*PIER, [(1, 0.5), (2, 0.5), (2, 1.0), (1, 1.0)]], 1, "3 joints"),
    "overlap": ([LOW, MIDDLE, [(x, y - 0.1) for x, y in HIGH]], 1, "overlaps"),
    "doubled": ([*PIER, HIGH], 2, "same block"),
    "crossed": ([LOW, [MIDDLE[i] for i in (0, 2, 1, 3)], HIGH], 1, "itself"),
    "stepped": ([[*LOW[:2], (1, 0.7), (0.5, 0.7), (0.5, 0.5), (0, 0.5)],
                 [(0, 0.5), (0.5, 0.5), (0.5, 0.7), (1, 0.7), (1, 1), (0, 1)]], 0, "one line"),
    "corner": ([LOW, [(0, 0.5), (1, 0.5), (0, 1)], [(1, 0.5), (1, 1), (0, 1)]], 1, "meet"),
}  # fmt: skip


class TestRefused:
    """One message with file, layer and handle."""

    @pytest.mark.parametrize(("blocks", "wrong", "word"), FAULTS.values(), ids=FAULTS)
    def test_no_chain(self, tmp_path, blocks, wrong, word):
        document = draw(tmp_path / "a.dxf", blocks)
        handle = document.modelspace()[wrong].dxf.handle
        with pytest.raises(GeometryError) as error:
            af.Arch.from_dxf(tmp_path / "a.dxf", 0.7)
        for part in (f"a.dxf, layer STONE: LWPOLYLINE {handle}", word):
            assert part in str(error.value)

    @pytest.mark.parametrize(
        ("options", "reading", "word"),
        [
            ({"closed": False}, {}, "LWPOLYLINE 2F is open"),
            ({"unit": 0}, {}, "INSUNITS = 0"),
            ({"unit": 4}, {}, "0.0015 m"),
            ({}, {"layer": "BRICK"}, "layers with polylines: STONE (3)"),
            ({"ground": []}, {}, "LWPOLYLINE 2F"),
            ({"ground": [((0, 0.1), (1, 0.1))]}, {}, "LINE 32 must be on"),
            ({"ground": [GROUND, ((0, 0.5), (0, 1))]}, {}, "between two joints"),
        ],
    )
    def test_drawing(self, tmp_path, options, reading, word):
        blocks = PIER[:1] if options == {"ground": []} else PIER
        draw(tmp_path / "a.dxf", blocks, **options)
        with pytest.raises(GeometryError) as error:
            af.Arch.from_dxf(tmp_path / "a.dxf", 0.7, **reading)
        assert word in str(error.value)

    def test_other_entities(self, tmp_path):
        document = draw(tmp_path / "a.dxf", PIER)
        space = document.modelspace()
        space.add_text("north elevation", dxfattribs={"layer": "STONE"})
        document.saveas(tmp_path / "a.dxf")
        assert len(read_drawing(tmp_path / "a.dxf").outlines) == 3
        circle = space.add_circle((0, 0), 1, dxfattribs={"layer": "STONE"})
        document.saveas(tmp_path / "a.dxf")
        with pytest.raises(GeometryError, match=f"CIRCLE {circle.dxf.handle} is no 2D polyline"):
            read_drawing(tmp_path / "a.dxf")

    def test_text_that_begins_with_a_mark_of_its_encoding(self, tmp_path):
        draw(tmp_path / "a.dxf", PIER)
        (tmp_path / "a.dxf").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "a.dxf").read_bytes())
        assert len(read_drawing(tmp_path / "a.dxf").outlines) == 3

    def test_very_many_corners(self, tmp_path):
        corners = [(0.1 * k, (k % 7) * 0.1) for k in range(25_000)]
        draw(tmp_path / "a.dxf", [corners])
        with pytest.raises(GeometryError, match="more than 20000 corners"):
            read_drawing(tmp_path / "a.dxf")

    @pytest.mark.parametrize("content", [None, b"AC1032\0\0"])
    def test_no_dxf(self, tmp_path, content):
        if content is not None:
            (tmp_path / "a.dxf").write_bytes(content)
        with pytest.raises(GeometryError, match=r"a\.dxf:? (is not a DXF file|cannot be read)"):
            read_drawing(tmp_path / "a.dxf")


STUDY = """
id: drawn
title: From a drawing
arches: [{{id: pier, drawing: pier.dxf, friction: 0.9{more}}}]
motions:
  synthetic: {{events: 1, records_per_event: 1, magnitude: [6], distance_km: [10], seed: 1}}
intensity: {{measure: PGA, unit: g, levels: [0.3, 0.6]}}
"""


class TestStudy:
    def test_members_are_of_the_content(self, tmp_path):
        draw(tmp_path / "pier.dxf", PIER)
        vary = "samples: 4, of: {thickness_factor: {distribution: normal, mean: 1, cov: 0.1}}"
        (tmp_path / "s.yaml").write_text(STUDY.format(more=f", vary: {{{vary}}}"))
        study = load_study(tmp_path / "s.yaml")
        found = members(study)
        assert found.ids == [f"pier-000{i}" for i in (1, 2, 3, 4)]
        assert "pier.dxf" not in json.dumps([entry.model_dump() for entry in found.entries])
        widths = [np.ptp(entry.build().outlines[0][:, 0]) for entry in found.entries]
        np.testing.assert_allclose(widths, found.parameters()["thickness_factor"], rtol=1e-12)
        draw(tmp_path / "pier.dxf", PIER[:2])
        assert members(study).entries[0].build().n_voussoir == 2

    def test_refused_with_its_place(self, tmp_path):
        draw(tmp_path / "pier.dxf", PIER, closed=False)
        (tmp_path / "s.yaml").write_text(STUDY.format(more=""))
        with pytest.raises(StudyError, match=r"arches\[0\] \(pier\): .*pier.dxf.*is open"):
            load_study(tmp_path / "s.yaml")
        (tmp_path / "s.yaml").write_text(STUDY.format(more=", radius: 3"))
        with pytest.raises(StudyError, match=r"arches\[0\].radius"):
            load_study(tmp_path / "s.yaml")

    def test_commands(self, tmp_path):
        path = str(tmp_path / "new" / "a.dxf")
        given = ["--radius", "10", "--thickness", "1.5", "--embrace", "157.5", "--voussoirs", "7"]
        options = [*given, "--friction", "0.7", "--output", path, "--output-unit", "mm"]
        assert CliRunner().invoke(main, ["draw", *options]).exit_code == 0
        asked = ["onset", "--drawing", path, "--friction", "0.7", "--json"]
        answer = json.loads(CliRunner().invoke(main, asked).stdout)
        assert answer["plus"] == pytest.approx(0.37000973802187703, rel=1e-12)
        refused = CliRunner().invoke(main, [*asked, "--drawing-unit", "m"])
        assert (refused.exit_code, "unit" in refused.stderr) == (2, True)
