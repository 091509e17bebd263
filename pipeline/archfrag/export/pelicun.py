"""A damage database for pelicun: a table of parameters and its description."""

import csv
import io
import json
import re
from dataclasses import asdict
from itertools import chain

from archfrag.errors import InputError
from archfrag.export.curve_set import CurveSet
from archfrag.export.receivers import named_measure


def pelicun_table(curves: CurveSet) -> str:
    """Parameters of all arches as CSV, a component for each arch.

    ``Theta_0`` is the median in ``Demand-Unit`` (g or cmps), ``Theta_1`` the dispersion.
    ``Demand-Directional`` is 1: with 0 pelicun would multiply the demand by 1.2.
    """
    demand = named_measure("pelicun", curves.measure)
    complete = curves.require_curves("pelicun")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    states = [f"LS{n + 1}" for n in range(len(curves.limit_states))]
    columns = [f"{ls}-{key}" for ls in states for key in ("Family", "Theta_0", "Theta_1")]
    fixed = "ID Incomplete Demand-Type Demand-Unit Demand-Offset Demand-Directional"
    writer.writerow([*fixed.split(), *columns])
    for arch, name in _ids(tuple(complete)).items():
        fits = complete[arch].values()
        values = [("lognormal", float(demand.factor * f.theta), float(f.beta)) for f in fits]
        writer.writerow([name, 0, demand.name, demand.unit, 0, 1, *chain(*values)])
    return text.getvalue()


def pelicun_description(curves: CurveSet) -> str:
    """What stands beside the table, as JSON in the layout of pelicun's own databases."""
    complete = curves.require_curves("pelicun")
    note = named_measure("pelicun", curves.measure).note
    content: dict[str, object] = {
        "_GeneralInformation": {
            "ShortName": curves.made.study,
            "Description": curves.made.text + (f" Note: {note}." if note else ""),
            "Version": curves.made.archfrag,
            "ComponentGroups": ["Masonry arches"],
            "archfrag": asdict(curves.made),
            "LeftOut": curves.left_out,
        }
    }
    for arch, name in _ids(tuple(complete)).items():
        content[name] = {
            "Description": f"Masonry arch {arch}",
            "SuggestedComponentBlockSize": "1 EA",
            "RoundUpToIntegerQuantity": "True",
            "LimitStates": {
                f"LS{n + 1}": {f"DS{n + 1}": {"Description": state}}
                for n, state in enumerate(curves.limit_states)
            },
        }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _ids(arches: tuple[str, ...]) -> dict[str, str]:
    """pelicun's id of each arch."""
    names: dict[str, str] = {}
    for arch in arches:
        name = re.sub(r"[^A-Za-z0-9_.]", "_", arch)
        if name in names.values():
            raise InputError(
                f"arch {arch!r} would have the id {name!r} in pelicun, as another arch has; "
                "pelicun's ids hold letters, digits, _ and . only"
            )
        names[arch] = name
    return names
