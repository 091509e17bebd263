"""DXF drawings of arches: the only module that imports ezdxf."""

import io
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from archfrag.arch.checks import FloatArray
from archfrag.arch.geometry import sampled
from archfrag.arch.polygons import Blocks, without_repeated
from archfrag.errors import GeometryError
from archfrag.files import read_bytes

# Units that a drawing may be in [m], and their codes in $INSUNITS.
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
_CODES = {6: "m", 14: "dm", 5: "cm", 4: "mm", 1: "in", 2: "ft"}
SMALLEST = 0.05  # size of an arch [m]; outside these two the unit is probably wrong
LARGEST = 300.0
LARGEST_FILE = 20_000_000  # [bytes], of all blocks together
MOST_CORNERS = 20_000
MOST_ENTITIES = 50_000  # of exploded references to blocks, which may be nested
DEEPEST = 16  # nesting of blocks
MOST_COVERED = 0.5  # part of a block's area that a WIPEOUT may hide
_MOST_LISTED = 8  # kinds of entities that a message names
_POLYLINES = ("LWPOLYLINE", "POLYLINE")
# Entities that say something about the drawing; any other might be a block.
_ANNOTATIONS = {
    "TEXT",
    "MTEXT",
    "ATTDEF",
    "ATTRIB",
    "DIMENSION",
    "ARC_DIMENSION",
    "LEADER",
    "MLEADER",
    "MULTILEADER",
    "POINT",
    "IMAGE",
    "XLINE",
    "RAY",
    "VIEWPORT",
}
_COUNTED = (
    "HATCH",
    "WIPEOUT",
    "ARCALIGNEDTEXT",
    "RTEXT",
)  # never a block; the last two are text
_WHAT_TO_DRAW = (
    "draw one closed polyline for each voussoir, all on one layer (in AutoCAD: BOUNDARY and a "
    "click into each voussoir, or PLINE with its option Close)"
)


class _Part(NamedTuple):
    """Visible entity of model space, drawn there or inserted with a block."""

    entity: Any
    layer: str  # layer on which it is seen
    name: str  # for messages: kind, handle, and the INSERT that it comes from
    reference: Any = None  # the outermost INSERT that it comes from
    fault: str = ""  # why its INSERT cannot be read; empty if it can

    @property
    def kind(self) -> str:
        return self.entity.dxftype()


def read_drawing(
    path: str | Path, layer: str | Sequence[str] | None = None, unit: str | None = None
) -> Blocks:
    """Read the blocks of a DXF drawing, text or binary; `layer` and `unit` as in `Arch.from_dxf`.

    References to blocks (INSERT) are exploded. Entities that are frozen, off or invisible are not
    read. Visible entities that are no part of the arch are counted in `Blocks.caution`, except
    text and dimensions. `GeometryError` names file, layer and handle of an entity that is no
    block.
    """
    document = _document(Path(path))
    parts, hidden = _seen(document, str(path))
    layers = _chosen(layer, parts, hidden, str(path))
    code = document.header.get("$INSUNITS", 0)
    stated = _CODES.get(code)
    unit = unit or stated
    if unit not in UNITS:
        raise GeometryError(
            f"{path}: unit = {unit} ($INSUNITS = {code}) must be one of {', '.join(UNITS)}"
        )
    scale = UNITS[unit]
    left = list[_Part]()
    found = Blocks([], [], [], [], ", ".join(layers.values()), unit)
    places = list[int]()
    for place, part in enumerate(parts):
        name = f"{path}, layer {part.layer}: {part.name}"
        if part.layer.casefold() not in layers or part.kind in _COUNTED:
            left.append(part)
        elif part.fault:
            raise GeometryError(f"{name} {part.fault}")
        elif part.kind == "LINE":
            ends = [part.entity.dxf.start, part.entity.dxf.end]
            found.ground.append(scale * np.array([[end.x, end.y] for end in ends]))
            found.ground_names.append(name)
        else:
            found.outlines.append(_outline(part.entity, name) * [scale, scale, 1.0])
            found.names.append(name)
            places.append(place)
    every = np.concatenate(found.outlines)[:, :2]
    size = np.ptp(every, axis=0).max()
    if len(every) > MOST_CORNERS or not SMALLEST <= size <= LARGEST:
        raise GeometryError(
            f"{path}, layer {found.layer}: the blocks have {len(every)} corners and take "
            f"{size:.4g} m; an arch has at most {MOST_CORNERS} and takes {SMALLEST:g} to "
            f"{LARGEST:g} m: give the drawing's unit, one of {', '.join(UNITS)}"
        )
    whole = [
        shapely.Polygon(sampled(outline)[:, :2] / scale) for outline in found.outlines
    ]
    _refuse_covered(document, parts, dict(zip(places, whole)), str(path))
    left = [
        part
        for part in left
        if part.kind != "WIPEOUT"
        and (part.kind != "HATCH" or not _fills(part.entity, whole))
    ]
    cautions = list[str]()
    viewports = document.query("VIEWPORT")
    unseen = {name.casefold() for each in viewports for name in each.frozen_layers}
    frozen = [layers[name] for name in sorted(unseen & layers.keys())]
    if left:
        used = {id(part.reference) for part in parts if part.layer.casefold() in layers}
        cautions.append(
            f"{_counted(left, used)} {'are' if len(left) > 1 else 'is'} not part of the arch; if "
            "some of it is, name its layer too"
        )
    if frozen:
        cautions.append(
            f"layer {', '.join(frozen)} is frozen in a viewport of a layout, and read; is it seen?"
        )
    if stated not in (None, unit):
        cautions.append(f"its header states {stated}, {unit} was given and counts")
    found.caution = f"{Path(path).name}: {'; '.join(cautions)}" if cautions else ""
    return found


