"""Strips and rings that bend under light: the photomechanical elastica of chapter 3.

A planar inextensible elastica whose natural curvature relaxes, within the relaxation time of the
material, to what the light on its lit face asks for. Lengths are in units of the length of the
elastica, times in relaxation times, energies in units of bending stiffness over length.

Examples
--------
>>> import numpy as np
>>> from lissome import beams
>>> strip = beams.ClampedStrip(span=0.95, response=+1.0, segments=100)
>>> history = strip.under(beams.ParallelLight(intensity=10.0, angle=np.pi / 4)).run(until=12.0)
>>> print(f"{history.period:.2f}")
3.03
"""

from ._evolving import LitStrip
from ._material import Illumination, absorption_moment, illumination
from ._motion import ElasticaHistory, ElasticaSnap, Motion, Period
from ._structures import ClampedStrip, Elastica, ElasticaEquilibrium, ElasticaState, Ring
from ._survey import FirstSnap, Flapping, first_snap, flapping
from .light import GaussianSpot, Light, ParallelLight, UserLight

__all__ = [
    "ClampedStrip",
    "Elastica",
    "ElasticaEquilibrium",
    "ElasticaHistory",
    "ElasticaSnap",
    "ElasticaState",
    "FirstSnap",
    "Flapping",
    "GaussianSpot",
    "Illumination",
    "Light",
    "LitStrip",
    "Motion",
    "ParallelLight",
    "Period",
    "Ring",
    "UserLight",
    "absorption_moment",
    "first_snap",
    "flapping",
    "illumination",
]
