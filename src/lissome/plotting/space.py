"""Interactive 3-D figures that work offline, each with a static twin for print."""

from __future__ import annotations

import hashlib
import html
import json
from typing import Any

import matplotlib as mpl
import matplotlib.ticker
import numpy as np

from .._validate import positive
from ..errors import InvalidInput
from ._display import SHEET, Drawing, checked_alt, data_uri, figure, png, webp
from ._palette import PALETTE, SERIES
from ._scripts import SCRIPT, SPACE_SHEET

__all__ = ["show3d", "static_twin"]

_CONFIG = {
    "displaylogo": False,
    "responsive": True,
    "modeBarButtonsToRemove": ["sendChartToCloud", "resetCameraLastSave3d", "hoverClosest3d"],
}


def _slider(layout: Any, name: str) -> tuple[str, list[dict[str, Any]]]:
    """Take the slider out of a layout; return it as an input that fits a finger, and its steps."""
    sliders, menus = layout.sliders or (), layout.updatemenus or ()
    if menus or len(sliders) > 1:
        raise InvalidInput(
            f"argument `fig` has {len(sliders)} sliders and {len(menus)} menus; "
            "a figure may have one slider and no menu"
        )
    if not sliders:
        return "", []
    slider = sliders[0]
    steps = [
        {"label": step.label, "method": step.method, "args": list(step.args or ())}
        for step in slider.steps
    ]
    active = int(slider.active or 0)
    if not 0 <= active < len(steps):
        raise InvalidInput(
            f"argument `fig` has a slider of {len(steps)} steps whose `active` is {active}; "
            "it must be the number of a step"
        )
    prefix = html.escape(slider.currentvalue.prefix or "")
    label = html.escape(steps[active]["label"])
    layout.sliders = ()
    markup = (
        f'<div class="lissome-slide"><label for="{name}-slide">{prefix}</label>'
        f'<input type="range" id="{name}-slide" min="0" max="{len(steps) - 1}" value="{active}" '
        f'autocomplete="off" aria-valuetext="{label}"><output>{label}</output></div>'
    )
    return markup, steps


def show3d(
    fig: Any, alt: str, *, height: float = 460.0, twin: Any = None, equal: bool = True
) -> Drawing:
    """Return a plotly figure for display in an offline page.

    The reader turns it with the mouse or, once it has the focus, the arrow keys; ``+`` and ``-``,
    or the wheel with the control key, zoom, and comma and period move a slider. A finger scrolls
    past it; a tap, or the button that touch screens show, lets one finger turn it and two zoom.

    Parameters
    ----------
    fig : plotly.graph_objects.Figure
        Traces, and the layout that matters to the subject; ground, colors and margins are set
        here. One slider stands below the picture. The argument itself is not changed.
    alt : str
        What the picture shows, in words.
    height : float, optional
        Of the picture, in pixels, less on a phone; the width follows the page.
    twin : matplotlib.figure.Figure, optional
        Static picture for print; by default :func:`static_twin` draws one.
    equal : bool, optional
        One scale on all three axes (default).

    Returns
    -------
    Drawing
        Its markup expects the page to load plotly.js, and asks for nothing else; without plotly.js
        it shows the static twin.

    Raises
    ------
    InvalidInput
        If `fig` is no plotly figure or has menus or several sliders, `alt` says nothing, or the
        height is not positive.

    Examples
    --------
    Nothing is asked of a network:

    >>> import plotly.graph_objects as go
    >>> from lissome.plotting import show3d
    >>> helix = go.Scatter3d(x=[1, 0, -1], y=[0, 1, 0], z=[0, 1, 2], mode="lines")
    >>> drawing = show3d(go.Figure(helix), "a line that winds upward")
    >>> drawing, "https://" in drawing.markup
    (Drawing('a line that winds upward'), False)
    """
    import plotly.graph_objects as go

    alt = checked_alt(alt)
    height = positive("height", height, unit="px")
    if not isinstance(fig, go.Figure):
        raise InvalidInput(
            f"argument `fig` is a {type(fig).__name__}; it must be a plotly.graph_objects.Figure"
        )
    picture = go.Figure(fig)
    clear = "rgba(0,0,0,0)"
    picture.update_layout(
        template="none",
        colorway=[PALETTE[role].light for role in SERIES],
        paper_bgcolor=clear,
        plot_bgcolor=clear,
        font={"color": "#808892", "size": 12},
        margin={"l": 0, "r": 0, "t": 24, "b": 0},
        autosize=True,
        height=None,
        width=None,
    )
    if picture.layout.legend.orientation is None:  # beside the scene it would leave a phone little
        below = {"orientation": "h", "x": 0.5, "xanchor": "center", "y": 0.0, "yanchor": "top"}
        picture.update_layout(legend=below)
    line = "rgba(128,136,146,0.45)"
    wall = {"showbackground": False, "gridcolor": line, "zerolinecolor": line}
    picture.update_scenes(xaxis=wall, yaxis=wall, zaxis=wall)
    if equal:
        picture.update_scenes(aspectmode="data")
    still = png(static_twin(picture) if twin is None else twin)
    name = "lissome3d-" + hashlib.sha256(picture.to_json().encode() + alt.encode()).hexdigest()[:12]
    slider, steps = _slider(picture.layout, name)
    content = json.loads(picture.to_json()) | {"steps": steps, "config": _CONFIG}
    data = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
    image = data_uri(webp(still), "image/webp")
    said = html.escape(alt)
    markup = (
        f'<div class="lissome-drawing">{SHEET}{SPACE_SHEET}'
        f'<div class="lissome-screen" role="group" aria-label="{said}">'
        f'<button type="button" class="lissome-touch" id="{name}-touch">Tap to turn</button>'
        f'<div id="{name}" class="plotly-graph-div" '
        f'style="height:min({height:g}px,{height / 6.4:.4g}vw);width:100%" '
        'role="application" aria-label="View in space: the arrow keys turn it, plus and minus zoom">'
        f"</div>{slider}</div>"
        f'<img class="lissome-print dark-light" alt="{said}" src="{image}">'
        f'<script type="application/json" id="{name}-data">{data}</script>'
        f"<script>{SCRIPT.replace('NAME', name)}</script></div>"
    )
    return Drawing(markup=markup, still=still, alt=alt)


