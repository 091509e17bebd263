# One process: what starts three times as long as it works costs a small study more than its runs.
rule results:
    message: "Gather the cube of {STUDY.id}, fit its curves, write its report"
    input:
        motions="steps/motions.json",
        batches=[f"steps/{batch_step(batch, BATCHES)}.json" for batch in range(BATCHES)],
    output: "steps/report.json",
    log: "logs/results.log",
    benchmark: "benchmarks/results.tsv"
    shell: "archfrag results {STUDY_FILE:q} --log {log:q} 2>&1"
