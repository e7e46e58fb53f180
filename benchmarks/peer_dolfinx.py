"""A clamped linear plate by dolfinx, for a comparison; runs in the Python that has dolfinx.

Continuous triangles with interior penalties. Reads lines from its input: after each it assembles and
solves once more, and answers with unknowns and compliance. Usage: peer_dolfinx.py DEGREE DIVISIONS.
"""

import sys

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as meshes
from dolfinx.fem.petsc import LinearProblem
from mpi4py import MPI

NU = 0.3


def problem(degree, divisions):
    """Return forms and supports on a square with crossed diagonals."""
    mesh = meshes.create_unit_square(
        MPI.COMM_SELF, divisions, divisions, diagonal=meshes.DiagonalType.crossed
    )
    space = fem.FunctionSpace(mesh, ("CG", degree))
    w, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    n, h = ufl.FacetNormal(mesh), ufl.CellDiameter(mesh)
    sigma = 5.0 * degree * (degree - 1)

    def moment(f):
        return (1 - NU) * ufl.grad(ufl.grad(f)) + NU * ufl.div(ufl.grad(f)) * ufl.Identity(2)

    def across(f):
        return ufl.dot(ufl.dot(moment(f), n), n)

    def mean(f):
        sides = [ufl.dot(ufl.dot(moment(f(s)), n(s)), n(s)) for s in "+-"]
        return 0.5 * (sides[0] + sides[1])

    def jump(f):
        return ufl.jump(ufl.grad(f), n)

    def slope(f):
        return ufl.dot(ufl.grad(f), n)

    form = ufl.inner(moment(w), ufl.grad(ufl.grad(v))) * ufl.dx
    form += sigma / ufl.avg(h) * jump(w) * jump(v) * ufl.dS
    form -= (mean(w) * jump(v) + mean(v) * jump(w)) * ufl.dS
    form += (sigma / h * slope(w) * slope(v) - across(w) * slope(v) - across(v) * slope(w)) * ufl.ds
    rim = meshes.locate_entities_boundary(mesh, 1, lambda x: np.full(x.shape[1], True))
    held = fem.dirichletbc(0.0, fem.locate_dofs_topological(space, 1, rim), space)
    return space, form, v * ufl.dx, held


def main(degree, divisions):
    """Answer each line of the input."""
    space, form, load, held = problem(degree, divisions)
    for _ in sys.stdin:
        options = {"ksp_type": "preonly", "pc_type": "lu"}
        found = LinearProblem(form, load, bcs=[held], petsc_options=options).solve()
        compliance = fem.assemble_scalar(fem.form(found * ufl.dx))
        print("answer", space.dofmap.index_map.size_global, compliance, flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
