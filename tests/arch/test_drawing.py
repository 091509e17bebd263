"""Drawings: blocks of a DXF file make a chain, or are refused by handle."""

import json
import re

import ezdxf
import numpy as np
import pytest
from click.testing import CliRunner
from ezdxf.xclip import XClip

import archfrag as af
from archfrag.arch.drawing import read_drawing
from archfrag.cli import main
from archfrag.errors import GeometryError
from archfrag.study.file.arches import ArchEntry
from tests.arch.test_arch import CHAINS

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


UNITS = {
    "m": (1.0, 6),
    "mm": (0.001, 4),
    "in": (0.0254, 1),
}  # [m], and code of $INSUNITS


def draw_arch(path, arch, scale=1.0, code=6):
    """A drawing of an arch, with arcs where its voussoirs are annular sectors."""
    given = arch.parameters
    blocks = [outline / scale for outline in arch.outlines]
    # Outlines go along the intrados, then back along the extrados, with as many points.
    half = len(blocks[-1]) // 2
    ground = [blocks[0][[0, -1]], blocks[-1][[half - 1, half]]][: 2 - arch.free_end]
    if "outlines" in given:
        blocks = [np.array(block) / [scale, scale, 1.0] for block in given["outlines"]]
        ground = [np.array(line) / scale for line in given["ground"]]
    elif given.get("sector"):
        corners = [
            block[[0, len(block) // 2 - 1, len(block) // 2, -1]] for block in blocks
        ]
        sides = [corner[[3, 2]] - corner[[0, 1]] for corner in corners]
        angle = [
            np.arctan2(*side.T) for side in sides
        ]  # of both joints, clockwise from above
        bulge = [
            np.tan(0.25 * ((first - second) % (-2.0 * np.pi)))
            for first, second in angle
        ]
        rows = [np.array([b, 0.0, -b, 0.0]) for b in bulge]
        blocks = [np.column_stack(pair) for pair in zip(corners, rows)]
    draw(
        path,
        [block.tolist() for block in blocks],
        [line.tolist() for line in ground],
        code,
    )


@pytest.mark.parametrize("unit", ["m", "in"])
@pytest.mark.parametrize("name", sorted(CHAINS.keys() - {"reversed", "swapped"}))
def test_what_is_drawn_is_read_as_the_same_arch(tmp_path, name, unit):
    arch = CHAINS[name]
    draw_arch(tmp_path / "arch.dxf", arch, *UNITS[unit])
    density = arch.parameters["density"]
    again = af.Arch.from_dxf(
        tmp_path / "arch.dxf", arch.chain.friction, density=density
    )
    assert again.free_end == arch.free_end
    for ours, theirs in zip(arch.chain[:5], again.chain[:5]):
        np.testing.assert_allclose(
            theirs, ours, rtol=0, atol=1e-13 * np.abs(ours).max()
        )


@pytest.mark.parametrize("old", [False, True])
def test_pier(tmp_path, old):
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


def test_blocks_wider_than_joints():
    # A drum on a plinth: the joint is what both have in common.
    plinth = [(-1, 0), (1, 0), (1, 1), (-1, 1)]
    drum = [(-0.5, 1), (0.5, 1), (0.5, 3), (-0.5, 3)]
    ground = [[(-1, 0), (1, 0)]]
    column = af.Arch.from_polygons([drum, plinth], 5.0, ground=ground)
    np.testing.assert_allclose(column.intrados[1], [0.5, 1])
    assert af.onset(column).plus == pytest.approx(0.5)
    with pytest.raises(GeometryError, match=r"thickness_factor = 1\.1"):
        af.Arch.from_polygons([drum, plinth], 5.0, ground=ground, thickness_factor=1.1)


def test_thickness_factor(tmp_path):
    draw_arch(tmp_path / "a.dxf", af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7))
    drawn = af.Arch.from_dxf(
        tmp_path / "a.dxf", 0.7, thickness_factor=1.1, dead_load=1e4
    )
    thick = af.Arch.circular(10.0, 1.65, 157.5, 7, 0.7, dead_load=1e4)
    for pair in zip(thick.chain[:6], drawn.chain[:6]):
        np.testing.assert_allclose(*pair, rtol=1e-13, atol=1e-12)


LOW, MIDDLE, HIGH = PIER
# Blocks with a fault, which of them is to be named, and what the message has to contain.
FAULTS = {
    "gap": ([LOW, MIDDLE, [(x, y + 0.01) for x, y in HIGH]], 1, "0.01 m away"),
    "branch": ([*PIER, [(1, 0.5), (2, 0.5), (2, 1.0), (1, 1.0)]], 2, "hangs at one"),
    "overlap": ([LOW, MIDDLE, [(x, y - 0.1) for x, y in HIGH]], 1, "overlaps"),
    "doubled": ([*PIER, HIGH], 2, "overlaps"),
    "crossed": ([LOW, [MIDDLE[i] for i in (0, 2, 1, 3)], HIGH], 1, "itself"),
    "stepped": (
        [
            [*LOW[:2], (1, 0.7), (0.5, 0.7), (0.5, 0.5), (0, 0.5)],
            [(0, 0.5), (0.5, 0.5), (0.5, 0.7), (1, 0.7), (1, 1), (0, 1)],
        ],
        0,
        "one line",
    ),
    "corner": (
        [LOW, [(0, 0.5), (1, 0.5), (0, 1)], [(1, 0.5), (1, 1), (0, 1)]],
        1,
        "meet",
    ),
}


@pytest.mark.parametrize(("blocks", "wrong", "word"), FAULTS.values(), ids=FAULTS)
def test_blocks_that_make_no_chain_are_refused_by_handle(tmp_path, blocks, wrong, word):
    handle = draw(tmp_path / "a.dxf", blocks).modelspace()[wrong].dxf.handle
    with pytest.raises(GeometryError, match=f"STONE: LWPOLYLINE {handle} .*{word}"):
        af.Arch.from_dxf(tmp_path / "a.dxf", 0.7)


@pytest.mark.parametrize(
    ("blocks", "options", "reading", "word"),
    [
        (PIER, {"closed": False}, {}, "LWPOLYLINE 2F is open"),
        (PIER, {"unit": 0}, {}, "INSUNITS = 0"),
        (PIER, {"unit": 4}, {}, "0.0015 m"),
        (
            PIER,
            {},
            {"layer": "BRICK"},
            r"BRICK has nothing .*layers with polylines: STONE \(3\)",
        ),
        (PIER[:1], {"ground": []}, {}, "LWPOLYLINE 2F"),
        (PIER, {"ground": [((0, 0.1), (1, 0.1))]}, {}, "LINE 32 must be on"),
        (PIER, {"ground": [GROUND, ((0, 0.5), (0, 1))]}, {}, "hangs at one joint"),
    ],
)
def test_drawings_that_are_refused(tmp_path, blocks, options, reading, word):
    draw(tmp_path / "a.dxf", blocks, **options)
    with pytest.raises(GeometryError, match=word):
        af.Arch.from_dxf(tmp_path / "a.dxf", 0.7, **reading)


class Sheet:
    """A drawing in m with layers, of which some hide what is on them, and blocks."""

    def __init__(self, path, frozen=(), off=()):
        self.path = path
        self.document = ezdxf.new(units=6)
        self.space = self.document.modelspace()
        self.frozen = frozen
        self.off = off

    def add(self, corners, layer="STONE", where=None, **attributes):
        add = (self.space if where is None else where).add_lwpolyline
        return add(corners, close=True, dxfattribs={"layer": layer, **attributes})

    def block(self, name, corners, layer="0"):
        block = self.document.blocks.new(name)
        self.add(corners, layer, block)
        return block

    def insert(self, name, place, layer="STONE", where=None, **attributes):
        add = (self.space if where is None else where).add_blockref
        return add(name, place, dxfattribs={"layer": layer, **attributes})

    def read(self, **given):
        for names, hide in ((self.frozen, "freeze"), (self.off, "off")):
            for name in names:
                getattr(self.document.layers.get(name), hide)()
        for entity in self.space:
            if entity.dxf.layer not in self.document.layers:
                self.document.layers.add(entity.dxf.layer)
        self.document.saveas(self.path)
        return read_drawing(self.path, **given)


UNIT = [(0, 0), (1, 0), (1, 0.5), (0, 0.5)]


def pier(tmp_path, **hidden):
    sheet = Sheet(tmp_path / "a.dxf", **hidden)
    for name in ("STONE", "OTHER"):
        sheet.document.layers.add(name)
    for corners in PIER[:2]:
        sheet.add(corners)
    sheet.space.add_line(*GROUND, dxfattribs={"layer": "STONE"})
    return sheet


class TestWhatIsSeen:
    def test_and_is_no_part_of_the_arch_is_counted_and_named(self, tmp_path):
        sheet = pier(tmp_path)
        for corners in PIER[:2]:  # hatches of the blocks, and below one of no block
            sheet.space.add_hatch().paths.add_polyline_path(corners)
        sheet.space.add_text("plinth")
        assert sheet.read().caution == ""
        sheet.space.add_hatch().paths.add_polyline_path(PIER[2])
        sheet.block("CAP", UNIT)
        sheet.insert("CAP", (0, 1), "OTHER")
        sheet.insert("CAP", (0, 1.5), "OTHER")
        for k in range(3):
            sheet.space.add_line((5, k), (6, k))
        sheet.space.add_arc((0, 0), 1, 0, 90, dxfattribs={"layer": "AXIS"})
        sheet.document.add_xref_def("other.dwg", "ABUTMENT")
        sheet.insert("ABUTMENT", (0, 0), "REFS")
        found = sheet.read(layer="STONE")
        assert len(found.outlines) == 2
        assert found.caution == (
            "a.dxf: 2 blocks (INSERT of CAP) on layer OTHER, 1 ARC on layer AXIS, 1 HATCH on "
            "layer 0, 1 INSERT on layer REFS, 3 LINE on layer 0 are not part of the arch; if some "
            "of it is, name its layer too"
        )
        with pytest.warns(UserWarning, match="2 blocks .INSERT of CAP. on layer OTHER"):
            af.Arch.from_dxf(sheet.path, 0.9, layer="STONE")
        asked = (
            "onset",
            "--drawing",
            str(sheet.path),
            "--friction",
            "0.9",
            "--layer",
            "STONE",
        )
        assert "caution: a.dxf: 2 blocks" in CliRunner().invoke(main, asked).stderr

    @pytest.mark.parametrize("hidden", [{"frozen": ["OTHER"]}, {"off": ["OTHER"]}, {}])
    def test_and_nothing_else_is_read(self, tmp_path, hidden):
        sheet = pier(tmp_path, **hidden)
        for corners in PIER:
            sheet.add(
                [(x + 7, y) for x, y in corners], "OTHER", invisible=int(not hidden)
            )
        found = sheet.read()
        assert (found.layer, len(found.outlines), found.caution) == ("STONE", 2, "")
        if hidden:
            with pytest.raises(
                GeometryError, match=r"layer other .*frozen or off.*: OTHER"
            ):
                sheet.read(layer="other")

    def test_of_a_reference_hangs_on_the_layers_in_its_block(self, tmp_path):
        sheet = pier(tmp_path, off=["OTHER"])
        sheet.block(
            "CAP", UNIT, "STONE"
        )  # a block on a layer that is off shows what is on others
        sheet.insert("CAP", (0, 1), "OTHER")
        sheet.block("CUP", UNIT)
        sheet.insert("CUP", (0, 9), "OTHER")
        assert len(sheet.read().outlines) == 3
        sheet.frozen = ["OTHER"]
        assert len(sheet.read().outlines) == 2

    def test_on_several_layers_is_one_arch_if_they_are_named(self, tmp_path):
        sheet = pier(tmp_path)
        sheet.add(PIER[2], "CAPS")
        with pytest.raises(
            GeometryError, match=r"CAPS \(1\), STONE \(2\); give .*\[A, B\]"
        ):
            sheet.read()
        assert len(sheet.read(layer=["caps", "STONE"]).outlines) == 3
        arch = af.Arch.from_dxf(sheet.path, 0.9, layer=("STONE", "CAPS"))
        assert arch.n_voussoir == 3
        entry = ArchEntry(
            id="pier", drawing=str(sheet.path), friction=0.9, layer=["STONE", "CAPS"]
        )
        assert entry.build().n_voussoir == 3
        for given in (
            ["--layer", "STONE", "--layer", "CAPS"],
            ["--layer", "STONE,CAPS"],
        ):
            asked = ["onset", "--drawing", str(sheet.path), "--friction", "0.9", *given]
            answer = CliRunner().invoke(main, asked)
            assert "3 voussoirs" in answer.stderr
            assert "caution" not in answer.stderr


class TestInsertedBlocks:
    @pytest.mark.parametrize(
        "given",
        [
            {"insert": (0, 1)},
            {"insert": (1, 1), "xscale": -1},
            {"insert": (1, 1.5), "rotation": 180},
            {"insert": (0, 1.5), "yscale": -1},
            {"insert": (0, 1), "xscale": 0.5, "yscale": 0.5, "zscale": 0.5, "size": 2},
            {"insert": (0, 1), "xscale": 0.5, "size": (2, 1)},
            {"insert": (-1, 1), "extrusion": (0, 0, -1)},
        ],
    )
    def test_are_read_where_they_are_seen(self, tmp_path, given):
        sheet = pier(tmp_path)
        size = np.ones(2) * given.pop("size", 1)
        sheet.block("CAP", [tuple(size * corner) for corner in UNIT])
        sheet.insert("CAP", given.pop("insert"), **given)
        found = sheet.read()
        assert found.caution == ""
        np.testing.assert_allclose(found.outlines[2].min(axis=0), [0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(
            found.outlines[2].max(axis=0), [1, 1.5, 0], atol=1e-12
        )

    def test_may_hold_others_and_stand_in_rows(self, tmp_path):
        sheet = Sheet(tmp_path / "a.dxf")
        sheet.block("ONE", UNIT)
        pair = sheet.document.blocks.new("PAIR")
        sheet.insert("ONE", (0, 0), "0", pair)
        sheet.insert("ONE", (0, 0.5), "0", pair)
        sheet.insert("PAIR", (3, 2), row_count=3, row_spacing=1.0)
        sheet.space.add_line((3, 2), (4, 2), dxfattribs={"layer": "STONE"})
        found = sheet.read(layer="STONE")
        assert sorted(outline[:, 1].min() for outline in found.outlines) == list(
            np.arange(2, 5, 0.5)
        )
        assert af.Arch.from_dxf(sheet.path, 0.9).n_voussoir == 6

    def test_that_cannot_be_exploded_are_refused_by_handle(self, tmp_path):
        sheet = pier(tmp_path)
        round_one = [(x, y, 0.2) for x, y in UNIT]
        sheet.document.blocks.new("R").add_lwpolyline(round_one, "xyb", close=True)
        squeezed = sheet.insert("R", (0, 1), xscale=2.0)
        named = f"ELLIPSE of INSERT {squeezed.dxf.handle} .block R. is no 2D polyline"
        with pytest.raises(GeometryError, match=named):
            sheet.read()
        sheet.space.delete_entity(squeezed)
        sheet.document.add_xref_def("other.dwg", "X")
        handle = sheet.insert("X", (0, 0)).dxf.handle
        with pytest.raises(
            GeometryError, match=f"layer STONE: INSERT {handle} is no 2D polyline"
        ):
            sheet.read()

    def test_that_hold_each_other_or_too_much_are_refused(self, tmp_path):
        sheet = pier(tmp_path)
        sheet.block("ONE", UNIT)
        many = {
            "row_count": 1000,
            "column_count": 1000,
            "row_spacing": 1,
            "column_spacing": 2,
        }
        sheet.insert("ONE", (0, 1), **many)
        with pytest.raises(GeometryError, match="hold more than 50000 entities"):
            sheet.read()
        sheet = pier(tmp_path)
        block = sheet.block("SELF", UNIT)
        sheet.insert("SELF", (0, 1), "0", block)
        sheet.insert("SELF", (0, 1))
        with pytest.raises(GeometryError, match="more than 16 deep"):
            sheet.read()


@pytest.mark.parametrize("layer", [None, "0-Arcata", ["A-Giunti", "0-Arcata"]])
def test_arcs_and_joint_lines_are_told_what_to_draw(tmp_path, layer):
    sheet = Sheet(tmp_path / "a.dxf")
    for radius in (5.6, 6.2):
        sheet.space.add_arc((12, 3), radius, 28, 152, dxfattribs={"layer": "0-Arcata"})
    for k in range(23):
        sheet.space.add_line((k, 0), (k, 1), dxfattribs={"layer": "A-Giunti"})
    with pytest.raises(GeometryError) as error:
        sheet.read(layer=layer)
    message = str(error.value)
    assert "no polyline is seen, but 2 ARC on layer 0-Arcata" in message
    assert ("23 LINE on layer A-Giunti" in message) == (layer != "0-Arcata")
    assert "one closed polyline for each voussoir" in message
    assert "BOUNDARY" in message
    assert "None" not in message


def test_other_entities_and_other_files(tmp_path):
    path = tmp_path / "a.dxf"
    document = draw(path, PIER)
    space = document.modelspace()
    space.add_text("north elevation", dxfattribs={"layer": "STONE"})
    document.saveas(path)
    assert len(read_drawing(path).outlines) == 3
    circle = space.add_circle((0, 0), 1, dxfattribs={"layer": "STONE"})
    document.saveas(path)
    with pytest.raises(
        GeometryError, match=f"CIRCLE {circle.dxf.handle} is no 2D polyline"
    ):
        read_drawing(path)
    path.write_bytes(b"AC1032\0\0")
    for wrong in (path, tmp_path / "missing.dxf"):
        with pytest.raises(
            GeometryError, match=r"\.dxf:? (is not a DXF file|cannot be read)"
        ):
            read_drawing(wrong)


def test_entry_of_a_study(tmp_path):
    draw(tmp_path / "pier.dxf", PIER)
    entry = ArchEntry(
        id="pier", drawing=str(tmp_path / "pier.dxf"), friction=0.9
    ).read()
    assert entry.build().n_voussoir == 3
    assert "pier.dxf" not in entry.model_dump_json()


def test_commands(tmp_path):
    path = str(tmp_path / "a.dxf")
    draw_arch(path, af.Arch.circular(10.0, 1.5, 157.5, 7, 0.7), *UNITS["mm"])
    asked = ["onset", "--drawing", path, "--friction", "0.7", "--json"]
    answer = json.loads(CliRunner().invoke(main, asked).stdout)
    assert answer["plus"] == pytest.approx(0.37000973802187703, rel=1e-12)
    refused = CliRunner().invoke(main, [*asked, "--drawing-unit", "m"])
    assert (refused.exit_code, "unit" in refused.stderr) == (2, True)


# Entities that ezdxf keeps as tags: a proxy, text of the Express Tools, a wall of Architecture.
def kept_as_tags(kind, layer, handle="FFF1"):
    return (
        f"  0\n{kind}\n  5\n{handle}\n330\n1F\n100\nAcDbEntity\n  8\n{layer}\n100\n"
        f"AcDb{kind}\n 40\n1.0\n"
    )


def add_tags(path, *texts):
    """Put entities into the model space of a drawing, which come last there."""
    content = path.read_text()
    head, entities, tail = content.partition("ENTITIES\n")
    place = tail.index("  0\nENDSEC")
    path.write_text(head + entities + tail[:place] + "".join(texts) + tail[place:])


class TestEntitiesOfOtherKinds:
    @pytest.mark.parametrize(
        "kind",
        [
            "ARCALIGNEDTEXT",
            "RTEXT",
            "AEC_WALL",
            "ACAD_PROXY_ENTITY",
            "REGION",
            "3DSOLID",
            "BODY",
            "PLANESURFACE",
            "HELIX",
            "OLE2FRAME",
        ],
    )
    @pytest.mark.parametrize("layer", ["STONE", "OTHER"])
    def test_that_are_kept_as_tags_are_counted_or_refused(self, tmp_path, kind, layer):
        sheet = pier(tmp_path)
        sheet.read()
        add_tags(sheet.path, kept_as_tags(kind, layer))
        if "TEXT" not in kind and layer == "STONE":
            with pytest.raises(GeometryError, match=f"{kind} FFF1 is no 2D polyline"):
                read_drawing(sheet.path)
            return
        found = read_drawing(sheet.path)
        assert len(found.outlines) == 2
        assert f"1 {kind} on layer {layer} is not part of the arch" in found.caution

    @pytest.mark.parametrize(
        "add",
        [
            lambda space: space.add_3dface([(0, 1), (1, 1), (1, 2)]),
            lambda space: space.new_entity("LIGHT", {}),
            lambda space: space.add_solid([(0, 1), (1, 1), (1, 2)]),
            lambda space: space.add_spline([(0, 1), (1, 1), (1, 2)]),
            lambda space: space.add_mline([(0, 1), (1, 1)]),
        ],
    )
    def test_that_are_no_outlines_are_refused_by_handle(self, tmp_path, add):
        sheet = pier(tmp_path)
        entity = add(sheet.space)
        entity.dxf.layer = "STONE"
        with pytest.raises(
            GeometryError, match=f"{entity.dxf.handle} is no 2D polyline"
        ):
            sheet.read()


class TestWhatIsHidden:
    @pytest.mark.parametrize("depth", [1, 2])
    def test_by_a_clip_is_not_told_and_refused_on_the_layer_of_the_arch(
        self, tmp_path, depth
    ):
        sheet = pier(tmp_path)
        block = sheet.block("CAP", UNIT)
        sheet.add([(x, y + 3) for x, y in UNIT], "0", block)  # beyond the clip
        where = sheet.document.blocks.new("OUTER") if depth == 2 else None
        clipped = sheet.insert("CAP", (0, 1), where=where)
        if depth == 2:
            sheet.insert("OUTER", (0, 0))
        clip = XClip(clipped)
        clip.set_block_clipping_path([(-0.1, -0.1), (1.1, 0.6)])
        with pytest.raises(
            GeometryError, match=r"block (CAP|OUTER).* is clipped .XCLIP"
        ):
            sheet.read()
        sheet.add(UNIT, "OTHER")
        clipped.dxf.layer = "OTHER"
        if depth == 1:  # on another layer only counted
            assert (
                "1 block (INSERT of CAP) on layer OTHER"
                in sheet.read(layer="STONE").caution
            )
        clip.disable_clipping()
        clipped.dxf.layer = "STONE"
        assert len(sheet.read(layer="STONE").outlines) == 4  # all of it is seen

    @pytest.mark.parametrize(
        ("size", "after"), [(3.0, True), (3.0, False), (0.4, True)]
    )
    def test_by_a_later_wipeout_is_refused(self, tmp_path, size, after):
        sheet = pier(tmp_path)
        sheet.space.add_wipeout(
            [(-0.1, -0.1), (size, 0.55)], dxfattribs={"layer": "TEXT"}
        )
        if not after:
            wipeout = sheet.space[-1].dxf.handle
            lines = [
                entity.dxf.handle
                for entity in sheet.space
                if entity.dxf.handle != wipeout
            ]
            sheet.space.set_redraw_order(
                [(wipeout, "1"), *((line, "9") for line in lines)]
            )
        if size > 1.0 and after:
            with pytest.raises(
                GeometryError, match=r"LWPOLYLINE 3. is hidden by WIPEOUT"
            ):
                sheet.read(layer="STONE")
        else:
            assert sheet.read(layer="STONE").caution == ""

    def test_in_a_viewport_of_a_layout_is_asked_about(self, tmp_path):
        sheet = pier(tmp_path)
        sheet.document.layouts.get("Layout1").add_viewport(
            (1, 1), (1, 1), (0, 0), 2
        ).frozen_layers = ["stone"]
        assert (
            "layer STONE is frozen in a viewport of a layout, and read"
            in sheet.read().caution
        )


@pytest.mark.parametrize("code", [41, 42, 43])
def test_a_scale_of_zero_is_refused(tmp_path, code):
    sheet = pier(tmp_path)
    sheet.block("CAP", UNIT)
    sheet.insert("CAP", (0, 1), xscale=7.5, yscale=7.5, zscale=7.5)
    sheet.read()
    sheet.path.write_text(
        re.sub(rf"{code}\n7\.5", f"{code}\n0.0", sheet.path.read_text())
    )
    with pytest.raises(
        GeometryError, match=r"block CAP. has [xyz]scale = 0, which leaves no area"
    ):
        read_drawing(sheet.path)


def test_another_unit_than_the_header_states_is_said(tmp_path):
    draw(tmp_path / "a.dxf", PIER, unit=4)
    caution = read_drawing(tmp_path / "a.dxf", unit="m").caution
    assert caution == "a.dxf: its header states mm, m was given and counts"
    draw(tmp_path / "a.dxf", PIER, unit=0)
    assert read_drawing(tmp_path / "a.dxf", unit="m").caution == ""


@pytest.mark.parametrize("tolerance", [-1.0, 0.0, float("nan")])
def test_a_tolerance_that_is_no_length_is_refused(tmp_path, tolerance):
    draw(tmp_path / "a.dxf", PIER)
    entry = ArchEntry(id="a", drawing=str(tmp_path / "a.dxf"), friction=0.9)
    entry = entry.model_copy(update={"tolerance": tolerance})
    for make in (
        entry.read,
        lambda: af.Arch.from_polygons(PIER, 0.9, tolerance=tolerance),
    ):
        with pytest.raises(
            GeometryError, match=f"tolerance = {tolerance} is impossible"
        ):
            make()
