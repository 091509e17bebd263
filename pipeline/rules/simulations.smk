rule batch:
    message: "Simulations, batch {wildcards.batch} of {BATCHES}"
    input:
        study=STUDY_FILE,
        motions=f"{OUT}/motions.json",
    output: str(batch_file(STUDY.folder, "{batch}", BATCHES)),
    params:
        kernels=kernel_hash(),
        source=source_hash(*DECIDING, "study"),
        quiet=QUIET,
    threads: STUDY.execution.workers or workflow.cores or 1
    log: f"{OUT}/logs/batch-{{batch}}.log",
    benchmark: f"{OUT}/benchmarks/batch-{{batch}}.tsv"
    shell:
        "archfrag batch {input.study:q} --batch {wildcards.batch} --workers {threads}"
        " {params.quiet} --log {log:q}"
