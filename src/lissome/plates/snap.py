r"""Inversion of a domed plate as its spontaneous curvature grows against it.

The spontaneous strain stays as it is, and the spontaneous curvature is
:math:`\kappa_m = \kappa_0 + p\,\kappa_1` with a growing p. The dome is followed from p = 0 until the
inertia of the tangent tells that it is no longer a minimum: at a fold, or at a bifurcation where it
loses its symmetry. There p is frozen and the plate descends to the stable state below. If this state
is inverted it has snapped; if not (the dome has lost only its symmetry) it is followed further.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._corrector import as_balanced, as_equilibrium
from .._descent import descend
from .._validate import finite, finite_array, integer_at_least, one_of, positive
from ..branch import Branch, Event, follow
from ..equilibrium import Equilibrium, equilibrate
from ..errors import InvalidInput, LissomeError, NotConverged, StabilityNotResolvable
from ._path import NONE, Path
from .directors import Defect, require_inside
from .meshes import disc, rectangle
from .plate import Plate, PlateState
from .thermal_strain import transverse_strain

__all__ = ["CriticalCurvature", "Inversion", "critical_curvature", "dome", "inversion", "sheet"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
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

    Examples
    --------
    Both states at the inversion are stable, and the one after it has less energy:

    >>> from lissome.plates import Defect
    >>> from lissome.plates.snap import inversion, sheet
    >>> found = inversion(sheet(200.0, divisions=1), Defect().field(0.1, -0.05), stop=2.0)
    >>> print(found.inverts, found.before.stable, found.after.stable, found.energy_released > 0)
    True True True True
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

    Raises
    ------
    InvalidInput
        If `center` is not a point.

    Examples
    --------
    A small strain leaves the sheet flat, a greater one makes it a dome:

    >>> import numpy as np
    >>> from lissome.plates.snap import dome, sheet
    >>> heights = [np.ptp(dome(sheet(strain, divisions=2)).deflection) for strain in (1.0, 200.0)]
    >>> print(heights[0] < 1e-9, heights[1] > 0.01)
    True True
    """
    c = finite_array("center", center, shape=(2,))
    space = plate.space
    reach = float(np.max(np.hypot(*(space.positions - c).T)))
    top = plate.slope_scale * reach if height is None else positive("height", height)
    sign = 1.0 if up else -1.0
    last: NotConverged | None = None
    for part in (1.0, 0.8, 0.5) if height is None else (1.0,):
        rise = sign * part * top

        def paraboloid(x: Array, y: Array, rise: float = rise) -> Array:
            return -rise * ((x - c[0]) ** 2 + (y - c[1]) ** 2) / reach**2

        try:
            return equilibrate(plate, plate.interpolate(paraboloid), max_iterations=100)
        except NotConverged as error:
            last = error
    assert last is not None
    raise last


def _shape(plate: Plate, state: PlateState) -> Array:
    """Return the deflection without its mean plane, weighed by areas."""
    n = plate.space.nodes
    w = state.x[2 * n : 3 * n]
    weight = np.sqrt(plate.space.mass[2 * n : 3 * n])
    plane = weight[:, None] * np.column_stack([np.ones(n), plate.space.positions])
    return weight * w - plane @ np.linalg.lstsq(plane, weight * w, rcond=None)[0]


def _waves(plate: Plate, state: PlateState, mode: Array) -> int:
    """Return the number of waves by which a mode breaks the roundness of a plate; 0 if it does not."""
    rim = plate.mesh.p[:, np.unique(plate.mesh.facets[:, plate.mesh.boundary_facets()])]
    center = rim.mean(axis=1)
    radii = np.hypot(*(rim - center[:, None]))
    if np.ptp(radii) > 1e-6 * radii.max():
        return 0
    angle = 2 * np.pi * np.arange(32) / 32
    ring = center + 0.9 * radii.max() * np.column_stack([np.cos(angle), np.sin(angle)])
    size = plate.slope_scale * radii.max()
    w = plate.deflection_at(ring, state)
    push = 1e-3 * mode / float(np.max(np.abs(mode) / plate.typical(state)))
    change = plate.deflection_at(ring, plate.retract(state, push)) - w
    shape, waves = (np.abs(np.fft.rfft(v)) / 32 for v in (w, change))
    if np.max(shape[2:]) > 1e-2 * size:
        return 0  # not round any more
    most = int(np.argmax(waves))
    return most if most >= 2 else 0


