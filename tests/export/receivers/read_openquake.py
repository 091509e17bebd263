"""Probabilities that OpenQuake's own parser reads from a fragility model: FILE LEVELS, JSON out.

LEVELS: by id of a function, intensities in OpenQuake's unit. Run by OpenQuake's interpreter.
"""

import json
import sys

import numpy as np
from openquake.baselib import __version__
from openquake.hazardlib import imt, nrml
from openquake.risklib import read_nrml

read_nrml.update_validators()
model = nrml.to_python(sys.argv[1])
asked = json.loads(sys.argv[2])
found = {}
for (name, function), curves in model.items():
    assert str(imt.from_string(name)) == name
    built = curves.build(model.limitStates)
    levels = np.array(asked[function], dtype=float)
    found[function] = {curve.limit_state: curve(levels).tolist() for curve in built}
read = {
    "version": __version__, "measures": sorted({name for name, _ in model}),
    "description": model.description, "probabilities": found,
}  # fmt: skip
print(json.dumps(read))
