"""Studies in Python: the same bits as by a study file, messages, results, and their types."""

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import lxml.html
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import archfrag as af
from archfrag.api import studies
from archfrag.errors import InputError, OutputError
from archfrag.study.file.prepared import prepare_motions, read_manifest
from archfrag.study.file.schema import load_study
from archfrag.study.steps import run_study
from tests.arch.test_drawing import draw_arch
from tests.study.small import ROOT, write_at2

# What is of files, which are others if motions are given as objects.
OF_FILES = {"record_file", "record_sha256"}


def bits(values: np.ndarray) -> bytes:
    return (
        repr(values.tolist()).encode() if values.dtype == object else values.tobytes()
    )


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """The current folder, with two records of a horizontal and a vertical each, and a drawing."""
    (tmp_path / "records").mkdir()
    time = np.arange(150) * 0.01
    for name, frequency in (("a", 8.0), ("b", 13.0)):
        wave = np.sin(frequency * time) * np.sin(np.pi * time / 1.5)
        for direction, peak in (("N", 0.3), ("UP", 0.1)):
            path = tmp_path / "records" / f"{name}-{direction}.AT2"
            write_at2(path, peak * wave, 0.01, direction)
    arch = af.Arch.segmental(
        span=2.0, rise=0.7, thickness=0.3, voussoirs=4, friction=0.6
    )
    draw_arch(tmp_path / "bridge.dxf", arch, 0.001, 4)
    monkeypatch.chdir(tmp_path)
    return tmp_path


MOTIONS = "motions: {files: ['records/?-N.AT2'], vertical: %s}\n"
RING = {
    "radius": 10.0,
    "thickness": 1.5,
    "embrace": 157.5,
    "voussoirs": 7,
    "friction": 0.7,
}
EDGE = np.array([[0.2, 0.0], [0.2, 0.8], [0.18, 1.6]])
# A study file, and the arguments that say the same; both on a folder with records.
SAME = {
    "profiles, stripes": (
        "arches:\n- {id: ring, profile: circular, radius: 10.0, thickness: 1.5, embrace: 157.5, "
        "voussoirs: 7, friction: 0.7}\n- {id: slab, profile: block, width: 0.4, height: 2.0, "
        "friction: .inf}\n"
        + MOTIONS
        % "false"
        + "intensity: {measure: PGA, unit: g, levels: [0.1, 0.6, 1.2]}\n"
        "method: {name: time_stepping, dt: 2.0e-3, follow: 2.0}\n",
        lambda: af.Study(
            {"ring": af.Arch.circular(**RING), "slab": af.Block(0.4, 2.0, np.inf)},
            "records/?-N.AT2",
            levels=[0.1, 0.6, 1.2],
            id="same",
            method={"name": "time_stepping", "dt": 2e-3, "follow": 2.0},
        ),
    ),
    "motions as objects with verticals, ida": (
        "arches: [{id: slab, profile: block, width: 0.4, height: 2.0, friction: 0.8}]\n"
        + MOTIONS % "true"
        + "intensity: {measure: PGA, unit: g, levels: {start: 0.3, stop: 1.5, count: 5}}\n"
        "design: {kind: ida}\n",
        lambda: af.Study(
            {"slab": af.Block(0.4, 2.0, 0.8)},
            [
                af.read_motion(
                    f"records/{name}-N.AT2", vertical=f"records/{name}-UP.AT2"
                )
                for name in "ab"
            ],
            levels=np.linspace(0.3, 1.5, 5),
            design="ida",
            id="same",
        ),
    ),
    "a drawing that varies": (
        "arches: [{id: bridge, drawing: bridge.dxf, friction: 0.6, vary: {samples: 2, of: "
        "{friction: {distribution: uniform, start: 0.5, stop: 0.7}}}}]\n"
        + MOTIONS % "false"
        + "intensity: {measure: PGA, unit: g, levels: [0.4, 0.9, 1.6]}\n",
        lambda: af.Study(
            {"bridge": af.Arch.from_dxf("bridge.dxf", 0.6)},
            [Path("records/?-N.AT2")],
            levels=(0.4, 0.9, 1.6),
            id="same",
            vary={
                "samples": 2,
                "friction": {"distribution": "uniform", "start": 0.5, "stop": 0.7},
            },
        ),
    ),
    "cloud of PGV, processed": (
        "arches: [{id: slab, profile: block, width: 0.4, height: 2.0, friction: 0.8, "
        "recess: {intrados: 0.02, extrados: 0.0}}]\n"
        "motions: {files: [{path: 'records/?-N.AT2'}], processing: [demean]}\n"
        "intensity: {measure: PGV, unit: cm/s, levels: [20.0, 60.0, 120.0]}\n"
        "design: {kind: cloud}\n",
        lambda: af.Study(
            {"slab": af.Block(0.4, 2.0, 0.8).recessed(0.02)},
            {"files": ["records/?-N.AT2"], "processing": ["demean"]},
            "PGV",
            levels=[20.0, 60.0, 120.0],
            unit="cm/s",
            design={"kind": "cloud"},
            id="same",
        ),
    ),
    "joints with loads, limit states": (
        "arches: [{id: half, profile: from_joints, intrados: [[0.2, 0.0], [0.2, 0.8], [0.18, "
        "1.6]], extrados: [[-0.2, 0.0], [-0.2, 0.8], [-0.18, 1.6]], free_end: true, dead_load: "
        "[500.0, 0.0], friction: 0.8}]\n"
        + MOTIONS
        % "false"
        + "intensity: {measure: PGA, unit: m/s2, levels: [0.5, 2.0, 8.0]}\n"
        "limit_states: {rotation: 0.3}\nreport: {at: 2.0, confidence: 0.8}\n",
        lambda: af.Study(
            {
                "half": af.Arch.from_joints(
                    EDGE, EDGE * [-1, 1], 0.8, free_end=True, dead_load=[500.0, 0.0]
                )
            },
            af.read_motions("records/?-N.AT2"),
            unit="m/s2",
            levels=[0.5, 2.0, 8.0],
            limit_states={"rotation": 0.3},
            report={"at": 2.0, "confidence": 0.8},
            id="same",
        ),
    ),
}


