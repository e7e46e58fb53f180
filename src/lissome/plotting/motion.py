"""Short looping animations, small enough to live inside a page."""

from __future__ import annotations

import html
import io
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from .._validate import integer_at_least, positive
from ._display import SHEET, STYLE, Drawing, checked_alt, data_uri, png, webp

__all__ = ["animate"]

# Drawn in the colors of the light page on a transparent ground; on a dark page the lightness is
# turned around and the hue kept. The theme's own rules for pictures (light panel) are overruled.
_SHEET = (
    "<style>.lissome-drawing picture img{max-width:100%;height:auto;display:block;margin:auto}"
    "html[data-theme=dark] .bd-content div.cell_output .lissome-drawing picture img{"
    "background:none;padding:0;filter:invert(.92) hue-rotate(180deg)}"
    "@media print{html[data-theme=dark] .bd-content div.cell_output .lissome-drawing picture img{"
    "filter:none}}</style>"
)


def animate(
    fig: Figure,
    draw: Callable[[int], Any],
    frames: int,
    *,
    alt: str,
    seconds: float = 5.0,
    still: int = 0,
    dpi: float = 110,
    quality: int = 70,
) -> Drawing:
    """Draw a figure frame by frame into one looping WebP, with a static twin.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
        Made by :func:`~lissome.plotting.figure`.
    draw : callable
        ``draw(i)`` moves the artists of `fig` to frame ``i``.
    frames : int
        Number of frames, at least 2.
    alt : str
        What moves, in words.
    seconds : float, optional
        Duration of one loop.
    still : int, optional
        Frame of the static twin: shown in print, and to readers who ask their system for less
        motion.
    dpi : float, optional
        Resolution.
    quality : int, optional
        Of the lossy compression, 0 to 100.

    Returns
    -------
    Drawing
        With ``markup`` holding the animation as data; its attribute ``still`` is a PNG.

    Raises
    ------
    InvalidInput
        If there are fewer than 2 frames, a number is out of its range, or `alt` says nothing.

    Examples
    --------
    >>> from lissome.plotting import animate, figure
    >>> fig, ax = figure(size=(1, 1))
    >>> (dot,) = ax.plot([0.0], [0.0], "o")
    >>> animate(fig, lambda i: dot.set_xdata([i / 4]), 4, alt="a dot that moves to the right")
    Drawing('a dot that moves to the right')
    """
    frames = integer_at_least("frames", frames, 2)
    seconds = positive("seconds", seconds, unit="s")
    alt = checked_alt(alt)
    pictures = []
    twin = b""
    with mpl.rc_context({**STYLE, "figure.dpi": dpi}):
        fig.set_dpi(dpi)
        canvas = FigureCanvasAgg(fig)
        for i in range(frames):
            draw(i)
            canvas.draw()
            if i == 0:
                # Layout is solved once: axes that breathe from frame to frame only distract.
                fig.set_layout_engine("none")
                canvas.draw()
            pictures.append(Image.fromarray(np.array(canvas.buffer_rgba())))
            if i == still % frames:
                twin = png(fig)
    buffer = io.BytesIO()
    pictures[0].save(
        buffer,
        format="WEBP",
        save_all=True,
        append_images=pictures[1:],
        duration=max(round(1000 * seconds / frames), 1),
        loop=0,
        quality=quality,
        alpha_quality=80,
        method=4,
        background=(0, 0, 0, 0),
    )
    width, height = pictures[0].size
    markup = (
        f'<div class="lissome-drawing">{SHEET}{_SHEET}<picture>'
        f'<source media="print, (prefers-reduced-motion: reduce)" '
        f'srcset="{data_uri(webp(twin), "image/webp")}">'
        f'<img class="dark-light" alt="{html.escape(alt)}" width="{width}" height="{height}" '
        f'src="{data_uri(buffer.getvalue(), "image/webp")}"></picture></div>'
    )
    return Drawing(markup=markup, still=twin, alt=alt)
