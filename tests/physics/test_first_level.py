"""First level: reactions at the hinges of three mega-voussoirs (Eqs 29-33), against nine
equations of balance solved densely."""

import numpy as np

from archbench.paper.arch import cross, hinged_motion, mechanism_of, middle_reactions
from tests.physics.adapters import by_four_hinges

HINGES = np.array([[-9.0, 1.0], [-4.0, 8.0], [3.0, 9.0], [9.0, 2.0]])


def random_linkage(rng):
    """Three bodies of any mass on four hinges, in motion, under any body forces."""
    hinge = HINGES + rng.uniform(-1.5, 1.5, (4, 2))
    centroid = 0.5 * (hinge[1:] + hinge[:-1]) + rng.uniform(-2.0, 2.0, (3, 2))
    mass = rng.uniform(1e3, 1e5, 3)
    inertia = rng.uniform(1e3, 1e6, 3)
    spin = rng.uniform(-1.0, 1.0) * mechanism_of(centroid, hinge)[:, 2]
    return (
        mass,
        inertia,
        centroid,
        hinge,
        spin,
        rng.normal(size=(3, 3)) * [10.0, 10.0, 1.0],
    )


class TestFourHinges:
    def test_accelerations_and_forces_balance_the_three_bodies(self):
        rng = np.random.default_rng(1)
        for _ in range(300):
            *bodies, spin, free = random_linkage(rng)
            found = by_four_hinges(*bodies, rng.integers(0, 2, 4), spin, free)
            expected, forces = hinged_motion(*bodies, spin, free)
            wrench = np.column_stack([forces, cross(bodies[3], forces)])
            assert found.solved
            assert (
                np.abs(found.velocity - expected).max() < 1e-10 * np.abs(expected).max()
            )
            assert (
                np.abs(found.wrench - wrench) < 1e-9 * np.abs(wrench).max(axis=0)
            ).all()

    def test_of_weightless_outer_bodies_the_reactions_meet_at_the_rotation_centre(self):
        """What the paper states of the full reactions (Eq 30) holds where nothing else acts."""
        mass, inertia, centroid, hinge, spin, free = random_linkage(
            np.random.default_rng(2)
        )
        mass[[0, 2]] = 1e-9
        inertia[[0, 2]] = 1e-9
        found = by_four_hinges(mass, inertia, centroid, hinge, [1, 0, 1, 0], spin, free)
        middle = mass[1], inertia[1], centroid[1], hinge, found.velocity[1], free[1]
        along, left = middle_reactions(*middle)
        size = np.abs(along).max()
        assert left < 1e-8 * size / np.sqrt(mass[1])
        lines = (hinge[0] - hinge[1], hinge[2] - hinge[3])
        for j, line, force in zip((1, 2), lines, along):
            expected = force * line / np.linalg.norm(line)
            assert np.abs(found.wrench[j, :2] - expected).max() < 1e-8 * size

    def test_without_a_rotation_centre_of_the_middle_body_it_declines(self):
        mass, inertia, centroid, _, spin, free = random_linkage(
            np.random.default_rng(3)
        )
        for lean, possible in ((0.0, False), (1e-3, False), (0.1, True)):
            hinge = np.array([[0.0, 0.0], [lean, 5.0], [6.0, 5.0], [6.0, 0.0]])
            found = by_four_hinges(
                mass, inertia, centroid, hinge, [1, 0, 1, 0], spin, free
            )
            assert found.solved is possible
