r"""Plates of liquid-crystal elastomers that dome, snap and leap: chapter 5.

One set of conventions holds in the whole package. The coordinate z points up from the middle of the
thickness, layers are listed from the bottom, w is the deflection upward, and curvature means
:math:`\nabla\nabla w`: a dome is negative, a cup positive. A :class:`Plate` is one structure for all
of them; its meshes are in :mod:`lissome.plates.meshes`, its snaps in :mod:`lissome.plates.snap`.

Examples
--------
A soft film that contracts much on a stiff one that contracts little, evenly heated: a cup.

>>> from lissome.plates import Laminate, Layer, SigmoidCurve
>>> much = SigmoidCurve(saturation=0.3, transition=170.0, width=10.0)
>>> little = SigmoidCurve(saturation=0.3, transition=225.0, width=20.0)
>>> sheet = Laminate([Layer(1.0, 17.0, 0.5, strain=little), Layer(2.0, 3.2, 0.5, strain=much)])
>>> bool(sheet.spontaneous(160.0).curvature_along > 0)
True
"""

from .actuation import SpontaneousHistory, spontaneous_history
from .conduction import (
    Conduction,
    Convection,
    FixedTemperature,
    HeatFlux,
    Insulated,
    TemperatureHistory,
    TemperatureProfile,
)
from .directors import (
    Defect,
    DirectedTensor,
    Director,
    UniformDirector,
    UserDirector,
    require_inside,
)
from .films import (
    film_curve,
    film_fits,
    film_laminate,
    film_layer,
    measured_film_curve,
)
from .heated_plate import HeatedPlate
from .laminate import Laminate, Layer, SpontaneousDeformation
from .leap import (
    Flight,
    energy_height,
    flight_from_heights,
    launch_speed_with_drag,
    terminal_speed,
)
from .mixed_plate import MixedPlate, projected_bending
from .plate import Plate, PlateEquilibrium, PlateState
from .scales import PlateScales
from .thermal_strain import (
    NoStrain,
    SigmoidCurve,
    TabulatedCurve,
    fit_sigmoid,
    transverse_strain,
)

__all__ = [
    "Conduction",
    "Convection",
    "Defect",
    "DirectedTensor",
    "Director",
    "FixedTemperature",
    "Flight",
    "HeatFlux",
    "HeatedPlate",
    "Insulated",
    "Laminate",
    "Layer",
    "MixedPlate",
    "NoStrain",
    "Plate",
    "PlateEquilibrium",
    "PlateScales",
    "PlateState",
    "SigmoidCurve",
    "SpontaneousDeformation",
    "SpontaneousHistory",
    "TabulatedCurve",
    "TemperatureHistory",
    "TemperatureProfile",
    "UniformDirector",
    "UserDirector",
    "energy_height",
    "film_curve",
    "film_fits",
    "film_laminate",
    "film_layer",
    "fit_sigmoid",
    "flight_from_heights",
    "launch_speed_with_drag",
    "measured_film_curve",
    "projected_bending",
    "require_inside",
    "spontaneous_history",
    "terminal_speed",
    "transverse_strain",
]
