"""The slow twin: the paper's formulas in plain numpy, named and numbered as in the paper.

The kernels of `archfrag.physics` are tested against them; the site's pages draw with them.
"""
