r"""Follow equilibria as a parameter moves: folds, bifurcations, snaps, and switching.

A *family* is a function from a number, the parameter p, to a structure. Its equilibria
:math:`r(x, \lambda, p) = 0` form curves (branches). :func:`follow` walks along one of them with a
tangent predictor,

.. math:: K \begin{pmatrix} x' \\ \lambda' \end{pmatrix} = -\frac{\partial r}{\partial p},

and Newton's method as corrector: at a fixed parameter where the branch runs along the parameter, and
in the plane orthogonal to the tangent (pseudo-arclength) where it turns. The arclength is measured
in the structure's metric,

.. math:: ds^2 = \frac{dx \cdot M dx}{X^2} + \frac{dp^2}{P^2},

with P the length of the interval to follow and X a typical size of the unknowns, so that steps do
not depend on the mesh.

At every accepted state the inertia of the KKT matrix K tells the number of unstable directions (the
*index*). Where it changes there is a critical state in between, which is bracketed along the branch
until the bracket is short. At a *fold* the parameter turns; at a *bifurcation* it does not, and
another branch crosses.
"""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from . import _archive
from ._corrector import (
    CONTRACTION,
    TOLERANCE,
    Balanced,
    CorrectionFailed,
    Family,
    Slope,
    as_balanced,
    as_equilibrium,
    correct,
    correct_on_plane,
    critical_modes,
    gauge_of,
    lowest_of_stable,
    member,
    typical_size,
)
from ._descent import descend
from ._stored import fits, pack_equilibria, unpack_equilibria, without_what_cannot_travel
from ._validate import finite, finite_array, integer_at_least, one_of, positive
from .equilibrium import Equilibrium, equilibrate
from .errors import (
    DataError,
    FactorizationError,
    InvalidInput,
    NotConverged,
    StabilityNotResolvable,
)
from .sensitivities import implicit_derivative, residual_slope
from .stability import smallest_eigenvalue

__all__ = ["Branch", "BranchInterrupted", "Event", "follow"]

Array = NDArray[np.float64]
Outputs = Mapping[str, Callable[[Equilibrium], float]]

# A step is natural (at a fixed parameter) while the tangent has at least this share of parameter.
_NATURAL = 0.3
# Accepted distance between prediction and correction, as a fraction of the step.
_LARGEST_DEVIATION = 0.35
# The deviation that the choice of steps aims at.
_WANTED_DEVIATION = 0.08
# Tangents at the ends of a step must agree to this cosine.
_LARGEST_TURN = math.cos(math.radians(40.0))
_SHORTEST_STEP = 1e-9
# Factors that are no simple fractions keep halved steps off symmetric parameter values.
_SHORTER = 0.4713