def _hue_of(trace: Any) -> str | None:
    """Return the one color of a trace as ``#rrggbb``, or None if it has none or several."""
    hue = None
    if trace.type == "mesh3d":
        hue = trace.color
    elif trace.type == "scatter3d":
        hue = trace.line.color
    elif trace.type == "surface" and trace.colorscale is not None:
        hues = {hue for _, hue in trace.colorscale}
        hue = hues.pop() if len(hues) == 1 else None
    return hue if isinstance(hue, str) and hue.startswith("#") else None


def static_twin(fig: Any) -> Any:
    """Draw the traces of a 3-D plotly figure with matplotlib.

    Parameters
    ----------
    fig : plotly.graph_objects.Figure
        With traces of the kinds ``surface``, ``mesh3d`` and ``scatter3d``.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InvalidInput
        If a trace is of another kind: pass your own `twin` to :func:`show3d` then.

    Examples
    --------
    >>> import plotly.graph_objects as go
    >>> from lissome.plotting import static_twin
    >>> helix = go.Scatter3d(x=[1, 0, -1], y=[0, 1, 0], z=[0, 1, 2], mode="lines")
    >>> (axes,) = static_twin(go.Figure(helix)).axes
    >>> axes.name, len(axes.lines)
    ('3d', 1)
    """
    picture, ax = figure(size=(6.0, 4.6), subplot_kw={"projection": "3d"})
    ends = []
    shown = [trace for trace in fig.data if trace.visible in (None, True)]
    for number, trace in enumerate(shown):
        hue = _hue_of(trace) or PALETTE[SERIES[number % len(SERIES)]].light
        if trace.type == "surface":
            z = np.asarray(trace.z, dtype=float)
            x = np.arange(z.shape[1]) if trace.x is None else np.asarray(trace.x, dtype=float)
            y = np.arange(z.shape[0]) if trace.y is None else np.asarray(trace.y, dtype=float)
            if x.ndim == 1:
                x, y = np.meshgrid(x, y)
            ax.plot_surface(x, y, z, color=hue, alpha=0.85, linewidth=0, rcount=120, ccount=120)
        elif trace.type == "mesh3d":
            x, y, z = (np.asarray(v, dtype=float) for v in (trace.x, trace.y, trace.z))
            faces = np.column_stack([trace.i, trace.j, trace.k])
            ax.plot_trisurf(x, y, z, triangles=faces, color=hue, alpha=0.85, linewidth=0)
        elif trace.type == "scatter3d":
            x, y, z = (np.asarray(v, dtype=float) for v in (trace.x, trace.y, trace.z))
            mode = trace.mode or "lines"
            ax.plot(
                x,
                y,
                z,
                color=hue,
                linestyle="-" if "lines" in mode else "none",
                marker="o" if "markers" in mode else None,
                markersize=3,
            )
        else:
            raise InvalidInput(
                f"argument `fig` holds a trace of type {trace.type!r}; the static twin knows "
                "surface, mesh3d and scatter3d: pass `twin`, a matplotlib figure"
            )
        ends.append([(np.nanmin(v), np.nanmax(v)) for v in (x, y, z)])
    if ends:
        box = np.asarray(ends)
        low, high = box[:, :, 0].min(axis=0), box[:, :, 1].max(axis=0)
        room = np.maximum(high - low, 1e-3 * (high - low).max())
        ax.set_box_aspect(tuple(room) if fig.layout.scene.aspectmode == "data" else None)
        for axis, share in zip("xyz", room / room.max(), strict=True):
            ticks = int(np.clip(round(6 * share), 1, 5))  # a short axis has room for few numbers
            getattr(ax, f"{axis}axis").set_major_locator(mpl.ticker.MaxNLocator(ticks))
    for axis, name in zip("xyz", ("xaxis", "yaxis", "zaxis"), strict=True):
        title = getattr(fig.layout.scene, name).title.text
        getattr(ax, f"set_{axis}label")(title or axis, labelpad=8)
        if getattr(fig.layout.scene, name).visible is False:
            getattr(ax, f"{axis}axis").set_visible(False)
    return picture
