"""Unit quaternions as rotations: products, exponential, logarithm, parallel transport, matrices.

A quaternion :math:`q = s + v` is stored scalar first, ``(s, v1, v2, v3)``. A unit quaternion turns
the vector :math:`w` into :math:`q * w = q\\,w\\,\\bar q`; the product :math:`q_2 q_1` turns by
:math:`q_1` first. Both :math:`q` and :math:`-q` are the same rotation.

The functions in ``__all__`` take arrays of any leading shape and check what they are given. The
others (``mul``, ``turn``, ``exp_of``, ...) are compiled, take tuples of floats and check
nothing: they are the pieces of the kernels.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from .._compile import jit
from .._validate import finite_array
from ..errors import InvalidInput

__all__ = [
    "ANTIPARALLEL",
    "conjugate",
    "exponential",
    "from_directors",
    "from_matrix",
    "logarithm",
    "multiply",
    "parallel_transport",
    "rotate",
    "rotation_about",
    "to_directors",
    "to_matrix",
]

Array = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

#: Smallest angle (radians) to the opposite direction at which parallel transport is taken for
#: defined. Its axis is known to about the round-off of the tangents divided by this angle.
ANTIPARALLEL = 1e-6
#: How far the length of a unit vector or unit quaternion may be from one.
UNIT = 1e-8

# ---------------------------------------------------------------------------------------------
# Compiled pieces, on tuples


@jit(inline="always")
def mul(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product of two quaternions."""  # (4.4)
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + q[0] * p[1] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + q[0] * p[2] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + q[0] * p[3] + p[1] * q[2] - p[2] * q[1],
    )


@jit(inline="always")
def conj(q: Quaternion) -> Quaternion:
    """Return the conjugate: the inverse rotation."""
    return (q[0], -q[1], -q[2], -q[3])


@jit(inline="always")
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jit(inline="always")
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit(inline="always")
def turn(q: Quaternion, w: Vector) -> Vector:
    """Return the vector `w` turned by the unit quaternion `q`."""
    v = (q[1], q[2], q[3])
    c = cross(v, w)
    e = (2.0 * c[0], 2.0 * c[1], 2.0 * c[2])
    f = cross(v, e)
    return (w[0] + q[0] * e[0] + f[0], w[1] + q[0] * e[1] + f[1], w[2] + q[0] * e[2] + f[2])


@jit
def exp_of(v: Vector) -> Quaternion:
    """Return the unit quaternion of the rotation vector `v` (radians about its direction)."""
    angle = math.sqrt(dot(v, v))  # (4.5)
    if angle == 0.0:
        return (1.0, 0.5 * v[0], 0.5 * v[1], 0.5 * v[2])
    factor = math.sin(0.5 * angle) / angle
    return (math.cos(0.5 * angle), factor * v[0], factor * v[1], factor * v[2])


@jit
def transport_of(a: Vector, b: Vector) -> Quaternion:
    """Return the parallel transport from the unit vector `a` to `b`; not finite if `b` is `-a`."""
    sx, sy, sz = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    # |a + b|^2 = 2 (1 + a.b), without the cancellation of 1 + a.b near -1
    size = math.sqrt(sx * sx + sy * sy + sz * sz)  # (4.6)
    if size == 0.0:
        return (math.nan, math.nan, math.nan, math.nan)
    c = cross(a, b)
    return (0.5 * size, c[0] / size, c[1] / size, c[2] / size)


@jit
def normalized(q: Quaternion) -> Quaternion:
    """Return `q` divided by its norm: removes the drift of repeated products."""
    factor = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (factor * q[0], factor * q[1], factor * q[2], factor * q[3])


