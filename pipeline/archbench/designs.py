"""Designs of a study: runs that each needs, and how theta and beta scatter between repeats.

Each repeat is the shipped study as `archfrag run` makes it, with levels larger by a multiple of
1e-5, or the same with other synthetic motions.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd
import yaml

from archbench.runner import Bench, Row
from archbench.scene import STANDARD_GRAVITY
from archfrag.errors import ArchfragError
from archfrag.motions.synthetic import Plan, make_suite, plan_motions

REPEATS = {True: 2, False: 8}
DISTURBANCE = 1e-5
LIMIT = 600.0
MAGNITUDES, DISTANCES = [5.5, 6.0, 6.5, 7.0, 7.5], [5.0, 10.0, 20.0, 35.0, 70.0]  # [km]
# Design, and how many synthetic motions it draws anew; 0: the shipped ones.
DESIGNS: dict[str, tuple[Row, int]] = {
    "stripes": ({"kind": "stripes"}, 0),
    "ida": ({"kind": "ida"}, 0),
    "stripes, other motions": ({"kind": "stripes"}, 30),
}
QUICK = ("stripes", "ida")


def run_design(name: str, repeat: int, records: Path) -> Row:
    """Runs, theta [g], beta, their 90 % intervals and the time of one study."""
    design, events = DESIGNS[name]
    study = yaml.safe_load((records.parent / "configs" / "shipped.yaml").read_text("utf-8"))
    seed = {} if design["kind"] == "stripes" else {"seed": repeat}
    study["design"] = {**design, **seed}
    study["motions"] = {"index": "index.csv" if events else str(records / "index.csv")}
    levels = study["intensity"]["levels"]
    for end in ("start", "stop"):
        levels[end] *= 1.0 + DISTURBANCE * repeat
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.yaml"
        if events:
            make_suite(folder, plan_motions(Plan(events, 1, MAGNITUDES, DISTANCES, seed=repeat)))
        path.write_text(yaml.safe_dump({**study, "output": "out"}), encoding="utf-8")
        program = str(Path(sys.executable).with_name("archfrag"))
        command = [program, "run", str(path), "--cores", "1", "--quiet"]
        began = time.perf_counter()
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - began
        if done.returncode:
            raise ArchfragError(f"design {name}: {done.stderr.strip()[-500:]}")
        fits = json.loads((Path(folder) / "out" / "fits.json").read_text("utf-8"))
    (found,) = fits["arches"].values()
    (counted,) = fits["design"]["arches"].values()
    theta = [each / STANDARD_GRAVITY for each in (found["curve"]["theta"], *found["theta"])]
    return {
        "design": name, "repeat": repeat,
        **{key: counted.get(key, 0) for key in ("runs", "coarse_runs")},
        "theta_g": theta[0], "beta": found["curve"]["beta"], "theta_low": theta[1],
        "theta_high": theta[2], "beta_low": found["beta"][0], "beta_high": found["beta"][1],
        "seconds": seconds,
    }  # fmt: skip


def measure(bench: Bench) -> dict[str, pd.DataFrame]:
    """Every study, and means and standard deviations by design."""
    tasks = {(name, repeat): (name, repeat, bench.records)
             for name in (QUICK if bench.quick else DESIGNS)
             for repeat in range(REPEATS[bench.quick])}  # fmt: skip
    found = bench.run("designs", run_design, tasks, LIMIT)
    studies = pd.DataFrame([each for each in found.values() if not isinstance(each, str)])
    groups = studies.drop(columns="repeat").groupby("design", sort=False)
    means, scatter = groups.mean(), groups[["theta_g", "beta"]].std()
    return {"studies": studies, "designs": means.join(scatter, rsuffix="_scatter").reset_index()}
