"""What is true: kernels compiled by numba. SI floats in, status codes out; nothing here raises."""
