"""Plans, identities of runs, and the parts that hold their results."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.study.config import load_study
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
from tests.study.small import make_runs


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
        # The motions that a worker takes are hashed as they were stored, not as code.
        elsewhere = ("motions/", "errors.py", "kernel_cache.py")
        decided = {
            str(path.relative_to(PACKAGE))
            for name in DECIDING
            for path in ([PACKAGE / name] if name.endswith(".py") else (PACKAGE / name).rglob("*"))
        }
        assert {name for name in passed if not name.startswith(elsewhere)} <= decided


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

    def test_what_is_damaged_or_of_other_code_goes_and_nothing_else(self, tmp_path):
        parts, other = tmp_path / "parts" / "now", tmp_path / "parts" / "before"
        for folder in (parts, timings_folder(parts), other):
            folder.mkdir(parents=True)
        keys = drawn(np.random.default_rng(5), 6)
        made, late = part_of(parts, keys[:3], 1), part_of(other, keys[3:], 0)
        (parts / f"{'0' * 32}.npy").write_bytes(b"torn")
        write_timing(made, np.arange(3.0))
        store = Store(parts)
        late = late.rename(parts / late.name)  # by another batch meanwhile
        assert store.tidy() == 1
        assert set(parts.iterdir()) == {made, late, timings_folder(parts)}
        assert not other.exists()
        assert read_timing(made, 3).tolist() == [0.0, 1.0, 2.0]
        assert np.isnan(read_timing(made, 2)).all()
        assert np.isnan(read_timing(late, 3)).all()
