"""Keys of arches beside keys of the study: a check refuses all that a run would refuse."""

import json

import numpy as np
import pytest

from archfrag.errors import InputError, StabilityError
from archfrag.study.designs import CASE
from archfrag.study.file.prepared import load_prepared, prepare_motions
from archfrag.study.file.schema import load_study
from archfrag.study.runs.store import Plan
from archfrag.study.runs.workers import make_runs
from archfrag.study.validate import check_study
from tests.study.small import command, made, small_study, write_at2

RING = "profile: segmental, span: 8, rise: 3, thickness: 0.9, voussoirs: 6"
STUDY = """\
id: pair
title: A pair of keys
output: out
arches:
  - {{id: plain, {ring}, friction: 0.7}}
  - {{id: own, {arch}}}
motions: {{files: [records/wave.AT2]}}
intensity: {{measure: PGA, unit: g, levels: [0.1]}}
method: {method}
"""
# By name: profile and keys that a cell of a table takes as JSON.
ARCHES = {
    "rigid": (RING, {"friction": 0.7}),
    "face": (RING, {"friction": 0.7, "joints": {"stiffness": 3e10, "model": "face"}}),
    "soft": (RING, {"friction": 0.7, "joints": {"stiffness": 1e6, "model": "face"}}),
    "inset": (RING, {"friction": 0.7, "joints": {"stiffness": 3e10}}),
    "thin": (RING.replace("0.9", "0.05"), {"friction": 0.7}),
    "block": ("profile: block, width: 1, height: 3", {"friction": 0.7}),
    "column": (
        "profile: from_joints, intrados: [[1, 0], [1, 1], [1, 3]], "
        "extrados: [[0, 0], [0, 1], [0, 3]]",
        {"friction": 0.7, "free_end": True},
    ),
}
METHODS = {
    "auto": "{follow: 0.1}",
    "steps": "{name: time_stepping, dt: 0.002, follow: 0.1}",
    "events": "{name: event_driven, follow: 0.1}",
    "wave": "{wave_speed: -300, follow: 0.1}",
    "delay": "{bases: {right: 0.02}, follow: 0.1}",
    "no delay": "{bases: {right: 0}, follow: 0.1}",
}
REFUSED = {
    *((arch, "events") for arch in ("face", "soft")),
    *((arch, method) for arch in ("soft", "thin") for method in METHODS),
    *(
        (arch, method)
        for arch in ("block", "column")
        for method in ("wave", "delay", "no delay")
    ),
}


def written(folder, arch, method, table):
    """Write a study of a ring and another arch, whose keys are in a table or not."""
    profile, keys = ARCHES[arch]
    given = profile + "".join(
        f", {key}: {json.dumps(value)}" for key, value in keys.items()
    )
    path = small_study(folder)
    if table:
        cells = (
            '"' + json.dumps(value).replace('"', '""') + '"' for value in keys.values()
        )
        rows = f"id,{','.join(keys)}\nrow,{','.join(cells)}\n"
        (folder / "table.csv").write_text(rows)
        given = f"table: table.csv, {profile}"
    time = np.arange(30) * 0.01
    write_at2(folder / "records" / "wave.AT2", 0.1 * np.sin(20.0 * time), 0.01)
    path.write_text(STUDY.format(ring=RING, arch=given, method=METHODS[method]))
    return path


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("table", [False, True], ids=["entry", "cell"])
@pytest.mark.parametrize("arch", ARCHES)
def test_a_check_passes_what_runs_and_nothing_else(tmp_path, arch, table):
    for method in METHODS:
        refused = (arch, method) in REFUSED
        path = written(tmp_path, arch, method, table)
        result = command("validate", path)
        assert (result.exit_code in (2, 3)) is refused, (method, result.output)
        assert refused or result.exit_code == 0
        if refused:
            whose = "arches[1] (own): table.csv, arch row" if table else "arches[1]"
            assert whose in result.output.replace(str(tmp_path) + "/", "").replace(
                "\n", " "
            )
            continue
        study = load_study(path)
        prepare_motions(study)
        plan = Plan(study, study.members, tuple(load_prepared(study)))
        case = np.zeros(1, CASE)
        case["arch"] = 1
        case["level"] = 0.1 * 9.80665
        assert make_runs(plan, case)["verdict"][0] in (0, 1, 2)


def test_what_is_refused_is_named(tmp_path):
    texts = {
        (
            "face",
            "events",
        ): "method event_driven needs rigid joints; give them joints.model inset",
        ("block", "no delay"): "bases, method.bases in a study file, is given, but",
        (
            "column",
            "wave",
        ): "wave_speed, method.wave_speed in a study file, is given, but",
    }
    for (arch, method), text in texts.items():
        with pytest.raises(InputError, match=text):
            check_study(load_study(written(tmp_path, arch, method, table=True)))
    with pytest.raises(
        StabilityError, match=r"arches\[1\] \(own\): .*joints that soft"
    ):
        check_study(load_study(written(tmp_path, "soft", "auto", table=False)))


def test_a_number_that_only_some_arches_list_is_known_of_all(tmp_path):
    """Of a table or of samples beside other entries, and of an arch with one for each joint."""
    path = written(tmp_path, "rigid", "auto", table=True)
    more = f"  - {{id: each, {RING}, friction: [0.5, 0.6, 0.7, 0.7, 0.7, 0.6, 0.5]}}\n"
    path.write_text(path.read_text().replace("motions:", more + "motions:", 1))
    cube = made(path).cube
    assert cube["arch"].values.astype(str).tolist() == ["plain", "row", "each"]
    assert cube["arch_friction"].values.tolist() == pytest.approx([0.7, 0.7, 4.3 / 7.0])
