# Not part of a study: snakemake --cores 2 --config study=STUDY -- evidence
rule evidence:
    message: "Measure speed against accuracy, and where methods fail (less than 20 minutes)"
    output:
        f"{OUT}/evidence/guide.html",
    params:
        folder=f"{OUT}/evidence",
        kernels=kernel_hash(),
        source=source_hash("evidence"),
    log: f"{OUT}/logs/evidence.log"
    benchmark: f"{OUT}/benchmarks/evidence.tsv"
    threads: 2
    shell: "archfrag evidence --quick --out {params.folder:q} 2> {log:q}"