class BranchInterrupted(NotConverged):
    """A branch could not be followed to its end. What was found is attached.

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


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class _Row:
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
class _Settings:
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


@dataclass(frozen=True)
class Branch:
    """Equilibria along a branch, in order, and what happened on the way.

    Attributes
    ----------
    table : pandas.DataFrame
        One row for each equilibrium: ``parameter``, ``energy``, ``smallest_eigenvalue`` (of the second
        variation in the metric; NaN where rounding hides it, or where the constraints leave nothing
        free), ``index`` (number of unstable directions), ``stable``, ``kind`` (``"reported"``,
        ``"step"`` or ``"event"``), ``arclength``, and the user's outputs.
    equilibria : tuple of Equilibrium
        The states of the rows.
    events : tuple of Event
    finished : bool
        Whether the branch came to its end; False for what an interruption has left.

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
    >>> branch = ls.follow(fork, start=-1.0, stop=1.0)
    >>> print(branch.table[["parameter", "stable"]].iloc[[0, -1]].to_string(index=False))
     parameter  stable
          -1.0    True
           1.0   False
    >>> side = branch.switch(branch.events[0])
    >>> print(side.equilibria[-1].state.x.round(9), side.finished)
    [1.] True
    """

    family: Family = field(repr=False)
    events: tuple[Event, ...]
    finished: bool
    rows: tuple[_Row, ...] = field(repr=False)
    settings: _Settings = field(repr=False)
    outputs: Outputs = field(repr=False)
    derivative: Slope | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """The states of the rows of the table."""
        return tuple(row.equilibrium for row in self.rows)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row for each equilibrium."""
        data: dict[str, Any] = {
            "parameter": np.array([row.parameter for row in self.rows], dtype=float),
            "energy": np.array([row.equilibrium.energy for row in self.rows], dtype=float),
            "smallest_eigenvalue": np.array(
                [row.smallest_eigenvalue for row in self.rows], dtype=float
            ),
            "index": np.array([row.index for row in self.rows], dtype=int),
            "stable": np.array([row.stable for row in self.rows], dtype=bool),
            "kind": [row.kind for row in self.rows],
            "arclength": np.array([row.arclength for row in self.rows], dtype=float),
        }
        for name in self.settings.outputs:
            data[name] = np.array([row.outputs[name] for row in self.rows], dtype=float)
        return pd.DataFrame(data)

    def switch(
        self,
        event: Event,
        sign: int = 1,
        *,
        stop: float | None = None,
        bounds: tuple[float, float] | None = None,
        mode: int | Array = 0,
        amplitude: float | None = None,
        **options: Any,
    ) -> Branch:
        """Follow the branch that crosses this one at a bifurcation.

        The first state is looked for at a given distance from the bifurcation along the critical mode,
        with the parameter free: this finds the crossing branch of a pitchfork and of a transcritical
        point, and of the latter both halves, one with each sign.

        Parameters
        ----------
        event : Event
            A bifurcation of this branch.
        sign : int
            +1 or -1: along the critical mode or against it.
        stop : float, optional
            Parameter at which the new branch ends; by default both the start and the stop of this
            branch are its bounds.
        bounds : (float, float), optional
            The interval of the parameter; the branch ends where it leaves it.
        mode : int or ndarray, shape (n,), optional
            Which of several critical modes, or a direction: several eigenvalues that vanish together
            have modes that are arbitrary within their span, and branches leave along some directions
            of it only.
        amplitude : float, optional
            Distance of the first state, in units of the arclength. By default several are tried.
        **options
            Anything that :func:`follow` takes, to replace the settings of this branch:
            ``report_at``, ``on_fold``, ``step``, ``max_step``, ``max_steps``, ``outputs``, ...

        Returns
        -------
        Branch
            Its first row is the bifurcation.

        Raises
        ------
        InvalidInput
            If `event` is not a bifurcation of this branch, or `sign` is neither +1 nor -1.
        BranchInterrupted
            If no state is found on the crossing branch, or it cannot be followed to its end.
        """
        if event.kind != "bifurcation" or not any(event is known for known in self.events):
            raise InvalidInput(
                f"argument `event` is a {event.kind} at {event.parameter:.6g}; switching needs a "
                "bifurcation out of the `events` of the same branch"
            )
        _check_sign(sign)
        if isinstance(mode, (int, np.integer)):
            mode = int(mode)
            if not 0 <= mode < event.modes.shape[0]:
                raise InvalidInput(
                    f"argument `mode` is {mode}; the event has {event.modes.shape[0]} critical modes"
                )
        else:
            mode = finite_array("mode", mode, shape=(event.modes.shape[1],))
            if not np.any(mode):
                raise InvalidInput("argument `mode` is zero; it must be a direction")
        outputs = options.pop("outputs", self.outputs)
        old = self.settings
        if bounds is None:
            ends = (old.start, old.stop if stop is None else finite("stop", stop))
            bounds = (min(*ends, event.parameter), max(*ends, event.parameter))
        keep: dict[str, Any] = {
            "on_fold": "turn" if old.on_fold == "stop" else old.on_fold, "sign": old.sign,
            "step": old.step, "max_step": old.max_step, "max_steps": old.max_steps,
            "tolerance": old.tolerance, "event_tolerance": old.event_tolerance,
            "overshoot": old.overshoot, "eigenvalues": old.eigenvalues, "scale": old.scale,
            "report_at": old.report_at,
        }  # fmt: skip
        unknown = set(options) - set(keep)
        if unknown:
            raise InvalidInput(f"unknown options {sorted(unknown)}; known are {sorted(keep)}")
        settings = _settings(
            event.equilibrium.structure, event.equilibrium.state, old.start, old.stop,
            bounds=bounds, outputs=outputs, switching=True, **{**keep, **options},
        )  # fmt: skip
        follower = _Follower(self.family, settings, outputs, None, 0.0, self.derivative)
        follower.begin_at_bifurcation(event, sign, mode, amplitude)
        return follower.run()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the branch to one ``.npz`` file (arrays and JSON, no pickle), all or nothing."""
        meta, arrays = _pack(self)
        _archive.write(path, meta, arrays)

    @staticmethod
    def load(
        path: str | os.PathLike[str], family: Family, outputs: Outputs | None = None
    ) -> Branch:
        """Read a branch that :meth:`save` or a checkpoint wrote.

        Parameters
        ----------
        path : path
        family : callable
            The family that was followed: structures are not in the file.
        outputs : mapping, optional
            The functions of the outputs, which :meth:`switch` needs; their values are in the file.

        Raises
        ------
        DataError
            If the file is damaged, or its states are not equilibria of `family`.
        """
        meta, arrays = _archive.read(path, "branch")
        return _unpack(meta, arrays, family, outputs or {}, path)


def follow(
    family: Family,
    start: float,
    stop: float,
    report_at: Sequence[float] | Array | None = None,
    on_fold: str = "turn",
    *,
    initial: Any = None,
    outputs: Outputs | None = None,
    step: float | None = None,
    max_step: float | None = None,
    max_steps: int = 1000,
    bounds: tuple[float | None, float | None] | None = None,
    sign: int = 1,
    tolerance: float = TOLERANCE,
    event_tolerance: float = 1e-9,
    overshoot: float = 1e-6,
    eigenvalues: bool = True,
    scale: float | None = None,
    residual_derivative: Slope | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = 2.0,
) -> Branch:
    r"""Follow the equilibria of a family of structures from one parameter value to another.

    Parameters
    ----------
    family : callable
        Function from the parameter, a number, to a :class:`~lissome.structure.Structure`. All structures
        of a family have the same unknowns and constraints.
    start, stop : float
        First and last value of the parameter; `stop` may be smaller. The branch ends where it first
        comes to `stop`, even if it turned on the way.
    report_at : array_like, optional
        Parameter values at which states are wanted. They are hit exactly, every time the branch
        passes them. (A snap passes what lies within its `overshoot` without a row of its own.)
    on_fold : {"turn", "snap", "stop"}
        ``"turn"``: follow the smooth curve, around folds and through bifurcations; rows say what is
        stable. ``"stop"``: end at the first fold, or at the first bifurcation where stability is lost.
        ``"snap"``: where stability is lost, at a fold or at a bifurcation, freeze the parameter just
        beyond, descend to a stable state, and go on from there.
    initial : state or Equilibrium, optional
        Where to begin: a state to find a stable equilibrium from (by default the structure's own
        start), or an equilibrium of `start` or close by, of any index.
    outputs : mapping of str to callable, optional
        Functions from an equilibrium to a number; each becomes a column of the table.
    step, max_step : float, optional
        First and longest step, in units of the parameter (default 1/40 and 1/10 of the interval).
    max_steps : int, optional
        Number of steps after which the attempt is given up.
    bounds : (float, float), optional
        Interval of the parameter that the branch may not leave; None for an open side. By default
        only `stop` ends a branch, since loops may reach back beyond `start`.
    sign : int, optional
        +1 or -1: along which side of the critical mode a snap at a bifurcation descends. (At a fold the
        side is the direction of travel.)
    tolerance : float, optional
        Relative size of the corrections at which a state is accepted.
    event_tolerance : float, optional
        Length of the bracket, relative to the interval, to which events are located.
    overshoot : float, optional
        How far beyond a loss of stability a snap happens, relative to the interval.
    eigenvalues : bool, optional
        Whether the table has the smallest eigenvalue of each state; otherwise NaN. Where it comes
        near zero, steps are looked at more closely: without it more can go unseen (see Notes).
    scale : float, optional
        Size X of the unknowns, in the metric norm, that counts as much as the whole interval of the
        parameter; by default the structure's typical sizes.
    residual_derivative : callable, optional
        Function of parameter, state and multipliers that returns the derivatives of the gradient of
        the Lagrangian and of the constraints with respect to the parameter, shapes (n,) and (m,). By
        default they are found by differences, which costs two evaluations for each step.
    checkpoint : path, optional
        File that is written as the branch grows. If it exists, the same call goes on from it; a call
        with other arguments is refused, and a family of other constants as soon as the last state
        is no equilibrium of it.
    checkpoint_every : float, optional
        Seconds between two writings.

    Returns
    -------
    Branch

    Raises
    ------
    InvalidInput
        If an argument is wrong, or the checkpoint belongs to another call.
    BranchInterrupted
        If steps become too short or too many; its attribute `branch` holds what was found.
    NotConverged, Unstable
        If there is no stable state at `start`.

    Notes
    -----
    Two changes of the index that undo each other within one step and leave the direction of the
    parameter as it was go unseen; `max_step` bounds what can be missed.

    Examples
    --------
    A pitchfork: the straight state loses its stability at 1.

    >>> import numpy as np
    >>> from lissome import DenseStructure, follow
    >>> def family(p):
    ...     return DenseStructure(
    ...         initial=[0.0],
    ...         energy=lambda x: x[0] ** 4 / 4 + (1 - p) * x[0] ** 2 / 2,
    ...         gradient=lambda x: x**3 + (1 - p) * x,
    ...         hessian=lambda x: np.diag(3 * x**2 + 1 - p),
    ...     )
    >>> trivial = follow(family, start=0.0, stop=2.0)
    >>> [(event.kind, round(event.parameter, 6)) for event in trivial.events]
    [('bifurcation', 1.0)]
    >>> buckled = trivial.switch(trivial.events[0])
    >>> print(buckled.equilibria[-1].state.x.round(9), bool(buckled.table.stable.iloc[-1]))
    [1.] True
    """
    if not callable(family):
        raise InvalidInput(
            f"argument `family` is {family!r}; it must be a function from the parameter to a structure"
        )
    start, stop = finite("start", start), finite("stop", stop)
    if start == stop:
        raise InvalidInput(
            f"arguments `start` and `stop` are both {start}; there is nothing to follow"
        )
    outputs = dict(outputs or {})
    if isinstance(initial, Equilibrium):
        seed_structure, seed = initial.structure, initial.state
    else:
        seed_structure = family(start)
        seed = seed_structure.start() if initial is None else initial
    settings = _settings(
        seed_structure, seed, start, stop, report_at=report_at, on_fold=on_fold, step=step,
        max_step=max_step, max_steps=max_steps, bounds=bounds, sign=sign, tolerance=tolerance,
        event_tolerance=event_tolerance, overshoot=overshoot, eigenvalues=eigenvalues, scale=scale,
        outputs=outputs,
    )  # fmt: skip
    if checkpoint is not None and initial is not None:
        settings = replace(settings, initial=_archive.digest(seed))
    follower = _Follower(
        family, settings, outputs, None if checkpoint is None else Path(checkpoint),
        positive("checkpoint_every", checkpoint_every), residual_derivative,
    )  # fmt: skip
    if checkpoint is None or not follower.resume():
        follower.begin(initial)
    return follower.run()


def _check_sign(sign: int) -> int:
    if sign not in (1, -1):
        raise InvalidInput(f"argument `sign` is {sign!r}; it must be +1 or -1")
    return int(sign)


def _settings(
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
) -> _Settings:
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
    return _Settings(
        start=start,
        stop=stop,
        lower=lower,
        upper=upper,
        report_at=tuple(sorted({float(p) for p in reports})),
        on_fold=one_of("on_fold", on_fold, ("turn", "snap", "stop")),
        sign=_check_sign(sign),
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


@dataclass(frozen=True)
class _Tangent:
    dx: Array
    dm: Array
    dp: float


@dataclass(frozen=True)
class _Point:
    """A point of the branch close to an anchor: its place relative to it, and its factors."""

    parameter: float
    sigma: float  # projection on the anchor's tangent
    balanced: Balanced
    dx: Array  # from the anchor
    dm: Array
    dp: float

    @property
    def index(self) -> int:
        return self.balanced.index


@dataclass(frozen=True)
class _Crossing:
    left: _Point
    right: _Point
    exact: _Point | None = None  # a point where rounding hides the sign of the pivot
    fold: bool = False

    @property
    def sigma(self) -> float:
        return 0.5 * (self.left.sigma + self.right.sigma)


@dataclass(frozen=True)
class _End:
    sigma: float
    point: _Point
    reason: str  # "stop", "bound", "closed"


class _TooLong(Exception):
    """What happens within a step cannot be resolved: the step must be taken in parts."""


class _Follower:
    """Walks along one branch. The only mutable object here; lives for one call."""

    def __init__(
        self,
        family: Family,
        settings: _Settings,
        outputs: Outputs,
        checkpoint: Path | None,
        checkpoint_every: float,
        derivative: Slope | None,
    ) -> None:
        self.original = family
        # Structures derive much when they are first used; around a step the same few come back.
        self.family: Family = lru_cache(maxsize=8)(family)
        self.derivative = derivative
        self.settings = settings
        self.outputs = outputs
        self.checkpoint = checkpoint
        self.checkpoint_every = checkpoint_every
        self.written = time.monotonic()
        self.rows: list[_Row] = []
        self.events: list[Event] = []
        self.finished = False
        self.ends_at_stop = True
        self.steps = 0
        self.ds = settings.step / settings.range
        self.arclength = 0.0
        self.parameter = settings.start
        self.lowest: Array | None = None  # lowest modes of the last row, to start the next from
        self.known: tuple[Balanced, float, bool] | None = None  # eigenvalue of an end of a step
        self.anchor: Balanced
        self.tangent: _Tangent

    # -- geometry -------------------------------------------------------------------------------

    def _inner(self, metric: Array, ax: Array, ap: float, bx: Array, bp: float) -> float:
        s = self.settings
        return float(ax @ (metric * bx)) / s.scale**2 + ap * bp / s.range**2

    def _metric(self, balanced: Balanced) -> Array:
        return np.asarray(balanced.structure.metric(balanced.state), dtype=float)

    def _norm(self, metric: Array, dx: Array, dp: float) -> float:
        return math.sqrt(self._inner(metric, dx, dp, dx, dp))

    def _tangent_at(
        self, balanced: Balanced, parameter: float, along: tuple[Array, float]
    ) -> _Tangent:
        slope = residual_slope(
            self.family, parameter, balanced.state, balanced.multipliers, self.settings.range,
            self.derivative,
        )  # fmt: skip
        dx, dm = implicit_derivative(balanced.factorization, *slope)
        metric = self._metric(balanced)
        length = self._norm(metric, dx, 1.0)
        if self._inner(metric, dx, 1.0, *along) < 0:
            length = -length
        return _Tangent(dx / length, dm / length, 1.0 / length)

    def _relative(self, parameter: float, balanced: Balanced) -> _Point:
        """Return the place of a state relative to the anchor."""
        structure = balanced.structure
        dx = structure.difference(structure.adopt(self.anchor.state), balanced.state)
        dp = parameter - self.parameter
        metric = self._metric(self.anchor)
        return _Point(
            parameter, self._inner(metric, dx, dp, self.tangent.dx, self.tangent.dp), balanced, dx,
            balanced.multipliers - self.anchor.multipliers, dp,
        )  # fmt: skip

    def _displaced(self, parameter: float, dx: Array, dm: Array) -> tuple[Any, Any, Array]:
        structure = member(self.family, parameter)
        state = structure.adopt(self.anchor.state)
        if structure.max_step(state, dx) < 1.0:
            raise CorrectionFailed("the prediction leaves the domain of the energy")
        return structure, structure.retract(state, dx), self.anchor.multipliers + dm

    def _correct_at(self, parameter: float, dx: Array, dm: Array) -> _Point:
        structure, state, multipliers = self._displaced(parameter, dx, dm)
        balanced = correct(structure, state, multipliers, tolerance=self.settings.tolerance)
        return self._relative(parameter, balanced)

    def _correct_across(
        self,
        parameter: float,
        dx: Array,
        dm: Array,
        polish: bool = False,
        contraction: float = CONTRACTION,
    ) -> _Point:
        """Correct in the plane orthogonal to the anchor's tangent."""
        _, state, multipliers = self._displaced(parameter, dx, dm)
        s = self.settings
        row = (
            self._metric(self.anchor) * self.tangent.dx / s.scale**2,
            self.tangent.dp / s.range**2,
        )
        slope = residual_slope(self.family, parameter, state, multipliers, s.range, self.derivative)
        balanced, parameter = correct_on_plane(
            self.family, parameter, state, multipliers, row, slope, s.range,
            tolerance=s.tolerance, polish=polish, contraction=contraction,
            max_iterations=12 if contraction <= CONTRACTION else 40,
        )  # fmt: skip
        return self._relative(parameter, balanced)

    def _interpolated(self, end: _Point, sigma: float) -> tuple[float, Array, Array]:
        """Parabola from the anchor, with its tangent, to the end of the step."""
        t, f = self.tangent, (sigma / end.sigma) ** 2
        return (
            self.parameter + sigma * t.dp + f * (end.dp - end.sigma * t.dp),
            sigma * t.dx + f * (end.dx - end.sigma * t.dx),
            sigma * t.dm + f * (end.dm - end.sigma * t.dm),
        )

    def _direction(self, end: _Point, sigma: float) -> tuple[Array, Array, float]:
        """Unit tangent of that parabola."""
        t, f = self.tangent, 2 * sigma / end.sigma**2
        dx = t.dx + f * (end.dx - end.sigma * t.dx)
        dm = t.dm + f * (end.dm - end.sigma * t.dm)
        dp = t.dp + f * (end.dp - end.sigma * t.dp)
        length = self._norm(self._metric(self.anchor), dx, dp)
        return dx / length, dm / length, dp / length

    # -- beginnings -----------------------------------------------------------------------------

    def begin(self, initial: Any) -> None:
        s = self.settings
        structure = self.family(s.start)
        if isinstance(initial, Equilibrium):
            try:
                balanced = correct(
                    structure, structure.adopt(initial.state), initial.multipliers,
                    tolerance=s.tolerance,
                )  # fmt: skip
            except CorrectionFailed as error:
                raise InvalidInput(
                    f"argument `initial` is not near an equilibrium of the family at `start` = "
                    f"{s.start}: {error}; pass a state to search from instead"
                ) from error
        else:
            found = equilibrate(structure, initial, require="stable")
            balanced = as_balanced(found)
        self.parameter, self.anchor = s.start, balanced
        zero = np.zeros(structure.size)
        sense = math.copysign(1.0, s.stop - s.start)
        try:
            self.tangent = self._tangent_at(balanced, s.start, (zero, sense))
        except FactorizationError as error:
            raise InvalidInput(
                f"the state at `start` = {s.start} is critical, so that the branch has no direction: "
                "start from another parameter value"
            ) from error
        self._emit("reported" if s.start in s.report_at else "step", balanced, s.start, 0.0)

    def begin_at_bifurcation(
        self, event: Event, sign: int, mode: int | Array, amplitude: float | None
    ) -> None:
        s = self.settings
        self.ends_at_stop = False
        origin = as_balanced(event.equilibrium)
        self.anchor, self.parameter = origin, event.equilibrium_parameter
        metric = self._metric(origin)
        # The direction across the old branch, in the plane of its tangent and the critical mode.
        old_dx, _, old_dp = event.direction
        dx, dp = (event.modes[mode] if isinstance(mode, int) else np.array(mode)), 0.0
        share = self._inner(metric, dx, dp, old_dx, old_dp)
        dx, dp = dx - share * old_dx, dp - share * old_dp
        length = sign * self._norm(metric, dx, dp)
        if not abs(length) > 0:
            raise InvalidInput("the critical mode lies along the branch itself: nothing crosses it")
        m = origin.multipliers.size
        self.tangent = _Tangent(dx / length, np.zeros(m), dp / length)
        first: _Point | None = None
        tried = (amplitude,) if amplitude is not None else (0.01, 0.003, 0.03, 0.001, 0.1, 0.3)
        for size in tried:
            try:
                point = self._correct_across(
                    self.parameter + size * self.tangent.dp, size * self.tangent.dx,
                    np.zeros(m), contraction=0.95,
                )  # fmt: skip
            except (CorrectionFailed, FactorizationError):
                continue
            far = self._norm(metric, point.dx, point.dp) > 4 * size
            if far or point.balanced.marginal:
                continue
            first = point
            break
        if first is None:
            raise BranchInterrupted(
                f"no state was found on the branch that crosses at {event.parameter:.6g}, at distances "
                f"{tried} along its mode; pass another `amplitude`, another `mode`, or locate the "
                "event with a smaller `event_tolerance`",
                state=event.equilibrium.state, branch=self._branch(),
            )  # fmt: skip
        self._emit("event", origin, self.parameter, 0.0)
        self.anchor, self.parameter = first.balanced, first.parameter
        self.arclength = self._norm(metric, first.dx, first.dp)
        try:
            self.tangent = self._tangent_at(first.balanced, first.parameter, (first.dx, first.dp))
        except FactorizationError:
            length = self._norm(metric, first.dx, first.dp)
            self.tangent = _Tangent(first.dx / length, first.dm / length, first.dp / length)
        self.ds = min(self.ds, self.arclength)
        kind = "reported" if self.parameter in s.report_at else "step"
        self._emit(kind, first.balanced, self.parameter, self.arclength)

    # -- the walk -------------------------------------------------------------------------------

    def run(self) -> Branch:
        try:
            while not self.finished:
                if self.steps >= self.settings.max_steps:
                    raise self._interrupted(
                        f"the branch has not come to its end after {self.steps} steps, at parameter "
                        f"{self.parameter:.8g}; raise `max_steps`, or give `bounds`"
                    )
                self.steps += 1
                self._advance()
                if self.checkpoint and time.monotonic() - self.written > self.checkpoint_every:
                    self._write()
        finally:
            if self.checkpoint and self.rows:
                self._write()
        return self._branch()

    def _branch(self) -> Branch:
        return Branch(
            family=self.original, events=tuple(self.events), finished=self.finished,
            rows=tuple(self.rows), settings=self.settings, outputs=self.outputs,
            derivative=self.derivative,
        )  # fmt: skip

    def _interrupted(self, message: str) -> BranchInterrupted:
        return BranchInterrupted(
            f"{message}; the attribute `branch` of this error holds the {len(self.rows)} states found",
            branch=self._branch(), history=self.anchor.history, state=self.anchor.state,
        )  # fmt: skip

    def _ends(self) -> list[tuple[float, str]]:
        s = self.settings
        ends = [(s.stop, "stop")] if self.ends_at_stop else []
        return ends + [(b, "bound") for b in (s.lower, s.upper) if b is not None]

    def _advance(self) -> None:
        """Take one step, with everything that happens on it."""
        while True:
            end, tangent = self._step()
            try:
                end, last, crossings, reports = self._within(end, tangent)
                break
            except _TooLong as error:
                length = self._norm(self._metric(self.anchor), end.dx, end.dp)
                if length * _SHORTER < _SHORTEST_STEP:
                    raise self._interrupted(str(error)) from error
                self.ds = length * _SHORTER
        marks: list[tuple[float, int, Any]] = [(point.sigma, 0, point) for point in reports]
        marks += [(crossing.sigma, 1, crossing) for crossing in crossings]
        metric = self._metric(self.anchor)
        for _, kind, mark in sorted(marks, key=lambda mark: mark[:2]):
            if kind == 0:
                where = self.arclength + self._norm(metric, mark.dx, mark.dp)
                self._emit("reported", mark.balanced, mark.parameter, where)
            elif self._event(mark, end):
                return
        final = end if last is None else last.point
        self.arclength += self._norm(metric, final.dx, final.dp)
        reported = final.parameter in self.settings.report_at
        self._emit(
            "reported" if reported else "step", final.balanced, final.parameter, self.arclength
        )
        if last is not None:
            if last.reason != "stop":
                self._end_event(last, metric)
            self.finished = True
        self.anchor, self.parameter, self.tangent = final.balanced, final.parameter, tangent

    def _within(
        self, end: _Point, tangent: _Tangent
    ) -> tuple[_Point, _End | None, list[_Crossing], list[_Point]]:
        """Return what happens on a step: its end, the end of the branch, events, and reports."""
        turned = tangent.dp * self.tangent.dp < 0
        last = self._end_between([(None, end)]) if not turned else None
        if last is not None and last.sigma < end.sigma:
            end, last = last.point, _End(last.point.sigma, last.point, last.reason)
        start = _Point(
            self.parameter, 0.0, self.anchor, np.zeros_like(end.dx), np.zeros_like(end.dm), 0.0
        )
        crossings: list[_Crossing] = []
        if not end.balanced.marginal:
            self._refuse_hidden_changes(end)
            crossings = self._classified(end, self._located(start, end, end), turned)
        if turned and not crossings:
            crossings = [_Crossing(start, end, fold=True)]
        pieces: list[tuple[_Point | None, _Point]] = []
        begin: _Point | None = None
        for crossing in crossings:
            if crossing.fold:
                pieces.append((begin, crossing.left))
                begin = crossing.right
        pieces.append((begin, end))
        if last is None and turned:
            last = self._end_between(pieces)
        if last is None and len(self.rows) > 3:
            last = self._closed(pieces)
        limit = end.sigma if last is None else last.sigma
        reports = self._reports(pieces, end, limit)
        return end, last, [c for c in crossings if c.sigma <= limit], reports

    def _step(self) -> tuple[_Point, _Tangent]:
        """Return the end of an accepted step, and the tangent there. Adapts the step."""
        s = self.settings
        reason = ""
        metric = self._metric(self.anchor)
        while True:
            ds = min(self.ds, s.max_step / s.range)
            if ds < _SHORTEST_STEP:
                raise self._interrupted(
                    f"the branch cannot be continued at parameter {self.parameter:.10g}: steps became "
                    f"shorter than {_SHORTEST_STEP:g} of the interval ({reason}); check that the "
                    "family is smooth there, and its derivatives right"
                )
            t = self.tangent
            natural = abs(t.dp) > _NATURAL * s.range
            target = self.parameter + ds * t.dp
            if natural:
                for value, _ in self._ends():  # hit the end exactly
                    if (value - self.parameter) * (target - value) > 0:
                        target = value
                ds = (target - self.parameter) / t.dp
            try:
                if natural:
                    point = self._correct_at(target, ds * t.dx, ds * t.dm)
                else:
                    point = self._correct_across(target, ds * t.dx, ds * t.dm)
                if point.balanced.marginal:
                    if natural and any(target == value for value, _ in self._ends()):
                        return point, t  # an end of the interval is critical itself
                    raise CorrectionFailed("the state is critical to working precision")
                deviation = self._norm(
                    metric, point.dx - ds * t.dx, point.dp - ds * t.dp
                ) / ds  # fmt: skip
                if deviation > _LARGEST_DEVIATION:
                    raise CorrectionFailed(f"the branch bends by {deviation:.2g} of the step")
                tangent = self._next_tangent(point, deviation)
                if ds > 1e-5:
                    self._refuse_hidden_turns(point, tangent)
            except (CorrectionFailed, FactorizationError) as error:
                reason = str(error)
                self.ds = ds * _SHORTER
                continue
            break
        growth = min(2.0, 1.5 * 0.7 ** (point.balanced.iterations - 3))
        growth = min(growth, math.sqrt(_WANTED_DEVIATION / max(deviation, 1e-12)) + 0.3)
        self.ds = ds * max(0.4, growth) if ds >= 0.999 * self.ds or growth < 1 else self.ds
        return point, tangent

    def _refuse_hidden_turns(self, point: _Point, tangent: _Tangent) -> None:
        """Raise if the parameter seems to turn, and turn back, within a step."""
        if tangent.dp * self.tangent.dp < 0:
            if point.index == self.anchor.index:
                raise CorrectionFailed("the parameter turns without a change of the index")
            return
        if point.dp * self.tangent.dp <= 0:
            raise CorrectionFailed("the parameter turns twice")
        # Slope of the cubic that fits values and slopes at both ends, over the mean slope.
        length = self._norm(self._metric(self.anchor), point.dx, point.dp)
        a, b = self.tangent.dp * length / point.dp, tangent.dp * length / point.dp
        bend = 3.0 * (a + b - 2.0)
        place = (2.0 * a + b - 3.0) / bend if bend > 0 else 0.0
        if 0.0 < place < 1.0 and a - bend * place**2 < -1e-3:
            raise CorrectionFailed("the parameter seems to turn twice")

    def _refuse_hidden_changes(self, end: _Point) -> None:
        """Raise if stability is lost and regained within a step, when there is reason to look.

        There is when an eigenvalue at either end is smaller than its changes from step to step.
        """
        if not self.settings.eigenvalues or end.index != self.anchor.index:
            return
        values = [row.smallest_eigenvalue for row in self.rows[-2:]]
        if end.index > 0 or len(values) < 2 or not np.all(np.isfinite(values)):
            return
        self.known = (
            end.balanced,
            *self._smallest(end.balanced, as_equilibrium(end.balanced, factors=True)),
        )
        values.append(self.known[1])
        if min(values[1:]) < max(abs(np.diff(values))):
            if self._interpolated_index(end, 0.5 * end.sigma) == end.index:
                return
            middle = self._on_step(end, 0.5 * end.sigma)
            if middle.index != end.index and not middle.balanced.marginal:
                raise _TooLong("stability is lost and regained within one step")

    def _interpolated_index(self, end: _Point, sigma: float) -> int | None:
        """Return the number of unstable directions on the parabola through the step.

        It differs from the branch by the third power of the step; None if it cannot be told there.
        """
        try:
            structure, state, multipliers = self._displaced(*self._interpolated(end, sigma))
            kkt = structure.evaluate(state, multipliers, 2).kkt
            factors = kkt.factorize(gauge=gauge_of(structure, state))
        except (CorrectionFailed, FactorizationError):
            return None
        return None if factors.inertia[2] else factors.index

    def _next_tangent(self, point: _Point, deviation: float) -> _Tangent:
        metric = self._metric(self.anchor)
        tangent = self._tangent_at(point.balanced, point.parameter, (point.dx, point.dp))
        turn = self._inner(metric, tangent.dx, tangent.dp, self.tangent.dx, self.tangent.dp)
        dx, dm, dp = self._direction(point, point.sigma)
        agreement = self._inner(metric, tangent.dx, tangent.dp, dx, dp)
        if deviation <= 0.1 and agreement < 0.9:
            # The step itself is straight. Next to a bifurcation the solution for the tangent is
            # polluted by the critical mode; the parabola through the step is not.
            return _Tangent(dx, dm, dp)
        if turn >= _LARGEST_TURN:
            return tangent
        raise CorrectionFailed(f"the tangent turns by {math.degrees(math.acos(turn)):.0f} degrees"
                               if abs(turn) <= 1 else "the tangent changes its length")  # fmt: skip

    # -- where a parameter value is met -----------------------------------------------------------

    def _met(self, value: float, left: _Point | None, right: _Point, end: _Point) -> _Point:
        """Return the state at exactly `value` between two points of a monotone piece."""
        low, p_low = (0.0, self.parameter) if left is None else (left.sigma, left.parameter)
        high, p_high = right.sigma, right.parameter
        if value == p_high:
            return right
        slack = 1e-9 * end.sigma
        for attempt in range(60):
            # Invert the parabola of the step inside the bracket.
            a, b = low, high
            if attempt % 3 == 2:
                a = b = 0.5 * (low + high)
            for _ in range(60):
                if b - a <= 1e-3 * (high - low):
                    break
                mid = 0.5 * (a + b)
                above = self._interpolated(end, mid)[0] >= value
                a, b = (a, mid) if above == (p_high > p_low) else (mid, b)
            sigma = 0.5 * (a + b)
            _, dx, dm = self._interpolated(end, sigma)
            try:
                point = self._correct_at(value, dx, dm)
                if low - slack <= point.sigma <= high + slack:
                    return point
            except (CorrectionFailed, FactorizationError):
                pass
            if high - low <= 1e-12 * end.sigma:
                break
            point = self._on_step(end, sigma)
            if (point.parameter >= value) == (p_high > p_low):
                high = sigma
            else:
                low = sigma
        raise _TooLong(
            f"no state was found at parameter {value:.10g}, although the branch passes it between "
            f"{p_low:.10g} and {p_high:.10g}; leave this value out, or move it off the fold"
        )

    def _end_between(self, pieces: list[tuple[_Point | None, _Point]]) -> _End | None:
        """Return the first end of the branch on monotone pieces of the step."""
        found: list[_End] = []
        end = pieces[-1][1]
        for left, right in pieces:
            before = self.parameter if left is None else left.parameter
            for value, reason in self._ends():
                passed = (value - before) * (right.parameter - value)
                if (passed > 0 or value == right.parameter) and value != before:
                    point = self._met(value, left, right, end)
                    found.append(_End(point.sigma, point, reason))
        return min(found, key=lambda item: item.sigma, default=None)

    def _closed(self, pieces: list[tuple[_Point | None, _Point]]) -> _End | None:
        """Return the place where the branch comes back to its first state, if it does."""
        first = self.rows[0]
        end = pieces[-1][1]
        for left, right in pieces:
            before = self.parameter if left is None else left.parameter
            if not (first.parameter - before) * (right.parameter - first.parameter) > 0:
                continue
            structure, metric = self.anchor.structure, self._metric(self.anchor)
            far = structure.difference(self.anchor.state, structure.adopt(first.equilibrium.state))
            if self._norm(metric, far, 0.0) > 2 * self._norm(metric, end.dx, end.dp):
                continue
            point = self._met(first.parameter, left, right, end)
            structure = point.balanced.structure
            gap = structure.difference(first.equilibrium.state, point.balanced.state)
            if self._norm(metric, gap, 0.0) <= 1e-6:
                return _End(point.sigma, point, "closed")
        return None

    def _reports(
        self, pieces: list[tuple[_Point | None, _Point]], end: _Point, limit: float
    ) -> list[_Point]:
        points = []
        for left, right in pieces:
            before = self.parameter if left is None else left.parameter
            for value in self.settings.report_at:
                if (value - before) * (right.parameter - value) > 0:
                    point = self._met(value, left, right, end)
                    if point.sigma < limit:
                        points.append(point)
        return points

    # -- events -----------------------------------------------------------------------------------

    def _on_step(self, end: _Point, sigma: float) -> _Point:
        """Return the state of the branch at projection `sigma` of the step."""
        reason: Exception | None = None
        # A neighboring place will do when the corrector stumbles over a critical state.
        for nudge in (0.0, 1e-3, -1e-3, 1e-2, -1e-2):
            place = sigma * (1 + nudge)
            if not 0 < place < end.sigma:
                continue
            try:
                return self._correct_across(*self._interpolated(end, place), polish=True)
            except (CorrectionFailed, FactorizationError) as error:
                reason = error
        raise _TooLong(
            f"no state was found at parameter {self._interpolated(end, sigma)[0]:.10g}, within an "
            f"accepted step ({reason}); use a smaller `max_step`"
        )

    def _located(self, left: _Point, right: _Point, end: _Point) -> list[_Crossing]:
        """Return the changes of index between two points, each in a short bracket."""
        if left.index == right.index:
            return []
        shortest = self.settings.event_tolerance
        single = abs(left.index - right.index) == 1
        values = (math.nan, math.nan)
        if single:
            values = (self._test(left), self._test(right))
        last_root, widths = math.nan, [math.inf]
        for _ in range(200):
            width = right.sigma - left.sigma
            if width <= shortest:
                return [_Crossing(left, right)]
            root = left.sigma + 0.5 * width
            slow = len(widths) > 3 and width > 0.3 * widths[-3]
            widths.append(width)
            if single and values[0] * values[1] < 0 and not slow:
                root = left.sigma + width * values[0] / (values[0] - values[1])
                change = abs(root - last_root) if math.isfinite(last_root) else 0.2 * width
                last_root = root
                # Aim a little beyond the root, so that the far end of the bracket comes close.
                aside = max(change, 0.4 * shortest)
                root += aside if right.sigma - root > root - left.sigma else -aside
                inside = min(0.4 * shortest, 0.5 * width)
                root = min(max(root, left.sigma + inside), right.sigma - inside)
            middle = self._on_step(end, root)
            if middle.balanced.marginal:
                return [_Crossing(left, right, exact=middle)]
            if not left.sigma < middle.sigma < right.sigma:
                if width > 1e3 * shortest:
                    raise _TooLong(
                        f"states near parameter {middle.parameter:.10g} do not follow one another"
                    )
                return [_Crossing(left, right)]  # rounding: the bracket cannot be divided further
            if middle.index == left.index:
                left = middle
                values = (self._test(left) if single else math.nan, values[1])
            elif middle.index == right.index:
                right = middle
                values = (values[0], self._test(right) if single else math.nan)
            else:
                return self._located(left, middle, end) + self._located(middle, right, end)
        return [_Crossing(left, right)]

    def _test(self, point: _Point) -> float:
        """Return the eigenvalue of smallest size: it goes through zero at an event."""
        try:
            return float(critical_modes(point.balanced, 1, iterations=6)[0][0])
        except FactorizationError:
            return math.nan

    def _classified(self, end: _Point, crossings: list[_Crossing], turned: bool) -> list[_Crossing]:
        """Tell folds from bifurcations: only at a fold does the parameter turn."""
        if not crossings:
            return []
        signs = [math.copysign(1.0, self.tangent.dp)]
        for one, other in itertools.pairwise(crossings):
            between = self._on_step(end, 0.5 * (one.sigma + other.sigma))
            direction = self._direction(end, between.sigma)
            try:
                tangent = self._tangent_at(between.balanced, between.parameter, direction[::2])
                signs.append(math.copysign(1.0, tangent.dp))
            except FactorizationError:
                signs.append(math.copysign(1.0, direction[2]))
        signs.append(-signs[0] if turned else signs[0])
        for crossing in crossings:
            left, right = crossing.left, crossing.right
            gap = self._norm(
                self._metric(self.anchor), right.dx - left.dx, right.dp - left.dp
            ) - 10 * (right.sigma - left.sigma)  # fmt: skip
            if gap > 1e-6:
                raise _TooLong(
                    f"the states on both sides of a change of stability at parameter "
                    f"{left.parameter:.10g} belong to different branches"
                )
        return [
            replace(crossing, fold=signs[i] != signs[i + 1]) for i, crossing in enumerate(crossings)
        ]

    def _event(self, crossing: _Crossing, end: _Point) -> bool:
        """Record a fold or a bifurcation. Return whether the walk does not go on from the step."""
        s = self.settings
        left, right = crossing.left, crossing.right
        stable_side = left if left.index <= right.index else right
        count = max(abs(left.index - right.index), 1)
        _, modes = critical_modes(stable_side.balanced, count)
        direction = self._direction(end, crossing.sigma)
        metric = self._metric(self.anchor)
        if crossing.exact is not None:
            parameter = crossing.exact.parameter
            bracket = max(abs(left.parameter - parameter), abs(right.parameter - parameter))
        else:
            parameter = 0.5 * (left.parameter + right.parameter)
            bracket = 0.5 * abs(left.parameter - right.parameter)
        width = right.sigma - left.sigma
        if crossing.fold:
            # The parameter is extremal within the bracket: its curvature bounds what is missed.
            bracket += abs(end.dp - end.sigma * self.tangent.dp) * (width / end.sigma) ** 2
            if float(modes[0] @ (metric * direction[0])) < 0:
                modes = modes * np.array([-1.0] + [1.0] * (count - 1))[:, None]
        where = self.arclength + self._norm(metric, stable_side.dx, stable_side.dp)
        kind = "fold" if crossing.fold else "bifurcation"
        bracket = max(bracket, 4 * np.finfo(float).eps * max(abs(parameter), s.range))
        bracket += stable_side.balanced.correction * s.range
        bracket += self._hidden(left, right, stable_side, modes[0])
        row = self._emit("event", stable_side.balanced, stable_side.parameter, where)
        event = Event(
            kind=kind, parameter=float(parameter), uncertainty=float(bracket), arclength=where,
            equilibrium=self.rows[row].equilibrium, row=row, modes=modes,
            index_before=left.index, index_after=right.index, direction=direction,
            equilibrium_parameter=stable_side.parameter,
            detail=f"{kind}: the number of unstable directions goes from {left.index} to {right.index}",
        )  # fmt: skip
        self.events.append(event)
        lost = left.index == 0
        if s.on_fold == "stop" and (crossing.fold or lost):
            self._arrive(left if lost else stable_side, direction, where)
            self.finished = True
            return True
        if s.on_fold == "snap" and lost:
            self._snap(event, crossing, end, direction)
            return True
        return False

    def _hidden(self, left: _Point, right: _Point, near: _Point, mode: Array) -> float:
        """Return the range of the parameter in which rounding hides the sign of the eigenvalue."""
        balanced = near.balanced
        kkt = balanced.evaluation.kkt
        assert kkt is not None
        terms, _ = kkt.magnitude(mode, np.zeros_like(balanced.multipliers))
        floor = float(balanced.structure.noise(balanced.state)) * float(np.abs(mode) @ terms)
        change = abs(self._test(right) - self._test(left))
        run = abs(right.parameter - left.parameter)
        return 0.0 if not change > 0 else min(floor / change, 1e3) * run

    def _arrive(self, point: _Point, direction: tuple[Array, Array, float], where: float) -> None:
        self.anchor, self.parameter = point.balanced, point.parameter
        self.tangent, self.arclength = _Tangent(*direction), where

    def _end_event(self, last: _End, metric: Array) -> None:
        words = {
            "bound": "the branch leaves its bounds",
            "closed": "the branch has come back to its first state",
        }
        index = last.point.index
        self.events.append(
            Event(
                kind="end",
                parameter=last.point.parameter,
                uncertainty=0.0,
                arclength=self.arclength,
                equilibrium=self.rows[-1].equilibrium,
                row=len(self.rows) - 1,
                modes=np.zeros((0, last.point.dx.size)),
                index_before=index,
                index_after=index,
                direction=(self.tangent.dx, self.tangent.dm, self.tangent.dp),
                equilibrium_parameter=last.point.parameter,
                detail=words[last.reason],
            )
        )

    def _snap(
        self, event: Event, crossing: _Crossing, end: _Point, direction: tuple[Array, Array, float]
    ) -> None:
        """Freeze the parameter just beyond the loss of stability, descend, and begin anew."""
        s = self.settings
        left = crossing.left
        sense = math.copysign(1.0, self.tangent.dp)
        frozen = event.parameter + sense * max(s.overshoot * s.range, 10 * event.uncertainty)
        for value, _ in self._ends():
            if (value - self.parameter) * (frozen - value) > 0:
                frozen = value
        signs = (1,) if crossing.fold else (s.sign, -s.sign)
        self._arrive(left, direction, event.arclength)
        after = descend(self.family(frozen), left.balanced, event.modes, signs, self._interrupted)
        before = self.family(frozen)
        energy = before.evaluate(
            before.adopt(left.balanced.state), left.balanced.multipliers, 0
        ).energy  # fmt: skip
        row = self._emit("event", as_balanced(after), frozen, event.arclength)
        self.events.append(
            replace(
                event,
                kind="snap",
                after=self.rows[row].equilibrium,
                after_row=row,
                energy_released=energy - after.energy,
                detail=f"snap after a {event.kind}, with the parameter frozen at {frozen:.10g}",
            )
        )
        self.anchor, self.parameter = as_balanced(after), frozen
        self.ds = s.step / s.range
        zero = np.zeros_like(left.dx)
        self.tangent = self._tangent_at(self.anchor, frozen, (zero, sense))
        self.finished = self.ends_at_stop and frozen == s.stop

    # -- rows -------------------------------------------------------------------------------------

    def _emit(self, kind: str, balanced: Balanced, parameter: float, arclength: float) -> int:
        full = as_equilibrium(balanced, factors=True)
        value, marginal = math.nan, balanced.marginal
        if self.settings.eigenvalues and not marginal:
            if self.known is not None and self.known[0] is balanced:
                _, value, marginal = self.known
            else:
                value, marginal = self._smallest(balanced, full)
        outputs: dict[str, float] = {}
        for name, function in self.outputs.items():
            result = np.asarray(function(full))
            if result.shape != () or result.dtype.kind not in "biuf":
                raise InvalidInput(
                    f"the output {name!r} returned {result!r} at parameter {parameter:.8g}; it must "
                    "return a number"
                )
            outputs[name] = float(result)
        self.rows.append(
            _Row(
                kind,
                float(parameter),
                float(arclength),
                value,
                balanced.index,
                marginal,
                outputs,
                as_equilibrium(balanced),
            )
        )
        return len(self.rows) - 1

    def _smallest(self, balanced: Balanced, full: Equilibrium) -> tuple[float, bool]:
        """Return the smallest eigenvalue, and whether rounding hides its sign."""
        factor = balanced.factorization
        free = factor.n - factor.m - factor.g
        if free < 1:  # the constraints leave no motion: nothing that could be unstable
            return math.nan, False
        if self.lowest is not None and balanced.stable:
            warm = lowest_of_stable(balanced, self.lowest)
            if warm is not None:
                self.lowest = warm[1]
                return warm[0], warm[0] <= warm[2]
        try:
            spectrum = smallest_eigenvalue(full, count=min(3, free))
        except (FactorizationError, StabilityNotResolvable, NotConverged):
            return math.nan, False
        self.lowest = spectrum.modes
        value = float(spectrum.values[0])
        return value, abs(value) <= spectrum.floor

    # -- files ------------------------------------------------------------------------------------

    def _write(self) -> None:
        assert self.checkpoint is not None
        meta, arrays = _pack(self._branch())
        meta["cursor"] = {
            "steps": self.steps, "ds": self.ds, "arclength": self.arclength,
            "parameter": self.parameter, "dp": self.tangent.dp, "ends_at_stop": self.ends_at_stop,
        }  # fmt: skip
        arrays |= {"cursor.dx": self.tangent.dx, "cursor.dm": self.tangent.dm}
        arrays |= _archive.pack_values("cursor.state", [self.anchor.state])
        arrays["cursor.multipliers"] = self.anchor.multipliers
        _archive.write(self.checkpoint, meta, arrays)
        self.written = time.monotonic()

    def resume(self) -> bool:
        """Take up what the checkpoint holds. Return whether there is one."""
        assert self.checkpoint is not None
        if not self.checkpoint.exists():
            return False
        path = self.checkpoint
        meta, arrays = _archive.read(path, "branch")
        found = _settings_from(meta, path)
        wanted = self.settings
        # A larger number of steps is what one asks for after too few.
        if replace(found, max_steps=wanted.max_steps) != wanted:
            names = [k for k, v in asdict(wanted).items() if asdict(found)[k] != v]
            raise InvalidInput(
                f"argument `checkpoint` is {str(path)!r}, which belongs to a call with other values of "
                f"{', '.join(names)}; repeat that call, or name another file"
            )
        branch = _unpack(meta, arrays, self.original, self.outputs, path)
        self.rows, self.events = list(branch.rows), list(branch.events)
        self.finished = branch.finished
        cursor = _needed(meta, "cursor", path)
        self.steps, self.ds = int(cursor["steps"]), float(cursor["ds"])
        self.arclength = float(cursor["arclength"])
        self.parameter = float(cursor["parameter"])
        self.ends_at_stop = bool(cursor["ends_at_stop"])
        structure = self.family(self.parameter)
        like = self.rows[0].equilibrium.state
        state = _archive.unpack_values("cursor.state", arrays, like, 1)[0]
        try:
            self.anchor = correct(
                structure, structure.adopt(state), arrays["cursor.multipliers"],
                tolerance=self.settings.tolerance, max_iterations=2,
            )  # fmt: skip
        except (CorrectionFailed, KeyError) as error:
            if not self.finished:
                raise _not_of_family(path, self.parameter) from error
        self.tangent = _Tangent(arrays["cursor.dx"], arrays["cursor.dm"], float(cursor["dp"]))
        return True


