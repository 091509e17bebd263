"""The command: quick to answer, one message and an exit code for what is wrong."""

import json
import os
import resource
import shlex
import subprocess
import sys

import numpy as np
import pytest

import archfrag as af
from archfrag.cli import COMMANDS
from archfrag.cli.records import records
from archfrag.study.file.schema import load_study
from tests.arch.test_drawing import PIER, draw, draw_arch
from tests.study.small import ROOT, TEXT, command, make_runs, small_study, write_at2

ARCH = shlex.split(
    "--radius 10 --thickness 1.5 --embrace 157.5 --voussoirs 7 --friction 0.7"
)
THIN = [*ARCH[:3], "0.3", *ARCH[4:]]


def refused(*arguments):
    result = command(*arguments)
    assert result.stderr.startswith("archfrag: error: ")
    assert result.stderr.count("\n") == 1
    return result.exit_code, result.stderr.removeprefix("archfrag: error: ").rstrip(
        "\n"
    )


def started(*arguments, code=0, **environment):
    """What the command writes on standard error in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "archfrag", *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr


class TestProcess:
    """The command as a process: its module, its environment and its signals."""

    def test_it_is_a_module(self):
        assert "archfrag 0" in subprocess.check_output(
            [sys.executable, "-m", "archfrag", "--version"], text=True
        )

    @pytest.mark.parametrize(
        "start",
        [
            "from importlib.metadata import entry_points as points; (point,) = "
            "points(group='console_scripts', name='archfrag'); point.load()()",
            "import runpy; runpy.run_module('archfrag', run_name='__main__')",
        ],
        ids=["script", "module"],
    )
    @pytest.mark.parametrize(
        ("given", "found"),
        [({}, ["1", "1"]), ({"OMP_NUM_THREADS": "3"}, ["None", "3"])],
        ids=["one thread", "the user's number"],
    )
    def test_linear_algebra_has_one_thread(
        self, start, given, found, tmp_path, monkeypatch
    ):
        """Numpy reads the variables at its import; collections of garbage are rarer by then."""
        (tmp_path / "numpy.py").write_text(
            "import gc, os, sys; print(*map(os.environ.get, ['OPENBLAS_NUM_THREADS', "
            "'OMP_NUM_THREADS']), gc.get_threshold()[0] > 10_000); sys.exit()"
        )
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            monkeypatch.delenv(name, raising=False)
        places = [str(tmp_path), *sys.path]
        code = f"import sys; sys.path = {places}; sys.argv[1:] = ['validate', 'lost']; {start}"
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            env={**os.environ, **given},
        )
        assert done.stdout.split() == [*found, "True"], done.stderr

    @pytest.mark.parametrize(
        "asked", ["error", "e::DeprecationWarning", "error::UserWarning"]
    )
    def test_warnings_end_no_command(self, asked):
        thick = [*ARCH[:3], "700", *ARCH[4:]]  # probably mm: a warning of our own
        assert "archfrag: " in started("onset", *thick, code=2, PYTHONWARNINGS=asked)
        started("onset", *ARCH, PYTHONWARNINGS=asked)

    def test_a_warning_is_a_sentence(self):
        code = (
            "import warnings; from archfrag.cli import main; import archfrag.cli.arch as arch;"
            "arch.unit_cautions = lambda _: warnings.warn('it is late') or [];"
            f"main({['onset', *ARCH]})"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True
        )
        assert done.stderr.splitlines()[0] == "archfrag: warning: it is late"

    @pytest.mark.parametrize("module", ["archfrag.cli", "archfrag.cli.arch", "numpy"])
    def test_ctrl_c_while_it_imports_is_a_sentence(self, module):
        code = (
            "import os, signal, sys\n"
            "class Interrupt:\n"
            "    def find_spec(self, name, path=None, target=None):\n"
            f"        if name == {module!r}: os.kill(os.getpid(), signal.SIGINT)\n"
            "sys.meta_path.insert(0, Interrupt())\n"
            "from archfrag.__main__ import main\n"
            f"sys.argv = ['archfrag', 'onset', *{ARCH}]\n"
            "main()"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True
        )
        assert (done.returncode, done.stderr) == (130, "archfrag: stopped by SIGINT\n")

    @pytest.mark.parametrize(
        ("name", "given", "why"),
        [
            ("NUMBA_DISABLE_JIT", "1", "is set"),
            ("ARCHFRAG_LANES", "6", "is '6'; it must be 4 or 8"),
        ],
    )
    @pytest.mark.parametrize(
        "words", [["warmup"], ["run", str(ROOT / "configs" / "tiny.yaml")]]
    )
    def test_a_variable_with_which_nothing_runs_is_said(
        self, words, name, given, why, tmp_path
    ):
        more = ["--set", f"output={tmp_path}"] if words[0] == "run" else []
        said = started(*words, *more, code=2, **{name: given})
        assert f"error: {name} {why}" in said
        assert "unset" in said

    def test_an_empty_variable_is_none(self):
        said = started("simulate", *ARCH, "nothing.AT2", code=2, NUMBA_DISABLE_JIT="")
        assert "NUMBA" not in said

    def test_methods_are_listed(self):
        for name in ("simulate", "warmup"):
            assert "[time_stepping|event_driven|auto]" in command(name, "--help").output
        wrong = command("simulate", *ARCH, "nothing.AT2", "--method", "steps")
        assert wrong.exit_code == 2
        assert "'time_stepping', 'event_driven', 'auto'" in wrong.stderr


class TestHelp:
    @pytest.mark.parametrize("asked", [["--help"], ["run", "--help"]])
    def test_it_imports_nothing_heavy_and_is_quick(self, asked):
        code = (
            f"import sys; from archfrag.cli import main; main({asked}, standalone_mode=False); "
            "sys.stderr.write(' '.join(sys.modules))"
        )
        took = []
        for _ in range(3):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            found = subprocess.run(
                [sys.executable, "-c", code], capture_output=True, text=True, check=True
            )
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            took.append(
                after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            )
        loaded = set(found.stderr.split())
        assert "click" in loaded
        heavy = "numpy numba pydantic yaml dask obspy snakemake email"
        assert not loaded & set(heavy.split(" "))
        assert min(took) < 0.3

    @pytest.mark.parametrize("group", [[], ["records"]])
    def test_every_command_explains_itself(self, group):
        listed = command(*group, "--help").output.split("Commands:")[1]
        assert "..." not in listed
        for name in COMMANDS if not group else records.commands:
            assert name in listed
            text = command(*group, name, "--help").output
            assert group or COMMANDS[name][1] in " ".join(text.split())
            assert not group or f"archfrag records {name}" in text.split("Example:")[1]


class TestOnset:
    def test_by_numbers_in_text_json_and_a_figure(self, tmp_path):
        result = command("onset", *ARCH)
        assert result.exit_code == 0
        assert result.output.splitlines()[0] == (
            "ground towards +x: moves from 0.3700 g: joint 0 extrados, joint 2 intrados, "
            "joint 4 extrados, joint 7 intrados"
        )
        figure = tmp_path / "a.svg"
        facts = json.loads(command("onset", *ARCH, "--json", "--figure", figure).output)
        assert figure.read_text().startswith("<svg ")
        assert facts["plus"] == pytest.approx(0.37, abs=1e-4)
        assert facts["hinges"][0] == [0, "extrados"]

    def test_of_a_study(self, tmp_path):
        path = small_study(tmp_path)
        text = command("onset", "--study", path, "--arch", "slab").output
        assert "moves from 0.2000 g: joint 0" in text
        for more, wrong in (
            ([], "is missing"),
            (["--arch", "x"], "x: there is no such arch"),
        ):
            message = f"{path}: --arch {wrong}; the study has ring, slab"
            assert refused("onset", "--study", path, *more) == (2, message)

    @pytest.mark.parametrize("count", [12, 13])
    def test_of_a_drawing_it_says_what_was_read(self, tmp_path, count):
        arch = af.Arch.segmental(
            span=10.0, rise=2.5, thickness=0.6, voussoirs=count, friction=0.6
        )
        draw_arch(tmp_path / "b.dxf", arch, 0.01, 5)
        asked = ("onset", "--drawing", tmp_path / "b.dxf", "--friction", "0.6")
        result = command(*asked)
        # Radius 6.25 m and half an angle whose sine is 0.8, less 0.3 m; the rise is of a joint.
        rise = 5.95 * np.cos(np.arcsin(0.8) / count * (count % 2)) - 5.95 * 0.6
        weight = arch.chain.mass.sum() * arch.chain.gravity / 1e3
        read, _, rest = result.stderr.partition("; ")
        assert (
            read
            == f"archfrag: clear span 9.52 m, rise {rise:.3g} m, mean thickness 0.6 m"
        )
        assert rest.startswith(f"{count} voussoirs, {count + 1} joints; ")
        assert rest.endswith(f"; {weight:.3g} kN; from b.dxf, layer STONE, in cm\n")
        mistaken = command(*asked, "--drawing-unit", "mm")
        # The onset does not tell them apart; the span, the weights and hinges 10 mm inside do.
        onsets = [
            [line for line in each.stdout.splitlines() if line.startswith("ground")]
            for each in (mistaken, result)
        ]
        assert len(onsets[0]) == 2
        assert onsets[0] == onsets[1]
        assert mistaken.stderr.startswith("archfrag: clear span 0.952 m, rise 0.23")
        assert "; from b.dxf, layer STONE, in mm\n" in mistaken.stderr
        assert json.loads(command(*asked, "--json").stdout)["stands"]

    @pytest.mark.parametrize(
        ("code", "read"), [(4, ("mm", "0.238 m")), (6, ("m", "238 m"))]
    )
    def test_a_span_that_cannot_be_meant_names_the_unit(self, tmp_path, code, read):
        arch = af.Arch.segmental(
            span=10.0, rise=2.5, thickness=0.6, voussoirs=9, friction=0.6
        )
        draw_arch(tmp_path / "b.dxf", arch, 0.04, code)
        given = "--drawing", tmp_path / "b.dxf", "--friction", "0.6"
        doubt = f"span = {read[1]}: usual are 0.3 to 200 m; is that its unit?\n"
        found = command("onset", *given).stderr
        assert f"in {read[0]}\n" in found
        assert f"\narchfrag: caution: {doubt}" in found
        text = TEXT.replace("profile: block, width: 0.4, height: 2.0", "drawing: b.dxf")
        path = small_study(tmp_path, text.replace("friction: .inf", "friction: 0.6"))
        result = command("validate", path)
        assert result.stdout.splitlines()[1].startswith(f"  slab: clear span {read[1]}")
        assert f"archfrag: caution: slab: {doubt}" in result.stderr
        assert doubt in command("onset", "--study", path, "--arch", "slab").stderr
        recessed = text.replace(
            "friction: .inf", "friction: 0.6, recess: {intrados: 1.0e-3}"
        )
        law = "{distribution: lognormal, median: 1.0, beta: 0.5, relative: true}"
        vary = f"{{samples: 1, of: {{joints.stiffness: {law}}}}}"
        soft = f"0.6, joints: {{stiffness: 3e+10}}, vary: {vary}"
        for other in (recessed, text.replace("friction: .inf", f"friction: {soft}")):
            again = command("validate", small_study(tmp_path, other))
            assert again.stdout.splitlines()[1] == result.stdout.splitlines()[1]

    def test_of_a_column_it_says_the_height(self, tmp_path):
        draw(tmp_path / "pier.dxf", PIER)
        result = command(
            "onset", "--drawing", tmp_path / "pier.dxf", "--friction", "0.6"
        )
        assert result.stderr.startswith(
            "archfrag: height 1.5 m, mean thickness 1 m; 3 "
        )

    def test_of_an_arch_that_varies_as_given_and_as_sampled(self, tmp_path):
        vary = (
            "samples: 2, of: {height: {distribution: uniform, start: 3.0, stop: 4.0}}"
        )
        text = TEXT.replace("friction: .inf}", f"friction: .inf, vary: {{{vary}}}}}")
        path = small_study(tmp_path, text)
        given = command("onset", "--study", path, "--arch", "slab")
        assert "moves from 0.2000 g" in given.stdout
        assert given.stderr == (
            "archfrag: slab as given, without vary; its 2 samples are --arch slab-0001 and so on\n"
        )
        sampled = command("onset", "--study", path, "--arch", "slab-0002")
        assert (sampled.stderr, "moves from 0.1" in sampled.stdout) == ("", True)
        ring = text[text.index("  - {id: ring") : text.index("  - {id: slab")]
        path.write_text(text.replace(ring, ""))
        assert command("onset", "--study", path).stdout == given.stdout

    def test_it_says_what_hinges_inside_the_edges_do(self):
        text = command("onset", *ARCH)
        assert (
            "\nhinges 10 mm inside the edges of the joints lower the onset of motion by 2.0 %"
            in text.stdout
        )
        facts = json.loads(command("onset", *ARCH, "--json").stdout)
        assert facts["loss_10_mm"] == pytest.approx(0.0196, abs=1e-4)
        assert (facts["cautions"], text.stderr) == ([], "")
        narrow = shlex.split(
            "onset --profile block --width 0.1 --height 1 --friction 1"
        )
        assert "caution: hinges 10 mm inside the edges" in command(*narrow).stderr
        assert len(json.loads(command(*narrow, "--json").stdout)["cautions"]) == 1

    def test_an_arch_that_does_not_stand_is_a_result(self):
        result = command("onset", *THIN)
        text, facts = result.output.splitlines()
        assert (result.exit_code, text) == (0, "does not stand under its own weight")
        assert facts.startswith(
            "the ring weighs 162 kN; springings at (-9.661, 1.922) and (9.66"
        )
        assert json.loads(command("onset", *THIN, "--json").output)["stands"] is False


def test_simulate_scales_a_record_to_a_peak(tmp_path):
    record = write_at2(tmp_path / "wave.AT2", 0.3 * np.sin(0.08 * np.arange(150)), 0.01)
    result = command("simulate", *ARCH, record, "--pga", "0.2", "--json", "--mechanism")
    facts = json.loads(result.output)
    assert facts["status"] == "standing"
    assert facts["scale"] == pytest.approx(0.2 / 0.3, rel=1e-3)
    assert (facts["collapse_time"], facts["peak_displacement"]) == (None, 0.0)
    assert set(facts["mechanism"][0]) == {
        "time",
        "until",
        "cause",
        "joint",
        "model",
        "joints",
    }
    text = command("simulate", *ARCH, record, "--pga", "0.2").output
    assert text.startswith("standing: the arch came to rest")
    code, message = refused("simulate", *ARCH, tmp_path / "lost.AT2")
    assert (code, str(tmp_path / "lost.AT2") in message) == (2, True)
    assert refused("simulate", *THIN, record)[0] == 3


class TestValidate:
    def test_a_study_in_order_and_nothing_is_created(self, tmp_path):
        path = small_study(tmp_path, TEXT.replace("output: out", "output: deep/out"))
        before = sorted(tmp_path.rglob("*"))
        assert command("validate", path).output == (
            f"{path}: in order; 2 arches, 2 records, 3 levels, 12 runs by design stripes\n"
            "  ring: the ring weighs 809 kN; springings at (-9.072, 1.805) and (9.072, 1.805) m "
            "(intrados); usual joints of 3e+10 Pa/m lower the onset of motion by 7.5 %: "
            "joints.model inset is enough, rigid ones are not\n"
            "  slab: the blocks weigh 15.7 kN; it stands from (-0.2, 0) to (0.2, 0) m; "
            "usual joints of 3e+10 Pa/m lower the onset of motion by 4.7 %: joints.model inset "
            "is enough, rigid ones are not\n"
        )
        assert json.loads(command("validate", path, "--json").output)["runs"] == 12
        assert sorted(tmp_path.rglob("*")) == before

    def test_errors_of_hazard_arches_and_records_are_told_together(self, tmp_path):
        path = small_study(tmp_path, TEXT.replace("thickness: 1.5", "thickness: 0.3"))
        result = command("validate", path, "--set", "risk.hazard=none.csv")
        assert result.exit_code == 2
        assert [line.partition(":")[0] for line in result.stderr.splitlines()] == [
            "archfrag",
            f"  the hazard curve {tmp_path / 'none.csv'} cannot be read",
            "  arches[0] (ring)",
        ]
        (tmp_path / "records" / "wave1.AT2").write_text("nothing")
        result = command("validate", path, "--set", "risk.hazard=none.csv")
        assert result.stderr.startswith("archfrag: error: 3 errors:\n")
        assert f"\n  {tmp_path}/records/wave1.AT2: " in result.stderr
        assert refused("validate", path, "--set", "arches.0.thickness=1.5")[0] == 2

    def test_of_very_many_arches_some_are_checked(self, tmp_path, monkeypatch):
        monkeypatch.setattr("archfrag.study.file.members.MOST_CHECKED", 3)
        vary = "samples: 8, of: {density: {distribution: uniform, start: 1800, stop: 2000}}"
        text = TEXT.replace("friction: .inf}", f"friction: .inf, vary: {{{vary}}}}}")
        result = command("validate", small_study(tmp_path, text))
        assert result.exit_code == 0
        assert "6 of 9 arches were not checked; the run checks all" in result.stderr

    @pytest.mark.skipif(
        sys.platform != "linux", reason="file names are UTF-8 elsewhere"
    )
    def test_names_that_are_no_text_are_refused(self, tmp_path):
        path = small_study(tmp_path)
        code, message = refused(
            "validate", path, "--set", os.fsdecode(b"output=\xfe/here")
        )
        assert (code, message.startswith("--set output: is not valid YAML: ")) == (
            2,
            True,
        )
        os.rename(
            tmp_path / "records" / "wave1.AT2",
            os.fsencode(tmp_path) + b"/records/\xff.AT2",
        )
        code, message = refused("validate", path)
        assert code == 2
        assert message.startswith(
            f"{tmp_path}/records/\\xff.AT2: the name of the file is not in "
        )


class TestSteps:
    def test_steps_by_hand_in_order(self, tmp_path):
        path = small_study(tmp_path)
        out = tmp_path / "out"
        assert refused("batch", path)[0] == 2
        assert command("motions", path).stderr == "archfrag: motions: 2 records ready\n"
        code, message = refused("cube", path)
        assert (
            code,
            message.startswith(f"{out / '.archfrag' / 'parts'}: 12 of 12"),
        ) == (2, True)
        result = command("batch", path, "--workers", "1", "--quiet")
        assert "12 runs, 0 kept from before, 12 new" in result.stderr
        made = {"cube": "cube.nc", "fit": "fits.json", "report": "report.html"}
        for step, result_file in made.items():
            assert command(step, path).exit_code == 0
            assert (out / result_file).stat().st_size > 0
        assert "A small study" in (out / "report.html").read_text()
        fits = json.loads(command("fit", path, "--json").stdout)
        assert set(fits["fits"]) == {"ring", "slab"}
        self.a_damaged_cube_is_refused_and_made_again(path, out)
        self.what_is_not_of_the_study_goes_but_no_run(path, out)

    def a_damaged_cube_is_refused_and_made_again(self, path, out):
        full = (out / "cube.nc").read_bytes()
        for damaged in (b"", full[: len(full) // 2], full[:100]):
            (out / "cube.nc").write_bytes(damaged)
            code, message = refused("fit", path)
            assert code == 2
            assert message.startswith(
                f"{out / 'cube.nc'}: is missing, changed or damaged; `arch"
            )
            assert command("cube", path).exit_code == 0
            assert (out / "cube.nc").read_bytes() == full
        (out / "cube.nc").write_bytes(b"a year of work")
        assert refused("cube", path)[0] == 4
        (out / "cube.nc").unlink()
        assert command("cube", path).exit_code == 0

    def what_is_not_of_the_study_goes_but_no_run(self, path, out):
        (out / "curve-mine.svg").write_text("drawn by hand")
        parts = set(out.glob(".archfrag/parts/*/*.npy"))
        text = path.read_text().replace("id: slab", "id: plate")
        path.write_text(text.replace("height: 2.0", "height: 2.5"))
        make_runs(load_study(path))
        for step in ("cube", "fit", "report"):
            assert command(step, path).exit_code == 0
        assert {p.name for p in out.glob("curve-*")} == {
            "curve-ring.svg",
            "curve-plate.svg",
            "curve-mine.svg",
        }
        assert parts < set(out.glob(".archfrag/parts/*/*.npy"))

    DENIED = OSError(13, "Permission denied", "a/b"), "a/b: Permission denied"
    FULL = OSError(28, "No space left on device"), "No space left on device"
    NO_MEMORY = MemoryError(), "the memory of this machine does not suffice"

    @pytest.mark.parametrize(("error", "message"), [DENIED, FULL, NO_MEMORY])
    def test_errors_of_the_machine_are_a_message(
        self, tmp_path, monkeypatch, error, message
    ):
        def broken(study):
            raise error

        monkeypatch.setattr("archfrag.study.steps.prepare_motions", broken)
        assert refused("motions", small_study(tmp_path)) == (1, message)
