r"""Laws of the user's own: one numpy function, or an energy written in SymPy.

Both kinds work with strain densities (1/length), so that they never depend on the mesh, and are
checked once, when they are made, by :func:`~lissome.rods.check_law`.
"""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._compile import jit
from .._validate import finite, one_of, positive
from ..errors import InvalidInput
from .law_checks import check_law, checked_values, refuse_not_finite
from .laws import (
    ROD_STRAINS,
    CompiledLaw,
    LawValues,
    common_count,
    row_indices,
    strain_array,
    table,
    varying,
)

__all__ = ["FunctionLaw", "SymbolicLaw"]

Array = NDArray[np.float64]


def _names(strains: Iterable[str]) -> tuple[str, ...]:
    if isinstance(strains, str):
        raise InvalidInput(
            f"argument `strains` is {strains!r}; pass a sequence of names such as {ROD_STRAINS}"
        )
    names = tuple(strains)
    if (
        not names
        or not all(isinstance(name, str) for name in names)
        or len(set(names)) < len(names)
    ):
        raise InvalidInput(f"argument `strains` is {names!r}; pass different names, at least one")
    return names


def _parameters(parameters: Mapping[str, Any] | None) -> Mapping[str, float | Array]:
    values = dict(parameters or {})
    for name in values:
        if not isinstance(name, str) or not name.isidentifier() or keyword.iskeyword(name):
            raise InvalidInput(
                f"argument `parameters` has the key {name!r}; pass the names of arguments"
            )
    return MappingProxyType(
        {name: varying(f"parameters[{name}]", value, finite) for name, value in values.items()}
    )


@dataclass(frozen=True, eq=False)
class FunctionLaw:
    r"""A law given as one numpy function of arrays of strains.

    Parameters
    ----------
    function : callable
        ``function(k, **parameters)`` with strain densities k, shape (n, m), m named strains. It
        returns (W, stress, stiffness): energy per unit length, shape (n,), its derivative, shape
        (n, m), and second derivative, shape (n, m, m). Each row is a hinge of its own. An energy of
        +inf says that a strain is outside the domain of the law: a solver then shortens its step.
    strains : sequence of str
        Names of the strains; those of a rod by default.
    parameters : mapping, optional
        Keyword arguments of the function: numbers, or arrays with one number for each node. Of the
        latter it receives vectors of shape (n,), one number for each row of k.
    scale : float
        Size of the strain densities (1/length) at which derivatives are checked.
    check_at : array_like, shape (p, m), optional
        Strain densities at which derivatives are checked instead.

    Raises
    ------
    InvalidInput
        When the law is made: if shapes are wrong, values are not finite, a row depends on another,
        or a derivative does not fit; the message names the component. Later: if a shape is wrong or
        a value is not a number; the message names row and strains.

    Examples
    --------
    A rod that hardens in bending:

    >>> import numpy as np
    >>> from lissome.rods.user_laws import FunctionLaw
    >>> def hardening(k, c):
    ...     square = k[:, 0] ** 2 + k[:, 1] ** 2
    ...     bend = np.array([1.0, 1.0, 0.0])
    ...     energy = square / 2 + square**2 / 4 + c * k[:, 2] ** 2 / 2
    ...     stress = k * bend * (1 + square)[:, None] + k * [0, 0, c]
    ...     stiffness = (1 + square)[:, None, None] * np.diag(bend) + np.diag([0, 0, c])
    ...     b = k * bend
    ...     return energy, stress, stiffness + 2 * b[:, :, None] * b[:, None, :]
    >>> law = FunctionLaw(hardening, parameters={"c": 0.8})
    >>> print(law.energy([[1.0, 0.0, 0.0]]))
    [0.75]
    """

    function: Callable[..., tuple[ArrayLike, ArrayLike, ArrayLike]]
    strains: tuple[str, ...] = ROD_STRAINS
    parameters: Mapping[str, Any] = field(default_factory=dict)
    scale: float = 1.0
    check_at: ArrayLike | None = field(default=None, repr=False)
    kernel: None = field(default=None, init=False, repr=False)
    count: int | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise InvalidInput(
                f"argument `function` is {self.function!r}; pass a function of strain densities "
                "that returns (W, stress, stiffness)"
            )
        object.__setattr__(self, "strains", _names(self.strains))
        object.__setattr__(self, "parameters", _parameters(self.parameters))
        object.__setattr__(self, "scale", positive("scale", self.scale))
        object.__setattr__(self, "count", common_count(**self.parameters))
        check_law(self, self.scale, points=self.check_at)

    def at(self, rows: ArrayLike) -> FunctionLaw:
        """Return the law of some nodes; a uniform law ignores them."""
        if self.count is None:
            return self
        indices = row_indices(rows, self.count)
        chosen = object.__new__(FunctionLaw)
        parameters = {
            name: value[indices] if isinstance(value, np.ndarray) else value
            for name, value in self.parameters.items()
        }
        for name in ("function", "strains", "scale", "check_at", "kernel"):
            object.__setattr__(chosen, name, getattr(self, name))
        object.__setattr__(chosen, "parameters", MappingProxyType(parameters))
        object.__setattr__(chosen, "count", indices.size)
        return chosen

    def evaluate(self, k: Array, order: int = 2) -> LawValues:
        """Return energy, stress and stiffness, all per unit length.

        Parameters
        ----------
        k : array_like, shape (n, m)
            Strain densities (1/length), natural strains subtracted.
        order : {0, 1, 2}
            What exceeds it is None.

        Raises
        ------
        InvalidInput
            If the function fails or returns a wrong shape, or a value that is not finite.
        """
        k = strain_array(k, self.strains, self.count)
        name = f"the law function {getattr(self.function, '__name__', '')!r}"
        result = self.function(k.copy(), **self.parameters)
        values = checked_values(result, k.shape[0], self.strains, order, name)
        refuse_not_finite(values, k, self.strains, name, barrier=True)
        return values

    def energy(self, k: Array) -> Array:
        """Return the energy per unit length, shape (n,), of strain densities `k`, shape (n, 3)."""
        return self.evaluate(k, 0)[0]

    def is_elliptic(self, k: Array) -> NDArray[np.bool_]:
        """Return where the stiffness at the strain densities `k` is positive definite, shape (n,)."""
        stiffness = self.evaluate(k, 2)[2]
        assert stiffness is not None
        return np.asarray(np.linalg.eigvalsh(stiffness)[:, 0] > 0.0)

    def __reduce__(self) -> tuple[Any, ...]:
        # Read-only mappings cannot be pickled. What was checked once is not checked again.
        names = ("function", "strains", "parameters", "scale", "check_at", "count")
        state = {name: getattr(self, name) for name in names}
        return _restored, ({**state, "parameters": dict(self.parameters)},)


