"""DXF drawings, read and written: the only module that imports ezdxf."""

import codecs
import io
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.arch.checks import FloatArray
from archfrag.arch.polygons import Blocks
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
    layer = _layer_of(entities, layer, path)
    scale, _ = _unit(unit, document.header.get("$INSUNITS", 0), path)
    found, corners = Blocks([], [], [], []), 0
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
            found.outlines.append(_outline(entity, name, scale))
            found.names.append(name)
            corners += len(found.outlines[-1])
            if corners > MOST_CORNERS:
                raise GeometryError(f"{name}: the blocks have more than {MOST_CORNERS} corners")
    every = np.concatenate([outline[:, :2] for outline in found.outlines])
    size = float(np.ptp(every, axis=0).max())
    if not SMALLEST <= size <= LARGEST:
        raise GeometryError(
            f"{path}, layer {layer}: the blocks take {size:.4g} m, no size of an arch, which must "
            f"be from {SMALLEST:g} to {LARGEST:g} m: give the drawing's unit, one of "
            f"{', '.join(UNITS)}"
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
    except OSError:
        raise GeometryError(f"{path}: is not a DXF file") from None
    except Exception as error:  # ezdxf raises of all kinds for damaged files
        reason = str(error).splitlines()[:1] or [type(error).__name__]
        raise GeometryError(
            f"{path}: is damaged or cut off ({reason[0]}); save it again as DXF from the drawing "
            "program"
        ) from None


def _layer_of(entities: list[Any], layer: str | None, path: str | Path) -> str:
    """The layer that is asked for, or the only one with polylines."""
    kinds = ("LWPOLYLINE", "POLYLINE")
    layers = Counter(e.dxf.layer for e in entities if e.dxftype() in kinds)
    if not layers:
        raise GeometryError(
            f"{path}: its model space has no polylines (blocks and paper space are not read)"
        )
    listed = ", ".join(f"{name} ({count})" for name, count in sorted(layers.items()))
    if layer is None:
        if len(layers) == 1:
            return str(next(iter(layers)))
        raise GeometryError(
            f"{path}: give the layer that has the blocks; layers with polylines: {listed}"
        )
    if layer.casefold() not in map(str.casefold, layers):
        raise GeometryError(
            f"{path}, layer {layer}: has no polyline; layers with polylines: {listed}"
        )
    return layer


def _unit(name: str | None, code: int, path: str | Path) -> tuple[float, int]:
    """Row of `UNITS` by its name, or by a drawing's code if there is none."""
    listed = ", ".join(UNITS)
    if name is not None:
        if name not in UNITS:
            raise GeometryError(f"unit = {name!r} must be one of {listed}")
        return UNITS[name]
    for row in UNITS.values():
        if row[1] == code:
            return row
    raise GeometryError(
        f"{path}: does not state its unit ($INSUNITS = {code}); give it as one of {listed}"
    )


def _outline(entity: Any, name: str, scale: float) -> FloatArray:
    """Corners (m, 3) of a closed polyline [m]."""
    kind = entity.dxftype()
    if kind == "LWPOLYLINE":
        points = np.array(list(entity.get_points("xyb")), dtype=float).reshape(-1, 3)
    elif kind == "POLYLINE" and entity.is_2d_polyline:
        vertices = [vertex.dxf for vertex in entity.vertices]
        points = np.array([(*v.location.vec2, v.get("bulge", 0.0)) for v in vertices])
        points = points.reshape(-1, 3)
    else:
        raise GeometryError(
            f"{name} is no 2D polyline; blocks must be closed polylines (LWPOLYLINE, "
            "POLYLINE) and lines on their layer (LINE) the edges on the ground"
        )
    if kind == "POLYLINE" and entity.dxf.flags & 0b110:
        raise GeometryError(f"{name} is a fitted curve; its sides must be straight or arcs")
    if not np.isfinite(points).all():
        raise GeometryError(f"{name} has a coordinate that is not a finite number")
    axis = entity.dxf.extrusion
    if not abs(abs(axis.z) - 1.0) < 1e-9:
        raise GeometryError(f"{name} does not lie in the plane x, y (its extrusion is {axis})")
    if axis.z < 0.0:  # seen from behind
        points *= [-1.0, 1.0, -1.0]
    size = float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0
    repeated = len(points) > 1 and np.hypot(*(points[-1] - points[0])[:2]) <= 1e-9 * size
    if not entity.is_closed and not repeated:
        raise GeometryError(f"{name} is open; a block must be a closed polyline")
    points = points[:-1] if repeated else points
    apart = np.hypot(*(np.roll(points[:, :2], -1, axis=0) - points[:, :2]).T) > 1e-9 * size
    points = points[apart]
    if len(points) < 3:
        raise GeometryError(f"{name} has {len(points)} corners; a block must have at least 3")
    return points * [scale, scale, 1.0]


def write_dxf(
    path: str | Path,
    outlines: Sequence[FloatArray],
    ground: Sequence[FloatArray],
    unit: str,
    layer: str,
    arcs: bool,
) -> None:
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
            full = np.zeros((len(outline), 3))
            full[:, : outline.shape[1]] = outline
            points = ((_with_arcs(outline) if arcs else full) / [scale, scale, 1.0]).tolist()
            space.add_lwpolyline(points, format="xyb", close=True, dxfattribs=attributes)
        for line in ground:
            start, end = (line / scale).tolist()
            space.add_line(start, end, dxfattribs=attributes)
        # In an order of their own: ezdxf registers them from a set.
        document.classes.add_required_classes(document.dxfversion)
        document.classes.classes = dict(sorted(document.classes.classes.items()))
        text = io.StringIO()
        document.write(text)
    except ezdxf.DXFError as error:
        raise GeometryError(f"layer = {layer!r} cannot be used ({error})") from None
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    place = Path(path)
    make_folder(place.parent)
    with replacing(place) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _with_arcs(points: FloatArray) -> FloatArray:
    """Outline ``(4, 3)`` of an annular sector, from points on its intrados, then its extrados."""
    half = len(points) // 2
    corners = points[[0, half - 1, half, -1]]
    sides = corners[[3, 2]] - corners[[0, 1]]
    angle = np.arctan2(
        sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0], (sides[0] * sides[1]).sum()
    )
    bulge = np.tan(-0.25 * (-angle % (2.0 * np.pi)))  # clockwise over the crown
    return np.column_stack([corners, [bulge, 0.0, -bulge, 0.0]])
