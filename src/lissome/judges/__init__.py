"""The judges: one small pure function for each claim of the thesis.

A judge names the facts that a page has to record and decides by them; the verdict is computed, not
asserted. To add judges, write them in a module of this package as in :mod:`lissome.judges.beams`,
list them in its ``JUDGES``, and name the module in ``_MODULES`` below.
"""

from __future__ import annotations

from types import MappingProxyType

from . import beams, derivatives, overview, plates, ribbons, rods
from ._core import Check, Facts, Judge, Need, Outcome

__all__ = ["JUDGES", "Check", "Facts", "Judge", "Need", "Outcome"]

_MODULES = (overview, beams, rods, ribbons, plates, derivatives)

JUDGES = MappingProxyType({judge.id: judge for module in _MODULES for judge in module.JUDGES})
