"""Arches from DXF drawings, and drawings of arches: the only place that imports ezdxf."""

import codecs
import io
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from archfrag.errors import GeometryError
from archfrag.files import make_folder, read_bytes, replacing

if TYPE_CHECKING:
    from archfrag.arch.model import Arch

FloatArray = NDArray[np.float64]
# Units that a drawing may be in: length [m] and code of $INSUNITS.
UNITS = {
    "m": (1.0, 6), "dm": (0.1, 14), "cm": (0.01, 5), "mm": (0.001, 4), "in": (0.0254, 1),
    "ft": (0.3048, 2),
}  # fmt: skip
LAYER = "VOUSSOIRS"
SMALLEST, LARGEST = 0.05, 300.0  # drawing of an arch [m]; beyond them the unit was mistaken
LARGEST_FILE, MOST_CORNERS = 20_000_000, 20_000  # [bytes], of all blocks together
# What may stand beside blocks and is none; anything else might be a block.
_IGNORED = {
    "TEXT", "MTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "ARC_DIMENSION", "LEADER", "MLEADER",
    "MULTILEADER", "POINT", "HATCH", "IMAGE", "WIPEOUT", "XLINE", "RAY", "VIEWPORT",
}  # fmt: skip


@dataclass(frozen=True)
class Drawing:
    """Blocks and the lines on which they stand [m], with their names for messages."""

    outlines: list[FloatArray]  # (m, 3) each: corners x, y and bulge
    ground: list[FloatArray]  # (2, 2) each; none where ends stand opposite to their joints
    names: list[str]  # of the blocks
    ground_names: list[str]


def read_drawing(path: str | Path, layer: str | None = None, unit: str | None = None) -> Drawing:
    """Blocks of a DXF drawing, text or binary; `layer` and `unit` as of `Arch.from_dxf`.

    Raises
    ------
    GeometryError
        Naming file, layer and handle of what is no block.

    Examples
    --------
    >>> import archfrag as af, tempfile, pathlib
    >>> from archfrag.arch.drawing import read_drawing
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "block.dxf"
    >>> af.Block(width=0.2, height=1.0, friction=0.8).to_dxf(file)
    >>> read_drawing(file).outlines[0].shape
    (4, 3)
    """
    document = _document(Path(path))
    entities = [entity for entity in document.modelspace() if not entity.dxf.invisible]
    layer = _layer_of(entities, layer, path)
    scale = _scale(document, unit, path)
    found, corners = Drawing([], [], [], []), 0
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
    import ezdxf

    content = read_bytes(path, LARGEST_FILE, GeometryError, "the drawing")
    try:
        if content.startswith(codecs.BOM_UTF8):
            return ezdxf.read(io.StringIO(content.decode("utf-8-sig", "surrogateescape")))
        return ezdxf.readfile(path)
    except OSError:
        raise GeometryError(f"{path}: is not a DXF file") from None
    except Exception as error:  # whatever a damaged file leads ezdxf to
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


def _scale(document: Any, unit: str | None, path: str | Path) -> float:
    """Length of a drawing's unit [m]."""
    if unit is not None:
        if unit not in UNITS:
            raise GeometryError(f"unit = {unit!r} must be one of {', '.join(UNITS)}")
        return UNITS[unit][0]
    code = document.header.get("$INSUNITS", 0)
    for length, number in UNITS.values():
        if number == code:
            return length
    raise GeometryError(
        f"{path}: does not state its unit ($INSUNITS = {code}); it must be given as one of "
        f"{', '.join(UNITS)}"
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


def write_dxf(arch: "Arch", path: str | Path, unit: str = "m", layer: str = LAYER) -> None:
    """Draw an arch: `Arch.to_dxf` has the particulars."""
    import ezdxf

    if unit not in UNITS:
        raise GeometryError(f"unit = {unit!r} must be one of {', '.join(UNITS)}")
    scale, code = UNITS[unit]
    # The same arch makes the same bytes, without times and random identifiers.
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        document = ezdxf.new("R2010", units=code)
        document.layers.add(layer)
        space, attributes = document.modelspace(), {"layer": layer}
        outlines = arch_outlines(arch)
        for outline in outlines:
            points = (outline / [scale, scale, 1.0]).tolist()
            space.add_lwpolyline(points, format="xyb", close=True, dxfattribs=attributes)
        for line in ground_lines(arch, outlines):
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


def arch_outlines(arch: "Arch") -> list[FloatArray]:
    """Outlines of the voussoirs of any arch, (m, 3) each, arcs as arcs."""
    given = arch.parameters
    if "outlines" in given:
        return [np.array(outline) for outline in given["outlines"]]
    if not given.get("sector"):
        return [np.column_stack([points, np.zeros(len(points))]) for points in arch.outlines]
    outlines = []
    for points in arch.outlines:
        # Intrados, then extrados backwards, as many points of each.
        half = len(points) // 2
        corners = points[[0, half - 1, half, -1]]
        sides = corners[[3, 2]] - corners[[0, 1]]
        angle = np.arctan2(
            sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0], (sides[0] * sides[1]).sum()
        )
        bulge = np.tan(-0.25 * (-angle % (2.0 * np.pi)))  # clockwise over the crown
        outlines.append(np.column_stack([corners, [bulge, 0.0, -bulge, 0.0]]))
    return outlines


def ground_lines(arch: "Arch", outlines: list[FloatArray]) -> list[FloatArray]:
    """Lines (2, 2) on which an arch stands, from its outlines: a recess is not drawn."""
    given = arch.parameters
    if "ground" in given:
        return [np.array(line) for line in given["ground"]]
    first, last = outlines[0][:, :2], outlines[-1][:, :2]
    lines = [np.array([first[0], first[-1]])]
    if not arch.free_end:
        half = len(last) // 2
        lines.append(np.array([last[half - 1], last[half]]))
    return lines
