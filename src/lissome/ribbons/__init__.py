"""Inextensible elastic ribbons: developable strips, open and closed, and their stability.

Wunderlich's model of chapter 4 of the thesis, and Sadowsky's limit: a rod whose hinges bend about
rulings, which are unknowns too. Units are the caller's. Self-contact is not modeled.
"""

from __future__ import annotations

from ._equilibrium import RibbonEquilibrium
from ._structure import Ribbon, RibbonState
from .laws import RibbonLaw, Sadowsky, Wunderlich, width_factor
from .shapes import WIDEST_BAND, band, circle, straight
from .surface import DevelopedSurface

__all__ = [
    "WIDEST_BAND",
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
