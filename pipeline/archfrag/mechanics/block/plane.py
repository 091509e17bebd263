"""The balance of a block's contact in plane pi: Eqs 15 to 20 of Sinopoli's paper.

Plane pi is spanned by the gradient operators N_t and N_n of the contact point, and orthogonal to
the mechanism u' that rotates about it. What acts along u' moves the block and needs no reaction;
what acts in pi has to be balanced by them. N_t and N_n are not orthogonal to each other unless G
stands over the contact or beside it, so that each reaction changes the other.
"""

import math

from archfrag.mechanics.block.formulas import combine, dot, generalised, scaled
from archfrag.mechanics.compile import kernel


@kernel
def rocking_mechanism(block, arm, angular_velocity):
    """Mechanism u'_A that rotates about a contact point; orthogonal to N_t and N_n (Eq 16)."""
    return generalised(
        block, angular_velocity * arm[1], -angular_velocity * arm[0], angular_velocity
    )


@kernel
def contact_acceleration(n_t, n_n, n_t_rate, n_n_rate, velocity, acceleration):
    """Acceleration of a contact point along t and n (Eq 17) [m/s2]."""
    return (
        dot(n_t, acceleration) + dot(n_t_rate, velocity),
        dot(n_n, acceleration) + dot(n_n_rate, velocity),
    )


@kernel
def centripetal_projections(n_t_rate, n_n_rate, velocity):
    """What N_t and N_n must measure on u" for the contact to last (Eqs 17, 18) [m/s2]."""
    return -dot(n_t_rate, velocity), -dot(n_n_rate, velocity)


@kernel
def components_in_plane(n_t, n_n, on_t, on_n):
    """Components along N_t and N_n of the vector of plane pi with given projections on them.

    The two directions are not orthogonal: that is the interplay of both reactions (Eq 19).
    """
    tt, tn, nn = dot(n_t, n_t), dot(n_t, n_n), dot(n_n, n_n)
    determinant = tt * nn - tn * tn
    return (nn * on_t - tn * on_n) / determinant, (tt * on_n - tn * on_t) / determinant


@kernel
def centripetal_acceleration(n_t, n_n, n_t_rate, n_n_rate, velocity):
    """u"_A,t and u"_A,n, the known part of the acceleration, in plane pi (Eq 18)."""
    on_t, on_n = centripetal_projections(n_t_rate, n_n_rate, velocity)
    along_t, along_n = components_in_plane(n_t, n_n, on_t, on_n)
    return scaled(along_t, n_t), scaled(along_n, n_n)


@kernel
def part_in_plane(vector, mechanism):
    """Part of a vector in the plane orthogonal to a mechanism, as S^pi in Eq 19."""
    square = dot(mechanism, mechanism)
    if square == 0.0:
        return vector
    return combine(1.0, vector, -dot(vector, mechanism) / square, mechanism)


@kernel
def sticking_reaction(n_t, n_n, active, on_t, on_n):
    """R_t and R_n that hold a contact point, from the balance in plane pi (Eq 19) [N].

    `active` is S, for an impact the velocity before it (Eq 21); `on_t` and `on_n` are those of
    `centripetal_projections`, zero for an impact.
    """
    return components_in_plane(n_t, n_n, on_t - dot(n_t, active), on_n - dot(n_n, active))


@kernel
def cone_boundaries(n_t, n_n, friction):
    """N+ and N-, the boundaries of Coulomb's cone in plane pi (Eq 20)."""
    return combine(1.0, n_n, friction, n_t), combine(1.0, n_n, -friction, n_t)


@kernel
def inside_cone(tangential, normal, friction):
    """Whether a reaction is compressive and lies in Coulomb's cone (Eqs 5, 6, 20)."""
    if normal < 0.0:
        return False
    return math.isinf(friction) or abs(tangential) <= friction * normal


@kernel
def sliding_ray(friction, sense):
    """R_t and R_n of a sliding reaction of unit normal part; of unit length without sliding.

    An infinite coefficient leaves the reaction of a point that has to slide no normal part: the
    limit of Coulomb's law.
    """
    if math.isinf(friction):
        return -1.0 * sense, 0.0
    return -friction * sense, 1.0


@kernel
def sliding_stiffness(n_t, n_n, friction, sense):
    """Normal acceleration that a unit sliding reaction gives its own point [1/kg].

    N_n N- for slip towards +t, N_n N+ for slip towards -t. Where it is not positive Painleve's
    paradox arises: no smooth motion, or more than one.
    """
    ray_t, ray_n = sliding_ray(friction, sense)
    return ray_t * dot(n_n, n_t) + ray_n * dot(n_n, n_n)


@kernel
def split_along(vector, velocity):
    """Parts of a vector along a velocity and in the plane orthogonal to it (Fig 7).

    Of N_t, where the contact slides and plane pi* of N_t and N_n is not orthogonal to u': the
    first part slows the motion down, the second takes part in the balance in plane pi.
    """
    across = part_in_plane(vector, velocity)
    return combine(1.0, vector, -1.0, across), across
