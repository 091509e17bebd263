"""Plans, identities of runs, and the parts that hold their results."""

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from archfrag.errors import InputError
from archfrag.physics.kernels.cache import digest_of_syntax
from archfrag.study.file.schema import load_study
from archfrag.study.provenance import PACKAGE, files_of_code
from archfrag.study.runs.store import (
    COLUMNS,
    DECIDING,
    KEY,
    ROW,
    code_identity,
    gather,
    make_plan,
    places,
    read_part,
    read_parts,
    write_part,
)
from tests.study.small import command, dumped, files_below

# The arches of the study, with another id or friction of the ring.
RING = (
    "arches=[{id: %s, profile: circular, radius: 10.0, thickness: 1.5, embrace: 157.5, "
    "voussoirs: 7, friction: %g}, "
    "{id: slab, profile: block, width: 0.4, height: 2.0, friction: .inf}]"
)


def keys_of(plan):
    cases = np.concatenate([next(requests) for requests in plan.requests().values()])
    return {key.tobytes() for key in plan.keys(cases)}


class TestPlan:
    @pytest.mark.parametrize(
        ("override", "same"),
        [
            (RING % ("ring", 0.6), 6),
            ("method.dt=1e-3", 0),
            ("method.follow=3", 0),
            (RING % ("other", 0.7), 12),
            ("intensity.levels=[0.1, 0.6, 1.3]", 8),
            ("execution.chunk=3", 12),
            ("design.kind=ida", 12),
        ],
    )
    def test_whatever_changes_a_result_makes_other_runs_and_nothing_else(
        self, done, override, same
    ):
        path = done.study.folder.parent / "small.yaml"
        study = load_study(path, [override]).model_copy(
            update={"output": done.study.output}
        )
        plan = make_plan(study.model_copy(update={"design": done.study.design}))
        assert len(keys_of(done.plan) & keys_of(plan)) == same

    def test_all_that_a_simulation_passes_through_decides(self, done):
        code = (
            "import sys, archfrag as af, numpy as np; af.simulate(af.Block(1.0, 2.0, 0.6), "
            "af.Motion(np.zeros(5), 0.01)); print(*(m.__file__ for n, m in sys.modules.items() "
            "if n.startswith('archfrag.')), sep='\\n')"
        )
        found = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True
        )
        passed = {Path(name) for name in found.stdout.split()}
        # Arch and motion count as the kernels get them.
        elsewhere = (
            "arch/",
            "motions/",
            "files.py",
            "errors.py",
            "properties.py",
            "system.py",
            "version.py",
        )
        decides = {path for pattern in DECIDING for path in PACKAGE.glob(pattern)}
        left = {str(path.relative_to(PACKAGE)) for path in passed - decides}
        assert not [name for name in left if not name.startswith(elsewhere)]

    @pytest.mark.parametrize(
        ("file", "old", "new", "same"),
        [
            ("physics/contact/laws.py", "Signorini's and", "The laws of", True),
            ("simulation/springings.py", "import math", "import math  # why not", True),
            ("simulation/simulate.py", "there must be one", "give one", True),
            ("simulation/simulate.py", "BOUND = 1.02", "BOUND = 1.03", False),
            (
                "physics/methods/auto.py",
                "return _made_well",
                "return 1 and _made_well",
                False,
            ),
            ("physics/contact/laws.py", " < ", " <= ", False),
        ],
    )
    def test_words_do_not_decide_and_code_does(
        self, tmp_path, monkeypatch, file, old, new, same
    ):
        before = digest_of_syntax(tuple(files_of_code(*DECIDING)))
        copy = tmp_path / "archfrag"
        shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
        text = (copy / file).read_text()
        assert old in text
        (copy / file).write_text(text.replace(old, new))
        monkeypatch.setattr("archfrag.study.provenance.PACKAGE", copy)
        monkeypatch.setattr("archfrag.physics.kernels.cache.HOME", copy)
        assert (digest_of_syntax(tuple(files_of_code(*DECIDING))) == before) == same

    @pytest.mark.parametrize(
        ("field", "same"), [("long_name", True), ("comment", True), ("source", False)]
    )
    def test_labels_of_columns_do_not_decide(self, monkeypatch, field, same):
        before = code_identity()
        columns = [column._replace(**{field: "other"}) for column in COLUMNS]
        monkeypatch.setattr("archfrag.study.runs.store.COLUMNS", columns)
        assert (code_identity() == before) == same