def _needed(meta: Mapping[str, Any], name: str, path: Any) -> Any:
    if name not in meta:
        raise DataError(f"the file {path} lacks {name!r}: it is damaged, or of another version")
    return meta[name]


def _not_of_family(path: Any, parameter: float) -> DataError:
    return DataError(
        f"the file {path} holds a state that is no equilibrium of the family at parameter "
        f"{parameter:.8g}; pass the family that was followed, with the same mesh and constants"
    )


def _settings_from(meta: Mapping[str, Any], path: Any) -> _Settings:
    values = dict(_needed(meta, "settings", path))
    try:
        values["report_at"] = tuple(values["report_at"])
        values["outputs"] = tuple(values["outputs"])
        return _Settings(**values)
    except (KeyError, TypeError) as error:
        raise DataError(f"the settings in {path} are of another version: {error}") from error


def _pack(branch: Branch) -> tuple[dict[str, Any], dict[str, Any]]:
    rows = branch.rows
    meta: dict[str, Any] = {
        "kind": "branch",
        "finished": branch.finished,
        "settings": asdict(branch.settings),
        "rows": [row.kind for row in rows],
        "events": [],
    }
    arrays: dict[str, Any] = {
        "parameter": np.array([row.parameter for row in rows]),
        "arclength": np.array([row.arclength for row in rows]),
        "smallest_eigenvalue": np.array([row.smallest_eigenvalue for row in rows]),
        "index": np.array([row.index for row in rows], dtype=int),
        "marginal": np.array([row.marginal for row in rows], dtype=bool),
        "outputs": np.array([[row.outputs[k] for k in branch.settings.outputs] for row in rows]),
    }
    arrays |= pack_equilibria([row.equilibrium for row in rows])
    for i, event in enumerate(branch.events):
        meta["events"].append(
            {
                "kind": event.kind, "parameter": event.parameter, "uncertainty": event.uncertainty,
                "arclength": event.arclength, "row": event.row, "after_row": event.after_row,
                "index_before": event.index_before, "index_after": event.index_after,
                "equilibrium_parameter": event.equilibrium_parameter,
                "energy_released": event.energy_released, "detail": event.detail,
                "dp": event.direction[2],
            }
        )  # fmt: skip
        arrays[f"event.{i}.modes"] = event.modes
        arrays[f"event.{i}.dx"], arrays[f"event.{i}.dm"] = event.direction[:2]
    return meta, arrays


