"""Newton corrections close to a known equilibrium, and the linear algebra of a branch.

The correctors here do not look for a minimum: they go to the equilibrium that is next to a good
guess, whatever its stability, and give up as soon as Newton's corrections do not contract. That is
what following a branch or a slow evolution asks for. :func:`lissome.equilibrate` finds minima from
afar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .equilibrium import Equilibrium, Iteration, present, relative_residual
from .errors import FactorizationError, InvalidInput, LissomeError
from .factorization import Factorization, KKTMatrix
from .sensitivities import residual_slope
from .structure import Evaluation

Array = NDArray[np.float64]
Family = Callable[[float], Any]
#: Function of parameter, state and multipliers: derivatives of gradient and constraints.
Slope = Callable[[float, Any, Array], tuple[ArrayLike, ArrayLike]]
EPS = float(np.finfo(float).eps)

#: Corrections (relative to the typical size of the unknowns) at which an iterate is accepted. The
#: last one is applied, so that the error is of the order of its square.
TOLERANCE = 1e-8
#: Corrections up to which a state that is said to be an equilibrium is one.
LARGEST_CONFIRMED = 1e-4
#: The correction that would follow, over the tolerance, where the last one is foretold; and the relative
#: residual that it must leave.
_NEXT = 1e-5
#: Largest ratio of successive corrections.
CONTRACTION = 0.5


class CorrectionFailed(LissomeError):
    """Newton's corrections do not contract from this guess: the step is too long."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """An equilibrium of any index, with the factors of its KKT matrix.

    Attributes
    ----------
    structure, state, multipliers
        The equilibrium.
    evaluation : Evaluation
        There; its matrix is that of the last iterate, before a correction too small to matter to it.
    residual : float
        Largest unbalanced force or constraint relative to the terms summed in it.
    history : tuple of Iteration
        The corrections.
    factorization : Factorization
        Of the KKT matrix at the equilibrium, with gauge rows and without shift.
    """

    structure: Any
    state: Any
    multipliers: Array
    evaluation: Evaluation = field(repr=False)
    residual: float
    factorization: Factorization = field(repr=False)
    history: tuple[Iteration, ...] = field(repr=False)

    @property
    def energy(self) -> float:
        """Potential energy."""
        return self.evaluation.energy

    @property
    def iterations(self) -> int:
        """Number of corrections."""
        return len(self.history) - 1

    @property
    def correction(self) -> float:
        """Relative size of the last correction that Newton's method asked for."""
        return self.history[-1].correction

    @property
    def index(self) -> int:
        """Number of unstable directions."""
        return self.factorization.index

    @property
    def marginal(self) -> bool:
        """Whether rounding errors hide the sign of a pivot."""
        return self.factorization.inertia[2] > 0

    @property
    def stable(self) -> bool:
        """Whether the inertia is that of a strict minimum."""
        return self.factorization.is_minimum


def typical_size(structure: Any, state: Any) -> Array:
    """Return the typical size of each unknown."""
    size = np.asarray(structure.typical(state), dtype=float)
    return size if size.ndim else np.full(structure.size, float(size))


def gauge_of(structure: Any, state: Any) -> Array | None:
    """Return the generators of neutral motions, or None if there are none."""
    rows = np.asarray(structure.gauge(state), dtype=float)
    return rows if rows.shape[0] else None


def _evaluate(structure: Any, state: Any, multipliers: Array) -> tuple[Any, Factorization]:
    evaluation = structure.evaluate(state, multipliers, 2)
    finite = np.isfinite(evaluation.energy) and np.all(np.isfinite(evaluation.gradient))
    if not finite or not np.all(np.isfinite(evaluation.constraints)):
        raise CorrectionFailed("the energy or its gradient is not finite")
    try:
        factors = evaluation.kkt.factorize(gauge=gauge_of(structure, state))
    except FactorizationError as error:
        raise CorrectionFailed(str(error)) from error
    return evaluation, factors


