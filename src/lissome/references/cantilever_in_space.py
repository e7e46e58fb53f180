r"""Cantilevers in space: Kirchhoff rods under a dead end force, by shooting.

An inextensible rod of unit length is clamped at the origin with its directors along the axes (tangent
along the third) and carries a dead force F at its free end. Its internal force is F everywhere; in the
frame R,

.. math:: m' = m\times\kappa + (R^T F)\times e_3, \qquad R' = R\,[\kappa]_\times, \qquad x' = R\,e_3,
   \qquad m = D(\kappa - \kappa_0), \qquad m(1) = 0 .

The three moments at the clamp are found by Newton's method, while the load grows in steps. The
determinant of :math:`\partial m(1)/\partial m(0)` is positive without load and vanishes where a
neighboring equilibrium exists; the branch is followed only as long as it is positive.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from .._validate import finite_array
from ..errors import InvalidInput, NotConverged

__all__ = ["SpatialCantilever", "spatial_cantilever"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpatialCantilever:
    r"""A clamped rod in equilibrium under a dead end force.

    Attributes
    ----------
    force : ndarray, shape (3,)
        F.
    tip : ndarray, shape (3,)
        Position of the free end.
    tip_frame : ndarray, shape (3, 3)
        Its directors as columns.
    clamp_moment : ndarray, shape (3,)
        Internal moment at the clamp.
    energy : float
        Elastic energy.
    stiffness, natural : ndarray, shape (3,)
        D and :math:`\kappa_0`.

    Examples
    --------
    The clamp bears the moment of the force about it, also when the rod leaves its plane:

    >>> import numpy as np
    >>> from lissome.references.cantilever_in_space import spatial_cantilever
    >>> rod = spatial_cantilever([1.0, 0.5, -0.5], stiffness=(1.0, 2.0, 1.5))
    >>> print(np.allclose(rod.clamp_moment, np.cross(rod.tip, rod.force), atol=1e-9))
    True
    """

    force: Array
    tip: Array
    tip_frame: Array
    clamp_moment: Array
    energy: float
    stiffness: Array = field(repr=False)
    natural: Array = field(repr=False)

    def points(self, position: npt.ArrayLike) -> Array:
        """Coordinates at increasing arc lengths `position` in [0, 1], shape (n, 3).

        Raises
        ------
        InvalidInput
            If `position` is not finite.
        """
        s = finite_array("position", position, (None,))
        if s.size and (np.any(np.diff(s) < 0.0) or s[0] < 0.0 or s[-1] > 1.0):
            raise InvalidInput("argument `position` must increase within [0, 1]")
        return _integrate(self.stiffness, self.natural, self.force, self.clamp_moment, s)[:, :3]


def spatial_cantilever(
    force: npt.ArrayLike,
    *,
    stiffness: npt.ArrayLike = (1.0, 1.0, 1.0),
    natural: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> SpatialCantilever:
    r"""Return the cantilever that a growing dead force bends from its natural shape.

    Parameters
    ----------
    force : array_like, shape (3,)
        F, for unit length; the undeformed tangent at the clamp is (0, 0, 1).
    stiffness : array_like, shape (3,), optional
        Bending about the first and the second director, and torsion.
    natural : array_like, shape (3,), optional
        Natural curvatures about the first two directors, and natural twist.

    Returns
    -------
    SpatialCantilever

    Raises
    ------
    InvalidInput
        If an argument is out of its range.
    NotConverged
        If a load step cannot be made: at a fold, or beyond a bifurcation.

    Examples
    --------
    >>> from lissome.references.cantilever_in_space import spatial_cantilever
    >>> rod = spatial_cantilever([5.0, 0.0, 0.0])
    >>> rod.tip[[0, 2]].round(6)
    array([0.713792, 0.612372])
    """
    load = finite_array("force", force, (3,))
    rigidity = finite_array("stiffness", stiffness, (3,))
    if np.any(rigidity <= 0.0):
        raise InvalidInput(f"argument `stiffness` is {rigidity.tolist()}; all must be positive")
    rest = finite_array("natural", natural, (3,))
    # short steps, so that Newton's method cannot change to an equilibrium with more turns
    longest = 1.0 / max(1.0, 0.5 * float(np.linalg.norm(load)) / float(rigidity.min()))
    moment, done, step = np.zeros(3), 0.0, longest
    previous: tuple[Array, float] | None = None
    while done < 1.0:
        share = min(1.0, done + step)
        guess = moment
        if previous is not None and done > previous[1]:
            guess = moment + (moment - previous[0]) * (share - done) / (done - previous[1])
        found = _shoot(rigidity, rest, share * load, guess, 1e-11 if share == 1.0 else 1e-6)
        if found is None:
            step *= 0.5
            if step < 1e-5 * longest:
                raise NotConverged(
                    f"the rod cannot be followed beyond {done:.6f} of the force {load.tolist()}",
                    state=moment,
                )
            continue
        previous = (moment, done)
        moment, done, step = found, share, min(longest, 1.5 * step)
    end = _integrate(rigidity, rest, load, moment, np.array([0.0, 1.0]))[-1]
    return SpatialCantilever(
        force=load,
        tip=end[:3],
        tip_frame=end[3:12].reshape(3, 3),
        clamp_moment=moment,
        energy=float(end[15]),
        stiffness=rigidity,
        natural=rest,
    )


def _integrate(
    stiffness: Array,
    rest: Array,
    force: Array,
    moment: Array,
    stations: Array,
    rtol: float = 1e-12,
) -> Array:
    """Position, frame, moment and energy at the stations, one row each."""

    def right(s: float, y: Array) -> Array:
        frame, m = y[3:12].reshape(3, 3), y[12:15]
        k = rest + m / stiffness
        f = force @ frame
        spin = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
        turn = np.array(
            [
                m[1] * k[2] - m[2] * k[1] + f[1],
                m[2] * k[0] - m[0] * k[2] - f[0],
                m[0] * k[1] - m[1] * k[0],
            ]
        )
        density = 0.5 * np.array([np.sum(m * m / stiffness)])
        return np.concatenate([frame[:, 2], (frame @ spin).ravel(), turn, density])

    start = np.concatenate([np.zeros(3), np.eye(3).ravel(), moment, [0.0]])
    run = solve_ivp(right, (0.0, 1.0), start, "DOP853", t_eval=stations, rtol=rtol, atol=0.1 * rtol)
    return np.asarray(run.y.T)


def _shoot(stiffness: Array, rest: Array, force: Array, guess: Array, goal: float) -> Array | None:
    """Moment at the clamp that leaves none at the end; None if there is none near, or beyond."""
    scale = max(1.0, float(np.linalg.norm(force)))
    moment = guess.copy()
    rtol, size = 1e-8, np.inf
    for _ in range(12):
        if goal < 1e-6 and size < 1e-4:
            rtol = 1e-12
        base, *shifted = (
            _integrate(stiffness, rest, force, moment + offset, np.array([0.0, 1.0]), rtol)[
                -1, 12:15
            ]
            for offset in (np.zeros(3), *(1e-5 * scale * np.eye(3)))
        )
        matrix = (np.array(shifted) - base).T / (1e-5 * scale)
        change = np.linalg.solve(matrix, -base)
        size = float(np.max(np.abs(change))) / scale
        if not np.isfinite(size) or size > 0.3:
            return None
        moment = moment + change
        if size < goal:
            return moment if np.linalg.det(matrix) > 0.0 else None
    return None
