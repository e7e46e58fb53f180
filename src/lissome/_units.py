"""Physical quantities at the boundary of the API: pint in, plain floats out."""

from __future__ import annotations

import math
from typing import Any

from .errors import InvalidInput

__all__ = ["is_quantity", "magnitude"]


def is_quantity(value: Any) -> bool:
    """Return whether `value` carries units: a string such as ``"30 um"`` or a pint quantity."""
    return isinstance(value, str) or (hasattr(value, "to") and hasattr(value, "magnitude"))


def magnitude(name: str, value: Any, unit: str, example: str) -> float:
    """Return the number of a quantity in `unit`.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : str or pint.Quantity
        Such as ``"30 um"``.
    unit : str
        The unit of the result; temperatures are absolute, so ``"degC"`` takes ``"433 K"``.
    example : str
        What a right value looks like, for the message.

    Returns
    -------
    float

    Raises
    ------
    InvalidInput
        If the value has no units or wrong ones, or is not finite.

    Examples
    --------
    >>> print(f"{magnitude('thickness', '30 um', 'm', '30 um'):.1e}")
    3.0e-05
    """
    import pint

    registry: Any = pint.get_application_registry()
    wanted = f"pass a quantity with units of {unit}, such as {example!r} or a pint.Quantity"
    if isinstance(value, str):
        try:
            quantity = _parsed(registry, value)
        except Exception as error:
            raise InvalidInput(
                f"argument `{name}` is {value!r}, which is no quantity ({error}); {wanted}"
            ) from error
    elif isinstance(value, pint.Quantity):
        quantity = value
    else:
        raise InvalidInput(f"argument `{name}` is {value!r}, without units; {wanted}")
    try:
        number = float(quantity.to(unit).magnitude)
    except (pint.PintError, TypeError, ValueError) as error:
        raise InvalidInput(f"argument `{name}` is {value!s}; {wanted} ({error})") from error
    if not math.isfinite(number):
        raise InvalidInput(f"argument `{name}` is {value!s}; it must be finite")
    return number


def _parsed(registry: Any, text: str) -> Any:
    """Parse a string; "160 degC" too, which is an offset unit and not a product."""
    head, _, tail = text.strip().partition(" ")
    try:
        number = float(head)
    except ValueError:
        return registry.Quantity(text)
    return registry.Quantity(number, tail) if tail else registry.Quantity(text)
