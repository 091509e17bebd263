# Not part of a study: snakemake --cores 1 --config study=STUDY -- method_figures
rule method_figures:
    message: "Draw the method on a single block"
    output:
        f"{OUT}/figures/block_regions.svg",
        f"{OUT}/figures/block_reactions.svg",
    params:
        folder=f"{OUT}/figures",
        kernels=kernel_hash(),
        source=source_hash("report"),
    log: f"{OUT}/logs/method_figures.log",
    benchmark: f"{OUT}/benchmarks/method_figures.tsv"
    shell: "archfrag figures method {params.folder:q} > {log:q}"
