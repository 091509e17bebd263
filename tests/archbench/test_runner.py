"""Tasks with time limits that are not done twice, and the command's refusals."""

import math
import time

import pandas as pd
import pytest

from archbench import runner
from archbench.command import gather
from archbench.growth import exponents_table
from archbench.runner import Bench, in_processes, load_tables
from archfrag.errors import InputError


def nap(seconds):
    """Sleep, and return how long."""
    time.sleep(seconds)
    return seconds


def leave(code):
    """End the process."""
    import os

    os._exit(code)


def test_what_takes_too_long_is_ended_and_all_else_is_done():
    began = time.monotonic()
    tasks = {(k,): (seconds,) for k, seconds in enumerate((0.2, 600.0, 0.0, 0.1))}
    found = dict(in_processes(nap, tasks, 2, 3.0, prepare=int))
    assert found == {(0,): 0.2, (1,): "not ended within 3 s", (2,): 0.0, (3,): 0.1}
    assert time.monotonic() - began < 60.0


def test_a_process_that_ends_by_itself_is_reported():
    found = dict(in_processes(leave, {("a",): (3,)}, 1, 30.0, prepare=int))
    assert found == {("a",): "its process ended by itself"}


def test_finished_tasks_are_not_done_again_and_a_cut_line_is(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "load_kernels", int)
    monkeypatch.setattr(runner, "sources", lambda: "one")
    asked = []

    def pretend(function, tasks, *_):
        asked.append(list(tasks))
        return [(key, function(*task)) for key, task in tasks.items()]

    monkeypatch.setattr(runner, "in_processes", pretend)
    bench = Bench(tmp_path, report=lambda _: None)
    tasks = {("a", 1): (3, 4), ("b", 2): (5, 6)}
    assert bench.run("sums", math.hypot, tasks, 1.0) == {
        ("a", 1): 5.0, ("b", 2): pytest.approx(61**0.5)
    }  # fmt: skip
    file = next((tmp_path / "finished").glob("sums-one.jsonl"))
    file.write_text("\n".join((file.read_text().splitlines()[0], '[["b", 2], 7.8')) + "\n")
    bench.run("sums", math.hypot, tasks, 1.0)
    monkeypatch.setattr(runner, "sources", lambda: "other")
    bench.run("sums", math.hypot, tasks, 1.0)
    assert asked == [[("a", 1), ("b", 2)], [("b", 2)], [("a", 1), ("b", 2)]]


def test_tables_come_back_as_they_were_saved(tmp_path):
    table = pd.DataFrame({"method": ["auto"], "seconds": [0.25]})
    Bench(tmp_path, report=lambda _: None).save("growth", {"runs": table})
    pd.testing.assert_frame_equal(load_tables(tmp_path, "growth")["runs"], table)
    (tmp_path / "growth_runs.csv").write_bytes(b"")
    with pytest.raises(InputError, match=r"growth_runs\.csv"):
        load_tables(tmp_path, "growth")


@pytest.mark.parametrize(
    ("parts", "solvers", "words"),
    [
        (["sped"], [], "no part 'sped'; allowed are speed, frag"),
        ([], ["mujuco"], "'mujuco'; allowed"),
    ],
)
def test_an_unknown_name_is_refused_before_anything_is_written(tmp_path, parts, solvers, words):
    with pytest.raises(InputError, match=words):
        gather(parts, tmp_path / "out", solvers=solvers)
    assert not (tmp_path / "out").exists()


def test_exponent_of_a_power_law():
    rows = [("auto", n, 1e-3 * n**1.5 * (1.0 + 0.01 * k), 2.0)
            for n in (7, 14, 28, 56) for k in (-1, 0, 1)]  # fmt: skip
    runs = pd.DataFrame(rows, columns=["method", "voussoirs", "seconds", "moving_seconds"])
    row = exponents_table(runs).iloc[0]
    assert row["exponent"] == pytest.approx(1.5)
    assert row["low"] <= 1.5 <= row["high"]
