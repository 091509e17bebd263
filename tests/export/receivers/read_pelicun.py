"""Probabilities that pelicun reads from a damage database: FILE LEVELS DEMAND, JSON out.

LEVELS: by component, intensities in SI, pelicun's base units. DEMAND: pelicun's short name, such
as PGA or SA_0.5. For each component the distribution of its capacity is what pelicun makes of the
file, and a full damage run is done with the demand at the first of its levels. Run by pelicun's
interpreter.
"""

import json
import sys
from importlib.metadata import version

import pandas as pd
from pelicun import assessment, file_io

RUNS = 20_000
path, asked, demand = sys.argv[1], json.loads(sys.argv[2]), sys.argv[3]
UNITS = {"PGV": "mps"}
found, fractions = {}, {}
for component, levels in asked.items():
    run = assessment.Assessment({"PrintLog": False, "Seed": 1, "LogFile": None})
    column = {f"{demand}-0-1": [UNITS.get(demand, "mps2"), *[levels[0]] * RUNS]}
    run.demand.load_sample(pd.DataFrame(column, index=["Units", *range(RUNS)]))
    run.stories = 1
    assets = {
        "Units": ["ea"], "Location": ["0"], "Direction": ["1"], "Theta_0": [1.0], "Blocks": [1],
        "Family": [None],
    }  # fmt: skip
    run.asset.load_cmp_model({"marginals": pd.DataFrame(assets, index=[component])})
    run.asset.generate_cmp_sample(RUNS)
    units = run.unit_conversion_factors
    database = file_io.load_data(path, reindex=False, unit_conversion_factors=units)
    run.damage.load_model_parameters([database], {component})
    model = run.damage.ds_model
    place = [(component, "0", "1", "0")]
    index = pd.MultiIndex.from_tuples(place, names=["cmp", "loc", "dir", "uid"])
    capacities, _ = model._create_dmg_RVs(pd.DataFrame({"Blocks": [1]}, index=index))
    drawn = {name.split("-")[-1]: variable for name, variable in capacities.RV.items()}
    found[component] = {name: variable.cdf(levels).tolist() for name, variable in drawn.items()}
    run.damage.calculate()
    states = model.probabilities().iloc[0]
    fractions[component] = {str(state): float(value) for state, value in states.items()}
print(json.dumps({"version": version("pelicun"), "probabilities": found, "damage": fractions}))
