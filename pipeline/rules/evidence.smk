# Not part of a study: snakemake --cores 2 --config study=STUDY -- evidence
rule evidence:
    message: "Measure speed against accuracy, and where methods fail (less than 20 minutes)"
    output: "../evidence/guide.html",
    params:
        kernels=kernel_hash(),
        source=source_hash("evidence"),
    log: "logs/evidence.log"
    benchmark: "benchmarks/evidence.tsv"
    threads: 2
    shell: "archfrag evidence --quick --out ../evidence 2> {log:q}"
