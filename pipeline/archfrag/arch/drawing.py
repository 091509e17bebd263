"""DXF drawings, read and written: the only module that imports ezdxf."""

import codecs
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import cross
from archfrag.arch.polygons import Blocks, without_repeated
from archfrag.errors import GeometryError, from_extra
from archfrag.files import make_folder, read_bytes, replacing

# Units that a drawing may be in: length [m] and code of $INSUNITS.
UNITS = {
    "m": (1.0, 6), "dm": (0.1, 14), "cm": (0.01, 5), "mm": (0.001, 4), "in": (0.0254, 1),
    "ft": (0.3048, 2),
}  # fmt: skip
SMALLEST, LARGEST = 0.05, 300.0  # drawing of an arch [m]; beyond them the unit was mistaken
LARGEST_FILE, MOST_CORNERS = 20_000_000, 20_000  # [bytes], of all blocks together
# Entities that are no blocks; any other might be one.
_IGNORED = {
    "TEXT", "MTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "ARC_DIMENSION", "LEADER", "MLEADER",
    "MULTILEADER", "POINT", "HATCH", "IMAGE", "WIPEOUT", "XLINE", "RAY", "VIEWPORT",
}  # fmt: skip


def read_drawing(path: str | Path, layer: str | None = None, unit: str | None = None) -> Blocks:
    """Read the blocks of a DXF drawing, text or binary; `layer` and `unit` as in `Arch.from_dxf`.

    `GeometryError` names file, layer and handle of an entity that is no block.
    """
    document = _document(Path(path))
    entities = [entity for entity in document.modelspace() if not entity.dxf.invisible]
    kinds = ("LWPOLYLINE", "POLYLINE")
    layers = Counter(e.dxf.layer for e in entities if e.dxftype() in kinds)
    if layer is None and len(layers) == 1:
        layer = next(iter(layers))
    if layer is None or layer.casefold() not in map(str.casefold, layers):
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(layers.items())) or "none"
        raise GeometryError(
            f"{path}: layer = {layer} must be the layer that has the blocks; layers with "
            f"polylines: {listed}"
        )
    scale, _ = _unit(unit, document.header.get("$INSUNITS", 0), path)
    found = Blocks([], [], [], [])
    for entity in entities:
        kind = entity.dxftype()
        if entity.dxf.layer.casefold() != layer.casefold() or kind in _IGNORED:
            continue
        name = f"{path}, layer {layer}: {kind} {entity.dxf.handle}"
        if kind == "LINE":
            ends = [entity.dxf.start, entity.dxf.end]
            found.ground.append(scale * np.array([[end.x, end.y] for end in ends]))
            found.ground_names.append(name)
        else:
            found.outlines.append(_outline(entity, name) * [scale, scale, 1.0])
            found.names.append(name)
    every = np.concatenate(found.outlines)[:, :2]
    size = float(np.ptp(every, axis=0).max())
    if len(every) > MOST_CORNERS or not SMALLEST <= size <= LARGEST:
        raise GeometryError(
            f"{path}, layer {layer}: the blocks have {len(every)} corners and take {size:.4g} m; "
            f"an arch has at most {MOST_CORNERS} and takes {SMALLEST:g} to {LARGEST:g} m: give "
            f"the drawing's unit, one of {', '.join(UNITS)}"
        )
    return found


def _document(path: Path) -> Any:
    """The file as ezdxf reads it."""
    ezdxf = from_extra("ezdxf", "drawing")
    content = read_bytes(path, LARGEST_FILE, GeometryError, "the drawing")
    try:
        if content.startswith(codecs.BOM_UTF8):
            return ezdxf.read(io.StringIO(content.decode("utf-8-sig", "surrogateescape")))
        return ezdxf.readfile(path)
    except Exception as error:  # ezdxf raises of all kinds for damaged files
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise GeometryError(
            f"{path}: is not a DXF file, or a damaged one ({reason}); save it again as DXF from "
            "the drawing program"
        ) from None


