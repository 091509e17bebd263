rule motions:
    message: "Read and scale the records of {STUDY.id}"
    input:
        study=STUDY_FILE,
        records=[str(source.path) for source in find_sources(STUDY)],
    output: f"{OUT}/motions.json",
    params:
        source=source_hash("motions"),
    log: f"{OUT}/logs/motions.log",
    benchmark: f"{OUT}/benchmarks/motions.tsv"
    shell: "archfrag motions {input.study:q} --log {log:q}"
