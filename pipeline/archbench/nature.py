"""Blocks calibrated on shake-table tests with known verdicts, and scored on tests held back.

A test topples with probability f + (1 - 2 f) q. The chance q is the fraction of blocks that
collapse if both ends of the base scatter: the logarithms of their distances from the centre are
normal with deviation s, because the block is set up anew for each test. A verdict is flipped for
any other reason with probability f. The posterior is a sum over a grid of the block's parameters,
s and f; the prior is uniform over the grid.

``python -m archbench.nature FOLDER FILE`` writes the numbers of the validation page.
"""

import json
import sys
import time
from base64 import b64decode, b64encode
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import butter, sosfiltfilt
from scipy.special import log_ndtr, ndtr, softmax

import archfrag as af
from archbench.scene import STANDARD_GRAVITY
from archfrag.fragility.probit import binomial_lines
from archfrag.fragility.verdicts import draws_of_records
from archfrag.study.provenance import commit

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Slenderness [rad], half-diagonal [m], and how far the centre is off the middle of the base.
GRID = {
    "slenderness": np.geomspace(0.045, 0.2, 12),
    "half_diagonal": np.geomspace(0.26, 1.04, 6),
    "off_centre": np.linspace(-0.45, 0.45, 7),
}
SCATTERS = np.geomspace(0.05, 0.4, 7)
FLIPS = np.geomspace(0.002, 0.2, 9)
FRICTION = 0.6  # [1], [Hz]
LOW_PASS = 20.0
RUNS: dict[str, Any] = {"method": "time_stepping", "rtol": 1e-2}
SPLITS = 200
RESAMPLES = 1000
SEED = 20261125
LEVELS = np.geomspace(0.03, 0.8, 40)  # PGV of drawn curves [m/s]


def scales(axes: dict[str, Array]) -> dict[str, Array]:
    """Values in equal steps: logarithms of what is positive."""
    return {name: np.log(x) if x[0] > 0.0 else x for name, x in axes.items()}


class Tests(NamedTuple):
    """Table motions, a row for each of `tests.csv`, and verdicts of both specimens."""

    motions: list[af.Motion]
    table: pd.DataFrame
    toppled: dict[int, Flags]


def read_tests(folder: Path) -> Tests:
    """Read the tests: table motions low-passed at 20 Hz, with the sampling and sign stored."""
    table = pd.read_csv(folder / "tests.csv")
    kept = np.load(folder / "acceleration.npz")
    parts = np.split(
        1e-5 * STANDARD_GRAVITY * kept["acceleration"], np.cumsum(kept["length"])
    )
    motions = []
    for name, part, dt in zip(kept["test"], parts, kept["dt"]):
        low = butter(4, LOW_PASS, fs=1.0 / dt, output="sos")
        motions.append(af.Motion(sosfiltfilt(low, part), dt=float(dt), id=str(name)))
    return Tests(
        motions, table, {k: table[f"toppled_{k}"].to_numpy() == 1 for k in (1, 2)}
    )


def block(slenderness: float, half_diagonal: float, off_centre: float) -> af.Arch:
    """A block whose base reaches slenderness x (1 ± off_centre) to its right and left.

    A rectangle of this half-diagonal and of the larger slenderness, with one edge recessed.
    """
    wide = slenderness * (1.0 + abs(off_centre))
    width = 2.0 * half_diagonal * np.sin(wide)
    height = 2.0 * half_diagonal * np.cos(wide)
    lost = width * abs(off_centre) / (1.0 + abs(off_centre))
    sides = (0.0, lost) if off_centre > 0.0 else (lost, 0.0)
    return af.Block(width, height, FRICTION).recessed(*sides)


def verdicts(arch: af.Arch, motions: list[af.Motion]) -> Flags:
    """Whether each motion makes it collapse; a block that rocks 20 s after it has not."""
    runs = af.simulate_many(arch, motions, np.ones(len(motions)), **RUNS)
    return runs["status"].to_numpy() == "collapsed"