def _refuse_covered(
    document, parts: list[_Part], blocks: dict[int, Any], path: str
) -> None:
    """Raise `GeometryError` if a WIPEOUT that is drawn later hides a block.

    `blocks` holds the polygon of each block by its index in `parts`.
    """
    covers = [place for place, part in enumerate(parts) if part.kind == "WIPEOUT"]
    drawn = document.modelspace().entities_in_redraw_order() if covers else ()
    order = {entity.dxf.handle: place for place, entity in enumerate(drawn)}

    def rank(place: int) -> tuple[int, int]:
        part = parts[place]
        top = part.entity if part.reference is None else part.reference
        return order.get(top.dxf.handle, 0), place

    for cover in covers:
        corners = parts[cover].entity.boundary_path_wcs()
        area = shapely.Polygon([(corner.x, corner.y) for corner in corners]).buffer(0.0)
        for place, shape in blocks.items():
            common = shapely.intersection(shape.buffer(0.0), area).area
            if rank(cover) > rank(place) and common > MOST_COVERED * shape.area:
                raise GeometryError(
                    f"{path}: {parts[place].name} is hidden by {parts[cover].name}; "
                    "delete one of them, or draw it on another layer"
                )


def drawing_text(lines: Iterable[tuple[str, FloatArray]]) -> str:
    """Return lines as the text of a DXF drawing in metres.

    Each line is a layer and points ``(n, 2)``: two points become a LINE, more a closed polyline.
    """
    ezdxf = _library()
    stream = io.StringIO()
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True  # no date
    try:
        document = ezdxf.new("R2010", units=ezdxf.units.M)
        space = document.modelspace()
        for layer, points in lines:
            form = {"layer": layer}
            corners = points.tolist()
            if len(corners) == 2:
                space.add_line(*corners, dxfattribs=form)
            else:
                space.add_lwpolyline(corners, close=True, dxfattribs=form)
        document.write(stream)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    return stream.getvalue()


def _library():
    import ezdxf.xclip  # start-up: it looks for fonts and a cache of its own

    return ezdxf


def _document(path: Path):
    """Read a drawing by ezdxf; `GeometryError` if it is no sound DXF file."""
    ezdxf = _library()
    read_bytes(
        path, LARGEST_FILE, GeometryError, "the drawing"
    )  # small enough, no device
    try:
        return ezdxf.readfile(path)
    except Exception as error:  # ezdxf raises of all kinds for damaged files
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise GeometryError(
            f"{path}: is not a DXF file, or a damaged one ({reason}); save it again as DXF from "
            "the drawing program"
        ) from None


