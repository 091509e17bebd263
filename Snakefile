# `archfrag run STUDY` starts this; by hand: snakemake --cores 2 --config study=configs/shipped.yaml
from pathlib import Path

from archfrag.kernel_cache import kernel_hash
from archfrag.study.config import load_study
from archfrag.study.files import source_hash
from archfrag.study.plan import DECIDING, batch_file
from archfrag.study.records import find_sources

STUDY_FILE = str(Path(config["study"]).absolute())
STUDY = load_study(STUDY_FILE)
OUT = STUDY.output
BATCHES = STUDY.execution.batches
QUIET = "--quiet" if int(config.get("quiet", 0)) else ""


wildcard_constraints:
    batch=r"\d+",


localrules:
    all,
    motions,
    cube,
    fit,
    report,
    method_figures,


rule all:
    input:
        f"{OUT}/report.html",


include: "pipeline/rules/motions.smk"
include: "pipeline/rules/simulations.smk"
include: "pipeline/rules/results.smk"
include: "pipeline/rules/method.smk"
