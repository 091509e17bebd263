# `archfrag run STUDY` starts this; by hand:
#   snakemake --cores 2 --config study=configs/shipped.yaml
from pathlib import Path

from snakemake.exceptions import WorkflowError

from archfrag.study.tree import leave_snakemakes_cache

leave_snakemakes_cache()

from archfrag.study.config import load_study
from archfrag.study.steps import batch_step, stale_steps

if "study" not in config:
    raise WorkflowError("no study is given; add --config study=FILE, such as configs/shipped.yaml")
STUDY_FILE = str(Path(config["study"]).absolute())
STUDY = load_study(STUDY_FILE)
BATCHES = STUDY.execution.batches
QUIET = "--quiet" if int(config.get("quiet", 0)) else ""

# Records and results are compared by content, not by Snakemake: it sees only the stamps of steps.
# Paths are relative, so that no name can mean a wildcard.
workdir: str(STUDY.work)


def force_stale(wildcards):
    """Have Snakemake make steps again that are out of date, as by --forcerun; no input."""
    if workflow.is_main_process:
        workflow.dag.forcefiles |= {f"steps/{step}.json" for step in stale_steps(STUDY)[0]}
    return []


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
