"""Arches for other programs: a scene with the scaled motions (scene.schema.json), and drawings."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from archfrag.arch import Arch
from archfrag.arch.checks import FloatArray
from archfrag.arch.drawing import drawing_text
from archfrag.arch.geometry import cross, polygon_section
from archfrag.arch.tie_rods import tie_lines
from archfrag.errors import InputError
from archfrag.files import make_folder
from archfrag.physics.status import Tie
from archfrag.study.file.members import Member
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import commit, finite, write_text
from archfrag.study.runs.store import make_plan
from archfrag.study.steps import require
from archfrag.version import __version__

SCHEMA = Path(__file__).with_name("scene.schema.json")
MOST_ARCHES = 500
_LISTS = re.compile(r"\[\n\s*[^][{}]*?\n\s*\]")  # of numbers, indented


def export_arches(
    study: StudyKeys, formats: Sequence[str], folder: Path | None = None, members: bool = False
) -> dict[str, Any]:
    """Write arches of a study, and with a scene its motions, in formats of `export.OF_ARCHES`.

    Of a class there is its first arch, with `members` all. Returned are ``files`` and ``notes`` as
    of `export_study`. Nothing is written after an InputError: too many arches, or no motions yet.
    """
    own = [each for each in study.members if not each.shock]  # whose joints are as given
    sizes = Counter(each.arch_class for each in own)
    found = {each.id if members else each.arch_class: each for each in reversed(own)}
    if len(found) > MOST_ARCHES:
        remedy = f"scene and dxf take at most {MOST_ARCHES}; leave out --members"
        raise InputError(f"study {study.id} has {len(found)} arches; {remedy}")
    messages = [f"scene and dxf have {found[name].id} of {size} arches of {name}; --members: all"
             for name, size in sizes.items() if size > 1 and not members]  # fmt: skip
    if study.motions.before is not None:
        messages.append("scene and dxf have the intact arches and the records, no first shocks")
    chosen, texts = list(reversed(found.values())), dict[str, str]()
    if "scene" in formats:
        text = json.dumps(_scene(study, chosen), indent=1, allow_nan=False)
        texts["scene.json"] = _LISTS.sub(lambda one: re.sub(r"\n\s*", " ", one[0]), text) + "\n"
    if "dxf" in formats:
        texts |= {f"{each.id}.dxf": drawing_text(_lines(each.entry.build())) for each in chosen}
    paths = [make_folder(folder or study.folder / "export") / f"{study.id}-{end}" for end in texts]
    for path, text in zip(paths, texts.values()):
        write_text(path, text)
    names = ["dxf" if path.suffix == ".dxf" else "scene" for path in paths]
    files = [{"format": name, "file": str(path)} for name, path in zip(names, paths)]
    return {"files": files, "notes": messages}


def _scene(study: StudyKeys, chosen: Sequence[Member]) -> Any:
    """Return arches, levels, and motions at factor 1 with their factors, for strict JSON."""
    require(study, "motions")
    plan, levels, motions = make_plan(study), study.intensity, []
    for number, record in enumerate(plan.records):
        motion, factors = plan.motion(number), plan.unscaled[number] * plan.levels**plan.power
        own = {"id": record.id, "event": record.event, "dt": motion.dt}
        rows = {"horizontal": motion.acceleration, "vertical": motion.vertical, "factors": factors}
        motions.append(own | {key: row.tolist() for key, row in rows.items() if row is not None})
    made = {"study": study.id, "title": study.title}
    made |= {"archfrag": __version__, "archfrag_commit": commit()}
    about = json.loads(SCHEMA.read_text())["properties"]
    return finite({
        "schema": about["schema"]["const"], "units": about["units"]["const"], "made": made,
        "arches": [_arch(each) for each in chosen], "delay": study.method.delay or 0.0,
        "intensity": {"measure": levels.measure, "unit": levels.unit,
                      "levels": list(levels.given), "power": plan.power},
        "motions": motions,
    })  # fmt: skip


def _arch(member: Member) -> dict[str, Any]:
    """Return bodies at rest, those of the ground last, and what joins them."""
    arch: Arch = member.entry.build()
    chain, n, (first, last) = arch.chain, arch.n_voussoir, arch.springings

    def bodies(pair: Sequence[int]) -> list[int]:
        return [n if body < 0 else n + 1 if body == n else body for body in pair]

    parts: list[dict[str, Any]] = [{
        "kind": "voussoir" if first <= i < last else "pier", "outline": _anticlockwise(outline),
        "centroid": arch.centroids[i].tolist(), "depth": depth, "mass": mass, "inertia": inertia,
        "density": mass / (polygon_section(outline)[0] * depth),
    } for i, (outline, depth, mass, inertia) in enumerate(
        zip(arch.outlines, arch.depths.tolist(), chain.mass.tolist(), chain.inertia.tolist())
    )]  # fmt: skip
    parts += [{"kind": "ground", "outline": _anticlockwise(each)} for each in _ground(arch)]
    joints: list[dict[str, Any]] = [{
        "bodies": bodies((j - 1, j)), "friction": friction,
        "ends": [arch.intrados[j].tolist(), arch.extrados[j].tolist()],
    } for j, friction in enumerate(chain.friction.tolist())]  # fmt: skip
    gives = {key: each for key, each in arch.joint_keys.items() if key != "positions"}
    for key, name in (("kn", "stiffness"), ("ks", "shear")) if gives else ():
        values = np.array(gives.get(name, gives["stiffness"]), dtype=float)
        for joint, value in zip(joints, np.broadcast_to(values, arch.n_joint).tolist()):
            joint[key] = value
    ties, rows = [], () if chain.tie is None else chain.tie
    for pair, ends, tie in zip(arch.tie_bodies.tolist(), tie_lines(arch), rows):
        own = {each.name.lower(): float(tie[each]) for each in list(Tie)[Tie.STIFFNESS :]}
        own["prestress"] = own["stiffness"] * (np.hypot(*(ends[1] - ends[0])) - own["length"])
        ties.append({"bodies": bodies(pair), "ends": ends.tolist(), **own})
    about = {"id": member.id, "class": member.arch_class, "gravity": chain.gravity}
    about |= {key: gives[key] for key in ("model", "damping", "points") if key in gives}
    return about | {"bodies": parts, "joints": joints, "ties": ties}


def _edges(arch: Arch) -> Iterator[FloatArray]:
    """Yield the sides of bodies on which an arch stands, (2, 2) each, from the intrados [m]."""
    for end in (0, -1)[: 1 if arch.free_end else 2]:
        ends, outline = np.array([arch.intrados[end], arch.extrados[end]]), arch.outlines[end]
        along = ends[1] - ends[0]
        on = np.abs(cross(outline - ends[0], along)) < 1e-9 * along @ along
        points = np.vstack([ends, outline[on]])  # a joint may bear on a part of the side
        yield points[[np.argmin(points @ along), np.argmax(points @ along)]]


def _ground(arch: Arch) -> Iterator[FloatArray]:
    """Yield a block of ground under each edge, (4, 2), which it exceeds for bodies that slide."""
    edges = list(_edges(arch))
    clear = np.hypot(*(edges[-1][0] - edges[0][0])) if len(edges) > 1 else np.inf
    for edge, body in zip(edges, (0, -1)):
        along = edge[1] - edge[0]
        away = 2.0 * np.array([-along[1], along[0]])
        away *= -np.sign(away @ (arch.centroids[body] - edge[0]))
        near = edge[0] - min(1.0, 0.4 * clear / np.hypot(*along)) * along  # both do not meet
        yield np.array([near, edge[1] + along, edge[1] + along + away, near + away])


def _lines(arch: Arch) -> Iterator[tuple[str, FloatArray]]:
    """Yield layers and lines of a drawing; `read_drawing` takes VOUSSOIRS."""
    layers = {"VOUSSOIRS": [*arch.outlines, *_edges(arch)], "GROUND": _ground(arch)}
    for layer, shapes in {**layers, "TIES": tie_lines(arch)}.items():
        yield from ((layer, points) for points in shapes)


def _anticlockwise(points: FloatArray) -> Any:
    turn = cross(points, np.roll(points, -1, axis=0)).sum()
    return (points if turn > 0.0 else points[::-1]).tolist()
