# Not part of a study: snakemake --cores 1 --config study=STUDY -- method_figures
rule method_figures:
    message: "Draw the method on a single block"
    output:
        "../figures/block_regions.svg",
        "../figures/block_reactions.svg",
    params:
        kernels=kernel_hash(),
        source=source_hash("report"),
    log: "logs/method_figures.log",
    benchmark: "benchmarks/method_figures.tsv"
    shell: "archfrag figures method ../figures > {log:q}"
