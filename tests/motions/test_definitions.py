"""Each intensity measure against its definition, written here anew, on real and shipped records.

The oscillator is a complex first-order filter, exact for an acceleration that is linear between
samples; the filter of FIV3 is the analogue one by the bilinear transform, written out. Rotated
measures are those of motions that are rotated sample by sample.
"""

import numpy as np
import pytest
from scipy.signal import lfilter

from archfrag.motions.index import load_index
from archfrag.motions.measures import PLAIN, measure
from archfrag.motions.motion import Motion
from archfrag.motions.read import load_motion, read_motion

from .helpers import REAL_RECORDS, SHIPPED, needs_real_records

G = 9.80665
NAMES = [
    *PLAIN,
    "Sa(0.05)",
    "Sa(0.4)",
    "AvgSA(0.2,1)",
    "Sa_avg2(0.3)",
    "Sa_avg3(0.5)",
    "FIV3(0.1)",
    "FIV3(0.5)",
    "FIV3(1.7)",
]


def trapezoid(wave, dt):
    return np.concatenate([[0.0], np.cumsum(0.5 * dt * (wave[1:] + wave[:-1]))])


def sa(wave, dt, period):
    w = 2.0 * np.pi / period
    rate = w * (-0.05 + 1j * np.sqrt(1.0 - 0.05**2))
    finer = max(1, int(np.ceil(200.0 * dt / period)))
    h = dt / finer
    count = wave.size + 1 + int(np.ceil(period / dt))
    ground = np.zeros(count)
    ground[: wave.size] = wave
    fine = np.interp(
        np.arange((count - 1) * finer + 1) / finer, np.arange(count), ground
    )
    growth = np.exp(rate * h)
    late = (growth - 1.0 - rate * h) / rate**2 / h
    early = (growth - 1.0) / rate - late
    force = -(early * fine[:-1] + late * fine[1:])
    state = lfilter([1.0], [1.0, -growth], force)  # of u' - conj(rate) u
    return w * w * np.abs(state.imag / rate.imag).max()


def low_pass(wave, dt, corner):
    k = np.tan(np.pi * corner * dt)
    norm = 1.0 + np.sqrt(2.0) * k + k * k
    b = k * k / norm
    a1 = 2.0 * (k * k - 1.0) / norm
    a2 = (1.0 - np.sqrt(2.0) * k + k * k) / norm
    x1 = x2 = y1 = y2 = 0.0
    out = []
    for x in wave.tolist():
        y = b * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2
        x1, x2, y1, y2 = x, x1, y, y1
        out.append(y)
    return np.array(out)


def fiv3(wave, dt, period):
    corner = 0.85 / period
    filtered = wave if corner >= 0.5 / dt else low_pass(wave, dt, corner)
    velocity = trapezoid(filtered, dt)
    whole, part = divmod(0.7 * period / dt, 1.0)
    whole = int(whole)
    steps = []
    for i in range(velocity.size):
        if i + whole + part > velocity.size - 1:
            break
        end = velocity[i + whole]
        if part:
            end += part * (velocity[i + whole + 1] - end)
        steps.append(end - velocity[i])
    middle = range(1, len(steps) - 1)
    high = [steps[i] for i in middle if steps[i - 1] < steps[i] > steps[i + 1]]
    low = [steps[i] for i in middle if steps[i - 1] > steps[i] < steps[i + 1]]
    return max(abs(sum(sorted(high)[-3:])), abs(sum(sorted(low)[:3])))


def cav(wave, dt, windows=False):
    total = 0.0
    size = round(1.0 / dt) if windows else wave.size
    for start in range(0, wave.size - 1, size):
        part = wave[start : start + size + 1]
        if windows and np.abs(part).max() < 0.025 * G:
            continue
        for one, other in zip(part[:-1].tolist(), part[1:].tolist()):
            if one * other < 0.0:
                total += 0.5 * dt * (one**2 + other**2) / abs(one - other)
            else:
                total += 0.5 * dt * abs(one + other)
    return total


def duration(wave, dt):
    energy = trapezoid(wave**2, dt) / np.trapezoid(wave**2, dx=dt)
    time = np.arange(wave.size) * dt
    return np.interp(0.95, energy, time) - np.interp(0.05, energy, time)


def mean(wave, dt, periods):
    return np.prod([sa(wave, dt, period) for period in periods]) ** (1.0 / len(periods))


