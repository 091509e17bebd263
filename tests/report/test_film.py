"""A film of a run of a finished study: the run and the file that are asked for."""

import numpy as np
import pytest

from archfrag.arch import Arch
from archfrag.errors import InputError
from archfrag.fragility.verdicts import Verdict
from archfrag.motions.motion import Motion
from archfrag.report import film
from archfrag.simulation.simulate import simulate
from tests.report import synthetic
from tests.study.small import command, small_study


@pytest.fixture(scope="module")
def study():
    return synthetic.inputs()


@pytest.fixture
def runs(study, monkeypatch):
    """Ask for films of a made-up study; record, level and reason of each run repeated."""
    kept = []
    monkeypatch.setattr(film, "report_inputs", lambda given: study)
    monkeypatch.setattr(
        film, "repeat", lambda *given: kept.append(given[-1]) or given[-1]
    )
    return kept


def test_median_and_named_runs_are_found(study, runs):
    results = study.results("ring")
    film.example_of(None)
    (record, level, reason) = runs[0]
    assert results.verdict[record, level] == Verdict.COLLAPSED
    assert "nearest the median" in reason
    name = results.records[2]
    for text in ("0.459", "0.459 g", f"{results.levels[4]:.6f}g"):
        film.example_of(None, f"{name}@{text}", "ring")
        assert runs[-1] == (2, 4, "the run that was asked for")


@pytest.mark.parametrize(
    ("run", "arch", "message"),
    [
        (
            "mean",
            None,
            r"--run mean: must be median or RECORD@LEVEL, such as RSN100.*@0\.102",
        ),
        ("RSN1O0_EVENT00_STA000@0.459", None, r"did you mean RSN100_EVENT00_STA000\?"),
        (
            "RSN100_EVENT00_STA000@0.5",
            None,
            r"was run at 0\.102, .* 0\.816 g, not at 0\.5",
        ),
        ("median", "rnig", r"--arch rnig: .*did you mean ring\?"),
    ],
)
def test_a_run_that_is_not_there_is_refused(runs, run, arch, message):
    with pytest.raises(InputError, match=message):
        film.example_of(None, run, arch)
    assert not runs


def test_command_writes_what_it_was_asked_for(tmp_path):
    path = small_study(tmp_path)
    assert command("run", path, "--quiet").exit_code == 0
    done = command("film", path, "--run", "wave0@1.2", "--to", tmp_path / "run.svg")
    assert done.output.startswith(
        f"film: {tmp_path / 'run.svg'}: wave0 at PGA = 1.20 g, "
    )
    assert (tmp_path / "run.svg").read_text().count("@keyframes") > 1
    refused = command("film", path, "--to", tmp_path / "run.mov")
    assert refused.exit_code == 2
    assert "films are written as .svg" in refused.output


def test_the_fill_is_drawn_in_a_film():
    ring = Arch.segmental(10.0, 2.5, 0.6, voussoirs=7, friction=0.6)
    pulse = Motion(np.where(np.arange(200) < 60, 14.0, 0.0), 0.01, id="pulse")
    for arch, count in (
        (ring, 0),
        (ring.filled(height_over_crown=0.4, unit_weight=18e3), 1),
    ):
        run = simulate(arch, pulse, history=True)
        example = film.Example(arch, pulse, 1.0, "PGA = 0.8 g", run, "a pulse", True)
        moving, _ = film.film(example, "f", "A run")
        assert str(moving.svg).count('class="earth"') == count
        assert ("fill at rest" in moving.caption) == bool(count)
