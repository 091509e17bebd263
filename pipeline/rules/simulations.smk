rule batch:
    message: "Simulations, batch {wildcards.batch} of {BATCHES}"
    input: "steps/motions.json",
    output: "steps/" + batch_step("{batch}", BATCHES) + ".json",
    params:
        quiet=QUIET,
    threads: STUDY.execution.workers or workflow.resource_settings.cores or 1
    log: "logs/batch-{batch}.log",
    benchmark: "benchmarks/batch-{batch}.tsv"
    shell:
        "archfrag batch {STUDY_FILE:q} --batch {wildcards.batch} --cores {threads}"
        " {params.quiet} --log {log:q} 2>&1"
