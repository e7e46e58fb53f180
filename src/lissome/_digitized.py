"""Validation of points read off a figure, before they enter the data package."""

from __future__ import annotations

import json
import math
import re
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ._datapackage import nearest
from ._validate import nonnegative
from .errors import DataError, InvalidInput

__all__ = ["check_declarations", "check_points", "check_tool", "check_uncertainty", "read_axes"]


_LARGEST = 20 * 2**20  # bytes of a project without its image; a compressed one may pretend


def check_points(path: Path, slot: Mapping[str, Any], columns: Mapping[str, Any]) -> None:
    """Refuse too few points, and points that do not advance where the slot demands it."""
    count = len(next(iter(columns.values())))
    if count < 3:
        raise DataError(f"{path}: expected at least 3 points, found {count}; digitize the figure")
    for name, column in columns.items():
        for row, cell in enumerate(column.tolist()):
            # A spreadsheet would run it as soon as somebody opens the stored table.
            if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r")):
                raise DataError(
                    f"{path}, row {row + 2}, column '{name}': expected text, found the formula "
                    f"{cell!r}; write it without the first character"
                )
    rule = slot.get("monotone")
    if rule is None:
        return
    last: dict[tuple[Any, ...], float] = {}
    for row in range(count):
        group = tuple(columns[name][row] for name in rule["within"])
        value = float(columns[rule["column"]][row])
        if group in last and value <= last[group]:
            series = ", ".join(map(str, group)) or "the only one"
            raise DataError(
                f"{path}, row {row + 2}: expected '{rule['column']}' to increase within the series "
                f"({series}), found {value:g} after {last[group]:g}; sort the points of each "
                "series and remove repeated ones"
            )
        last[group] = value


def check_tool(tool: object) -> str:
    """Return the name of the tool, which must carry a version."""
    if not isinstance(tool, str) or not re.search(r"[A-Za-z].*\d", tool):
        raise InvalidInput(
            f"argument `tool` is {tool!r}; name the tool with its version, "
            "such as 'WebPlotDigitizer 5.2'"
        )
    return tool.strip()


def check_uncertainty(slot: Mapping[str, Any], uncertainty: object) -> dict[str, float]:
    """Return one uncertainty for each numeric column, in the unit of the column."""
    numeric = [f["name"] for f in slot["schema"]["fields"] if f["type"] == "number"]
    if not isinstance(uncertainty, Mapping):
        raise InvalidInput(
            f"argument `uncertainty` is {uncertainty!r}; give a mapping with one number for each "
            f"of {', '.join(numeric)}"
        )
    _same_names("uncertainty", uncertainty, numeric)
    result = {name: nonnegative(f"uncertainty[{name}]", uncertainty[name]) for name in numeric}
    if not any(result.values()):
        raise InvalidInput(
            "argument `uncertainty` is 0 for every column; points read off a figure are uncertain: "
            "digitize twice and give half the largest difference"
        )
    return result


def check_declarations(slot: Mapping[str, Any], declare: object) -> dict[str, str]:
    """Return what the slot wants to be declared about the figure."""
    wanted: Mapping[str, Any] = slot["declare"]
    given = {} if declare is None else declare
    if not isinstance(given, Mapping):
        raise InvalidInput(f"argument `declare` is {declare!r}; give a mapping of names to text")
    _same_names("declare", given, list(wanted))
    for name, text in given.items():
        allowed = wanted[name].get("enum")
        if not isinstance(text, str) or not text.strip() or (allowed and text not in allowed):
            choices = f"one of {', '.join(map(repr, allowed))}" if allowed else "some text"
            raise InvalidInput(
                f"argument `declare[{name}]` is {text!r}; it must be {choices}: "
                f"{wanted[name]['description']}"
            )
    return dict(given)


def _same_names(argument: str, given: Mapping[Any, Any], wanted: list[str]) -> None:
    missing = [name for name in wanted if name not in given]
    if missing:
        raise InvalidInput(f"argument `{argument}` lacks {', '.join(missing)}; give every one")
    for name in given:
        if name not in wanted:
            raise InvalidInput(
                f"argument `{argument}` has the unknown name {name!r}; {nearest(name, wanted)}"
            )


def read_axes(path: Path) -> tuple[bytes, list[dict[str, Any]]]:
    """Return the JSON of a WebPlotDigitizer project and the calibration of its axes.

    A project is a JSON file, or a tar archive of ``wpd.json`` and the image. Only the JSON is kept:
    the image belongs to the publisher.

    Each entry of the list holds the name of the axes, whether each is logarithmic, and the two
    calibration values of each axis.
    """
    remedy = "save the project (File, Save Project) with WebPlotDigitizer 4 or later"
    try:
        raw = _project(path)
        project = json.loads(raw)
        collection = project["axesColl"]
        found = [_axes(axes) for axes in collection]
    except Exception as error:  # JSON, tar, compression: each has errors of its own
        raise DataError(
            f"{path}: expected a WebPlotDigitizer project with calibrated XY axes, found "
            f"{type(error).__name__}: {error}; {remedy}"
        ) from error
    if not found:
        raise DataError(f"{path}: expected calibrated XY axes, found none; {remedy}")
    return raw, found


def _project(path: Path) -> bytes:
    if not tarfile.is_tarfile(path):
        with path.open("rb") as plain:
            return _limited(plain.read(_LARGEST + 1))
    with tarfile.open(path) as archive:
        for member in archive.getmembers():
            if Path(member.name).name == "wpd.json":
                stream = archive.extractfile(member)
                if stream is not None:
                    return _limited(stream.read(_LARGEST + 1))
    raise ValueError("an archive without wpd.json")


def _limited(raw: bytes) -> bytes:
    if len(raw) > _LARGEST:
        raise ValueError(f"more than {_LARGEST} bytes")
    return raw


def _axes(axes: Mapping[str, Any]) -> dict[str, Any]:
    if axes.get("type") != "XYAxes":
        raise ValueError(f"axes of type {axes.get('type')!r} instead of 'XYAxes'")
    points = axes["calibrationPoints"]
    if len(points) < 4:
        raise ValueError(f"{len(points)} calibration points instead of 4 (X1, X2, Y1, Y2)")
    pixels: npt.NDArray[np.float64] = np.array([[float(p["px"]), float(p["py"])] for p in points])
    # X1 and X2 carry the value of x, Y1 and Y2 that of y
    x = [float(points[0]["dx"]), float(points[1]["dx"])]
    y = [float(points[2]["dy"]), float(points[3]["dy"])]
    if not (np.isfinite(pixels).all() and all(map(math.isfinite, x + y))):
        raise ValueError("a calibration point that is not finite")
    for label, values, ends in (("x", x, pixels[:2]), ("y", y, pixels[2:4])):
        if values[0] == values[1] or np.array_equal(ends[0], ends[1]):
            raise ValueError(f"the two calibration points of the {label} axis coincide")
    log_x, log_y = bool(axes.get("isLogX", axes.get("isLog", False))), bool(axes.get("isLogY"))
    for label, values, logarithmic in (("x", x, log_x), ("y", y, log_y)):
        if logarithmic and min(values) <= 0:
            raise ValueError(f"a logarithmic {label} axis with the value {min(values):g}")
    return {"name": str(axes.get("name", "")), "x": x, "y": y, "log_x": log_x, "log_y": log_y}
