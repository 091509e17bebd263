"""The slow twin: the paper's formulas in plain numpy, named and numbered as in the paper.

The kernels of `archfrag.mechanics` are tested against them, and the site's pages of the method
draw with them. A physicist reads here first; nothing of archfrag imports it.
"""
