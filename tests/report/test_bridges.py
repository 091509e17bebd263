"""Figures and texts on bridges name the span or the pier, and show the whole bridge."""

import lxml.html
import numpy as np
import pytest

import archfrag as af
from archfrag.fragility.verdicts import Verdict
from archfrag.report import arch_figure, film, run_figures
from archfrag.report.first_page import first_page
from archfrag.report.inputs import arch_results
from archfrag.report.limits import aspects, base_of, short
from archfrag.report.page import render
from archfrag.report.svg import NARROW
from archfrag.simulation.response import MechanismChange
from archfrag.study.answer.curves import runs_of_cube
from tests.report import synthetic
from tests.report.conftest import texts

RING = af.Arch.circular(2.5, 0.5, 180.0, voussoirs=9, friction=0.6)
PIER = {"height": 4.0, "width": 1.0, "courses": 2}


def bridge_of(spans, **more):
    return af.Bridge([RING] * spans, piers=PIER, **more)


BRIDGE = bridge_of(2)


def results(arch):
    cube = synthetic.cube(n_joint=arch.n_joint)
    return arch_results(runs_of_cube(cube, ["ring"])["ring"], synthetic.SCALE)


@pytest.mark.parametrize("arch", [BRIDGE, bridge_of(3, ends=PIER)])
def test_collapses_are_divided_by_the_part_of_their_joint(arch, drawn):
    data = results(arch)
    fell = data.verdict == Verdict.COLLAPSED
    groups = mode, joint, part = run_figures.groupings(data, 0.9, arch)
    assert list(part.categories) == [each.name for each in arch.parts]
    for each, counts in zip(arch.parts, part.counts):
        own = fell & np.isin(data["collapse_joint"], each.joints)
        np.testing.assert_array_equal(counts, own.sum(axis=0))
    assert mode.counts.sum() == part.counts.sum() == fell.sum()
    assert {*joint.categories[:-1]} < {*arch.places}
    shown = run_figures.fractions(groups, data, base_of(arch))
    assert "span or pier" in shown.caption
    assert {"span 1", "pier 1"} <= {words for words, *_ in texts(drawn[0])}


def test_one_arch_has_no_parts():
    arch = synthetic.arch_and_onset(7)[0]
    assert arch.places == []
    assert len(run_figures.groupings(results(arch), 0.9, arch)) == 2
    assert base_of(arch) == "the left springing"


@pytest.mark.parametrize("spans", [2, 3, 8, 12])
def test_a_long_bridge_is_drawn_one_below_the_other(spans, drawn):
    """Each drawing has the width of the page, and labels keep clear of each other."""
    arch = bridge_of(spans)
    start = af.onset(arch)
    arch_figure.arch_at_onset(start, "viaduct")
    arch_figure.lost_joints(arch, results(arch))
    one, other = (panel.box for panel in drawn[0].panels)
    assert other[1] > one[3]
    assert (one[0], one[2]) == (other[0], other[2])
    if spans > 3:
        assert one[2] - one[0] > 0.8 * drawn[0].width
    words = [words for words, *_ in texts(drawn[0])]
    names = [each.name for each in arch.parts]
    shown = [name for name in names if words.count(name) == 2]
    # Where there is no room for all names, most are left.
    assert shown == names if spans < 9 else len(shown) > 0.5 * len(names)


def test_the_first_page_measures_one_span(drawn):
    given = synthetic.inputs(arches={"ring": af.onset(BRIDGE)})
    page = lxml.html.fromstring(str(first_page(given, None))).text_content()
    assert "clear span 4.5 m" in page
    assert "the bridge collapses" in page or "make the bridge collapse" in page
    assert all(sheet.width >= NARROW for sheet in drawn)


def test_the_log_has_the_joints_of_each_part_together(drawn):
    motion = af.Motion(np.where(np.arange(400) < 200, 8.0, -4.0), 2e-3, id="pulse")
    response = af.simulate(
        BRIDGE, motion, method="time_stepping", dt=1e-3, history=True, follow=1.0
    )
    assert response.collapsed
    assert response.collapse_place == BRIDGE.place(response.collapse_joint)
    assert response.collapse_place in repr(response)
    of_run = BRIDGE, motion, 1.0, "PGA = 0.8 g", response, "chosen", True
    example = film.Example(*of_run)
    run_figures.timeline(example)
    shown = {words for words, *_ in texts(drawn[0])}
    assert {"span 1", "pier 1", "span 2", "hinge left"} <= shown
    assert any(words.endswith(response.collapse_place) for words in shown)
    moving, _ = film.film(example, "fall", "A collapse")
    words = "18 voussoirs in 2 spans on piers under pulse"
    assert f"A collapse at {response.collapse_place}: {words}" in moving.caption


def test_a_change_of_the_mechanism_names_places():
    places = BRIDGE.places
    joints = {0: "hinge left", 17: "hinge extrados"}
    change = MechanismChange(1.0, 2.0, "impact", 0, "all_voussoirs", joints, places)
    words = "impact at pier 1 base: hinges pier 1 base left, span 2 joint 5 extrados"
    assert words in str(change)
    alone = MechanismChange(1.0, 2.0, "impact", 0, "all_voussoirs", {3: "open"})
    assert "impact at joint 0: open 3" in str(alone)


class TestWhatIsModelled:
    def test_spans_are_counted(self):
        given = {"one": [{}], "bridges": [{"several": 2}, {"several": 4}]}
        text = " ".join(each.sentence for each in aspects(given))
        whose = "(bridges)"
        assert (
            f"2 to 4 spans are modelled together with the piers that they share {whose}."
            in text
        )
        assert "One span" not in text
        assert "Piers are modelled" in text
        assert (
            "several spans (bridges)" in short(aspects(given)).partition("Not mod")[0]
        )

    def test_one_span_is_one(self):
        text = " ".join(each.sentence for each in aspects({"ring": [{}]}))
        assert "One span is modelled, and nothing beside it." in text
        assert "Piers are not modelled" in text

    def test_the_report_says_so(self):
        given = synthetic.inputs(arches={"ring": af.onset(BRIDGE)})
        page = lxml.html.document_fromstring(render(given)[0]).text_content()
        assert "2 spans are modelled together" in page
        assert "One span" not in page
        assert "Piers are not modelled" not in page
        assert f"Onset towards +x: {af.onset(BRIDGE).places('+x')}." in page
        assert "pier 1, base left; span 1, joint 0 extrados" in page

    def test_across_stands_beside_along(self):
        start = af.onset(BRIDGE)
        given = synthetic.inputs(arches={"ring": start})
        page = lxml.html.document_fromstring(render(given)[0])
        words = page.text_content()
        value = f"{start.transverse[1].plus:.3f} g"
        card = [each.text_content() for each in page.find_class("answer")]
        assert any(f"onset across the bridge{value}of pier 1" in each for each in card)
        told = start.transverse_text
        assert f"{told[0].upper()}{told[1:]}." in words
        assert "three dimensions" in words
        assert "Motion across the plane is not modelled." in words

    def test_a_column_is_told(self):
        bridge = af.Bridge([RING] * 2, {**PIER, "courses": 8})
        start = af.onset(bridge.transverse("pier 1"))
        given = synthetic.inputs(arches={"ring": start})
        page = lxml.html.document_fromstring(render(given)[0]).text_content()
        assert "onset across the bridge" not in page
        assert "The column is pier 1 across the bridge with its share" in page
        assert "A pier moves across the bridge, with its share of rings" in page
        assert "the column collapses" in page or "make the column collapse" in page
