"""Directors of a rod by quaternions, and how strains turn them, for the collocated references."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["directors", "quaternion_rate"]


def directors(q: npt.NDArray) -> tuple[npt.NDArray, npt.NDArray, npt.NDArray]:
    """Return the three directors of quaternions (scalar and components first), each (3, ...)."""
    a, b, c, d = q
    return (
        np.array([a * a + b * b - c * c - d * d, 2 * (b * c + a * d), 2 * (b * d - a * c)]),
        np.array([2 * (b * c - a * d), a * a - b * b + c * c - d * d, 2 * (c * d + a * b)]),
        np.array([2 * (b * d + a * c), 2 * (c * d - a * b), a * a - b * b - c * c + d * d]),
    )


def quaternion_rate(
    q: npt.NDArray, k1: npt.NDArray, k2: npt.NDArray, k3: npt.NDArray
) -> tuple[npt.NDArray, ...]:
    """Return the derivative of quaternions along a rod with the given strains, four arrays."""
    a, b, c, d = q
    return (
        -(b * k1 + c * k2 + d * k3) / 2,
        (a * k1 + c * k3 - d * k2) / 2,
        (a * k2 + d * k1 - b * k3) / 2,
        (a * k3 + b * k2 - c * k1) / 2,
    )
