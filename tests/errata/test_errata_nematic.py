"""How far a nematic elastomer contracts and extends as its order falls, by computer algebra."""

import sympy as sp

r, r0 = sp.symbols("r r_0", positive=True)
stretch = sp.symbols("lambda", positive=True)


def steps(anisotropy):
    """Return the tensor of squared step lengths of the chains, of determinant 1, along the axes."""
    along, across = anisotropy ** sp.Rational(2, 3), anisotropy ** -sp.Rational(1, 3)
    return sp.diag(along, across, across)


def test_stretches_are_roots_of_the_ratios_of_step_lengths():
    """Of the energy tr(l0 F^T l^-1 F) of a network made at r0, at no stress and no change of volume."""
    assert sp.simplify(steps(r).det()) == 1
    deformation = sp.diag(stretch, 1 / sp.sqrt(stretch), 1 / sp.sqrt(stretch))
    energy = sp.trace(steps(r0) * deformation.T * steps(r).inv() * deformation)
    slope = sp.diff(energy, stretch)
    natural = (r / r0) ** sp.Rational(1, 3)  # along the director
    assert sp.simplify(slope.subs(stretch, natural)) == 0
    assert sp.simplify(sp.diff(energy, stretch, 2).subs(stretch, natural)).is_positive
    assert sp.simplify(1 / sp.sqrt(natural) - (r0 / r) ** sp.Rational(1, 6)) == 0  # across it
    printed = (r / r0) ** sp.Rational(2, 3), (r0 / r) ** sp.Rational(1, 3)
    assert sp.simplify(slope.subs(stretch, printed[0])) != 0
    assert sp.simplify(printed[0] - natural**2) == 0
    # The ratio of the two small strains, -2, is the same for stretches and for their squares.
    small = [sp.diff(sp.log(s), r).subs(r, r0) for s in (*printed, natural, 1 / sp.sqrt(natural))]
    assert sp.simplify(small[0] / small[1]) == sp.simplify(small[2] / small[3]) == -2
