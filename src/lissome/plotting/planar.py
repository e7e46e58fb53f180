"""Parts of planar drawings: strips, rings, light, ground, and maps over two parameters."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from .._validate import finite, finite_array, integer_at_least, positive
from ..errors import InvalidInput
from ._display import STYLE
from ._palette import color

__all__ = [
    "bare",
    "clamps",
    "curve",
    "ground",
    "heatmap",
    "legend",
    "light_arrows",
    "ray_direction",
]

Array = npt.NDArray[np.float64]


def ray_direction(angle: float) -> Array:
    """Return the unit vector along which light travels that comes from above.

    Parameters
    ----------
    angle : float
        From the vertical, in radians; light with a positive angle travels to the right.

    Returns
    -------
    numpy.ndarray, shape (2,)
        ``(sin angle, -cos angle)``.

    Examples
    --------
    >>> bool(np.allclose(ray_direction(0.0), [0.0, -1.0]))
    True
    """
    angle = finite("angle", angle, unit="radians")
    return np.array([np.sin(angle), -np.cos(angle)])


def light_arrows(
    ax: Axes,
    direction: npt.ArrayLike,
    target: npt.ArrayLike,
    *,
    length: float = 0.15,
    width: float = 0.3,
    count: int = 5,
    hue: str = "gold",
) -> None:
    """Draw parallel rays that end on a line through a point, across their direction.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    direction : array_like, shape (2,)
        Along which the light travels, see :func:`ray_direction`; its length does not matter.
    target : array_like, shape (2,)
        Where the middle ray ends.
    length, width : float, optional
        Length of a ray, and width of the bundle, in the units of the axes.
    count : int, optional
        Number of rays.
    hue : str, optional
        A role of the palette.
    """
    along = finite_array("direction", direction, shape=(2,))
    norm = float(np.linalg.norm(along))
    if norm == 0.0:
        raise InvalidInput("argument `direction` is the zero vector; light must travel somewhere")
    along = along / norm
    center = finite_array("target", target, shape=(2,))
    length, width = positive("length", length), positive("width", width)
    count = integer_at_least("count", count, 1)
    across = np.array([-along[1], along[0]])
    offsets = np.linspace(-width / 2, width / 2, count) if count > 1 else np.zeros(1)
    for offset in offsets:
        tip = center + offset * across
        ax.annotate(
            "",
            xy=tuple(tip),
            xytext=tuple(tip - length * along),
            arrowprops={"arrowstyle": "-|>", "color": color(hue), "lw": 1.3, "shrinkA": 0},
        )


def curve(ax: Axes, positions: npt.ArrayLike, *, hue: str | int = "blue", **style: Any) -> Any:
    """Draw a centerline and return its :class:`matplotlib.lines.Line2D`.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Its aspect is set to equal.
    positions : array_like, shape (n, 2)
        Points along the curve.
    hue : str or int, optional
        A role of the palette or the number of a series.
    **style
        Of the line.
    """
    points = finite_array("positions", positions, shape=(None, 2))
    style = {"lw": 2.4, "solid_capstyle": "round", "color": color(hue), **style}
    ax.set_aspect("equal", adjustable="box")
    return ax.plot(points[:, 0], points[:, 1], **style)[0]


def clamps(ax: Axes, left: float, right: float, *, height: float = 0.05) -> None:
    """Draw the two clamps of a strip as blocks at ``y = 0`` beyond `left` and `right`."""
    left, right = finite("left", left), finite("right", right)
    height = positive("height", height)
    for x in (left - height, right):
        ax.add_patch(
            mpl.patches.Rectangle((x, -height / 2), height, height, color=color("muted"), lw=0)
        )


def ground(ax: Axes, left: float, right: float, *, level: float = 0.0, depth: float = 0.02) -> None:
    """Draw a rigid floor from `left` to `right` whose surface is at `level`."""
    left, right = finite("left", left), finite("right", right)
    ax.plot([left, right], [level, level], color=color("ink"), lw=1.0, zorder=0)
    ax.fill_between(
        [left, right], level - depth, level, color=color("muted"), alpha=0.35, lw=0, zorder=0
    )


def bare(ax: Axes) -> None:
    """Take away ticks and frame of axes that only hold a drawing to scale."""
    ax.set_aspect("equal", adjustable="box")
    ax.set_axis_off()


def legend(ax: Axes, **options: Any) -> None:
    """Add a legend in the style of the book."""
    with mpl.rc_context(STYLE):
        ax.legend(**{"fontsize": 8.5, "handlelength": 1.6, **options})


def _edges(centers: Array) -> Array:
    middle = 0.5 * (centers[1:] + centers[:-1])
    return np.concatenate([[2 * centers[0] - middle[0]], middle, [2 * centers[-1] - middle[-1]]])


def heatmap(
    ax: Axes,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    values: npt.ArrayLike,
    label: str,
    *,
    cmap: str = "viridis",
    logarithmic: bool = False,
    limits: tuple[float, float] | None = None,
) -> Any:
    """Show values over a rectangular grid, with a labeled color bar; NaN stays transparent.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    x : array_like, shape (n,)
        Increasing.
    y : array_like, shape (m,)
        Increasing.
    values : array_like, shape (m, n)
        ``values[j, i]`` belongs to ``x[i], y[j]``. NaN marks points without a value.
    label : str
        Of the color bar, with the unit.
    cmap : str, optional
        Name of a matplotlib color map.
    logarithmic : bool, optional
        Scale of the `y` axis (cells are then centered in the logarithm).
    limits : (float, float), optional
        Values at the ends of the color map.

    Returns
    -------
    matplotlib.collections.QuadMesh
    """
    x, y = finite_array("x", x, shape=(None,)), finite_array("y", y, shape=(None,))
    table = np.array(values, dtype=float)
    if table.shape != (y.size, x.size):
        raise InvalidInput(
            f"argument `values` has shape {table.shape}; it must have shape ({y.size}, {x.size}): "
            "one row for each `y`, one column for each `x`"
        )
    for name, axis in (("x", x), ("y", y)):
        if axis.size < 2 or np.any(np.diff(axis) <= 0):
            raise InvalidInput(f"argument `{name}` must hold at least 2 increasing numbers")
    y_edges = np.exp(_edges(np.log(y))) if logarithmic else _edges(y)
    low, high = limits if limits is not None else (None, None)
    # One embedded image instead of thousands of polygons keeps the page small.
    mesh = ax.pcolormesh(
        _edges(x),
        y_edges,
        np.ma.masked_invalid(table),
        cmap=cmap,
        vmin=low,
        vmax=high,
        rasterized=True,
    )
    if logarithmic:
        ax.set_yscale("log")
    with mpl.rc_context(STYLE):
        bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02)
        bar.ax.set_title(label, fontsize=8, pad=4)  # beside it would be taken for the next axis
        bar.outline.set_visible(False)
    return mesh
