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

    Raises
    ------
    InvalidInput
        If `angle` is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.plotting.planar import ray_direction
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
        The axes.
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

    Raises
    ------
    InvalidInput
        If the direction is zero, or a number is out of its range.

    Examples
    --------
    Rays from straight above that end at one height:

    >>> import numpy as np
    >>> from lissome.plotting import figure, light_arrows, ray_direction
    >>> fig, ax = figure(size=(2, 1))
    >>> light_arrows(ax, ray_direction(0.0), [0.5, 0.2], width=0.2, count=3)
    >>> print(np.array([ray.xy for ray in ax.texts]).round(6))
    [[0.4 0.2]
     [0.5 0.2]
     [0.6 0.2]]
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
        ax.update_datalim([tip, tip - length * along])  # annotations alone widen no axes
    ax.autoscale_view()


def curve(ax: Axes, positions: npt.ArrayLike, *, hue: str | int = "blue", **style: Any) -> Any:
    """Draw a centerline and return its :class:`matplotlib.lines.Line2D`.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The axes; their aspect is set to equal.
    positions : array_like, shape (n, 2)
        Points along the curve.
    hue : str or int, optional
        A role of the palette or the number of a series.
    **style
        Of the line.

    Raises
    ------
    InvalidInput
        If the shape of `positions` is wrong, or there is no such role.

    Examples
    --------
    A circle looks like one:

    >>> import numpy as np
    >>> from lissome.plotting import color, curve, figure
    >>> fig, ax = figure(size=(4, 2))
    >>> u = np.linspace(0, 2 * np.pi, 50)
    >>> line = curve(ax, np.stack([np.cos(u), np.sin(u)], axis=1), hue="orange")
    >>> ax.get_aspect(), line.get_color() == color("orange")
    (1.0, True)
    """
    points = finite_array("positions", positions, shape=(None, 2))
    style = {"lw": 2.4, "solid_capstyle": "round", "color": color(hue), **style}
    ax.set_aspect("equal", adjustable="box")
    return ax.plot(points[:, 0], points[:, 1], **style)[0]


def clamps(ax: Axes, left: float, right: float, *, height: float = 0.05) -> None:
    """Draw the two clamps of a strip as blocks at ``y = 0`` beyond `left` and `right`.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The axes.
    left, right : float
        Where the strip leaves the clamps, in the units of the axes.
    height : float, optional
        Height of the blocks, which are as wide as high.

    Raises
    ------
    InvalidInput
        If a number is not finite, or the height is not positive.

    Examples
    --------
    The strip lies between the blocks:

    >>> from lissome.plotting import clamps, figure
    >>> fig, ax = figure(size=(2, 1))
    >>> clamps(ax, 0.0, 0.95, height=0.1)
    >>> [(block.get_x(), block.get_x() + block.get_width()) for block in ax.patches]
    [(-0.1, 0.0), (0.95, 1.05)]
    """
    left, right = finite("left", left), finite("right", right)
    height = positive("height", height)
    for x in (left - height, right):
        ax.add_patch(
            mpl.patches.Rectangle((x, -height / 2), height, height, color=color("muted"), lw=0)
        )


def ground(ax: Axes, left: float, right: float, *, level: float = 0.0, depth: float = 0.02) -> None:
    """Draw a rigid floor from `left` to `right` whose surface is at `level`.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The axes.
    left, right : float
        Ends of the floor, in the units of the axes.
    level : float, optional
        Height of its surface.
    depth : float, optional
        How far the shading reaches below it.

    Raises
    ------
    InvalidInput
        If `left` or `right` is not finite.

    Examples
    --------
    >>> from lissome.plotting import figure, ground
    >>> fig, ax = figure(size=(2, 1))
    >>> ground(ax, 0.0, 2.0, level=-0.5)
    >>> (surface,) = ax.lines
    >>> print(surface.get_ydata())
    [-0.5 -0.5]
    """
    left, right = finite("left", left), finite("right", right)
    ax.plot([left, right], [level, level], color=color("ink"), lw=1.0, zorder=0)
    ax.fill_between(
        [left, right], level - depth, level, color=color("muted"), alpha=0.35, lw=0, zorder=0
    )


def bare(ax: Axes) -> None:
    """Take away ticks and frame of axes that only hold a drawing to scale.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The axes.

    Examples
    --------
    >>> from lissome.plotting import bare, figure
    >>> fig, ax = figure(size=(2, 1))
    >>> bare(ax)
    >>> ax.axison
    False
    """
    ax.set_aspect("equal", adjustable="box")
    ax.set_axis_off()


def legend(ax: Axes, **options: Any) -> None:
    """Add a legend in the style of the book.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        The axes, with labeled curves.
    **options
        Passed on to :meth:`matplotlib.axes.Axes.legend`.

    Examples
    --------
    >>> from lissome.plotting import figure, legend
    >>> fig, ax = figure(size=(3, 2))
    >>> lines = ax.plot([0, 1], label="stable")
    >>> legend(ax, loc="upper left")
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['stable']
    """
    with mpl.rc_context(STYLE):
        ax.legend(**{"fontsize": 9.5, "handlelength": 1.6, **options})


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
        The axes.
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

    Raises
    ------
    InvalidInput
        If shapes do not fit, or `x` or `y` does not increase.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.plotting import figure, heatmap
    >>> fig, ax = figure(size=(3, 2))
    >>> mesh = heatmap(ax, [0.9, 0.95], [1.0, 10.0], [[2.0, 3.0], [np.nan, 5.0]], "period")
    >>> mesh.get_clim(), int(mesh.get_array().mask.sum())
    ((2.0, 5.0), 1)
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
        bar.ax.set_title(label, fontsize=9.5, pad=4)  # beside it would be taken for the next axis
        bar.outline.set_visible(False)
    return mesh
