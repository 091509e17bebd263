"""Mechanics: kernels compiled by numba. SI floats in, status codes out; nothing here raises."""

from archfrag.kernel_cache import use_kernel_cache

use_kernel_cache()
