"""Makes the worked study of a bridge and puts what its page shows into ``results``.

``python docs/worked_study_bridge/make.py`` takes some three minutes on one core.
It makes the study again with rigid joints.
"""

import hashlib
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd

import archfrag as af
from archfrag.api.results import Results
from archfrag.study.file.schema import load_study

HERE = Path(__file__).parent
RESULTS = HERE / "results"
STUDY = HERE / "study.yaml"
SPREADS = (0, 20, 50)  # [mm]
ARCHES = [f"spread-{mm}{tied}" for mm in SPREADS for tied in ("", "-tied")]


def main() -> None:
    """Run the study by the command line; keep what is small."""
    out = load_study(STUDY).folder
    shutil.rmtree(out, ignore_errors=True)  # so that the time is that of all of it
    start = time.perf_counter()
    program = Path(sys.executable).with_name("archfrag")
    command = [program, "run", STUDY, "--cores", "1", "--quiet"]
    subprocess.run(command, check=True)
    wall_time = time.perf_counter() - start
    changed = [f"arches.{number}.joints.stiffness=.inf" for number in range(len(ARCHES))]
    changed += [f"output={json.dumps(f'{out}_rigid')}"]
    subprocess.run([*command, *(f"--set={each}" for each in changed)], check=True)
    # Before files of the checkout change, and with them its state.
    results, rigid = af.open(out), Results(load_study(STUDY, changed))
    joints = {name: rigid.compare(name, name, other=results).loc["theta"] for name in ARCHES}
    pairs = [(f"spread-{mm}", f"spread-{mm}-tied") for mm in SPREADS]
    pairs += [("spread-0", f"spread-{mm}") for mm in SPREADS[1:]]
    compared = {pair: results.compare(*pair).loc["theta"] for pair in pairs}
    shutil.rmtree(RESULTS, ignore_errors=True)
    RESULTS.mkdir()
    for path in (out / "summary.json", out / "capacities.csv"):
        shutil.copy(path, RESULTS)
    rows = [{"one": one, "other": other, **row} for (one, other), row in compared.items()]
    pd.DataFrame(rows).to_csv(RESULTS / "compared.csv", index=False)
    pd.DataFrame(joints).T.to_csv(RESULTS / "joints.csv", index_label="arch")
    note = {
        "sha256": hashlib.sha256(STUDY.read_bytes()).hexdigest(),
        "wall_time_s": round(wall_time),
    }
    (RESULTS / "provenance.json").write_text(json.dumps(note, indent=1) + "\n")


if __name__ == "__main__":
    main()