def points() -> list[list[float]]:
    """Parameters of all blocks of `GRID`, (n_block, 3)."""
    return (
        np.stack(np.meshgrid(*GRID.values(), indexing="ij"), axis=-1)
        .reshape(-1, 3)
        .tolist()
    )


def run_grid(motions: list[af.Motion]) -> Flags:
    """Verdicts of all blocks of `GRID`, its shape and (n_test,)."""
    found = [verdicts(block(*point), motions) for point in points()]
    return np.reshape(found, (*(x.size for x in GRID.values()), len(motions)))


def packed(flags: Flags) -> str:
    """Verdicts as text."""
    return b64encode(np.packbits(flags).tobytes()).decode()


def unpacked(text: str, number: int) -> Flags:
    """Verdicts of the grid from text, its shape and (number of tests,)."""
    shape = *(x.size for x in GRID.values()), number
    bits = np.frombuffer(b64decode(text), np.uint8)
    return np.unpackbits(bits, count=int(np.prod(shape))).reshape(shape).astype(bool)


def chances(collapsed: Flags) -> Array:
    """q of each scatter and grid point, (n_scatter, *grid, n_test).

    Of ends that scatter by s, the slenderness's logarithm and off_centre do so by s over root 2.
    One step of the grid is added to s in squares, and the half-diagonal is smoothed by one step,
    because single verdicts are chaotic.
    """
    near = []
    for name, x in scales(GRID).items():
        own = SCATTERS[:, None, None] ** 2
        if name == "half_diagonal":
            variance = (x[1] - x[0]) ** 2 + 0.0 * own
        else:
            variance = 0.5 * ((x[1] - x[0]) ** 2 + own)
        near.append(softmax(-0.5 * (x[:, None] - x) ** 2 / variance, axis=-1))
    return np.einsum(
        "sab,scd,sef,bdft->sacet", *near, collapsed.astype(float), optimize=True
    )


def calibrate(
    chance: Array, toppled: Flags, sets: NDArray
) -> tuple[Array, Array, Array]:
    """Calibrate on each row of `sets`, (n_set, n_test).

    Returns weights of (flip, point), (n_set, n_flip, n_point); the probability that each test
    topples, (n_set, n_test); and the logarithm of the evidence, (n_set,).
    """
    flat = chance.reshape(-1, toppled.size)
    fit = np.empty((len(sets), FLIPS.size, len(flat)))
    for k, flip in enumerate(FLIPS):
        p = flip + (1.0 - 2.0 * flip) * flat
        fit[:, k] = sets @ np.log(np.where(toppled, p, 1.0 - p)).T
    weight = softmax(fit, axis=(1, 2))
    slope = np.tensordot(weight, 1.0 - 2.0 * FLIPS, (1, 0))  # (n_set, n_point)
    constant = weight.sum(axis=2) @ FLIPS
    most = fit.max(axis=(1, 2))
    evidence = most + np.log(np.exp(fit - most[:, None, None]).mean(axis=(1, 2)))
    return weight, constant[:, None] + slope @ flat, evidence


def quantiles(
    weight: Array, at: tuple[float, ...] = (0.05, 0.5, 0.95)
) -> dict[str, list[float]]:
    """Quantiles of each parameter, of one set; the weight of a cell is spread over the cell."""
    found = {}
    axes = scales({"flip": FLIPS, "scatter": SCATTERS, **GRID})
    weight = weight.reshape([x.size for x in axes.values()])
    for k, (name, x) in enumerate(axes.items()):
        edges = np.append(x, 2.0 * x[-1] - x[-2]) - 0.5 * (x[1] - x[0])
        mass = weight.sum(axis=tuple(i for i in range(len(axes)) if i != k))
        ends = np.interp(at, np.append(0.0, np.cumsum(mass)), edges)
        found[name] = (ends if name == "off_centre" else np.exp(ends)).tolist()
    return found


