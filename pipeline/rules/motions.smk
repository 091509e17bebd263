def record_files(wildcards):
    from archfrag.study.file.sources import find_sources

    study = study_of(wildcards.study)
    sources = find_sources(study.motions, study.intensity.measure)
    return [str(source.path) for source in sources]


rule motions:
    message: "Read and scale the records of {wildcards.study}"
    input:
        study=study_file,
        records=record_files,
    output: f"{HIDDEN}/motions.json",
    params:
        folder=lambda wildcards, output: Path(output[0]).absolute().parents[1],
    log: f"{HIDDEN}/logs/motions.log",
    benchmark: f"{HIDDEN}/benchmarks/motions.tsv"
    shell: "archfrag motions {input.study:q} --set output={params.folder:q} 2> {log:q}"
