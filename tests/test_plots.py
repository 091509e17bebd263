"""What arches, onsets, motions and responses show of themselves: figures, films, tables."""

import re

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import archfrag as af
from archfrag import plots
from archfrag.errors import InputError, RecordError, UnitWarning
from tests.study.small import write_at2

TIME = np.arange(0.0, 2.0, 0.005)
PULSE = af.Motion(6.0 * np.sin(2 * np.pi * TIME) * (TIME < 1.0), dt=0.005, id="pulse")


@pytest.fixture(scope="module")
def arch():
    return af.Arch.circular(10.0, 1.5, 157.5, voussoirs=7, friction=0.7)


@pytest.fixture(scope="module")
def collapse(arch):
    return af.simulate(arch, PULSE, scale=2.0, history=True)


@pytest.fixture(autouse=True)
def _closed():
    yield
    pyplot.close("all")


def luminance(colour):
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("background", ["white", "#111111", "#1e1e1e"])
@pytest.mark.parametrize(
    "colour", [plots.INK, plots.BLUE, plots.VERMILION, plots.GREEN]
)
def test_colours_are_read_on_light_and_dark(colour, background):
    bright, dark = sorted([luminance(colour), luminance(background)], reverse=True)
    assert (bright + 0.05) / (dark + 0.05) > (3.8 if colour == plots.INK else 3.0)


def test_all_plots_take_axes_and_make_them(arch, collapse):
    for thing in (arch, af.onset(arch), af.Block(0.4, 2.0, 0.8), PULSE, collapse):
        mine = Figure().add_subplot()
        assert thing.plot(mine) is mine
        assert isinstance(new := thing.plot(), Axes)
        assert new.figure.get_facecolor()[3] == 0.0
        assert mine.has_data()
        assert new.has_data()


def test_onset_shows_the_direction_asked_for(arch):
    start = af.onset(arch)
    ax = start.plot(towards="-x")
    dots = [line.get_xydata()[0] for line in ax.lines if line.get_label() == "hinge"]
    assert np.array_equal(
        dots, [getattr(arch, side)[joint] for joint, side in start.hinges_minus]
    )
    assert ax.get_title() == "ground accelerating towards -x: moves from 0.37 g"
    with pytest.raises(InputError, match="towards = 'left' must be"):
        start.plot(towards="left")


@pytest.mark.parametrize("towards", [None, "+x", "-x"])
def test_thrust_line_passes_contact_centres_and_is_smooth(arch, towards):
    start = af.onset(arch)
    line = start.thrust_line(towards)
    centres = {None: start.thrust, "+x": start.thrust_plus, "-x": start.thrust_minus}[
        towards
    ]
    pieces = line.reshape(arch.n_voussoir, 9, 2)
    assert np.allclose(pieces[:, 0], centres[:-1])
    assert np.allclose(pieces[:, -1], centres[1:])
    # The force in a joint has one direction: a parabola ends along the line to its corner.
    out = 2 * pieces[:, -1] - 4 * pieces[:, 4] + 2 * pieces[:, 0]
    into = np.diff(centres, axis=0)
    before = into[:-1] + out[:-1]
    after = into[1:] - out[1:]
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    assert np.abs(turn).max() < 1e-9


def test_thrust_of_a_column_leads_to_its_centroid():
    column = af.Block(0.4, 2.0, 0.8)
    assert np.allclose(
        af.onset(column).thrust_line()[[0, -1]], [[0.0, 0.0], [0.0, 1.0]]
    )
    assert np.allclose(
        af.onset(column).thrust_line("+x")[[0, -1]], [[-0.2, 0.0], [0.0, 1.0]]
    )


def test_notebooks_show_drawings_in_the_colour_of_their_text(arch):
    for thing in (arch, af.onset(arch), PULSE):
        shown = thing._repr_html_()
        assert shown.count("<svg") == 1
        assert "currentColor" in shown
        assert plots.INK not in shown
        assert "<style" not in shown
        assert shown == thing._repr_html_()
        assert len(shown) < 60_000


def test_reprs_take_two_lines(arch, collapse):
    many = af.Arch.segmental(10.0, 4.0, 0.45, voussoirs=21, friction=[0.6] * 22)
    curve = af.fit_ida([0.5, 0.7, 0.9, 1.3])
    for thing in (arch, many, af.onset(many), PULSE, collapse, curve):
        lines = repr(thing).splitlines()
        assert len(lines) <= 2
        assert max(map(len, lines)) < 125
    assert re.fullmatch(
        r"<Response collapsed at [\d.]+ s, joint \d, hinging; .*>", repr(collapse)
    )


