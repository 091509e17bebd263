"""How the cost of a contact problem grows with the number of voussoirs.

Prints the median time of one solution for each number, from the modes of the state itself and
warm-started as in a time step, and the exponent of a power law fitted to them. Run it alone on a
quiet machine.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.mechanics.adapters import posed
from tests.physics.random_states import KINDS, random_state

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.contact.blocks import FOR_STEPS
from archfrag.mechanics.contact.modes import settle_modes, solve_contact, velocity_scale
from archfrag.mechanics.contact.path import PATHS, SOFT_PATHS, new_path, solve_by_path

NUMBERS = (9, 18, 36, 54, 81, 108)
STATES = 40
REPEATS = 50


@kernel
def solve_often(model, position, work, path, touch, slide, repeats):
    """Solve one contact problem from the same modes so many times; whether it was solved."""
    solved = False
    for _ in range(repeats):
        for j in range(slide.size):
            work.touch[j, 0], work.touch[j, 1] = touch[j, 0], touch[j, 1]
            work.slide[j] = slide[j]
        never = False, 0.0, 0.0
        solved, _, _ = solve_contact(model, position, work, True, never, FOR_STEPS)
        if not solved:
            scale = velocity_scale(position, work)
            solved, _ = settle_modes(model, position, work, scale, FOR_STEPS, 1)
        if not solved:
            solved, _, _, _ = solve_by_path(model, position, work, path, PATHS, SOFT_PATHS)
    return solved


def measure(n_body: int) -> tuple[float, float]:
    """Median times of a cold and of a warm-started solution [s]."""
    rng = np.random.default_rng(n_body)
    cold, warm = [], []
    for trial in range(STATES):
        problem = random_state(rng, n_body, rng.uniform(0.2, 1.2), KINDS[trial % len(KINDS)])
        model, position, work = posed(problem)
        path = new_path(model)
        for times in (cold, warm):
            touch, slide = work.touch.copy(), work.slide.copy()
            began = time.perf_counter()
            assert solve_often(model, position, work, path, touch, slide, REPEATS)
            times.append((time.perf_counter() - began) / REPEATS)
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