def _unit(name: str | None, code: int, path: str | Path) -> tuple[float, int]:
    """Row of `UNITS` by its name, or by a drawing's code if there is none."""
    codes = {row[1]: unit for unit, row in UNITS.items()}
    given = codes.get(code) if name is None else name
    if given not in UNITS:
        raise GeometryError(
            f"{path}: unit = {name} ($INSUNITS = {code}) must be one of {', '.join(UNITS)}"
        )
    return UNITS[given]


def _outline(entity: Any, name: str) -> FloatArray:
    """Corners (m, 3) of a closed polyline, in the unit of the drawing."""
    kind, rows = entity.dxftype(), []
    if kind == "LWPOLYLINE":
        rows = entity.get_points("xyb")
    elif kind == "POLYLINE" and entity.is_2d_polyline and not entity.dxf.flags & 0b110:
        rows = [vertex.format("xyb") for vertex in entity.vertices]  # of no fitted curve
    points = np.array(rows, dtype=float).reshape(-1, 3)
    axis = entity.dxf.extrusion
    if len(points) < 2 or not np.isfinite(points).all() or abs(abs(axis.z) - 1.0) > 1e-9:
        raise GeometryError(
            f"{name} is no 2D polyline in the plane x, y; blocks must be closed polylines with "
            "straight sides or arcs (LWPOLYLINE, POLYLINE), and lines on their layer (LINE) the "
            "edges on the ground"
        )
    if axis.z < 0.0:  # seen from behind
        points *= [-1.0, 1.0, -1.0]
    least = 1e-9 * float(np.ptp(points[:, :2], axis=0).max())
    if not entity.is_closed and np.hypot(*(points[-1] - points[0])[:2]) > least:
        raise GeometryError(f"{name} is open; a block must be a closed polyline")
    return without_repeated(points, least)


def write_dxf(
    path: str | Path, outlines: Sequence[FloatArray], ground: Sequence[FloatArray], unit: str,
    layer: str, arcs: bool,
) -> None:  # fmt: skip
    """Write blocks as closed polylines and what they stand on as lines; see `Arch.to_dxf`.

    Outlines ``(m, 3)`` are corners x, y [m] and bulge; ``(m, 2)`` are points of straight-sided
    blocks, or with `arcs` of annular sectors, whose arcs are then drawn as arcs.
    """
    ezdxf = from_extra("ezdxf", "drawing")
    scale, code = _unit(unit, 0, path)
    # The same arch makes the same bytes, without times and random identifiers.
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2010", units=code)
        document.layers.add(layer)
        space, attributes = document.modelspace(), {"layer": layer}
        for outline in outlines:
            full = np.column_stack([outline, np.zeros(len(outline))])[:, :3]
            points = ((_with_arcs(outline) if arcs else full) / [scale, scale, 1.0]).tolist()
            space.add_lwpolyline(points, format="xyb", close=True, dxfattribs=attributes)
        for line in ground:
            space.add_line(*(line / scale).tolist(), dxfattribs=attributes)
        # In an order of their own: ezdxf registers them from a set.
        document.classes.add_required_classes(document.dxfversion)
        document.classes.classes = dict(sorted(document.classes.classes.items()))
        text = io.StringIO()
        document.write(text)
    except ezdxf.DXFError as error:
        raise GeometryError(f"layer = {layer!r} cannot be used ({error})") from None
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    make_folder(Path(path).parent)
    with replacing(Path(path)) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _with_arcs(points: FloatArray) -> FloatArray:
    """Outline ``(4, 3)`` of an annular sector, from points on its intrados, then its extrados."""
    half = len(points) // 2
    corners = points[[0, half - 1, half, -1]]
    sides = corners[[3, 2]] - corners[[0, 1]]
    angle = np.arctan2(cross(sides[0], sides[1]), (sides[0] * sides[1]).sum())
    bulge = np.tan(-0.25 * (-angle % (2.0 * np.pi)))  # clockwise over the crown
    return np.column_stack([corners, [bulge, 0.0, -bulge, 0.0]])
