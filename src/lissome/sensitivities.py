"""Derivatives of an equilibrium, and of outputs of it, with respect to parameters.

An equilibrium :math:`(x, \\lambda)` of a family of structures solves :math:`g(x, \\lambda, p) = 0` and
:math:`c(x, p) = 0`. By the implicit function theorem

.. math:: K \\begin{pmatrix} dx/dp \\\\ d\\lambda/dp \\end{pmatrix}
    = - \\begin{pmatrix} \\partial g/\\partial p \\\\ \\partial c/\\partial p \\end{pmatrix}

with the KKT matrix K that the equilibrium has factored already. The direct mode solves this for each
parameter; the adjoint mode solves :math:`K a = \\nabla f` for each output f, and
:math:`df/dp = \\partial f/\\partial p - a \\cdot \\partial (g, c)/\\partial p`. Both cost one solve each,
not a new equilibrium.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._validate import finite_array, one_of
from .equilibrium import Equilibrium
from .errors import InvalidInput
from .factorization import Factorization
from .stability import yielding_multipliers

__all__ = ["Output", "Sensitivity", "sensitivity"]

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Output:
    """A scalar output of an equilibrium, with the derivatives that are known.

    Parameters
    ----------
    function : callable
        ``function(state, multipliers, parameter)`` returns a number.
    state_gradient, multiplier_gradient, parameter_gradient : callable, optional
        Functions of the same arguments that return its partial derivatives, of shapes (n,), (m,) and
        that of the parameter. Those that are missing are found by central differences of fourth
        order. The derivative by the parameter includes what moves with prescribed values
        (``structure.adopt``).

    Examples
    --------
    An output whose derivative by the state is known:

    >>> import lissome as ls
    >>> from lissome.sensitivities import Output
    >>> def spring(load):
    ...     return ls.DenseStructure(
    ...         initial=[0.0],
    ...         energy=lambda x: 2 * x[0] ** 2 - load * x[0],
    ...         gradient=lambda x: 4 * x - load,
    ...         hessian=lambda x: [[4.0]],
    ...     )
    >>> found = ls.equilibrate(spring(3.0))
    >>> square = Output(
    ...     lambda state, multipliers, load: state.x[0] ** 2,
    ...     state_gradient=lambda state, multipliers, load: 2 * state.x,
    ... )
    >>> result = ls.sensitivity(spring, 3.0, found, {"square": square}, mode="adjoint")
    >>> print(round(result.outputs["square"], 9))
    0.375
    """

    function: Callable[[Any, Array, Any], float]
    state_gradient: Callable[[Any, Array, Any], ArrayLike] | None = None
    multiplier_gradient: Callable[[Any, Array, Any], ArrayLike] | None = None
    parameter_gradient: Callable[[Any, Array, Any], ArrayLike] | None = None


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of an equilibrium with respect to k parameters.

    For a parameter that is a number the axis of length k is missing.

    Attributes
    ----------
    parameter : float or ndarray, shape (k,)
        Where.
    mode : str
        "direct" or "adjoint".
    state : ndarray, shape (n, k), or None
        Derivatives of the state, as tangent vectors at the state (direct mode). With neutral
        motions: the one that is orthogonal to their generators.
    multipliers : ndarray, shape (m, k), or None
        Derivatives of the multipliers (direct mode).
    outputs : dict
        Name: derivative, a float or an ndarray of shape (k,).

    Examples
    --------
    >>> import lissome as ls
    >>> def spring(load):
    ...     return ls.DenseStructure(
    ...         initial=[0.0],
    ...         energy=lambda x: 2 * x[0] ** 2 - load * x[0],
    ...         gradient=lambda x: 4 * x - load,
    ...         hessian=lambda x: [[4.0]],
    ...     )
    >>> found = ls.equilibrate(spring(3.0))
    >>> result = ls.sensitivity(spring, 3.0, found)
    >>> print(result.mode, result.state.round(9), result.multipliers)
    direct [0.25] []
    """

    parameter: float | Array
    mode: str
    state: Array | None
    multipliers: Array | None
    outputs: dict[str, Any]


def _difference(function: Callable[[float], Any], step: float) -> Any:
    """Return the derivative at 0 by central differences of fourth order."""
    near = np.asarray(function(step)) - np.asarray(function(-step))
    far = np.asarray(function(2 * step)) - np.asarray(function(-2 * step))
    return (8.0 * near - far) / (12.0 * step)


def implicit_derivative(
    factorization: Factorization, force: Array, closure: Array
) -> tuple[Array, Array]:
    """Return the derivatives of state and multipliers, given those of the residual.

    The implicit function theorem: for :func:`sensitivity`, and for the tangent of
    :func:`lissome.follow`.

    Parameters
    ----------
    factorization : Factorization
        Of the KKT matrix at the equilibrium.
    force, closure : ndarray, shapes (n,) and (m,), or (n, k) and (m, k)
        Derivatives of gradient and constraints with respect to the parameters.

    Returns
    -------
    state, multipliers : ndarray, of the same shapes
    """
    return factorization.solve(-force, -closure)