def _descended(
    below: Plate, before: Any, modes: Array, signs: Any, interrupted: Any, p: float
) -> Equilibrium:
    """Return the stable state to which a plate falls."""
    try:
        return descend(below, before, modes, signs, interrupted)[0]
    except NotConverged as error:
        waves = _waves(below, below.adopt(before.state), modes[0])
        if not waves:
            raise
        raise StabilityNotResolvable(
            f"at p = {p:.6g} the round plate gives way to {waves} waves around its rim. Nothing holds "
            "their direction: plate and director are alike in all, so that to turn the waves costs no "
            "energy, and whether a state with waves is a minimum is decided by errors of the mesh "
            "alone. End before this p, or break the symmetry: a square, or a defect off the center"
        ) from error


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
        of :class:`~lissome.plates.Plate`.
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
    StabilityNotResolvable
        If a round plate gives way to waves around its rim that turn freely, and no minimum can be
        told for this.

    Examples
    --------
    A dome is the mirror image of another one, which inverts at the opposite curvature:

    >>> from lissome.plates import Defect
    >>> from lissome.plates.snap import dome, inversion, sheet
    >>> plate = sheet(200.0, divisions=1)
    >>> up, down = (
    ...     inversion(plate, Defect().field(0.1, -0.05), stop, initial=dome(plate, up=stop > 0))
    ...     for stop in (2.0, -2.0)
    ... )
    >>> print(f"{up.kind} {down.parameter / up.parameter:.6f}")
    fold -1.000000
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
        after = _descended(
            below, as_balanced(event.equilibrium), event.modes, signs, interrupted, event.parameter
        )
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


@dataclass(frozen=True)
class CriticalCurvature:
    """One point of the master curves of a sheet, in the units of :class:`.PlateScales`.

    Attributes
    ----------
    inverts : bool
        Whether the sheet turns over up to the greatest curvature.
    curvature : float
        Spontaneous curvature along the director at the inversion, over t/L^2; NaN without one.
    uncertainty : float
        Half of the bracket of it.
    kind : str
        "fold" or "bifurcation"; "" without an inversion.
    energy : float
        Energy released on the way to the stable inverted state, over C t^4/L^2; NaN without an
        inversion.
    losses : int
        Losses of stability, the inversion included; earlier ones broke a symmetry only.
    first_loss : float
        Curvature at the first of them; NaN if there is none.
    height_before, height_after : float
        Height of the defect over the mean of the corners (of the rim of a disc), over t, at the
        critical curvature.
    unknowns, factorizations : int
        Size of the problem, and how often its matrix was factored on the path (not on the descent).

    Examples
    --------
    Energy is released on the way down; no loss of stability went before:

    >>> from lissome.plates.snap import CriticalCurvature, critical_curvature
    >>> point = CriticalCurvature(**critical_curvature(200.0, divisions=1))
    >>> print(point.inverts, point.kind, point.losses, point.curvature == point.first_loss)
    True fold 1 True
    >>> print(point.energy > 0, point.height_before > 0 > point.height_after)
    True True
    """

    inverts: bool
    curvature: float
    uncertainty: float
    kind: str
    energy: float
    losses: int
    first_loss: float
    height_before: float
    height_after: float
    unknowns: int
    factorizations: int


