r"""Families of solutions of two-point boundary value problems, by Gauss collocation.

.. math:: y' = f(y, p),\qquad g(y(a), y(b), p) = 0

with one condition fewer than unknowns: the solutions form curves, followed by pseudo-arclength
through folds. Polynomials of the stage values superconverge at the nodes (order twice the number
of stages) and keep quadratic first integrals such as the norm of a quaternion exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from ..errors import NotConverged

__all__ = ["Family", "Point", "gauss"]

Array = npt.NDArray[np.float64]
Right = Callable[[npt.NDArray, npt.NDArray], npt.NDArray]
Ends = Callable[[npt.NDArray, npt.NDArray, npt.NDArray], npt.NDArray]
_IMAGINARY = 1e-30  # step of complex differentiation: no cancellation, so as small as one likes


@lru_cache
def gauss(stages: int) -> tuple[Array, Array, Array]:
    """Return matrix, weights and abscissas of Gauss collocation on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(stages)
    c = (x + 1.0) / 2.0
    powers = np.arange(stages)
    integrals = c[:, None] ** (powers + 1) / (powers + 1)
    return integrals @ np.linalg.inv(np.vander(c, increasing=True)), w / 2.0, c


@dataclass(frozen=True, eq=False)
class Point:
    """One solution of a family.

    Attributes
    ----------
    mesh : ndarray, shape (m + 1,)
        Ends of the elements.
    nodes : ndarray, shape (m + 1, n)
        Values there.
    slopes : ndarray, shape (m, k, n)
        Derivatives at the collocation points of each element.
    parameters : ndarray, shape (q,)
        Unknown constants; the last one is that along which folds are counted.
    """

    mesh: Array
    nodes: Array
    slopes: Array
    parameters: Array

    def __post_init__(self) -> None:
        for array in (self.mesh, self.nodes, self.slopes, self.parameters):
            array.setflags(write=False)

    @cached_property
    def stage_positions(self) -> Array:
        """Collocation points, shape (m, k)."""
        _, _, c = gauss(self.slopes.shape[1])
        return np.asarray(self.mesh[:-1, None] + np.diff(self.mesh)[:, None] * c)

    @cached_property
    def stage_values(self) -> Array:
        """Solution at the collocation points, shape (m, k, n)."""
        a, _, _ = gauss(self.slopes.shape[1])
        step = np.diff(self.mesh)[:, None, None]
        return np.asarray(self.nodes[:-1, None] + step * np.einsum("ij,ejn->ein", a, self.slopes))

    def at(self, position: npt.ArrayLike) -> Array:
        """Values of the collocation polynomials at `position`, shape (..., n)."""
        s = np.asarray(position, dtype=float)
        stages = self.slopes.shape[1]
        _, _, c = gauss(stages)
        element = np.clip(np.searchsorted(self.mesh, s, "right") - 1, 0, len(self.mesh) - 2)
        step = np.diff(self.mesh)[element]
        local = (s - self.mesh[element]) / step
        powers = np.arange(stages)
        weights = (local[..., None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(
            np.vander(c, increasing=True)
        )
        rise = np.einsum("...j,...jn->...n", weights, self.slopes[element])
        return np.asarray(self.nodes[element] + step[..., None] * rise)


class Family:
    """The solutions of one problem on one mesh.

    Parameters
    ----------
    right : callable
        f(y, p) with y of shape (n, points) and p of shape (q,) or (q, points), analytic in y and p:
        derivatives are taken by complex steps.
    ends : callable
        g(y(a), y(b), p), n + q - 1 conditions, as analytic. All have columns, as in f.
    mesh : ndarray
        Ends of the elements.
    stages : int
        Collocation points an element.
    """

    def __init__(self, right: Right, ends: Ends, mesh: Array, stages: int) -> None:
        self.right = right
        self.ends = ends
        self.mesh = np.asarray(mesh, dtype=float)
        self.stages = stages
        self._latest: tuple[Point, tuple[Array, Array, Array]] | None = None

    def start(self, values: Array, parameters: Array) -> Point:
        """Return a first guess that interpolates `values` at the mesh, shape (m + 1, n)."""
        _, _, c = gauss(self.stages)
        steps = np.diff(values, axis=0)
        between = values[:-1, None] + steps[:, None] * c[:, None]
        flat = between.reshape(-1, values.shape[1]).T
        slopes = self.right(flat, parameters).T.reshape(between.shape)
        return Point(self.mesh, values.copy(), slopes, np.array(parameters, dtype=float))

    def fixed(self, guess: Point, value: float, which: int = -1) -> Point:
        """Return the solution whose parameter number `which` is `value`."""
        row = np.zeros(guess.nodes.size + len(guess.parameters))
        row[guess.nodes.size :][which] = 1.0
        return self._newton(guess, row, value, 1e-11, 25)

    def defect(self, point: Point) -> Array:
        """Largest error of the equation between the collocation points, per element.

        The derivative of the collocation polynomial less f, at the middles between neighboring
        collocation points, times the length of the element.
        """
        _, _, c = gauss(self.stages)
        middle = (c[1:] + c[:-1]) / 2.0
        basis = np.vander(middle, self.stages, increasing=True) @ np.linalg.inv(
            np.vander(c, increasing=True)
        )
        step = np.diff(self.mesh)
        positions = self.mesh[:-1, None] + step[:, None] * middle
        values = point.at(positions)
        slopes = np.einsum("gj,ejn->egn", basis, point.slopes)
        flat = values.reshape(-1, values.shape[-1]).T
        wanted = self.right(flat, point.parameters).T.reshape(slopes.shape)
        return np.asarray(np.abs(slopes - wanted).max(axis=(1, 2)) * step)

    def refined(self, point: Point, split: npt.NDArray[np.bool_]) -> tuple[Family, Point]:
        """Halve the elements marked in `split`; return the new family and its solution."""
        added = (self.mesh[:-1] + self.mesh[1:])[split] / 2.0
        family = Family(self.right, self.ends, np.sort([*self.mesh, *added]), self.stages)
        guess = family.resample(point)
        return family, family.fixed(guess, float(point.parameters[-1]))

    def resample(self, point: Point) -> Point:
        """Return the values of a solution on another mesh as a guess on this one."""
        nodes = point.at(self.mesh)
        _, _, c = gauss(self.stages)
        stages = point.at(self.mesh[:-1, None] + np.diff(self.mesh)[:, None] * c)
        flat = stages.reshape(-1, nodes.shape[1]).T
        slopes = self.right(flat, point.parameters).T.reshape(stages.shape)
        return Point(self.mesh, nodes, slopes, point.parameters.copy())

    def tangent(self, point: Point, towards: Array | None = None, which: int = -1) -> Array:
        """Return the unit tangent of the curve, in the direction of `towards`.

        Nodal values and parameters; without `towards`, parameter number `which` grows along it.
        """
        matrix, _, _ = self._linearized(point)
        weight = self._weight(point)
        row = np.zeros(matrix.shape[1])
        if towards is None:
            row[point.nodes.size :][which] = 1.0
        else:
            row = weight * towards
        right = np.zeros(len(row))
        right[-1] = 1.0
        found = _solve(np.vstack([matrix, row]), right)
        return np.asarray(found / np.sqrt(np.sum(weight * found * found)))

    def step(self, point: Point, tangent: Array, length: float) -> Point:
        """Return the solution in the plane normal to `tangent` at the distance `length`."""
        row = self._weight(point) * tangent
        _, _, sensitivity = self._linearized(point)
        guess = self._moved(point, length * tangent, sensitivity, homogeneous=True)
        return self._newton(guess, row, float(row @ self._flat(point)) + length, 1e-11, 9)

    def turn(self, one: Array, other: Array, point: Point) -> float:
        """Cosine of the angle of two unit tangents."""
        return float(np.sum(self._weight(point) * one * other))

    def fold(self, point: Point, tangent: Array, length: float) -> tuple[Point, Array]:
        """Return the fold between `point` and the solution at `length` along its tangent.

        There the last parameter is stationary: the last component of the tangent is zero.
        """

        def component(distance: float) -> float:
            there = self.step(point, tangent, distance) if distance else point
            return float(self.tangent(there, tangent)[-1])

        # The parameter is stationary at a fold: an error e of the place is an error e^2 of it.
        place = float(brentq(component, 0.0, length, xtol=1e-9, rtol=1e-10))
        found = self.step(point, tangent, place)
        return found, self.tangent(found, tangent)

    def _flat(self, point: Point) -> Array:
        return np.concatenate([point.nodes.ravel(), point.parameters])

    def _weight(self, point: Point) -> Array:
        """Mean square of the nodal values plus the square of the last parameter."""
        step = np.diff(self.mesh)
        width = np.zeros(len(self.mesh))
        width[1:] += step / 2
        width[:-1] += step / 2
        n, q = point.nodes.shape[1], len(point.parameters)
        return np.concatenate([np.repeat(width / width.sum(), n), np.zeros(q - 1), [1.0]])

    def _newton(
        self, guess: Point, row: Array, value: float, tolerance: float, limit: int
    ) -> Point:
        point, history = guess, []
        for _ in range(limit):
            matrix, residual, sensitivity = self._linearize(point)
            flat = self._flat(point)
            whole = np.vstack([matrix, row])
            right = np.append(residual, value - row @ flat)
            try:
                change = _solve(whole, right)
            except np.linalg.LinAlgError as error:
                raise NotConverged("the collocation equations are singular") from error
            size = float(np.abs(change).max())
            history.append(size)
            if not np.isfinite(size) or size > 1e3:
                break
            point = self._moved(point, change, sensitivity)
            if size < tolerance * (1.0 + float(np.abs(flat).max())):
                return point
        raise NotConverged(
            f"collocation did not converge; its Newton steps were {history}", history=history
        )

    def _moved(
        self, point: Point, change: Array, sensitivity: Array, *, homogeneous: bool = False
    ) -> Point:
        count, n = point.nodes.shape
        nodes = change[: count * n].reshape(count, n)
        parameters = change[count * n :]
        slopes = np.einsum("eknm,em->ekn", sensitivity[..., :n], nodes[:-1])
        slopes = slopes + np.einsum("eknm,m->ekn", sensitivity[..., n:-1], parameters)
        if not homogeneous:
            slopes = slopes + sensitivity[..., -1]
        return Point(
            self.mesh, point.nodes + nodes, point.slopes + slopes, point.parameters + parameters
        )

    def _linearized(self, point: Point) -> tuple[Array, Array, Array]:
        """As :meth:`_linearize`, kept for the latest point: its tangent is followed by a step."""
        if self._latest is None or self._latest[0] is not point:
            self._latest = (point, self._linearize(point))
        return self._latest[1]

    def _linearize(self, point: Point) -> tuple[Array, Array, Array]:
        """Newton's equations in nodal values and parameters, stages eliminated element by element.

        Returns matrix, right-hand side, and the stages' response (m, k, n, n + q + 1) to the first
        node of the element, the parameters, and the residual.
        """
        count, n = point.nodes.shape
        m, k, q = count - 1, self.stages, len(point.parameters)
        a, b, _ = gauss(k)
        step = np.diff(self.mesh)
        value, by_state, by_parameter = _differentiate(
            self.right, point.stage_values.reshape(m * k, n).T, point.parameters
        )
        residual = point.slopes - value.T.reshape(m, k, n)
        states = by_state.transpose(2, 0, 1).reshape(m, k, n, n)
        parameters = by_parameter.transpose(2, 0, 1).reshape(m, k, n, q)
        local = -np.einsum("e,eimn,ij->eimjn", step, states, a)
        for i in range(k):
            local[:, i, range(n), i, range(n)] += 1.0
        driven = np.concatenate(
            [
                states.reshape(m, k * n, n),
                parameters.reshape(m, k * n, q),
                -residual.reshape(m, k * n, 1),
            ],
            axis=2,
        )
        response = np.linalg.solve(local.reshape(m, k * n, k * n), driven)
        response = response.reshape(m, k, n, n + q + 1)
        moved = np.einsum("e,j,ejnm->enm", step, b, response)
        gap = np.diff(point.nodes, axis=0) - step[:, None] * np.einsum("j,ejn->en", b, point.slopes)
        ends = np.concatenate([point.nodes[0], point.nodes[-1], point.parameters])

        def conditions(z: npt.NDArray) -> npt.NDArray:
            return self.ends(z[:n], z[n : 2 * n], z[2 * n :])

        size = len(ends)
        shifted = np.tile(ends.astype(complex)[:, None], (1, size + 1))
        shifted[range(size), range(size)] += 1j * _IMAGINARY
        found = conditions(shifted)
        here, slope = found[:, -1].real, found[:, :-1].imag / _IMAGINARY
        matrix = np.zeros((m * n + len(here), count * n + q))
        blocks = matrix[: m * n].reshape(m, n, count * n + q)
        by_node = blocks[..., : count * n].reshape(m, n, count, n)
        element = np.arange(m)
        by_node[element, :, element] = -np.eye(n) - moved[..., :n]
        by_node[element, :, element + 1] = np.eye(n)
        blocks[..., count * n :] = -moved[..., n : n + q]
        matrix[m * n :, :n] = slope[:, :n]
        matrix[m * n :, m * n : count * n] = slope[:, n : 2 * n]
        matrix[m * n :, count * n :] = slope[:, 2 * n :]
        right = np.concatenate([(moved[..., -1] - gap).ravel(), -here])
        return matrix, right, response


def _solve(matrix: Array, right: Array) -> Array:
    """Solve equations of which most entries vanish: each element knows its two nodes only."""
    try:
        return np.asarray(splu(csc_array(matrix)).solve(right))
    except RuntimeError as error:  # what SuperLU calls singular
        raise np.linalg.LinAlgError(str(error)) from error


def _differentiate(right: Right, y: Array, p: Array) -> tuple[Array, Array, Array]:
    """Value of f and its derivatives by y and p, each with the points last."""
    n, q, points = len(y), len(p), y.shape[1]
    # all directions in one call: the arrays are small, so that calls cost more than numbers
    states = np.tile(y.astype(complex), (1, n + q))
    constants = np.tile(p.astype(complex)[:, None], (1, (n + q) * points))
    for j in range(n + q):
        column = slice(j * points, (j + 1) * points)
        (states if j < n else constants)[j if j < n else j - n, column] += 1j * _IMAGINARY
    slopes = right(states, constants).imag.reshape(n, n + q, points) / _IMAGINARY
    return right(y, p), slopes[:, :n], slopes[:, n:]
