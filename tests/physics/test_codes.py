"""Codes are known by their names only: their numbers may change."""

import os
import subprocess
import sys

SHAKEN = """
import sys
from enum import IntEnum
import numpy as np
from archfrag.physics import status

for name in sys.argv[1:]:
    names = list(getattr(status, name).__members__)
    names.insert(1, "ANOTHER")
    setattr(status, name, IntEnum(name, names, start=0))
import archfrag as af

motion = af.Motion(6.0 * np.sin(np.arange(0.0, 1.0, 0.1) * 9.0), 0.1)
block = af.Block(0.5, 2.0, 0.8)
run = af.simulate(block, motion, method="time_stepping", dt=0.02, follow=1.0)
print(run.status.name, run.energy, run.peak_displacement)
"""


def test_another_member_of_an_enum_changes_no_result():
    codes = ["Wait", "Stretch", "Phase", "TieMode", "Cause", "Level", "Count"]
    plain, more = (
        subprocess.run(
            [sys.executable, "-c", SHAKEN, *names],
            env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for names in ([], codes)
    )
    assert plain
    assert more == plain
