"""Small pictures side by side, each leading to a page."""

from __future__ import annotations

import html
import io
from collections.abc import Sequence

from matplotlib.figure import Figure
from PIL import Image

from ..errors import InvalidInput
from ._display import SHEET, Drawing, checked_alt, png, svg

__all__ = ["tiles"]

_SHEET = (
    "<style>.lissome-tiles{display:grid;gap:1rem;"
    "grid-template-columns:repeat(auto-fit,minmax(11rem,1fr))}"
    "@media(max-width:600px){.lissome-tiles{grid-template-columns:1fr 1fr}}"
    ".lissome-tiles>a{display:flex;flex-direction:column;justify-content:flex-end;padding:.6rem;"
    "border:1px solid var(--pst-color-border,#c9c9c9);border-radius:.4rem;text-align:center;"
    "text-decoration:none;line-height:1.3}"
    ".lissome-tiles>a:hover{border-color:var(--pst-color-primary,#0a6ab6)}"
    ".lissome-tiles svg{display:block;width:100%;height:auto;margin-bottom:.4rem}</style>"
)


def tiles(entries: Sequence[tuple[Figure, str, str, str]]) -> Drawing:
    """Return small figures side by side for display, each with a caption and a link.

    Parameters
    ----------
    entries : sequence of (figure, caption, address, alt)
        Made by :func:`figure`; what stands below it; where a click leads, relative to the page; what
        the picture shows, in words.

    Returns
    -------
    Drawing
        Its static twin holds the pictures side by side.

    Raises
    ------
    InvalidInput
        If there is no entry, an address is absolute, or a text says nothing.

    Examples
    --------
    >>> from lissome.plotting import figure, tiles
    >>> fig, ax = figure(size=(2, 1))
    >>> tiles([(fig, "A line", "lines.html", "a line that rises")])
    Drawing('a line that rises')
    """
    if not entries:
        raise InvalidInput("argument `entries` is empty; give at least one figure")
    parts, stills, said = [], [], []
    for place, (fig, caption, address, alt) in enumerate(entries):
        if "//" in address or address.startswith("/"):
            raise InvalidInput(
                f"argument `entries`[{place}] leads to {address!r}; "
                "it must be relative, since the book is read without a network"
            )
        said.append(checked_alt(alt))
        stills.append(Image.open(io.BytesIO(png(fig))))
        parts.append(
            f'<a href="{html.escape(address)}">{svg(fig, alt)}<span>{html.escape(caption)}</span></a>'
        )
    twin = Image.new("RGB", (sum(s.width for s in stills), max(s.height for s in stills)), "white")
    left = 0
    for still in stills:
        twin.paste(still, (left, twin.height - still.height))
        left += still.width
    buffer = io.BytesIO()
    twin.save(buffer, format="PNG")
    markup = f'<div class="lissome-drawing lissome-tiles">{SHEET}{_SHEET}{"".join(parts)}</div>'
    return Drawing(markup=markup, still=buffer.getvalue(), alt="; ".join(said))
