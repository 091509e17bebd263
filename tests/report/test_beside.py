"""A study beside another one: both curves and their figures, or why not."""

import json

import lxml.html
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from archfrag.cli import main
from archfrag.errors import InputError
from archfrag.fragility.counts import Verdict
from archfrag.report.beside import beside_section
from archfrag.report.page import render
from archfrag.report.summary import reading_scale
from tests.report import synthetic
from tests.report.test_page import table, text
from tests.study.small import TEXT, in_process, small_study


def study(name, vertical, theta=4.0, arches=("ring",), thickness=1.5):
    """Cube of a made-up study with losses of contact in the runs that collapsed."""
    cube = synthetic.cube(arches, theta=theta)
    config = {"arches": [{"id": arch, "thickness": thickness} for arch in arches]}
    cube.attrs |= {
        "archfrag_study": name,
        "vertical_component": vertical,
        "archfrag_config": json.dumps(config),
    }
    cube["intensity"].attrs["measure"] = "PGA"
    return cube


def inputs(one, other):
    names = [str(arch) for arch in one["arch"].values]
    return synthetic.inputs(names, cube=one, beside=(other, synthetic.answers_of(other)))


def shown(given):
    return beside_section(given, reading_scale(given.cube, "PGA"))


def rows_of(given, label="ring in both studies"):
    heads, rows = table(lxml.html.document_fromstring(render(given)), label)
    return {key: values for key, *values in (heads, *rows)}


class TestSection:
    def test_figures_of_both_studies(self):
        one, other = study("up", "used"), study("flat", "not used", theta=5.0)
        given = inputs(one, other)
        rows = rows_of(given)
        fits = [given.answers["ring"].curve, given.beside[1]["ring"].curve]
        fell = [int((cube["verdict"] == Verdict.COLLAPSED).sum()) for cube in (one, other)]
        change = 100 * (fits[1].theta / fits[0].theta - 1)
        assert change > 5
        assert fell[0] != fell[1]
        collapsed = [str(n) for n in fell]
        expected = {
            "figure": ["up", "flat"],
            "vertical component": ["used", "not used"],
            "median capacity θ": [f"{fit.theta / 9.80665:#.3g} g" for fit in fits],
            "dispersion β": [f"{fit.beta:#.3g}" for fit in fits],
            "change of θ from up": ["–", f"+{change:.1f} %"],
            "runs": ["54", "54"],
            "collapsed": collapsed,
            "runs with a loss of contact by any gap": collapsed,
            "lost contact by a gap above 2 % of a joint's length": collapsed,
            "losses of contact by any gap": [str(3 * n) for n in fell],
            "of these, standing": ["0", "0"],
            "unfinished": ["1", "1"],
            "solver failures": ["1", "1"],
        }
        assert {key: rows[key] for key in expected} == expected

    def test_what_both_have_and_what_else_differs(self):
        one = study("up", "used", arches=("ring", "wall"))
        found = shown(inputs(one, study("flat", "not used", arches=("tower", "wall"))))
        assert [arch["name"] for arch in found["arches"]] == ["wall"]
        assert found["settings"][0] == found["settings"][1]
        differing = inputs(one, study("flat", "used", thickness=1.2))
        rows = rows_of(differing, "Arches, levels and method in which the studies differ")
        assert rows == {"key": ["up", "flat"], "arches.ring.thickness": ["1.5", "1.2"]}
        assert shown(synthetic.inputs()) is None

    def test_without_a_curve(self):
        other = study("flat", "not used")
        other["verdict"][:] = Verdict.STANDING
        rows = rows_of(inputs(study("up", "used"), other))
        assert rows["median capacity θ"][1] == "no curve"
        assert rows["change of θ from up"] == ["–", "–"]


@pytest.mark.parametrize(
    ("attributes", "arches", "kind"),
    [
        ({"measure": "Sa(0.5)"}, ("ring",), r"its levels are of Sa\(0.5\) \[m s-2\]"),
        ({"units": "m s-1"}, ("ring",), r"its levels are of PGA \[m s-1\]"),
        ({}, ("wall",), "it has no arch ring, but wall"),
    ],
)
def test_refused(attributes, arches, kind):
    given = inputs(study("up", "used"), study("flat", "not used", arches=arches))
    given.beside[0]["intensity"].attrs |= attributes
    with pytest.raises(InputError, match=f"study 'flat' cannot be shown beside 'up': {kind}"):
        shown(given)


MADE = """synthetic: {events: 3, magnitude: [6.5], distance_km: [10.0], seed: 3, vertical: YES}
  vertical: NO"""  # is of records, not of synthetic motions


def call(command, path, *options):
    return CliRunner().invoke(main, [command, str(path), *map(str, options)])


@pytest.mark.slow
def test_command(tmp_path):
    """A study with verticals, the same without, and one that is not run."""
    paths = {}
    for name, made, recorded in (("up", "true", "false"), ("flat", "false", "true"),
                                 ("idle", "false", "false")):  # fmt: skip
        motions = MADE.replace("YES", made).replace("NO", recorded)
        changed = TEXT.replace('files: ["records/*.AT2"]', motions)
        changed = changed.replace("id: small", f"id: {name}")
        changed = changed.replace("output: out", f"output: {name}")
        paths[name] = small_study(tmp_path, changed, f"{name}.yaml")
    with in_process():
        for name in ("up", "flat"):
            for command in ("motions", "batch", "cube", "fit"):
                result = call(command, paths[name])
                assert result.exit_code == 0, result.output
    result = call("report", paths["up"], "--beside", paths["flat"])
    assert result.exit_code == 0, result.output
    out = tmp_path / "up" / "report.html"
    page = lxml.html.document_fromstring(out.read_text())
    (found,) = page.xpath('//section[@id="beside"]')
    assert [text(head) for head in found.xpath("./h3")] == ["ring", "slab"]
    assert "3 have the same name in both" in text(found)
    rows = {key: values for key, *values in table(page, "ring in both studies")[1]}
    assert rows["vertical component"] == ["used", "not used"]
    cubes = [xr.load_dataset(tmp_path / name / "cube.nc") for name in ("up", "flat")]
    assert np.array_equal(cubes[0]["scale_factor"], cubes[1]["scale_factor"])
    losses = [int(cube["contact_losses"].sel(arch="ring").sum()) for cube in cubes]
    assert losses[0] != losses[1]
    assert rows["losses of contact by any gap"] == [f"{n:,}" for n in losses]
    before = out.read_bytes()
    for other, why in (
        ("idle", "study 'idle' cannot be shown beside 'up', since it is not finished: "),
        ("up", "study 'up' cannot be shown beside 'up': each study needs its own id"),
    ):
        result = call("report", paths["up"], "--beside", paths[other])
        assert result.exit_code != 0
        assert result.stderr.startswith(f"archfrag: error: {why}")
        assert result.stderr.count("\n") == 1
    assert out.read_bytes() == before