def _restored(state: dict[str, Any]) -> FunctionLaw:
    law = object.__new__(FunctionLaw)
    for name, value in state.items():
        object.__setattr__(law, name, value)
    object.__setattr__(law, "parameters", MappingProxyType(state["parameters"]))
    object.__setattr__(law, "kernel", None)
    return law


# ---------------------------------------------------------------------------------------------
# From an energy in SymPy

# More operations than this take many seconds to compile; numpy then takes over.
_LARGEST_COMPILED = 2000
_BACKENDS = ("auto", "compiled", "numpy")


@dataclass(frozen=True, eq=False)
class SymbolicLaw(CompiledLaw):
    r"""A law given as an energy per unit length in SymPy; stress and stiffness are derived.

    Energy, both derivatives and their common subexpressions make one function.

    Parameters
    ----------
    density : sympy expression
        Energy per unit length as a function of the strain densities.
    variables : sequence of sympy symbols
        The strain densities, in the order of `names`.
    values : mapping, optional
        Values of all other symbols, by symbol or by name: numbers, or arrays with one number for each
        node.
    names : sequence of str
        Names of the strains; those of a rod by default.
    backend : {"auto", "compiled", "numpy"}
        Whether the function is compiled, or calls numpy. "auto" compiles unless the function is very
        long or uses what only scipy has, such as Bessel functions; see the property `compiled`.
    scale : float
        Size of the strain densities (1/length) at which derivatives are checked.
    check_at : array_like, shape (p, m), optional
        Strain densities at which derivatives are checked instead.

    Raises
    ------
    InvalidInput
        If a symbol has no value, a value no symbol, if the backend cannot express the energy, or if it
        is not finite or not smooth where it is checked.

    Examples
    --------
    >>> import sympy
    >>> from lissome.rods.user_laws import SymbolicLaw
    >>> k1, k2, k3, b = sympy.symbols("k1 k2 k3 b")
    >>> law = SymbolicLaw((b * k1**2 + k2**2 + k3**2) / 2 + k3**4, (k1, k2, k3), {b: 4})
    >>> print(law.evaluate([[1.0, 0.0, 1.0]])[1])
    [[4. 0. 5.]]
    """

    density: Any
    variables: Any
    values: Any = field(default_factory=dict)
    names: Any = ROD_STRAINS
    backend: str = "auto"
    scale: float = 1.0
    check_at: ArrayLike | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        import sympy

        names = _names(self.names)
        try:
            density = sympy.sympify(self.density)
            variables = tuple(sympy.sympify(v) for v in self.variables)
        except (sympy.SympifyError, TypeError) as error:
            raise InvalidInput(
                f"arguments `density` and `variables` must be a SymPy expression and its symbols: {error}"
            ) from error
        if not isinstance(density, sympy.Expr):
            raise InvalidInput(f"argument `density` is {density!r}; pass one scalar expression")
        if not all(isinstance(v, sympy.Symbol) for v in variables) or len(set(variables)) < len(
            names
        ):
            raise InvalidInput(
                f"argument `variables` is {variables}; pass {len(names)} different symbols, one for each "
                f"of {names}"
            )
        if len(variables) != len(names):
            raise InvalidInput(
                f"argument `variables` has {len(variables)} symbols; there are {len(names)} strains: "
                f"{', '.join(names)}"
            )
        given = _parameters({str(key): value for key, value in dict(self.values).items()})
        others = sorted(density.free_symbols - set(variables), key=str)
        missing = [s for s in others if str(s) not in given]
        unknown = set(given) - {str(s) for s in others}
        if missing or unknown:
            raise InvalidInput(
                f"argument `values` has no value for {missing}"
                if missing
                else f"argument `values` names {sorted(unknown)}, which the energy does not contain"
            )
        one_of("backend", self.backend, _BACKENDS)
        common_count(**given)
        object.__setattr__(self, "density", density)
        object.__setattr__(self, "variables", variables)
        object.__setattr__(self, "values", given)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "strains", names)
        object.__setattr__(self, "scale", positive("scale", self.scale))
        columns = [given[str(s)] for s in others] or [0.0]
        object.__setattr__(self, "parameters", table(*columns))
        function, compiled = _from_energy(density, variables, others, self.backend)
        object.__setattr__(self, "_function", function)
        object.__setattr__(self, "kernel", function if compiled else None)
        check_law(self, self.scale, points=self.check_at)

    @property
    def compiled(self) -> bool:
        """Whether the function is compiled (else it calls numpy)."""
        return self.kernel is not None

    def at(self, rows: ArrayLike) -> SymbolicLaw:
        """Return the law of some nodes; a uniform law ignores them."""
        chosen = super().at(rows)
        if chosen is not self:
            indices = row_indices(rows, self.parameters.shape[0])
            given = {
                name: value[indices] if isinstance(value, np.ndarray) else value
                for name, value in self.values.items()
            }
            object.__setattr__(chosen, "values", MappingProxyType(given))
            for name in ("strains", "kernel", "_function"):
                object.__setattr__(chosen, name, getattr(self, name))
        return chosen

    def evaluate(self, k: Array, order: int = 2) -> LawValues:
        """Return energy, stress and stiffness, all per unit length; see :class:`FunctionLaw`."""
        values = super().evaluate(k, order)
        refuse_not_finite(values, np.asarray(k), self.strains, "the symbolic law", barrier=True)
        return values

    def evaluate_into(
        self, k: Array, energy: Array, stress: Array, stiffness: Array, order: int = 2
    ) -> None:
        """Write energy, stress and stiffness into arrays; nothing is checked."""
        function = self._function  # type: ignore[attr-defined]
        if self.compiled:
            function(self.parameters, k, energy, stress, stiffness, order)
            return
        with np.errstate(all="ignore"):  # what is not finite is refused or rejected by the caller
            function(self.parameters, k, energy, stress, stiffness, order)

    def __reduce__(self) -> tuple[Any, ...]:
        options = (self.names, self.backend, self.scale, self.check_at)
        return SymbolicLaw, (self.density, self.variables, dict(self.values), *options)