def _unpack(
    meta: Mapping[str, Any], arrays: dict[str, Any], family: Family, outputs: Outputs, path: Any
) -> Branch:
    kinds = _needed(meta, "rows", path)
    settings = _settings_from(meta, path)
    count = len(kinds)
    try:
        parameters = arrays["parameter"]
        structures = [family(float(p)) for p in parameters]
        equilibria = unpack_equilibria(arrays, structures, path)
        rows = tuple(
            _Row(
                kinds[i], float(parameters[i]), float(arrays["arclength"][i]),
                float(arrays["smallest_eigenvalue"][i]), int(arrays["index"][i]),
                bool(arrays["marginal"][i]),
                dict(zip(settings.outputs, map(float, arrays["outputs"][i]), strict=True)),
                equilibria[i],
            )
            for i in range(count)
        )  # fmt: skip
        events = []
        for i, item in enumerate(_needed(meta, "events", path)):
            item = dict(item)
            direction = (
                arrays[f"event.{i}.dx"], arrays[f"event.{i}.dm"], float(item.pop("dp")),
            )  # fmt: skip
            after = item["after_row"]
            events.append(
                Event(
                    **item, equilibrium=rows[item["row"]].equilibrium,
                    after=None if after < 0 else rows[after].equilibrium,
                    modes=arrays[f"event.{i}.modes"], direction=direction,
                )
            )  # fmt: skip
    except (KeyError, IndexError, TypeError) as error:
        raise DataError(f"the file {path} is incomplete: {error!r} is missing or wrong") from error
    if not fits(equilibria[-1]):
        raise _not_of_family(path, float(parameters[-1]))
    return Branch(
        family=family, events=tuple(events), finished=bool(_needed(meta, "finished", path)),
        rows=rows, settings=settings, outputs=dict(outputs),
    )  # fmt: skip