@jit
def directors_of(q: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Return the three directors of the frame `q`: the columns of its rotation matrix."""
    s, x, y, z = q  # (4.10)
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + s * z), 2.0 * (x * z - s * y)),
        (2.0 * (x * y - s * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + s * x)),
        (2.0 * (x * z + s * y), 2.0 * (y * z - s * x), 1.0 - 2.0 * (x * x + y * y)),
    )


# ---------------------------------------------------------------------------------------------
# Public functions, on arrays


def _array(name: str, value: ArrayLike, length: int, meaning: str) -> Array:
    array: Array = finite_array(name, value)
    if array.ndim == 0 or array.shape[-1] != length:
        raise InvalidInput(
            f"argument `{name}` has shape {array.shape}; it must have shape (..., {length}): "
            f"{meaning}"
        )
    return array


def _quaternions(name: str, value: ArrayLike) -> Array:
    return _array(name, value, 4, "quaternions, scalar first")


def _unit(name: str, array: Array, what: str) -> Array:
    sizes = np.sqrt(np.sum(array**2, axis=-1))
    wrong = np.abs(sizes - 1.0) > UNIT
    if np.any(wrong):
        place = tuple(int(i) for i in np.argwhere(wrong)[0]) if sizes.ndim else ()
        where = f"[{', '.join(map(str, place))}]" if place else ""
        raise InvalidInput(
            f"argument `{name}`{where} has length {float(sizes[place]):.9g}; pass {what}, for "
            "example divided by its length"
        )
    return array


def _broadcast(**arrays: Array) -> None:
    shapes = [array.shape[:-1] for array in arrays.values()]
    if shapes.count(shapes[0]) == len(shapes):
        return
    try:
        np.broadcast_shapes(*shapes)
    except ValueError:
        raise InvalidInput(
            f"arguments {' and '.join(f'`{name}`' for name in arrays)} have leading shapes "
            f"{' and '.join(map(str, shapes))}, which do not fit each other; pass as many of one "
            "as of the other, or one of either"
        ) from None


def _cross(a: Array, b: Array) -> Array:
    """Return vector products; ``np.cross``, which takes vectors of any kind, costs several times as much."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    product = np.empty(a.shape if a.shape == b.shape else np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = y * w - z * v
    product[..., 1] = z * u - x * w
    product[..., 2] = x * v - y * u
    return product


def multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Return products of quaternions: the rotation `q` first, then `p`.

    .. math:: p q = (s_p s_q - v_p \\cdot v_q) + (s_p v_q + s_q v_p + v_p \\times v_q)

    Parameters
    ----------
    p, q : array_like, shape (..., 4)
        Quaternions, scalar first, of any length. Leading shapes are broadcast.

    Returns
    -------
    ndarray, shape (..., 4)

    Raises
    ------
    InvalidInput
        If shapes do not fit or an entry is not finite.

    Notes
    -----
    (4.4) of the thesis.

    Examples
    --------
    >>> from lissome.rods.quaternions import multiply
    >>> print(multiply([0, 1, 0, 0], [0, 0, 1, 0]))  # i j = k
    [0. 0. 0. 1.]
    """
    first, second = _quaternions("p", p), _quaternions("q", q)
    _broadcast(p=first, q=second)
    s, t = first[..., :1], second[..., :1]
    v, w = first[..., 1:], second[..., 1:]
    scalar = s * t - np.sum(v * w, axis=-1, keepdims=True)
    return np.concatenate([scalar, s * w + t * v + _cross(v, w)], axis=-1)


def conjugate(q: ArrayLike) -> Array:
    """Return conjugates: for unit quaternions the inverse rotations.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Quaternions, scalar first.

    Returns
    -------
    ndarray, shape (..., 4)

    Raises
    ------
    InvalidInput
        If the shape does not fit or an entry is not finite.

    Examples
    --------
    >>> from lissome.rods.quaternions import conjugate
    >>> print(conjugate([1.0, 2.0, 3.0, 4.0]))
    [ 1. -2. -3. -4.]
    """
    return _quaternions("q", q) * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(q: ArrayLike, w: ArrayLike) -> Array:
    """Return vectors turned by unit quaternions, :math:`q * w = q\\,w\\,\\bar q`.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, scalar first.
    w : array_like, shape (..., 3)
        Vectors.

    Returns
    -------
    ndarray, shape (..., 3)

    Raises
    ------
    InvalidInput
        If a quaternion is not of unit length, or shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.quaternions import rotate, rotation_about
    >>> print(rotate(rotation_about([0, 0, 1], np.pi / 2), [1, 0, 0]).round(12) + 0.0)
    [0. 1. 0.]
    """
    first = _unit("q", _quaternions("q", q), "unit quaternions")
    second = _array("w", w, 3, "vectors")
    _broadcast(q=first, w=second)
    s, v = first[..., :1], first[..., 1:]
    twice = 2.0 * _cross(v, second)
    return second + s * twice + _cross(v, twice)


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return unit quaternions of rotations about axes.

    .. math:: r_n(\\theta) = \\cos(\\theta/2) + n \\sin(\\theta/2) = \\exp(n \\theta / 2)

    Parameters
    ----------
    axis : array_like, shape (..., 3)
        Unit vectors.
    angle : array_like, shape (...)
        Angles in radians. The quaternion changes its sign after a whole turn.

    Returns
    -------
    ndarray, shape (..., 4)

    Raises
    ------
    InvalidInput
        If an axis is not of unit length, or shapes do not fit.

    Notes
    -----
    (4.5) of the thesis.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.quaternions import rotation_about
    >>> print(rotation_about([0, 1, 0], np.pi).round(12))
    [0. 0. 1. 0.]
    """
    n = _unit("axis", _array("axis", axis, 3, "axes"), "unit vectors")
    half = 0.5 * finite_array("angle", angle)[..., None]
    _broadcast(axis=n, angle=half)
    n, half = np.broadcast_arrays(n, half)
    return np.concatenate([np.cos(half[..., :1]), n * np.sin(half)], axis=-1)


def exponential(rotation_vector: ArrayLike) -> Array:
    """Return unit quaternions of rotation vectors, :math:`\\exp(v/2)`.

    Parameters
    ----------
    rotation_vector : array_like, shape (..., 3)
        Axis times angle in radians.

    Returns
    -------
    ndarray, shape (..., 4)

    Raises
    ------
    InvalidInput
        If the shape does not fit or an entry is not finite.

    Notes
    -----
    (4.5) of the thesis.

    Examples
    --------
    >>> from lissome.rods.quaternions import exponential
    >>> print(exponential([0.0, 0.0, 0.0]))
    [1. 0. 0. 0.]
    """
    v = _array("rotation_vector", rotation_vector, 3, "rotation vectors")
    angle = np.sqrt(np.sum(v**2, axis=-1, keepdims=True))
    factor = np.divide(np.sin(0.5 * angle), angle, out=np.full_like(angle, 0.5), where=angle > 0)
    return np.concatenate([np.cos(0.5 * angle), factor * v], axis=-1)


def logarithm(q: ArrayLike) -> Array:
    """Return rotation vectors of unit quaternions, :math:`2 \\log(\\pm q)`.

    Of the two signs the one is taken whose angle is at most pi.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, scalar first.

    Returns
    -------
    ndarray, shape (..., 3)
        Axis times angle in radians.

    Raises
    ------
    InvalidInput
        If a quaternion is not of unit length, or the shape does not fit.

    Examples
    --------
    >>> from lissome.rods.quaternions import exponential, logarithm
    >>> print(logarithm(exponential([0.1, -0.2, 0.3])))
    [ 0.1 -0.2  0.3]
    """
    array = _unit("q", _quaternions("q", q), "unit quaternions")
    sign = np.where(array[..., :1] < 0.0, -1.0, 1.0)
    s, v = sign * array[..., :1], sign * array[..., 1:]
    size = np.sqrt(np.sum(v**2, axis=-1, keepdims=True))
    factor = np.divide(2.0 * np.arctan2(size, s), size, out=np.full_like(size, 2.0), where=size > 0)
    return factor * v


def parallel_transport(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the rotations that turn `a` into `b` on the shortest path.

    .. math:: p_a^b = \\sqrt{\\frac{1 + a \\cdot b}{2}}
              + \\frac{1}{2} \\frac{a \\times b}{\\sqrt{(1 + a \\cdot b) / 2}}

    Parameters
    ----------
    a, b : array_like, shape (..., 3)
        Unit vectors. Leading shapes are broadcast.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions, scalar first; scalar parts are positive.

    Raises
    ------
    InvalidInput
        If `b` is opposite to `a` to within :data:`ANTIPARALLEL`: every axis normal to them would
        do. Also if a vector is not of unit length, or shapes do not fit.

    Notes
    -----
    (4.6) of the thesis.

    Examples
    --------
    >>> from lissome.rods.quaternions import parallel_transport, rotate
    >>> print(rotate(parallel_transport([0, 0, 1], [0.6, 0, 0.8]), [0, 0, 1]).round(12))
    [0.6 0.  0.8]
    >>> parallel_transport([0, 0, 1], [0, 0, -1])
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `b` is opposite to `a` to within 0 radians; parallel transport has no axis then: go through a direction between them
    """  # noqa: E501
    first = _unit("a", _array("a", a, 3, "unit vectors"), "unit vectors")
    second = _unit("b", _array("b", b, 3, "unit vectors"), "unit vectors")
    _broadcast(a=first, b=second)
    size = np.sqrt(np.sum((first + second) ** 2, axis=-1, keepdims=True))
    near = size[..., 0] < ANTIPARALLEL  # the angle from -a to b, when it is small
    if np.any(near):
        place = tuple(int(i) for i in np.argwhere(near)[0]) if near.ndim else ()
        where = f"[{', '.join(map(str, place))}]" if place else ""
        raise InvalidInput(
            f"argument `b`{where} is opposite to `a`{where} to within "
            f"{float(size[(*place, 0)]):.2g} radians; parallel transport has no axis then: go "
            "through a direction between them"
        )
    return np.concatenate([0.5 * size, np.cross(first, second) / size], axis=-1)


def to_matrix(q: ArrayLike) -> Array:
    """Return rotation matrices of unit quaternions.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, scalar first.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``matrix @ w`` is the vector w, turned. Columns are the directors.

    Raises
    ------
    InvalidInput
        If a quaternion is not of unit length, or the shape does not fit.

    Examples
    --------
    >>> from lissome.rods.quaternions import to_matrix
    >>> print(to_matrix([0.0, 0.0, 0.0, 1.0]))
    [[-1.  0.  0.]
     [ 0. -1.  0.]
     [ 0.  0.  1.]]
    """
    return np.swapaxes(to_directors(q), -1, -2)


def to_directors(q: ArrayLike) -> Array:
    """Return the directors of frames that are given as unit quaternions.

    Parameters
    ----------
    q : array_like, shape (..., 4)
        Unit quaternions, scalar first, that turn the Cartesian basis into the directors.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``directors[..., I, :]`` is director I.

    Raises
    ------
    InvalidInput
        If a quaternion is not of unit length, or the shape does not fit.

    Notes
    -----
    (4.10) of the thesis.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.quaternions import rotation_about, to_directors
    >>> print(to_directors(rotation_about([0, 0, 1], np.pi / 2)).round(12)[0] + 0.0)
    [0. 1. 0.]
    """
    array = _unit("q", _quaternions("q", q), "unit quaternions")
    s, x, y, z = (array[..., i] for i in range(4))
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + s * z), 2.0 * (x * z - s * y)),
        (2.0 * (x * y - s * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + s * x)),
        (2.0 * (x * z + s * y), 2.0 * (y * z - s * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(matrix: ArrayLike) -> Array:
    """Return unit quaternions of rotation matrices.

    Parameters
    ----------
    matrix : array_like, shape (..., 3, 3)
        Rotation matrices: orthonormal to 1e-8, right-handed. Columns are directors.

    Returns
    -------
    ndarray, shape (..., 4)
        Scalar first; of the two signs the one with a scalar part that is not negative.

    Raises
    ------
    InvalidInput
        If a matrix is not a rotation.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods.quaternions import from_matrix
    >>> print(from_matrix(np.eye(3)))
    [1. 0. 0. 0.]
    """
    return _from_rotation("matrix", finite_array("matrix", matrix), "columns")


def from_directors(directors: ArrayLike) -> Array:
    """Return the unit quaternions of frames that are given by their directors.

    Parameters
    ----------
    directors : array_like, shape (..., 3, 3)
        ``directors[..., I, :]`` is director I: orthonormal to 1e-8, right-handed.

    Returns
    -------
    ndarray, shape (..., 4)
        Scalar first; of the two signs the one with a scalar part that is not negative.

    Raises
    ------
    InvalidInput
        If a frame is not orthonormal, or left-handed.

    Examples
    --------
    >>> from lissome.rods.quaternions import from_directors
    >>> from_directors([[1, 0, 0], [0, 1, 0], [0, 0, -1]])
    Traceback (most recent call last):
        ...
    lissome.errors.InvalidInput: argument `directors` is left-handed (determinant -1); swap two of its rows or reverse one
    """  # noqa: E501
    array = finite_array("directors", directors)
    if array.ndim >= 2:
        array = np.swapaxes(array, -1, -2)
    return _from_rotation("directors", array, "rows")


def _from_rotation(name: str, matrix: Array, vectors: str) -> Array:
    if matrix.ndim < 2 or matrix.shape[-2:] != (3, 3):
        raise InvalidInput(
            f"argument `{name}` has shape {matrix.shape}; it must have shape (..., 3, 3)"
        )
    flat = matrix.reshape(-1, 3, 3)

    def where(wrong: NDArray[np.bool_]) -> tuple[int, str]:
        first = int(np.argmax(wrong))
        place = np.unravel_index(first, matrix.shape[:-2]) if matrix.ndim > 2 else ()
        return first, f"[{', '.join(str(int(i)) for i in place)}]" if place else ""

    skew = np.max(np.abs(np.swapaxes(flat, 1, 2) @ flat - np.eye(3)), axis=(1, 2), initial=0.0)
    if np.any(skew > UNIT):
        first, place = where(skew > UNIT)
        raise InvalidInput(
            f"argument `{name}`{place} is not orthonormal: scalar products of its {vectors} are off "
            f"by up to {float(skew[first]):.2g}; pass unit vectors at right angles"
        )
    handed = np.linalg.det(flat)
    if np.any(handed < 0):
        first, place = where(handed < 0)
        raise InvalidInput(
            f"argument `{name}`{place} is left-handed (determinant {float(handed[first]):.2g}); "
            f"swap two of its {vectors} or reverse one"
        )
    if flat.shape[0] == 0:
        return np.zeros((*matrix.shape[:-2], 4))
    last: Any = Rotation.from_matrix(flat).as_quat()
    quaternions = np.concatenate([last[:, 3:], last[:, :3]], axis=1)
    quaternions *= np.where(quaternions[:, :1] < 0, -1.0, 1.0)
    return quaternions.reshape(*matrix.shape[:-2], 4)
