"""Pivots of joints and body forces, in the layout of archfrag.mechanics.former_contact."""

from archfrag.mechanics.compile import kernel


@kernel
def place_pivots(contacts, pivot):
    """Middle of the two contact points of each joint, (n_joint, 2) [m], into `pivot`."""
    for j in range(pivot.shape[0]):
        pivot[j, 0] = 0.5 * (contacts.point[j, 0, 0] + contacts.point[j, 1, 0])
        pivot[j, 1] = 0.5 * (contacts.point[j, 0, 1] + contacts.point[j, 1, 1])


@kernel
def uniform_force(n_body, horizontal, vertical, gravity, free):
    """Accelerations without reactions, (n_body, 3), into `free` [m/s2]."""
    for i in range(n_body):
        free[i, 0] = -horizontal
        free[i, 1] = -gravity - vertical
        free[i, 2] = 0.0
