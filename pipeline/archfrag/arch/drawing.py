"""DXF drawings of arches: the only module that imports ezdxf."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.arch.checks import FloatArray
from archfrag.arch.polygons import Blocks, without_repeated
from archfrag.errors import GeometryError, from_extra
from archfrag.files import read_bytes

# Units that a drawing may be in [m], and their codes in $INSUNITS.
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
_CODES = {6: "m", 14: "dm", 5: "cm", 4: "mm", 1: "in", 2: "ft"}
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
    code = document.header.get("$INSUNITS", 0)
    name = _CODES.get(code) if unit is None else unit
    if name not in UNITS:
        raise GeometryError(
            f"{path}: unit = {unit} ($INSUNITS = {code}) must be one of {', '.join(UNITS)}"
        )
    scale = UNITS[name]
    found = Blocks([], [], [], [], layer, name)
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
    read_bytes(path, LARGEST_FILE, GeometryError, "the drawing")  # small enough, no device
    try:
        return ezdxf.readfile(path)
    except Exception as error:  # ezdxf raises of all kinds for damaged files
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise GeometryError(
            f"{path}: is not a DXF file, or a damaged one ({reason}); save it again as DXF from "
            "the drawing program"
        ) from None


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
