"""Makes the curve of README and front page, wide and narrow, anew: python docs/images/make.py."""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
STUDY = HERE.parents[1] / "configs" / "shipped.yaml"


def main() -> None:
    """Run the shipped study and keep its curve."""
    with tempfile.TemporaryDirectory() as folder:
        output = f"--set=output={json.dumps(folder + '/results')}"
        command = [sys.executable, "-m", "archfrag.cli", "run", str(STUDY), output]
        subprocess.run(command, check=True)
        shutil.copyfile(next(Path(folder).rglob("curve-*.svg")), HERE / "curve.svg")
        report = next(Path(folder).rglob("report.html")).read_text("utf-8")
    keep_narrow(report)


def keep_narrow(report: str) -> None:
    """The curve as the report draws it for narrow screens: the first of its figures."""
    narrow = re.search(r'<div class="slim">(<svg.*?</svg>)', report, flags=re.DOTALL)
    if narrow is None:
        raise LookupError("the report has no figure for narrow screens")
    text = narrow[1].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    (HERE / "curve-narrow.svg").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