@pytest.mark.parametrize("case", SAME)
def test_a_study_by_file_and_in_python_gives_the_same_bits(case, folder, monkeypatch):
    monkeypatch.setattr(studies, "make_report", lambda study: study.folder)
    text, make = SAME[case]
    Path("same.yaml").write_text(f"id: same\ntitle: same\noutput: by_file\n{text}")
    by_file = load_study("same.yaml")
    run_study(by_file, Path("same.yaml"), lambda: None, lambda *_: Path(), 1, True)
    study = make()
    results = study.run(progress=False, cores=1)
    one, two = (
        xr.load_dataset(each / "cube.nc") for each in (by_file.folder, study.folder)
    )
    assert set(one.variables) == set(two.variables)
    for name in set(one.variables) - OF_FILES:
        assert bits(one[name].values) == bits(two[name].values), name
    fits = [(each / "fits.json").read_text() for each in (by_file.folder, study.folder)]
    assert fits[0] == fits[1]
    theta = {
        k: f["theta"] for k, f in json.loads(fits[0])["fits"].items() if "theta" in f
    }
    found = {k: results.curves[k].theta * by_file.intensity.factor for k in theta}
    assert found == pytest.approx(theta, rel=1e-15)
    again = load_study(study.to_file("again/same.yaml"))
    samples = [each.samples for each in prepare_motions(again)]
    assert samples == [each.samples for each in read_manifest(by_file)["records"]]
    assert [each.chain for each in again.members] == [
        each.chain for each in by_file.members
    ]
    alike = {"arches", "motions", "output"}
    assert again.model_dump(exclude=alike) == by_file.model_dump(exclude=alike)


