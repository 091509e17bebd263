rule cube:
    message: "Gather the cube of {STUDY.id}"
    input:
        motions="steps/motions.json",
        batches=[f"steps/{batch_step(batch, BATCHES)}.json" for batch in range(BATCHES)],
    output: "steps/cube.json",
    log: "logs/cube.log",
    benchmark: "benchmarks/cube.tsv"
    shell: "archfrag cube {STUDY_FILE:q} --log {log:q} 2>&1"


rule fit:
    message: "Fit the fragility curves of {STUDY.id}"
    input: "steps/cube.json",
    output: "steps/fit.json",
    log: "logs/fit.log",
    benchmark: "benchmarks/fit.tsv"
    shell: "archfrag fit {STUDY_FILE:q} --log {log:q} 2>&1"


rule report:
    message: "Write the report of {STUDY.id}"
    input:
        motions="steps/motions.json",
        cube="steps/cube.json",
        fits="steps/fit.json",
    output: "steps/report.json",
    log: "logs/report.log",
    benchmark: "benchmarks/report.tsv"
    shell: "archfrag report {STUDY_FILE:q} --log {log:q} 2>&1"