def _layer(entity) -> str:
    return str(entity.graphic_properties().get("layer", "0"))


def _fault(reference) -> str:
    """Return why an INSERT cannot be read; empty if it can.

    It cannot if it is clipped (XCLIP) or has a scale of 0.
    """
    original = (
        reference if reference.dxf.handle else reference.source_of_copy or reference
    )
    if _library().xclip.XClip(original).is_clipping_enabled:
        return (
            "is clipped (XCLIP), so that not all of it is seen; draw what is "
            "seen, without a clip"
        )
    for name in ("xscale", "yscale", "zscale"):
        if reference.dxf.get(name, 1.0) == 0.0:
            return f"has {name} = 0, which leaves no area; give it another scale"
    return ""


def _seen(document, path: str) -> tuple[list[_Part], Counter[str]]:
    """Return the visible entities of model space, and the layers that hide some.

    Annotations are left out and INSERTs exploded. For each layer that is frozen or off, the
    counter has the number of its polylines and INSERTs.
    """
    layers = {layer.dxf.name.casefold(): layer for layer in document.layers}
    frozen = {name for name, layer in layers.items() if layer.is_frozen()}
    off = {name for name, layer in layers.items() if layer.is_off()}
    parts = list[_Part]()
    hidden = Counter[str]()
    inside = 0

    def look(entity, layer: str, reference, depth: int, fault: str = "") -> None:
        nonlocal inside
        kind = entity.dxftype()
        name = layer.casefold()
        stored = entity.graphic_properties() if hasattr(entity, "xtags") else entity.dxf
        if stored.get("invisible") or kind in _ANNOTATIONS:
            return
        # The layer of a reference hides what is in its block only if it is frozen.
        if name in frozen or (name in off and kind != "INSERT"):
            hidden[layer] += kind in (*_POLYLINES, "INSERT")
            return
        block = entity.block() if kind == "INSERT" else None
        if block is None or block.block.is_xref:
            source = entity if entity.dxf.handle else entity.source_of_copy or entity
            told = f"{kind} {source.dxf.handle or ''}".rstrip()
            if reference is not None:
                told += (
                    f" of INSERT {reference.dxf.handle} (block {reference.dxf.name})"
                )
            parts.append(_Part(entity, layer, told, reference, fault))
            return
        inside += entity.mcount * len(block)
        if inside > MOST_ENTITIES or depth > DEEPEST:
            raise GeometryError(
                f"{path}: its blocks (INSERT) hold more than {MOST_ENTITIES} "
                f"entities, or blocks more than {DEEPEST} deep; save a drawing that "
                "has only the arch"
            )
        outer = entity if reference is None else reference
        fault = fault or _fault(entity)
        for each in block if fault else _exploded(entity):
            own = _layer(each)  # what is on layer 0 is seen on that of the reference
            look(each, layer if own == "0" else own, outer, depth + 1, fault)

    for entity in document.modelspace():
        look(entity, _layer(entity), None, 0)
    return parts, hidden


def _exploded(reference) -> Iterator[Any]:
    """Yield the entities of an INSERT where it puts them, for all its rows and columns.

    Entities that ezdxf cannot move follow, as they are in the block.
    """
    skipped: list[Any] = []
    keep = {"skipped_entity_callback": lambda entity, reason: skipped.append(entity)}
    for each in reference.multi_insert() if reference.mcount > 1 else [reference]:
        yield from each.virtual_entities(**keep)
    yield from skipped  # which cannot be moved, and are refused if they are on a layer of the arch


