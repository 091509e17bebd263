rule cube:
    message: "Gather the cube of {STUDY.id}"
    input:
        study=STUDY_FILE,
        motions=f"{OUT}/motions.json",
        batches=[str(batch_file(STUDY.folder, batch, BATCHES)) for batch in range(BATCHES)],
    output:
        f"{OUT}/cube.nc",
        f"{OUT}/timings.csv",
    params:
        kernels=kernel_hash(),
        source=source_hash("study"),
    log: f"{OUT}/logs/cube.log",
    benchmark: f"{OUT}/benchmarks/cube.tsv"
    shell: "archfrag cube {input.study:q} --log {log:q}"


rule fit:
    message: "Fit the fragility curves of {STUDY.id}"
    input:
        study=STUDY_FILE,
        cube=f"{OUT}/cube.nc",
    output: f"{OUT}/fits.json",
    params:
        source=source_hash("fragility"),
    log: f"{OUT}/logs/fit.log",
    benchmark: f"{OUT}/benchmarks/fit.tsv"
    shell: "archfrag fit {input.study:q} --log {log:q}"


rule report:
    message: "Write the report of {STUDY.id}"
    input:
        study=STUDY_FILE,
        motions=f"{OUT}/motions.json",
        cube=f"{OUT}/cube.nc",
        timings=f"{OUT}/timings.csv",
        fits=f"{OUT}/fits.json",
    output: f"{OUT}/report.html",
    params:
        source=source_hash("report"),
    log: f"{OUT}/logs/report.log",
    benchmark: f"{OUT}/benchmarks/report.tsv"
    shell: "archfrag report {input.study:q} --log {log:q}"
