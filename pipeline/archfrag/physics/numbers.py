"""Arithmetic of kernels on numbers of one run, or of four side by side."""

from archfrag.physics.kernels.kernel import inlined
from archfrag.physics.kernels.primitives import fused, lane, select, width


@inlined
def count_of(mask):
    """Return in how many runs `mask` holds."""
    count = 0
    for k in range(width(mask)):
        count += 1 if lane(mask, k) else 0
    return count


@inlined
def dot(a, b):
    """Return the scalar product of two vectors of three numbers."""
    return fused(a[0], b[0], fused(a[1], b[1], a[2] * b[2]))


@inlined
def choose(mask, a, b):
    """Return the pair `a` where `mask` holds, else the pair `b`."""
    return select(mask, a[0], b[0]), select(mask, a[1], b[1])


@inlined
def larger(x, y):
    """Return the larger of two numbers; `y` where one is nan."""
    return select(x > y, x, y)


@inlined
def smaller(x, y):
    """Return the smaller of two numbers; `y` where one is nan."""
    return select(x < y, x, y)


@inlined
def flag(mask):
    """Return one where `mask` holds, else zero."""
    return select(mask, 1.0, 0.0)


@inlined
def copy_rows(of, to, first, last):
    """Copy rows `first` to ``last - 1``, of three numbers each, from array `of` to array `to`."""
    for i in range(first, last):
        for c in range(3):
            to[i, c] = of[i, c]


# A sum with this number has no bits for a fraction, so that it is rounded to an integer.
_ROUNDER = 6755399441055744.0
_PER_QUARTER = 0.63661977236758134308
_QUARTER_HIGH = 1.57079632673412561417
_QUARTER_MIDDLE = 6.07710050630396597660e-11
_QUARTER_LOW = 2.02226624879595063154e-21


@inlined
def nearest(x):
    """Return the nearest integer, as a number."""
    return (x + _ROUNDER) - _ROUNDER


@inlined
def sine_cosine(angle):
    """Return the sine and the cosine of an angle [rad].

    Up to some thousand revolutions they are right to two units in the last place. The angle is
    reduced by quarter revolutions in three parts; polynomials of Sun's fdlibm (1993), `k_sin.c`
    and `k_cos.c`.
    """
    quarters = nearest(angle * _PER_QUARTER)
    x = (
        angle
        - quarters * _QUARTER_HIGH
        - quarters * _QUARTER_MIDDLE
        - quarters * _QUARTER_LOW
    )
    z = x * x
    sine = -2.50507602534068634195e-8 + z * 1.58969099521155010221e-10
    sine = 2.75573137070700676789e-6 + z * sine
    sine = -1.98412698298579493134e-4 + z * sine
    sine = 8.33333333332248946124e-3 + z * sine
    sine = -1.66666666666666324348e-1 + z * sine
    sine = x + x * z * sine
    cosine = 2.08757232129817482790e-9 - z * 1.13596475577881948265e-11
    cosine = -2.75573143513906633035e-7 + z * cosine
    cosine = 2.48015872894767294178e-5 + z * cosine
    cosine = -1.38888888888741095749e-3 + z * cosine
    cosine = 4.16666666666666019037e-2 + z * cosine
    cosine = 1.0 - 0.5 * z + z * z * cosine
    # In which quarter: 0, 1, 2 or 3 of a revolution on.
    part = quarters * 0.25
    part = 4.0 * (part - nearest(part))
    crossed = abs(part) == 1.0
    first = select(crossed, cosine, sine)
    second = select(crossed, sine, cosine)
    negative_sine = (abs(part) == 2.0) | (part == -1.0)
    negative_cosine = (abs(part) == 2.0) | (part == 1.0)
    return select(negative_sine, -first, first), select(
        negative_cosine, -second, second
    )