def sheet(
    strain: float,
    *,
    offset: Any = (0.0, 0.0),
    shape: str = "square",
    thickness: float = 0.01,
    poisson_ratio: float = 0.5,
    tensor: str | float = "incompressible",
    divisions: int = 3,
    degree: int = 3,
    grading: float = 1.5,
) -> Plate:
    r"""Return a free sheet with a defect, of side (diameter) 1 and stretching modulus 1.

    Parameters
    ----------
    strain : float
        Spontaneous strain across minus along the director, over :math:`(t/L)^2`: what matters of
        a strain where edges are free. Positive: domes.
    offset : array_like, shape (2,)
        Defect, from the middle, over L.
    shape : {"square", "disc"}
    thickness : float
        h/L of a uniform sheet: :math:`t = h/\sqrt{12}`. In the scaled quantities nothing depends on it.
    poisson_ratio : float
    tensor : str or float
        See :func:`.transverse_strain`; to first order.
    divisions, grading
        Of the mesh, see :mod:`lissome.plates.meshes`.
    degree : int
        See :class:`.Plate`.

    Raises
    ------
    InvalidInput
        If the defect is outside, or the tensor is isotropic, so that no difference is left.

    Examples
    --------
    In scaled quantities the thickness does not matter: half of it, and a sixteenth of the energy.

    >>> from lissome.plates.snap import dome, sheet
    >>> thick, thin = (dome(sheet(100.0, divisions=2, thickness=h)).energy for h in (0.01, 0.005))
    >>> print(f"{thick / thin:.6f}")
    16.000000
    """
    center = finite_array("offset", offset, shape=(2,))
    one_of("shape", shape, ("square", "disc"))
    t = positive("thickness", thickness) / math.sqrt(12.0)
    ratio = _ratio(tensor)
    if ratio == 1.0:
        raise InvalidInput(
            f"argument `tensor` is {tensor!r}: strains alike along and across the director do not "
            "bend a free sheet"
        )
    along = finite("strain", strain) * t**2 / (ratio - 1.0)
    defect = Defect(center=(float(center[0]), float(center[1])))
    if max(abs(center)) >= 0.5 or (shape == "disc" and math.hypot(*center) >= 0.5):
        raise InvalidInput(
            f"argument `offset` is ({center[0]:g}, {center[1]:g}); the defect must lie on the sheet, "
            "which reaches to 0.5"
        )
    mesh = (
        rectangle(divisions=divisions, center=center, grading=grading)
        if shape == "square"
        else disc(0.5, divisions, center=center, grading=grading)
    )
    require_inside(defect, mesh)
    return Plate(
        mesh=mesh, bending=t**2, poisson_ratio=poisson_ratio, strain=defect.field(along, ratio * along),
        degree=degree,
    )  # fmt: skip


def _ratio(tensor: str | float) -> float:
    """Return strain across over strain along the director, to first order."""
    small = 1e-7  # finite deformations are linear there
    return float(np.round(transverse_strain(small, tensor) / small, 6))


def critical_curvature(
    strain: float,
    *,
    offset: Any = (0.0, 0.0),
    shape: str = "square",
    thickness: float = 0.01,
    poisson_ratio: float = 0.5,
    tensor: str | float = "incompressible",
    curvature_tensor: str | float | None = None,
    most: float | None = None,
    tolerance: float = 1e-4,
    divisions: int = 3,
    degree: int = 3,
    grading: float = 1.5,
) -> dict[str, Any]:
    r"""Return the critical curvature of a sheet at a given strain, and the energy released.

    The dome of the strain is found, and the spontaneous curvature grows against it until the inertia
    of the tangent tells that stability is lost; then the sheet descends to a stable state. If it is
    not inverted there, it is followed further. A function to be called by :func:`lissome.sweep`.

    Parameters
    ----------
    strain, offset, shape, thickness, poisson_ratio, tensor, divisions, degree, grading
        See :func:`sheet`.
    curvature_tensor : str or float, optional
        Tensor of the spontaneous curvature; by default that of the strain, as the theory of laminates
        has it where all strain is of one kind.
    most : float, optional
        Greatest curvature along the director, over t/L^2, at which to give up; by default 4 times
        `strain`, which is far beyond what the strain can hold.
    tolerance : float
        Bracket of a loss of stability, relative to the curvature.

    Returns
    -------
    dict
        The fields of :class:`CriticalCurvature`.

    Raises
    ------
    InvalidInput
        If an argument is wrong, or the sheet is flat without curvature.
    NotConverged
        If the path or the descent cannot be followed.
    StabilityNotResolvable
        See :func:`lissome.plates.snap.inversion`.

    Examples
    --------
    >>> from lissome.plates.snap import critical_curvature
    >>> found = critical_curvature(200.0, divisions=2)
    >>> found["inverts"], found["kind"], 20 < found["curvature"] < 40
    (True, 'fold', True)
    """
    plate = sheet(
        strain, offset=offset, shape=shape, thickness=thickness, poisson_ratio=poisson_ratio, tensor=tensor,
        divisions=divisions, degree=degree, grading=grading,
    )  # fmt: skip
    t = thickness / math.sqrt(12.0)
    center = np.asarray(offset, dtype=float)
    defect = Defect(center=(float(center[0]), float(center[1])))
    unit = defect.field(t, _ratio(tensor if curvature_tensor is None else curvature_tensor) * t)
    greatest = positive("most", 4.0 * abs(float(strain)) if most is None else most)
    positive("tolerance", tolerance)
    start = dome(plate, center=center)
    found = _followed(plate, unit, greatest, start, tolerance)
    points = plate.mesh.p[:, : plate.mesh.nvertices]
    middle = int(np.argmin(np.hypot(*(points - center[:, None]))))
    far = np.hypot(*points)
    rim = np.flatnonzero(far > far.max() - 1e-9)

    def height(equilibrium: Equilibrium | None) -> float:
        if equilibrium is None:
            return math.nan
        w = plate.deflection(equilibrium.state)
        return float(w[middle] - w[rim].mean()) / t

    return asdict(
        CriticalCurvature(
            inverts=found.inverts, curvature=found.parameter, uncertainty=found.uncertainty,
            kind=found.kind, energy=found.energy_released / t**4, losses=len(found.losses),
            first_loss=found.losses[0].parameter if found.losses else math.nan,
            height_before=height(found.before), height_after=height(found.after),
            unknowns=plate.size, factorizations=found.factorizations,
        )
    )  # fmt: skip


