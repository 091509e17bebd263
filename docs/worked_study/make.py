"""Makes the worked study and puts what its page shows into ``results``.

``python docs/worked_study/make.py`` takes some five minutes on two cores; a person could type the
commands. It makes the study again with rigid joints and the same arches otherwise.
"""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

from archfrag.study.file.schema import load_study

HERE = Path(__file__).parent
RESULTS = HERE / "results"
STUDY, HAZARD = HERE / "study.yaml", HERE / "hazard.csv"
SOURCES = ("study.yaml", "bridge.dxf", "hazard.csv")
FORMATS = ("nrml-continuous", "nrml-discrete", "pelicun", "in-core", "csv")
KEPT = ("*-fragility-continuous.xml", "*-pelicun.csv", "*-pelicun.json", "*-arches.csv",
        "*-parameters.csv", "*-in-core-ring.json")  # fmt: skip
MOTIONS = """--events 20 --records-per-event 2 --magnitude 6.5:7.5 --distance-km 3:20 --vs30 760
--vertical --seed 16"""
CORES = 2
# Sampled as before, each number a factor on an infinite stiffness.
RIGID = [
    "arches.0.joints.stiffness=.inf",
    "arches.0.vary.of={"
    "thickness_factor: {distribution: normal, mean: 1.0, cov: 0.05, lower: 0.85, upper: 1.15}, "
    "friction: {distribution: lognormal, median: 0.6, beta: 0.25, lower: 0.35, upper: 1.0}, "
    "joints.stiffness: {distribution: lognormal, median: 1.0, beta: 1.0, relative: true}}",
]


def archfrag(*words: str | Path) -> str:
    """What one command prints, as a person types it."""
    program = [Path(sys.executable).with_name("archfrag"), *map(str, words)]
    return subprocess.run(program, cwd=HERE, check=True, text=True, stdout=subprocess.PIPE).stdout


def main() -> None:
    """Run, export, integrate the hazard; keep what is small."""
    out = load_study(STUDY).folder
    shutil.rmtree(out, ignore_errors=True)  # so that the time is that of all of it
    start = time.perf_counter()
    archfrag("records", "make", "--out", out / "motions", *MOTIONS.split())
    archfrag("run", STUDY, "--cores", CORES)
    wall_time = time.perf_counter() - start
    archfrag("export", STUDY, *(f"--format={name}" for name in FORMATS))
    twin = out.with_name(f"{out.name}_rigid")
    changed = [*RIGID, f"output={json.dumps(str(twin))}"]
    archfrag("run", STUDY, "--cores", CORES, *(f"--set={each}" for each in changed))
    (rigid,) = json.loads((twin / "summary.json").read_text())["classes"]
    # Before files of the checkout change, and with them its state.
    risk = archfrag("risk", STUDY, "--hazard", HAZARD.name, "--members", "--json")
    shutil.rmtree(RESULTS, ignore_errors=True)
    RESULTS.mkdir()
    (RESULTS / "rigid.json").write_text(json.dumps(rigid, indent=1) + "\n")
    (RESULTS / "risk.json").write_text(risk)
    for pattern in KEPT:
        for path in (out / "export").glob(pattern):
            shutil.copy(path, RESULTS)
    for path in (out / "summary.json", *out.glob("curve-ring-0001.svg")):
        shutil.copy(path, RESULTS)
    content = {name: (HERE / name).read_bytes() for name in SOURCES}
    note = {
        "sha256": {name: hashlib.sha256(each).hexdigest() for name, each in content.items()},
        "cores": CORES,
        "wall_time_s": round(wall_time),
        "report_bytes": (out / "report.html").stat().st_size,
    }
    (RESULTS / "provenance.json").write_text(json.dumps(note, indent=1) + "\n")


if __name__ == "__main__":
    main()
