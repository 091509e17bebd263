"""Energy account of a chain: independent of every method that moves it."""

from archfrag.mechanics.compile import kernel
from archfrag.mechanics.laws import STICK, is_closed, slip_of, touches


@kernel
def kinetic_energy(mass, inertia, velocity):
    """Kinetic energy of the bodies relative to the ground [J].

    Parameters
    ----------
    mass, inertia : ndarray, (n_body,) [kg], [kg m2]
    velocity : ndarray, (n_body, 3) [m/s], [m/s], [rad/s]
    """
    total = 0.0
    for i in range(mass.size):
        total += mass[i] * (velocity[i, 0] ** 2 + velocity[i, 1] ** 2)
        total += inertia[i] * velocity[i, 2] ** 2
    return 0.5 * total


@kernel
def potential_energy(mass, gravity, position):
    """Weight times height of the centroids [J]; position as (n_body, 3) [m]."""
    total = 0.0
    for i in range(mass.size):
        total += mass[i] * position[i, 1]
    return total * gravity


@kernel
def ground_work(mass, impulse_x, impulse_y, mean_velocity):
    """Work of the inertia forces of a ground motion over one step [J].

    Parameters
    ----------
    mass : ndarray, (n_body,) [kg]
    impulse_x, impulse_y : float
        Integral of the ground acceleration over the step [m/s].
    mean_velocity : ndarray, (n_body, 3)
        Mean of the velocities before and after the step.
    """
    total = 0.0
    for i in range(mass.size):
        total -= mass[i] * (impulse_x * mean_velocity[i, 0] + impulse_y * mean_velocity[i, 1])
    return total


@kernel
def contact_works(contacts, work, mean_relative, old_mode, fresh):
    """Work done at the joints over a step, told apart by the law that explains it.

    Parameters
    ----------
    contacts, work
        The solved contact problem of the step; ``work.reaction`` holds impulses [N s].
    mean_relative : ndarray, (n_joint, 3)
        Mean relative velocity over the step at the pivots.
    old_mode : ndarray, (n_joint,)
        Modes in the step before.
    fresh : ndarray, (n_joint,)
        Positive where contact was made in this step or the one before.

    Returns
    -------
    (float, float, float)
        Friction, impacts, and what neither explains [J].
    """
    by_friction = by_impact = stray = 0.0
    for j in range(old_mode.size):
        fx, fy = work.reaction[j, 0], work.reaction[j, 1]
        ux, uy, uw = mean_relative[j, 0], mean_relative[j, 1], mean_relative[j, 2]
        total = fx * ux + fy * uy + work.reaction[j, 2] * uw
        mode = work.mode[j]
        slip = slip_of(mode)
        if fresh[j] > 0:
            by_impact += total
            continue
        if slip == STICK and slip_of(old_mode[j]) == STICK:
            stray += total
            continue
        corner = 0 if touches(mode, 0) else 1
        if is_closed(mode):
            nx, ny = contacts.normal[j, 0], contacts.normal[j, 1]
        elif slip >= STICK:
            nx, ny = contacts.normal_plus[j, corner, 0], contacts.normal_plus[j, corner, 1]
        else:
            nx, ny = contacts.normal_minus[j, corner, 0], contacts.normal_minus[j, corner, 1]
        ux -= uw * (contacts.point[j, corner, 1] - work.pivot[j, 1])
        uy += uw * (contacts.point[j, corner, 0] - work.pivot[j, 0])
        friction = (fy * nx - fx * ny) * (uy * nx - ux * ny)
        by_friction += friction
        stray += total - friction
    return by_friction, by_impact, stray
