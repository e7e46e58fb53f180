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

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack

from .errors import FactorizationError, InvalidInput

__all__ = ["DenseKKT", "Factorization", "KKTMatrix"]

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


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

    @abstractmethod
    def _solve(self, rhs: Array) -> Array:
        """Solve with the factors, for columns of shape (n + m + g, k)."""

    @abstractmethod
    def _apply(self, z: Array) -> Array:
        """Apply the matrix that was factored."""

    def solve(self, rhs_x: ArrayLike, rhs_c: ArrayLike | None = None) -> tuple[Array, Array]:
        """Solve the KKT system, with iterative refinement.

        Parameters
        ----------
        rhs_x : array_like, shape (n,) or (n, k)
            Right-hand sides of the force balance.
        rhs_c : array_like, shape (m,) or (m, k), optional
            Right-hand sides of the constraints; zero by default.

        Returns
        -------
        dx : ndarray, shape (n,) or (n, k)
        dmultipliers : ndarray, shape (m,) or (m, k)

        Raises
        ------
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
        rhs = np.zeros((self.n + self.m + self.g, k))
        rhs[: self.n] = columns
        if rhs_c is not None:
            second = np.asarray(rhs_c, dtype=float)
            second = second[:, None] if second.ndim == 1 else second
            if second.shape != (self.m, k):
                raise InvalidInput(
                    f"argument `rhs_c` has shape {np.shape(rhs_c)}; it must hold {k} columns of "
                    f"{self.m} values"
                )
            rhs[self.n : self.n + self.m] = second
        if self.inertia[2]:
            raise FactorizationError(
                f"the KKT matrix is singular to working precision ({self.inertia[2]} zero pivots): "
                "the state is critical, a neutral motion is not listed in `gauge`, or constraints "
                "are redundant"
            )
        z = self._solve(rhs)
        residual = rhs - self._apply(z)
        size = np.max(np.abs(residual), axis=0, initial=0.0)
        for _ in range(3):
            trial = z + self._solve(residual)
            left = rhs - self._apply(trial)
            new = np.max(np.abs(left), axis=0, initial=0.0)
            better = new < size
            if not np.any(better):
                break
            z = np.where(better, trial, z)
            residual = np.where(better, left, residual)
            done = np.all(new >= 0.25 * size)
            size = np.where(better, new, size)
            if done:
                break
        if not np.all(np.isfinite(z)):
            raise FactorizationError("the solution of the KKT system is not finite")
        dx, dm = z[: self.n], z[self.n : self.n + self.m]
        return (dx[:, 0], dm[:, 0]) if single else (dx, dm)


class KKTMatrix(ABC):
    """The matrix of an equilibrium problem: Hessian of the Lagrangian and Jacobian of constraints.

    Attributes
    ----------
    n, m : int
        Numbers of unknowns and of constraints.
    """

    n: int
    m: int

    @abstractmethod
    def apply(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return ``H dx + J^T dmultipliers`` and ``J dx``."""

    @abstractmethod
    def magnitude(self, dx: Array, dmultipliers: Array) -> tuple[Array, Array]:
        """Return the same with the absolute values of everything: the sizes of the summed terms."""

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


class _DenseFactorization(Factorization):
    def __init__(self, matrix: Array, n: int, m: int, g: int) -> None:
        self.n, self.m, self.g = n, m, g
        self._matrix = matrix
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
        """Return the whole matrix, with shift, gauge rows and relaxation."""
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
        """Factor the matrix; see :meth:`KKTMatrix.factorize`."""
        full = self.matrix(shift, gauge, metric, relaxation)
        if not np.all(np.isfinite(full)):
            raise FactorizationError("the KKT matrix holds NaN or infinity")
        return _DenseFactorization(full, self.n, self.m, full.shape[0] - self.n - self.m)
