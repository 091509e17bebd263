"""Arches under pulses beside other solvers: amplitudes that collapse, positions, peaks."""

import numpy as np
import pytest

import archbench  # noqa: F401  registers the baselines
import archfrag as af
from tests.validation.scenes import falls, first_collapse, g, oppenheim, pulse

TOPIC = "Arch under pulses"
FINE = {"method": "event_driven", "rtol": 1e-7}
SWING = "+a for {:g} s, −a/2 for {:g} s"
# Middles of last standing and first collapsing amplitude [g], straight-sided voussoirs.
LEAST = {
    0.3: {
        "LMGC90, 1 ms": 0.694, "Siconos, 1 ms": 0.6815, "MuJoCo, 2 ms": 0.694,
        "MuJoCo, 0.5 ms": 0.6815, "pymunk, 0.5 ms": 0.694,
    },
    0.5: {
        "LMGC90, 1 ms": 0.453, "Siconos, 1 ms": 0.455, "MuJoCo, 2 ms": 0.441,
        "MuJoCo, 0.5 ms": 0.447, "pymunk, 0.5 ms": 0.422,
    },
}  # fmt: skip
OWN = {0.3: (0.6797 + 0.6812) / 2, 0.5: (0.4388 + 0.4403) / 2}
SHORT = {(0.5, "pymunk, 0.5 ms"): "5 to 8 % below the other solvers"}
PEAKS = (
    ("LMGC90, 0.1 ms", 0.187, ""),
    ("MuJoCo, 0.1 ms", 0.195, "0.182 to 0.195 m for its steps of 1 to 0.1 ms"),
    ("Siconos, finest step", 0.161, "0.145 to 0.161 m for its steps; no common limit"),
)


class TestTwoParts:
    @pytest.mark.parametrize("duration", LEAST)
    def test_least_amplitude(self, validated, duration):
        case = SWING.format(duration, 2 * duration)
        rough = OWN[duration]
        for sector in (True, False):
            arch = oppenheim(sector=sector)
            found = first_collapse(
                lambda a, arch=arch: falls(arch, pulse(a, duration)),
                0.94 * rough,
                1.1 * rough,
                0.0025,
            )
            name = "least a that collapses" + ("" if sector else ", straight-sided voussoirs")
            codes = {"own prototype, 0.125 ms": rough} if sector else LEAST[duration]
            for code, reference in codes.items():
                validated(
                    case, name, found, reference, code, rel=0.01 if sector else 0.03, unit="g",
                    short=SHORT.get((duration, code), ""),
                )  # fmt: skip

    def test_one_degree_of_freedom_is_too_strong(self, validated):
        """Mirrored hinges after an impact lose the energy of the other mega-voussoirs."""
        found = first_collapse(
            lambda a: falls(oppenheim(), pulse(a, 0.3), method="four_link"), 0.8, 2.0, 0.05
        )
        validated(
            SWING.format(0.3, 0.6), "least a that collapses, four links", found, 1.6,
            "own prototype", rel=0.05, unit="g",
        )  # fmt: skip

    def test_keystone_before_the_first_impact(self, validated):
        history = af.simulate(
            oppenheim(sector=False), pulse(0.5, 0.3), history=True, **FINE
        ).history
        key = history.displacement.sel(component="x", voussoir=3)
        for time, expected in ((0.2, -0.01621), (0.4, -0.04211)):
            validated(
                SWING.format(0.3, 0.6) + ", a 0.5 g", f"keystone at {time:g} s",
                np.interp(time, history.time, key), expected, "LMGC90 and Siconos, 0.5 ms",
                rel=1e-3, unit="m",
            )  # fmt: skip

    def test_largest_displacement(self, validated):
        run = af.simulate(oppenheim(sector=False), pulse(0.5, 0.3), **FINE)
        for code, reference, short in PEAKS:
            validated(
                SWING.format(0.3, 0.6) + ", a 0.5 g", "largest displacement",
                run.peak_displacement, reference, code, rel=0.03, unit="m", short=short,
            )  # fmt: skip


class TestRectangle:
    CASE = "{:g} g for a time, then nothing"

    def durations(self, amplitude, **options):
        def collapses(duration):
            return falls(oppenheim(), pulse(amplitude, duration, back=0.0), **options)

        return collapses

    @pytest.mark.parametrize(("amplitude", "least"), [(0.5, 0.634), (0.7, 0.365), (1.0, 0.2197)])
    def test_least_duration(self, validated, amplitude, least):
        found = first_collapse(
            self.durations(amplitude), 0.95 * least, 1.05 * least, 0.004 * least
        )
        validated(
            self.CASE.format(amplitude), "least time that collapses", found, least,
            "own prototype, 0.25 ms", rel=0.01, unit="s",
        )  # fmt: skip

    @pytest.mark.parametrize(("amplitude", "least"), [(0.5, 0.662), (0.7, 0.375), (1.0, 0.232)])
    def test_of_the_four_link_baseline(self, validated, amplitude, least):
        found = first_collapse(
            self.durations(amplitude, method="four_link"), 0.9 * least, 1.1 * least, 0.01 * least
        )
        validated(
            self.CASE.format(amplitude), "least time that collapses, four links", found, least,
            "four-link equation of motion", rel=3e-3, unit="s",
        )  # fmt: skip


class TestSemicircle:
    TOPIC = "Semicircle of 27 voussoirs"

    def test_fall_of_a_ring_too_thin(self, validated):
        thin = af.Arch.circular(10.0, 0.95, 180.0, 27, 0.7, sector=False)
        still = np.zeros((27, 3))
        history = af.simulate(
            thin, af.Motion(np.zeros(400), 0.01), initial=(still, still), history=True
        ).history
        away = np.hypot(*np.moveaxis(history.displacement.values, -1, 0)).max(axis=1)
        found = np.interp(2 * 0.95, away, history.time.values)
        for code, reference in (("LMGC90", 1.31), ("MuJoCo", 1.24), ("pymunk", 1.15)):
            validated(
                "t/R 0.095, self-weight", "time to fall by two thicknesses", found, reference,
                code, rel=0.05, unit="s",
                short="" if code == "LMGC90" else "the solvers' times differ by 14 %",
            )  # fmt: skip

    def test_harmonic_motion(self, validated):
        arch = af.Arch.circular(10.0, 1.5, 180.0, 27, 0.7, sector=False)
        time = np.arange(0.0, 5.0, 1e-3)
        run = af.simulate(arch, af.Motion(0.3 * g * np.sin(2 * np.pi * time), 1e-3), follow=0.0)
        for code, reference in (("LMGC90", 0.224), ("pymunk", 0.225), ("MuJoCo", 0.241)):
            validated(
                "t/R 0.15, 0.3 g at 1 Hz for 5 s", "largest displacement", run.peak_displacement,
                reference, code, rel=0.05, unit="m",
                short="" if code != "MuJoCo" else "the solvers' peaks differ by 8 %",
            )  # fmt: skip
