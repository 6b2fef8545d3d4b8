"""How functions of whole images are compiled: exact arithmetic, kept in numba's cache."""

from numba import njit

compiled = njit(cache=True, error_model="numpy")
