"""Methods of integration: one file or folder for each, with one signature."""
