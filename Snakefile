# The steps of `archfrag run` as rules, for many studies, for a workflow of your own, for a cluster.
# Snakemake comes with the extra `workflow`: pip install -e ".[workflow]"
#   snakemake --cores 2 --config study=configs/shipped.yaml
#   snakemake --cores 2 --config "study=[one.yaml, two.yaml]" -- results/two/report.html
# Results of FILE.yaml are in results/FILE, or in the folder that `results` of the configuration
# names. As a module: https://snakemake.readthedocs.io/en/stable/snakefiles/modularization.html
import re
from functools import cache
from pathlib import Path

from snakemake.exceptions import WorkflowError

try:
    import archfrag
except ModuleNotFoundError:
    raise WorkflowError(
        "the environment of this Snakemake has no archfrag; install both in one, in a checkout by "
        'pip install -e ".[workflow]"'
    )
if "study" not in config:
    raise WorkflowError("no study is given; add --config study=FILE, such as configs/shipped.yaml")
GIVEN = config["study"] if isinstance(config["study"], list) else [config["study"]]
STUDIES = {Path(file).stem: str(file) for file in GIVEN}
for file in GIVEN:
    if Path(STUDIES[Path(file).stem]).resolve() != Path(file).resolve():
        raise WorkflowError(
            f"{file} and {STUDIES[Path(file).stem]} would both have their results in "
            f"{Path(file).stem}; give one of the study files another name"
        )
RESULTS = str(config.get("results", "results"))
FOLDER = f"{RESULTS}/{{study}}"
HIDDEN = f"{FOLDER}/.archfrag"


@cache
def study_of(name):
    from archfrag.study.file.schema import load_study

    return load_study(STUDIES[name])


def study_file(wildcards):
    return STUDIES[wildcards.study]


wildcard_constraints:
    study="|".join(map(re.escape, STUDIES)),
    batch=r"\d+",
    batches=r"\d+",


localrules:
    all,
    motions,
    cube,
    fit,
    report,


rule all:
    default_target: True
    input:
        expand(f"{FOLDER}/report.html", study=STUDIES),


include: "pipeline/rules/motions.smk"
include: "pipeline/rules/runs.smk"
include: "pipeline/rules/results.smk"
