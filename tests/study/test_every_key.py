"""Each key of a study file changed, one by one: results made before are never called current."""

import contextlib
import json
from pathlib import Path

from archfrag.errors import ArchfragError
from archfrag.study.file.schema import Study, load_study
from archfrag.study.steps import stale_steps
from tests.study.small import command, dumped, small_study

TEXT = Path(__file__).with_name("every.yaml").read_text()
HAZARD = "PGA [g],rate\n0.01,0.1\n0.1,0.01\n0.5,0.001\n2.0,0.0001\n"
TABLE = "id,width,height,owner\none,0.4,2.0,me\ntwo,0.5,2.1,you\n"
# Where it runs, and where results go, changes no result.
SAME = ("output", "execution")


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
    path = small_study(tmp_path, TEXT, "every.yaml")
    (tmp_path / "hazard.csv").write_text(HAZARD)
    for name in ("table.csv", "other.csv"):
        (tmp_path / name).write_text(TABLE)
    for step in ("motions", "batch", "cube", "fit", "report"):
        done = command(step, path, *["--quiet"] * (step == "batch"))
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
