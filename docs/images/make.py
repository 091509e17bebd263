"""Makes the curve and the film of README anew: python docs/images/make.py."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
STUDY = HERE.parents[1] / "configs" / "shipped.yaml"


def main() -> None:
    """Run the shipped study and keep its curve and a film of a typical collapse."""
    with tempfile.TemporaryDirectory() as folder:
        output = f"--set=output={json.dumps(folder + '/results')}"
        command = [sys.executable, "-m", "archfrag", "run", str(STUDY), output]
        subprocess.run(command, check=True)
        shutil.copyfile(next(Path(folder).rglob("curve-*.svg")), HERE / "curve.svg")
        command[3:4] = ["film", "--to", f"{folder}/fall.svg"]
        subprocess.run(command, check=True)
        shutil.copyfile(f"{folder}/fall.svg", HERE / "fall.svg")


if __name__ == "__main__":
    main()