def held_back(chance: Array, tests: Tests, specimen: int) -> dict[str, float]:
    """Mean share of equal verdicts in the half of the motions that was not calibrated on.

    Beside it: the distinct elements' best column in hindsight and the one that is best in the
    calibrated half, and the threshold of PGV that is best there.
    """
    motion = tests.table["motion"].to_numpy()
    toppled = tests.toppled[specimen]
    names = np.unique(motion)
    generator = np.random.default_rng(SEED)
    half = [generator.permutation(names)[: names.size // 2] for _ in range(SPLITS)]
    known = np.array([np.isin(motion, each) for each in half], float)

    def right(answers: NDArray) -> Array:  # (n_split or 1, n_test)
        return ((answers == toppled) * (1.0 - known)).sum(axis=1) / (1.0 - known).sum(
            axis=1
        )

    columns = tests.table.filter(like=f"dem: Specimen {specimen}").to_numpy().T
    pgv = tests.table["pgv_m_s"].to_numpy()
    above = pgv >= pgv[:, None]
    best = [(known @ (each == toppled).T).argmax(axis=1) for each in (columns, above)]
    ours = right(calibrate(chance, toppled, known)[1] > 0.5)
    return {
        "archfrag": ours.mean(),
        "deviation": ours.std(),
        "elements": max(right(each[None]).mean() for each in columns),
        "elements_chosen": right(columns[best[0]]).mean(),
        "threshold": right(above[best[1]]).mean(),
    }


def left_out(chance: Array, tests: Tests, specimen: int) -> dict[str, Any]:
    """Leave-one-motion-out: share of equal verdicts, mean ln score, and what is missed."""
    motion = tests.table["motion"].to_numpy()
    toppled = tests.toppled[specimen]
    names, number = np.unique(motion, return_inverse=True)
    p = calibrate(chance, toppled, names[:, None] != motion)[1][
        number, np.arange(number.size)
    ]
    ratio = tests.table["pga_nominal_g"] * STANDARD_GRAVITY / tests.table["pgv_m_s"]
    false = (p > 0.5) & ~toppled
    missed = (p <= 0.5) & toppled
    score = np.log(np.where(toppled, p, 1.0 - p)).mean()
    found = {
        "equal": 1.0 - np.mean(false | missed),
        "score": score,
        "ratio": ratio.median(),
    }
    for name, own in (("false", false), ("missed", missed)):
        counts = (
            tests.table["motion"][own]
            .value_counts()
            .sort_index(kind="stable")
            .to_dict()
        )
        found[name] = {
            "tests": int(own.sum()),
            "ratio": ratio[own].median(),
            "motions": counts,
        }
    return found


def curve_of(measure: Array, toppled: NDArray, motion: NDArray) -> dict[str, Any]:
    """Theta and beta, their 90 % intervals by resampling motions, and the curve with its band."""
    drawn = draws_of_records(motion, motion.size, SEED, RESAMPLES)
    weight = np.vstack([np.ones(motion.size), drawn])
    a, b, *_ = binomial_lines(np.log(measure), weight * toppled, weight)
    ends = np.nanquantile([np.exp(-a / b), 1.0 / b], [0.05, 0.95], axis=1).T.tolist()
    p = ndtr(a[:, None] + b[:, None] * np.log(LEVELS))
    shown = [p[0], *np.nanquantile(p, [0.05, 0.95], axis=0)]
    return {
        "theta": [np.exp(-a[0] / b[0]), *ends[0]],
        "beta": [1.0 / b[0], *ends[1]],
        "curve": np.round(shown, 4).tolist(),
    }


def surface_of(table: pd.DataFrame, toppled: Flags) -> dict[str, Any]:
    """Probit of intercept, ln PGV [m/s] and ln PGA [g]; ln likelihood that PGA adds to PGV."""
    rows = np.log(
        table.assign(one=np.e)[["one", "pgv_m_s", "pga_nominal_g"]].to_numpy()
    )
    sign = np.where(toppled, 1.0, -1.0)
    alone, both = (
        minimize(
            lambda p, n=n: -log_ndtr(sign * (rows[:, :n] @ p)).sum(),
            np.zeros(n),
            tol=1e-9,
        )
        for n in (2, 3)
    )
    return {"line": both.x.tolist(), "gain": alone.fun - both.fun}


def contradictions(level: Array, toppled: Flags, motion: NDArray) -> int:
    """Number of tests on the wrong side of the best threshold of their own motion."""
    off = 0
    for name in np.unique(motion):
        own = toppled[motion == name][np.argsort(level[motion == name], kind="stable")]
        off += min(own[:k].sum() + (~own[k:]).sum() for k in range(own.size + 1))
    return int(off)


def intervals_that_hold(tests: Tests, chance: Array, cases: int) -> dict[str, int]:
    """In how many synthetic cases the 90 % interval of each parameter holds it.

    Parameters are drawn from the prior; each test has a block of its own, and 2 % of the verdicts
    are flipped.
    """
    number = len(tests.motions)
    held = dict.fromkeys(["scatter", *GRID], 0)
    axes = scales({"scatter": SCATTERS, **GRID})
    bounds = [[x[end] for x in axes.values()] for end in (0, -1)]
    for seed in range(cases):
        generator = np.random.default_rng([SEED, seed])
        *logs, off_centre = generator.uniform(*bounds).tolist()
        scatter, slenderness, size = np.exp(logs).tolist()
        ends = slenderness * (1.0 + off_centre * np.array([[1.0], [-1.0]]))
        ends = ends * np.exp(scatter * generator.standard_normal((2, number)))
        middle = 0.5 * ends.sum(axis=0)
        own = zip(middle.tolist(), (ends[0] / middle - 1.0).tolist(), tests.motions)
        failed = [verdicts(block(a, size, e), [each])[0] for a, e, each in own]
        toppled = np.array(failed) ^ (generator.random(number) < 0.02)
        known = quantiles(calibrate(chance, toppled, np.ones((1, number)))[0][0])
        for name, value in zip(held, (scatter, slenderness, size, off_centre)):
            held[name] += known[name][0] <= value <= known[name][2]
    return held


def measure(tests: Tests, collapsed: Flags) -> dict[str, Any]:
    """All numbers of the page but those of synthetic cases, from the verdicts of the grid."""
    motion = tests.table["motion"].to_numpy()
    pgv, pga = (tests.table[name].to_numpy() for name in ("pgv_m_s", "pga_nominal_g"))
    started = time.process_time()
    verdicts(block(0.1, 0.5, 0.0), (2 * tests.motions)[:490])
    found: dict[str, Any] = {"seconds_490": time.process_time() - started}
    chance = chances(collapsed)
    for k, toppled in tests.toppled.items():
        (weight,), (p,), _ = calibrate(chance, toppled, np.ones((1, toppled.size)))
        blocks = collapsed.reshape(-1, toppled.size)
        best = blocks[(blocks == toppled).sum(axis=1).argmax()]
        own: dict[str, Any] = {
            "parameters": quantiles(weight),
            "equal": np.mean((p > 0.5) == toppled),
            "equal_best_block": np.mean(best == toppled),
            "held_back": held_back(chance, tests, k),
            "left_out": left_out(chance, tests, k),
        }
        for name, answers in (
            ("tests", toppled),
            ("archfrag", p > 0.5),
            ("one block", best),
        ):
            own[name] = {
                "PGV": curve_of(pgv, answers, motion),
                "PGA": curve_of(pga, answers, motion),
                "surface": surface_of(tests.table, answers),
                "contradictions": contradictions(pgv, answers, motion),
            }
        found[f"specimen {k}"] = own
    return found


if __name__ == "__main__":
    known = read_tests(Path(sys.argv[1]))
    grid = run_grid(known.motions)
    numbers = {"commit": commit(), **measure(known, grid), "verdicts": packed(grid)}
    numbers["held of 50"] = intervals_that_hold(known, chances(grid), 50)
    Path(sys.argv[2]).write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
