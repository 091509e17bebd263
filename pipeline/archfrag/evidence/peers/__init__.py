"""Other people's solvers on our scenes, each behind one adapter with one signature."""