def correct(
    structure: Any,
    state: Any,
    multipliers: Array,
    *,
    tolerance: float = TOLERANCE,
    foretold: float = 0.0,
    polish: bool = False,
    stable: bool = False,
    max_iterations: int = 12,
) -> Balanced:
    """Correct a guess at a fixed parameter.

    A correction that is larger than `tolerance`, but not than `foretold`, is the last one if those before
    it tell that the next would be far smaller than the tolerance, and the residual after it agrees.
    With `polish`, corrections go on until rounding errors are all that is left. With `stable`, every
    iterate must have the inertia of a minimum: whoever passes an unstable state leaves the branch.

    Raises
    ------
    CorrectionFailed
        If the corrections do not contract, leave the domain, or meet a singular matrix.
    """

    def newton(evaluation: Any, factors: Factorization, *place: Any) -> tuple[Array, Array, float]:
        if stable and not factors.is_minimum:
            raise CorrectionFailed("an iterate is not stable")
        dx, dm = factors.solve(-evaluation.gradient, -evaluation.constraints, refine=polish)
        return dx, dm, 0.0

    balanced, _ = _iterate(lambda p: structure, 0.0, state, multipliers, newton, tolerance,
                           foretold, polish, max_iterations, 1.0)  # fmt: skip
    return balanced


def confirm(structure: Any, state: Any, multipliers: Array) -> Balanced:
    """Return a state as it is, but for a small correction, if it is an equilibrium.

    Raises
    ------
    CorrectionFailed
        If it is not.
    """
    balanced = correct(structure, state, multipliers)
    asked = balanced.history[0].correction
    if asked > LARGEST_CONFIRMED:
        raise CorrectionFailed(f"Newton's method asks for a correction of {asked:.2g}")
    return balanced


def correct_on_plane(
    family: Family,
    parameter: float,
    state: Any,
    multipliers: Array,
    row: tuple[Array, float],
    slope: tuple[Array, Array] | None,
    scale: float,
    *,
    tolerance: float = TOLERANCE,
    foretold: float = 0.0,
    polish: bool = False,
    contraction: float = CONTRACTION,
    max_iterations: int = 12,
) -> tuple[Balanced, float]:
    """Correct a guess in state and parameter, orthogonally to a direction.

    Parameters
    ----------
    family : callable
        Parameter to structure.
    row : (ndarray (n,), float)
        Covector of the direction: every correction satisfies ``row[0] @ dx + row[1] * dp == 0``.
    slope : (ndarray (n,), ndarray (m,))
        Derivatives of gradient and constraints with respect to the parameter. A good approximation
        will do: it does not change the solution. If None, a difference at the guess.
    scale : float
        Typical size of the parameter.
    foretold : float
        As in :func:`correct`.
    contraction : float
        Largest ratio of successive corrections.

    Returns
    -------
    balanced : Balanced
    parameter : float
    """

    def newton(
        evaluation: Any, factors: Factorization, parameter: float, state: Any, multipliers: Array
    ) -> tuple[Array, Array, float]:
        nonlocal slope
        if slope is None:
            slope = slope_beside(family, evaluation, parameter, state, multipliers, scale)
        # Bordering: two solves with the same factors, and a scalar equation for the parameter.
        rhs_x = np.stack([-evaluation.gradient, -slope[0]], axis=1)
        rhs_c = np.stack([-evaluation.constraints, -slope[1]], axis=1)
        dx, dm = factors.solve(rhs_x, rhs_c, refine=polish)
        denominator = row[0] @ dx[:, 1] + row[1]
        if denominator == 0.0 or not np.isfinite(denominator):
            raise CorrectionFailed("the plane of corrections contains the branch")
        dp = -(row[0] @ dx[:, 0]) / denominator
        return dx[:, 0] + dp * dx[:, 1], dm[:, 0] + dp * dm[:, 1], float(dp)

    return _iterate(
        family, parameter, state, multipliers, newton, tolerance, foretold, polish, max_iterations,
        scale, contraction,
    )  # fmt: skip


