"""Numbers in print: no digit beyond the uncertainty."""

from __future__ import annotations

import math
from decimal import ROUND_HALF_EVEN, Decimal, localcontext
from typing import Any

from ._validate import finite, nonnegative, one_of

__all__ = ["rounded", "with_uncertainty"]

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_EPSILON = 2.0**-53  # a float does not know its further digits, whatever the caller believes


def with_uncertainty(value: Any, uncertainty: Any, style: str = "text") -> str:
    """Return a number with the uncertainty of its last digits in parentheses.

    The uncertainty has one digit, two if the first is 1. Very large and very small numbers, and
    numbers that are uncertain before the point, are written in scientific form.

    Parameters
    ----------
    value : float
        The number.
    uncertainty : float
        Its uncertainty in the same unit; 0 says that the number is exact.
    style : {'text', 'unicode', 'latex'}, optional
        ``2.04(3)e-4``, ``2.04(3) × 10⁻⁴`` or ``2.04(3) \\times 10^{-4}``.

    Returns
    -------
    str

    Raises
    ------
    InvalidInput
        If a number is not finite, the uncertainty is negative, or the style is unknown.

    Examples
    --------
    >>> with_uncertainty(65.1312, 0.04)
    '65.13(4)'
    >>> with_uncertainty(2.0417e-4, 1.3e-6), with_uncertainty(2.0417e-4, 1.3e-6, "unicode")
    ('2.042(13)e-4', '2.042(13) × 10⁻⁴')
    >>> with_uncertainty(1119.28, 30)
    '1.12(3)e3'
    >>> with_uncertainty(0.5, 0)
    '0.5'
    """
    digits, last, exponent = _parts(value, uncertainty)
    return _joined(digits + (f"({last})" if last else ""), exponent, style)


def rounded(value: Any, uncertainty: Any, style: str = "text") -> str:
    """Return a number rounded where its uncertainty begins, without the uncertainty.

    Parameters
    ----------
    value, uncertainty, style
        As in :func:`with_uncertainty`.

    Examples
    --------
    >>> rounded(65.1312, 0.04), rounded(-2.0417e-4, 1.3e-6), rounded(2, 0)
    ('65.13', '-2.042e-4', '2')
    """
    digits, _, exponent = _parts(value, uncertainty)
    return _joined(digits, exponent, style)


def _joined(digits: str, exponent: int, style: str) -> str:
    one_of("style", style, ("text", "unicode", "latex"))
    if exponent == 0:
        return digits
    if style == "text":
        return f"{digits}e{exponent}"
    if style == "unicode":
        return f"{digits} × 10{str(exponent).translate(_SUPERSCRIPTS)}"
    return rf"{digits} \times 10^{{{exponent}}}"


def _parts(value: Any, uncertainty: Any) -> tuple[str, str, int]:
    """Return the digits of the number, those of the uncertainty, and a power of ten."""
    number = finite("value", value, largest=math.inf)
    spread = nonnegative("uncertainty", uncertainty, largest=math.inf)
    with localcontext() as context:
        context.prec = 800  # any two floats side by side
        v = Decimal(repr(number))
        if spread == 0.0:
            v = v.normalize()
            exponent = _exponent(v.adjusted(), -1) if v else 0
            return _plain(v.scaleb(-exponent).normalize()), "", exponent
        u = max(Decimal(repr(spread)), abs(v) * Decimal(_EPSILON))
        first = u.adjusted()
        place = first - (1 if u.scaleb(-first) < 2 else 0)
        quantum = Decimal(1).scaleb(place)
        v = v.quantize(quantum, ROUND_HALF_EVEN)
        u = u.quantize(quantum, ROUND_HALF_EVEN)
        leading = max(v.adjusted() if v else place, u.adjusted())
        exponent = _exponent(leading, place)
        return (
            _plain(v.scaleb(-exponent)),
            str(int(u.scaleb(-place))) if place - exponent < 0 else _plain(u.scaleb(-exponent)),
            exponent,
        )


def _exponent(leading: int, place: int) -> int:
    return 0 if -3 <= leading < 6 and place <= 0 else leading


def _plain(number: Decimal) -> str:
    text = f"{number:f}"
    return text[1:] if text.startswith("-") and not number else text
