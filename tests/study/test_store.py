"""Plans, identities of runs, and the parts that hold their results."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from archfrag.cli import main
from archfrag.errors import InputError
from archfrag.kernel_cache import HOLDS_NO_KERNEL, KERNEL_FOLDERS
from archfrag.study.config import dump_study, load_study
from archfrag.study.files import PACKAGE
from archfrag.study.plan import DECIDING, KEY, Plan, make_plan
from archfrag.study.store import (
    Gathered,
    Store,
    read_part,
    read_timing,
    replay,
    table_type,
    timings_folder,
    write_part,
    write_timing,
)  # fmt: skip
from tests.study.small import files_below, make_runs


def runs_of(plan):
    """All runs of a plan, their factors and keys."""
    cases = plan.rounds().wanted
    factors = plan.factors(cases)
    return cases, factors, plan.keys(cases, factors)


class TestPlan:
    @pytest.mark.parametrize("design", ["stripes", "ida", "two_stage", "scattered", "cloud"])
    def test_stored_plan_is_the_same_plan(self, copied, design):
        study = copied.study.model_validate(
            copied.study.model_dump() | {"design": {"kind": design}}
        )
        plan = make_plan(study)
        plan.save()
        again = Plan.load(plan.path)
        assert again == plan
        assert again.digest == plan.digest

    @pytest.mark.parametrize(
        ("override", "same"),
        [
            ("arches.0.friction=0.6", 6), ("method.dt=1e-3", 0), ("method.follow=3", 0),
            ("arches.0.id=other", 12), ("intensity.levels=[0.1, 0.6, 1.3]", 8),
            ("execution.chunk=3", 12), ("design.kind=ida", 12),
        ],
    )  # fmt: skip
    def test_whatever_changes_a_result_makes_other_runs_and_nothing_else(
        self, done, override, same
    ):
        path = done.study.folder.parent / "small.yaml"
        before = {key.tobytes() for key in runs_of(done.plan)[2]}
        study = load_study(path, [override]).model_copy(update={"output": done.study.output})
        plan = replace(make_plan(study), design={"kind": "stripes"})
        after = {key.tobytes() for key in runs_of(plan)[2]}
        assert len(before & after) == same

    def test_all_that_a_simulation_passes_through_decides(self, done):
        code = (
            "import sys, archfrag as af, numpy as np; af.simulate(af.Block(1.0, 2.0, 0.6), "
            "af.Motion(np.zeros(5), 0.01)); print(*(m.__file__ for n, m in sys.modules.items() "
            "if n.startswith('archfrag.')), sep='\\n')"
        )
        found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        passed = {str(Path(name).relative_to(PACKAGE)) for name in found.stdout.split()}
        assert "simulation/response.py" in passed
        # Arch and motion count as the kernels get them; a chain at rest is but checked; the
        # history and the response are those of a single run.
        elsewhere = ("arch/", "motions/", "errors.py", "kernel_cache.py", "simulate.py")
        names = ("history", "mechanism", "response", "rest", "warm")
        single = {f"simulation/{name}.py" for name in names}
        kernels = {
            str(path.relative_to(PACKAGE)) for folder in KERNEL_FOLDERS
            for path in (PACKAGE / folder).rglob("*.py") if path.name not in HOLDS_NO_KERNEL
        }  # fmt: skip
        found = {name for name in passed if not name.startswith(elsewhere)}
        assert {name for name in found if "__init__" not in name} <= {*DECIDING, *kernels, *single}


class TestParts:
    def test_a_damaged_part_is_ignored_and_made_again(self, copied):
        plan = copied.plan
        before = Gathered(plan).read()
        parts = sorted(plan.parts.glob("*.npy"))
        full = parts[0].read_bytes()
        for spoilt in (b"", full[:-40], full[:300] + b"\x01" * 8 + full[308:],
                       parts[1].read_bytes()):  # fmt: skip
            parts[0].write_bytes(spoilt)
            assert read_part(parts[0]) is None
            with pytest.raises(InputError, match="runs of round 1 are missing or damaged"):
                replay(plan, Store(plan.parts))
        make_runs(plan)
        after = Gathered(plan).read()
        for name, values in before.table.items():
            np.testing.assert_array_equal(after.table[name], values)

    def test_a_part_of_other_columns_counts_as_missing(self, copied):
        path = next(copied.plan.parts.glob("*.npy"))
        table = read_part(path)
        names = [name for name in table.dtype.names if name != "switches"]
        assert read_part(write_part(copied.plan.parts, table[names].copy())) is None
        assert read_part(write_part(copied.plan.parts, table["steps"].copy())) is None


def part_of(folder, keys, verdicts):
    """Write a part of made-up runs."""
    table = np.zeros(len(keys), table_type(("one",)))
    table["key"], table["verdict"] = keys, verdicts
    return write_part(folder, table)


def drawn(generator, count, alphabet=256):
    text = generator.integers(0, alphabet, (count, KEY)).astype(np.uint8)
    return np.frombuffer(text.tobytes(), f"V{KEY}")


class TestStore:
    @pytest.mark.parametrize("alike", ["nothing", "first half", "second half", "some bytes"])
    def test_places_are_those_of_a_dict(self, tmp_path, alike):
        generator = np.random.default_rng(1)
        keys = drawn(generator, 6000, 2 if alike == "some bytes" else 256)
        text = np.frombuffer(keys.tobytes(), np.uint8).reshape(-1, KEY).copy()
        if alike == "first half":
            text[:, :7] = 255
            text[:, 7] %= 3
        if alike == "second half":
            text[:, 8:] = 0
        keys = np.unique(np.frombuffer(text.tobytes(), f"V{KEY}"))
        keys = keys[generator.permutation(len(keys))]
        stored, other = keys[: len(keys) // 2], keys[len(keys) // 2 :]
        verdict = generator.integers(0, 4, len(stored)).astype(np.int8)
        for some in np.array_split(np.arange(len(stored)), 7):
            part_of(tmp_path, stored[some], verdict[some])
        known = {key.tobytes(): code for key, code in zip(stored, verdict)}
        asked = np.concatenate([other, stored, stored[:5]])
        expected = [known.get(key.tobytes(), -1) for key in asked]
        store = Store(tmp_path)
        assert store.verdicts(asked).tolist() == expected
        places = store.places(asked)
        assert ((places >= 0) == (np.array(expected) >= 0)).all()
        for _, rows, table, _ in store.rows(places):
            np.testing.assert_array_equal(table["key"], asked[rows])

    def test_a_part_damaged_while_it_is_read_is_reported(self, tmp_path):
        keys = drawn(np.random.default_rng(4), 3)
        path = part_of(tmp_path, keys, 1)
        store = Store(tmp_path)
        path.write_bytes(b"")
        assert not store.add(path)
        with pytest.raises(InputError, match="was damaged or removed while it was read"):
            list(store.rows(store.places(keys)))

    def test_clean_shows_what_is_of_no_use_asks_and_removes_it_alone(self, copied):
        """A study that grew and went back; parts of other kernels, one damaged, a user's file."""
        plan, work = copied.plan, copied.study.work
        path = copied.study.folder / "study.yaml"
        path.write_text(dump_study(copied.study))
        before = files_below(work)
        asked = ["clean", str(path)]
        assert CliRunner().invoke(main, asked).output.startswith("nothing to remove")
        other = plan.parts.with_name("0" * 12)
        for folder in (other, timings_folder(plan.parts), timings_folder(other)):
            folder.mkdir(exist_ok=True)
        write_timing(part_of(other, drawn(np.random.default_rng(5), 6), 1), np.arange(6.0))
        unasked = part_of(plan.parts, drawn(np.random.default_rng(6), 3), 1)
        write_timing(unasked, np.arange(3.0))
        assert read_timing(unasked, 3).tolist() == [0.0, 1.0, 2.0]
        assert np.isnan(read_timing(unasked, 2)).all()
        (plan.parts / f"{'0' * 32}.npy").write_bytes(b"torn")
        mine = {plan.parts / "mine.npy": b"mine", work / "parts" / "notes": b"mine"}
        for place, content in mine.items():
            place.write_bytes(content)
        full = files_below(work)
        refused = CliRunner().invoke(main, asked, input="n\n")
        assert refused.exit_code == 1
        assert "6 runs of other kernels or another version: 2 files, " in refused.output
        assert "3 runs that the study does not ask for: 2 files, " in refused.output
        assert files_below(work) == full | {work / "lock": b""}
        assert CliRunner().invoke(main, [*asked, "--yes"]).exit_code == 0
        assert files_below(work) == before | mine | {work / "lock": b""}
        assert not other.exists()