def slope_beside(
    family: Family, here: Evaluation, parameter: float, state: Any, multipliers: Array, scale: float
) -> tuple[Array, Array]:
    """Return the derivatives of gradient and constraints with respect to the parameter.

    By one evaluation beside the one that is known; where the family ends there, by two. The step is
    so long that rounding errors of stiff terms do not matter.
    """
    place = parameter + EPS ** (1.0 / 3.0) * max(scale, 1e-3 * abs(parameter))
    try:
        structure = family(place)
    except InvalidInput:
        return residual_slope(family, parameter, state, multipliers, scale)
    beside = structure.evaluate(structure.adopt(state), multipliers, 1)
    step = place - parameter
    return (
        (beside.gradient - here.gradient) / step,
        (beside.constraints - here.constraints) / step,
    )


def member(family: Family, parameter: float) -> Any:
    """Return the structure of a parameter that a step has come to, if the family has one there."""
    try:
        return family(parameter)
    except InvalidInput as error:
        raise _nothing_at(parameter, error) from error


def adopted(family: Family, parameter: float, state: Any) -> tuple[Any, Any]:
    """Return that structure, and `state` as one of its states.

    Some structures find out only then that they cannot be.
    """
    structure = member(family, parameter)
    try:
        return structure, structure.adopt(state)
    except InvalidInput as error:
        raise _nothing_at(parameter, error) from error


def _nothing_at(parameter: float, error: InvalidInput) -> CorrectionFailed:
    return CorrectionFailed(f"the family has no structure at {parameter:.8g}: {error}")


def _iterate(
    family: Family,
    parameter: float,
    state: Any,
    multipliers: Array,
    newton: Callable[..., tuple[Array, Array, float]],
    tolerance: float,
    foretold: float,
    polish: bool,
    max_iterations: int,
    scale: float,
    contraction: float = CONTRACTION,
) -> tuple[Balanced, float]:
    structure, state = adopted(family, parameter, state)
    size = typical_size(structure, state)
    noise = float(structure.noise(state))
    history: list[Iteration] = []
    previous = np.inf
    balanced_before: tuple[Balanced, float] | None = None
    last: tuple[Any, Any, Array, float, Evaluation, float] | None
    for number in range(max_iterations + 1):
        evaluation, factors = _evaluate(structure, state, multipliers)
        terms = evaluation.kkt.magnitude(size, multipliers)
        residual = relative_residual(evaluation.gradient, evaluation.constraints, terms)
        contracts = True
        last = None
        if factors.inertia[2]:
            if residual > noise:
                raise CorrectionFailed("the KKT matrix is singular to working precision")
            correction = 0.0  # balanced to rounding; Newton's correction has no meaning here
            done = True
        else:
            dx, dm, dp = newton(evaluation, factors, parameter, state, multipliers)
            correction = max(float(np.max(np.abs(dx) / size)), abs(dp) / scale)
            if not np.isfinite(correction):
                raise CorrectionFailed("a correction is not finite")
            contracts = correction <= contraction * previous
            # Where corrections cease to contract, rounding errors must be all that is left.
            floor = residual <= noise
            done = (floor and not contracts) or (
                correction <= tolerance and (floor or not polish or not contracts)
            )
            # Where constraints leave nothing free, the multipliers are all that is corrected.
            improvable = correction > 0.0 or bool(np.any(dm))
            # Where Newton's method converges, the ratio of corrections is squared from one to the next.
            early = (
                number > 0
                and not done
                and contracts
                and correction <= foretold
                and correction * (correction / previous) ** 2 <= _NEXT * tolerance
            )
            if improvable and not polish and (done or early):
                last = _with_last_correction(
                    family,
                    parameter,
                    structure,
                    state,
                    multipliers,
                    dx,
                    dm,
                    dp,
                    noise,
                    residual if done else min(residual, _NEXT * tolerance),
                    evaluation.kkt,
                )
                done = done or last is not None
        history.append(
            Iteration(
                number,
                evaluation.energy,
                residual,
                correction,
                0.0,
                0.0 if done else 1.0,
                factors.inertia,
                "accepted" if done else "newton",
            )
        )
        if done:
            if last is not None:
                structure, state, multipliers, parameter, first, residual = last
                evaluation = replace(first, kkt=evaluation.kkt)
            balanced = Balanced(
                structure, state, multipliers, evaluation, residual, factors, tuple(history)
            )
            return balanced, parameter
        if not contracts:
            if balanced_before is not None:
                return balanced_before
            raise CorrectionFailed(
                f"corrections do not contract: {correction:.3g} after {previous:.3g}"
            )
        if structure.max_step(state, dx) < 1.0:
            raise CorrectionFailed("a correction would leave the domain of the energy")
        previous = correction
        if polish and residual <= noise:
            # Next to a critical state rounding errors ask for corrections that make nothing better.
            accepted = (*history[:-1], replace(history[-1], step=0.0, kind="accepted"))
            balanced_before = (
                Balanced(structure, state, multipliers, evaluation, residual, factors, accepted),
                parameter,
            )
        if dp != 0.0:
            parameter += dp
            structure, state = adopted(family, parameter, state)
        state = structure.retract(state, dx)
        multipliers = multipliers + dm
    raise CorrectionFailed(f"no convergence in {max_iterations} corrections")


