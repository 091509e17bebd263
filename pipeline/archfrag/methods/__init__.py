"""How the mechanics is integrated: one file for each method, one signature."""
