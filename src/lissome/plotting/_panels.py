"""Where a figure can be cut between its panels, so that a narrow page shows them one by one."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

__all__ = ["Box", "panels"]

#: Left, top, width and height, in points from the upper left corner, as SVG counts.
Box = tuple[float, float, float, float]

_POINTS = 72  # per inch
_LEAST = 0.8  # inches: a narrower piece is no panel


def _extents(fig: Figure) -> list[Bbox]:
    """Return what each panel covers, with its labels, legend and color bar, in inches."""
    canvas: Any = fig.canvas
    canvas.draw()  # solves the layout
    renderer = canvas.get_renderer()
    groups: dict[int, list[Bbox]] = {}
    for ax in fig.axes:
        box = ax.get_tightbbox(renderer) if ax.get_visible() else None
        if box is not None:
            for owner in getattr(ax, "_colorbar_info", {}).get("parents", [ax]):
                groups.setdefault(id(owner), []).append(box)
    boxes = [Bbox.union(group) for group in groups.values()]
    loose = [*fig.texts, *fig.legends, *fig.lines, *fig.patches, *fig.artists, *fig.images]
    boxes += [artist.get_window_extent(renderer) for artist in loose if artist.get_visible()]
    return [Bbox(box.get_points() / fig.dpi) for box in boxes]


def _cuts(boxes: list[Bbox], way: int, size: float) -> list[float]:
    """Return the edges of the pieces: upright cuts for `way` 0, level ones for 1."""
    spans = sorted((box.min[way], box.max[way]) for box in boxes)
    edges, reach = [0.0], spans[0][1]
    for start, end in spans[1:]:
        if start > reach:
            edges.append((start + reach) / 2)
        reach = max(reach, end)
    return [*edges, size]


def panels(fig: Figure) -> list[list[Box]]:
    """Return the panels of a figure row by row; side by side they are the figure again.

    A panel is what straight cuts through the figure, level ones first, can part: axes with an arrow
    between them stay together. The list is empty where nothing stands side by side.
    """
    boxes = _extents(fig)
    if len(boxes) < 2:
        return []
    width, height = fig.get_size_inches()
    rows = []
    for low, high in reversed(list(pairwise(_cuts(boxes, 1, height)))):
        row = [box for box in boxes if low <= (box.y0 + box.y1) / 2 <= high]
        edges = _cuts(row, 0, width)
        if min(b - a for a, b in pairwise(edges)) < _LEAST:
            edges = [0.0, width]
        rows.append(
            [
                (_POINTS * a, _POINTS * (height - high), _POINTS * (b - a), _POINTS * (high - low))
                for a, b in pairwise(edges)
            ]
        )
    return rows if any(len(row) > 1 for row in rows) else []
