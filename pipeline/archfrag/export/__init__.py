"""Exports of a study. Its formats stand here, where nothing heavy is loaded."""

# By name: its use; the receiver whose names of measures it takes, none for tables; and functions
# of `archfrag.export.writers` by the ends of their files' names.
FORMATS: dict[str, tuple[str, str, dict[str, str]]] = {
    "nrml-continuous": (
        "OpenQuake: lognormal curves by mean and standard deviation",
        "OpenQuake",
        {"fragility-continuous.xml": "nrml_continuous"},
    ),
    "nrml-discrete": (
        "OpenQuake: probabilities at levels",
        "OpenQuake",
        {"fragility-discrete.xml": "nrml_discrete"},
    ),
    "pelicun": (
        "pelicun: damage database, medians and dispersions in CSV, and JSON",
        "pelicun",
        {"pelicun.csv": "pelicun_table", "pelicun.json": "pelicun_description"},
    ),
    "in-core": (
        "IN-CORE: a DFR3 set in JSON for each arch or class",
        "IN-CORE",
        {"in-core-{}.json": "in_core_sets"},
    ),
    "csv": ("curves, parameters, runs, records and arches; JSON on columns", "", {}),
}
# Of arches and motions, by name: its use.
OF_ARCHES = {
    "scene": "LMGC90, 3DEC and others: bodies, joints, ties and scaled motions in JSON",
    "dxf": "drawing programs: a drawing of each arch",
}
# What is written: the curve of the medians of theta and beta, its mean, or weighted branches.
CURVES = ("median", "predictive", "branches")
