"""Each key of a study file changed, one by one: results made before are never called current."""

import contextlib
import json
import shutil

from click.testing import CliRunner

from archfrag.cli import main
from archfrag.errors import ArchfragError
from archfrag.study.file.schema import Study, load_study
from archfrag.study.steps import stale_steps
from tests.study.small import dumped, small_study

TEXT = """\
id: every
title: A study of all keys
institution: nobody
output: out
arches:
  - {id: ring, profile: circular, radius: 10.0, thickness: 1.5, embrace: 157.5, voussoirs: 7,
     friction: 0.7, recess: {intrados: 0.01, extrados: 0.02}, dead_load: 100.0}
  - {id: segment, profile: segmental, span: 10.0, rise: 3.0, thickness: 1.0, voussoirs: 5,
     friction: 0.8}
  - {id: point, profile: pointed, span: 8.0, rise: 6.0, thickness: 1.2, voussoirs: 6,
     friction: 0.8}
  - {id: ellipse, profile: elliptic, span: 8.0, rise: 4.0, thickness: 1.5, voussoirs: 7,
     friction: 0.9}
  - {id: chain, profile: catenary, span: 8.0, rise: 4.0, thickness: 1.0, voussoirs: 5,
     friction: 0.9}
  - {id: slab, profile: block, width: 0.4, height: 2.0, friction: .inf, vary: {samples: 2,
     of: {density: {distribution: uniform, start: 1900.0, stop: 2100.0},
          width: {distribution: normal, mean: 0.4, sd: 0.01},
          height: {distribution: lognormal, median: 2.0, beta: 0.01},
          depth: {distribution: triangular, start: 0.9, mode: 1.0, stop: 1.2}}}}
  - {id: wall, profile: from_joints, friction: 0.7, free_end: true,
     intrados: [[0.0, 0.0], [0.0, 1.0]], extrados: [[-0.5, 0.0], [-0.5, 1.0]]}
  - {id: stone, profile: polygons, friction: 0.7, thickness_factor: 1.0,
     outlines: [[[0, 0, 0], [0.5, 0, 0], [0.5, 1.5, 0], [0, 1.5, 0]]],
     ground: [[[-1, 0], [2, 0]]]}
  - {id: many, table: table.csv, profile: block, friction: 0.7}
motions:
  files: [{path: "records/*.AT2"}]
  processing: [demean, {taper: {fraction: 0.05}}, {bandpass: {lowest: 0.1, highest: 25.0}},
    {trim: {times: [0.0, 1.4]}}, {baseline: {order: 1}}, {resample: {dt: 0.005}}]
intensity: {measure: PGA, unit: g, levels: [0.1, 1.2]}
method: {name: time_stepping, dt: 4.0e-3, follow: 0.5}
report: {at: 0.3}
risk: {hazard: hazard.csv, unit: g}
"""
HAZARD = "PGA [g],rate\n0.01,0.1\n0.1,0.01\n0.5,0.001\n2.0,0.0001\n"
TABLE = "id,width,height,owner\none,0.4,2.0,me\ntwo,0.5,2.1,you\n"
# Where it runs, and where results go, changes no result.
SAME = ("output", "execution")


def base(folder):
    """The study of all keys, not run."""
    path = small_study(folder, TEXT, "every.yaml")
    (folder / "hazard.csv").write_text(HAZARD)
    (folder / "table.csv").write_text(TABLE)
    shutil.copyfile(folder / "table.csv", folder / "other.csv")
    return path


def leaves(value, here=()):
    """Places of all numbers and texts of a study."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        if isinstance(inner, dict | list | tuple) and inner:
            yield from leaves(inner, (*here, key))
        else:
            yield (*here, key), inner


def without_none(value):
    """The same without keys that have no value."""
    if isinstance(value, dict):
        return {k: without_none(v) for k, v in value.items() if v is not None}
    return [without_none(v) for v in value] if isinstance(value, list) else value


def others(value):
    """Values that may stand in the place of one."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int | float):
        return [value * 1.01, value * 0.99, value + 1, value - 1, value + 0.01, 0.5, 1]
    if isinstance(value, str):
        return [value + "x", "cm/s2", "PGV", "latin_hypercube", "left", "penalty"]
    return [0.5, 1, 0.01, True, "x", "cm/s2", [0.1], {"PGA": 0.1}, [0.1] * 7, [1.0] * 5]


def changed(path):
    """For each key its name and the study with another value in the first place that can."""
    seen = set()
    plain = load_study(path).model_dump(mode="json")
    for place, value in leaves(plain):
        name = ".".join("*" if isinstance(key, int) else key for key in place)
        for other in others(value):
            if other == value or name in seen:
                continue
            new = json.loads(json.dumps(plain))
            inner = new
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = other
            with contextlib.suppress(ArchfragError, ValueError):
                copy = path.with_name("changed.yaml")
                copy.write_text(dumped(Study.model_validate(without_none(new))))
                study = load_study(copy)
                seen.add(name)
                yield name, study


def test_each_change_is_seen(tmp_path):
    path = base(tmp_path)
    for step in ("motions", "batch", "cube", "fit", "report"):
        done = CliRunner().invoke(main, [step, str(path), *["--quiet"] * (step == "batch")])
        assert done.exit_code == 0, done.output
    assert stale_steps(load_study(path))[0] == []
    seen = set()
    for name, study in changed(path):
        seen.add(name)
        if name.startswith("output"):
            continue
        with contextlib.suppress(ArchfragError):  # what cannot be run is not called current
            stale = stale_steps(study)[0]
            assert bool(stale) == (not name.startswith(SAME)) or name == "execution.batches", name
    assert len(seen) > 70, sorted(seen)
