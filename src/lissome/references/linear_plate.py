r"""Clamped plates under a load that bends them little, by three other methods.

All solve :math:`D \nabla^4 w = q` with :math:`w = \partial_n w = 0` on the boundary: Ritz's method with
products of polynomials on a square, to rounding; Morley's triangles and interior penalties on
continuous quadratic ones, on any mesh, by forms of scikit-fem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray
from skfem.helpers import dd, ddot, dot, grad, mul, trace

from .._validate import in_open_interval, integer_at_least, one_of, positive

__all__ = ["LinearPlate", "clamped_square", "finite_elements"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearPlate:
    """A clamped plate under an even load.

    Attributes
    ----------
    unknowns : int
        Number of unknowns that are solved for.
    center : float
        Deflection at the middle of the mesh, in units of :math:`q a^4/D`.
    compliance : float
        Integral of the deflection, :math:`q a^6/D`: twice the elastic energy over q.

    Examples
    --------
    >>> from lissome.references.linear_plate import clamped_square
    >>> print(f"{clamped_square().center:.8f}")
    0.00126532
    """

    unknowns: int
    center: float
    compliance: float


def clamped_square(degree: int = 30) -> LinearPlate:
    r"""Return the clamped unit square under an even load, by Ritz's method.

    The deflection is a sum of :math:`(1 - x^2)^2 (1 - y^2)^2 P_i(x) P_j(y)` with even Legendre
    polynomials.

    Parameters
    ----------
    degree : int
        Largest degree i and j; at 30 the center deflection has ten digits.

    Returns
    -------
    LinearPlate

    Raises
    ------
    InvalidInput
        If the degree is negative.

    Examples
    --------
    >>> from lissome.references.linear_plate import clamped_square
    >>> a, b = clamped_square(16), clamped_square(24)
    >>> abs(a.compliance / b.compliance - 1) < 1e-8
    True
    """
    degree = integer_at_least("degree", degree, 0)
    bump = Polynomial([1.0, 0.0, -1.0]) ** 2
    x, weights = np.polynomial.legendre.leggauss(degree + 8)
    shapes = [bump.convert(kind=Legendre) * Legendre.basis(i) for i in range(0, degree + 1, 2)]
    values, slopes, bends = (
        np.array([(s.deriv(k) if k else s)(x) / size for s, size in
                  ((s, np.sqrt(float(np.sum(weights * s.deriv(2)(x) ** 2)))) for s in shapes)])
        for k in (0, 1, 2)
    )  # fmt: skip
    mass, stiff, bend = (f @ (weights[:, None] * f.T) for f in (values, slopes, bends))
    n = len(shapes)
    matrix = np.kron(bend, mass) + np.kron(mass, bend) + 2.0 * np.kron(stiff, stiff)
    one = values @ weights
    load = np.kron(one, one)
    found = np.linalg.solve(matrix, load)
    middle = np.array(
        [s(0.0) / np.sqrt(float(np.sum(weights * s.deriv(2)(x) ** 2))) for s in shapes]
    )
    # On (-1, 1)^2, sides are 2: deflections are 2^4 times, compliances 2^6 times those of sides 1.
    return LinearPlate(
        n * n, float(np.kron(middle, middle) @ found) / 16.0, float(load @ found) / 64.0
    )


def finite_elements(
    mesh: Any, element: str, *, poisson_ratio: float = 0.3, penalty: float = 10.0
) -> LinearPlate:
    r"""Return a clamped plate on a mesh by Morley's triangles, or by interior penalties.

    Parameters
    ----------
    mesh : skfem.MeshTri
        Straight triangles; a vertex lies in the middle of its box.
    element : {"Morley", "interior penalty"}
        Morley: quadratic, discontinuous, joined at vertices and in the middles of edges by values and
        normal slopes. Interior penalty: continuous quadratic triangles; jumps of the slope across edges
        do work on the mean moment there, and cost

        .. math:: \frac{\sigma D}{h} \int [\partial_n w]^2 .
    poisson_ratio : float
        In (-1, 1); for a clamped plate it changes the error only.
    penalty : float
        :math:`\sigma`.

    Returns
    -------
    LinearPlate
        In units of q over D, with lengths of the mesh.

    Raises
    ------
    InvalidInput
        If a name is unknown, or a number out of range.

    Examples
    --------
    >>> import skfem
    >>> from lissome.references.linear_plate import clamped_square, finite_elements
    >>> mesh = skfem.MeshTri.init_sqsymmetric().refined(2)
    >>> plate = finite_elements(mesh, "Morley")
    >>> print(f"{plate.compliance / clamped_square(16).compliance:.2f}")
    1.49
    """
    one_of("element", element, ("Morley", "interior penalty"))
    nu = in_open_interval("poisson_ratio", poisson_ratio, -1.0, 1.0, "Poisson's ratio of a plate")
    sigma = positive("penalty", penalty)

    def moment(w: Any) -> Any:
        bent = dd(w)
        return (1 - nu) * bent + nu * np.einsum("ij,...->ij...", np.eye(2), trace(bent))

    @skfem.BilinearForm
    def bending(w: Any, v: Any, p: Any) -> Any:
        return ddot(moment(w), dd(v))

    @skfem.LinearForm
    def load(v: Any, p: Any) -> Any:
        return 1.0 * v

    kind = (
        skfem.ElementTriMorley() if element == "Morley" else skfem.ElementTriP2G()
    )  # with second derivatives
    basis = skfem.Basis(mesh, kind, intorder=4)
    matrix, right = bending.assemble(basis), load.assemble(basis)
    held = basis.get_dofs().all()
    if element == "interior penalty":

        def parts(w: Any, p: Any, sign: float) -> tuple[Any, Any]:
            return sign * dot(grad(w), p.n), dot(mul(moment(w), p.n), p.n)

        @skfem.BilinearForm
        def inside(w: Any, v: Any, p: Any) -> Any:
            (jw, mw), (jv, mv) = (
                parts(f, p, (-1.0) ** i) for f, i in zip((w, v), p.idx, strict=True)
            )
            return sigma / p.h * jw * jv - 0.5 * (mw * jv + mv * jw)

        @skfem.BilinearForm
        def rim(w: Any, v: Any, p: Any) -> Any:
            (jw, mw), (jv, mv) = (parts(f, p, 1.0) for f in (w, v))
            return sigma / p.h * jw * jv - (mw * jv + mv * jw)

        sides = [skfem.InteriorFacetBasis(mesh, kind, side=i, intorder=4) for i in (0, 1)]
        matrix = matrix + skfem.asm(inside, sides, sides)
        matrix = matrix + rim.assemble(skfem.BoundaryFacetBasis(mesh, kind, intorder=4))
    w = skfem.solve(*skfem.condense(matrix, right, D=held))
    box = np.mean([mesh.p.min(axis=1), mesh.p.max(axis=1)], axis=0)
    vertex = int(np.argmin(np.hypot(*(mesh.p - box[:, None]))))
    center = float(w[basis.nodal_dofs[0, vertex]])
    return LinearPlate(len(w) - len(held), center, float(right @ w))