class TestFilm:
    def test_last_frame_is_where_the_run_ended(self, arch, collapse):
        film = collapse.animate(seconds=0.5, speed=4.0)
        *artists, now = film._func(10**6)
        stones = artists[: arch.n_voussoir]
        hinges = artists[arch.n_voussoir :]
        end = collapse.history.isel(time=-1)
        centres = [stone.get_xy()[:-1].mean(axis=0) for stone in stones]
        rest = (
            np.array([outline.mean(axis=0) for outline in arch.outlines])
            - arch.chain.centroid
        )
        cosine = np.cos(end.rotation.values)
        sine = np.sin(end.rotation.values)
        turned = np.stack(
            [
                cosine * rest[:, 0] - sine * rest[:, 1],
                sine * rest[:, 0] + cosine * rest[:, 1],
            ],
            axis=1,
        )
        expected = arch.chain.centroid + end.displacement.values + turned
        assert np.allclose(centres, expected, atol=1e-9)
        mode = end.contact_mode.values
        count = sum(len(dots.get_xdata()) for dots in hinges)
        assert count == ((mode > 0) & (mode < 7)).sum()
        assert now.get_xdata()[0] == pytest.approx(float(end.time))
        film._draw_was_started = True

    def test_what_cannot_be_filmed_is_refused(
        self, arch, collapse, tmp_path, monkeypatch
    ):
        for call in ("plot", "animate"):
            with pytest.raises(InputError, match="simulate with history=True"):
                getattr(af.simulate(arch, PULSE), call)()
        with pytest.raises(InputError, match="speed = 0"):
            collapse.animate(speed=0.0)
        monkeypatch.setattr(plots.writers, "is_available", lambda name: False)
        film = collapse.animate(seconds=0.1)
        film._draw_was_started = True
        with pytest.raises(InputError, match=r"fall\.mp4: needs ffmpeg"):
            film.save(tmp_path / "fall.mp4")


class TestMotion:
    def test_multiple_and_measures(self):
        twice = 2 * PULSE
        assert np.array_equal(twice.acceleration, (PULSE * 2.0).acceleration)
        assert twice.pga == 2 * PULSE.pga == pytest.approx(12.0)
        assert twice.measures("Sa(0.5)")["Sa(0.5)"] == twice.spectrum(0.5)[0]
        assert {"PGA", "PGV", "Arias"} < twice.measures().keys()
        with pytest.raises(TypeError):
            PULSE * "2"

    def test_from_obspy(self):
        import obspy

        stream = obspy.read()
        for trace, factor in zip(stream, (1e-4, 2e-4, 3e-4)):
            trace.data = trace.data * factor
        before = [trace.data.copy() for trace in stream]
        motion = af.Motion.from_obspy(stream, "cm/s2", component="E", accept=["pga"])
        assert np.allclose(motion.acceleration, before[2] / 100)
        assert np.allclose(motion.vertical, before[0] / 100)
        assert all(np.array_equal(one.data, two) for one, two in zip(stream, before))
        assert motion.id == "BW.RJOB..EHE"
        with pytest.raises(RecordError, match=r"BW\.RJOB: no horizontal component 'X'"):
            af.Motion.from_obspy(stream, component="X", accept=["pga"])
        with pytest.raises(RecordError, match="join them by"):
            af.Motion.from_obspy(stream + stream[:1])
        with pytest.raises(RecordError, match="has no trace"):
            af.Motion.from_obspy(obspy.Stream())

    def test_numbers_that_look_like_g_are_warned_of(self, arch):
        in_g = af.Motion(PULSE.acceleration / 9.80665, dt=0.005)
        with pytest.warns(
            UnitWarning, match=r"0.612 m/s2 is not above the onset .*0.37 g"
        ):
            af.simulate(arch, in_g)
        with pytest.warns(UnitWarning, match="multiply it by 9.80665"):
            af.simulate_many(arch, in_g, [0.9, 1.0])

    @pytest.mark.filterwarnings("error")
    def test_others_are_not(self, arch):
        af.simulate(arch, PULSE)
        af.simulate(arch, PULSE, scale=0.01)
        known = af.Motion(PULSE.acceleration, 0.005, metadata={"unit_in_file": "g"})
        af.simulate(arch, known, scale=0.1)
        af.simulate_many(arch, PULSE, [0.05, 1.0])


class TestReadMotions:
    @pytest.fixture
    def records(self, tmp_path):
        wave = 0.1 * np.sin(np.arange(100) * 0.3)
        for number, name in enumerate(("a090", "a180", "a-UP", "b.1")):
            path = tmp_path / f"{name}.AT2"
            component = "UP" if name.endswith("UP") else "0"
            write_at2(path, wave * (number + 1), 0.01, component)
        return tmp_path

    def test_patterns_pair_components_and_show_a_table(self, records):
        found = af.read_motions(records / "A*.at2", vertical=True)
        assert [motion.id for motion in found] == ["a090", "a180"]
        assert np.allclose(found[0].vertical, 3 * found[0].acceleration)
        text = repr(found).splitlines()
        assert text[0].split()[:3] == ["id", "PGA", "[g]"]
        assert text[2].split()[1:3] == ["a180", "0.2"]
        assert "<td>a090</td>" in found._repr_html_()
        assert isinstance(found[:1], type(found))
        assert found.asked.vertical

    def test_as_a_study_reads_them(self, records):
        step = {"bandpass": {"lowest": 0.5}}
        found = af.read_motions(
            records, select=["b.1", "a090"], processing=["demean", step]
        )
        assert [motion.id for motion in found] == ["b.1", "a090"]
        assert all(motion.vertical is None for motion in found)
        assert "demean" in repr(found.asked.processing)

    def test_refusals(self, records):
        with pytest.raises(InputError, match=r"no file matches .*c\*\.AT2"):
            af.read_motions(records / "c*.AT2")
        with pytest.raises(RecordError, match=r"record b\.1 has no vertical"):
            af.read_motions(records / "b*", vertical=True)
        with pytest.raises(InputError, match=r"read_motions: files\[0\]\.unit = 3"):
            af.read_motions("a.AT2", unit=3)
        indices = [records / "index.csv", records / "more" / "index.csv"]
        with pytest.raises(InputError, match="at most one index"):
            af.read_motions(*indices)
