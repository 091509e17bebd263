"""Probabilities that a receiver's own parser reads from files: RECEIVER, JSON in and out.

Run by the receiver's interpreter. On stdin is a list of [FILE, LEVELS, ...]; LEVELS are in its
unit: of OpenQuake by id of a function, of pelicun by component, of IN-CORE a list.
"""

import json
import sys
from importlib import metadata


def openquake(path, levels):
    import numpy as np
    from openquake.hazardlib import imt, nrml
    from openquake.risklib import read_nrml

    read_nrml.update_validators()
    model = nrml.to_python(path)
    found = {}
    for (name, function), curves in model.items():
        assert str(imt.from_string(name)) == name
        at = np.array(levels[function], dtype=float)
        built = curves.build(model.limitStates)
        found[function] = {curve.limit_state: curve(at).tolist() for curve in built}
    measures = sorted({name for name, _ in model})
    return {
        "measures": measures,
        "description": model.description,
        "probabilities": found,
    }


def in_core(path, levels):
    from pyincore import FragilityCurveSet

    curves = FragilityCurveSet.from_json_file(path)
    demand = curves.demand_types[0]
    bridge = {"inventory_type": "bridge"}
    found = [curves.calculate_limit_state({demand: im}, **bridge) for im in levels]
    return {"measures": [demand], "units": curves.demand_units, "probabilities": found}


def pelicun(path, levels, demand):
    """Levels are in SI, pelicun's base units; `demand` is its short name, as PGA or SA_0.5."""
    import pandas as pd
    from pelicun import assessment, file_io

    unit = "mps" if demand == "PGV" else "mps2"
    found = {}
    for component, at in levels.items():
        run = assessment.Assessment({"PrintLog": False, "Seed": 1, "LogFile": None})
        column = {f"{demand}-0-1": [unit, at[0], at[0]]}
        run.demand.load_sample(pd.DataFrame(column, index=["Units", 0, 1]))
        run.stories = 1
        assets = {
            "Units": ["ea"],
            "Location": ["0"],
            "Direction": ["1"],
            "Theta_0": [1.0],
            "Blocks": [1],
            "Family": [None],
        }
        run.asset.load_cmp_model({"marginals": pd.DataFrame(assets, index=[component])})
        run.asset.generate_cmp_sample(2)
        units = run.unit_conversion_factors
        database = file_io.load_data(path, reindex=False, unit_conversion_factors=units)
        run.damage.load_model_parameters([database], {component})
        names = ["cmp", "loc", "dir", "uid"]
        index = pd.MultiIndex.from_tuples([(component, "0", "1", "0")], names=names)
        blocks = pd.DataFrame({"Blocks": [1]}, index=index)
        capacities, _ = run.damage.ds_model._create_dmg_RVs(blocks)
        drawn = {
            name.split("-")[-1]: variable for name, variable in capacities.RV.items()
        }
        found[component] = {name: drawn[name].cdf(at).tolist() for name in drawn}
    return {"probabilities": found}


if __name__ == "__main__":
    read, package = {
        "OPENQUAKE": (openquake, "openquake.engine"),
        "INCORE": (in_core, "pyincore"),
        "PELICUN": (pelicun, "pelicun"),
    }[sys.argv[1]]
    answers = [read(*each) for each in json.load(sys.stdin)]
    print(json.dumps({"version": metadata.version(package), "answers": answers}))