def test_results_show_themselves_in_two_lines(folder, monkeypatch):
    monkeypatch.setattr(studies, "make_report", lambda study: study.folder)
    arches = {"slab": af.Block(0.4, 2.0, 0.8), "<post>": af.Block(0.3, 2.0, 0.8)}
    with pytest.raises(InputError, match=r"arches\[1\].id"):
        af.Study(arches, "records/?-N.AT2", levels=[0.3, 0.9])
    arches["post"] = arches.pop("<post>")
    study = af.Study(arches, "records/?-N.AT2", levels=[0.3, 0.6, 1.2], design="ida")
    used = list[int]()
    made = studies.run_study
    monkeypatch.setattr(
        studies, "run_study", lambda *a, **k: (used.append(a[4]), made(*a, **k))
    )
    results = study.run(progress=False, workers=1)
    assert used == [1]
    assert results.runs.intensity.values.tolist() == [0.3, 0.6, 1.2]
    assert results.runs.collapsed.sel(intensity=1.2, arch="post").all()
    assert results.capacities.groupby("arch")["capacity"].median()["post"] < 1.2
    with pytest.raises(InputError, match=r"take one of \.curves by name: slab, post"):
        _ = results.curve
    with pytest.raises(InputError, match="the study has no hazard"):
        results.risk()
    for thing in (study, results, results.curves["slab"]):
        assert len(repr(thing).splitlines()) <= 2
        assert "slab" in thing._repr_html_()


def test_from_a_drawing_to_nrml_in_six_lines(folder):
    pages = [
        (ROOT / name).read_text() for name in ("README.md", "docs/howto/python.md")
    ]
    blocks = {
        block
        for page in pages
        for block in re.findall(r"```python\n(.*?)```", page, re.S)
    }
    (lines,) = (block for block in blocks if "to_nrml" in block)
    assert len(list(filter(None, lines.splitlines()))) == 6
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on limit states that too few runs show
        exec(lines.replace('"samples": 16', '"samples": 4'), {})
    text = Path("bridge.xml").read_text()
    assert text.count("<fragilityFunction ") == 1
    assert 'id="bridge"' in text


MANY = "Study: 1 of 2 motions have a vertical component; all of them must have one, or none"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"arch": "ring"},
            "Study: arch is str; it must be an Arch, a mapping of names to arches",
        ),
        (
            {"arch": {"slab": {"profile": "block", "width": 1.0}}},
            r"Study: arches\[0\].height, "
            r"arches\[0\].friction must be given",
        ),
        (
            {"motions": []},
            "Study: motions hold nothing; they must be Motion objects, or paths",
        ),
        (
            {"motions": [af.Motion([0.0, 1.0], 0.1), "a.AT2"]},
            "hold Motion, str; they must",
        ),
        ({"motions": [af.Motion([0, 1], 0.1), af.Motion([0, 1], 0.1, [0, 1])]}, MANY),
        (
            {"motions": [af.Motion([0, 1], 0.1, id="a")] * 2},
            "several motions have the id 'a'",
        ),
        (
            {"motions": np.zeros(9)},
            "Study: motions hold float64; they must be Motion objects",
        ),
        (
            {"motions": 5},
            "Study: motions hold int; they must be Motion objects, or paths",
        ),
        (
            {"intensity": {}},
            "Study: intensity cannot be given; give measure, levels and unit",
        ),
        ({"measure": "PGX"}, "Study: intensity.measure = PGX"),
        (
            {"design": "search"},
            "Study: design.kind = search must be one of stripes, ida, cloud",
        ),
        ({"vary": {"samples": 4, "frictoin": {}}}, "vary.frictoin is not a known key"),
        (
            {"limitstates": {}},
            "Study: limitstates is not a known key; did you mean limit_states",
        ),
        ({"report": {"client": object()}}, "cannot be written to a study file"),
        (
            {"levels": np.array([1j])},
            "Study: levels = array.* must be a row of numbers",
        ),
        (
            {"levels": np.array([0.2, "a"], object)},
            "levels = array.* must be a row of numbers",
        ),
        (
            {"levels": np.array([[0.2, 0.4]])},
            "levels = array.* must be a row of numbers",
        ),
        (
            {"levels": np.ma.masked_array([0.2, 0.4], [0, 1])},
            "must be a row of numbers",
        ),
        ({"vary": [1]}, "Study: vary is list; it must be a mapping of samples and"),
        ({"vary": "x"}, "Study: vary is str; it must be a mapping of samples and"),
        (
            {"output": "a\0b"},
            r"Study.output = 'a\\x00b' must hold no control characters",
        ),
        ({"title": "a\x07"}, r"Study.title = 'a\\x07' must hold no control characters"),
    ],
)
def test_a_wrong_argument_is_named_by_its_key(changes, message):
    given = {"arch": af.Block(0.4, 2.0, 0.8), "motions": "*.AT2", "levels": [0.2, 0.4]}
    with pytest.raises(InputError, match=message):
        af.Study(**given | changes)


