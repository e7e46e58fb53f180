"""Interactive 3-D figures that work offline, each with a static twin for print."""

from __future__ import annotations

import hashlib
import html
from typing import Any

import numpy as np

from .._validate import positive
from ..errors import InvalidInput
from ._display import SHEET, Drawing, checked_alt, data_uri, figure, png, webp
from ._palette import PALETTE, SERIES

__all__ = ["show3d", "static_twin"]

_CONFIG = {
    "displaylogo": False,
    "responsive": True,
    "modeBarButtonsToRemove": ["sendChartToCloud", "resetCameraLastSave3d", "hoverClosest3d"],
}

# What the mouse does can be done from the keyboard: turn, zoom, move the slider. The wheel zooms
# with the control key only: nobody gets stuck in a figure on the way down a page.
_KEYS = """
(function () {
  var plot = document.getElementById("{plot_id}"), turn = Math.PI / 24;
  plot.tabIndex = 0;
  plot.addEventListener("wheel", function (event) {  // the wheel scrolls the page, as everywhere
    if (!event.ctrlKey) event.stopPropagation();
  }, {capture: true, passive: true});
  function look(move) {
    var change = {};
    Object.keys(plot._fullLayout).filter(function (key) {
      return /^scene[0-9]*$/.test(key);
    }).forEach(function (scene) {
      var eye = plot._fullLayout[scene]._scene.getCamera().eye;
      var far = Math.hypot(eye.x, eye.y, eye.z), round = Math.atan2(eye.y, eye.x) + move.round;
      var high = Math.asin(eye.z / far) + move.high;
      high = Math.max(-1.5, Math.min(1.5, high));
      far = Math.max(0.2, Math.min(8, far * move.far));
      change[scene + ".camera.eye"] = {x: far * Math.cos(high) * Math.cos(round),
        y: far * Math.cos(high) * Math.sin(round), z: far * Math.sin(high)};
    });
    Plotly.relayout(plot, change);
  }
  function slide(by) {
    var bar = plot._fullLayout.sliders && plot._fullLayout.sliders[0];
    if (!bar) return;
    var next = Math.max(0, Math.min(bar.steps.length - 1, bar.active + by));
    Plotly[bar.steps[next].method].apply(null, [plot].concat(bar.steps[next].args));
    Plotly.relayout(plot, {"sliders[0].active": next});
  }
  var moves = {ArrowLeft: [-turn, 0, 1], ArrowRight: [turn, 0, 1], ArrowUp: [0, turn, 1],
    ArrowDown: [0, -turn, 1], "+": [0, 0, 0.9], "-": [0, 0, 1 / 0.9]};
  plot.addEventListener("keydown", function (event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    var move = moves[event.key];
    if (move) look({round: move[0], high: move[1], far: move[2]});
    else if (event.key === "," || event.key === ".") slide(event.key === "." ? 1 : -1);
    else return;
    event.preventDefault();
  });
})();
"""

# Axes and text take the color of the page's own text, also after the reader switches the theme.
_FOLLOW_THEME = """
(function () {
  var plot = document.getElementById("{plot_id}");
  function paint() {
    var ink = getComputedStyle(plot).color, change = {"font.color": ink};
    Object.keys(plot._fullLayout || {}).filter(function (key) {
      return /^scene[0-9]*$/.test(key);
    }).forEach(function (scene) {
      ["xaxis", "yaxis", "zaxis"].forEach(function (axis) {
        change[scene + "." + axis + ".color"] = ink;
        change[scene + "." + axis + ".gridcolor"] = "rgba(128,136,146,0.45)";
      });
    });
    Plotly.relayout(plot, change);
  }
  new MutationObserver(paint).observe(document.documentElement,
    {attributes: true, attributeFilter: ["data-theme"]});
  paint();
})();
"""


def show3d(
    fig: Any, alt: str, *, height: float = 460.0, twin: Any = None, equal: bool = True
) -> Drawing:
    """Return a plotly figure for display in an offline page.

    The reader turns it with mouse, finger or, once it has the focus, the arrow keys; ``+`` and
    ``-``, or the wheel with the control key, zoom, and comma and period move a slider.

    Parameters
    ----------
    fig : plotly.graph_objects.Figure
        Traces, and the layout that matters to the subject; ground, colors and margins are set
        here. The argument itself is not changed.
    alt : str
        What the picture shows, in words.
    height : float, optional
        In pixels; the width follows the page.
    twin : matplotlib.figure.Figure, optional
        Static picture for print; by default :func:`static_twin` draws one.
    equal : bool, optional
        One scale on all three axes (default).

    Returns
    -------
    Drawing
        Its markup expects the page to load plotly.js, and asks for nothing else.

    Raises
    ------
    InvalidInput
        If `fig` is no plotly figure, `alt` says nothing, or the height is not positive.

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
        height=height,
    )
    line = "rgba(128,136,146,0.45)"
    wall = {"showbackground": False, "gridcolor": line, "zerolinecolor": line}
    picture.update_scenes(xaxis=wall, yaxis=wall, zaxis=wall)
    if equal:
        picture.update_scenes(aspectmode="data")
    still = png(static_twin(picture) if twin is None else twin)
    name = "lissome3d-" + hashlib.sha256(picture.to_json().encode() + alt.encode()).hexdigest()[:12]
    plot = picture.to_html(
        full_html=False,
        include_plotlyjs=False,
        config=_CONFIG,
        div_id=name,
        default_height=f"{height:g}px",
        post_script=[_FOLLOW_THEME, _KEYS],
    )
    image = data_uri(webp(still), "image/webp")
    markup = (
        f'<div class="lissome-drawing">{SHEET}'
        "<style>.lissome-print{display:none}@media print{.lissome-screen{display:none}"
        ".lissome-print{display:block}}</style>"
        f'<div class="lissome-screen" role="img" aria-label="{html.escape(alt)}">{plot}</div>'
        f'<img class="lissome-print dark-light" alt="{html.escape(alt)}" src="{image}">'
        "<noscript><style>.lissome-print{display:block}</style></noscript></div>"
    )
    return Drawing(markup=markup, still=still, alt=alt)


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
        hue = PALETTE[SERIES[number % len(SERIES)]].light
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
    for axis, name in zip("xyz", ("xaxis", "yaxis", "zaxis"), strict=True):
        title = getattr(fig.layout.scene, name).title.text
        getattr(ax, f"set_{axis}label")(title or axis)
    return picture