def _chosen(
    given: str | Sequence[str] | None,
    parts: list[_Part],
    hidden: Counter[str],
    path: str,
) -> dict[str, str]:
    """Return the layers of the blocks: name in small letters to name in the drawing.

    Without `given` layers, it is the only layer that has polylines. `GeometryError` if several
    have, if none is on the layers, or if a given layer shows nothing.
    """
    shown = {part.layer.casefold(): part.layer for part in parts}
    closed = Counter(part.layer for part in parts if part.kind in _POLYLINES)
    names = [given] if isinstance(given, str) else list(given or ())
    names = names or list(closed) * (len(closed) == 1)
    listed = ", ".join(f"{name} ({count})" for name, count in sorted(closed.items()))
    hiding = ", ".join(sorted(+hidden))
    others = f"; layers with polylines: {listed or 'none'}"
    if hiding:
        others += f"; frozen or off (thaw and turn on what you need): {hiding}"
    lost = next((name for name in names if name.casefold() not in shown), None)
    if lost is not None:
        raise GeometryError(f"{path}: layer {lost} has nothing that is seen{others}")
    layers = {name.casefold(): shown[name.casefold()] for name in names}
    if not names and closed:
        raise GeometryError(
            f"{path}: several layers have polylines: {listed}; give the layer of the "
            "blocks, or the layers: [A, B]"
        )
    if not set(closed) & set(layers.values()):
        there = [
            part for part in parts if not layers or part.layer.casefold() in layers
        ]
        texts = _counted(there, {id(part.reference) for part in there}) or "nothing"
        raise GeometryError(
            f"{path}: no polyline is seen, but {texts}; {_WHAT_TO_DRAW}{others}"
        )
    return layers


def _counted(parts: list[_Part], used: set[int]) -> str:
    """Return a text that counts entities by kind and layer.

    `used` has the ids of INSERTs with entities on layers of the arch; any other INSERT counts as
    one block.
    """
    whole = {id(p.reference): p.reference for p in parts if id(p.reference) not in used}
    kinds = Counter(
        (p.kind, p.layer) for p in parts if not p.reference or id(p.reference) in used
    )
    blocks = Counter((r.dxf.name, r.dxf.layer) for r in whole.values() if r is not None)
    texts = [
        f"{n} block{'s' * (n > 1)} (INSERT of {name}) on layer {layer}"
        for (name, layer), n in sorted(blocks.items())
    ]
    texts += [
        f"{n} {kind} on layer {layer}" for (kind, layer), n in sorted(kinds.items())
    ]
    more = len(texts) - _MOST_LISTED
    return ", ".join(texts[:_MOST_LISTED]) + f" and {more} more kinds" * (more > 0)


def _fills(hatch, blocks: list[Any]) -> bool:
    """Return whether a hatch fills blocks: the middle of each of its boundaries is in one."""
    try:
        paths = list(_library().path.from_hatch(hatch))
    except Exception:  # ezdxf raises of all kinds for damaged boundaries
        return False
    middles = [
        np.mean([(p.x, p.y) for p in path.control_vertices()], axis=0) for path in paths
    ]
    points = shapely.points(np.reshape(middles, (-1, 2)))
    return all(shapely.covers(blocks, point).any() for point in points)


def _outline(entity, name: str) -> FloatArray:
    """Return the corners (m, 3) of a closed polyline, in the unit of the drawing."""
    kind = entity.dxftype()
    rows = []
    if kind == "LWPOLYLINE":
        rows = entity.get_points("xyb")
    elif kind == "POLYLINE" and entity.is_2d_polyline and not entity.dxf.flags & 0b110:
        rows = [
            vertex.format("xyb") for vertex in entity.vertices
        ]  # of no fitted curve
    points = np.array(rows, dtype=float).reshape(-1, 3)
    flat = len(points) > 1 and abs(abs(entity.dxf.extrusion.z) - 1.0) <= 1e-9
    if not flat or not np.isfinite(points).all():
        raise GeometryError(
            f"{name} is no 2D polyline in the plane x, y; blocks must be closed polylines with "
            "straight sides or arcs (LWPOLYLINE, POLYLINE), and lines on their layer (LINE) the "
            "edges on the ground"
        )
    if entity.dxf.extrusion.z < 0.0:  # seen from behind
        points *= [-1.0, 1.0, -1.0]
    least = 1e-9 * np.ptp(points[:, :2], axis=0).max()
    if not entity.is_closed and np.hypot(*(points[-1] - points[0])[:2]) > least:
        raise GeometryError(f"{name} is open; a block must be a closed polyline")
    return without_repeated(points, least)
