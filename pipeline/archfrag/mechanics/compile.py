"""How kernels are compiled: cached on disk, IEEE division, no reordering of sums."""

from numba import njit

kernel = njit(cache=True, error_model="numpy")
inlined = njit(cache=True, error_model="numpy", inline="always")
