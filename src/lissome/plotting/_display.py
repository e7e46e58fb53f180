"""Turn a drawing into something a notebook shows: themable SVG, with a static PNG for print."""

from __future__ import annotations

import base64
import hashlib
import html
import io
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..errors import InvalidInput
from ._palette import PALETTE, SERIES, color
from ._panels import Box
from ._panels import panels as panels_of

__all__ = [
    "SHEET",
    "STYLE",
    "Drawing",
    "checked_alt",
    "data_uri",
    "figure",
    "png",
    "show",
    "svg",
    "webp",
]

#: Settings in force while a figure is made and while it is drawn; nothing else ever sees them.
STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": color("ink"),
    "axes.facecolor": "none",
    "axes.formatter.use_mathtext": True,
    "axes.labelcolor": color("ink"),
    "axes.linewidth": 0.8,
    "axes.prop_cycle": cycler(color=[color(role) for role in SERIES]),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 11,
    "figure.edgecolor": "none",
    "figure.facecolor": "none",
    "font.size": 11,  # on a phone a figure is 0.6 times as wide
    "grid.color": color("muted"),
    "grid.linewidth": 0.5,
    "image.cmap": "viridis",
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "mathtext.fontset": "dejavusans",  # as large as the words beside it
    "savefig.facecolor": "none",
    "svg.fonttype": "path",
    "svg.hashsalt": "lissome",
    "text.color": color("ink"),
    "xtick.color": color("ink"),
    "xtick.direction": "out",
    "ytick.color": color("ink"),
    "ytick.direction": "out",
}


def checked_alt(alt: Any) -> str:
    """Return the text that stands for a picture, or raise: no picture goes without one."""
    if not isinstance(alt, str) or len(alt.split()) < 3:
        raise InvalidInput(
            f"argument `alt` is {alt!r}; say in a sentence what the picture shows, "
            "for readers who cannot see it"
        )
    return " ".join(alt.split())


def figure(
    rows: int = 1,
    columns: int = 1,
    *,
    size: tuple[float, float] = (6.4, 3.6),
    panels: bool | str = False,
    **layout: Any,
) -> tuple[Figure, Any]:
    """Make a figure and its axes in the style of the book, without pyplot and its global state.

    Parameters
    ----------
    rows, columns : int
        Grid of axes.
    size : (float, float)
        Width and height in inches.
    panels : bool or str, optional
        Letter the axes (a), (b), ...; a string gives the letters, for instance ``"cd"``.
    **layout
        Passed on to :meth:`matplotlib.figure.Figure.subplots` (``sharex``, ``width_ratios``, ...).

    Returns
    -------
    figure : matplotlib.figure.Figure
    axes : matplotlib.axes.Axes or numpy.ndarray of them
        One axes, or an array as ``subplots`` returns it.

    Raises
    ------
    InvalidInput
        If there are fewer letters than axes.

    Examples
    --------
    >>> drawing, axes = figure(1, 2, size=(6, 2.5), panels=True)
    >>> [a.get_title(loc="left") for a in axes]
    ['(a)', '(b)']
    """
    with mpl.rc_context(STYLE):
        fig = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(fig)
        axes = fig.subplots(rows, columns, **layout)
        if columns > 1 and (layout.get("sharex") or layout.get("sharey")):
            for ax in fig.axes:  # each panel can be read alone: on a phone it stands so
                ax.tick_params(labelbottom=True, labelleft=True)
        if panels:
            letters = panels if isinstance(panels, str) else "abcdefghijklmnop"
            if len(letters) < len(fig.axes):
                raise InvalidInput(
                    f"argument `panels` is {panels!r}; it must hold a letter for each of the "
                    f"{len(fig.axes)} axes"
                )
            for ax, letter in zip(fig.axes, letters, strict=False):
                ax.set_title(f"({letter})", loc="left")
    return fig, axes


def _recolored(text: str) -> str:
    """Replace palette colors by CSS variables, so that a page's theme decides."""
    for role, hue in PALETTE.items():
        text = text.replace(hue.light, f"var(--lissome-{role},{hue.light})")
    return text.replace("#000000", f"var(--lissome-ink,{PALETTE['ink'].light})")


