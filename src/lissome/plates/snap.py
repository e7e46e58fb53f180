r"""Inversion of a domed plate as its spontaneous curvature grows against it.

The spontaneous strain stays as it is, and the spontaneous curvature is
:math:`\kappa_m = \kappa_0 + p\,\kappa_1` with a growing p. The dome is followed from p = 0 until the
inertia of the tangent tells that it is no longer a minimum: at a fold, or at a bifurcation where it
loses its symmetry. There p is frozen and the plate descends to the stable state below. If this state
is inverted it has snapped; if not (the dome has lost only its symmetry) it is followed further.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._corrector import as_balanced
from .._descent import descend
from .._validate import finite, finite_array, integer_at_least, positive
from ..branch import Branch, Event, follow
from ..equilibrium import Equilibrium, equilibrate
from ..errors import InvalidInput, LissomeError, NotConverged
from .fvk import Plate, PlateState

__all__ = ["Inversion", "dome", "inversion"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Inversion:
    """How a dome inverts, or that it does not.

    Attributes
    ----------
    inverts : bool
        Whether the plate is turned over before p comes to its end.
    parameter : float
        p at the inversion; NaN without one.
    uncertainty : float
        Half-width of the interval that brackets it.
    kind : str
        "fold" or "bifurcation": how the state lost its stability; "" without an inversion.
    energy_released : float
        Energy before minus energy of the stable inverted state, at the same p; NaN without one.
    before, after : Equilibrium or None
        The last stable state of the dome, and the stable inverted state.
    losses : tuple of Event
        Every loss of stability, the inversion's last: earlier ones broke a symmetry only.
    branches : tuple of Branch
        What was followed between them.
    """

    inverts: bool
    parameter: float
    uncertainty: float
    kind: str
    energy_released: float
    before: Equilibrium | None = field(repr=False)
    after: Equilibrium | None = field(repr=False)
    losses: tuple[Event, ...] = field(repr=False)
    branches: tuple[Branch, ...] = field(repr=False)


def dome(
    plate: Plate, *, center: Any = (0.0, 0.0), up: bool = True, height: float | None = None
) -> Equilibrium:
    """Return the stable state into which a plate relaxes from a paraboloid.

    Parameters
    ----------
    plate : Plate
    center : array_like, shape (2,)
        Top of the paraboloid: the defect.
    up : bool
        Whether the center is above the edge (w larger), or below.
    height : float, optional
        Of the paraboloid; by default what suits the spontaneous strain.

    Returns
    -------
    Equilibrium
        Stable; flat where the plate does not buckle.
    """
    c = finite_array("center", center, shape=(2,))
    space = plate.space
    reach = float(np.max(np.hypot(*(space.positions - c).T)))
    top = plate.slope_scale * reach if height is None else positive("height", height)
    sign = 1.0 if up else -1.0
    start = plate.interpolate(
        lambda x, y: -sign * top * ((x - c[0]) ** 2 + (y - c[1]) ** 2) / reach**2
    )
    return equilibrate(plate, start)


def _shape(plate: Plate, state: PlateState) -> Array:
    """Return the deflection without its mean plane, weighed by areas."""
    n = plate.space.nodes
    w = state.x[2 * n : 3 * n]
    weight = np.sqrt(plate.space.mass[2 * n : 3 * n])
    plane = weight[:, None] * np.column_stack([np.ones(n), plate.space.positions])
    return weight * w - plane @ np.linalg.lstsq(plane, weight * w, rcond=None)[0]


def inversion(
    plate: Plate,
    direction: Any,
    stop: float,
    *,
    initial: Equilibrium | PlateState | None = None,
    tolerance: float = 1e-4,
    sign: int = 1,
    most_losses: int = 6,
) -> Inversion:
    """Find the spontaneous curvature at which a dome inverts, and the energy that it releases.

    Parameters
    ----------
    plate : Plate
        At p = 0.
    direction : array_like (2, 2) or callable
        What p multiplies, added to the plate's own spontaneous curvature; as the argument `curvature`
        of :class:`~lissome.plates.fvk.Plate`.
    stop : float
        p at which to give up; its sign is the way to go.
    initial : Equilibrium or PlateState, optional
        The dome at p = 0; by default ``dome(plate)``.
    tolerance : float
        Length of the bracket of a loss of stability, relative to `stop`.
    sign : int
        +1 or -1: side of the critical mode that is tried first at a bifurcation.
    most_losses : int
        Losses of stability, without an inversion, after which to give up.

    Returns
    -------
    Inversion

    Raises
    ------
    InvalidInput
        If the plate is flat at p = 0: what has no side cannot be inverted.
    NotConverged
        If there are more than `most_losses` losses of stability, or a descent finds no minimum.
    """
    stop = finite("stop", stop)
    if stop == 0:
        raise InvalidInput("argument `stop` is 0; p must have somewhere to go")
    positive("tolerance", tolerance)
    integer_at_least("most_losses", most_losses, 1)
    base = plate.curvature

    def at(p: float) -> Plate:
        def curvature(x: Array, y: Array) -> Array:
            total = p * _tensor(direction, x, y)
            return total if base is None else total + _tensor(base, x, y)

        return plate.with_(curvature=curvature)

    current: Equilibrium
    if initial is None:
        current = dome(plate)
    elif isinstance(initial, Equilibrium):
        current = initial
    else:
        current = equilibrate(plate, initial)
    first = _shape(plate, current.state)
    size = float(np.linalg.norm(first))
    flat = 1e-6 * plate.slope_scale * plate.space.extent * np.sqrt(plate.space.area)
    if not size > flat:
        raise InvalidInput(
            "the plate is flat at p = 0: its strain does not make it buckle, so that nothing can be "
            "inverted; raise the strain, or pass `initial`"
        )
    losses: list[Event] = []
    branches: list[Branch] = []
    here = 0.0
    while True:
        branch = follow(
            at, here, stop, on_fold="stop", initial=current, eigenvalues=False,
            event_tolerance=tolerance, step=abs(stop) / 40, max_step=abs(stop - here),
        )  # fmt: skip
        branches.append(branch)
        lost = [event for event in branch.events if event.kind in ("fold", "bifurcation")
                and event.index_after > event.index_before]  # fmt: skip
        if not lost:
            return Inversion(
                False, np.nan, np.nan, "", np.nan, None, None, tuple(losses), tuple(branches)
            )
        event = lost[-1]
        losses.append(event)
        beyond = max(tolerance * abs(stop), 2 * event.uncertainty)
        frozen = event.parameter + float(np.copysign(beyond, stop))

        def interrupted(message: str) -> LissomeError:
            return NotConverged(message)

        signs = (1,) if event.kind == "fold" else (sign, -sign)
        below = at(frozen)
        after = descend(below, as_balanced(event.equilibrium), event.modes, signs, interrupted)
        if float(first @ _shape(plate, after.state)) < 0:
            top = below.evaluate(event.equilibrium.state, np.zeros(0), 0).energy
            return Inversion(
                True, event.parameter, event.uncertainty, event.kind, top - after.energy,
                event.equilibrium, after, tuple(losses), tuple(branches),
            )  # fmt: skip
        if len(losses) >= most_losses:
            raise NotConverged(
                f"the plate lost its stability {len(losses)} times up to p = {frozen:.6g} without "
                "being inverted; raise `most_losses` to go on",
                state=after.state,
            )
        if (stop - frozen) * np.sign(stop) <= 0:
            return Inversion(
                False, np.nan, np.nan, "", np.nan, None, None, tuple(losses), tuple(branches)
            )
        here, current = frozen, after


def _tensor(value: Any, x: Array, y: Array) -> Array:
    """Return a tensor field at points, shape (2, 2, ...)."""
    if callable(value):
        return np.asarray(value(x, y), dtype=float)
    return np.asarray(value, dtype=float).reshape(2, 2, *(1,) * np.ndim(x))
