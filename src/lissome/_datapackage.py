"""The data package behind :mod:`lissome.literature`: where it lies, how its tables are read.

Only the standard library and numpy are used here, so that loading a table costs milliseconds. The
rules are those of the Frictionless Table Schema that the tables need; the tests check the same
files with the frictionless library.
"""

from __future__ import annotations

import contextlib
import csv
import difflib
import hashlib
import io
import json
import math
import os
import re
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import DataError

__all__ = ["Descriptor", "data_folder", "nearest", "parse_csv", "write_atomically"]

PROVENANCES = ("published", "derived", "digitized")
PACKAGE = "datapackage.json"
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

# What a description must hold: a type, a list of one kind, or a mapping ("?": may be missing,
# "*": any other name). Everything else in it is for people.
_NUMERIC = (int, float)
_FIELD: dict[str, Any] = {
    "name": str,
    "type": str,
    "unit?": str,
    "description?": str,
    "constraints?": {
        "required?": bool,
        "unique?": bool,
        "minimum?": _NUMERIC,
        "maximum?": _NUMERIC,
        "enum?": [(str, *_NUMERIC)],
        "pattern?": str,
    },
}
_SCHEMA: dict[str, Any] = {"fields": [_FIELD], "primaryKey?": [str]}
_SOURCES = [{"title": str, "path?": str, "place?": str}]
_RESOURCE: dict[str, Any] = {
    "name": str,
    "path": str,
    "title": str,
    "description": str,
    "provenance": str,
    "licenses": [{"name": str}],
    "sources?": _SOURCES,
    "schema": _SCHEMA,
    "digitization?": {"*": object},
    "sealed?": bool,
}
_SLOT: dict[str, Any] = {
    "name": str,
    "title": str,
    "figure": str,
    "description": str,
    "instructions": [str],
    "sources": _SOURCES,
    "schema": _SCHEMA,
    "declare": {"*": {"description": str, "enum?": [str]}},
    "monotone?": {"column": str, "within": [str]},
}
_PACKAGE: dict[str, Any] = {
    "licenses": [{"name": str}],
    "resources": [_RESOURCE],
    "awaited": [_SLOT],
}
# Names become names of files: nothing leads out of the folder.
_NAME = re.compile(r"[a-z0-9]([a-z0-9-]*[a-z0-9])?", re.ASCII)


def data_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """Return the folder that holds ``datapackage.json``.

    In this order: the argument, the environment variable ``LISSOME_DATA``, the folder that an
    installed wheel brings (``lissome/_data``), the folder ``data`` of a source checkout.
    """
    explicit = folder if folder is not None else os.environ.get("LISSOME_DATA") or None
    if explicit is not None:
        candidates = [Path(explicit)]
        named = "argument `folder`" if folder is not None else "environment variable LISSOME_DATA"
    else:
        here = Path(__file__).resolve()
        candidates = [here.parent / "_data", here.parents[2] / "data"]
        named = "installation"
    for candidate in candidates:
        if (candidate / PACKAGE).is_file():
            return candidate
    tried = ", ".join(str(candidate / PACKAGE) for candidate in candidates)
    raise DataError(
        f"the {named} has no stored data: none of {tried} exists; "
        "reinstall the package, or let LISSOME_DATA name the folder that holds datapackage.json"
    )


