"""Exports of a study. The list of formats is here, where nothing heavy is loaded."""

# Of each format: its use; the receiver whose names of measures it has, empty for tables; and, by
# the end of a file's name, the function of `archfrag.export.writers` that makes the file.
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
# Formats of arches and motions, each with its use.
OF_ARCHES = {
    "scene": "LMGC90, 3DEC and others: bodies, joints, ties and scaled motions in JSON",
    "dxf": "drawing programs: a drawing of each arch",
}
# Curve that is written: that of the medians of theta and beta, the mean, or weighted branches.
CURVES = ("median", "predictive", "branches")
