# `archfrag run STUDY` starts this; by hand:
#   snakemake --cores 2 --config study=configs/shipped.yaml
from pathlib import Path

from archfrag.study.tree import leave_snakemakes_cache

leave_snakemakes_cache()

from archfrag.kernel_cache import kernel_hash
from archfrag.study.config import load_study
from archfrag.study.files import source_hash
from archfrag.study.steps import batch_step, forget_stale

STUDY_FILE = str(Path(config["study"]).absolute())
STUDY = load_study(STUDY_FILE)
BATCHES = STUDY.execution.batches
QUIET = "--quiet" if int(config.get("quiet", 0)) else ""

# Records and results are compared by content, not by Snakemake: it sees only the stamps of steps,
# and makes those that are not there. Paths are relative, so that no name can mean a wildcard.
workdir: str(STUDY.work)
if workflow.is_main_process:
    forget_stale(STUDY)


wildcard_constraints:
    batch=r"\d+",


localrules:
    all,
    motions,
    results,


rule all:
    input:
        "steps/report.json",


include: "pipeline/rules/motions.smk"
include: "pipeline/rules/simulations.smk"
include: "pipeline/rules/results.smk"
