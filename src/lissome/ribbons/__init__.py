"""Inextensible elastic ribbons: developable strips, open and closed, and their stability.

Wunderlich's model of chapter 4 of the thesis, and Sadowsky's limit: a rod whose hinges bend about
rulings, which are unknowns too. Units are the caller's. Self-contact is not modeled.
"""

from __future__ import annotations

from ._equilibrium import RibbonEquilibrium
from ._structure import Ribbon, RibbonState
from .laws import RibbonLaw, Sadowsky, Wunderlich, width_factor
from .shapes import LIMIT, band, circle, straight
from .surface import DevelopedSurface

__all__ = [
    "LIMIT",
    "DevelopedSurface",
    "Ribbon",
    "RibbonEquilibrium",
    "RibbonLaw",
    "RibbonState",
    "Sadowsky",
    "Wunderlich",
    "band",
    "circle",
    "straight",
    "width_factor",
]
