"""Discrete elastic rods: equilibria of bent and twisted rods in space, and their stability.

The rods of chapter 4 of the thesis: a chain of rigid segments with frames, elastic hinges at the
nodes. Units are the caller's: energies are stiffness over length.

Self-contact is not modeled: a rod may pass through itself. :func:`lissome.equilibrate` warns of it,
and ``self_crossings()`` of an equilibrium tells where.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import laws, measures, quaternions, sections, topology
from ._equilibrium import RodEquilibrium
from ._structure import Rod, RodState
from .law_checks import check_law
from .laws import Kirchhoff, Law
from .loads import Loads
from .ribbon_laws import RefinedRibbon, RelaxedRibbon, SanoWada, crossover_length
from .sections import Circle, Ellipse, Rectangle
from .shapes import along, arc, helix, ring, straight
from .supports import Support
from .topology import linking_number, self_crossings, writhe
from .user_laws import FunctionLaw, SymbolicLaw

if TYPE_CHECKING:
    from .centerline import CenterlineState
    from .centerline_structure import CenterlineTwist

__all__ = [
    "CenterlineState",
    "CenterlineTwist",
    "Circle",
    "Ellipse",
    "FunctionLaw",
    "Kirchhoff",
    "Law",
    "Loads",
    "Rectangle",
    "RefinedRibbon",
    "RelaxedRibbon",
    "Rod",
    "RodEquilibrium",
    "RodState",
    "SanoWada",
    "Support",
    "SymbolicLaw",
    "along",
    "arc",
    "check_law",
    "crossover_length",
    "helix",
    "laws",
    "linking_number",
    "measures",
    "quaternions",
    "ring",
    "sections",
    "self_crossings",
    "straight",
    "topology",
    "writhe",
]


def __getattr__(name: str) -> Any:
    if name == "CenterlineState":
        from .centerline import CenterlineState

        return CenterlineState
    if name == "CenterlineTwist":
        from .centerline_structure import CenterlineTwist

        return CenterlineTwist
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING", "Any", "annotations"})
