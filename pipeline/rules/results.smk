def tables_of_runs(wildcards):
    batches = study_of(wildcards.study).execution.batches
    table = f"{HIDDEN}/runs/batch-{{batch}}of{batches}.csv"
    return expand(table, study=wildcards.study, batch=range(batches))


rule cube:
    message: "Gather the cube of {wildcards.study}"
    input:
        study=study_file,
        runs=tables_of_runs,
    output: f"{FOLDER}/cube.nc",
    params:
        folder=lambda wildcards, output: Path(output[0]).absolute().parent,
    log: f"{HIDDEN}/logs/cube.log",
    benchmark: f"{HIDDEN}/benchmarks/cube.tsv"
    shell: "archfrag cube {input.study:q} --set output={params.folder:q} 2> {log:q}"


rule fit:
    message: "Fit the curves of {wildcards.study}"
    input:
        study=study_file,
        cube=f"{FOLDER}/cube.nc",
    output:
        f"{FOLDER}/fits.json",
        report(f"{FOLDER}/curve.csv", category="{study}"),
    params:
        folder=lambda wildcards, output: Path(output[0]).absolute().parent,
    log: f"{HIDDEN}/logs/fit.log",
    benchmark: f"{HIDDEN}/benchmarks/fit.tsv"
    shell: "archfrag fit {input.study:q} --set output={params.folder:q} 2> {log:q}"


rule report:
    message: "Write the report of {wildcards.study}"
    input:
        study=study_file,
        cube=f"{FOLDER}/cube.nc",
        fits=f"{FOLDER}/fits.json",
    output:
        report(f"{FOLDER}/report.html", category="{study}"),
        capacities=f"{FOLDER}/capacities.csv",
        runs=f"{FOLDER}/runs.csv",
        readme=f"{FOLDER}/README.txt",
    params:
        folder=lambda wildcards, output: Path(output[0]).absolute().parent,
    log: f"{HIDDEN}/logs/report.log",
    benchmark: f"{HIDDEN}/benchmarks/report.tsv"
    shell: "archfrag report {input.study:q} --set output={params.folder:q} 2> {log:q}"