def residual_slope(
    family: Callable[[float], Any],
    parameter: float,
    state: Any,
    multipliers: Array,
    scale: float,
    exact: Callable[[float, Any, Array], tuple[ArrayLike, ArrayLike]] | None = None,
) -> tuple[Array, Array]:
    """Return the derivatives of gradient and constraints with respect to the parameter.

    Without the `exact` function: differences of the family, of second order, on one side where the
    family refuses the other side as invalid. Prescribed support values move along.
    """
    if exact is not None:
        force, closure = exact(parameter, state, multipliers)
        return np.asarray(force, dtype=float), np.asarray(closure, dtype=float)

    def residual(p: float) -> tuple[Array, Array]:
        structure = family(p)
        here = structure.evaluate(structure.adopt(state), multipliers, 1)
        return here.gradient, here.constraints

    # Far from p = 0 the rounding of p itself asks for a longer step.
    h = EPS ** (1.0 / 3.0) * max(scale, 1e-3 * abs(parameter))
    sides: list[tuple[float, tuple[Array, Array]]] = []
    refusal: InvalidInput | None = None
    for side in (1.0, -1.0):
        try:
            place = parameter + side * h
            sides.append((place - parameter, residual(place)))
        except InvalidInput as error:
            refusal = error
    if len(sides) == 1:
        far = parameter + 2.0 * sides[0][0]
        sides += [(far - parameter, residual(far)), (0.0, residual(parameter))]
        (a, near), (b, further), (_, here) = sides
        weights = (b / (a * (b - a)), -a / (b * (b - a)))
        first, second = (
            weights[0] * (near[i] - here[i]) + weights[1] * (further[i] - here[i]) for i in (0, 1)
        )
        return first, second
    if not sides:
        assert refusal is not None
        raise refusal
    (a, ahead), (b, back) = sides
    return (ahead[0] - back[0]) / (a - b), (ahead[1] - back[1]) / (a - b)


def _refuse_hidden(
    i: int,
    value: float,
    step: float,
    residual: Callable[[float], Array],
    slope: Array,
    seen: Callable[[Array], bool],
) -> None:
    """Raise if rounding hides what a small parameter changes, although the parameter matters."""
    if seen(step * slope):
        return
    longer = EPS**0.2  # what a parameter of 0 gets
    try:
        matters = seen(longer * _difference(residual, longer))
    except InvalidInput:  # the family ends before: nothing can be told
        matters = True
    if matters:
        raise InvalidInput(
            f"argument `parameter` has the entry {value:.3g} (number {i}), so small that rounding "
            f"hides the changes within the default step {step:.3g}; pass `step`, or 0 for a "
            "parameter that is meant to be zero"
        )


def _number(name: str, value: Any) -> float:
    array = np.asarray(value, dtype=float)
    if array.size != 1:
        raise InvalidInput(
            f"the output `{name}` returned an array of shape {array.shape}; it must be a number"
        )
    number = float(array.reshape(()))
    if not np.isfinite(number):
        raise InvalidInput(f"the output `{name}` returned {number}; it must be finite")
    return number


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        raise InvalidInput(f"`{name}` returned an array of shape {array.shape}; it must be {shape}")
    return array