_HUES = {
    theme: "".join(f"--lissome-{role}:{getattr(hue, theme)};" for role, hue in PALETTE.items())
    for theme in ("light", "dark")
}
_PIXELS = 96 / 72  # of a page, per point
_IN_BOOK = ".bd-content div.cell_output .output.text_html:has(>.lissome-drawing)"

#: Style sheet that travels with every drawing, so that it also works in a bare notebook. The book's
#: theme puts a light panel behind HTML outputs of dark pages; ours need none.
SHEET = (
    "<style>"
    f"html[data-theme=dark] {_IN_BOOK}{{background:none;color:inherit;padding:0}}"
    f"html[data-theme=dark] .lissome-drawing{{{_HUES['dark']}"
    f"--lissome-paper:var(--pst-color-background,{PALETTE['paper'].dark})}}"
    f"@media print{{html[data-theme=dark] .lissome-drawing{{{_HUES['light']}}}}}"
    ".lissome-drawing{overflow-x:auto;overflow-y:hidden;"
    "--lissome-ground:var(--pst-color-background,Canvas)}"
    ".lissome-drawing>svg{display:block;margin:auto;max-width:100%;height:auto}"
    ".lissome-drawing.wide>svg{min-width:34rem}"
    # panels of one row stand side by side where there is room, else below each other
    ".lissome-row{display:flex;flex-wrap:wrap;justify-content:center;align-items:start;margin:auto}"
    ".lissome-row>svg{height:auto}"
    "@media(max-width:600px){.lissome-odd>svg{flex-basis:75%!important}}"  # not two and one
    # shadows at the edges say that there is more aside; covers that scroll along hide them there
    ".lissome-drawing.wide{background:"
    "linear-gradient(90deg,var(--lissome-ground) 40%,transparent) 0 0/2rem 100% no-repeat local,"
    "linear-gradient(270deg,var(--lissome-ground) 40%,transparent) 100% 0/2rem 100% no-repeat local,"
    "linear-gradient(90deg,rgba(128,136,146,.55),transparent) 0 0/.7rem 100% no-repeat scroll,"
    "linear-gradient(270deg,rgba(128,136,146,.55),transparent) 100% 0/.7rem 100% no-repeat scroll}"
    "</style>"
)


def svg(fig: Figure, alt: str) -> str:
    """Return a figure as inline SVG whose colors follow the page's theme.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
    alt : str
        What the picture shows, in words.

    Returns
    -------
    str
        An ``<svg>`` element. Its ids carry a hash of its content: several can share one page.
    """
    alt = checked_alt(alt)
    buffer = io.StringIO()
    with mpl.rc_context(STYLE):
        fig.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->\s*", "", text, flags=re.DOTALL)
    mark = "f" + hashlib.sha256(text.encode()).hexdigest()[:10]
    text = re.sub(r'\bid="', f'id="{mark}', text)
    text = re.sub(r'href="#', f'href="#{mark}', text)
    text = re.sub(r"url\(#", f"url(#{mark}", text)
    ink = f"var(--lissome-ink,{PALETTE['ink'].light})"
    text = text.replace(
        "<svg ", f'<svg role="img" aria-label="{html.escape(alt)}" fill="{ink}" ', 1
    )
    return re.sub(r"\s*\n\s*", "\n", _recolored(text))


def _side_by_side(whole: str, rows: list[list[Box]]) -> str:
    """Show an SVG through one window for each panel; the windows of a row wrap on narrow pages."""
    start = whole.index("<svg")
    opening, body = whole[start : whole.index(">", start) + 1], whole[whole.index(">", start) + 1 :]
    label, ink = (re.search(rf'{key}="[^"]*"', opening) for key in ("aria-label", "fill"))
    name = re.search(r'<g id="(\w+)"', body)
    assert label and ink and name  # svg() wrote them
    content = body[: body.rindex("</svg>")]
    parts = []
    for row in rows:
        odd = " lissome-odd" if len(row) % 2 else ""
        whole_width = sum(width for _, _, width, _ in row) * _PIXELS
        parts.append(f'<div class="lissome-row{odd}" style="max-width:{whole_width:.0f}px">')
        for x, y, width, height in row:
            room = width * _PIXELS
            parts.append(
                f'<svg viewBox="{x:.2f} {y:.2f} {width:.2f} {height:.2f}" aria-hidden="true" '
                f'{ink.group()} style="flex:{width:.2f} 1 0;min-width:min(100%,{0.85 * room:.0f}px);'
                f'max-width:{1.3 * room:.0f}px">{content}</svg>'
            )
            content = f'<use href="#{name.group(1)}"/>'
        parts.append("</div>")
    return f'<div role="img" {label.group()}>{"".join(parts)}</div>'


