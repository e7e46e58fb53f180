"""What a structure is: a potential energy with equality constraints.

Everything that the library solves is brought to one form: unknowns that live on a manifold (for
rods: positions and frames), an energy, equality constraints, and the derivatives of the Lagrangian

.. math:: L(x, \\lambda) = E(x) + \\lambda \\cdot c(x).

:class:`Structure` states what a solver needs to know. :class:`BaseStructure` has defaults for
everything but the energy; :class:`DenseStructure` makes a structure out of plain functions.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._archive import UNREADABLE
from ._validate import finite_array
from .errors import DataError, InvalidInput
from .factorization import DenseKKT, Factorization, KKTMatrix

__all__ = [
    "BaseStructure",
    "Corrected",
    "DenseStructure",
    "Evaluation",
    "Structure",
    "VectorState",
    "load_state",
    "save_state",
]

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Energy, constraints and derivatives of a structure at one state.

    Attributes
    ----------
    energy : float
        Potential energy :math:`E`.
    constraints : ndarray, shape (m,)
        Values :math:`c` of the constraints; zero at an equilibrium.
    gradient : ndarray, shape (n,), or None
        Gradient of the Lagrangian, :math:`\\nabla E + J^T \\lambda` (order 1 and 2).
    kkt : KKTMatrix or None
        The matrix :math:`[[\\nabla^2 L, J^T], [J, 0]]` (order 2).

    Examples
    --------
    A spring, away from its rest:

    >>> import numpy as np
    >>> from lissome import DenseStructure
    >>> spring = DenseStructure([2.0], lambda x: x[0] ** 2, lambda x: 2 * x, lambda x: [[2.0]])
    >>> here = spring.evaluate(spring.start(), np.zeros(0), order=1)
    >>> print(here.energy, here.gradient, here.kkt)
    4.0 [4.] None
    """

    energy: float
    constraints: Array
    gradient: Array | None = None
    kkt: KKTMatrix | None = None


@dataclass(frozen=True, eq=False)
class Corrected:
    """What a structure's own corrector hands over to :func:`lissome.equilibrate`.

    Attributes
    ----------
    state : object
        A stationary point near the start, or a state that one Newton correction takes there.
    multipliers : ndarray, shape (m,)
        The multipliers there.
    evaluation : Evaluation, optional
        What ``evaluate(state, multipliers, 2)`` returns; evaluated anew if it is missing.
    factorization : Factorization, optional
        Of ``evaluation.kkt``, without shift and with the rows of ``gauge(state)``; factored anew
        if it is missing.
    iterations : int
        Number of corrections that were made.

    Examples
    --------
    A spring that knows where it comes to rest; the verdict stays with :func:`lissome.equilibrate`:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome.factorization import DenseKKT
    >>> from lissome.structure import BaseStructure, Corrected, Evaluation, VectorState
    >>> class Spring(BaseStructure):
    ...     size = 1
    ...     def start(self):
    ...         return VectorState([5.0])
    ...     def evaluate(self, state, multipliers, order=2):
    ...         energy = 0.5 * (state.x[0] - 1.0) ** 2
    ...         return Evaluation(energy, np.zeros(0), state.x - 1.0, DenseKKT([[1.0]]))
    ...     def correct(self, state, multipliers, tolerance):
    ...         return Corrected(VectorState([1.0]), multipliers)
    >>> found = ls.equilibrate(Spring())
    >>> print(found.state.x, found.stable)
    [1.] True
    """

    state: Any
    multipliers: Array
    evaluation: Evaluation | None = None
    factorization: Factorization | None = None
    iterations: int = 0


