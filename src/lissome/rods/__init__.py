"""Discrete elastic rods: equilibria of bent and twisted rods in space, and their stability.

The rods of chapter 4 of the thesis: a chain of rigid segments with frames, elastic hinges at the
nodes. Units are the caller's: energies are stiffness over length.
"""

from . import laws, measures, quaternions, sections
from ._equilibrium import Reaction, RodEquilibrium
from ._structure import Rod, RodState
from .law_checks import check_law
from .laws import Kirchhoff, Law
from .loads import Loads
from .sections import Circle, Ellipse, Rectangle
from .supports import Support

__all__ = [
    "Circle",
    "Ellipse",
    "Kirchhoff",
    "Law",
    "Loads",
    "Reaction",
    "Rectangle",
    "Rod",
    "RodEquilibrium",
    "RodState",
    "Support",
    "check_law",
    "laws",
    "measures",
    "quaternions",
    "sections",
]
