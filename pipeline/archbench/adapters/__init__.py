"""Other people's solvers on the scenes: one adapter each, one contract.

A module ``<name>_adapter`` has ``VERSION`` and ``build(scene, dt) -> drive.Stepper``: the scene,
straight-sided and at its initial state, ready for steps of `dt` [s]. It imports its solver, numpy,
`archbench.scene` and modules of this folder: its interpreter may be another's. `drive.drive`
steps, clocks and judges all alike. `client` raises `SolverFailed` if an adapter raises. Steps that
the solver left unconverged are counted, and are no failure.
"""
