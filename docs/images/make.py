"""Makes the curve and the films of README anew: python docs/images/make.py."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
FILMS = {"shipped": "fall", "viaduct": "viaduct"}  # by study


def main() -> None:
    """Run the studies; keep a curve of the shipped one, and films of typical collapses."""
    for study, film in FILMS.items():
        with tempfile.TemporaryDirectory() as folder:
            file = HERE.parents[1] / "configs" / f"{study}.yaml"
            output = f"--set=output={json.dumps(folder + '/results')}"
            command = [sys.executable, "-m", "archfrag", "run", str(file), output]
            subprocess.run(command, check=True)
            if study == "shipped":
                shutil.copyfile(
                    next(Path(folder).rglob("curve-*.svg")), HERE / "curve.svg"
                )
            command[3:4] = ["film", "--to", f"{folder}/{film}.svg"]
            subprocess.run(command, check=True)
            shutil.copyfile(f"{folder}/{film}.svg", HERE / f"{film}.svg")


if __name__ == "__main__":
    main()