def test_an_id_that_looks_like_a_number_stays_text(folder):
    for name in ("1e3", "1_000", "2020-01-01", "0x10", "null", "yes"):
        path = af.Study(
            af.Block(0.4, 2.0, 0.8), "records/*", levels=[0.5], id=name
        ).to_file(f"{name}.yaml")
        assert load_study(path).id == name


@pytest.mark.parametrize(
    "name", sorted(path.stem for path in (ROOT / "configs").glob("*.yaml"))
)
def test_a_study_file_that_is_read_and_written_says_the_same(name, tmp_path):
    path = ROOT / "configs" / f"{name}.yaml"
    file = af.Study.from_file(path).to_file(tmp_path / "other" / "study.yaml")
    assert ": /" not in file.read_text()  # paths are relative
    written = load_study(file)
    assert written.folder == tmp_path / "other" / "results" / name.replace("_", "-")
    assert written.model_dump(exclude={"output"}) == load_study(path).model_dump(
        exclude={"output"}
    )


def test_motions_that_were_read_stay_files_until_they_are_changed(folder):
    def motions_of(motions):
        path = af.Study(af.Block(0.4, 2.0, 0.8), motions, levels=[0.5]).to_file(
            "s/study.yaml"
        )
        return load_study(path).motions

    motions = af.read_motions("records/?-N.AT2")
    assert motions_of(motions).files[0].path == str(folder / "records" / "?-N.AT2")
    motions[0] *= 2.0
    assert motions_of(motions).index == str(
        folder / "s" / "study-motions" / "index.csv"
    )


def test_results_that_are_not_there_are_asked_for(folder):
    with pytest.raises(
        InputError, match="is not a folder with the results of a study; give"
    ):
        af.open("records")
    with pytest.raises(InputError, match="nowhere cannot be read"):
        af.open("nowhere")


def test_a_script_uses_all_that_is_public_and_its_types_are_known(folder):
    script = folder / "script.py"
    script.write_text((ROOT / "tests" / "user_script.py").read_text())
    options = [
        "--cache-dir",
        str(folder),
        "--config-file",
        str(ROOT / "pyproject.toml"),
    ]
    check = [sys.executable, "-m", "mypy", "--strict", *options, str(script)]
    run = [sys.executable, "-W", "ignore", str(script)]
    environment = os.environ | {"MPLBACKEND": "agg", "MYPYPATH": str(ROOT / "pipeline")}
    for command in (check, run):
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stdout + done.stderr


def small(width, **given):
    """A study of a block under two motions, made at once."""
    wave = np.sin(np.arange(150) / 10.0) * np.hanning(150)
    motions = [af.Motion(factor * wave, 0.01, id=f"wave{factor}") for factor in (1, 2)]
    block = af.Block(width, 2.0, 0.8)
    return af.Study(block, motions, levels=[0.1, 0.4, 1.6, 6.4], **given)


