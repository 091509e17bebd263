"""How the cost of a contact problem grows with the number of voussoirs.

Prints the median time of one solution for each number, warm-started as in a time step, and the
exponent of a power law fitted to them. Run it alone on a quiet machine.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.physics.random_states import KINDS, random_state

from archfrag.mechanics.former_contact import contact_work, solve_contact

NUMBERS = (9, 18, 36, 54, 81, 108)
STATES = 40
REPEATS = 5


def measure(n_body: int) -> tuple[float, float]:
    """Median times of a cold and of a warm-started solution [s]."""
    rng = np.random.default_rng(n_body)
    cold, warm = [], []
    for trial in range(STATES):
        mass, inertia, contacts, friction, free, mode = random_state(
            rng, n_body, rng.uniform(0.2, 1.2), KINDS[trial % len(KINDS)]
        )
        work = contact_work(n_body, n_body + 1)
        for times, start in ((cold, lambda m=mode: m), (warm, lambda w=work: w.mode.copy())):
            first = start()
            spent = []
            for _ in range(REPEATS):
                work.mode[:] = first
                began = time.perf_counter()
                solve_contact(mass, inertia, contacts, friction, free, work)
                spent.append(time.perf_counter() - began)
            times.append(float(np.median(spent)))
    return float(np.median(cold)), float(np.median(warm))


def main() -> None:
    """Measure all numbers and print a table and the exponents."""
    measure(NUMBERS[0])
    rows = np.array([measure(n) for n in NUMBERS])
    print("voussoirs  cold [us]  warm [us]")
    for n, (cold, warm) in zip(NUMBERS, rows * 1e6):
        print(f"{n:9d}  {cold:9.1f}  {warm:9.1f}")
    for name, times in zip(("cold", "warm"), rows.T):
        exponent = np.polyfit(np.log(NUMBERS), np.log(times), 1)[0]
        print(f"growth, {name} start: n^{exponent:.3f}")


if __name__ == "__main__":
    main()
