"""Sets of fragility curves for IN-CORE, in its layout named DFR3."""

import json
from typing import Any

from archfrag.export.curve_set import CurveSet
from archfrag.export.receivers import named_measure

_MOST = 4


def in_core_sets(curves: CurveSet) -> dict[str, str]:
    """A set for each arch, as JSON.

    IN-CORE takes four curves for a bridge under an earthquake, no more and, in its analysis of
    bridge damage, no fewer: the severest four. Where there are fewer limit states, the severest is
    repeated up to the fourth: the damage states between then have probability 0, and the last has
    that of the severest.
    """
    curves = curves.severest(_MOST)
    demand = named_measure("IN-CORE", curves.measure)
    complete = curves.require_curves("IN-CORE")
    variable = demand.name.rsplit(maxsplit=1)[-1].lower()  # pga, pgv, pgd or sa
    note = f" Note: {demand.note}." if demand.note else ""
    sets = {}
    for arch, states in complete.items():
        last, severest = list(states.items())[-1]
        repeated = f"{last}, repeated since IN-CORE takes {_MOST} limit states"
        four = [*states.items(), *[(repeated, severest)] * (_MOST - len(states))]
        rules = [
            _curve(f"LS_{n}: {state}", variable, demand.factor * fit.theta, fit.beta)
            for n, (state, fit) in enumerate(four)
        ]
        content = {
            "description": f"Masonry arch {arch}. {curves.made.text}{note}",
            "creator": f"archfrag {curves.made.archfrag}",
            "demandTypes": [demand.name],
            "demandUnits": [demand.unit],
            "resultType": "Limit State",
            "resultUnit": "",
            "hazardType": "earthquake",
            "inventoryType": "bridge",
            "curveParameters": [
                {
                    "name": variable,
                    "unit": demand.unit,
                    "description": f"{curves.measure} as {demand.name}",
                    "fullName": demand.name,
                    "expression": None,
                }
            ],
            "fragilityCurves": rules,
        }
        sets[arch] = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    return sets


def _curve(description: str, variable: str, theta: float, beta: float) -> dict[str, Any]:
    median, dispersion = repr(float(theta)), repr(float(beta))
    expression = (
        f"scipy.stats.norm.cdf((math.log({variable}) - math.log({median})) / {dispersion})"
    )
    return {
        "description": description,
        "curveParameters": None,
        "returnType": {
            "type": "Limit State", "unit": "", "description": description.split(":")[0],
        },
        "rules": [{"condition": [f"{variable} > 0"], "expression": expression}],
    }  # fmt: skip
