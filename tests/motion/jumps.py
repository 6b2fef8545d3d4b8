"""How abruptly a planar motion changes."""

import numpy as np

from pipeline.motion.planar import PlanarMotion


def velocity_jumps(motion: PlanarMotion) -> np.ndarray:
    """Size (k,) in m/s of the change of velocity at each breakpoint."""
    at = motion.breakpoints()
    return np.linalg.norm(motion.velocity(at) - motion.velocity(at - 1e-9), axis=-1)