class Descriptor:
    """The parsed ``datapackage.json`` of a folder.

    Parameters
    ----------
    folder : path-like, optional
        See :func:`data_folder`.

    Raises
    ------
    DataError
        If the file is not a data package.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        self.folder = data_folder(folder)
        self.path = self.folder / PACKAGE
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise DataError(
                f"{self.path}: expected a JSON data package, found {error}; restore the file"
            ) from error
        if fault := _fault(content, _PACKAGE, "") or _inconsistency(content):
            raise DataError(f"{self.path}: {fault}; restore the file")
        self.content: dict[str, Any] = content
        self.resources: dict[str, dict[str, Any]] = {r["name"]: r for r in content["resources"]}
        self.slots: dict[str, dict[str, Any]] = {s["name"]: s for s in content["awaited"]}

    def read(self, name: str) -> tuple[dict[str, Any], bytes, dict[str, npt.NDArray[Any]]]:
        """Return description, bytes and columns of a table after all checks."""
        resource = self.resources[name]
        path = self.folder / resource["path"]
        if resource.get("provenance") not in PROVENANCES:
            raise DataError(
                f"{self.path}: table '{name}' has provenance {resource.get('provenance')!r}; "
                f"expected one of {', '.join(PROVENANCES)}"
            )
        try:
            raw = path.read_bytes()
        except OSError as error:
            raise DataError(
                f"{path}: expected the table '{name}', found {error.strerror or error}; "
                "restore the file from version control"
            ) from error
        if resource.get("sealed", True):
            expected, found = resource.get("hash"), digest(raw)
            if expected != found:
                raise DataError(
                    f"{path}: expected {expected}, found {found} ({len(raw)} bytes; expected "
                    f"{resource.get('bytes')}); the file is damaged or was edited: restore it, or "
                    f"after a wanted change run `python -m lissome.literature seal {name}`"
                )
        return resource, raw, parse_csv(path, raw, resource["schema"])

    def write(self) -> None:
        """Write ``datapackage.json`` anew, in one step."""
        text = json.dumps(self.content, indent=2, ensure_ascii=False) + "\n"
        write_atomically(self.path, text.encode("utf-8"))


def _fault(value: Any, shape: Any, where: str) -> str | None:
    """Say in words where a value is not of a shape; see `_PACKAGE`."""
    place = where.lstrip(".") or "the whole"
    if isinstance(shape, list):
        if not isinstance(value, list):
            return f"expected a list, found {_kind(value)}, at {place}"
        faults = (_fault(item, shape[0], f"{where}[{i}]") for i, item in enumerate(value))
        return next((fault for fault in faults if fault), None)
    if isinstance(shape, dict):
        if not isinstance(value, dict):
            return f"expected an object, found {_kind(value)}, at {place}"
        for name, inner in shape.items():
            key = name.removesuffix("?")
            if name == "*":
                faults = (_fault(item, inner, f"{where}.{key}") for key, item in value.items())
                if fault := next((fault for fault in faults if fault), None):
                    return fault
            elif key in value:
                if fault := _fault(value[key], inner, f"{where}.{key}"):
                    return fault
            elif key == name:
                return f"expected '{key}', which is missing, at {place}"
        return None
    # a flag is a number in Python, but none in JSON
    if not isinstance(value, shape) or (isinstance(value, bool) and shape not in (bool, object)):
        return f"found {_kind(value)}, which does not belong there, at {place}"
    return None


def _kind(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _inconsistency(content: Mapping[str, Any]) -> str | None:
    """Say in words what is wrong in a description whose parts have the right shapes."""
    for part in ("resources", "awaited"):
        names = [item["name"] for item in content[part]]
        for item in content[part]:
            name, schema = item["name"], item["schema"]
            if not _NAME.fullmatch(name) or names.count(name) > 1:
                return f"expected a name of a-z, 0-9 and - that is used once, found {name!r}"
            path = item.get("path", "")
            if path.startswith((".", "/")) or re.search(r"[\\:]|/\.", path):
                return f"table '{name}': expected a file in the folder, found the path {path!r}"
            columns = {field["name"]: field for field in schema["fields"]}
            if not columns or len(columns) != len(schema["fields"]):
                return f"table '{name}': expected columns of different names"
            for column, field in columns.items():
                if field["type"] not in ("string", "number"):
                    return (
                        f"table '{name}', column '{column}': the type {field['type']!r} is unknown"
                    )
                kinds = (str,) if field["type"] == "string" else _NUMERIC
                if not all(
                    isinstance(c, kinds) for c in field.get("constraints", {}).get("enum", [])
                ):
                    return f"table '{name}', column '{column}': choices of another type than it"
                try:
                    re.compile(field.get("constraints", {}).get("pattern", ""))
                except re.error as error:
                    return f"table '{name}', column '{column}': the pattern is none ({error})"
            rule = item.get("monotone", {"column": next(iter(columns)), "within": []})
            for column in [rule["column"], *rule["within"]]:
                if column not in columns:
                    return f"table '{name}': there is no column {column!r}"
            if "monotone" in item and columns[rule["column"]]["type"] != "number":
                return f"table '{name}': the column {rule['column']!r} cannot increase"
    return None


def digest(raw: bytes) -> str:
    """Return the hash of a file in the notation of the data package."""
    return "sha256:" + hashlib.sha256(raw).hexdigest()


def write_atomically(path: Path, raw: bytes) -> None:
    """Write a file so that nobody ever sees half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(raw)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the remedy for an unknown name: the nearest known ones, or all of them."""
    names = sorted(known)
    close = difflib.get_close_matches(str(name), names, 3, 0.5)
    if close:
        return "did you mean " + " or ".join(repr(item) for item in close) + "?"
    return "known: " + (", ".join(names) if names else "none")


def parse_csv(path: Path, raw: bytes, schema: Mapping[str, Any]) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a CSV table that obeys its schema, or raise :class:`DataError`.

    Numbers become arrays of ``float`` (an empty cell is NaN where the schema allows it), everything
    else arrays of ``str``.
    """
    try:
        text = raw.decode("utf-8-sig")
        rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(
            f"{path}: expected a CSV table in UTF-8, found {error}; export or restore it again"
        ) from error
    if not rows:
        raise DataError(f"{path}: expected a header line, found an empty file; restore it")
    fields = schema["fields"]
    names = [field["name"] for field in fields]
    header = rows[0]
    if header != names:
        missing = [name for name in names if name not in header]
        extra = [name for name in header if name not in names]
        what = (
            [f"missing column {name!r}" for name in missing]
            + [f"unknown column {name!r} ({nearest(name, names)})" for name in extra]
        ) or ["the columns in another order"]
        raise DataError(
            f"{path}: expected the columns {', '.join(names)}; found {', '.join(header)}: "
            f"{'; '.join(what)}"
        )
    columns: dict[str, list[Any]] = {name: [] for name in names}
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            raise DataError(
                f"{path}, row {number}: expected {len(names)} cells, found {len(row)}; "
                "quote cells that hold commas"
            )
        for field, cell in zip(fields, row, strict=True):
            columns[field["name"]].append(_cell(path, number, field, cell))
    for field in fields:
        name = field["name"]
        if field.get("constraints", {}).get("unique") or schema.get("primaryKey") == [name]:
            _unique(path, name, columns[name])
    return {
        field["name"]: np.array(
            columns[field["name"]], dtype=float if field["type"] == "number" else object
        )
        for field in fields
    }