def png(fig: Figure, *, dpi: float = 160, background: str = "white") -> bytes:
    """Return a figure as PNG, for print and for tools that show no SVG.

    If the environment variable ``LISSOME_FIGURES`` names a folder, the figure is also written there
    as PDF, under the SHA-256 digest of its PNG: `make reproduce` gathers the figures of the book so.
    """
    buffer = io.BytesIO()
    with mpl.rc_context(STYLE):
        fig.savefig(buffer, format="png", dpi=dpi, facecolor=background, metadata={"Software": ""})
        content = buffer.getvalue()
        if folder := os.environ.get("LISSOME_FIGURES"):
            path = Path(folder, hashlib.sha256(content).hexdigest()).with_suffix(".pdf")
            path.parent.mkdir(parents=True, exist_ok=True)
            fig.savefig(path, facecolor=background, metadata={"CreationDate": None})
    return content


def webp(content: bytes, quality: int = 80) -> bytes:
    """Return a PNG as WebP, several times smaller: for twins that are embedded in a page."""
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(content)) as picture:
        picture.save(buffer, format="WEBP", quality=quality, method=4)
    return buffer.getvalue()


def data_uri(content: bytes, kind: str) -> str:
    """Return bytes as a ``data:`` address, which no page needs a network for."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


@dataclass(frozen=True)
class Drawing:
    """A finished picture; the last value of a notebook cell shows it.

    Attributes
    ----------
    markup : str
        HTML, without any remote address.
    still : bytes
        The static twin, PNG on white.
    alt : str
        What the picture shows, in words.

    Examples
    --------
    A picture brings everything with it: what a page shows, what is printed, what is read aloud.

    >>> from lissome.plotting import figure, show
    >>> fig, ax = figure(size=(2, 1))
    >>> drawing = show(fig, alt="axes without a curve")
    >>> "https://" in drawing.markup, drawing.still[1:4], drawing.alt
    (False, b'PNG', 'axes without a curve')
    """

    markup: str
    still: bytes
    alt: str

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return {
            "text/html": self.markup,
            "image/png": base64.b64encode(self.still).decode(),
            "text/plain": self.alt,
        }

    def __repr__(self) -> str:
        return f"Drawing({self.alt!r})"


def show(fig: Figure, alt: str) -> Drawing:
    """Return a figure for display: inline SVG that follows the page's theme, and a PNG twin.

    Panels that stand side by side, and that straight cuts can part, stand one below the other on a
    page that is too narrow for them.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
        Made by :func:`figure`.
    alt : str
        What the picture shows, in a sentence, for readers who cannot see it.

    Returns
    -------
    Drawing

    Raises
    ------
    InvalidInput
        If `alt` says nothing.

    Examples
    --------
    >>> fig, ax = figure(size=(3, 2))
    >>> lines = ax.plot([0, 1], [0, 1])
    >>> show(fig, alt="a straight line through the origin")
    Drawing('a straight line through the origin')
    """
    alt = checked_alt(alt)
    picture = svg(fig, alt)
    with mpl.rc_context(STYLE):
        rows = panels_of(fig)
    if rows:
        picture = _side_by_side(picture, rows)
    # On a phone a wide figure of one piece scrolls sideways rather than shrink beyond reading.
    wide = " wide" if fig.get_figwidth() > 6.5 and not rows else ""
    markup = f'<div class="lissome-drawing{wide}">{SHEET}{picture}</div>'
    return Drawing(markup=markup, still=png(fig), alt=alt)
