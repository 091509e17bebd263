"""The run table and its parts."""

import errno
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from archfrag.study.parts import read_part, write_part

from archfrag.errors import InputError, OutputError
from archfrag.study.config import load_study
from archfrag.study.digests import PACKAGE
from archfrag.study.outcome import COLUMNS
from archfrag.study.plan import DECIDING, Plan, chunks_of_batch, make_plan, run_table
from archfrag.study.worker import run_chunk, run_chunks
from tests.study.small import files


class TestPlan:
    def test_runs_are_arch_by_record_by_level(self, done):
        table = run_table(done.plan)
        assert len(table) == done.plan.n_run == 2 * 2 * 3
        assert table["arch"].tolist() == ["ring"] * 6 + ["slab"] * 6
        assert table["record"].tolist() == (["wave0"] * 3 + ["wave1"] * 3) * 2
        np.testing.assert_allclose(
            table["level"].to_numpy().reshape(4, 3), [done.study.intensity.si] * 4
        )
        assert table["run"].tolist() == list(range(12))
        assert table["chunk"].tolist() == [run // 2 for run in range(12)]
        peak = 0.0
        for row, factor in zip(done.plan.records, table["factor"].to_numpy().reshape(2, 2, 3)[0]):
            np.testing.assert_array_equal(factor, row.factors)
            peak += factor[0]
        assert peak > 0.0

    def test_every_run_is_in_one_batch_and_one_chunk(self, done):
        seen = [
            run
            for batch in range(4)
            for chunk in chunks_of_batch(done.plan, batch, 4)
            for run in done.plan.rows(chunk)
        ]
        assert sorted(seen) == list(range(done.plan.n_run))
        with pytest.raises(InputError, match=r"--batch 4: must be from 0 to 3"):
            chunks_of_batch(done.plan, 4, 4)

    def test_stored_plan_is_the_same_plan(self, done):
        assert Plan.load(done.plan.path) == done.plan

    def test_workers_batches_title_and_folder_do_not_make_another_plan(self, done, tmp_path):
        study = done.study
        same = study.model_copy(
            update={
                "title": "Another title",
                "execution": study.execution.model_copy(update={"workers": 7, "batches": 3}),
            }
        )
        assert make_plan(same).identity == done.plan.identity

    @pytest.mark.parametrize(
        "override",
        ["arches.0.friction=0.6", "method.dt=1e-3", "method.follow=3", "execution.chunk=3"],
    )
    def test_whatever_changes_results_or_parts_makes_another_plan(self, done, override):
        path = done.study.folder.parent / "small.yaml"
        assert make_plan(load_study(path)).identity == done.plan.identity
        assert make_plan(load_study(path, [override])).identity != done.plan.identity

    def test_edited_kernels_make_another_plan(self, done, monkeypatch):
        monkeypatch.setattr("archfrag.study.plan.kernel_hash", lambda: "edited")
        assert make_plan(done.study).identity != done.plan.identity

    def test_all_that_a_simulation_passes_through_decides(self, done, monkeypatch):
        code = (
            "import sys, archfrag as af, numpy as np; af.simulate(af.Block(1.0, 2.0, 0.6), "
            "af.Motion(np.zeros(5), 0.01)); print(*(m.__file__ for n, m in sys.modules.items() "
            "if n.startswith('archfrag.')), sep='\\n')"
        )
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        passed = {str(Path(name).relative_to(PACKAGE)) for name in found.stdout.split()}
        assert "simulation/response.py" in passed
        # The motions that a worker takes are hashed as they were stored, not as code.
        elsewhere = ("motions/", "errors.py", "kernel_cache.py")
        decided = {
            str(path.relative_to(PACKAGE))
            for name in DECIDING
            for path in ([PACKAGE / name] if name.endswith(".py") else (PACKAGE / name).rglob("*"))
        }
        assert {name for name in passed if not name.startswith(elsewhere)} <= decided


class TestParts:
    def test_parts_hold_what_single_simulations_say(self, done):
        import archfrag as af
        from archfrag.study.records import load_record

        entry, record = done.study.arches[0], done.plan.records[1]
        response = af.simulate(
            entry.build(), load_record(done.study, record), scale=record.factors[2],
            method="time_stepping", dt=2e-3, follow=2.0,
        )  # fmt: skip
        run = 5
        assert done.plan.case(run) == (0, 1, 2)
        part = read_part(done.plan, run // 2)
        row = run % 2
        assert part["status"][row] == response.status
        assert part["peak_displacement"][row] == response.peak_displacement > 0.0
        assert part["steps"][row] == response.steps
        for name, count in response.events.items():
            assert part[name][row] == count
        for name in ("levels", "level_iterations", "general"):
            assert part[name][row] == response.work[name]
        assert part["impacts"][row] > 0
        assert part["model"].tolist() == list(response.model_time)
        assert part["model_time"][row].tolist() == list(response.model_time.values())

    def test_verdicts_differ_so_that_a_mix_up_would_show(self, done):
        verdicts = [read_part(done.plan, chunk)["verdict"] for chunk in range(done.plan.n_chunk)]
        assert set(np.concatenate(verdicts)) >= {0, 1}

    def test_running_a_chunk_again_gives_the_same_bytes(self, copied):
        copied.plan.save()
        before = copied.plan.part(2).read_bytes()
        copied.plan.part(2).unlink()
        run_chunk(str(copied.plan.path), 2)
        assert copied.plan.part(2).read_bytes() == before

    def test_a_damaged_foreign_or_older_part_counts_as_missing(self, copied):
        plan, path = copied.plan, copied.plan.part(3)
        whole = path.read_bytes()
        assert read_part(plan, 3) is not None
        for spoilt in (b"", whole[:-40], whole[:300] + b"\x00" * 8 + whole[308:]):
            path.write_bytes(spoilt)
            assert read_part(plan, 3) is None
        path.write_bytes(plan.part(2).read_bytes())
        assert read_part(plan, 3) is None
        path.write_bytes(whole)
        assert read_part(replace(plan, identity=plan.identity[:12] + "0" * 52), 3) is None
        table = read_part(plan, 3)
        table["steps"] = table["steps"][:1]
        write_part(plan, 3, table)
        assert read_part(plan, 3) is None
        path.unlink()
        assert read_part(plan, 3) is None

    def test_a_part_from_before_a_column_was_made_counts_as_missing(self, copied):
        table = read_part(copied.plan, 3)
        del table["hand_overs"]
        write_part(copied.plan, 3, table)
        assert read_part(copied.plan, 3) is None

    def test_disk_full_in_a_part_keeps_the_finished_ones(self, copied, monkeypatch):
        plan = copied.plan
        plan.save()
        for chunk in range(plan.n_chunk):
            plan.part(chunk).unlink()
        before = set(files(plan.part(0).parent))

        written = []

        def savez(file, **columns):
            written.append(file)
            if len(written) == 3:
                file.write(b"PK")
                raise OSError(errno.ENOSPC, "No space left on device")
            whole(file, **columns)

        whole = np.savez
        monkeypatch.setattr(np, "savez", savez)
        with pytest.raises(OutputError) as caught:
            run_chunks(str(plan.path), range(plan.n_chunk))
        assert str(caught.value).startswith(
            f"{plan.part(2)}: cannot be written (No space left on device)"
        )
        after = set(files(plan.part(0).parent))
        assert after - before == {plan.part(0).name, plan.part(1).name}
        assert read_part(plan, 1) is not None

    def test_columns_cover_every_value_once(self, done):
        names = [column.name for column in COLUMNS]
        assert len(set(names)) == len(names)
        part = read_part(done.plan, 0)
        assert set(part) == {*names, "model", "model_time"}