def test_studies_without_an_id_have_folders_and_reports_of_their_own(folder):
    made = {width: small(width).run(progress=False) for width in (0.4, 0.5)}
    assert small(0.4).folder == made[0.4].folder
    assert (
        len({str(results.folder) for results in made.values()})
        == len(list(Path("results").iterdir()))
        == 2
    )
    for width, results in made.items():
        assert results.folder.name.startswith("study-")
        assert f"{width:g} m" in results.report().read_text()


def test_results_of_another_study_are_not_replaced_unasked_and_write_nothing_of_it(
    folder,
):
    first = small(0.4, id="block").run(progress=False)
    again = small(0.4, id="block").run(progress=False)
    assert again.curve.theta == first.curve.theta
    with pytest.raises(
        OutputError,
        match=r"another study with the id 'block'; give this one .*run\(replace=True",
    ):
        small(0.5, id="block").run(progress=False)
    assert first.to_nrml("first.xml").is_file()
    other = small(0.5, id="block").run(progress=False, replace=True)
    assert other.to_nrml("other.xml").is_file()
    for asked in (
        first.report,
        first.film,
        first.response,
        lambda: first.to_nrml("x.xml"),
    ):
        with pytest.raises(
            InputError, match="results/block: holds other results than these"
        ):
            asked()
    assert not Path("x.xml").exists()


def test_collapsed_is_known_only_of_runs_that_were_made_and_fractions_do_not_fall(
    folder,
):
    study = af.Study(
        af.Block(0.4, 2.0, 0.8),
        "records/?-N.AT2",
        id="ida",
        design={"kind": "ida", "checks": 0},
        levels=np.linspace(0.2, 2.4, 12),
    )
    results = study.run(progress=False, cores=1)
    runs = results.runs
    made = runs.verdict.notnull()
    assert 0 < int(made.sum()) < made.size
    assert np.isnan(runs.collapsed.values[~made.values]).all()
    assert set(runs.collapsed.values[made.values]) == {0.0, 1.0}
    with xr.open_dataset(results.folder / "cube.nc", mask_and_scale=False) as stored:
        assert stored.verdict.attrs["_FillValue"] == 4
        assert 4 not in stored.verdict.attrs["flag_values"]
    fractions = results.fractions["ida"]
    assert fractions.index.tolist() == runs.intensity.values.tolist()
    assert fractions.is_monotonic_increasing
    assert (fractions.iloc[0], fractions.iloc[-1]) == (0.0, 1.0)


def test_curves_of_studies_and_of_counts_have_one_interface(folder):
    import matplotlib

    matplotlib.use("Agg")
    results = small(0.4, id="block").run(progress=False)
    fitted = af.fit_ida([0.5, 0.7, 0.9, 1.3])
    for curve in (fitted, results.curve):
        at = curve.quantile([0.1, 0.5, 0.9])
        assert curve(at) == pytest.approx([0.1, 0.5, 0.9], abs=1e-9)
        assert float(curve.quantile(0.5)) == pytest.approx(curve.theta)
        low, high = curve.band(at)
        assert (low < high).all()
        assert curve.plot().get_ylim() == (0.0, 1.0)
        with pytest.raises(InputError, match="must lie between 0 and 1"):
            curve.quantile(1.0)
    table = results.curve.to_dataframe()
    assert table.columns.tolist() == ["PGA [g]", "probability", "lower", "upper"]
    points = [(0.1, 1e-2), (0.4, 1e-3), (1.6, 1e-5)]
    Path("hazard.csv").write_text(
        "PGA [g],rate\n" + "".join(f"{a},{b}\n" for a, b in points)
    )
    by_file = results.risk("hazard.csv")
    for table in (
        points,
        np.array(points),
        pd.DataFrame(points, columns=["im", "rate"]),
    ):
        assert results.risk(table).rate.tolist() == by_file.rate.tolist()
    with pytest.raises(
        InputError, match="it must be a path, or a table of two columns"
    ):
        results.risk([1.0, 2.0])
    with pytest.raises(InputError, match="a run is a text such as"):
        results.response("wave1", 0.8)


