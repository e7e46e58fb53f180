"""What a branch is made of: its rows, its events, and the settings that determine it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._corrector import typical_size
from ._stored import without_what_cannot_travel
from ._validate import finite, finite_array, integer_at_least, one_of, positive
from .equilibrium import Equilibrium
from .errors import InvalidInput, NotConverged

Array = NDArray[np.float64]
Outputs = Mapping[str, Callable[[Equilibrium], float]]


class BranchInterrupted(NotConverged):
    """A branch could not be followed to its end. What was found is attached.

    Parameters
    ----------
    message : str
        Where the branch ended, and what to try.
    branch : Branch, optional
        What was found.
    history, state : object, optional
        Record of the last correction, and the last state.

    Attributes
    ----------
    branch : Branch
        All equilibria up to the interruption.
    history, state : object or None
        Record of the last correction, and the last state of the branch.

    Examples
    --------
    What was found before the interruption is not lost:

    >>> import lissome as ls
    >>> def fork(p):
    ...     return ls.DenseStructure(
    ...         initial=[0.4],
    ...         energy=lambda x: x[0] ** 4 / 4 - p * x[0] ** 2 / 2,
    ...         gradient=lambda x: x**3 - p * x,
    ...         hessian=lambda x: [[3 * x[0] ** 2 - p]],
    ...     )
    >>> try:
    ...     ls.follow(fork, start=1.0, stop=2.0, max_steps=2)
    ... except ls.branch.BranchInterrupted as error:
    ...     print(error.branch.finished, len(error.branch))
    False 3
    """

    def __init__(
        self, message: str = "", *, branch: Any = None, history: Any = None, state: Any = None
    ) -> None:
        super().__init__(message, history=history, state=state)
        self.branch = branch

    def __reduce__(self) -> tuple[Any, ...]:
        return without_what_cannot_travel(super().__reduce__(), "branch")


@dataclass(frozen=True, eq=False)
class Event:
    """Something that happened on a branch.

    Attributes
    ----------
    kind : str
        ``"fold"``, ``"bifurcation"``, ``"snap"`` or ``"end"`` (the branch closed upon itself or left
        its bounds).
    parameter : float
        Where.
    uncertainty : float
        Half-width of the interval around `parameter` that brackets the event.
    arclength : float
        Where, along the branch.
    equilibrium : Equilibrium
        The state at the event, from the side with the smaller index; at a snap, the state before it.
    row : int
        Its row in the table.
    equilibrium_parameter : float
        The parameter at which `equilibrium` is balanced: within `uncertainty` of `parameter`.
    modes : ndarray, shape (k, n)
        Critical modes, orthonormal in the metric; k is 1 unless several eigenvalues vanish together.
        At a fold the mode points along the direction of travel; elsewhere its entry of largest size
        is positive.
    index_before, index_after : int
        Numbers of unstable directions on either side.
    direction : (ndarray, ndarray, float)
        Tangent of the branch in unknowns, multipliers and parameter, of unit arclength.
    after : Equilibrium or None
        At a snap, the stable state after it.
    after_row : int
        Its row in the table; -1 without one.
    energy_released : float or None
        At a snap, the potential energy before minus that after, at the frozen parameter.
    detail : str
        In words.

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
    >>> (event,) = ls.follow(fork, start=-1.0, stop=1.0).events
    >>> print(event.kind, round(event.parameter, 6) + 0.0, event.index_before, event.index_after)
    bifurcation 0.0 0 1
    >>> print(event.mode)
    [1.]
    """

    kind: str
    parameter: float
    uncertainty: float
    arclength: float
    equilibrium: Equilibrium = field(repr=False)
    row: int
    modes: Array = field(repr=False)
    index_before: int
    index_after: int
    direction: tuple[Array, Array, float] = field(repr=False)
    equilibrium_parameter: float = math.nan
    after: Equilibrium | None = field(default=None, repr=False)
    after_row: int = -1
    energy_released: float | None = None
    detail: str = ""

    @property
    def before(self) -> Equilibrium:
        """The state before a snap: `equilibrium`."""
        return self.equilibrium

    @property
    def mode(self) -> Array:
        """The critical mode, shape (n,); the first of several."""
        return self.modes[0]


@dataclass(frozen=True, eq=False)
class Row:
    kind: str
    parameter: float
    arclength: float
    smallest_eigenvalue: float
    index: int
    marginal: bool
    outputs: dict[str, float]
    equilibrium: Equilibrium

    @property
    def stable(self) -> bool:
        return self.index == 0 and not self.marginal


@dataclass(frozen=True)
class Settings:
    """What determines a branch, besides its family; plain values that JSON can hold."""

    start: float
    stop: float
    lower: float | None
    upper: float | None
    report_at: tuple[float, ...]
    on_fold: str
    sign: int
    step: float
    max_step: float
    max_steps: int
    tolerance: float
    event_tolerance: float
    overshoot: float
    eigenvalues: bool
    outputs: tuple[str, ...]
    scale: float  # of the unknowns
    initial: str = ""  # digest of the state to begin from, where there is a checkpoint

    @property
    def range(self) -> float:
        """The scale of the parameter."""
        return abs(self.stop - self.start)


def checked_sign(sign: int) -> int:
    """Return +1 or -1, or raise InvalidInput."""
    if sign not in (1, -1):
        raise InvalidInput(f"argument `sign` is {sign!r}; it must be +1 or -1")
    return int(sign)


def checked_settings(
    structure: Any,
    state: Any,
    start: float,
    stop: float,
    *,
    report_at: Any,
    on_fold: str,
    step: float | None,
    max_step: float | None,
    max_steps: int,
    bounds: Any,
    sign: int,
    tolerance: float,
    event_tolerance: float,
    overshoot: float,
    eigenvalues: bool,
    scale: float | None,
    outputs: Outputs,
    switching: bool = False,
) -> Settings:
    """Return the settings of a branch from the arguments of a call, checked."""
    length = abs(stop - start)
    reports = () if report_at is None else finite_array("report_at", report_at, shape=(None,))
    lower, upper = (None, None) if bounds is None else bounds
    lower = None if lower is None else finite("bounds[0]", lower)
    upper = None if upper is None else finite("bounds[1]", upper)
    for value, name in ((start, "start"), (stop, "stop")):
        if (lower is not None and value < lower) or (upper is not None and value > upper):
            # A switched branch keeps the scales of its parent, whatever its own bounds.
            if switching:
                continue
            raise InvalidInput(
                f"argument `{name}` is {value}; it must lie within `bounds` {bounds}"
            )
    for name, function in outputs.items():
        if not isinstance(name, str) or not callable(function):
            raise InvalidInput(
                f"argument `outputs` maps {name!r} to {function!r}; it must map names to functions"
            )
        if name in ("parameter", "energy", "smallest_eigenvalue", "index", "stable", "kind",
                    "arclength"):  # fmt: skip
            raise InvalidInput(f"argument `outputs` redefines the column {name!r}; rename it")
    longest = length / 10 if max_step is None else positive("max_step", max_step)
    if scale is None:
        metric = np.asarray(structure.metric(state), dtype=float)
        scale = float(np.sqrt(np.sum(metric * typical_size(structure, state) ** 2)))
    return Settings(
        start=start,
        stop=stop,
        lower=lower,
        upper=upper,
        report_at=tuple(sorted({float(p) for p in reports})),
        on_fold=one_of("on_fold", on_fold, ("turn", "snap", "stop")),
        sign=checked_sign(sign),
        step=min(length / 40, longest) if step is None else min(positive("step", step), longest),
        max_step=longest,
        max_steps=integer_at_least("max_steps", max_steps, 1),
        tolerance=positive("tolerance", tolerance),
        event_tolerance=positive("event_tolerance", event_tolerance),
        overshoot=positive("overshoot", overshoot),
        eigenvalues=bool(eigenvalues),
        outputs=tuple(outputs),
        scale=positive("scale", scale),
    )
