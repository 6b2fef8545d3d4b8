"""Polynomials with ascending coefficients on normalised time [0, 1], one row per axis."""

from functools import cache

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@cache
def interpolation(n: int) -> Array:
    """Matrix (n, n) that maps values at the times 0, 1/(n-1), ..., 1 to the ascending coefficients
    of the polynomial through them.

    With as many coefficients as points the least-squares fit of appendix D.3 is the interpolation;
    Lagrange's form needs no linear solver, so its digits do not depend on the LAPACK at hand.
    """
    nodes = np.arange(n) / (n - 1)
    columns = []
    for i, node in enumerate(nodes):
        others = np.delete(nodes, i)
        columns.append(polynomial.polyfromroots(others) / np.prod(node - others))
    matrix = np.stack(columns, axis=1)
    matrix.setflags(write=False)
    return matrix


@cache
def quadrature(n: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights, (n,) each, on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    nodes, weights = (x + 1) / 2, w / 2
    nodes.setflags(write=False)
    weights.setflags(write=False)
    return nodes, weights


def evaluate(coefficients: ArrayLike, s: Array | float) -> Array:
    """Horner's scheme: coefficients (..., d+1) at `s`, broadcast against their leading
    dimensions."""
    c = np.asarray(coefficients, float)
    value = c[..., -1] + np.zeros_like(s)
    for k in range(c.shape[-1] - 2, -1, -1):
        value = value * s + c[..., k]
    return value


def derivative(coefficients: ArrayLike) -> Array:
    """Coefficients (..., max(d, 1)) of the derivative of (..., d+1)."""
    c = np.asarray(coefficients, float)
    if c.shape[-1] == 1:
        return np.zeros_like(c)
    return c[..., 1:] * np.arange(1, c.shape[-1], dtype=np.float64)


def stationary(coefficients: ArrayLike) -> Array:
    """Sorted times in [0, 1] at which one polynomial (d+1,) can be extreme: both ends and the real
    roots of its derivative."""
    slope = derivative(coefficients)
    # leading terms of this size cannot move an extreme, but send roots to infinity
    kept = np.flatnonzero(np.abs(slope) > 1e-14 * np.abs(slope).max())
    slope = slope[: kept.max(initial=0) + 1]
    roots = polynomial.polyroots(slope) if len(slope) > 1 else np.zeros(0)
    # a double root splits into a pair beside the real axis; taking its real part adds a harmless
    # point
    inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < 1)]
    return np.concatenate([[0.0], np.sort(inside), [1.0]])


def squared_speed(coefficients: ArrayLike) -> Array:
    """Coefficients of |p'(s)|^2 for a planar curve (2, d+1)."""
    x, y = derivative(coefficients)
    return (np.convolve(x, x) + np.convolve(y, y)).astype(np.float64)


def arc_length(coefficients: ArrayLike) -> float:
    """Length of a planar curve (2, d+1) over [0, 1], same unit as its coefficients.

    Gauss-Legendre between the extremes of the speed: the speed has its kinks, or nearly so, only at
    its minima.
    """
    slope = derivative(coefficients)
    cuts = stationary(squared_speed(coefficients))
    nodes, weights = quadrature(32)
    width = np.diff(cuts)
    s = cuts[:-1, None] + width[:, None] * nodes
    speed = np.hypot(evaluate(slope[0], s), evaluate(slope[1], s))
    return float(((speed * weights).sum(-1) * width).sum())


def greatest_speed(coefficients: ArrayLike) -> float:
    """Maximum of |p'(s)| over [0, 1] for a planar curve (2, d+1), exact up to rounding."""
    slope = derivative(coefficients)
    s = stationary(squared_speed(coefficients))
    return float(np.hypot(evaluate(slope[0], s), evaluate(slope[1], s)).max())