@dataclass(frozen=True)
class _Followed:
    """What :func:`_followed` has come to; see :class:`Inversion`."""

    inverts: bool
    parameter: float
    uncertainty: float
    kind: str
    energy_released: float
    before: Any
    after: Any
    losses: tuple[Any, ...]
    factorizations: int


def _followed(
    plate: Plate, direction: Any, stop: float, initial: Equilibrium, tolerance: float,
    sign: int = 1, most_losses: int = 6,
) -> _Followed:  # fmt: skip
    first = _shape(plate, initial.state)
    flat = 1e-6 * plate.slope_scale * plate.space.extent * np.sqrt(plate.space.area)
    if not float(np.linalg.norm(first)) > flat:
        raise InvalidInput(
            "the plate is flat without curvature: its strain does not make it buckle, so that nothing "
            "can be inverted; raise the strain"
        )

    def at(p: float) -> Plate:
        return plate.with_(curvature=lambda x, y: p * _tensor(direction, x, y))

    force = plate.force_of(direction)
    losses: list[Any] = []
    here, state, count = 0.0, initial.state, 0
    while True:
        path = Path(plate, force, state, here, stop - here)
        loss = path.to_loss(stop, tolerance)
        count += path.factorizations
        if loss is None:
            break
        losses.append(loss)
        beyond = max(tolerance * abs(loss.parameter), 2 * loss.uncertainty)
        frozen = loss.parameter + float(np.copysign(beyond, stop))
        below = at(frozen)
        signs = (1,) if loss.kind == "fold" else (sign, -sign)
        after = _descended(
            below, loss.before.balanced, loss.modes[:2], signs, NotConverged, loss.parameter
        )
        if float(first @ _shape(plate, after.state)) < 0:
            top = below.evaluate(loss.before.balanced.state, NONE, 0).energy
            edge = at(loss.before.parameter)
            evaluation = edge.evaluate(loss.before.balanced.state, NONE, 2)
            before = as_equilibrium(
                replace(loss.before.balanced, structure=edge, evaluation=evaluation)
            )
            return _Followed(
                True, loss.parameter, loss.uncertainty, loss.kind, top - after.energy, before, after,
                tuple(losses), count,
            )  # fmt: skip
        if len(losses) >= most_losses:
            raise NotConverged(
                f"the plate lost its stability {len(losses)} times up to p = {frozen:.6g} without "
                "being inverted",
                state=after.state,
            )
        if (stop - frozen) * np.sign(stop) <= 0:
            break
        here, state = frozen, after.state
    return _Followed(
        False, math.nan, math.nan, "", math.nan, None, None, tuple(losses), count
    )  # fmt: skip
