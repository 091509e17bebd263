"""Makes the table that brings the median Sa of synthetic motions to two ground-motion models.

``python records/median_adjustment.py`` writes ``adjustment.csv`` beside
``archfrag.motions.synthetic``; minutes on two cores.
"""

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from unittest import mock

import numpy as np

from archfrag.motions.measures import spectral_acceleration
from archfrag.motions.motion import STANDARD_GRAVITY
from archfrag.motions.synthetic import Recipe, amplitude, make_motion
from archfrag.motions.synthetic.amplitude import VS30
from archfrag.motions.target import Rupture, predict

MAGNITUDES = (4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0)
DISTANCES = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)  # nearer, the top of small ruptures is not
FREQUENCIES = np.array([0.2, 1 / 3, 0.5, 1.0, 2.0, 10 / 3, 5.0, 10.0])
MODELS = ("CY14", "ASK14")
SEEDS, ROUNDS = 100, 4
HEAD = """\
# ln of the factor on the Fourier amplitude at each frequency [Hz] that brings the median Sa of
# simulations to the geometric mean of CY14 and ASK14 (Vs30 760 m/s, vertical strike-slip fault);
# made by records/median_adjustment.py.
"""


def adjusted(magnitude: float, distance: float) -> np.ndarray:
    """Logarithm of the factor at each frequency for one scenario."""
    periods = 1.0 / FREQUENCIES
    rupture = Rupture(magnitude, distance, VS30, region="california")
    models = [predict(rupture, model, periods)[0] for model in MODELS]
    target = np.mean(models, axis=0) + np.log(STANDARD_GRAVITY)
    logarithm = np.zeros(FREQUENCIES.size)
    for _ in range(ROUNDS):

        def factor(f, *_, row=logarithm):
            return np.exp(np.interp(np.log(f), np.log(FREQUENCIES), row))

        with mock.patch.object(amplitude, "median_adjustment", factor):
            made = [make_motion(Recipe(magnitude, distance, seed, vary=False))
                    for seed in range(SEEDS)]  # fmt: skip
        found = np.log([spectral_acceleration(each, periods) for each in made]).mean(axis=0)
        logarithm = logarithm + target - found
    return logarithm


def main() -> None:
    """Write the table."""
    scenarios = [(m, r) for m in MAGNITUDES for r in DISTANCES]
    with ProcessPoolExecutor(2) as pool:
        rows = list(pool.map(adjusted, *zip(*scenarios, strict=True)))
    names = ",".join(f"{f:.6g}" for f in FREQUENCIES)
    lines = [f"magnitude,distance_km,{names}"]
    for (magnitude, distance), row in zip(scenarios, rows, strict=True):
        lines.append(f"{magnitude:g},{distance:g},{','.join(f'{value:.3f}' for value in row)}")
    table = Path(amplitude.__file__).with_name("adjustment.csv")
    table.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