def test_lists_and_names_stand_for_what_they_say(folder):
    motions = af.read_motions("records/?-N.AT2")
    assert motions[motions[1].id] is motions[1]
    study = af.Study([af.Block(0.4, 2.0, 0.8)] * 2, motions, levels=[0.5])
    assert study._repr_html_().count("arch1, arch2") == 1
    runs = af.simulate_many(af.Block(0.4, 2.0, 0.8), [motions[0]], [0.5, 1.0, 2.0])
    assert runs.sizes["run"] == 3


def test_studies_in_threads_leave_the_interpreter_alone(tmp_path):
    """In a process of its own, which a crash would end."""
    code = (
        "import sys, threading, numpy as np, archfrag as af\n"
        "wave = np.sin(np.arange(150) / 10.0) * np.hanning(150)\n"
        "motions = [af.Motion(f * wave, 0.01, id=f'w{f}') for f in (1, 2)]\n"
        "made = []\n"
        "def go(i):\n"
        "    for k in range(3):\n"
        "        block = af.Block(0.4 + 0.01 * i + 0.1 * k, 2.0, 0.8)\n"
        "        af.Study(block, motions, levels=[0.2, 1.8]).run(progress=False, cores=1)\n"
        "        made.append(i)\n"
        "threads = [threading.Thread(target=go, args=(i,)) for i in range(4)]\n"
        "[t.start() for t in threads]; [t.join() for t in threads]\n"
        "print(len(made), hasattr(sys.modules['__main__'], 'go'))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout == "12 True\n", done.stderr[-3000:]
    assert len(list((tmp_path / "results").iterdir())) == 12


def test_the_report_of_a_cloud_counts_its_runs_in_groups(folder):
    """Each run has a level of its own: neighbours are counted together, and none is left out."""
    wave = np.sin(np.arange(100) / 5.0) * np.hanning(100)
    motions = [
        af.Motion(a * wave, 0.01, id=f"w{n}") for n, a in enumerate(np.arange(1, 25))
    ]
    study = af.Study(
        af.Block(0.4, 2.0, 0.8),
        motions,
        levels=[1.0],
        id="cloud",
        design={"kind": "cloud", "factor": 2.0},
    )
    results = study.run(progress=False)
    page = lxml.html.fromstring((results.folder / "report.html").read_text("utf-8"))
    (table,) = page.xpath("//table[contains(@aria-label, 'by level')]")
    rows = [[cell.text_content() for cell in row] for row in table.xpath(".//tbody/tr")]
    assert len(rows) > 2
    assert sum(int(row[1]) for row in rows) == len(motions)
    assert len({row[6] for row in rows}) > 1  # fractions


def test_a_study_of_joints_that_give(tmp_path):
    """Nothing is known of where they move, so no rate is cut and no state asks for it."""
    soft = af.jointed(af.Arch.circular(4.0, 0.5, 180.0, 9, 0.7), 1e10, model="face")
    time = np.arange(0.0, 1.0, 0.01)
    motions = [
        af.Motion(np.where(time < d, np.sin(np.pi * time / d), 0.0), 0.01, id=f"p{k}")
        for k, d in enumerate((0.2, 0.3, 0.5))
    ]
    found = []
    for cores in (1, 2):
        place = {"output": tmp_path / str(cores), "id": f"soft{cores}"}
        study = af.Study(
            soft, motions, measure="PGA", levels=[0.03, 0.06, 0.1, 0.2], **place
        )
        found.append(study.run(cores=cores))
    one, two = (each.runs for each in found)
    assert np.isnan(one.onset_plus).all()
    assert 0.0 < one.collapsed.mean() < 1.0
    for name in ("collapsed", "end_time", "peak_rotation"):
        np.testing.assert_array_equal(one[name], two[name])
    states = [each.state for each in found[0].curve.states]
    assert "rotation" in states
    assert "motion" not in states