def _with_last_correction(
    family: Family,
    parameter: float,
    structure: Any,
    state: Any,
    multipliers: Array,
    dx: Array,
    dm: Array,
    dp: float,
    noise: float,
    residual: float,
    kkt: KKTMatrix,
) -> tuple[Any, Any, Array, float, Evaluation, float] | None:
    """Return the iterate after a correction so small that the matrix need not be made anew.

    None if it would be less balanced than `residual`, by more than rounding errors.
    """
    if np.any(dx) and structure.max_step(state, dx) < 1.0:
        return None
    if dp != 0.0:
        parameter += dp
        structure, state = adopted(family, parameter, state)
    state = structure.retract(state, dx)
    multipliers = multipliers + dm
    evaluation = structure.evaluate(state, multipliers, 1)
    if not np.isfinite(evaluation.energy):
        return None
    terms = kkt.magnitude(typical_size(structure, state), multipliers)
    left = relative_residual(evaluation.gradient, evaluation.constraints, terms)
    if not left <= max(residual, noise):
        return None
    return structure, state, multipliers, parameter, evaluation, left


def critical_modes(
    balanced: Balanced, count: int, guess: Array | None = None, iterations: int = 12
) -> tuple[Array, Array]:
    """Return the eigenvalues of smallest size, and their modes, by inverse iteration.

    The eigenvalues are those of the second variation on the motions that the constraints admit, in
    the structure's metric; near a loss of stability they are separated from all others, so that
    few iterations suffice.

    Returns
    -------
    values : ndarray, shape (count,)
    modes : ndarray, shape (count, n)
        Orthonormal in the metric.
    """
    n = balanced.factorization.n
    if guess is None:
        metric = np.asarray(balanced.structure.metric(balanced.state), dtype=float)
        block = np.random.default_rng(0).standard_normal((min(count + 1, n), n)) / np.sqrt(metric)
    else:
        block = np.asarray(guess, dtype=float)
    values, modes = _inverse_iteration(balanced, block, count, iterations)
    return values[:count], _with_sign(modes[:count])


