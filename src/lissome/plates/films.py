r"""The films of the leaping sheets, from Table A.1 of the thesis.

The strain of the films against temperature was measured but is printed nowhere. Table A.1 gives two
numbers of each curve: the temperature of its inflection and its mean slope from 155 to 165 degrees.
A sigmoid through these leaves open, and takes as arguments here, the **width** of either transition,
the **transition of the stiff film**, of which only "> 225" is printed, and the **form** of the
sigmoid. The slopes have no unit in print: per cent per degree is taken, since the strains would
otherwise be above one or below a thousandth.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from .. import literature
from .._validate import finite, one_of, positive
from ..errors import InvalidInput
from .laminate import Laminate, Layer
from .thermal_strain import SigmoidCurve, StrainCurve, TabulatedCurve, fit_sigmoid

__all__ = [
    "film_curve",
    "film_fits",
    "film_laminate",
    "film_layer",
    "measured_film_curve",
]

FILMS: tuple[str, ...] = ("stiff", "soft")
_DIRECTIONS = {"along": "parallel", "across": "perpendicular"}


@functools.cache
def _printed(name: str) -> literature.Number:
    return literature.value(name)


def film_curve(
    film: str,
    *,
    width: float,
    transition: float | None = None,
    reference: float | None = None,
    shape: str = "logistic",
) -> SigmoidCurve:
    """Return the strain of a film against temperature (degrees Celsius).

    Parameters
    ----------
    film : {"stiff", "soft"}
        The film of 1:0.5 or of 1:0.75 acrylate to thiol.
    width : float
        Width of the transition in degrees: not printed.
    transition : float, optional
        The inflection. Of the stiff film only a lower bound is printed, which is the default and
        the least value taken; that of the soft film is printed, and another one is refused.
    reference : float, optional
        Temperature of zero strain: the start of the ramp, 25 degrees, by default.
    shape : {"logistic", "gaussian"}
        Form of the sigmoid.

    Returns
    -------
    SigmoidCurve

    Raises
    ------
    InvalidInput
        If the transition contradicts Table A.1, or no film can have the slope with that width.

    Examples
    --------
    >>> from lissome.plates import film_curve
    >>> for film, width in (("stiff", 25.0), ("soft", 12.0)):
    ...     print(f"{film}: {100 * film_curve(film, width=width)(160.0):.1f} %")
    stiff: -1.3 %
    soft: -9.4 %
    """
    one_of("film", film, FILMS)
    printed = _printed(f"ta1-{film}-transition")
    middle = float(printed) if transition is None else finite("transition", transition)
    if printed.relation == "equal" and middle != float(printed):
        raise InvalidInput(
            f"argument `transition` is {middle:g}; Table A.1 prints {printed.printed} for the {film} "
            "film: leave it out, or use fit_sigmoid for a film of your own"
        )
    if middle < float(printed):
        raise InvalidInput(
            f"argument `transition` is {middle:g}; Table A.1 says {printed.printed} for the {film} "
            "film: pass at least that, or use fit_sigmoid for a film of your own"
        )
    start = _printed("c5-ramp-start") if reference is None else reference
    return fit_sigmoid(
        transition=middle,
        rate=0.01 * float(_printed(f"ta1-{film}-strain-rate")),
        between=(
            float(_printed("ta1-slope-temperature-min")),
            float(_printed("ta1-slope-temperature-max")),
        ),
        width=width,
        reference=float(start),
        shape=shape,
    )


def measured_film_curve(
    film: str, *, outside: str = "refuse", folder: Any = None
) -> TabulatedCurve:
    """Return the measured strain of a film, once somebody has digitized Fig. 5.2B.

    Parameters
    ----------
    film : {"stiff", "soft"}
        Which film.
    outside : {"refuse", "hold", "extend"}
        See :class:`TabulatedCurve`.
    folder : path-like, optional
        Folder of the data, see :func:`lissome.literature.load`.

    Returns
    -------
    TabulatedCurve

    Raises
    ------
    InvalidInput
        If the film is none of the two.
    DataAwaited
        Until the slot ``film-strains`` is filled; the message says how to do it.

    Examples
    --------
    >>> from lissome.literature import is_available
    >>> from lissome.plates import measured_film_curve
    >>> curve = measured_film_curve("soft") if is_available("film-strains") else None
    """
    one_of("film", film, FILMS)
    table = literature.load("film-strains", folder)
    here = table["film"] == film
    return TabulatedCurve(table["temperature"][here], 0.01 * table["strain"][here], outside)


def film_layer(
    film: str,
    curve: StrainCurve,
    *,
    modulus: str = "across",
    poisson_ratio: float = 0.5,
    tensor: str | float = "incompressible",
    diffusivity: Any = None,
) -> Layer:
    """Return one film as a layer: 30 micrometers thick, lengths in meters, moduli in pascals.

    Parameters
    ----------
    film : {"stiff", "soft"}
        Which modulus.
    curve : callable
        Its strain, as from :func:`film_curve`, or measured.
    modulus : {"across", "along"}
        The modulus of Table A.1 across or along the director; the theory has one modulus only. The
        thesis names the former as that which matters.
    poisson_ratio : float
        Not printed; 1/2 is that of an elastomer.
    tensor : str or float
        See :func:`lissome.plates.transverse_strain`; not printed.
    diffusivity : str or pint.Quantity, optional
        Not printed. Without it only scaled times mean anything.

    Returns
    -------
    Layer

    Raises
    ------
    InvalidInput
        If the film or the modulus is none of the two.

    Examples
    --------
    >>> from lissome.plates import film_curve, film_layer
    >>> layer = film_layer("stiff", film_curve("stiff", width=25.0))
    >>> print(f"{1e6 * layer.thickness:.0f} micrometers")
    30 micrometers
    """
    one_of("film", film, FILMS)
    direction = _DIRECTIONS[one_of("modulus", modulus, _DIRECTIONS)]
    values = {
        "thickness": _printed("c5-film-thickness").to("m"),
        "modulus": _printed(f"ta1-{film}-modulus-{direction}").to("Pa"),
    }
    if diffusivity is None:
        return Layer(
            values["thickness"], values["modulus"], poisson_ratio, curve, tensor, name=film
        )
    return Layer.of(
        thickness=f"{values['thickness']} m",
        modulus=f"{values['modulus']} Pa",
        poisson_ratio=poisson_ratio,
        diffusivity=diffusivity,
        strain=curve,
        tensor=tensor,
        name=film,
    )


def film_laminate(
    films: Sequence[str] = ("stiff", "soft", "soft"),
    *,
    soft_width: float | None = None,
    stiff_width: float | None = None,
    stiff_transition: float | None = None,
    shape: str = "logistic",
    curves: Mapping[str, StrainCurve] | None = None,
    modulus: str = "across",
    poisson_ratio: float = 0.5,
    tensor: str | float = "incompressible",
    diffusivity: Any = None,
) -> Laminate:
    """Return a stack of the films of Table A.1, listed from the bottom.

    Parameters
    ----------
    films : sequence of {"stiff", "soft"}
        By default the sheet that leaps, its stiff film down.
    soft_width, stiff_width, stiff_transition, shape
        What Table A.1 leaves open, see :func:`film_curve`.
    curves : mapping, optional
        Strain curves of your own for ``"soft"`` and ``"stiff"``, instead of widths.
    modulus, poisson_ratio, tensor, diffusivity
        See :func:`film_layer`.

    Returns
    -------
    Laminate

    Raises
    ------
    InvalidInput
        If a film is unknown, or neither its width nor its curve is given.

    Examples
    --------
    The stretching modulus of the leaping sheet is not the 1053 Pa m of Table 5.2:

    >>> from lissome.plates import film_laminate
    >>> sheet = film_laminate(soft_width=12.0, stiff_width=25.0)
    >>> print(f"{sheet.stretching_modulus:.0f}")
    702
    """
    if isinstance(films, str) or not isinstance(films, Iterable):
        raise InvalidInput(
            f"argument `films` is {films!r}; pass a sequence such as ('stiff', 'soft', 'soft'), the "
            "bottom film first"
        )
    if curves is None:
        if soft_width is None or stiff_width is None:
            raise InvalidInput(
                f"arguments `soft_width` and `stiff_width` are {soft_width!r} and {stiff_width!r}; the "
                "thesis prints neither: pass both, or `curves` of your own"
            )
        transition = None
        if stiff_transition is not None:
            transition = positive("stiff_transition", stiff_transition)
        curves = {
            "soft": film_curve("soft", width=positive("soft_width", soft_width), shape=shape),
            "stiff": film_curve(
                "stiff",
                width=positive("stiff_width", stiff_width),
                transition=transition,
                shape=shape,
            ),
        }
    elif soft_width is not None or stiff_width is not None or stiff_transition is not None:
        raise InvalidInput("arguments `curves` and widths or transitions exclude each other")
    missing = {one_of("films", film, FILMS) for film in films} - set(curves)
    if missing:
        raise InvalidInput(f"argument `curves` lacks {sorted(missing)}; give one for each film")
    return Laminate(
        [
            film_layer(
                film,
                curves[film],
                modulus=modulus,
                poisson_ratio=poisson_ratio,
                tensor=tensor,
                diffusivity=diffusivity,
            )
            for film in films
        ]
    )


def film_fits(
    *,
    soft_widths: Sequence[float] = (5.0, 10.0, 15.0, 20.0, 30.0),
    stiff_widths: Sequence[float] = (10.0, 20.0, 30.0, 45.0, 60.0),
    stiff_transitions: Sequence[float] = (225.0, 250.0, 275.0),
    shapes: Sequence[str] = ("logistic", "gaussian"),
    moduli: Sequence[str] = ("across", "along"),
) -> Iterator[dict[str, Any]]:
    """Yield arguments of :func:`film_laminate` that fit Table A.1, over a grid of what it leaves open.

    Left out are combinations that contradict Table A.1 or the text: those with which no film can
    have the printed slope, and those in which the soft film does not contract more than the stiff
    one at the temperature of the plate (Sec. 5.2).

    Parameters
    ----------
    soft_widths, stiff_widths : sequence of float
        Widths of the transitions, in degrees.
    stiff_transitions : sequence of float
        Inflections of the stiff film, in degrees Celsius.
    shapes : sequence of {"logistic", "gaussian"}
        Forms of the sigmoid.
    moduli : sequence of {"across", "along"}
        Which modulus of Table A.1 counts.

    Yields
    ------
    dict

    Examples
    --------
    Every combination is a stack that the table allows:

    >>> from lissome.plates import film_fits, film_laminate
    >>> for arguments in film_fits(soft_widths=[12.0], stiff_widths=[25.0], moduli=["across"]):
    ...     stack = film_laminate(**arguments)
    >>> len(stack.layers), "soft_width" in arguments
    (3, True)
    """
    hot = float(_printed("c5-plate-temperature"))
    for soft, stiff, transition, shape in itertools.product(
        soft_widths, stiff_widths, stiff_transitions, shapes
    ):
        try:
            curves = (
                film_curve("soft", width=soft, shape=shape),
                film_curve("stiff", width=stiff, transition=transition, shape=shape),
            )
        except InvalidInput:
            continue
        if curves[0](hot) >= curves[1](hot):
            continue
        for modulus in moduli:
            yield {
                "soft_width": soft,
                "stiff_width": stiff,
                "stiff_transition": transition,
                "shape": shape,
                "modulus": modulus,
            }
