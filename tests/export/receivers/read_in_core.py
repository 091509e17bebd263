"""Probabilities that IN-CORE's own parser reads from a set: FILE LEVELS, JSON out.

LEVELS: intensities in IN-CORE's unit. Run by pyincore's interpreter.
"""

import json
import sys
from importlib.metadata import version

from pyincore import FragilityCurveSet

curves = FragilityCurveSet.from_json_file(sys.argv[1])
demand = curves.demand_types[0]
levels = json.loads(sys.argv[2])
found = [curves.calculate_limit_state({demand: im}, inventory_type="bridge") for im in levels]
damage = [
    curves.calculate_damage_interval(dict(each), hazard_type="earthquake", inventory_type="bridge")
    for each in found
]
read = {
    "version": version("pyincore"), "measures": [demand], "units": curves.demand_units,
    "probabilities": found,
    "damage": [{key: float(value) for key, value in each.items()} for each in damage],
}  # fmt: skip
print(json.dumps(read))
