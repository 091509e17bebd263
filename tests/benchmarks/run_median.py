"""Make the table that brings the median Sa of synthetic motions to two ground-motion models.

``python -m tests.benchmarks.run_median`` writes ``adjustment.csv`` beside
``archfrag.motions.synthetic``. It needs pygmm; a few minutes on two cores.
"""

from multiprocessing import Pool
from pathlib import Path
from unittest import mock

import numpy as np

from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.selection import Rupture, predict
from archfrag.motions.synthetic import VS30, Options, make_motion, motion
from archfrag.motions.units import STANDARD_GRAVITY

MAGNITUDES = (4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0)
DISTANCES = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)  # nearer, the top of small ruptures is not
FREQUENCIES = (0.2, 1 / 3, 0.5, 1.0, 2.0, 10 / 3, 5.0, 10.0)
MODELS = ("CY14", "ASK14")
SEEDS, ROUNDS = 100, 4
TABLE = Path(motion.__file__).with_name("adjustment.csv")
HEAD = """\
# ln of the factor on the Fourier amplitude at each frequency [Hz] that brings the median Sa of
# simulations to the geometric mean of CY14 and ASK14 (Vs30 760 m/s, vertical strike-slip fault);
# made by tests/benchmarks/run_median.py.
"""


def adjusted(scenario):
    magnitude, distance = scenario
    periods = 1.0 / np.array(FREQUENCIES)
    rupture = Rupture(magnitude, distance, VS30, region="california")
    wanted = np.mean([predict(rupture, m, periods).ln_median for m in MODELS], axis=0)
    wanted += np.log(STANDARD_GRAVITY)
    logarithm = np.zeros(len(FREQUENCIES))
    for _ in range(ROUNDS):

        def factor(f, *_, row=logarithm):
            return np.exp(np.interp(np.log(f), np.log(FREQUENCIES), row))

        with mock.patch.object(motion, "median_adjustment", factor):
            spectra = [
                spectral_acceleration(
                    make_motion(magnitude, distance, seed, Options(vary=False)), periods
                )
                for seed in range(SEEDS)
            ]
        logarithm = logarithm + wanted - np.log(spectra).mean(axis=0)
    return logarithm


def main():
    scenarios = [(m, r) for m in MAGNITUDES for r in DISTANCES]
    with Pool(2) as pool:
        rows = pool.map(adjusted, scenarios, chunksize=1)
    names = ",".join(f"{f:.6g}" for f in FREQUENCIES)
    lines = [f"magnitude,distance_km,{names}"]
    for (magnitude, distance), row in zip(scenarios, rows, strict=True):
        values = ",".join(f"{value:.3f}" for value in row)
        lines.append(f"{magnitude:g},{distance:g},{values}")
    TABLE.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
