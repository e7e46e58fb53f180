"""Symmetric indefinite solves with inertia: the linear algebra behind equilibria and stability.

The matrix of an equilibrium problem is

.. math:: K = \\begin{pmatrix} H + s M & J^T & G^T \\\\ J & -r & 0 \\\\ G & 0 & 0 \\end{pmatrix},

with the Hessian :math:`H` of the Lagrangian (n unknowns), the Jacobian :math:`J` of m constraints, g
generators :math:`G` of neutral motions, a shift :math:`s` times the metric :math:`M`, and a
relaxation :math:`r` that is zero unless constraints are redundant. By Gould's theorem
the second variation is positive on the admissible motions that are not neutral if and only if K has
n positive and m + g negative eigenvalues; each further negative one is an unstable direction. All
factorizations are of the form :math:`P K P^T = L D L^T`, whose D has the inertia of K (Sylvester).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.linalg import lapack

from .errors import FactorizationError, InvalidInput

__all__ = [
    "ChainKKT",
    "ChainLayout",
    "DenseKKT",
    "Factorization",
    "KKTMatrix",
    "SparseKKT",
    "TridiagonalKKT",
]

Array = NDArray[np.float64]
Entries = tuple[NDArray[np.uint32], NDArray[np.uint32]]
EPS = float(np.finfo(float).eps)
#: Componentwise backward error of a solution that needs no refinement.
ENOUGH = 16 * EPS


class Factorization(ABC):
    """A factored KKT matrix.

    Attributes
    ----------
    n, m, g : int
        Numbers of unknowns, constraints and gauge rows.
    inertia : tuple of int
        Numbers of positive, negative and zero pivots of the whole matrix. A pivot is zero when
        rounding errors hide its sign.
    relative_smallest_pivot : float
        Smallest over largest absolute eigenvalue of the pivots of the scaled matrix.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import DenseKKT
    >>> factor = DenseKKT(np.diag([2.0, -1.0])).factorize()
    >>> print(factor.inertia, factor.index, factor.is_minimum)
    (1, 1, 0) 1 False
    >>> print(factor.solve([4.0, 3.0])[0])
    [ 2. -3.]
    """

    n: int
    m: int
    g: int
    inertia: tuple[int, int, int]
    relative_smallest_pivot: float

    @property
    def index(self) -> int:
        """Number of unstable directions: negative pivots beyond those of the constraints."""
        return self.inertia[1] - self.m - self.g

    @property
    def is_minimum(self) -> bool:
        """Whether the inertia is that of a strict minimum: (n, m + g, 0)."""
        return self.inertia == (self.n, self.m + self.g, 0)

    def solve(
        self, rhs_x: ArrayLike, rhs_c: ArrayLike | None = None, *, refine: bool = True
    ) -> tuple[Array, Array]:
        """Solve the KKT system, with iterative refinement.

        Parameters
        ----------
        rhs_x : array_like, shape (n,) or (n, k)
            Right-hand sides of the force balance.
        rhs_c : array_like, shape (m,) or (m, k), optional
            Right-hand sides of the constraints; zero by default.
        refine : bool
            Whether to refine at once; inverse iterations need it only beside a singular matrix.

        Returns
        -------
        dx : ndarray, shape (n,) or (n, k)
        dmultipliers : ndarray, shape (m,) or (m, k)

        Raises
        ------
        InvalidInput
            If a right-hand side has the wrong shape.
        FactorizationError
            If the matrix is singular, or if the solution has no correct digit.
        """
        first = np.asarray(rhs_x, dtype=float)
        single = first.ndim == 1
        columns = first[:, None] if single else first
        k = columns.shape[1]
        if columns.shape[0] != self.n:
            raise InvalidInput(
                f"argument `rhs_x` has {columns.shape[0]} rows; it must have {self.n}"
            )
        second = None
        if rhs_c is not None:
            second = np.asarray(rhs_c, dtype=float)
            second = second[:, None] if second.ndim == 1 else second
            if second.shape != (self.m, k):
                raise InvalidInput(
                    f"argument `rhs_c` has shape {np.shape(rhs_c)}; it must hold {k} columns of "
                    f"{self.m} values"
                )
        if self.inertia[2]:
            raise FactorizationError(
                f"the KKT matrix is singular to working precision ({self.inertia[2]} zero pivots): "
                "the state is critical, a neutral motion is not listed in `gauge`, or constraints "
                "are redundant"
            )
        dx, dm, left = self._refined(columns, second, 3 if refine else 0)
        if not refine and left > 1e-7:  # beside a singular matrix
            dx, dm, left = self._refined(columns, second, 3)
        if not left < math.inf:
            raise FactorizationError("the solution of the KKT system is not finite")
        if left > 1e-7:
            raise FactorizationError(
                f"the KKT system was solved to {left:.2g} only: the matrix is too "
                "ill-conditioned; scale the unknowns and constraints, or use a coarser mesh"
            )
        return (dx[:, 0], dm[:, 0]) if single else (dx, dm)

    @abstractmethod
    def _refined(
        self, rhs_x: Array, rhs_c: Array | None, refinements: int
    ) -> tuple[Array, Array, float]:
        """Return the refined solutions, and the largest residual that they leave.

        Right-hand sides have shapes (n, k) and (m, k). The residual is relative to the largest
        right-hand side plus the largest entry of the matrix times that of the solution; it is
        infinite if the solution is not finite.
        """


class KKTMatrix(ABC):
    """The matrix of an equilibrium problem: Hessian of the Lagrangian and Jacobian of constraints.

    Attributes
    ----------
    n, m : int
        Numbers of unknowns and of constraints.

    Examples
    --------
    Any of the classes of this module will do where a structure is evaluated:

    >>> import numpy as np
    >>> from lissome.factorization import DenseKKT
    >>> kkt = DenseKKT(np.diag([2.0, -1.0]), jacobian=[[1.0, 1.0]])
    >>> force, violation = kkt.apply(np.array([1.0, 1.0]), np.array([3.0]))
    >>> print(force, violation, kkt.jacobian_rows())
    [5. 2.] [2.] [[1. 1.]]
    """

    n: int
    m: int

    @abstractmethod
    def apply(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return ``H dx + J^T dmultipliers``, shape (n,), and ``J dx``, shape (m,).

        Parameters
        ----------
        dx : ndarray, shape (n,)
            An increment of the unknowns.
        dmultipliers : ndarray, shape (m,)
            One of the multipliers.
        """

    @abstractmethod
    def magnitude(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return the sizes of the terms that :meth:`apply` sums: the same with absolute values.

        Parameters
        ----------
        dx, dmultipliers : ndarray
            As in :meth:`apply`.
        """

    @abstractmethod
    def factorize(
        self,
        shift: float = 0.0,
        gauge: Array | None = None,
        metric: Array | None = None,
        relaxation: float = 0.0,
    ) -> Factorization:
        """Factor the matrix.

        Parameters
        ----------
        shift : float
            Multiple of the metric that is added to the Hessian.
        gauge : ndarray, shape (g, n), optional
            Generators of neutral motions, appended as rows.
        metric : ndarray, shape (n,), optional
            The metric; ones by default.
        relaxation : float
            Subtracted from the diagonal of the constraint block; keeps redundant constraints regular.

        Raises
        ------
        FactorizationError
            If the matrix is not finite or its factors would be inaccurate.
        """

    def jacobian_rows(self) -> Array:
        """Return the Jacobian as a dense matrix, shape (m, n), for diagnosis."""
        rows = np.empty((self.m, self.n))
        zero = np.zeros(self.n)
        for i in range(self.m):
            unit = np.zeros(self.m)
            unit[i] = 1.0
            rows[i] = self.apply(zero, unit)[0]
        return rows


def _gauge_rows(gauge: Array | None, n: int) -> Array:
    if gauge is None:
        return np.zeros((0, n))
    rows = np.asarray(gauge, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != n:
        raise InvalidInput(f"argument `gauge` has shape {rows.shape}; it must be (g, {n})")
    return rows


def _mass(metric: Array | None, n: int) -> Array:
    if metric is None:
        return np.ones(n)
    mass = np.asarray(metric, dtype=float)
    if mass.shape != (n,) or not np.all(mass > 0):
        raise InvalidInput(f"argument `metric` must hold {n} positive numbers")
    return mass


def _pivot_inertia(eigenvalues: Array, floor: float) -> tuple[tuple[int, int, int], float]:
    """Count the signs of pivots, and return the smallest over the largest size."""
    sizes = np.abs(eigenvalues)
    zero = int(np.count_nonzero(~(sizes > floor)))
    positive = int(np.count_nonzero(eigenvalues > floor))
    largest = float(np.max(sizes, initial=0.0))
    smallest = float(np.min(sizes, initial=np.inf))
    relative = smallest / largest if largest > 0 else 0.0
    return (positive, sizes.size - positive - zero, zero), relative


class _ColumnFactorization(Factorization):
    """Factors that solve for columns in the order unknowns, constraints, gauge rows."""

    _norm: float

    @abstractmethod
    def _solve(self, rhs: Array) -> Array:
        """Solve with the factors, for columns of shape (n + m + g, k)."""

    @abstractmethod
    def _apply(self, z: Array) -> Array:
        """Apply the matrix that was factored."""

    def _refined(
        self, rhs_x: Array, rhs_c: Array | None, refinements: int
    ) -> tuple[Array, Array, float]:
        rhs = np.zeros((self.n + self.m + self.g, rhs_x.shape[1]))
        rhs[: self.n] = rhs_x
        if rhs_c is not None:
            rhs[self.n : self.n + self.m] = rhs_c
        z = self._solve(rhs)
        residual = rhs - self._apply(z)
        size = np.max(np.abs(residual), axis=0, initial=0.0)
        for _ in range(refinements):
            trial = z + self._solve(residual)
            left = rhs - self._apply(trial)
            new = np.max(np.abs(left), axis=0, initial=0.0)
            better = new < size
            if not np.any(better):
                break
            z = np.where(better, trial, z)
            residual = np.where(better, left, residual)
            floor = 4 * EPS * (np.max(np.abs(rhs), axis=0) + self._norm * np.max(np.abs(z), axis=0))
            done = np.all((new >= 0.25 * size) | (new <= floor))
            size = np.where(better, new, size)
            if done:
                break
        worst = math.inf
        if np.all(np.isfinite(z)):
            bound = np.max(np.abs(rhs), axis=0, initial=0.0)
            bound = bound + self._norm * np.max(np.abs(z), axis=0, initial=0.0)
            worst = float(np.max(size / np.maximum(bound, 1e-300), initial=0.0))
        return z[: self.n], z[self.n : self.n + self.m], worst


class _DenseFactorization(_ColumnFactorization):
    def __init__(self, matrix: Array, n: int, m: int, g: int) -> None:
        self.n, self.m, self.g = n, m, g
        self._matrix = matrix
        self._norm = float(np.max(np.abs(matrix), initial=0.0))
        size = n + m + g
        scale = np.ones(size)
        for _ in range(3):  # Ruiz: rows and columns of similar size, so that a pivot can be judged
            largest = np.max(np.abs(matrix) * scale, axis=1, initial=0.0) * scale
            scale /= np.sqrt(np.where(largest > 0, largest, 1.0))
        self._scale = np.exp2(np.round(np.log2(scale)))
        scaled = matrix * self._scale[:, None] * self._scale
        self._factors, self._pivots, info = lapack.dsytrf(scaled, lower=1)
        if info < 0:
            raise FactorizationError("the dense KKT matrix could not be factored")
        eigenvalues = np.empty(size)
        k = 0
        while k < size:
            a = self._factors[k, k]
            if self._pivots[k] > 0:
                eigenvalues[k] = a
                k += 1
            else:
                b, c = self._factors[k + 1, k], self._factors[k + 1, k + 1]
                mean, radius = (a + c) / 2, np.hypot((a - c) / 2, b)
                eigenvalues[k : k + 2] = mean - radius, mean + radius
                k += 2
        self.inertia, self.relative_smallest_pivot = _pivot_inertia(
            eigenvalues, 4 * EPS * max(size, 4)
        )

    def _solve(self, rhs: Array) -> Array:
        scale = self._scale[:, None]
        z, info = lapack.dsytrs(self._factors, self._pivots, rhs * scale, lower=1)
        if info != 0:
            raise FactorizationError("the solve with the dense KKT matrix failed")
        return z * scale

    def _apply(self, z: Array) -> Array:
        return self._matrix @ z


class DenseKKT(KKTMatrix):
    """A small KKT matrix with dense blocks, factored by LAPACK's Bunch-Kaufman method.

    Parameters
    ----------
    hessian : array_like, shape (n, n)
        Hessian of the Lagrangian. Symmetric to 1e-8 of its size.
    jacobian : array_like, shape (m, n), optional
        Derivatives of the constraints.

    Raises
    ------
    InvalidInput
        If a shape is wrong or the Hessian is not symmetric.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import DenseKKT
    >>> saddle = DenseKKT(np.diag([1.0, -1.0]), jacobian=[[0.0, 1.0]])
    >>> saddle.factorize().inertia  # the constraint removes the unstable direction
    (2, 1, 0)
    """

    def __init__(self, hessian: ArrayLike, jacobian: ArrayLike | None = None) -> None:
        h = np.asarray(hessian, dtype=float)
        if h.ndim != 2 or h.shape[0] != h.shape[1]:
            raise InvalidInput(f"argument `hessian` has shape {h.shape}; it must be square")
        self.n = h.shape[0]
        j = np.zeros((0, self.n)) if jacobian is None else np.asarray(jacobian, dtype=float)
        if j.ndim != 2 or j.shape[1] != self.n:
            raise InvalidInput(f"argument `jacobian` has shape {j.shape}; it must be (m, {self.n})")
        self.m = j.shape[0]
        with np.errstate(invalid="ignore"):  # NaN and infinity are refused by `factorize`
            skew = np.max(np.abs(h - h.T), initial=0.0)
        if skew > 1e-8 * np.max(np.abs(h), initial=0.0):
            raise InvalidInput(
                f"argument `hessian` is not symmetric: entries differ by up to {skew:.3g}; check "
                "the second derivatives"
            )
        self.hessian = 0.5 * (h + h.T)
        self.jacobian = j

    def apply(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return ``H dx + J^T dmultipliers`` and ``J dx``."""
        return self.hessian @ dx + self.jacobian.T @ dmultipliers, self.jacobian @ dx

    def magnitude(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return the sizes of the terms that `apply` sums."""
        h, j = np.abs(self.hessian), np.abs(self.jacobian)
        return h @ np.abs(dx) + j.T @ np.abs(dmultipliers), j @ np.abs(dx)

    def jacobian_rows(self) -> Array:
        """Return the Jacobian."""
        return self.jacobian

    def matrix(
        self, shift: float, gauge: Array | None, metric: Array | None, relaxation: float
    ) -> Array:
        """Return the whole matrix, shape (n + m + g, n + m + g); see :meth:`factorize`.

        Parameters
        ----------
        shift : float
            Multiple of the metric that is added to the Hessian.
        gauge : ndarray, shape (g, n), or None
            Rows to append.
        metric : ndarray, shape (n,), or None
            The metric; ones if None.
        relaxation : float
            Subtracted from the diagonal of the constraint block.
        """
        n, m = self.n, self.m
        rows = _gauge_rows(gauge, n)
        size = n + m + rows.shape[0]
        full = np.zeros((size, size))
        full[:n, :n] = self.hessian
        if shift:
            full[np.arange(n), np.arange(n)] += shift * _mass(metric, n)
        full[n : n + m, :n] = self.jacobian
        full[:n, n : n + m] = self.jacobian.T
        full[n + m :, :n] = rows
        full[:n, n + m :] = rows.T
        if relaxation:
            full[np.arange(n, n + m), np.arange(n, n + m)] -= relaxation
        return full

    def factorize(
        self,
        shift: float = 0.0,
        gauge: Array | None = None,
        metric: Array | None = None,
        relaxation: float = 0.0,
    ) -> Factorization:
        """Factor the matrix; see :meth:`KKTMatrix.factorize`.

        Raises
        ------
        FactorizationError
            If an entry is not finite.
        """
        full = self.matrix(shift, gauge, metric, relaxation)
        if not np.all(np.isfinite(full)):
            raise FactorizationError("the KKT matrix holds NaN or infinity")
        return _DenseFactorization(full, self.n, self.m, full.shape[0] - self.n - self.m)


@dataclass(frozen=True, eq=False)
class ChainLayout:
    """Where unknowns and constraints sit in a chain with a border.

    Parameters
    ----------
    length : int
        Number N of columns of the band.
    unknowns : array_like of int, shape (n,), optional
        Position of each unknown: 0 to N - 1 in the band, N and up in the border. By default the
        unknowns are the columns of the band, in order.
    constraints : array_like of int, shape (m,), optional
        Position of each constraint; by default the rest, in order.
    border : int, optional
        Number of border rows.

    Raises
    ------
    InvalidInput
        If the positions are not each of 0 to N + border - 1 once.

    Examples
    --------
    Four unknowns and one constraint, which sits in the border behind the band of the unknowns:

    >>> from lissome.factorization import ChainLayout
    >>> layout = ChainLayout(length=4, border=1)
    >>> print(layout.unknowns, layout.constraints, layout.ordered)
    [0 1 2 3] [4] True
    """

    length: int
    unknowns: NDArray[np.int64] | None = None
    constraints: NDArray[np.int64] | None = None
    border: int = 0
    #: Whether the unknowns come first, then the constraints, each in order.
    ordered: bool = field(init=False)

    def __post_init__(self) -> None:
        total = int(self.length) + int(self.border)
        if self.length < 1 or self.border < 0:
            raise InvalidInput(
                f"argument `length` is {self.length} and `border` is {self.border}; they must be at "
                "least 1 and 0"
            )
        unknowns = np.arange(self.length) if self.unknowns is None else np.array(self.unknowns)
        if self.constraints is None:
            rest = np.ones(total, dtype=bool)
            rest[unknowns[(unknowns >= 0) & (unknowns < total)]] = False
            constraints = np.flatnonzero(rest)
        else:
            constraints = np.array(self.constraints)
        both = np.concatenate([unknowns.ravel(), constraints.ravel()]).astype(np.int64)
        if both.size != total or not np.array_equal(np.sort(both), np.arange(total)):
            raise InvalidInput(
                "arguments `unknowns` and `constraints` must hold each of the positions 0 to "
                f"{total - 1} once"
            )
        object.__setattr__(self, "unknowns", unknowns.astype(np.int64))
        object.__setattr__(self, "constraints", constraints.astype(np.int64))
        object.__setattr__(self, "ordered", bool(np.array_equal(both, np.arange(total))))


@lru_cache(maxsize=64)
def _plain_layout(length: int, border: int) -> ChainLayout:
    return ChainLayout(length, border=border)


#: Width of a band up to which it is taken as full.
_NARROW = 16


@lru_cache(maxsize=64)
def _all_entries(length: int, width: int) -> Entries:
    """Return the offsets and numbers of entries in the columns of a full band."""
    at = np.tile(np.arange(1, width + 1, dtype=np.uint32), (length, 1))
    count = np.minimum(width - 1, np.arange(length)[::-1]).astype(np.uint32)
    return at, count


class _ChainFactors(NamedTuple):
    """Factors of a scaled chain; see :mod:`lissome._chain`."""

    band: Array
    at: NDArray[np.uint32]  # offsets of the entries in its columns
    numbers: NDArray[np.uint32]  # of them
    border: Array
    pivots: Array
    inverse: Array  # of what is left to the corner
    events: NDArray[np.int64]
    links: NDArray[np.int64]


_NOTHING = np.empty((0, 3), dtype=np.int64)


class _ChainFactorization(Factorization):
    def __init__(
        self,
        band: Array,
        entries: Entries,
        border: Array,
        corner: Array,
        layout: ChainLayout,
        counts: Any,
    ) -> None:
        from . import _chain

        self.n, self.m, self.g = counts
        self._original = (band, *entries, border, corner)
        self._layout = layout
        length, nb = border.shape
        self._nb = nb
        self._scale = np.empty(length + nb)
        sizes = np.empty(length + nb)
        self._norm = _chain.scale_chain(band, *entries, border, corner, nb, 2, self._scale, sizes)
        if not math.isfinite(self._norm):
            raise FactorizationError("the KKT matrix holds NaN or infinity")
        slots, threshold = 8, 0.05
        while True:
            work = np.empty_like(band)
            edge = np.empty((length, nb + slots))
            small = np.empty((nb + slots, nb + slots))
            _chain.scaled_copy(band, *entries, border, corner, nb, self._scale, work, edge, small)
            pivots = np.empty((length, 3))
            weight = np.zeros(nb + slots)
            done = _chain.eliminate_plainly(
                work, edge, small, nb, threshold, 64 * EPS, pivots, weight
            )
            columns, positive, negative, smallest, largest, growth = done
            status, count, top = 0, 0, nb
            occupant = np.full(slots, -1, dtype=np.int64)
            events = links = _NOTHING
            fill = entries
            if columns < length:
                fill = np.empty(work.shape, np.uint32), np.empty(length, np.uint32)
                events = np.empty((2 * length, 3), dtype=np.int64)
                links = np.empty((length, 2), dtype=np.int64)
                status, count, top, positive, negative, smallest, largest, growth = (
                    _chain.factorize_chain(
                        work, *fill, edge, small, nb, slots, threshold, 64 * EPS, pivots, weight,
                        events, links, occupant, done,
                    )
                )  # fmt: skip
            if status == 1:  # many columns wait for a good pivot: give them room
                slots = min(4 * slots, length + 1)
            elif growth > 1e8 and threshold < 0.5:
                threshold = 0.5
            else:
                break
        if not growth <= 1e8:
            raise FactorizationError(
                f"the factors of the chain grow by {growth:.2g}; the result would be inaccurate: "
                "scale the unknowns and constraints"
            )
        zero = 0
        inverse = np.zeros((nb + slots, nb + slots))
        if top:
            more, fewer, zero, least = _chain.invert_corner(
                small, nb, top, occupant, weight, 64 * EPS, inverse
            )
            positive, negative = positive + more, negative + fewer
            smallest, largest = min(smallest, least), max(largest, 1.0)
        self._delays = columns < length
        self._factors = _ChainFactors(work, *fill, edge, pivots, inverse, events[:count], links)
        self.inertia = (positive, negative, zero)
        self.relative_smallest_pivot = smallest / largest if largest > 0 else 0.0

    def _refined(
        self, rhs_x: Array, rhs_c: Array | None, refinements: int
    ) -> tuple[Array, Array, float]:
        from . import _chain

        n, m, k = self.n, self.m, rhs_x.shape[1]
        b = np.zeros((k, n + m + self.g))
        z = np.empty_like(b)
        first: Any = self._layout.unknowns
        second: Any = self._layout.constraints
        if self._layout.ordered:
            first, second = slice(0, n), slice(n, n + m)
        b[:, first] = rhs_x.T
        if rhs_c is not None:
            b[:, second] = rhs_c.T
        solve = _chain.solve_with_delays if self._delays else _chain.solve_plainly
        work = np.empty((6, max(b.shape[1], self._factors.border.shape[1])))
        left = solve(
            self._original, self._nb, self._norm, self._scale, self._factors, ENOUGH, refinements,
            b, z, work,
        )  # fmt: skip
        return z[:, first].T, z[:, second].T, left


class ChainKKT(KKTMatrix):
    """A KKT matrix that is a band with a border: a chain of blocks under a few global constraints.

    Unknowns and local constraints are interleaved along the chain, so that the band is narrow;
    constraints that couple all of it, and unknowns that close a ring, are rows of the border. The
    cost of a factorization is linear in the length. Columns that make no good pivot are delayed, so
    that neither the order of unknowns and multipliers nor singular leading blocks matter.

    Parameters
    ----------
    band : ndarray, shape (N, w + 1)
        ``band[j, k]`` is the entry in row j + k, column j. Entries past the end are ignored.
    border : ndarray, shape (b, N), optional
        The rows of the border.
    corner : ndarray, shape (b, b), optional
        Entries among border rows; zero by default. Symmetric.
    layout : ChainLayout, optional
        Where unknowns and constraints sit; by default the band holds the unknowns and the border
        the constraints.

    Raises
    ------
    InvalidInput
        If shapes do not fit.

    Examples
    --------
    Three unit springs in a row, whose total extension is prescribed:

    >>> import numpy as np
    >>> from lissome.factorization import ChainKKT
    >>> kkt = ChainKKT(np.array([[1.0], [1.0], [1.0]]), border=np.ones((1, 3)))
    >>> factor = kkt.factorize()
    >>> factor.inertia
    (3, 1, 0)
    >>> print(factor.solve(np.zeros(3), [3.0])[0])
    [1. 1. 1.]
    """

    def __init__(
        self,
        band: Array,
        border: Array | None = None,
        corner: Array | None = None,
        *,
        layout: ChainLayout | None = None,
    ) -> None:
        band = np.ascontiguousarray(band, dtype=float)
        if band.ndim != 2 or band.shape[0] < 1 or band.shape[1] < 1:
            raise InvalidInput(f"argument `band` has shape {band.shape}; it must be (N, w + 1)")
        length = band.shape[0]
        rows = np.zeros((0, length)) if border is None else np.asarray(border, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != length:
            raise InvalidInput(
                f"argument `border` has shape {rows.shape}; it must be (b, {length})"
            )
        nb = rows.shape[0]
        square = np.zeros((nb, nb)) if corner is None else np.ascontiguousarray(corner, dtype=float)
        if square.shape != (nb, nb):
            raise InvalidInput(
                f"argument `corner` has shape {square.shape}; it must be ({nb}, {nb})"
            )
        self.layout = _plain_layout(length, nb) if layout is None else layout
        if self.layout.length != length or self.layout.border != nb:
            raise InvalidInput(
                f"argument `layout` is for {self.layout.length} columns and {self.layout.border} "
                f"border rows; the matrix has {length} and {nb}"
            )
        unknowns, constraints = self.layout.unknowns, self.layout.constraints
        assert unknowns is not None
        assert constraints is not None
        self.n, self.m = unknowns.size, constraints.size
        self._unknowns: Any = unknowns
        self._constraints: Any = constraints
        if self.layout.ordered:  # slices are faster
            self._unknowns, self._constraints = slice(0, self.n), slice(self.n, self.n + self.m)
        self.band = band
        self.border = np.ascontiguousarray(rows.T)
        self.corner = square

    @classmethod
    def from_blocks(
        cls,
        diagonal: Array,
        lower: Array,
        border: Array | None = None,
        corner: Array | None = None,
        *,
        half_bandwidth: int | None = None,
        layout: ChainLayout | None = None,
    ) -> ChainKKT:
        """Make the matrix from blocks.

        Parameters
        ----------
        diagonal : ndarray, shape (K, b, b)
            Diagonal blocks (the lower triangles are used).
        lower : ndarray, shape (K, q, b, b)
            ``lower[i, p]`` couples rows of block i + p + 1 to columns of block i.
        border, corner
            As for the class.
        half_bandwidth : int, optional
            The largest distance of a nonzero entry from the diagonal, if it is known to be less
            than (q + 1) b - 1.
        layout
            As for the class.

        Raises
        ------
        InvalidInput
            If a shape is wrong, or an entry lies outside `half_bandwidth`.
        """
        from . import _chain

        diagonal = np.ascontiguousarray(diagonal, dtype=float)
        if diagonal.ndim != 3 or diagonal.shape[1] != diagonal.shape[2]:
            raise InvalidInput(
                f"argument `diagonal` has shape {diagonal.shape}; it must be (K, b, b)"
            )
        count, b, _ = diagonal.shape
        lower = np.ascontiguousarray(lower, dtype=float)
        if lower.ndim != 4 or lower.shape[0] != count or lower.shape[2:] != (b, b):
            raise InvalidInput(
                f"argument `lower` has shape {lower.shape}; it must be ({count}, q, {b}, {b})"
            )
        w = (lower.shape[1] + 1) * b - 1 if half_bandwidth is None else int(half_bandwidth)
        band = np.empty((count * b, w + 1))
        outside = _chain.blocks_to_band(diagonal, lower, w, band)
        if outside:
            raise InvalidInput(
                f"argument `half_bandwidth` is {w}, but an entry of size {outside:.3g} lies outside"
            )
        return cls(band, border, corner, layout=layout)

    @cached_property
    def _entries(self) -> Entries:
        """Offsets and numbers of the entries in the columns of the band, but for the diagonal."""
        from . import _chain

        length, width = self.band.shape
        if width <= _NARROW:
            return _all_entries(length, width)
        at, count = np.empty((length, width), np.uint32), np.empty(length, np.uint32)
        _chain.list_entries(self.band, length, at, count)
        return at, count

    def _full(self, dx: Array, dmultipliers: Array) -> Array:
        x = np.empty(self.n + self.m)
        x[self._unknowns] = dx
        x[self._constraints] = dmultipliers
        return x

    def apply(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return ``H dx + J^T dmultipliers`` and ``J dx``."""
        from . import _chain

        x = self._full(dx, dmultipliers)[None, :]
        out = np.empty_like(x)
        _chain.apply_chain(
            self.band, *self._entries, self.border, self.corner, self.border.shape[1], x, out
        )
        return out[0, self._unknowns], out[0, self._constraints]

    def magnitude(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return the sizes of the terms that `apply` sums."""
        from . import _chain

        x = self._full(dx, dmultipliers)
        out = np.empty_like(x)
        _chain.magnitude_chain(
            self.band, *self._entries, self.border, self.corner, self.border.shape[1], x, out
        )
        return out[self._unknowns], out[self._constraints]

    def factorize(
        self,
        shift: float = 0.0,
        gauge: Array | None = None,
        metric: Array | None = None,
        relaxation: float = 0.0,
    ) -> Factorization:
        """Factor the matrix; see :meth:`KKTMatrix.factorize`."""
        length, nb = self.border.shape
        rows = _gauge_rows(gauge, self.n)
        g = rows.shape[0]
        band, border, corner = self.band, self.border, self.corner
        if g:
            border = np.zeros((length, nb + g))
            border[:, :nb] = self.border
            corner = np.zeros((nb + g, nb + g))
            corner[:nb, :nb] = self.corner
            scattered = np.zeros((g, length + nb))
            scattered[:, self._unknowns] = rows
            border[:, nb:] = scattered[:, :length].T
            corner[nb:, :nb] = scattered[:, length:]
            corner[:nb, nb:] = scattered[:, length:].T
        if shift or relaxation:
            diagonal = np.zeros(length + nb)
            if shift:
                diagonal[self._unknowns] = shift * _mass(metric, self.n)
            diagonal[self._constraints] = -relaxation
            band = band.copy()
            band[:, 0] += diagonal[:length]
            corner = corner.copy()
            corner[np.arange(nb), np.arange(nb)] += diagonal[length:]
        return _ChainFactorization(
            band, self._entries, border, corner, self.layout, (self.n, self.m, g)
        )


class TridiagonalKKT(ChainKKT):
    """The KKT matrix of a chain of scalar unknowns under a few global constraints.

    Parameters
    ----------
    diagonal : ndarray, shape (n,)
        Diagonal of the Hessian of the Lagrangian.
    off_diagonal : ndarray, shape (n - 1,)
        Its entries beside the diagonal.
    rows : ndarray, shape (m, n), optional
        The Jacobian of the constraints.

    Raises
    ------
    InvalidInput
        If a shape is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.factorization import TridiagonalKKT
    >>> TridiagonalKKT(np.full(4, 2.0), np.full(3, -1.0)).factorize().inertia
    (4, 0, 0)
    """

    def __init__(self, diagonal: Array, off_diagonal: Array, rows: Array | None = None) -> None:
        diagonal = np.asarray(diagonal, dtype=float)
        off_diagonal = np.asarray(off_diagonal, dtype=float)
        if diagonal.ndim != 1 or off_diagonal.shape != (diagonal.size - 1,):
            raise InvalidInput(
                f"arguments `diagonal` and `off_diagonal` have shapes {diagonal.shape} and "
                f"{off_diagonal.shape}; they must be (n,) and (n - 1,)"
            )
        band = np.zeros((diagonal.size, 2))
        band[:, 0] = diagonal
        band[:-1, 1] = off_diagonal
        super().__init__(band, rows)


class _SparseFactorization(_ColumnFactorization):
    def __init__(self, matrix: Any, last: int, positions: NDArray[np.int64], counts: Any) -> None:
        from ._multifrontal import Multifrontal

        self.n, self.m, self.g = counts
        self._matrix = matrix  # both triangles, every diagonal entry present
        self._positions = positions
        sizes = np.abs(matrix.data)
        self._norm = float(np.max(sizes))
        if not math.isfinite(self._norm):
            raise FactorizationError("the KKT matrix holds NaN or infinity")
        scale = np.ones(matrix.shape[0])
        columns = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        for _ in range(3):
            largest = np.maximum.reduceat(sizes * scale[matrix.indices], matrix.indptr[:-1]) * scale
            scale /= np.sqrt(np.where(largest > 0, largest, 1.0))
        self._scale = np.exp2(np.round(np.log2(scale)))
        scaled = matrix.copy()
        scaled.data = matrix.data * self._scale[matrix.indices] * self._scale[columns]
        self._factors = Multifrontal(scaled, self.n, last)
        self.inertia = self._factors.inertia
        self.relative_smallest_pivot = self._factors.relative_smallest_pivot

    def _solve(self, rhs: Array) -> Array:
        full = np.empty_like(rhs)
        full[self._positions] = rhs
        scale = self._scale[:, None]
        return (self._factors.solve(full * scale) * scale)[self._positions]

    def _apply(self, z: Array) -> Array:
        full = np.empty_like(z)
        full[self._positions] = z
        return (self._matrix @ full)[self._positions]


class SparseKKT(KKTMatrix):
    r"""A sparse KKT matrix, for plates and other meshes in two dimensions.

    Factored by nested dissection and dense fronts (:mod:`lissome._multifrontal`), with delayed
    elimination where a front is nearly singular: the inertia is that of the whole matrix, also when
    multipliers have zero diagonals. The analysis of a pattern is remembered.

    Parameters
    ----------
    hessian : sparse matrix, shape (n, n)
        Hessian of the Lagrangian, both triangles; symmetric to 1e-8 of its size. Keep entries that
        happen to be zero, so that the pattern stays the same from state to state.
    jacobian : sparse matrix, shape (m, n), optional
        Derivatives of the constraints. Rows of more than :math:`\max(64, 2\sqrt n)` entries are
        treated as dense.

    Raises
    ------
    InvalidInput
        If a shape is wrong or the Hessian is not symmetric.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy import sparse
    >>> from lissome.factorization import SparseKKT
    >>> chain = sparse.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(500, 500))
    >>> SparseKKT(chain).factorize(shift=-1.001).inertia  # 167 eigenvalues up to 1
    (333, 167, 0)
    >>> SparseKKT(chain).factorize(shift=-1.0).inertia  # one of them is 1
    (333, 166, 1)
    """

    def __init__(self, hessian: Any, jacobian: Any = None) -> None:
        h = sparse.csc_matrix(hessian, dtype=float)
        if h.shape[0] != h.shape[1]:
            raise InvalidInput(f"argument `hessian` has shape {h.shape}; it must be square")
        self.n = h.shape[0]
        j = sparse.csr_matrix((0, self.n)) if jacobian is None else sparse.csr_matrix(jacobian)
        if j.shape[1] != self.n:
            raise InvalidInput(f"argument `jacobian` has shape {j.shape}; it must be (m, {self.n})")
        self.m = j.shape[0]
        with np.errstate(invalid="ignore"):
            skew = abs(h - h.T)
            largest = float(skew.data.max()) if skew.nnz else 0.0
            size = float(np.abs(h.data).max()) if h.nnz else 0.0
        if largest > 1e-8 * size:
            raise InvalidInput(
                f"argument `hessian` is not symmetric: entries differ by up to {largest:.3g}; check "
                "the second derivatives"
            )
        self.hessian = h
        self.jacobian = j.astype(float)

    def apply(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return ``H dx + J^T dmultipliers`` and ``J dx``."""
        return self.hessian @ dx + self.jacobian.T @ dmultipliers, self.jacobian @ dx

    def magnitude(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return the sizes of the terms that `apply` sums."""
        h, j = abs(self.hessian), abs(self.jacobian)
        return h @ np.abs(dx) + j.T @ np.abs(dmultipliers), j @ np.abs(dx)

    def jacobian_rows(self) -> Array:
        """Return the Jacobian as a dense matrix."""
        return self.jacobian.toarray()

    def factorize(
        self,
        shift: float = 0.0,
        gauge: Array | None = None,
        metric: Array | None = None,
        relaxation: float = 0.0,
    ) -> Factorization:
        """Factor the matrix; see :meth:`KKTMatrix.factorize`."""
        n, m = self.n, self.m
        rows = _gauge_rows(gauge, n)
        g = rows.shape[0]
        # A row that touches more unknowns than a cut through the mesh ties its two sides together.
        full = np.diff(self.jacobian.indptr) > max(64, 2 * math.isqrt(n))
        order = np.concatenate([np.flatnonzero(~full), np.flatnonzero(full)])
        below = sparse.vstack([self.jacobian[order], sparse.csr_matrix(rows)]).tocoo()
        upper = self.hessian.tocoo()
        diagonal = np.zeros(n + m + g)
        if shift:
            diagonal[:n] = shift * _mass(metric, n)
        diagonal[n : n + m] = -relaxation
        every = np.arange(n + m + g)
        # Zeros on the diagonal are entries, so that the pattern does not depend on the shift.
        matrix = sparse.coo_matrix(
            (
                np.concatenate([upper.data, below.data, below.data, diagonal]),
                (
                    np.concatenate([upper.row, below.row + n, below.col, every]),
                    np.concatenate([upper.col, below.col, below.row + n, every]),
                ),
            ),
            shape=(n + m + g, n + m + g),
        ).tocsc()
        matrix.sort_indices()
        place = np.empty(m, dtype=np.int64)
        place[order] = np.arange(m)
        positions = np.concatenate([np.arange(n), n + place, np.arange(n + m, n + m + g)])
        last = int(np.count_nonzero(full)) + g
        return _SparseFactorization(matrix, last, positions, (n, m, g))
