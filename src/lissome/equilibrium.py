"""Stable stationary points of an energy under equality constraints.

Newton's method on the KKT system of the Lagrangian, with the inertia of the KKT matrix held at that
of a minimum: a shift of the Hessian where it is not, a step along the direction of negative
curvature at a saddle, a second-order correction with the same factors, and a line search.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Literal, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._telling import one_call, user_level
from ._validate import PLAIN, finite, finite_array, integer_at_least, one_of, structure_like
from .errors import (
    FactorizationError,
    InvalidInput,
    LissomeError,
    NotConverged,
    StabilityNotResolvable,
    Unstable,
)
from .factorization import Factorization, KKTMatrix
from .reactions import Reaction, Reactions
from .stability import lowest_mode, softest_mode, yielding_multipliers
from .structure import Corrected, Evaluation, Structure, save_state

__all__ = ["Equilibrium", "Iteration", "equilibrate"]

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
DEFAULT_TOLERANCE = 1e-9
#: Corrections beyond this multiple of the typical unknowns are shortened by a shift, at first.
FAR = 10.0


@dataclass(frozen=True)
class Iteration:
    """One line of the history of a solve.

    Attributes
    ----------
    number : int
        Iteration, from 0.
    energy : float
        Potential energy.
    residual : float
        Largest unbalanced force or constraint, relative to the size of the terms in its sum.
    correction : float
        Size of the Newton correction relative to the typical size of the unknowns.
    shift : float
        Multiple of the metric added to the Hessian.
    step : float
        Fraction of the correction that was taken (0 on the last line).
    inertia : tuple of int
        Inertia of the KKT matrix without shift.
    kind : str
        "newton", "corrected" (with second-order correction), "curvature" (step off a saddle),
        "accepted" or "fast" (by the structure's own corrector).

    Examples
    --------
    >>> import lissome as ls
    >>> def fork(p):
    ...     return ls.DenseStructure(
    ...         initial=[0.4],
    ...         energy=lambda x: x[0] ** 4 / 4 - p * x[0] ** 2 / 2,
    ...         gradient=lambda x: x**3 - p * x,
    ...         hessian=lambda x: [[3 * x[0] ** 2 - p]],
    ...     )
    >>> history = ls.equilibrate(fork(1.0)).history
    >>> print(history[-1].kind, history[-1].inertia, history[-1].residual < 1e-12)
    accepted (1, 0, 0) True
    """

    number: int
    energy: float
    residual: float
    correction: float
    shift: float
    step: float
    inertia: tuple[int, int, int]
    kind: str


E = TypeVar("E", bound="Equilibrium")


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A stationary point of a structure: balanced, and stable unless it was asked for otherwise.

    Attributes
    ----------
    structure : Structure
        What was solved.
    state : object
        The state.
    multipliers : ndarray, shape (m,)
        Lagrange multipliers of the constraints.
    energy : float
        Potential energy.
    residual : float
        Largest unbalanced force or constraint relative to the terms that are summed in it.
    inertia : tuple of int
        Positive, negative and zero pivots of the KKT matrix (with gauge rows).
    iterations : int
        Number of Newton iterations.
    stable : bool
        Whether the second variation is positive on all admissible, not neutral, motions.
    history : tuple of Iteration
        The iterations.

    Examples
    --------
    >>> import lissome as ls
    >>> def fork(p):
    ...     return ls.DenseStructure(
    ...         initial=[0.4],
    ...         energy=lambda x: x[0] ** 4 / 4 - p * x[0] ** 2 / 2,
    ...         gradient=lambda x: x**3 - p * x,
    ...         hessian=lambda x: [[3 * x[0] ** 2 - p]],
    ...     )
    >>> found = ls.equilibrate(fork(1.0))
    >>> print(found.state.x.round(9), round(found.energy, 9), found.stable, found.index)
    [1.] -0.25 True 0
    >>> print(round(found.smallest_eigenvalue(), 6))
    2.0
    """

    structure: Any
    state: Any
    multipliers: Array
    energy: float
    residual: float
    inertia: tuple[int, int, int]
    iterations: int
    stable: bool
    history: tuple[Iteration, ...] = field(repr=False)

    @property
    def index(self) -> int:
        """Number of unstable directions; 0 for a stable equilibrium."""
        return self.inertia[1] - (sum(self.inertia) - self.structure.size)

    @cached_property
    def evaluation(self) -> Evaluation:
        """Energy, gradient, constraints and KKT matrix at the equilibrium."""
        return self.structure.evaluate(self.state, self.multipliers, 2)

    @cached_property
    def metric(self) -> Array:
        """Diagonal metric at the equilibrium, shape (n,)."""
        return np.asarray(self.structure.metric(self.state), dtype=float)

    @cached_property
    def gauge(self) -> Array:
        """Generators of neutral motions at the equilibrium, shape (g, n)."""
        return np.asarray(self.structure.gauge(self.state), dtype=float)

    @cached_property
    def factorization(self) -> Factorization:
        """The factored KKT matrix, with gauge rows."""
        kkt = self.evaluation.kkt
        assert kkt is not None
        return kkt.factorize(0.0, self.gauge, self.metric)

    def smallest_eigenvalue(self) -> float:
        """Return the smallest eigenvalue of the constrained second variation in the metric.

        See :func:`lissome.smallest_eigenvalue`.
        """
        from .stability import smallest_eigenvalue

        return float(smallest_eigenvalue(self).values[0])

    def mode(self) -> Array:
        """Return the mode of the smallest eigenvalue, shape (n,), of unit length in the metric."""
        from .stability import smallest_eigenvalue

        return smallest_eigenvalue(self).modes[0]

    @overload
    def reactions(self) -> Reactions: ...

    @overload
    def reactions(self, where: Any) -> Reaction: ...

    def reactions(self, where: Any = None) -> Reaction | Reactions:
        """Return what the supports exert on the structure.

        Parameters
        ----------
        where : str, int or other name of a support, optional
            Whose reaction is wanted; by default those of all supports are returned.

        Returns
        -------
        Reaction or Reactions
            Force, moment and position of one support, or a mapping from the names of the supports to
            these. It is empty if nothing supports the structure.

        Raises
        ------
        InvalidInput
            If there is no such support, or the structure does not tell what its supports exert.

        Examples
        --------
        >>> import lissome as ls
        >>> from lissome import rods
        >>> law = rods.Kirchhoff(bending=(1.0, 2.0), twisting=1.0)
        >>> rod = rods.Rod(law, [0.1] * 10).clamped("start").loaded(end=[0.5, 0, 0])
        >>> print(ls.equilibrate(rod).reactions("start").force.round(9) + 0.0)
        [-0.5  0.   0. ]
        """
        found = self._reactions
        return found if where is None else found[where]

    @cached_property
    def _reactions(self) -> Reactions:
        own = getattr(self.structure, "reactions", None)
        if own is None:
            raise InvalidInput(
                f"a structure of the type {type(self.structure).__name__} does not tell what its "
                "supports exert: give it a method `reactions(equilibrium)` that returns Reactions. "
                "The multipliers of its constraints are in `multipliers`"
            )
        found: Reactions = own(self)
        return found

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the state to the file `path` (.npz), for :func:`lissome.structure.load_state`."""
        save_state(path, self.state)

    def as_type(self, cls: type[E], **extra: Any) -> E:
        """Return the same equilibrium as an instance of a subclass, for ``structure.present``.

        Parameters
        ----------
        cls : type
            A subclass of Equilibrium.
        **extra
            The fields that it has besides.
        """
        values = {item.name: getattr(self, item.name) for item in fields(Equilibrium)}
        other = cls(**values, **extra)
        for name in ("evaluation", "metric", "gauge", "factorization"):
            if name in self.__dict__:
                other.__dict__[name] = self.__dict__[name]
        return other


def _finite(evaluation: Evaluation) -> bool:
    gradient = evaluation.gradient
    return (
        math.isfinite(evaluation.energy)
        and bool(np.isfinite(evaluation.constraints).all())
        and (gradient is None or bool(np.isfinite(gradient).all()))
    )


def relative_residual(gradient: Array, constraints: Array, terms: tuple[Array, Array]) -> float:
    """Return the largest residual relative to the terms summed in its component.

    Parameters
    ----------
    gradient, constraints : ndarray, shapes (n,) and (m,)
        What should vanish.
    terms : (ndarray (n,), ndarray (m,))
        Sizes of the terms that are summed in them (``KKTMatrix.magnitude``).
    """
    worst = 0.0
    for values, sizes in zip((gradient, constraints), terms, strict=True):
        if values.size:
            size = np.abs(values)
            total = np.maximum(sizes, EPS * sizes.max()) + size
            if not total.all():
                total = np.where(total > 0, total, 1.0)
            largest = float((size / total).max())
            if math.isnan(largest):
                return math.nan
            worst = max(worst, largest)
    return worst


def present(equilibrium: Equilibrium) -> Equilibrium:
    """Return the structure's own view of an equilibrium, if it has one."""
    own = getattr(equilibrium.structure, "present", None)
    return equilibrium if own is None else own(equilibrium)


def redundant_constraints(structure: Any, kkt: KKTMatrix, gauge: Array, metric: Array) -> list[int]:
    """Return the rows of Jacobian and gauge that depend linearly on earlier ones.

    Rows of multipliers with a compliance may: these forces yield, and are never redundant.
    """
    rows = np.vstack([kkt.jacobian_rows(), gauge]) / np.sqrt(metric)
    rigid = np.append(~yielding_multipliers(kkt), np.ones(len(gauge), dtype=bool))
    kept: list[Array] = []
    dependent = []
    for i, row in enumerate(rows):
        if not rigid[i]:
            continue
        size = float(np.linalg.norm(row))
        left = row.copy()
        for _ in range(2):
            for basis in kept:
                left -= (basis @ left) * basis
        if np.linalg.norm(left) <= 1e-10 * size or size == 0:
            dependent.append(i)
        else:
            kept.append(left / np.linalg.norm(left))
    return dependent


def _redundancy_message(structure: Any, kkt: KKTMatrix, gauge: Array, metric: Array) -> str | None:
    rows = redundant_constraints(structure, kkt, gauge, metric)
    if not rows:
        return None
    names = getattr(structure, "constraint_names", None)

    def name(i: int) -> str:
        if i >= kkt.m:
            return f"gauge row {i - kkt.m}"
        return f"constraint {i}" + (f" ({names[i]})" if names else "")

    listed = ", ".join(name(i) for i in rows[:6]) + (", ..." if len(rows) > 6 else "")
    return (
        f"the constraints are redundant: {listed} depends on those before (linearly dependent rows "
        "of the Jacobian); remove it, or move the supports apart from the configuration in which "
        "they lose their independence"
    )


class _Solver:
    """State of one solve. Steps are methods; nothing outlives the solve."""

    def __init__(
        self,
        structure: Structure,
        state: Any,
        multipliers: Array,
        tolerance: float,
        max_iterations: int,
        on_iteration: Callable[[Iteration], None] | None,
    ) -> None:
        self.structure = structure
        self.tolerance = tolerance
        self.max_iterations = max_iterations
        self.on_iteration = on_iteration
        self.history: list[Iteration] = []
        self.last_shift = 0.0
        self.damping = 0.0
        self.largest_force = np.zeros(structure.size)
        self.far = FAR
        self.penalty = np.zeros(structure.constraints_count)
        self.escapes = 0
        self.relaxed = False
        self.state = state
        self.multipliers = multipliers
        self.ready: Evaluation | None = None  # of second order, at the current point
        self.full = False  # whether the last step was a full one

    # ---- one point -------------------------------------------------------------------------------

    def evaluate(self, given: Corrected | None = None) -> None:
        """Evaluate everything at the current point and factor the matrix without shift.

        What a corrector has made there need not be made again.
        """
        structure = self.structure
        evaluation = given.evaluation if given is not None else self.ready
        if evaluation is None:
            evaluation = structure.evaluate(self.state, self.multipliers, 2)
        self.evaluation, self.ready = evaluation, None
        n, m = structure.size, structure.constraints_count
        if evaluation.gradient is None or evaluation.kkt is None:
            raise InvalidInput("`structure.evaluate` returned no gradient or KKT matrix at order 2")
        if evaluation.gradient.shape != (n,) or evaluation.constraints.shape != (m,):
            raise InvalidInput(
                f"`structure.evaluate` returned a gradient of shape {evaluation.gradient.shape} and "
                f"constraints of shape {evaluation.constraints.shape}; they must be ({n},) and ({m},)"
            )
        if not _finite(evaluation):
            raise InvalidInput(
                f"energy ({evaluation.energy}), gradient or constraints are not finite at the "
                "starting state; start inside the domain of the energy"
            )
        self.gradient: Array = evaluation.gradient
        self.constraints: Array = evaluation.constraints
        self.kkt: KKTMatrix = evaluation.kkt
        self.metric = np.asarray(structure.metric(self.state), dtype=float)
        self.gauge = np.asarray(structure.gauge(self.state), dtype=float).reshape(-1, n)
        typical = np.asarray(structure.typical(self.state), dtype=float)
        self.typical = typical if typical.shape == (n,) else np.full(n, float(typical))
        self.noise = float(structure.noise(self.state))
        self.terms = self.kkt.magnitude(self.typical, self.multipliers)
        self.force_terms, self.constraint_terms = self.terms
        self.residual = relative_residual(self.gradient, self.constraints, self.terms)
        sizes = self.force_terms + np.abs(self.gradient)
        np.maximum(self.largest_force, sizes, out=self.largest_force)
        self.plain: Factorization | None = given.factorization if given is not None else None
        if self.plain is None:
            try:
                self.plain = self.kkt.factorize(0.0, self.gauge, self.metric)
            except FactorizationError:
                self.plain = None

    def magnitude(self, dx: Array) -> float:
        """Return the size of an increment relative to the typical unknowns."""
        return float((np.abs(dx) / self.typical).max())

    @property
    def inertia(self) -> tuple[int, int, int]:
        """Inertia without shift; zeros stand for 'not known'."""
        return self.plain.inertia if self.plain is not None else (0, 0, 0)

    @property
    def yielding(self) -> bool:
        """Whether some multipliers are forces in parts that yield."""
        return bool(np.any(yielding_multipliers(self.kkt)))

    def record(self, correction: float, shift: float, step: float, kind: str) -> None:
        """Add a line to the history."""
        line = Iteration(
            len(self.history), float(self.evaluation.energy), self.residual, correction, shift, step,
            self.inertia, kind,
        )  # fmt: skip
        self.history.append(line)
        if self.on_iteration is not None:
            self.on_iteration(line)

    def fail(self, message: str) -> LissomeError:
        """Return the error for a solve that does not go on."""
        if self.relaxed:
            redundant = _redundancy_message(self.structure, self.kkt, self.gauge, self.metric)
            if redundant:
                return InvalidInput(redundant)
        return NotConverged(self.diagnosed(message), history=tuple(self.history), state=self.state)

    def diagnosed(self, message: str) -> str:
        """Return the message with what the structure says of the state, if it says anything."""
        diagnose = getattr(self.structure, "diagnose", None)
        found = None if diagnose is None else diagnose(self.state)
        return f"{found} ({message})" if found else message

    # ---- directions ------------------------------------------------------------------------------

    def regular(self, least: float = 0.0) -> tuple[Factorization, float]:
        """Return factors with the inertia of a minimum, with a shift that is as small as can be."""
        if least == 0.0 and self.plain is not None and self.plain.is_minimum:
            self.last_shift *= 0.25
            return self.plain, 0.0
        unit = np.ones(self.structure.size)
        stiffness = self.kkt.magnitude(unit, np.zeros(self.structure.constraints_count))[0]
        scale = float(np.median(stiffness / self.metric))
        scale = scale if scale > 0 else 1.0
        floor = float(getattr(self.structure, "smallest_shift", 1e-6))
        first = max(least, self.last_shift * 0.25, floor * scale)
        if self.plain is not None and self.plain.is_minimum:
            first = least  # asked for in order to shorten the step

        def attempt(shift: float, relaxation: float) -> Factorization | None:
            # The relaxation is measured by what the shifted Hessian makes of the constraints.
            r = relaxation * float(np.max(self.constraint_terms, initial=0.0)) ** 2
            r /= shift * float(np.min(self.metric * self.typical**2))
            try:
                factor = self.kkt.factorize(shift, self.gauge, self.metric, r)
            except FactorizationError:
                return None
            return factor if factor.is_minimum else None

        for relaxation in (0.0, 1e-8):
            trial = first
            while trial <= 1e9 * scale:
                factor = attempt(trial, relaxation)
                if factor is not None:
                    if trial > first:  # a smaller shift gives longer steps
                        middle = trial / math.sqrt(8.0)
                        better = attempt(middle, relaxation)
                        if better is not None:
                            factor, trial = better, middle
                    self.last_shift = trial
                    self.relaxed = relaxation > 0
                    return factor, trial
                trial *= 8.0
        message = _redundancy_message(self.structure, self.kkt, self.gauge, self.metric)
        if message:
            raise InvalidInput(message)
        raise self.fail(
            "the KKT matrix could not be made regular by any shift of the Hessian (residual "
            f"{self.residual:.3g}): the search is lost where the constraints leave hardly any motion; "
            "start nearer, or go there in small steps (`follow`), on a finer mesh if need be"
        )

    def curvature(self, shift: float, dx: Array) -> float:
        """Return the stiffness along an increment, in units of the metric."""
        mass = float(dx @ (self.metric * dx))
        bend = float(dx @ self.kkt.apply(dx, np.zeros(self.structure.constraints_count))[0])
        return abs(bend + shift * mass) / mass if mass > 0 else 0.0

    def shorten(
        self, factor: Factorization, shift: float, dx: Array, dmult: Array
    ) -> tuple[Factorization, float, Array, Array]:
        """Raise the shift until the increment is not far beyond the typical unknowns."""
        size = self.magnitude(dx)
        while size > self.far:
            least = max(10.0 * shift, self.curvature(shift, dx))
            if not least > shift:
                break
            factor, shift = self.regular(least)
            dx, dmult = factor.solve(-self.gradient, -self.constraints)
            previous, size = size, self.magnitude(dx)
            if size > 0.7 * previous:  # the constraints ask for it
                break
        return factor, shift, dx, dmult

    # ---- line search -----------------------------------------------------------------------------

    def merit(self, evaluation: Evaluation) -> float:
        """Return the exact penalty function."""
        return evaluation.energy + float(self.penalty @ np.abs(evaluation.constraints))

    def newton(self, factor: Factorization, shift: float, dx: Array, dmult: Array) -> float:
        """Take a step along the Newton direction; return the fraction taken, 0 if none."""
        structure = self.structure
        c = self.constraints
        bent, moved = self.kkt.apply(dx, np.zeros_like(dmult))
        energy_slope = float(self.gradient @ dx - self.multipliers @ moved)
        target = np.abs(self.multipliers + dmult)
        c1 = float(np.sum(np.abs(c)))
        self.penalty = np.maximum(target, 0.5 * (self.penalty + target))
        slope = energy_slope - float(self.penalty @ np.abs(c))
        mass = float(dx @ (self.metric * dx))
        quadratic = float(dx @ bent) + shift * mass
        wanted = -0.5 * abs(quadratic)
        if slope > wanted and c1 > 0:  # not downhill yet: weigh the constraints more
            self.penalty = self.penalty + 2.0 * (slope - wanted) / c1
            slope = energy_slope - float(self.penalty @ np.abs(c))
        merit = self.merit(self.evaluation)
        slack = 16 * EPS * (abs(self.evaluation.energy) + float(self.penalty @ np.abs(c)))
        size, far = math.sqrt(mass), self.magnitude(dx)

        def accept(state: Any, mult: Array, trial: Evaluation, step: float, kind: str) -> float:
            self.record(far, shift, step, kind)
            self.state, self.multipliers = state, mult
            self.ready = trial if trial.kkt is not None else None
            self.full = step == 1.0
            return step

        largest = float(structure.max_step(self.state, dx))
        if not 0 < largest <= 1:
            raise InvalidInput(f"`structure.max_step` returned {largest}; it must lie in (0, 1]")
        if far <= 1e-14:  # the state is right, and its multipliers may not be
            mult = self.multipliers + dmult
            trial = structure.evaluate(self.state, mult, 2)
            if _finite(trial):
                assert trial.gradient is not None
                left = relative_residual(trial.gradient, trial.constraints, self.terms)
                if left < min(0.5 * self.residual, 1e3 * self.noise):
                    return accept(self.state, mult, trial, 1.0, "newton")
        step = largest
        while step * far > 1e-14 and step > 1e-12:
            state = structure.retract(self.state, step * dx)
            mult = self.multipliers + step * dmult
            kind, previous = "newton", math.inf
            for attempt in range(5):
                # A full step after a full step will be accepted: it takes its matrix along.
                first = attempt == 0 and step == 1.0
                trial = structure.evaluate(state, mult, 2 if first and self.full else 1)
                if not _finite(trial):
                    break
                assert trial.gradient is not None
                if self.merit(trial) <= merit + 1e-4 * step * slope + slack:
                    return accept(state, mult, trial, step, kind)
                if attempt == 4:
                    break
                if first:
                    # Natural test: the next correction, with the same factors, is much shorter.
                    d2, _ = factor.solve(-trial.gradient, -trial.constraints)
                    if float(np.sqrt(d2 @ (self.metric * d2))) <= 0.25 * size:
                        return accept(state, mult, trial, step, kind)
                if not c1 and not np.any(trial.constraints):
                    break
                aim = (1.0 - step) * c
                excess = float(self.penalty @ np.abs(trial.constraints - aim))
                if not excess < 0.9 * previous:
                    break
                previous = excess
                d2, _ = factor.solve(np.zeros_like(dx), aim - trial.constraints)
                if self.magnitude(d2) > step * far:
                    break
                d2 = d2 * float(structure.max_step(state, d2))
                state = structure.retract(state, d2)
                kind = "corrected"
            step *= 0.5 if step > 0.2 else 0.25
        self.full = False
        return 0.0

    def leave_saddle(self) -> bool:
        """Step along the direction of most negative curvature, downhill."""
        structure = self.structure
        factor, shift = self.regular(self.last_shift * 4)
        try:
            curvature, mode = lowest_mode(self.kkt, factor, self.metric)
        except FactorizationError:
            return False
        if not curvature < 0:
            return False
        # A constraint that holds to rounding must not hide the small fall of the energy.
        self.penalty = np.maximum(self.penalty, 2 * np.abs(self.multipliers))
        merit = self.merit(self.evaluation)
        slack = 16 * EPS * abs(self.evaluation.energy)
        unit = mode / self.magnitude(mode)
        length2 = float(unit @ (self.metric * unit))

        def reach(distance: float) -> tuple[float, Any] | None:
            dx = distance * unit
            if structure.max_step(self.state, dx) < 1.0:
                return None
            state = structure.retract(self.state, dx)
            trial = structure.evaluate(state, self.multipliers, 0)
            for _ in range(6):
                if not _finite(trial):
                    return None
                if not np.any(np.abs(trial.constraints) > self.noise * self.constraint_terms):
                    break
                back, _ = factor.solve(np.zeros_like(dx), -trial.constraints)
                if self.magnitude(back) > abs(distance):
                    return None
                state = structure.retract(state, back * float(structure.max_step(state, back)))
                trial = structure.evaluate(state, self.multipliers, 0)
            fall = self.merit(trial) - merit if _finite(trial) else math.inf
            if fall < 0.1 * curvature * length2 * distance**2 - slack:
                return fall, state
            return None

        # Downhill first; the sign of a slope that is hidden by rounding must not decide.
        slope = float(self.gradient @ unit)
        hidden = self.noise * float(np.abs(unit) @ self.force_terms)
        first = -1.0 if slope > hidden else 1.0
        distance = 0.1
        while distance > 1e-7:
            for sign in (first, -first):
                found = reach(sign * distance)
                if found is None:
                    continue
                while abs(distance) < 10:  # go on while it falls
                    further = reach(2 * sign * distance)
                    if further is None or further[0] >= found[0]:
                        break
                    found, distance = further, 2 * distance
                self.record(self.magnitude(mode), shift, sign * distance, "curvature")
                self.state = found[1]
                return True
            distance *= 0.25
        return False

    # ---- the loops -------------------------------------------------------------------------------

    def check_resolved(self) -> None:
        """Raise if rounding hides the sign of the eigenvalue that is nearest to zero."""
        details = {"state": self.state, "history": tuple(self.history)}
        if self.plain is None or self.plain.inertia[2]:
            redundant = _redundancy_message(self.structure, self.kkt, self.gauge, self.metric)
            if redundant:
                raise InvalidInput(redundant)
            raise StabilityNotResolvable(
                self.diagnosed(
                    "the KKT matrix is singular to working precision at the stationary point: it is "
                    "critical (a fold or a bifurcation), or a neutral motion is not listed in `gauge`"
                ),
                **details,
            )
        value, mode, mult = softest_mode(self.kkt, self.plain, self.metric)
        if math.isinf(value):
            return
        sizes, _ = self.kkt.magnitude(mode, mult)
        floor = self.noise * float(np.abs(mode) @ sizes)
        floor += self.drift(value, mode, mult, value - floor)
        if not value > floor:
            raise StabilityNotResolvable(
                self.diagnosed(
                    f"the eigenvalue nearest to zero is {value:.3g}, which does not exceed the "
                    f"round-off floor {floor:.3g}: stability cannot be resolved at this point; move "
                    "the parameter away from the critical value, or use a coarser mesh"
                ),
                **details,
            )

    def drift(self, value: float, mode: Array, mult: Array, room: float) -> float:
        """Return how much the eigenvalue moves within the rounding error of the state.

        Rounding of the forces moves the state along the soft mode by (error of force) / value. At a
        fold the eigenvalue is linear in this motion, and vanishes like the root of the error. One
        side is looked at if what it tells is negligible against `room`, both sides otherwise.
        """
        length = 1.0 / self.magnitude(mode)
        force = self.noise * float(np.linalg.norm(mode * self.largest_force))
        if force / value < 1e-12 * length and mode.size > 10:
            return 0.0
        reach = 1e-3 * length
        bent, moved = self.kkt.apply(mode, mult)
        here = float(mode @ bent + mult @ moved)
        slope = result = 0.0
        for step in (reach, -reach):
            step *= float(self.structure.max_step(self.state, step * mode))
            state = self.structure.retract(self.state, step * mode)
            there = self.structure.evaluate(state, self.multipliers + step * mult, 2).kkt
            assert there is not None
            bent, moved = there.apply(mode, mult)
            change = float(mode @ bent + mult @ moved) - here
            if not math.isfinite(change):
                continue
            slope = max(slope, abs(change) / abs(step))
            result = 2.0 * slope * max(force, self.noise * slope * length**2) / value
            if 1e4 * result < room and slope > 0:
                break
        return result

    def finish(self, dx: Array | None, dmult: Array | None, correction: float) -> Equilibrium:
        """Return the result, after a last Newton step if that improves the balance."""
        self.check_resolved()
        assert self.plain is not None
        self.record(correction, 0.0, 0.0, "accepted")
        state, mult, energy, residual = (
            self.state, self.multipliers, self.evaluation.energy, self.residual,
        )  # fmt: skip
        polished = False
        if (
            dx is not None
            and dmult is not None
            and correction > 0
            and not (self.residual <= self.noise and correction <= 1e-3 * self.tolerance)
            and self.structure.max_step(self.state, dx) == 1.0
        ):
            new_state = self.structure.retract(self.state, dx)
            new = self.structure.evaluate(new_state, mult + dmult, 1)
            if _finite(new):
                assert new.gradient is not None
                new_residual = relative_residual(new.gradient, new.constraints, self.terms)
                if new_residual > 100 * self.noise:
                    # At a regular root corrections shrink quadratically; at a double one by 1/2.
                    after, _ = self.plain.solve(-new.gradient, -new.constraints)
                    ratio = self.magnitude(after) / correction
                    if ratio > 0.2:
                        raise StabilityNotResolvable(
                            "Newton's corrections shrink only linearly (the next is "
                            f"{ratio:.2g} of the last): the stationary point is critical to within "
                            "the tolerance, and its stability cannot be told; move the parameter "
                            "away from the critical value",
                            state=self.state,
                            history=tuple(self.history),
                        )
                if new_residual < residual:
                    state, mult, energy, residual = (
                        new_state, mult + dmult, new.energy, new_residual,
                    )  # fmt: skip
                    polished = True
        mult = np.array(mult)
        mult.flags.writeable = False
        result = Equilibrium(
            structure=self.structure,
            state=state,
            multipliers=mult,
            energy=float(energy),
            residual=residual,
            inertia=self.plain.inertia,
            iterations=len(self.history) - 1,
            stable=self.plain.is_minimum,
            history=tuple(self.history),
        )
        if not polished:
            result.__dict__["evaluation"] = self.evaluation
            result.__dict__["factorization"] = self.plain
        return present(result)

    def correction_at_hand(self) -> tuple[Array | None, Array | None, float]:
        """Return the plain Newton correction, and its size."""
        if self.plain is None or self.plain.inertia[2]:
            return None, None, math.inf
        try:
            dx, dmult = self.plain.solve(-self.gradient, -self.constraints)
        except FactorizationError:
            return None, None, math.inf
        return dx, dmult, self.magnitude(dx)

    def settled(self, dmult: Array | None) -> bool:
        """Return whether a correction of the multipliers changes no force by much."""
        if dmult is None or not dmult.size:
            return True
        zero = np.zeros_like(self.gradient)
        change = self.kkt.magnitude(zero, dmult)[0]
        size = self.kkt.magnitude(zero, self.multipliers + dmult)[0]
        return bool(
            change.max() <= 1e-6 * size.max()
            or np.all(change <= 1e3 * self.noise * self.force_terms)
        )

    def corrected(self, require: str) -> Equilibrium | None:
        """Return what the structure's own Newton iteration finds, if it has one and it will do."""
        correct = getattr(self.structure, "correct", None)
        state, multipliers = self.state, self.multipliers
        fast = None if correct is None else correct(state, multipliers, self.tolerance)
        if fast is None:
            return None
        self.state, self.multipliers = fast.state, np.asarray(fast.multipliers, dtype=float)
        self.evaluate(fast)
        if require == "any" or (self.plain is not None and self.plain.is_minimum):
            dx, dmult, correction = self.correction_at_hand()
            if self.residual <= self.noise or (
                correction <= self.tolerance and self.settled(dmult)
            ):
                self.record(correction, 0.0, 1.0, "fast")
                return self.finish(dx, dmult, correction)
        self.state, self.multipliers = state, multipliers
        return None

    def descended(self, known: bool) -> Equilibrium | None:
        """Return the minimum below, of a structure that has a way of its own to find one.

        `known`: whether the multipliers are near those of the state.
        """
        descended = getattr(self.structure, "descended", None)
        if descended is None:
            return None
        origin = self.state, self.multipliers
        for guess in (self.multipliers, None) if known else (None,):
            lower = descended(origin[0], guess)
            if lower is None:
                continue
            self.state, self.multipliers = lower
            found = self.corrected("stable")
            if found is not None:
                return found
            self.state, self.multipliers = origin
        return None

    def stable(self) -> Equilibrium:
        """Descend to a minimum."""
        previous = math.inf
        origin = self.state
        step, stuck = 1.0, 0
        for _ in range(self.max_iterations):
            self.evaluate()
            if self.magnitude(self.structure.difference(origin, self.state)) > 1e8:
                raise self.fail(
                    "the unknowns have grown by more than 1e8 times their typical size: the energy "
                    "has no minimum on this side (a load beyond the limit), or the typical size is "
                    "wrong"
                )
            dx, dmult, correction = self.correction_at_hand()
            at_floor = self.residual <= self.noise
            # Short steps all but at rounding errors: the energy is too flat to tell states apart.
            near = self.residual <= 1e3 * self.noise and correction <= 1e3 * self.tolerance
            stuck = stuck + 1 if near and step < 0.1 else 0
            stalled = stuck >= 3 or (at_floor and not correction < 0.5 * previous)
            previous = correction
            if stalled or (correction <= self.tolerance and self.settled(dmult)):
                if self.plain is not None and self.plain.is_minimum:
                    return self.finish(dx, dmult, correction)
                self.check_resolved()
                self.escapes += 1
                if self.yielding or self.escapes > 30 or not self.leave_saddle():
                    self.record(correction, 0.0, 0.0, "accepted")
                    raise Unstable(
                        f"the solve ended at a saddle with inertia {self.inertia} and could not "
                        "leave it; start from another state, or pass require='any' to accept it",
                        state=self.state,
                        history=tuple(self.history),
                    )
                previous = math.inf
                continue
            if self.yielding:
                # The Lagrangian is to be maximized by these forces: no merit function leads down.
                raise self.fail(
                    "no stable state was found from this start, neither near nor below, where moments "
                    f"are unknowns (residual {self.residual:.3g}): start nearer, or go there in small "
                    "steps (`follow`); a ribbon with the scheme 'cells' may find a state from afar, "
                    "from which this one can start (`adapted`)"
                )
            least = self.damping
            for attempt in range(8):
                factor, shift = self.regular(least)
                if factor is not self.plain or dx is None or dmult is None:
                    sx, sm = factor.solve(-self.gradient, -self.constraints)
                else:
                    sx, sm = dx, dmult
                factor, shift, sx, sm = self.shorten(factor, shift, sx, sm)
                if (
                    attempt == 0
                    and self.plain is not None
                    and self.plain.index > 0
                    and self.magnitude(sx) < 1e-2
                    and self.escapes < 30
                ):  # near a saddle: do not converge to it first
                    self.escapes += 1
                    if self.leave_saddle():
                        break
                step = self.newton(factor, shift, sx, sm)
                if step > 0:
                    # A short step tells that the model is poor at the distance of the correction.
                    bend = self.curvature(shift, sx)
                    if step < 0.1:
                        self.damping = max(10 * shift, bend)
                    else:
                        self.damping = 0.1 * shift if shift > 0.1 * bend else 0.0
                    if step == 1.0 and self.magnitude(sx) > 0.1 * self.far:
                        self.far *= 2.0
                    break
                least = max(10 * shift, 4 * self.last_shift, self.curvature(shift, sx))
            else:
                if self.residual <= 1e3 * self.noise and self.plain and self.plain.is_minimum:
                    return self.finish(dx, dmult, correction)
                raise self.fail(
                    f"no step lowers the merit function at iteration {len(self.history)} (residual "
                    f"{self.residual:.3g}); start nearer, or go there in small steps (`follow`); of a "
                    "structure of your own, check the gradient against finite differences of the energy"
                )
        raise self.fail(
            f"no equilibrium after {self.max_iterations} iterations (residual {self.residual:.3g}); "
            "start nearer, load in smaller steps (`follow`), or raise `max_iterations`"
        )

    def any(self) -> Equilibrium:
        """Go to a stationary point of any index: Newton damped by the natural monotonicity test."""
        previous = math.inf
        for _ in range(self.max_iterations):
            self.evaluate()
            dx, dmult, correction = self.correction_at_hand()
            at_floor = self.residual <= self.noise
            if (correction <= self.tolerance and self.settled(dmult)) or (
                at_floor and not correction < 0.5 * previous
            ):
                return self.finish(dx, dmult, correction)
            previous = correction
            if self.plain is None or dx is None or dmult is None:
                raise self.fail(
                    f"the KKT matrix is singular at iteration {len(self.history)}; start elsewhere"
                )
            size = float(np.sqrt(dx @ (self.metric * dx)))
            step = float(self.structure.max_step(self.state, dx))
            while step > 1e-10:
                state = self.structure.retract(self.state, step * dx)
                mult = self.multipliers + step * dmult
                trial = self.structure.evaluate(state, mult, 1)
                if _finite(trial):
                    assert trial.gradient is not None
                    d2, _ = self.plain.solve(-trial.gradient, -trial.constraints)
                    left = relative_residual(trial.gradient, trial.constraints, self.terms)
                    near = left <= self.noise
                    if near or np.sqrt(d2 @ (self.metric * d2)) <= (1 - 0.25 * step) * size:
                        break
                step *= 0.5
            else:
                if self.residual <= 1e3 * self.noise:
                    return self.finish(dx, dmult, correction)
                raise self.fail(
                    f"damped Newton iteration stopped at residual {self.residual:.3g}; start nearer"
                )
            self.record(correction, 0.0, step, "newton")
            self.state, self.multipliers = state, mult
        raise self.fail(
            f"no equilibrium after {self.max_iterations} iterations (residual {self.residual:.3g})"
        )


def _estimate_multipliers(structure: Structure, state: Any) -> Array:
    """Return the multipliers that balance the forces best, in the metric."""
    m = structure.constraints_count
    zero = np.zeros(m)
    if m == 0:
        return zero
    evaluation = structure.evaluate(state, zero, 2)
    if not _finite(evaluation) or evaluation.kkt is None or evaluation.gradient is None:
        return zero  # the first iteration reports it
    metric = np.asarray(structure.metric(state), dtype=float)
    stiffness = evaluation.kkt.magnitude(np.ones(structure.size), zero)[0] / metric
    largest = float(np.max(stiffness))
    shift = 1e5 * largest if largest > 0 else 1.0
    try:
        factor = evaluation.kkt.factorize(shift, None, metric)
        return factor.solve(-evaluation.gradient)[1]
    except FactorizationError:
        return zero


@one_call
def equilibrate(
    structure: Structure,
    start: Any = None,
    multipliers: ArrayLike | None = None,
    *,
    require: Literal["stable", "any"] = "stable",
    tolerance: float | None = None,
    max_iterations: int = 200,
    on_iteration: Callable[[Iteration], None] | None = None,
) -> Equilibrium:
    """Find an equilibrium: a stationary point of the energy under the constraints.

    Parameters
    ----------
    structure : Structure
        What to solve.
    start : state or Equilibrium, optional
        Where to start; ``structure.start()`` by default. Prescribed values of `structure` are
        imposed on it (``structure.adopt``).
    multipliers : array_like, shape (m,), optional
        First guess of the multipliers; by default those of the Equilibrium to start from, or those
        that balance the forces best.
    require : {"stable", "any"}
        "stable" (default) descends to a minimum, leaving saddles on its way. "any" goes to a
        stationary point near the start, whatever its index; see ``Equilibrium.stable``.
    tolerance : float, optional
        Size of the last Newton correction relative to the typical unknowns, 1e-9 by default. The
        correction is still applied, so that the error is of the order of its square. Where rounding
        errors of the residual ask for larger corrections (a structure that hardly resists some motion)
        it cannot be had: the solve ends when they are all that is left, or, if only short steps lower
        the energy, within a thousand times of it. The last entry of `history` tells the correction.
    max_iterations : int
        Limit of Newton iterations.
    on_iteration : callable, optional
        Called with every :class:`Iteration`.

    Returns
    -------
    Equilibrium
        Or the structure's own subclass of it.

    Raises
    ------
    InvalidInput
        If the start is outside the domain of the energy, or constraints are redundant.
    NotConverged
        If no stationary point was found; carries `history` and the last `state`.
    Unstable
        If the iteration ended at a saddle that it could not leave.
    StabilityNotResolvable
        If rounding hides the sign of an eigenvalue: at a fold or a bifurcation.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> saddle = ls.DenseStructure(
    ...     initial=[0.0, 0.5],
    ...     energy=lambda x: (x[0] ** 2 - 1) ** 2 / 4 + x[1] ** 2 / 2,
    ...     gradient=lambda x: np.array([x[0] ** 3 - x[0], x[1]]),
    ...     hessian=lambda x: np.diag([3 * x[0] ** 2 - 1, 1.0]),
    ... )
    >>> float(abs(ls.equilibrate(saddle).state.x[0]))
    1.0
    >>> ls.equilibrate(saddle, require="any").index
    1
    """
    structure = structure_like("structure", structure)
    one_of("require", require, ("stable", "any"))
    tol = DEFAULT_TOLERANCE if tolerance is None else finite("tolerance", tolerance)
    if not 0 < tol < 1:
        raise InvalidInput(f"argument `tolerance` is {tolerance}; it must lie in (0, 1)")
    max_iterations = integer_at_least("max_iterations", max_iterations, 1)
    m = structure.constraints_count
    if isinstance(start, Equilibrium):
        if multipliers is None and start.multipliers.shape == (m,):
            multipliers = start.multipliers
        start = start.state
    state = structure.start() if start is None else structure.adopt(start)
    if isinstance(state, PLAIN) and not isinstance(state, type(structure.start())):
        raise InvalidInput(
            f"argument `start` is of type {type(start).__name__}; pass a state, such as "
            "`structure.start()`, or an Equilibrium"
        )
    if multipliers is None:
        guess = _estimate_multipliers(structure, state)
    else:
        guess = finite_array("multipliers", multipliers, shape=(m,))
    solver = _Solver(structure, state, guess, tol, max_iterations, on_iteration)
    corrected = solver.corrected(require)
    if corrected is None and require == "stable":
        corrected = solver.descended(multipliers is not None)
    if corrected is not None:
        return _told(corrected)
    return _told(solver.stable() if require == "stable" else solver.any())


def _told(result: Equilibrium) -> Equilibrium:
    """Let the structure warn of what is wrong with an equilibrium, and return it."""
    warn = getattr(result.structure, "warn", None)
    if warn is not None:
        warn(result, user_level() + 1)
    return result
