"""Response of a linear oscillator to a ground motion that is linear between samples.

The recursion is that of Nigam and Jennings (1969), BSSA 59(2), exact for such a motion.
"""

import numpy as np

from archfrag.physics.kernels.kernel import kernel


@kernel
def largest_response(ground, dt, w, z, directions, largest):
    """Raise `largest`, (n_direction,), to the largest |y| in each direction [m/s2].

    y is the displacement of the oscillator times `w` squared. `ground` has the samples of the
    ground acceleration, complex numbers x + i y [m/s2], `dt` apart [s]; `w` is the circular
    frequency [rad/s], `z` the damping ratio [1], and `directions` are complex numbers of size one.

    Reads: ground, directions (imag, real), largest.
    Writes: largest.
    """
    points = max(1, int(np.ceil(200.0 * dt * w / (2.0 * np.pi))))
    step = dt / points
    root = np.sqrt(1.0 - z * z)
    decay = np.exp(-z * w * step)
    cosine = decay * np.cos(root * w * step)
    sine = decay * np.sin(root * w * step) / root
    f = ground[0]  # y = y' = 0
    g = 0.0 * ground[0]
    slope = 0.0 * ground[0]
    least = 0.0
    for n in range(ground.size - 1):
        change = (ground[n + 1] - ground[n]) / dt - slope
        slope += change
        f = f - 2.0 * z / w * change
        g = g + change / w
        for k in range(points):
            y = f - ground[n] + slope * (2.0 * z / w - k * step)
            if y.real**2 + y.imag**2 > least**2:
                least = np.inf
                for i in range(directions.size):
                    here = abs(
                        y.real * directions[i].real + y.imag * directions[i].imag
                    )
                    largest[i] = max(largest[i], here)
                    least = min(least, largest[i])
            f, g = (
                (cosine + z * sine) * f + sine * g,
                (cosine - z * sine) * g - sine * f,
            )
