"""Columns of many runs straight from the kernels' arrays, and the keys of runs."""

import numpy as np

import archfrag as af
from archfrag.fragility.counts import Verdict
from archfrag.mechanics.status import CollapseMode
from archfrag.simulate import results_of_runs
from archfrag.simulation.response import response_of
from archfrag.study.runs.store import COLUMNS, columns_of

FACTORS = [0.0, 0.5, 2.0, 6.0]


def ring_and_wave():
    arch = af.Arch.circular(radius=10.0, thickness=1.5, embrace=157.5, voussoirs=7, friction=0.7)
    time = np.arange(100) * 0.01
    return arch, af.Motion(5.0 * np.sin(9.0 * time) * np.sin(np.pi * time), 0.01)


VERDICTS = {None: Verdict.UNFINISHED, False: Verdict.STANDING, True: Verdict.COLLAPSED}


def table_of(responses):
    """The columns by the responses' attributes, in the order of `COLUMNS`."""
    rows = []
    for each in responses:
        known = vars(each) | each.work | each.events
        failed = each.collapsed is None and each.status.name != "UNFINISHED"
        known["verdict"] = Verdict.SOLVER_FAILURE if failed else VERDICTS[each.collapsed]
        for name in ("collapse_mode", "lost_contact_mode"):
            known[name] = CollapseMode[known[name].upper()]
        known |= {"contact_residual": each.residual, "fallbacks": each.fallbacks}
        rows.append(known)
    table = {c.name: np.array([row[c.name] for row in rows], dtype=c.dtype) for c in COLUMNS}
    table["model_time"] = np.array([list(each.model_time.values()) for each in responses])
    return table


def assert_equal(first, second):
    assert set(first) == set(second)
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def test_every_column_has_a_value_of_its_own():
    """Arrays in which every entry differs, so that no two could be mixed up."""
    arch, motion = ring_and_wave()
    options = {"method": "time_stepping", "dt": 2e-3, "follow": 1.0}
    results, count = results_of_runs(arch, [motion] * 4, FACTORS, **options)[0], 0
    for array in (results.loss, results.count, results.energy, results.model_time, results.peak):
        array[:] = count + np.arange(array.size).reshape(array.shape)
        count += array.size
    results.loss[:, 2] = [0, 1, 2, 3]
    results.status[:] = [0, 1, 2, 4]
    results.energy[0] = 0.0
    responses = [response_of(results, row, "", 0.0) for row in range(4)]
    assert_equal(columns_of(results), table_of(responses))


def test_a_method_without_lanes_gives_the_same_columns():
    arch, motion = ring_and_wave()
    options = {"method": "event_driven", "rtol": 1e-3, "follow": 0.0}
    results, wall_time = results_of_runs(arch, [motion], [0.01], **options)
    one = af.simulate(arch, motion, scale=0.01, **options)
    assert wall_time.shape == (1,)
    assert_equal(columns_of(results), table_of([one]))
