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

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from . import _archive
from ._branch_file import pack, unpack
from ._branch_records import (
    BranchInterrupted,
    Event,
    Outputs,
    Row,
    Settings,
    checked_settings,
    checked_sign,
)
from ._corrector import TOLERANCE, Family, Slope
from ._follower import Follower
from ._telling import one_call
from ._validate import finite, finite_array, functions, positive, structure_like
from .equilibrium import Equilibrium
from .errors import InvalidInput

__all__ = ["Branch", "BranchInterrupted", "Event", "follow"]

Array = NDArray[np.float64]


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
        Folds, bifurcations and snaps, in the order in which they were met.
    finished : bool
        Whether the branch came to its end; False for what an interruption has left.
    family, outputs, derivative
        What was followed: the arguments of :func:`follow`.

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
    #: Equilibria and options in the form in which `save` writes them.
    _rows: tuple[Row, ...] = field(repr=False)
    _settings: Settings = field(repr=False)
    outputs: Outputs = field(repr=False)
    derivative: Slope | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """The states of the rows of the table."""
        return tuple(row.equilibrium for row in self._rows)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row for each equilibrium."""
        data: dict[str, Any] = {
            "parameter": np.array([row.parameter for row in self._rows], dtype=float),
            "energy": np.array([row.equilibrium.energy for row in self._rows], dtype=float),
            "smallest_eigenvalue": np.array(
                [row.smallest_eigenvalue for row in self._rows], dtype=float
            ),
            "index": np.array([row.index for row in self._rows], dtype=int),
            "stable": np.array([row.stable for row in self._rows], dtype=bool),
            "kind": [row.kind for row in self._rows],
            "arclength": np.array([row.arclength for row in self._rows], dtype=float),
        }
        for name in self._settings.outputs:
            data[name] = np.array([row.outputs[name] for row in self._rows], dtype=float)
        return pd.DataFrame(data)

    @one_call
    def switch(
        self,
        event: Event,
        sign: int = 1,
        *,
        stop: float | None = None,
        bounds: tuple[float, float] | None = None,
        mode: int | Array = 0,
        amplitude: float | None = None,
        progress: bool | None = None,
        **options: Any,
    ) -> Branch:
        """Follow the branch that crosses this one at a bifurcation.

        The first state is looked for at a given distance from the bifurcation along the critical mode,
        with the parameter free: this finds the crossing branch of a pitchfork and of a transcritical
        point, and of the latter both halves, one with each sign.

        A branch that comes back to the bifurcation, in the direction in which it left, is closed and
        ends there. On its way it may pass through another pitchfork, where its parameter turns: this is
        a fold without a change of the number of unstable directions.

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
        progress : bool, optional
            As of :func:`follow`.
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
        checked_sign(sign)
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
        old = self._settings
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
        settings = checked_settings(
            event.equilibrium.structure, event.equilibrium.state, old.start, old.stop,
            bounds=bounds, outputs=outputs, switching=True, **{**keep, **options},
        )  # fmt: skip
        follower = Follower(self.family, settings, outputs, None, 0.0, self.derivative)
        return _walked(
            follower, lambda: follower.begin_at_bifurcation(event, sign, mode, amplitude), progress
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the branch to the file `path` (.npz: arrays and JSON, no pickle), all or nothing."""
        meta, arrays = pack(self._rows, self.events, self._settings, self.finished)
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
        InvalidInput
            If `outputs` is no mapping of names to functions.
        """
        meta, arrays = _archive.read(path, "branch")
        rows, events, settings, finished = unpack(meta, arrays, family, path)
        return Branch(family, events, finished, rows, settings, functions("outputs", outputs))


@one_call
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
    progress: bool | None = None,
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
        Relative size of the corrections at which a state is accepted. Up to a hundred times that will do
        where those before it tell that the next would be far smaller.
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
    progress : bool, optional
        Count the steps on stderr, after two seconds. By default only if that is a terminal.

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
    outputs = functions("outputs", outputs)
    if isinstance(initial, Equilibrium):
        seed_structure, seed = initial.structure, initial.state
    else:
        seed_structure = structure_like("family(start)", family(start))
        seed = seed_structure.start() if initial is None else initial
    settings = checked_settings(
        seed_structure, seed, start, stop, report_at=report_at, on_fold=on_fold, step=step,
        max_step=max_step, max_steps=max_steps, bounds=bounds, sign=sign, tolerance=tolerance,
        event_tolerance=event_tolerance, overshoot=overshoot, eigenvalues=eigenvalues, scale=scale,
        outputs=outputs,
    )  # fmt: skip
    if checkpoint is not None and initial is not None:
        settings = replace(settings, initial=_archive.digest(seed))
    follower = Follower(
        family, settings, outputs, None if checkpoint is None else Path(checkpoint),
        positive("checkpoint_every", checkpoint_every), residual_derivative,
    )  # fmt: skip

    def begin() -> None:
        if checkpoint is None or not follower.resume():
            follower.begin(initial)

    return _walked(follower, begin, progress)


def _walked(follower: Follower, begin: Callable[[], None], progress: bool | None) -> Branch:
    """Return the branch that was walked; what interrupts the walk carries what was found."""

    def branch() -> Branch:
        return Branch(
            family=follower.original, events=tuple(follower.events), finished=follower.finished,
            _rows=tuple(follower.rows), _settings=follower.settings, outputs=follower.outputs,
            derivative=follower.derivative,
        )  # fmt: skip

    try:
        begin()
        follower.run(progress)
    except BranchInterrupted as error:
        error.branch = branch()
        raise
    return branch()
