"""Steps of the Runge-Kutta method between events: order 5, its dense output 4, its own error."""

import numpy as np
from scipy.integrate import solve_ivp

import archfrag as af
from archbench.paper.arch import hinged_motion
from tests.physics.linkages import hinged_arch, rotate
from tests.physics.moving import Moving

GROUND = (1.0, 5.0, -0.5, 3.0)
SPAN = 0.4


def linkage():
    """Three voussoirs on four hinges; their motion by nine dense equations."""
    arch = af.Arch.circular(10.0, 1.5, 157.5, 3, 0.7)
    hinges = [(0, 1), (1, 0), (2, 1), (3, 0)]
    position, velocity, modes = hinged_arch(arch, hinges, 0.02, 0.3)
    chain = arch.chain
    corners = [c for _, c in hinges]

    def rate(time, y):
        places, speeds = y.reshape(2, 3, 3)
        face = chain.face_after[range(4), corners]
        hinge = [place[:2] + rotate(arm, place[2]) for place, arm in zip(places, face)]
        hinge = np.array([*hinge, face[3]])
        ground_x, rate_x, ground_y, rate_y = GROUND
        force = [
            -ground_x - rate_x * time,
            -chain.gravity - ground_y - rate_y * time,
            0.0,
        ]
        free = np.tile(force, (3, 1))
        bodies = chain.mass, chain.inertia, places[:, :2]
        acceleration, _ = hinged_motion(*bodies, hinge, speeds[:, 2], free)
        return np.concatenate([speeds.ravel(), acceleration.ravel()])

    def exact(time):
        start = np.concatenate([position.ravel(), velocity.ravel()])
        done = solve_ivp(
            rate, (0.0, time), start, method="DOP853", rtol=1e-12, atol=1e-14
        )
        return done.y[:, -1].reshape(6, 3)

    return Moving(chain, position, velocity, modes, GROUND), exact


SIZES = (0.08, 0.04, 0.02)


def order(errors):
    """Power of the step size in errors of steps halved twice."""
    assert errors[-1] > 1e-14
    return 0.5 * np.log2(errors[0] / errors[-1])


class TestOrder:
    def test_of_motion_over_a_span_is_five(self):
        _, exact = linkage()
        expected = exact(SPAN)
        errors = []
        for number in (8, 16, 32):
            moving, _ = linkage()
            for _ in range(number):
                moving.step(SPAN / number)
                moving.go_on(SPAN / number)
            end = np.concatenate(moving.state)
            errors.append(np.abs(end - expected).max())
        assert 4.7 < order(errors) < 6.3

    def test_of_the_dense_output_is_four(self):
        """Inside a step its error is of the fifth power of the step, at its ends of the sixth."""
        moving, exact = linkage()
        for part, power in ((0.3, 5.0), (0.5, 5.0), (0.8, 5.0), (1.0, 6.0)):
            errors = []
            for size in SIZES:
                moving.step(size)
                found = np.concatenate(moving.inside(part))
                errors.append(np.abs(found - exact(part * size)).max())
            assert order(errors) > power - 0.4
