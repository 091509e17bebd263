"""Other people's solvers on the scenes: one adapter each, one contract.

A module ``<name>_adapter`` has ``VERSION``, the solver's name and version, and ``build(scene, dt)
-> drive.Stepper``: the scene, straight-sided and at its initial state, ready for steps of `dt`
[s]. ``prepare()``, if there is one, compiles before anything is clocked. An adapter imports its
solver, numpy, `archbench.scene` and modules of this folder: its interpreter may be another's.

`drive.drive` steps, clocks and judges all of them by the same lines. An adapter raises where it
fails; `worker` reports this as one line, and `client` raises `SolverFailed`, as it does where
positions are no motion, where there is no answer within the limit, or where the process ends.
Steps whose contact problem the solver left unconverged are no failure but are counted.
"""
