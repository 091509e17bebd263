"""Other people's solvers, and archfrag, on the scenes: one adapter each, one contract.

**What an adapter gets.** A module ``<name>_adapter`` has ``VERSION``, the solver's name and
version; ``SETTINGS``, its settings with their defaults, all that a request may set; and
``build(scene, dt, settings) -> drive.Stepper``: the scene, straight-sided and at its initial
state, ready for steps of `dt` [s]. ``prepare()``, if there is one, compiles before anything is
clocked. A solver that does not step by itself has ``run(scene, dt, settings, history=...) ->
drive.Outcome`` in the place of ``build``. An adapter imports its solver, numpy, `archbench.scene`
and modules of this folder; only archfrag's own imports more of archfrag.

**What it returns.** `drive.drive` steps it with the mean ground acceleration of each step,
samples centroids in the ground's frame every `sampling` seconds, and judges collapse: a centroid
more than two thicknesses from its place. All solvers are clocked and judged by the same lines.

**How a failure is reported.** An adapter raises. `worker` reports the exception as one line, and
`client` raises `SolverFailed` with solver, scene and step; the same where positions are not
finite or too fast to be a motion, where there is no answer within the limit, or where the process
ends. A run that failed has no `Outcome`. Steps whose contact problem the solver left unconverged
are no failure but are counted in `Outcome.unconverged`; None if the solver does not report them.
"""