def _from_energy(density: Any, variables: Any, others: Any, backend: str) -> tuple[Any, bool]:
    """Return ``function(parameters, k, energy, stress, stiffness, order)``, and if it is compiled."""
    import sympy
    from sympy.printing.codeprinter import PrintMethodNotImplementedError
    from sympy.printing.numpy import SciPyPrinter
    from sympy.printing.pycode import PythonCodePrinter

    # Real symbols with names of our own: derivatives of |x| and roots need to know.
    m = len(variables)
    strains = [sympy.Symbol(f"strain_{a}", real=True) for a in range(m)]
    constants = [sympy.Symbol(f"constant_{a}", real=True) for a in range(len(others))]
    renamed = dict(zip((*variables, *others), (*strains, *constants), strict=True))
    energy = density.xreplace(renamed)
    stress = [sympy.diff(energy, s) for s in strains]
    stiffness = [sympy.diff(stress[a], strains[b]) for a in range(m) for b in range(a, m)]
    common, results = sympy.cse(
        [energy, *stress, *stiffness], symbols=sympy.numbered_symbols("common_")
    )
    if any(
        r.has(sympy.DiracDelta, sympy.Derivative, sympy.Subs)
        for r in (*results, *dict(common).values())
    ):
        raise InvalidInput(
            f"argument `density` is {density}; its second derivatives must be ordinary functions "
            "(for laws in pieces use sympy.Piecewise)"
        )

    def source(printer: Any, loop: bool) -> str:
        row, column = ("i", "row") if loop else (":", ":")
        lines = [f"{s} = k[{row}, {a}]" for a, s in enumerate(strains)]
        lines += [f"{c} = parameters[{column}, {a}]" for a, c in enumerate(constants)]
        lines += [f"{name} = {printer.doprint(value)}" for name, value in common]
        printed = [printer.doprint(value) for value in results]
        lines += [f"energy[{row}] = {printed[0]}", "if order >= 1:"]
        lines += [f"    stress[{row}, {a}] = {printed[1 + a]}" for a in range(m)]
        lines += ["if order >= 2:"]
        pairs = [(a, b) for a in range(m) for b in range(a, m)]
        for value, (a, b) in zip(printed[1 + m :], pairs, strict=True):
            lines += [f"    stiffness[{row}, {a}, {b}] = {value}"]
            if a != b:
                lines += [f"    stiffness[{row}, {b}, {a}] = stiffness[{row}, {a}, {b}]"]
        head = ["def symbolic_law(parameters, k, energy, stress, stiffness, order):"]
        if loop:
            head += [
                "    step = 0 if parameters.shape[0] == 1 else 1",
                "    for i in range(k.shape[0]):",
                "        row = i * step",
            ]
        indent = " " * (8 if loop else 4)
        return "\n".join([*head, *(indent + line for line in lines)]) + "\n"

    def made(text: str, modules: dict[str, Any]) -> Any:
        space: dict[str, Any] = {"__name__": __name__, **modules}
        exec(compile(text, "<energy of a SymbolicLaw>", "exec"), space)
        return space["symbolic_law"]

    long = sympy.count_ops([*results, *(value for _, value in common)]) > _LARGEST_COMPILED
    if backend == "compiled" or (backend == "auto" and not long):
        try:
            text = source(PythonCodePrinter({"strict": True}), loop=True)
            return jit(made(text, {"math": math}), error_model="numpy"), True
        except PrintMethodNotImplementedError as error:
            if backend == "compiled":
                raise InvalidInput(
                    f"argument `density` has functions that cannot be compiled ({error}); use "
                    "backend='numpy'"
                ) from error
    try:
        text = source(SciPyPrinter({"strict": True}), loop=False)
    except PrintMethodNotImplementedError as error:
        raise InvalidInput(
            f"argument `density` has functions that neither numpy nor scipy knows ({error})"
        ) from error
    import scipy.special

    return made(text, {"numpy": np, "scipy": scipy}), False