class TestParts:
    def test_a_damaged_part_is_ignored(self, copied):
        plan = copied.plan
        parts = sorted(plan.parts.glob("*.npy"))
        full = parts[0].read_bytes()
        for spoilt in (
            b"",
            full[:-40],
            full[:300] + b"\x01" * 8 + full[308:],
            parts[1].read_bytes(),
        ):
            parts[0].write_bytes(spoilt)
            assert read_part(parts[0]) is None
            with pytest.raises(InputError, match="runs are missing or damaged"):
                gather(plan)

    def test_a_part_of_other_columns_counts_as_missing(self, copied):
        path = next(copied.plan.parts.glob("*.npy"))
        np.save(
            path, read_part(path)[[name for name in ROW.names if name != "switches"]]
        )
        digest = hashlib.blake2b(path.read_bytes(), digest_size=KEY).hexdigest()
        assert read_part(path.rename(path.with_stem(digest))) is None


def rows(keys, verdict):
    table = np.zeros(len(keys), ROW)
    table["key"] = keys
    table["verdict"] = verdict
    return table


def drawn(folder, seed, count):
    keys = np.frombuffer(np.random.default_rng(seed).bytes(count * KEY), f"S{KEY}")
    return write_part(folder, rows(keys, 1))


class TestStore:
    @pytest.mark.parametrize(
        "alike", [slice(0), slice(0, 8), slice(8, None), slice(None)]
    )
    def test_each_key_finds_its_row_and_no_other(self, tmp_path, alike):
        """Of keys that are alike in no byte, in the first or last half, or in all bytes."""
        generator = np.random.default_rng(1)
        text = generator.integers(0, 256, (6000, KEY)).astype(np.uint8)
        text[:, alike] %= 2
        keys = generator.permutation(
            np.unique(np.frombuffer(text.tobytes(), f"S{KEY}"))
        )
        stored = keys[: len(keys) // 2]
        other = keys[len(keys) // 2 :]
        verdict = generator.integers(0, 4, len(stored)).astype(np.int8)
        for some in np.array_split(np.arange(len(stored)), 7):
            write_part(tmp_path, rows(stored[some], verdict[some]))
        table = read_parts(tmp_path)
        there = places(table, np.concatenate([other, stored, stored[:5]])) >= 0
        assert there.tolist() == [False] * len(other) + [True] * (len(stored) + 5)
        np.testing.assert_array_equal(table[places(table, stored)]["verdict"], verdict)

    def test_clean_shows_what_is_of_no_use_asks_and_removes_it_alone(self, copied):
        """A study that grew and went back; parts of other kernels, one damaged, a user's file."""
        plan = copied.plan
        work = copied.study.work
        path = copied.study.folder / "study.yaml"
        path.write_text(dumped(copied.study))
        before = files_below(work)
        asked = ["clean", path]
        assert command(*asked).output.startswith("nothing to remove")
        other = plan.parts.with_name("0" * 12)
        other.mkdir()
        drawn(other, 5, 6)
        drawn(plan.parts, 6, 3)
        (plan.parts / f"{'0' * 32}.npy").write_bytes(b"torn")
        mine = {plan.parts / "mine.npy": b"mine", work / "parts" / "notes": b"mine"}
        for place, content in mine.items():
            place.write_bytes(content)
        full = files_below(work)
        refused = command(*asked, input="n\n")
        assert refused.exit_code == 1
        assert "1 file of runs of other kernels or another version, " in refused.output
        assert "1 file of runs that the study does not ask for, " in refused.output
        assert files_below(work) | {work / "lock": b""} == full | {work / "lock": b""}
        assert command(*asked, "--yes").exit_code == 0
        assert files_below(work) | {work / "lock": b""} == before | mine | {
            work / "lock": b""
        }
        assert not other.exists()