@runtime_checkable
class Structure(Protocol):
    """What the solvers ask of a structure. Structures are immutable values.

    Vectors `dx` are tangent vectors of the manifold of states: increments of the `size` unknowns.

    Six methods are optional. ``present(equilibrium)`` returns the structure's own subclass of
    :class:`~lissome.equilibrium.Equilibrium`. ``correct(state, multipliers, tolerance)`` is a fast
    corrector: it returns a nearby stationary point as :class:`Corrected`, or None if it does not get
    to one. :func:`lissome.equilibrate` calls it once, before its own descent, with the start and a
    guess of the multipliers, and judges balance and stability of what it returns like those of any
    state: the corrector may hand over the evaluation and the factors that it has made there, but not a
    verdict. It may stop where the next Newton correction is within `tolerance` (relative to
    ``typical``), without applying it; that correction is still made. ``descended(state, multipliers)``
    returns a state near a stable equilibrium below, and its multipliers, or None; the multipliers that
    it is given may be None (not known). It is for structures of which no equilibrium is a minimum of
    the Lagrangian, because forces are among the multipliers. ``diagnose(state)`` is asked about
    the last state when a solve fails: it returns what is wrong with that state, and the remedy, or None.
    ``warn(equilibrium, stacklevel)`` is called with what :func:`lissome.equilibrate` returns (not with
    the many states of a branch), to warn of what the model leaves out. ``reactions(equilibrium)`` returns
    what the supports exert, as :class:`~lissome.reactions.Reactions`. An attribute ``smallest_shift``
    tells where shifts of an indefinite Hessian start, relative to its entries (1e-6 by default): less
    for structures whose eigenvalues spread farther.

    Examples
    --------
    Whatever has these methods is one; no base class is needed:

    >>> from lissome import DenseStructure
    >>> from lissome.structure import Structure
    >>> spring = DenseStructure([2.0], lambda x: x[0] ** 2, lambda x: 2 * x, lambda x: [[2.0]])
    >>> isinstance(spring, Structure), isinstance(2.0, Structure)
    (True, False)
    """

    @property
    def size(self) -> int:
        """Number n of unknowns (the prescribed ones are none)."""
        ...

    @property
    def constraints_count(self) -> int:
        """Number m of equality constraints."""
        ...

    def start(self) -> Any:
        """Return a state from which a solver may start."""
        ...

    def retract(self, state: Any, dx: Array) -> Any:
        """Return the state reached from `state` by the increment `dx`, shape (n,)."""
        ...

    def difference(self, a: Any, b: Any) -> Array:
        """Return the increment, shape (n,), that leads from `a` to `b`.

        It is the inverse of :meth:`retract`: ``retract(a, difference(a, b))`` is `b`.
        """
        ...

    def evaluate(self, state: Any, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy and constraints, the gradient (order >= 1), the KKT matrix (order 2).

        Parameters
        ----------
        state : object
            Of the kind that :meth:`start` returns.
        multipliers : ndarray, shape (m,)
            Lagrange multipliers: gradient and Hessian are those of the Lagrangian.
        order : {0, 1, 2}
            The highest derivative that is wanted.

        Returns
        -------
        Evaluation
            An energy of infinity says that `state` is outside the domain: solvers step back.
        """
        ...

    def max_step(self, state: Any, dx: Array) -> float:
        """Return the largest fraction of `dx` that a solver may take from `state`, in (0, 1]."""
        ...

    def metric(self, state: Any) -> Array:
        """Return a positive diagonal mass at `state`, shape (n,).

        ``dx @ (metric * dx)`` is a squared norm of an increment: arclengths of branches and eigenvalues
        are measured in it.
        """
        ...

    def gauge(self, state: Any) -> Array:
        """Return generators of neutral motions at `state`, shape (g, n); g = 0 when there are none."""
        ...

    def typical(self, state: Any) -> float | Array:
        """Return the typical size of the unknowns at `state` (a number, or one number for each).

        Corrections are judged relative to it.
        """
        ...

    def noise(self, state: Any) -> float:
        """Return the relative round-off error of the terms that gradient and Hessian sum at `state`."""
        ...

    def adopt(self, state: Any) -> Any:
        """Return `state` with the prescribed (support) values of this structure."""
        ...


@dataclass(frozen=True, eq=False)
class VectorState:
    """A state that is a plain vector of unknowns.

    Parameters
    ----------
    x : array_like, shape (n,)
        The unknowns. Copied, and made read-only.

    Raises
    ------
    InvalidInput
        If `x` is not a vector.

    Examples
    --------
    >>> from lissome.structure import VectorState
    >>> print(VectorState([1, 2]).x)
    [1. 2.]
    """

    x: Array

    def __post_init__(self) -> None:
        x = np.array(self.x, dtype=float)
        if x.ndim != 1:
            raise InvalidInput(
                f"argument `x` has shape {x.shape}; a VectorState holds a vector of shape (n,)"
            )
        x.flags.writeable = False
        object.__setattr__(self, "x", x)


class BaseStructure:
    """Defaults for everything of a structure except its energy.

    A subclass defines ``start`` and ``evaluate`` and the properties ``size`` and
    ``constraints_count`` (0 by default). The defaults below suit states of the kind
    :class:`VectorState`; a subclass whose states are of another kind also overrides ``retract`` and
    ``difference``.

    Examples
    --------
    A chain of springs of any number of unknowns, between two walls, under a load on each:

    >>> import numpy as np
    >>> import lissome as ls
    >>> from lissome.factorization import TridiagonalKKT
    >>> from lissome.structure import BaseStructure, Evaluation, VectorState
    >>> class Chain(BaseStructure):
    ...     size = 5
    ...     def start(self):
    ...         return VectorState(np.zeros(self.size))
    ...     def evaluate(self, state, multipliers, order=2):
    ...         strain = np.diff(state.x, prepend=0.0, append=0.0)
    ...         energy = 0.5 * strain @ strain - 0.1 * state.x.sum()
    ...         kkt = TridiagonalKKT(np.full(self.size, 2.0), np.full(self.size - 1, -1.0))
    ...         return Evaluation(energy, np.zeros(0), -np.diff(strain) - 0.1, kkt)
    >>> print(ls.equilibrate(Chain()).state.x.round(12))
    [0.25 0.4  0.45 0.4  0.25]
    """

    @property
    def size(self) -> int:
        """Number n of unknowns."""
        raise NotImplementedError(f"{type(self).__name__} must define the property `size`")

    @property
    def constraints_count(self) -> int:
        """Number m of equality constraints."""
        return 0

    def start(self) -> Any:
        """Return a state from which a solver may start."""
        raise NotImplementedError(f"{type(self).__name__} must define `start`")

    def evaluate(self, state: Any, multipliers: Array, order: int = 2) -> Evaluation:
        """Return an :class:`Evaluation` of the given order."""
        raise NotImplementedError(f"{type(self).__name__} must define `evaluate`")

    def retract(self, state: Any, dx: Array) -> Any:
        """Return the state reached by the increment `dx`: the sum, for vectors."""
        return VectorState(state.x + dx)

    def difference(self, a: Any, b: Any) -> Array:
        """Return the increment from `a` to `b`: the difference, for vectors."""
        return b.x - a.x

    def max_step(self, state: Any, dx: Array) -> float:
        """Return the fraction of `dx` that may be taken: all of it."""
        return 1.0

    def metric(self, state: Any) -> Array:
        """Return the mass of each unknown: one."""
        return np.ones(self.size)

    def gauge(self, state: Any) -> Array:
        """Return the generators of neutral motions: none."""
        return np.zeros((0, self.size))

    def typical(self, state: Any) -> float | Array:
        """Return the typical size of the unknowns: one."""
        return 1.0

    def noise(self, state: Any) -> float:
        """Return the relative error of a term: a few units of round-off."""
        return 8 * EPS

    def adopt(self, state: Any) -> Any:
        """Return `state`: no value is prescribed."""
        return state


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != (size,):
        raise InvalidInput(
            f"the function `{name}` returned an array of shape {array.shape}; it must be ({size},)"
        )
    return array


def _matrix(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        raise InvalidInput(
            f"the function `{name}` returned an array of shape {array.shape}; it must be {shape}"
        )
    return array


@dataclass(frozen=True, eq=False)
class DenseStructure(BaseStructure):
    """A structure with few unknowns, made of plain functions of a vector.

    Parameters
    ----------
    initial : array_like, shape (n,)
        Where solvers start.
    energy, gradient, hessian : callable
        Functions of x, shape (n,), that return the energy (a number) and its derivatives, shapes
        (n,) and (n, n).
    constraints, jacobian : callable, optional
        Functions of x that return the constraints, shape (m,), and their derivatives, shape (m, n).
    constraint_hessian : callable, optional
        Function of x and the multipliers, shape (m,), that returns the sum over i of multiplier i
        times the Hessian of constraint i, shape (n, n). Without it the constraints must be linear;
        this is checked.
    neutral : callable, optional
        Function of x that returns the generators of motions that change neither energy nor
        constraints, shape (g, n).
    step_limit : callable, optional
        Function of x and dx that returns the fraction of dx, in (0, 1], that stays inside barriers.
    masses : array_like, shape (n,), optional
        The diagonal metric; ones by default.
    size_of_unknowns : float or array_like, optional
        Typical size of the unknowns; 1 by default. Corrections are judged relative to it.
    constraint_names : sequence of str, optional
        Names of the constraints, for error messages.
    check : bool, optional
        Compare gradient, Hessian and Jacobian with differences of the functions that they
        derive from, in one direction at `initial`, when the structure is made (default).

    Raises
    ------
    InvalidInput
        If a function returns a wrong shape, a Hessian that is not symmetric, or a value that is not
        finite at `initial`, or if a derivative does not fit its function.

    Examples
    --------
    A pitchfork: two minima at plus and minus one.

    >>> import numpy as np
    >>> from lissome import DenseStructure, equilibrate
    >>> pitchfork = DenseStructure(
    ...     initial=[0.3],
    ...     energy=lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2,
    ...     gradient=lambda x: x**3 - x,
    ...     hessian=lambda x: np.diag(3 * x**2 - 1),
    ... )
    >>> print(equilibrate(pitchfork).state.x.round(12))
    [1.]
    """

    initial: ArrayLike
    energy: Callable[[Array], float]
    gradient: Callable[[Array], ArrayLike]
    hessian: Callable[[Array], ArrayLike]
    constraints: Callable[[Array], ArrayLike] | None = None
    jacobian: Callable[[Array], ArrayLike] | None = None
    constraint_hessian: Callable[[Array, Array], ArrayLike] | None = None
    neutral: Callable[[Array], ArrayLike] | None = None
    step_limit: Callable[[Array, Array], float] | None = None
    masses: ArrayLike | None = None
    size_of_unknowns: float | ArrayLike = 1.0
    constraint_names: tuple[str, ...] | None = None
    check: bool = True
    _start: VectorState = field(init=False, repr=False)
    _count: int = field(init=False, repr=False)
    _masses: Array = field(init=False, repr=False)
    _typical: float | Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if (self.constraints is None) != (self.jacobian is None):
            raise InvalidInput("arguments `constraints` and `jacobian` must be given together")
        for name in ("energy", "gradient", "hessian"):
            if not callable(getattr(self, name)):
                raise InvalidInput(
                    f"argument `{name}` is {getattr(self, name)!r}; it must be a function of the unknowns"
                )
        initial = np.atleast_1d(finite_array("initial", self.initial))
        if initial.ndim > 1:
            raise InvalidInput(f"argument `initial` has shape {initial.shape}; it must be a vector")
        start = VectorState(initial)
        if start.x.size == 0:
            raise InvalidInput("argument `initial` is empty; a structure has at least one unknown")
        count = 0
        if self.constraints is not None:
            values = np.asarray(self.constraints(start.x), dtype=float)
            if values.ndim != 1:
                raise InvalidInput(
                    f"the function `constraints` returned an array of shape {values.shape}; "
                    "it must be (m,)"
                )
            count = values.size
        if self.constraint_names is not None and len(self.constraint_names) != count:
            raise InvalidInput(
                f"argument `constraint_names` has {len(self.constraint_names)} names; "
                f"there are {count} constraints"
            )
        n = start.x.size
        masses = np.ones(n) if self.masses is None else finite_array("masses", self.masses)
        if masses.shape != (n,) or not np.all(masses > 0):
            raise InvalidInput(
                f"argument `masses` is {self.masses}; it must hold {n} positive numbers"
            )
        typical = finite_array("size_of_unknowns", self.size_of_unknowns)
        if typical.shape not in ((), (n,)) or not np.all(typical > 0):
            raise InvalidInput(
                f"argument `size_of_unknowns` is {self.size_of_unknowns}; it must be a positive "
                f"number, or {n} of them"
            )
        object.__setattr__(self, "_start", start)
        object.__setattr__(self, "_count", count)
        object.__setattr__(self, "_masses", masses)
        object.__setattr__(self, "_typical", float(typical) if typical.ndim == 0 else typical)
        if self.check:
            self._check_derivatives()

    @property
    def size(self) -> int:
        """Number n of unknowns."""
        return self._start.x.size

    @property
    def constraints_count(self) -> int:
        """Number m of constraints."""
        return self._count

    def start(self) -> VectorState:
        """Return the initial state."""
        return self._start

    def max_step(self, state: VectorState, dx: Array) -> float:
        """Return the fraction of `dx` that stays inside the barriers.

        Raises
        ------
        InvalidInput
            If the function `step_limit` returns a number outside (0, 1].
        """
        if self.step_limit is None:
            return 1.0
        fraction = float(self.step_limit(state.x, dx))
        if not 0 < fraction <= 1:
            raise InvalidInput(
                f"the function `step_limit` returned {fraction}; it must lie in (0, 1]"
            )
        return fraction

    def metric(self, state: VectorState) -> Array:
        """Return `masses`."""
        return self._masses

    def typical(self, state: VectorState) -> float | Array:
        """Return `size_of_unknowns`."""
        return self._typical

    def gauge(self, state: VectorState) -> Array:
        """Return what the function `neutral` returns, or no generators."""
        if self.neutral is None:
            return np.zeros((0, self.size))
        rows = np.atleast_2d(np.asarray(self.neutral(state.x), dtype=float))
        return _matrix("neutral", rows, (rows.shape[0], self.size))

    def evaluate(self, state: VectorState, multipliers: Array, order: int = 2) -> Evaluation:
        """Return energy, constraints and derivatives up to `order`.

        Raises
        ------
        InvalidInput
            If a function returns an array of a wrong shape.
        """
        n, m, x = self.size, self._count, state.x
        if x.shape != (n,):
            raise InvalidInput(f"the state has {x.size} unknowns; this structure has {n}")
        multipliers = np.asarray(multipliers, dtype=float)
        if multipliers.shape != (m,):
            raise InvalidInput(
                f"argument `multipliers` has shape {multipliers.shape}; it must be ({m},)"
            )
        energy = np.asarray(self.energy(x), dtype=float)
        if energy.size != 1:
            raise InvalidInput(
                f"the function `energy` returned an array of shape {energy.shape}; "
                "it must be a number"
            )
        constraints = np.zeros(0)
        if self.constraints is not None:
            constraints = _vector("constraints", self.constraints(x), m)
        value = float(energy.reshape(()))
        if order == 0:
            return Evaluation(value, constraints)
        gradient = _vector("gradient", self.gradient(x), n)
        jacobian = np.zeros((0, n))
        if self.jacobian is not None:
            jacobian = _matrix("jacobian", self.jacobian(x), (m, n))
            gradient = gradient + jacobian.T @ multipliers
        if order == 1:
            return Evaluation(value, constraints, gradient)
        hessian = _matrix("hessian", self.hessian(x), (n, n))
        if self.constraint_hessian is not None:
            curvature = self.constraint_hessian(x, multipliers)
            hessian = hessian + _matrix("constraint_hessian", curvature, (n, n))
        return Evaluation(value, constraints, gradient, DenseKKT(hessian, jacobian))

    def _check_derivatives(self) -> None:
        x, n, m = self._start.x, self.size, self._count
        multipliers = np.cos(1.0 + np.arange(m))
        here = self.evaluate(self._start, multipliers, 2)
        assert here.gradient is not None
        if not math.isfinite(here.energy):
            raise InvalidInput(f"the function `energy` returned {here.energy} at `initial`")
        for name, value in (("gradient", here.gradient), ("constraints", here.constraints)):
            if not np.all(np.isfinite(value)):
                raise InvalidInput(f"the function `{name}` returned NaN or infinity at `initial`")
        kkt = here.kkt
        assert isinstance(kkt, DenseKKT)  # its constructor has checked symmetry
        direction = np.sin(1.0 + np.arange(n)) * np.broadcast_to(self._typical, (n,))
        h = EPS ** (1 / 3)
        h *= 0.5 * self.max_step(self._start, h * direction)
        h *= self.max_step(self._start, -h * direction)
        points = [
            self.evaluate(VectorState(x + f * h * direction), multipliers, 1)
            for f in (1.0, -1.0, 0.5, -0.5)
        ]

        def compare(name: str, of: str, values: list[Any], exact: Any) -> None:
            coarse, fine = (values[0] - values[1]) / (2 * h), (values[2] - values[3]) / h
            error = float(np.max(np.abs(fine - exact), initial=0.0))
            scale = float(np.max(np.abs(fine), initial=0.0) + np.max(np.abs(exact), initial=0.0))
            size = max(float(np.max(np.abs(v), initial=0.0)) for v in values)
            truncation = float(np.max(np.abs(fine - coarse), initial=0.0))
            # Truncation is seen in the difference of the two steps; rounding is eps / h.
            if not error <= 1e-5 * scale + 4 * truncation + 100 * EPS / h * size:
                raise InvalidInput(
                    f"the function {name} is not the derivative of {of} at `initial`: along a "
                    f"test direction it gives {exact}, central differences give {fine}"
                )

        multiplied = [e.energy + float(multipliers @ e.constraints) for e in points]
        compare("`gradient` (or `jacobian`)", "`energy` (or `constraints`)", multiplied,
                float(here.gradient @ direction))  # fmt: skip
        compare("`hessian` (or `constraint_hessian`)", "`gradient` (or `jacobian`)",
                [e.gradient for e in points], kkt.hessian @ direction)  # fmt: skip
        compare("`jacobian`", "`constraints`", [e.constraints for e in points],
                kkt.jacobian @ direction)  # fmt: skip
        if self.constraint_hessian is None and m:
            far = np.asarray(self.jacobian(x + h**0.5 * direction))  # type: ignore[misc]
            if np.max(np.abs(far - kkt.jacobian)) > 1e-9 * np.max(np.abs(far)):
                raise InvalidInput(
                    "argument `constraint_hessian` is missing, and `jacobian` depends on x: curved "
                    "constraints need their second derivatives, or every verdict on stability is wrong"
                )


_SCALARS = {"float": float, "int": int, "bool": bool, "str": str}


def save_state(path: str | os.PathLike[str], state: Any) -> None:
    """Save a state (a dataclass of arrays and numbers) to an ``.npz`` file, without pickle.

    Parameters
    ----------
    path : path
        Where to write; the suffix is not changed.
    state : dataclass instance
        Its fields are arrays of numbers, numbers or strings.

    Raises
    ------
    InvalidInput
        If `state` is not a dataclass instance or a field is of another kind.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from lissome.structure import VectorState, load_state, save_state
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "state.npz"
    ...     save_state(file, VectorState([1.0, 2.0]))
    ...     print(load_state(file, VectorState).x)
    [1. 2.]
    """
    if not dataclasses.is_dataclass(state) or isinstance(state, type):
        raise InvalidInput(
            f"argument `state` is of type {type(state).__name__}; it must be a dataclass of arrays"
        )
    arrays: dict[str, Any] = {}
    for item in dataclasses.fields(state):
        if not item.init:  # derived from the others
            continue
        value = np.asarray(getattr(state, item.name))
        if value.dtype.kind not in "biufcU":
            raise InvalidInput(
                f"field `{item.name}` of {type(state).__name__} holds {value.dtype}; states hold "
                "arrays of numbers, numbers or strings"
            )
        arrays[item.name] = value
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    with open(partial, "wb") as file:
        np.savez(file, __class__=np.array(type(state).__qualname__), **arrays)
    os.replace(partial, path)  # an interruption leaves the old file or the new one


def load_state(path: str | os.PathLike[str], cls: type[Any]) -> Any:
    """Load a state that :func:`save_state` wrote.

    Parameters
    ----------
    path : path
        The file.
    cls : type
        The dataclass that was saved.

    Returns
    -------
    state : instance of `cls`

    Raises
    ------
    DataError
        If the file is damaged, holds a state of another class, or fields with other names.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from lissome.structure import VectorState, load_state, save_state
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "state.npz"
    ...     save_state(file, VectorState([1.0, 2.0]))
    ...     load_state(file, VectorState)
    VectorState(x=array([1., 2.]))
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise
    except UNREADABLE as error:
        raise DataError(
            f"the file {path} is not a saved state, or it is damaged: {error}"
        ) from error
    kind = str(arrays.pop("__class__", "")) or "an unknown class"
    if kind != cls.__qualname__:
        raise DataError(f"the file {path} holds {kind}; {cls.__qualname__} was asked for")
    fields = {item.name: item for item in dataclasses.fields(cls) if item.init}
    if set(fields) != set(arrays):
        raise DataError(
            f"the file {path} holds the fields {sorted(arrays)}; {cls.__qualname__} has "
            f"{sorted(fields)}: it was saved by another version"
        )
    values: dict[str, Any] = {}
    for name, array in arrays.items():
        annotation = fields[name].type
        plain = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", "")
        if plain in _SCALARS:
            if array.shape != ():
                raise DataError(f"field `{name}` of {path} has shape {array.shape}; it must be ()")
            values[name] = _SCALARS[plain](array[()])
        else:
            values[name] = array
    try:
        return cls(**values)
    except (ValueError, TypeError) as error:
        raise DataError(
            f"the fields of {path} do not make a {cls.__qualname__}: {error}"
        ) from error