def housner(wave, dt):
    periods = 0.1 + 0.02 * np.arange(121)
    velocity = [sa(wave, dt, period) * period / (2.0 * np.pi) for period in periods]
    return np.trapezoid(velocity, dx=0.02)


def defined(wave, dt, name):
    kind, _, inside = name.removesuffix(")").partition("(")
    periods = [float(part) for part in inside.split(",") if part]
    return {
        "PGA": lambda: max(wave.max(), -wave.min()),
        "PGV": lambda: np.abs(trapezoid(wave, dt)).max(),
        "PGD": lambda: np.abs(trapezoid(trapezoid(wave, dt), dt)).max(),
        "Arias": lambda: np.pi / (2.0 * G) * np.trapezoid(wave**2, dx=dt),
        "CAV": lambda: cav(wave, dt),
        "CAVstd": lambda: cav(wave, dt, windows=True),
        "D5_95": lambda: duration(wave, dt),
        "HI": lambda: housner(wave, dt),
        "Sa": lambda: sa(wave, dt, *periods),
        "AvgSA": lambda: mean(wave, dt, [0.2 * 5.0 ** (i / 9.0) for i in range(10)]),
        "Sa_avg2": lambda: mean(
            wave, dt, [periods[0] * (0.2 + 0.2 * i) for i in range(10)]
        ),
        "Sa_avg3": lambda: mean(
            wave, dt, [periods[0] * (0.2 + 2.8 * i / 9.0) for i in range(10)]
        ),
        "FIV3": lambda: fiv3(wave, dt, *periods),
    }[kind]()


def real_motions():
    """The first 20 records of one component that lie beside the repository."""
    return [read_motion(path) for path in sorted((REAL_RECORDS / "at2").iterdir())[:20]]


def shipped_motions():
    return [load_motion(entry) for entry in load_index(SHIPPED)[::4]]


@pytest.mark.parametrize(
    "motions",
    [
        shipped_motions,
        pytest.param(real_motions, marks=needs_real_records),
    ],
)
def test_measures_are_what_they_are_defined_to_be(motions):
    for motion in motions():
        for name in NAMES:
            expected = defined(motion.acceleration, motion.dt, name)
            assert measure(motion, name) == pytest.approx(expected, rel=1e-6), (
                motion.id,
                name,
            )


def rotated(motion, angle):
    one, other = motion.acceleration, motion.transverse
    return np.cos(np.deg2rad(angle)) * one + np.sin(np.deg2rad(angle)) * other


def made_pair():
    """Two components of 6 s that are made: noise of two bands under a window."""
    generator = np.random.default_rng(5)
    window = np.sin(np.pi * np.arange(600) / 599.0)
    one, other = (
        np.convolve(generator.standard_normal(620), np.ones(length) / length)[10:610]
        for length in (3, 8)
    )
    return Motion(3.0 * one * window, 0.01, transverse=2.0 * other * window, id="made")


def real_pair():
    one, other = (
        read_motion(REAL_RECORDS / "at2" / f"RSN753_LOMAP_CLS{azimuth}.AT2")
        for azimuth in ("000", "090")
    )
    size = min(one.acceleration.size, other.acceleration.size)
    samples = one.acceleration[:size], other.acceleration[:size]
    return Motion(samples[0], one.dt, transverse=samples[1], id="Corralitos")


@pytest.mark.parametrize(
    "pair", [made_pair, pytest.param(real_pair, marks=needs_real_records)]
)
def test_rotated_measures_are_percentiles_over_every_degree(pair):
    motion = pair()
    slow = {"HI"} if motion.id != "made" else set()  # 22,000 spectra of a long record
    for name in [each for each in NAMES if each not in slow]:
        each = [defined(rotated(motion, a), motion.dt, name) for a in range(180)]
        for share in (50, 100):
            assert measure(motion, f"RotD{share}({name})") == pytest.approx(
                np.percentile(each, share), rel=1e-6
            ), name


def test_fiv3_of_a_record_shorter_than_its_window_is_zero():
    assert measure(made_pair(), "FIV3(9)") == 0.0


def test_fiv3_without_filter_where_its_corner_is_beyond_the_nyquist_frequency():
    motion = made_pair()
    expected = fiv3(motion.acceleration, motion.dt, 0.01)
    assert measure(motion, "FIV3(0.01)") == pytest.approx(expected, rel=1e-9)
