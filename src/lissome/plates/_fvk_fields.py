"""Fields on a plate: numbers, tensors, or functions of position, evaluated and checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._validate import finite, finite_array, moderate
from ..errors import InvalidInput

Array = NDArray[np.float64]
Field = Callable[[Array], Array]


def _called(name: str, function: Any, x: Array, head: tuple[int, ...]) -> Array:
    try:
        value = np.asarray(function(x[..., 0], x[..., 1]), dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"the function `{name}` failed, or returned no array of numbers: {error}; it must take "
            "arrays (x, y) of one shape"
        ) from error
    wanted = (*head, *x.shape[:-1])
    try:
        if value.shape == head:  # a constant
            value = value.reshape(*head, *(1,) * (x.ndim - 1))
        value = np.broadcast_to(value, wanted)
    except ValueError:
        raise InvalidInput(
            f"the function `{name}` returned an array of shape {value.shape} for x, y of shape "
            f"{x.shape[:-1]}; it must be {wanted}"
        ) from None
    if not np.all(np.isfinite(value)):
        where = np.argwhere(~np.isfinite(value))[0][len(head) :]
        px, py = x[tuple(where)]
        raise InvalidInput(
            f"the function `{name}` is not finite at ({px:.6g}, {py:.6g}); quadrature points lie "
            "inside of triangles: put a vertex of the mesh on a singular point"
        )
    return moderate(name, value)


def scalar_field(name: str, value: Any) -> Field:
    """Return a function of positions (..., 2) from a number or a function of x, y."""
    if callable(value):
        return lambda x: np.array(_called(name, value, x, ()))
    number = finite(name, value)
    return lambda x: np.full(x.shape[:-1], number)


def vector_field(name: str, value: Any) -> Field:
    """Return a function of positions (..., 2) that gives x and y parts, shape (..., 2)."""
    if callable(value):
        return lambda x: np.moveaxis(_called(name, value, x, (2,)), 0, -1).copy()
    constant = moderate(name, finite_array(name, value, shape=(2,)))
    return lambda x: np.broadcast_to(constant, x.shape).copy()


def tensor_field(name: str, value: Any) -> Field:
    """Return a function of positions (..., 2) that gives xx, yy, xy, shape (..., 3)."""

    def parts(tensor: Array) -> Array:
        skew = np.max(np.abs(tensor[0, 1] - tensor[1, 0]), initial=0.0)
        if skew > 1e-9 * np.max(np.abs(tensor), initial=0.0):
            raise InvalidInput(
                f"argument `{name}` is not symmetric: xy and yx differ by {skew:.3g}"
            )
        return np.ascontiguousarray(np.stack([tensor[0, 0], tensor[1, 1], tensor[0, 1]], axis=-1))

    if value is None:
        return lambda x: np.zeros((*x.shape[:-1], 3))
    if callable(value):
        return lambda x: parts(_called(name, value, x, (2, 2)))
    constant = parts(moderate(name, finite_array(name, value, shape=(2, 2))))
    return lambda x: np.broadcast_to(constant, (*x.shape[:-1], 3)).copy()