def sensitivity(
    family: Callable[[Any], Any],
    parameter: float | ArrayLike,
    equilibrium: Equilibrium,
    outputs: Mapping[str, Output | Callable[..., float]] | None = None,
    mode: Literal["direct", "adjoint"] = "direct",
    *,
    residual_derivative: Callable[[Any, Any, Array], tuple[ArrayLike, ArrayLike]] | None = None,
    step: float | ArrayLike | None = None,
) -> Sensitivity:
    """Return derivatives of an equilibrium, and of outputs, with respect to parameters.

    Parameters
    ----------
    family : callable
        Returns the structure of a parameter. All its structures have the same unknowns.
    parameter : float or array_like, shape (k,)
        Where; the equilibrium is one of ``family(parameter)``.
    equilibrium : Equilibrium
        The equilibrium, of any index.
    outputs : mapping of str to Output or callable, optional
        Scalar outputs; a callable takes ``(state, multipliers, parameter)``.
    mode : {"direct", "adjoint"}
        "direct" (default) solves once for each parameter, and also gives the derivatives of state
        and multipliers; "adjoint" solves once for each output: for many parameters.
    residual_derivative : callable, optional
        ``residual_derivative(parameter, state, multipliers)`` returns the derivatives of gradient
        and constraints by the parameter, of shapes (n,) and (m,), or (n, k) and (m, k). Without it,
        central differences of fourth order of ``family(p).evaluate``.
    step : float or array_like, shape (k,), optional
        Step of the differences in the parameter; by default 7e-4 of its size (or of 1 if it is 0).

    Returns
    -------
    Sensitivity

    Raises
    ------
    InvalidInput
        If the equilibrium is not one of ``family(parameter)``, a function returns a wrong shape, or
        a parameter is so small that rounding hides what its default step changes.
    FactorizationError
        If the equilibrium is critical: at a fold it has no derivative.

    Examples
    --------
    >>> import numpy as np
    >>> import lissome as ls
    >>> def spring(load):
    ...     return ls.DenseStructure(
    ...         initial=[0.0],
    ...         energy=lambda x: 2 * x[0] ** 2 - load * x[0],
    ...         gradient=lambda x: 4 * x - load,
    ...         hessian=lambda x: np.array([[4.0]]),
    ...     )
    >>> found = ls.equilibrate(spring(3.0))
    >>> squared = {"squared": lambda state, multipliers, load: state.x[0] ** 2}
    >>> result = ls.sensitivity(spring, 3.0, found, squared)
    >>> print(result.state.round(12), round(result.outputs["squared"], 9))
    [0.25] 0.375
    """
    one_of("mode", mode, ("direct", "adjoint"))
    if not callable(family):
        raise InvalidInput(
            f"argument `family` is {family!r}; it must be a function from the parameter to a structure"
        )
    if not isinstance(equilibrium, Equilibrium):
        raise InvalidInput(
            f"argument `equilibrium` is of type {type(equilibrium).__name__}; pass what "
            "`equilibrate` returns at this parameter"
        )
    point = finite_array("parameter", parameter)
    if point.ndim > 1 or not point.size:
        raise InvalidInput(
            f"argument `parameter` has shape {point.shape}; it must be a number or a vector of some"
        )
    scalar = point.ndim == 0
    vector = np.atleast_1d(point)
    k = vector.size
    steps = np.where(vector != 0, np.abs(vector), 1.0) * EPS**0.2
    if step is not None:
        steps = np.broadcast_to(np.asarray(step, dtype=float), (k,))
        if not np.all(np.isfinite(steps) & (steps > 0)):
            raise InvalidInput(f"argument `step` is {step}; it must be positive")
    named: dict[str, Output] = {}
    if outputs is not None and not isinstance(outputs, Mapping):
        raise InvalidInput(
            f"argument `outputs` is {outputs!r}; pass names with functions or Outputs: "
            "{'name': function}"
        )
    for name, given in (outputs or {}).items():
        if not isinstance(given, Output) and not callable(given):
            raise InvalidInput(
                f"argument `outputs` holds {name!r}: {given!r}; pass names with functions or "
                "Outputs: {'name': function}"
            )
        named[name] = given if isinstance(given, Output) else Output(given)
    state, mult = equilibrium.state, equilibrium.multipliers
    n, m = equilibrium.structure.size, equilibrium.structure.constraints_count

    def argument(i: int, shift: float) -> Any:
        moved = vector.copy()
        moved[i] += shift
        return float(moved[0]) if scalar else moved

    here = family(argument(0, 0.0))
    if here.size != n or here.constraints_count != m:
        raise InvalidInput(
            f"argument `family` returns a structure of {here.size} unknowns and "
            f"{here.constraints_count} constraints; the equilibrium has {n} and {m}"
        )
    balance = here.evaluate(here.adopt(state), mult, 1)
    kkt = equilibrium.evaluation.kkt
    assert kkt is not None
    typical = np.broadcast_to(np.asarray(here.typical(state), dtype=float), (n,))
    force, closure = kkt.magnitude(typical, mult)
    if np.any(np.abs(balance.gradient) > 1e-5 * np.max(force)) or np.any(
        np.abs(balance.constraints) > 1e-5 * np.max(closure, initial=0.0)
    ):
        raise InvalidInput(
            f"argument `equilibrium` is not balanced in family({point}); pass the parameter "
            "at which it was found"
        )

    noise = float(here.noise(state))

    def seen(change: Array) -> bool:
        """Tell whether a change of the residual is far above its rounding errors."""
        return bool(
            np.max(np.abs(change[:n])) > 1e3 * noise * np.max(force)
            or np.any(np.abs(change[n:]) > 1e3 * noise * np.max(closure, initial=0.0))
        )

    # The unbalanced force and constraint that each parameter makes.
    dg, dc = np.empty((n, k)), np.empty((m, k))
    if residual_derivative is not None:
        first, second = residual_derivative(argument(0, 0.0), state, mult)
        if scalar:
            dg[:, 0] = _shaped("residual_derivative", first, (n,))
            dc[:, 0] = _shaped("residual_derivative", second, (m,))
        else:
            dg[:] = _shaped("residual_derivative", first, (n, k))
            dc[:] = _shaped("residual_derivative", second, (m, k))
    else:
        for i in range(k):

            def residual(shift: float, i: int = i) -> Array:
                structure = family(argument(i, shift))
                e = structure.evaluate(structure.adopt(state), mult, 1)
                return np.concatenate([e.gradient, e.constraints])

            both = _difference(residual, float(steps[i]))
            if not np.all(np.isfinite(both)):
                raise InvalidInput(
                    f"the residual of `family` is not finite within {2 * steps[i]:.3g} of the "
                    f"parameter {point}; pass a smaller `step`"
                )
            dg[:, i], dc[:, i] = both[:n], both[n:]
            if step is None and 0.0 < abs(vector[i]) < 1.0:
                _refuse_hidden(i, float(vector[i]), float(steps[i]), residual, both, seen)

    factor = equilibrium.factorization
    results: dict[str, Any] = {}

    def explicit(name: str, output: Output) -> Array:
        """Return the derivative by the parameters at fixed unknowns."""
        if output.parameter_gradient is not None:
            values = output.parameter_gradient(state, mult, argument(0, 0.0))
            return np.atleast_1d(
                _shaped(f"{name}: parameter_gradient", values, () if scalar else (k,))
            )
        found = np.empty(k)
        for i in range(k):

            def value(shift: float, i: int = i) -> float:
                p = argument(i, shift)
                return _number(name, output.function(family(p).adopt(state), mult, p))

            found[i] = _difference(value, float(steps[i]))
        return found

    def along(name: str, output: Output, dx: Array, dm: Array, finer: float = 1.0) -> float:
        """Return the derivative of an output along increments of state and multipliers.

        Differences by multipliers are `finer` than by default.
        """
        p = argument(0, 0.0)
        total = 0.0
        if output.state_gradient is not None:
            total += float(
                _shaped(f"{name}: state_gradient", output.state_gradient(state, mult, p), (n,)) @ dx
            )
        elif np.any(dx):
            h = EPS**0.2 / float(np.max(np.abs(dx) / typical))
            total += float(
                _difference(
                    lambda t: _number(
                        name, output.function(equilibrium.structure.retract(state, t * dx), mult, p)
                    ),
                    h,
                )
            )
        if output.multiplier_gradient is not None:
            total += float(
                _shaped(
                    f"{name}: multiplier_gradient", output.multiplier_gradient(state, mult, p), (m,)
                )
                @ dm
            )
        elif np.any(dm):
            size = float(np.max(np.abs(mult))) or 1.0
            h = EPS**0.2 * size / (finer * float(np.max(np.abs(dm))))
            total += float(
                _difference(lambda t: _number(name, output.function(state, mult + t * dm, p)), h)
            )
        return total

    def squeezed(values: Array) -> Any:
        return values[..., 0] if scalar else values

    def finished(values: Array) -> Any:
        return float(values[0]) if scalar else values

    if mode == "direct":
        dx, dm = implicit_derivative(factor, dg, dc)
        for name, output in named.items():
            moved = [along(name, output, dx[:, i], dm[:, i]) for i in range(k)]
            results[name] = finished(explicit(name, output) + np.array(moved))
        return Sensitivity(finished(vector), mode, squeezed(dx), squeezed(dm), results)

    yielding = bool(np.any(yielding_multipliers(kkt)))

    def by_multipliers(name: str, output: Output) -> Array:
        """Return the derivatives by the multipliers; those of yielding parts with shorter steps.

        The energy of such parts bends sharply where moments pass zero.
        """

        def found(finer: float) -> Array:
            return np.array([along(name, output, np.zeros(n), e, finer) for e in np.eye(m)])

        if not yielding:
            return found(1.0)
        values, others = found(512.0), found(64.0)
        if np.max(np.abs(values - others)) > 1e-4 * np.max(np.abs(values)):
            raise InvalidInput(
                f"the derivatives of the output {name!r} by the multipliers cannot be told from "
                "differences; give it a `multiplier_gradient`, or pass mode='direct'"
            )
        return values

    for name, output in named.items():
        p = argument(0, 0.0)
        if output.state_gradient is not None:
            fx = _shaped(f"{name}: state_gradient", output.state_gradient(state, mult, p), (n,))
        else:
            fx = np.array([along(name, Output(output.function), e, np.zeros(m)) for e in np.eye(n)])
        if output.multiplier_gradient is not None:
            fm = _shaped(
                f"{name}: multiplier_gradient", output.multiplier_gradient(state, mult, p), (m,)
            )
        else:
            fm = by_multipliers(name, Output(output.function))
        a, b = factor.solve(fx, fm)
        results[name] = finished(explicit(name, output) - a @ dg - b @ dc)
    return Sensitivity(finished(vector), mode, None, None, results)