def _cell(path: Path, number: int, field: Mapping[str, Any], cell: str) -> Any:
    where = f"{path}, row {number}, column '{field['name']}'"
    rules = field.get("constraints", {})
    if cell == "":
        if rules.get("required"):
            raise DataError(f"{where}: expected {_wanted(field)}, found an empty cell; fill it in")
        return math.nan if field["type"] == "number" else ""
    if field["type"] == "number":
        bare = cell.strip(" \t")  # other white space is a sign of damage
        value = float(bare) if _NUMBER.fullmatch(bare) else math.nan
        vanished = value == 0.0 and re.search("[1-9]", re.split("[eE]", bare)[0])
        if not math.isfinite(value) or vanished:  # too large or too small for a float
            raise DataError(
                f"{where}: expected {_wanted(field)}, found {cell!r}; write one number a cell, "
                "with a point and without unit"
            )
        low, high = rules.get("minimum", -math.inf), rules.get("maximum", math.inf)
        if not low <= value <= high:
            raise DataError(
                f"{where}: expected {_wanted(field)} from {low:g} to {high:g}, found {cell}; "
                "check unit and calibration"
            )
        allowed = rules.get("enum")
        if allowed is not None and value not in allowed:
            raise DataError(f"{where}: expected one of {allowed}, found {cell}")
        return value
    allowed = rules.get("enum")
    if allowed is not None and cell not in allowed:
        raise DataError(
            f"{where}: expected one of {', '.join(map(repr, allowed))}, found {cell!r}; "
            f"{nearest(cell, allowed)}"
        )
    pattern = rules.get("pattern")
    if pattern is not None and not re.fullmatch(pattern, cell):
        raise DataError(f"{where}: expected text of the form {pattern}, found {cell!r}")
    return cell


def _wanted(field: Mapping[str, Any]) -> str:
    unit = field.get("unit")
    if field["type"] != "number":
        return "text"
    return f"a number in {unit}" if unit and unit != "1" else "a number"


def _unique(path: Path, name: str, cells: list[Any]) -> None:
    seen: dict[Any, int] = {}
    for number, cell in enumerate(cells, start=2):
        if cell in seen:
            raise DataError(
                f"{path}, column '{name}': expected every entry once, found {cell!r} in rows "
                f"{seen[cell]} and {number}"
            )
        seen[cell] = number
