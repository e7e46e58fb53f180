"""Colors that name their role, each with a value for light and one for dark pages."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from ..errors import InvalidInput

__all__ = ["DARK_PAGE", "LIGHT_PAGE", "PALETTE", "SERIES", "Hue", "color"]

#: Backgrounds against which contrast is judged.
LIGHT_PAGE, DARK_PAGE = "#ffffff", "#121212"


@dataclass(frozen=True)
class Hue:
    """One color of the palette.

    Attributes
    ----------
    light, dark : str
        Its value on a light and on a dark page, as ``#rrggbb``. The light value is the one that
        matplotlib sees; it is unique, so that the drawing can be recolored afterwards.
    """

    light: str
    dark: str


#: Roles: `ink` for text and axes, `muted` for grids and secondary lines, `paper` for what must look
#: like the page, and six series colors that color-blind readers can tell apart (after Okabe and
#: Ito, darkened or lightened until each has a contrast of 3 or more against its page).
PALETTE: MappingProxyType[str, Hue] = MappingProxyType(
    {
        "ink": Hue("#1d1e20", "#e3e6ea"),
        "muted": Hue("#8b9097", "#7d858f"),
        "paper": Hue("#fefefd", "#121212"),
        "blue": Hue("#0a6bb0", "#5ab4f2"),
        "orange": Hue("#d55e00", "#ff9d4d"),
        "green": Hue("#00876a", "#2fd3a4"),
        "purple": Hue("#a03d84", "#e79fd0"),
        "gold": Hue("#a87a00", "#f2d64b"),
        "black": Hue("#3c4250", "#c3cad6"),
    }
)

#: Order in which series are colored.
SERIES: tuple[str, ...] = ("blue", "orange", "green", "purple", "gold", "black")


def color(role: str | int) -> str:
    """Return the color of a role, or of the series with a number, for matplotlib.

    Parameters
    ----------
    role : str or int
        A key of :data:`PALETTE`, or the number of a series (taken modulo the number of colors).

    Returns
    -------
    str
        ``#rrggbb``. :func:`lissome.plotting.show` replaces it on dark pages.

    Raises
    ------
    InvalidInput
        If there is no such role.

    Examples
    --------
    >>> color("orange") == color(1)
    True
    """
    if isinstance(role, int) and not isinstance(role, bool):
        return PALETTE[SERIES[role % len(SERIES)]].light
    if not isinstance(role, str) or role not in PALETTE:
        known = ", ".join(PALETTE)
        raise InvalidInput(f"argument `role` is {role!r}; pass a series number or one of {known}")
    return PALETTE[role].light
