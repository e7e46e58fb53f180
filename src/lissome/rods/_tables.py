"""Tables of rods, and files for ParaView, from plain arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._validate import finite_array, one_of
from ..errors import InvalidInput
from .laws import ROD_STRAINS
from .topology import as_nodes

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FORMATS", "hinge_table", "node_table", "node_values", "segment_table", "write_vtk"]

Array = NDArray[np.float64]
FORMATS = (".vtu", ".vtk")


def node_values(
    values: ArrayLike, hinge_nodes: ArrayLike, hinge_lengths: ArrayLike, count: int
) -> Array:
    """Return values of hinges as values of nodes.

    Parameters
    ----------
    values : array_like, shape (n, ...)
        One row for each hinge.
    hinge_nodes : array_like of int, shape (n,)
        Node of each hinge. A node that is clamped inside a rod has two hinges: their mean is taken,
        weighted with their lengths.
    hinge_lengths : array_like, shape (n,)
        Rest lengths of the hinges.
    count : int
        Number of nodes.

    Returns
    -------
    ndarray, shape (count, ...)
        Not a number where a node has no hinge.

    Raises
    ------
    InvalidInput
        If shapes do not fit, or there is no such node.

    Examples
    --------
    Node 1 has two hinges, of which one is three times as long; node 0 has none:

    >>> from lissome.rods._tables import node_values
    >>> node_values([0.0, 4.0], [1, 1], [0.1, 0.3], count=2)
    array([nan,  3.])
    """
    array = np.asarray(values, dtype=float)
    where = finite_array("hinge_nodes", hinge_nodes, (array.shape[0],), dtype=np.int64)
    weights: Array = finite_array("hinge_lengths", hinge_lengths, (array.shape[0],))
    if np.any((where < 0) | (where >= count)):
        raise InvalidInput(
            f"argument `hinge_nodes` holds {where.min()} to {where.max()}; nodes are numbered 0 to "
            f"{count - 1}"
        )
    shape = (-1,) + (1,) * (array.ndim - 1)
    total, weight = np.zeros((count, *array.shape[1:])), np.zeros(count)
    np.add.at(total, where, array * weights.reshape(shape))
    np.add.at(weight, where, weights)
    out = np.full_like(total, np.nan)
    has = weight > 0.0
    out[has] = total[has] / weight[has].reshape(shape)
    return out


def _columns(**groups: tuple[Any, tuple[str, ...]]) -> pd.DataFrame:
    import pandas as pd

    columns: dict[str, Any] = {}
    rows: int | None = None
    for argument, (values, names) in groups.items():
        if values is None:
            continue
        array = np.asarray(values)
        array = array.reshape(array.shape[0], -1) if array.ndim else array.reshape(0, 0)
        if array.shape[1] != len(names) or (rows is not None and array.shape[0] != rows):
            raise InvalidInput(
                f"argument `{argument}` has shape {np.shape(values)}; it must have "
                f"{'as many rows as the others' if rows is None else f'{rows} rows'} and "
                f"{len(names)} numbers in each"
            )
        rows = array.shape[0]
        columns.update({name: array[:, k] for k, name in enumerate(names)})
    return pd.DataFrame(columns)


def node_table(
    arclength: ArrayLike, positions: ArrayLike, *, strains: Any = None, moments: Any = None
) -> pd.DataFrame:
    """Return a table with a row for each node.

    Parameters
    ----------
    arclength : array_like, shape (N + 1,)
        Rest arc lengths: column s.
    positions : array_like, shape (N + 1, 3)
        Columns x, y, z.
    strains : array_like, shape (N + 1, 3), optional
        Columns curvature_1, curvature_2, twist; see :func:`node_values`.
    moments : array_like, shape (N + 1, 3), optional
        Columns moment_1, moment_2, moment_3, along the directors.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    InvalidInput
        If shapes do not fit.

    Examples
    --------
    >>> from lissome.rods._tables import node_table
    >>> node_table([0.0, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
         s    x    y    z
    0  0.0  0.0  0.0  0.0
    1  1.0  0.0  0.0  1.0
    """
    return _columns(
        arclength=(arclength, ("s",)),
        positions=(positions, ("x", "y", "z")),
        strains=(strains, ROD_STRAINS),
        moments=(moments, ("moment_1", "moment_2", "moment_3")),
    )


def hinge_table(
    nodes: ArrayLike, arclength: ArrayLike, *, strains: Any = None, moments: Any = None
) -> pd.DataFrame:
    """Return a table with a row for each hinge.

    Parameters
    ----------
    nodes : array_like of int, shape (n,)
        Nodes of the hinges: column node.
    arclength : array_like, shape (n,)
        Their rest arc lengths: column s.
    strains : array_like, shape (n, 3), optional
        Columns curvature_1, curvature_2, twist.
    moments : array_like, shape (n, 3), optional
        Columns moment_1, moment_2, moment_3, along the directors.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    InvalidInput
        If shapes do not fit.

    Examples
    --------
    >>> from lissome.rods._tables import hinge_table
    >>> hinge_table([1, 2], [0.5, 1.0], strains=[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
       node    s  curvature_1  curvature_2  twist
    0     1  0.5          0.0          0.0    1.0
    1     2  1.0          0.0          0.0    2.0
    """
    return _columns(
        nodes=(nodes, ("node",)),
        arclength=(arclength, ("s",)),
        strains=(strains, ROD_STRAINS),
        moments=(moments, ("moment_1", "moment_2", "moment_3")),
    )


def segment_table(
    arclength: ArrayLike, directors: ArrayLike, *, forces: Any = None, stretches: Any = None
) -> pd.DataFrame:
    """Return a table with a row for each segment.

    Parameters
    ----------
    arclength : array_like, shape (N,)
        Rest arc lengths of the middles: column s.
    directors : array_like, shape (N, 3, 3)
        ``directors[j, I]`` is director I: columns d1x to d3z.
    forces : array_like, shape (N, 3), optional
        Internal forces: columns force_x, force_y, force_z.
    stretches : array_like, shape (N,), optional
        Column stretch.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    InvalidInput
        If shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from lissome.rods._tables import segment_table
    >>> table = segment_table([0.5], np.eye(3)[None], forces=[[0.0, 0.0, -1.0]])
    >>> print(table.loc[0, ["s", "d1x", "d3z", "force_z"]].tolist())
    [0.5, 1.0, 1.0, -1.0]
    """
    names = tuple(f"d{i}{c}" for i in (1, 2, 3) for c in "xyz")
    return _columns(
        arclength=(arclength, ("s",)),
        directors=(directors, names),
        forces=(forces, ("force_x", "force_y", "force_z")),
        stretches=(stretches, ("stretch",)),
    )


def write_vtk(
    path: str | os.PathLike[str],
    positions: ArrayLike,
    directors: ArrayLike,
    *,
    closed: bool = False,
    point_data: Mapping[str, ArrayLike] | None = None,
    cell_data: Mapping[str, ArrayLike] | None = None,
) -> Path:
    """Write a rod for ParaView: a chain of lines with directors and whatever is known on it.

    Parameters
    ----------
    path : path
        File to write; its name ends in ``.vtu`` (XML) or ``.vtk`` (legacy).
    positions : array_like, shape (N + 1, 3)
        Nodes. Of a closed rod the last one, which repeats the first, is left out.
    directors : array_like, shape (N, 3, 3)
        Written as the cell data d1, d2, d3.
    closed : bool
        Whether the last segment ends at node 0.
    point_data : mapping, optional
        Arrays (N + 1, ...) by name, such as strains; not a number is allowed.
    cell_data : mapping, optional
        Arrays (N, ...) by name, such as internal forces.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InvalidInput
        If shapes do not fit, or the name of the file says another format.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import meshio
    >>> import numpy as np
    >>> from lissome.rods._tables import write_vtk
    >>> nodes = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = write_vtk(pathlib.Path(folder) / "rod.vtu", nodes, [np.eye(3)] * 2)
    ...     rod = meshio.read(file)
    >>> print(rod.points[-1], rod.cells_dict["line"].tolist())
    [0. 0. 2.] [[0, 1], [1, 2]]
    """
    import meshio

    file = Path(path)
    one_of("path", file.suffix.lower(), FORMATS)
    points = as_nodes("positions", positions)
    count = points.shape[0] - 1
    frames: Array = finite_array("directors", directors, (count, 3, 3))
    data = {"d1": frames[:, 0], "d2": frames[:, 1], "d3": frames[:, 2]}
    lines = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    kept = count + 1
    if closed:
        lines[-1, 1] = 0
        kept = count

    def arrays(kind: str, values: Mapping[str, ArrayLike] | None, rows: int) -> dict[str, Array]:
        out = {}
        for name, value in (values or {}).items():
            array = np.ascontiguousarray(value, dtype=float)
            if array.ndim == 0 or array.shape[0] != rows:
                raise InvalidInput(
                    f"argument `{kind}`[{name!r}] has shape {array.shape}; it must have {rows} rows"
                )
            out[name] = array
        return out

    on_points = {k: v[:kept] for k, v in arrays("point_data", point_data, count + 1).items()}
    data |= arrays("cell_data", cell_data, count)
    mesh = meshio.Mesh(
        points[:kept],
        [("line", lines)],
        point_data=on_points,
        cell_data={name: [np.ascontiguousarray(value)] for name, value in data.items()},
    )
    mesh.write(file)
    return file
