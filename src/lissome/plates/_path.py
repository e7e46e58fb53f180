r"""The path of a plate under a growing spontaneous curvature, with few factorizations.

A spontaneous curvature :math:`p\,\kappa_1` adds a force :math:`p f` that is the same in every state: the
Hessian H(x) does not know p. Equilibria :math:`g(x) = p f` are followed by arc length. Corrections reuse
the factors of the point before as long as they contract, so that a step costs little more than the one
factorization at its end, which tells stability; where that is lost, the zero of the lowest eigenvalue as
a function of arc length is found.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from .._corrector import (
    Balanced,
    CorrectionFailed,
    _evaluate,
    critical_modes,
    member,
    typical_size,
)
from ..equilibrium import Iteration, relative_residual
from ..errors import FactorizationError, NotConverged

Array = NDArray[np.float64]

NONE = np.zeros(0)
#: Size of the corrections, relative to typical unknowns, at which an iterate is accepted.
ACCEPTED = 1e-8
#: Largest ratio of successive corrections with the factors of another state.
CONTRACTION = 0.4
#: Largest first correction of a step, that is, error of its prediction.
PREDICTED = 0.05
#: Largest turn of the tangent in a step: least cosine.
TURN = 0.7


@dataclass(frozen=True)
class Point:
    """An equilibrium on the path."""

    parameter: float
    length: float
    balanced: Balanced = field(repr=False)
    response: Array = field(repr=False)  # H^-1 f
    tangent: tuple[Array, float] = field(repr=False)

    @property
    def index(self) -> int:
        """Number of unstable directions."""
        return self.balanced.index


@dataclass(frozen=True)
class Loss:
    """Where stability is lost.

    Attributes
    ----------
    before : Point
        The last stable one.
    after_index : int
        Number of unstable directions just beyond.
    parameter, uncertainty : float
    kind : str
        "fold" or "bifurcation".
    modes : ndarray, shape (k, n)
        Critical modes, the lowest first.
    """

    before: Point
    after_index: int
    parameter: float
    uncertainty: float
    kind: str
    modes: Array = field(repr=False)


class Path:
    """The equilibria of `plate` with the force p `force` besides its own."""

    damped = False  #: Whether corrections that do not contract are tried again with damping.

    def __init__(self, plate: Any, force: Array, state: Any, parameter: float, way: float) -> None:
        self.plate, self.force = plate, force
        self._begin(state, parameter, way)

    def _begin(self, state: Any, parameter: float, way: float) -> None:
        plate = self.plate
        self.size = typical_size(plate, state)
        self.weight = 1.0 / (len(self.size) * self.size**2)
        self.metric = np.asarray(plate.metric(state), dtype=float)
        self.scale = 1.0
        self.factorizations = 0
        first = self._settled(state, parameter, 0.0, None, 0)
        stretch = float(np.sqrt(np.sum(self.weight * first.response**2)))
        self.scale = 1.0 / stretch if stretch > 0 else 1.0
        dx, dp = first.tangent
        sign = np.copysign(1.0, dp * way)
        norm = self._norm(dx, dp)
        self.points = [replace(first, tangent=(sign * dx / norm, sign * dp / norm))]

    # -- what depends on the parameter --------------------------------------------------------------

    def _member(self, parameter: float) -> Any:
        """Return the plate at a parameter; the force is not in it."""
        return self.plate

    def _unbalanced(self, gradient: Array, parameter: float) -> Array:
        return gradient - parameter * self.force

    def _push(self, state: Any, parameter: float) -> Array:
        """Return the derivative of the force with respect to the parameter."""
        return self.force

    # -- one point --------------------------------------------------------------------------------

    def _norm(self, dx: Array, dp: float) -> float:
        return float(np.sqrt(np.sum(self.weight * dx**2) + (dp / self.scale) ** 2))

    def _dot(self, a: tuple[Array, float], b: tuple[Array, float]) -> float:
        return float(np.sum(self.weight * a[0] * b[0]) + a[1] * b[1] / self.scale**2)

    def _gradient(self, state: Any, parameter: float) -> Array:
        gradient = self._member(parameter).evaluate(state, NONE, 1).gradient
        return self._unbalanced(gradient, parameter)

    def _settled(
        self, state: Any, parameter: float, length: float, along: Any, iterations: int
    ) -> Point:
        """Return a balanced state with its factors and its tangent."""
        plate = self._member(parameter)
        evaluation, factors = _evaluate(plate, state, NONE)
        self.factorizations += 1
        gradient = self._unbalanced(evaluation.gradient, parameter)
        force = self._push(state, parameter)
        terms = evaluation.kkt.magnitude(self.size, NONE)
        residual = relative_residual(gradient, NONE, terms)
        try:
            both, _ = factors.solve(np.stack([force, -gradient], axis=1))
        except FactorizationError as error:
            raise CorrectionFailed(str(error)) from error
        response = both[:, 0]
        correction = float(np.max(np.abs(both[:, 1]) / self.size))
        line = Iteration(
            iterations,
            evaluation.energy,
            residual,
            correction,
            0.0,
            0.0,
            factors.inertia,
            "accepted",
        )
        balanced = Balanced(plate, state, NONE, evaluation, residual, factors, (line,))
        tangent = (response, 1.0)
        norm = self._norm(*tangent)
        sign = 1.0 if along is None else np.copysign(1.0, self._dot(tangent, along))
        tangent = (sign * response / norm, sign / norm)
        return Point(parameter, length, balanced, response, tangent)

    def _point(
        self, start: Point, dx: Array, dp: float, along: tuple[Array, float], length: float
    ) -> Point:
        """Return the equilibrium next to ``start + (dx, dp)``, on the plane across `along`."""
        state = self.plate.retract(start.balanced.state, dx)
        parameter = start.parameter + dp
        factors, response = start.balanced.factorization, start.response
        row = (self.weight * along[0], along[1] / self.scale**2)
        fresh, previous = False, np.inf
        for number in range(16):
            gradient = self._gradient(state, parameter)
            if not np.all(np.isfinite(gradient)):
                raise CorrectionFailed("the gradient is not finite")
            try:
                step, _ = factors.solve(-gradient)
            except FactorizationError as error:
                raise CorrectionFailed(str(error)) from error
            change = -float(row[0] @ step) / (float(row[0] @ response) + row[1])
            step = step + change * response
            correction = max(float(np.max(np.abs(step) / self.size)), abs(change) / self.scale)
            if number == 0 and correction > PREDICTED:
                raise CorrectionFailed("the prediction is too far off")
            if correction > CONTRACTION * previous:
                if fresh and correction > ACCEPTED:
                    if not self.damped:
                        raise CorrectionFailed("corrections do not contract")
                    predicted = self.plate.retract(start.balanced.state, dx)
                    return self._damped(predicted, start.parameter + dp, row, along, length)
                if not fresh:
                    _, factors = _evaluate(self._member(parameter), state, NONE)
                    self.factorizations += 1
                    try:
                        response, _ = factors.solve(self._push(state, parameter))
                    except FactorizationError as error:
                        raise CorrectionFailed(str(error)) from error
                    fresh, previous = True, np.inf
                    continue
            state = self.plate.retract(state, step)
            parameter += change
            if correction <= ACCEPTED:
                return self._settled(state, parameter, length, along, number)
            previous = correction
        raise CorrectionFailed("corrections contract too slowly")

    def _damped(
        self, state: Any, parameter: float, row: tuple[Array, float], along: Any, length: float,
        most: int = 12,
    ) -> Point:  # fmt: skip
        """Return the equilibrium next to a guess, on the plane of `row`, by damped Newton steps.

        Dearer than :meth:`_point`, but for thin plates the steps may be many times as long.
        """

        def solved(factors: Any, state: Any, parameter: float, response: Array) -> Any:
            step, _ = factors.solve(-self._gradient(state, parameter))
            change = -float(row[0] @ step) / (float(row[0] @ response) + row[1])
            step = step + change * response
            return step, change, self._norm(step, change)

        for number in range(most):
            try:
                _, factors = _evaluate(self._member(parameter), state, NONE)
                self.factorizations += 1
                response, _ = factors.solve(self._push(state, parameter))
                step, change, norm = solved(factors, state, parameter, response)
                correction = float(np.max(np.abs(step) / self.size))
                part = 1.0
                while True:
                    trial = self.plate.retract(state, part * step)
                    left = solved(factors, trial, parameter + part * change, response)[2]
                    if left <= (1.0 - 0.25 * part) * norm or correction <= ACCEPTED:
                        break
                    part *= 0.5
                    if part < 1e-2:
                        raise CorrectionFailed("damped corrections come to nothing")
            except FactorizationError as error:
                raise CorrectionFailed(str(error)) from error
            state, parameter = trial, parameter + part * change
            if correction <= ACCEPTED:
                return self._settled(state, parameter, length, along, number)
        raise CorrectionFailed("damped corrections contract too slowly")

    # -- the path ---------------------------------------------------------------------------------

    def _predicted(self, step: float) -> tuple[Array, float]:
        """Return the increment from the last point, by the tangents of the last two."""
        last = self.points[-1]
        dx, dp = step * last.tangent[0], step * last.tangent[1]
        if len(self.points) > 1:
            # The tangent turns on as it has turned.
            before = self.points[-2]
            gap = last.length - before.length
            half = 0.5 * step * step / gap
            dx = dx + half * (last.tangent[0] - before.tangent[0])
            dp = dp + half * (last.tangent[1] - before.tangent[1])
        return dx, dp

    def to_loss(self, stop: float, tolerance: float, most: int = 400) -> Loss | None:
        """Follow the path to the first loss of stability; None if `stop` comes first."""
        way = np.copysign(1.0, stop - self.points[0].parameter)
        if self.points[0].index > 0 or self.points[0].balanced.marginal:
            raise NotConverged(
                "the path begins at a state that is not stable", state=self.points[0].balanced.state
            )
        step, shortest = 0.1, 1e-9
        for _ in range(most):
            last = self.points[-1]
            if (last.parameter - stop) * way >= 0:
                return None
            dx, dp = self._predicted(step)
            try:
                new = self._point(last, dx, dp, last.tangent, last.length + step)
                cosine = self._dot(new.tangent, last.tangent)
                if cosine < TURN:
                    raise CorrectionFailed("the path turns")
                if new.index == 0 and new.tangent[1] * last.tangent[1] < 0:
                    raise CorrectionFailed("two folds in one step")
            except CorrectionFailed as error:
                step *= 0.4
                if step < shortest:
                    raise NotConverged(
                        f"the path cannot be followed beyond p = {last.parameter:.8g} ({error})",
                        state=last.balanced.state,
                    ) from error
                continue
            if new.index > 0 or new.balanced.marginal:
                return self._located(last, new, tolerance)
            self.points.append(new)
            step = min(1.0, step * (2.0 if cosine > 0.97 else 1.3))
        raise NotConverged(
            f"the path is still stable at p = {self.points[-1].parameter:.8g} after {most} steps; "
            "bring `stop` nearer",
            state=self.points[-1].balanced.state,
        )

    def _located(self, low: Point, high: Point, tolerance: float) -> Loss:
        """Return the loss of stability between a stable and an unstable point."""
        gap = high.length - low.length
        ends = (low, high)
        # Cubic through both ends, for predictions.
        jump = self.plate.difference(low.balanced.state, high.balanced.state)
        rise = high.parameter - low.parameter
        chord = (jump, rise)
        known: dict[float, tuple[float, Point]] = {}
        critical: list[float] = []
        modes: Array | None = None

        def lowest(point: Point) -> tuple[float, Array]:
            values, found = critical_modes(point.balanced, 3, modes, iterations=6)
            return float(np.min(values)), found[np.argsort(values)]

        def value(length: float) -> float:
            nonlocal modes
            if length not in known:
                if length in (low.length, high.length):
                    point = ends[int(length == high.length)]
                    lambda_, modes = lowest(point)
                else:
                    r = (length - low.length) / gap
                    h1, h2, h3 = r * r * (3 - 2 * r), r * (1 - r) ** 2 * gap, r * r * (r - 1) * gap
                    dx = h1 * jump + h2 * low.tangent[0] + h3 * high.tangent[0]
                    dp = h1 * rise + h2 * low.tangent[1] + h3 * high.tangent[1]
                    try:
                        point = self._point(low, dx, dp, chord, length)
                        lambda_, modes = lowest(point)
                    except (CorrectionFailed, FactorizationError):  # critical to rounding
                        critical.append(length)
                        return 0.0
                    point = replace(point, length=length)
                if (lambda_ > 0) != (
                    point.index == 0
                ):  # rounding, or a mode not seen: inertia rules
                    lambda_ = abs(lambda_) if point.index == 0 else -abs(lambda_)
                known[length] = lambda_, point
            return known[length][0]

        first, last = low.tangent[1], high.tangent[1]
        size = tolerance * max(abs(low.parameter), abs(high.parameter))
        if first * last < 0:  # p is a parabola of arc length
            bend = abs(first - last) / (2 * gap)
            narrow = 0.5 * np.sqrt(size / bend)
        else:
            narrow = size / max(abs(first), abs(last))
        narrow = min(narrow, 0.1 * gap)
        value(low.length)
        if known[low.length][0] > 0 > value(high.length):
            root = brentq(value, low.length, high.length, xtol=0.5 * narrow, rtol=1e-12)
            for reach in (0.5 * narrow, 2.0 * narrow):
                for side in (-reach, reach):
                    if low.length < root + side < high.length:
                        value(root + side)
                if not critical:
                    break
                critical.clear()
        stable = max((l for l, (v, p) in known.items() if p.index == 0), default=low.length)
        unstable = min(l for l, (v, p) in known.items() if p.index > 0 or l == high.length)
        before, beyond = known[stable][1], known[unstable][1]
        _, modes = lowest(before)
        mode = modes[0]
        along = before.response
        overlap = abs(float(mode @ (self.metric * along)))
        overlap /= float(np.sqrt((along @ (self.metric * along)) * (mode @ (self.metric * mode))))
        kind = "fold" if overlap > 0.5 else "bifurcation"
        top = max if first > 0 else min
        ends_at = (before.parameter, beyond.parameter)
        parameter = float(top(ends_at) if kind == "fold" else 0.5 * sum(ends_at))
        # A quadratic estimate besides the bracket itself: at a fold both ends may lie equally low.
        width = unstable - stable
        slack = 0.25 * width * max(abs(before.tangent[1]), abs(beyond.tangent[1]))
        uncertainty = float(max(0.5 * abs(beyond.parameter - before.parameter), slack))
        self.points.append(before)
        return Loss(before, beyond.index, parameter, uncertainty, kind, modes)


class TimePath(Path):
    """Equilibria of an evolving plate, whose time is the parameter."""

    damped = True

    def __init__(self, evolving: Any, state: Any, time: float, last: float, little: float) -> None:
        self.evolving, self.last, self.little = evolving, last, little
        self.plate, self.force = evolving.structure(time), NONE
        self._begin(state, time, 1.0)

    def _member(self, parameter: float) -> Any:
        return member(self.evolving.structure, parameter)

    def _unbalanced(self, gradient: Array, parameter: float) -> Array:
        return gradient

    def _push(self, state: Any, parameter: float) -> Array:
        low, high = parameter - self.little, min(parameter + self.little, self.last)
        ends = [self._member(time).evaluate(state, NONE, 1).gradient for time in (low, high)]
        return (ends[0] - ends[1]) / (high - low)
