"""Arches for other programs: a scene with the scaled motions (scene.schema.json), and drawings."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat
from pathlib import Path

import numpy as np
import pandas as pd
import shapely

from archfrag.arch import Arch
from archfrag.arch.checks import FloatArray
from archfrag.arch.drawing import drawing_text
from archfrag.arch.geometry import cross, polygon_section
from archfrag.errors import InputError
from archfrag.export.writers import Content, made_by, write_files
from archfrag.files import Named
from archfrag.physics.status import Tie
from archfrag.simulation.springings import own_motions
from archfrag.study.file.members import Member
from archfrag.study.file.schema import StudyKeys
from archfrag.study.provenance import finite
from archfrag.study.runs.store import make_plan

SCHEMA = Path(__file__).with_name("scene.schema.json")
MOST_ARCHES = 500
_LISTS = re.compile(r"\[\n\s*[^][{}]*?\n\s*\]")  # of numbers, indented


def export_arches(
    study: StudyKeys,
    formats: Sequence[str],
    folder: Path | None = None,
    members: bool = False,
) -> Named:
    """Write the arches of a study in formats of `export.OF_ARCHES`; a scene has its motions too.

    Of a class only the first arch is written, with `members` all of them. Returns ``files`` and
    ``notes`` as `export_study` does. Nothing is written after an InputError: too many arches, or
    no motions yet.
    """
    # Those whose joints are as given.
    own = [each for each in study.members if each.intact]
    sizes = Counter(each.arch_class for each in own)
    found = dict[str, Member]()
    for each in own:
        found.setdefault(each.id if members else each.arch_class, each)
    if len(found) > MOST_ARCHES:
        raise InputError(
            f"study {study.id} has {len(found)} arches; scene and dxf take at most "
            f"{MOST_ARCHES}; leave out --members"
        )
    messages = [
        f"scene and dxf have {found[name].id} of {size} arches of {name}; --members: all"
        for name, size in sizes.items()
        if size > 1 and not members
    ]
    if study.motions.before is not None:
        messages.append(
            "scene and dxf have the intact arches and the records, no first shocks"
        )
    content = list[Content]()
    if "scene" in formats:
        text = json.dumps(_scene(study, found.values()), indent=1, allow_nan=False)
        rows = _LISTS.sub(lambda one: re.sub(r"\n\s*", " ", one[0]), text)
        content.append(("scene", "scene.json", rows + "\n"))
    if "dxf" in formats:
        for each in found.values():
            drawn = drawing_text(_lines(each.entry.build()))
            content.append(("dxf", f"{each.id}.dxf", drawn))
    return {"files": write_files(study, folder, content), "notes": messages}


def _scene(study: StudyKeys, chosen: Iterable[Member]):
    """Return arches, levels, and unscaled motions with their factors, for strict JSON."""
    plan = make_plan(study)
    motions = []
    for number, record in enumerate(plan.records):
        motion = plan.motion(record)
        factors = plan.unscaled[number] * plan.levels**plan.power
        own: Named = {"id": record.id, "event": record.event, "dt": motion.dt}
        own["horizontal"] = motion.acceleration.tolist()
        if motion.vertical is not None:
            own["vertical"] = motion.vertical.tolist()
        motions.append(own | {"factors": factors.tolist()})
    about = json.loads(SCHEMA.read_text("utf-8"))["properties"]
    return finite(
        {
            "schema": about["schema"]["const"],
            "units": about["units"]["const"],
            "made": made_by(study),
            "arches": [_arch(each, study.method) for each in chosen],
            "intensity": {
                "measure": study.intensity.measure,
                "unit": study.intensity.unit,
                "levels": list(study.intensity.given),
                "power": plan.power,
            },
            "motions": motions,
        }
    )


def _arch(member: Member, method) -> Named:
    """Return the bodies of an arch at rest, the ground last, its joints and ties, and delays."""
    arch: Arch = member.entry.build()
    chain = arch.chain
    n = arch.n_voussoir
    k = arch.n_joint
    rings = [body for span in arch.spans for body in span.bodies]
    row = np.append(
        range(n), [*range(n + 1, n + len(arch.bases)), n]
    )  # with the ground last
    lines = arch.tie_lines
    outlines = [
        (each if shapely.is_ccw(shapely.linearrings(each)) else each[::-1]).tolist()
        for each in (*arch.outlines, *(block for _, block in _ground(arch)))
    ]
    bodies = {
        "kind": np.where(np.isin(range(n), rings), "voussoir", "pier"),
        "outline": outlines[:n],
        "centroid": arch.centroids.tolist(),
        "depth": arch.depths,
        "mass": chain.mass,
        "inertia": chain.inertia,
        "density": chain.mass
        / ([polygon_section(each)[0] for each in arch.outlines] * arch.depths),
    }
    ground = [{"kind": "ground", "outline": each} for each in outlines[n:]]
    joints = {
        "bodies": row[arch.pairs].tolist(),
        "friction": chain.friction,
        "ends": np.stack([arch.intrados, arch.extrados], axis=1)[:k].tolist(),
    }
    gives = arch.joints
    if gives:
        kn = gives["stiffness"]  # of each joint or of all, as "inf" if rigid
        joints |= {
            "kn": np.full(k, kn, float),
            "ks": np.full(k, gives.get("shear", kn), float),
        }
    rows = np.zeros((0, len(Tie))) if chain.tie is None else chain.tie
    ties = {
        "bodies": row[arch.tie_bodies].tolist(),
        "ends": lines.tolist(),
    }
    ties |= {each.name.lower(): rows[:, each] for each in list(Tie)[Tie.STIFFNESS :]}
    length = np.hypot(*(lines[:, 1] - lines[:, 0]).T)
    ties["prestress"] = ties["stiffness"] * (length - ties["length"])
    about = {"id": member.id, "class": member.arch_class, "gravity": chain.gravity}
    about |= {key: gives[key] for key in ("model", "damping", "points") if key in gives}
    delays = own_motions(arch, method.wave_speed, method.bases)
    about["delays"] = list(delays.values())
    parts = [pd.DataFrame(each).to_dict("records") for each in (bodies, joints, ties)]
    return about | {"bodies": parts[0] + ground, "joints": parts[1], "ties": parts[2]}


def _ground(arch: Arch) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield each side on which an arch stands, (2, 2), and the ground under it, (4, 2) [m]."""
    joints = np.stack([arch.intrados, arch.extrados], axis=1)
    for name, (joint, side_of) in arch.bases.items():
        others = [joints[other] for other, _ in arch.bases.values() if other != joint]
        body = arch.pairs[joint, 1 - side_of]
        outline = arch.outlines[body]
        along = joints[joint, 1] - joints[joint, 0]
        on = np.abs(cross(outline - joints[joint, 0], along)) < 1e-9 * along @ along
        # A joint may bear on a part of the side.
        points = np.vstack([joints[joint], outline[on]])
        side = points[[np.argmin(points @ along), np.argmax(points @ along)]]
        along = side[1] - side[0]
        away = 2.0 * np.array([-along[1], along[0]])
        away *= -np.sign(away @ (arch.centroids[body] - side[0]))
        # Grounds do not meet.
        clear = [
            np.hypot(*(np.reshape(others, (-1, 2)) - end).T).min(initial=np.inf)
            for end in joints[joint]
        ]
        near, far = (min(1.0, 0.4 * each / np.hypot(*along)) for each in clear)
        near = side[0] - near * along
        far = side[1] + (far if name.startswith("pier") else 1.0) * along
        yield side, np.array([near, far, far + away, near + away])


def _lines(arch: Arch) -> Iterator[tuple[str, FloatArray]]:
    """Yield each line of a drawing with its layer; `read_drawing` reads VOUSSOIRS."""
    sides, ground = zip(*_ground(arch))
    stones = [*arch.outlines, *sides]
    ties = arch.tie_lines
    for layer, shapes in (("VOUSSOIRS", stones), ("GROUND", ground), ("TIES", ties)):
        yield from zip(repeat(layer), shapes)
