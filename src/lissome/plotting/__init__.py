"""Pictures for the book and for notebooks: 2-D, moving, and interactive in 3-D.

Nothing here solves anything, and no solver imports this package. Figures are made without pyplot,
so that no global state leaks; each carries words for readers who cannot see it; on a web page its
colors follow the light or dark theme, and in print it is a static picture on white.
"""

from __future__ import annotations

from ._display import Drawing, figure, show
from ._palette import PALETTE, SERIES, color
from .gallery import tiles
from .motion import animate
from .planar import (
    bare,
    clamps,
    curve,
    ground,
    heatmap,
    legend,
    light_arrows,
    ray_direction,
)
from .space import show3d, static_twin

__all__ = [
    "PALETTE",
    "SERIES",
    "Drawing",
    "animate",
    "bare",
    "clamps",
    "color",
    "curve",
    "figure",
    "ground",
    "heatmap",
    "legend",
    "light_arrows",
    "ray_direction",
    "show",
    "show3d",
    "static_twin",
    "tiles",
]
