"""How kernels are compiled: cached on disk, IEEE division, no reordering of sums."""

from numba import njit

allocating = njit(cache=True, error_model="numpy")
# Kernels that make no arrays of their own do without numba's reference counts, which cost more
# than the arithmetic of a short chain: every call counts each array of its arguments up and down.
kernel = njit(cache=True, error_model="numpy", _nrt=False)  # type: ignore[call-overload]
inlined = njit(  # type: ignore[call-overload]
    cache=True, error_model="numpy", _nrt=False, inline="always"
)
