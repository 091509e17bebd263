rule motions:
    message: "Read and scale the records of {STUDY.id}"
    input: force_stale,
    output: "steps/motions.json",
    log: "logs/motions.log",
    benchmark: "benchmarks/motions.tsv"
    shell: "archfrag motions {STUDY_FILE:q} --log {log:q} 2>&1"
