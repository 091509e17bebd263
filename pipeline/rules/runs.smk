rule batch:
    message: "Simulations of {wildcards.study}, batch {wildcards.batch} of {wildcards.batches}"
    input:
        study=study_file,
        motions=f"{HIDDEN}/motions.json",
    output: f"{HIDDEN}/runs/batch-{{batch}}of{{batches}}.csv",
    params:
        folder=lambda wildcards, output: Path(output[0]).absolute().parents[2],
    threads: lambda wildcards: study_of(wildcards.study).execution.workers or workflow.cores or 1
    log: f"{HIDDEN}/logs/batch-{{batch}}of{{batches}}.log",
    benchmark: f"{HIDDEN}/benchmarks/batch-{{batch}}of{{batches}}.tsv"
    shell:
        "archfrag batch {input.study:q} --batch {wildcards.batch} --cores {threads} --quiet"
        " --set output={params.folder:q} --set execution.batches={wildcards.batches} 2> {log:q}"