def lowest_of_stable(balanced: Balanced, guess: Array) -> tuple[float, Array, float] | None:
    """Return the smallest eigenvalue of a stable equilibrium, from the lowest modes of a neighbor.

    The inertia at a shift just below the result confirms that no eigenvalue is smaller.

    Returns
    -------
    value : float
    modes : ndarray, shape (k, n)
        The guess of the next neighbor.
    floor : float
        Round-off error of the value.

    or None if the guess was not good enough, or the matrix cannot be factored.
    """
    structure, kkt = balanced.structure, balanced.evaluation.kkt
    assert kkt is not None
    try:
        values, modes = _inverse_iteration(balanced, guess, 1, 8)
        value = float(values[0])
        metric = np.asarray(structure.metric(balanced.state), dtype=float)
        gauge = gauge_of(structure, balanced.state)
        terms, _ = kkt.magnitude(modes[0], np.zeros(kkt.m))
        floor = float(structure.noise(balanced.state)) * float(np.abs(modes[0]) @ terms)
        below = value - max(1e-6 * abs(value), 4 * floor)
        if not value > 0 or kkt.factorize(-below, gauge, metric).index != 0:
            return None
    except FactorizationError:
        return None
    return value, modes, floor


def _inverse_iteration(
    balanced: Balanced, block: Array, count: int, iterations: int
) -> tuple[Array, Array]:
    """Return eigenvalues of smallest size and modes, as good as the first `count` have settled."""
    structure, factors = balanced.structure, balanced.factorization
    metric = np.asarray(structure.metric(balanced.state), dtype=float)
    root = np.sqrt(metric)[:, None]
    columns = np.ascontiguousarray(block.T)
    k = columns.shape[1]
    previous = np.zeros(k)
    values = previous
    done = False
    for number in range(iterations):
        # Rounding errors of the factors matter only to the final values.
        last = done or number == iterations - 1
        columns = np.linalg.qr(root * columns)[0] / root
        image, _ = factors.solve(metric[:, None] * columns, refine=last)
        small = columns.T @ (metric[:, None] * image)  # inverse of the eigenvalues, projected
        inverse, rotation = np.linalg.eigh(0.5 * (small + small.T))
        order = np.argsort(-np.abs(inverse))
        columns = image @ rotation[:, order]
        with np.errstate(divide="ignore", invalid="ignore"):
            values = 1.0 / inverse[order]
            settled = np.abs(values - previous) <= 1e-10 * np.abs(values)
        if last:
            break
        done = bool(np.all(settled[:count]))
        previous = values
    size = np.sqrt(np.einsum("ij,i,ij->j", columns, metric, columns))
    return values, (columns / np.where(size > 0, size, 1.0)).T


def _with_sign(modes: Array) -> Array:
    """Make the entry of largest size of each mode positive, so that signs are reproducible."""
    sizes = np.abs(modes)
    # The first entry within rounding of the largest: a symmetric mode has several.
    first = np.argmax(sizes >= (1.0 - 1e-6) * sizes.max(axis=1, keepdims=True), axis=1)
    sign = np.sign(modes[np.arange(modes.shape[0]), first])
    return modes * np.where(sign == 0.0, 1.0, sign)[:, None]


def as_balanced(equilibrium: Equilibrium) -> Balanced:
    """Return an equilibrium with its factors."""
    return Balanced(
        equilibrium.structure, equilibrium.state, equilibrium.multipliers, equilibrium.evaluation,
        equilibrium.residual, equilibrium.factorization, equilibrium.history,
    )  # fmt: skip


def as_equilibrium(balanced: Balanced, *, factors: bool = False) -> Equilibrium:
    """Return an :class:`Equilibrium`, of the structure's own subclass if it has one.

    Without `factors` it holds neither matrix nor factors, which are large; they are made anew when
    they are asked for.
    """
    multipliers = np.array(balanced.multipliers)
    multipliers.flags.writeable = False
    result = Equilibrium(
        structure=balanced.structure,
        state=balanced.state,
        multipliers=multipliers,
        energy=balanced.energy,
        residual=balanced.residual,
        inertia=balanced.factorization.inertia,
        iterations=balanced.iterations,
        stable=balanced.stable,
        history=balanced.history,
    )
    if factors:
        result.__dict__["evaluation"] = balanced.evaluation
        result.__dict__["factorization"] = balanced.factorization
    return present(result)
