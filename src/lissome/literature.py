"""Stored literature data: published, derived and digitized numbers with their provenance.

Every table is described in ``datapackage.json`` (Frictionless): one numeric value a cell, units,
source and place in the source, licence, hash, and how the numbers came about:

``published``
    printed in words or tables,
``derived``
    computed from a published formula or boundary-value problem; a test recomputes it,
``digitized``
    read off a figure; tool, axes, uncertainty and project file are kept.

Where a figure has not been digitized there is a *slot*: a table that is described but has no data.
Nothing is ever invented to fill it.

From a shell: ``python -m lissome.literature list``, ``describe NAME``, ``check``,
``seal [NAME ...]`` and ``register SLOT points.csv --project project.json ...``.
"""

from __future__ import annotations

import argparse
import csv
import html
import io
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _digitized
from ._datapackage import PROVENANCES, Descriptor, digest, nearest, parse_csv, write_atomically
from .errors import DataAwaited, DataError, InvalidInput

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Number",
    "Source",
    "Table",
    "awaited",
    "check",
    "describe",
    "is_available",
    "load",
    "register",
    "seal",
    "slots",
    "tables",
    "value",
]

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class Source:
    """Where data come from.

    Attributes
    ----------
    title : str
        Author, journal, year.
    address : str
        The DOI as an address; empty where none is known.
    place : str
        Section, equation, table or caption.

    Examples
    --------
    >>> from lissome import literature
    >>> (source, *_) = literature.load("audoly-neukirch-phi").sources
    >>> isinstance(source, literature.Source), source.address.startswith("https://doi.org/")
    (True, True)
    """

    title: str
    address: str = ""
    place: str = ""

    def __str__(self) -> str:
        return ", ".join(part for part in (self.title, self.place, self.address) if part)


@dataclass(frozen=True, eq=False)
class Table:
    """A stored table and everything that is known about it.

    Attributes
    ----------
    name, title, description : str
        What it is.
    provenance : {'published', 'derived', 'digitized'}
        How the numbers came about.
    sources : tuple of Source
        Where they come from.
    licence : str
        Licence of the table.
    columns : mapping of str to numpy.ndarray
        The columns, read-only; numbers as ``float`` (NaN where the source has none), else ``str``.
    units : mapping of str to str
        Unit of each column that has one for all its rows. Tables with a column ``unit`` carry the
        unit row by row.
    digitization : mapping
        Tool, axes, uncertainty, declarations and project file of a digitized table; else empty.

    Examples
    --------
    >>> from lissome import literature
    >>> table = literature.load("thesis-table-3-1")
    >>> table.provenance, sorted(table.columns)[:3], table.frame.shape[1] == len(table.columns)
    ('published', ['id', 'note', 'place'], True)
    """

    name: str
    title: str
    description: str
    provenance: str
    sources: tuple[Source, ...]
    licence: str
    columns: Mapping[str, npt.NDArray[Any]] = field(repr=False)
    units: Mapping[str, str] = field(repr=False)
    digitization: Mapping[str, Any] = field(repr=False)

    @property
    def frame(self) -> pd.DataFrame:
        """A new :class:`pandas.DataFrame` of the columns; changing it changes nothing else."""
        import pandas as pd

        return pd.DataFrame({name: column.copy() for name, column in self.columns.items()})

    def __getitem__(self, column: str) -> npt.NDArray[Any]:
        """Return one column as a read-only array.

        Raises
        ------
        DataError
            If there is no such column.
        """
        try:
            return self.columns[column]
        except KeyError:
            raise DataError(
                f"table '{self.name}' has no column {column!r}; {nearest(column, self.columns)}"
            ) from None

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values())))

    def _repr_html_(self) -> str:
        about = "; ".join(str(source) for source in self.sources)
        heading = (
            f"<p><b>{html.escape(self.title)}</b> ({self.provenance}). {html.escape(about)}</p>"
        )
        body: str = self.frame.to_html(index=False)
        return heading + body


@dataclass(frozen=True)
class Number:
    """One stored number.

    Attributes
    ----------
    id : str
        Its name.
    value : float
        The number in `unit`.
    unit : str
        A unit that pint knows, ``1``, a scale of the problem (such as ``L``), or empty where the
        source prints none.
    uncertainty : float or None
        Plus or minus, as printed.
    relation : str
        How the source states it: ``equal``, ``about``, ``more than``, ...
    quantity, symbol, printed : str
        What it is, and the characters of the source.
    reference, place, status, note : str
        Key of the source in the bibliography, place in the source, where it was read, remark.
    table : str
        Name of the table that holds it.

    Examples
    --------
    >>> from lissome import literature
    >>> thickness = literature.value("t31-thickness")
    >>> float(thickness), thickness.unit, thickness.to("mm"), thickness.relation
    (15.0, 'micrometer', 0.015, 'equal')
    """

    id: str
    value: float
    unit: str
    uncertainty: float | None
    relation: str
    quantity: str
    symbol: str
    printed: str
    reference: str
    place: str
    status: str
    note: str
    table: str

    def __float__(self) -> float:
        return self.value

    def to(self, unit: str) -> float:
        """Return the number in another unit.

        Parameters
        ----------
        unit : str
            Any unit that pint knows.

        Returns
        -------
        float

        Raises
        ------
        InvalidInput
            If the unit of the number is no physical unit, or cannot be converted into `unit`.

        Examples
        --------
        >>> from lissome import literature
        >>> literature.value("t31-thickness").to("m")
        1.5e-05
        """
        import pint

        registry: Any = pint.get_application_registry()
        try:
            return float(registry.Quantity(self.value, self.unit).to(unit).magnitude)
        except (pint.PintError, ValueError, AttributeError, TypeError) as error:
            raise InvalidInput(
                f"argument `unit` is {unit!r}; '{self.id}' is stored in {self.unit or 'no unit'} "
                f"and cannot be converted ({error})"
            ) from error


def tables(folder: PathLike | None = None) -> tuple[str, ...]:
    """Return the names of all tables that hold data.

    Parameters
    ----------
    folder : path-like, optional
        Folder with another data package; by default that of the library (or of the environment
        variable ``LISSOME_DATA``).

    Examples
    --------
    >>> from lissome import literature
    >>> "thesis-table-3-1" in literature.tables()
    True
    """
    return tuple(Descriptor(folder).resources)


def slots(folder: PathLike | None = None) -> tuple[str, ...]:
    """Return the names of all figures that have a slot for digitized points, filled or not.

    Parameters
    ----------
    folder : path-like, optional
        See :func:`tables`.

    Examples
    --------
    >>> from lissome import literature
    >>> "slinky-distance" in literature.slots()
    True
    """
    return tuple(Descriptor(folder).slots)


def awaited(folder: PathLike | None = None) -> tuple[str, ...]:
    """Return the names of the slots that have no data yet.

    Parameters
    ----------
    folder : path-like, optional
        See :func:`tables`.

    Examples
    --------
    A slot either has data or is awaited:

    >>> from lissome import literature
    >>> set(literature.awaited()) == {s for s in literature.slots() if not literature.is_available(s)}
    True
    """
    package = Descriptor(folder)
    return tuple(name for name in package.slots if name not in package.resources)


def is_available(slot: str, folder: PathLike | None = None) -> bool:
    """Return whether a slot has been filled.

    Parameters
    ----------
    slot : str
        One of :func:`slots`.
    folder : path-like, optional
        See :func:`tables`.

    Raises
    ------
    DataError
        If there is no such slot: a misspelled name would otherwise hide data for ever.

    Examples
    --------
    >>> from lissome import literature
    >>> literature.is_available("slinky-distances")
    Traceback (most recent call last):
        ...
    lissome.errors.DataError: ...there is no slot 'slinky-distances'; did you mean 'slinky-distance'...
    """
    package = Descriptor(folder)
    if slot not in package.slots:
        raise DataError(
            f"{package.path}: there is no slot {slot!r}; {nearest(slot, package.slots)}"
        )
    return slot in package.resources


def load(name: str, folder: PathLike | None = None) -> Table:
    """Load a table, after checking its hash and every cell against its schema.

    Parameters
    ----------
    name : str
        One of :func:`tables`, or a slot.
    folder : path-like, optional
        See :func:`tables`.

    Returns
    -------
    Table

    Raises
    ------
    DataAwaited
        If `name` is a slot without data; the message says how to fill it.
    DataError
        If there is no such table, or if the file is damaged or does not obey its schema; the
        message names the file, what was expected, what was found, and the remedy.

    Examples
    --------
    >>> from lissome import literature
    >>> table = literature.load("audoly-neukirch-phi")
    >>> table.provenance, table["v"].tolist()[0], round(float(table["phi"][0] * 360), 12)
    ('derived', 0.0, 1.0)
    """
    package = Descriptor(folder)
    if name not in package.resources:
        if name in package.slots:
            raise DataAwaited(
                f"the data of {package.slots[name]['figure']} ('{name}') are awaited: nobody has "
                f"digitized them yet; `python -m lissome.literature describe {name}` says how"
            )
        raise DataError(
            f"{package.path}: there is no table {name!r}; "
            f"{nearest(name, [*package.resources, *package.slots])}"
        )
    resource, _, columns = package.read(name)
    for column in columns.values():
        column.setflags(write=False)
    return Table(
        name=name,
        title=resource["title"],
        description=resource["description"],
        provenance=resource["provenance"],
        sources=_sources(resource),
        licence=", ".join(item["name"] for item in resource["licenses"]),
        columns=MappingProxyType(columns),
        units=MappingProxyType(
            {f["name"]: f["unit"] for f in resource["schema"]["fields"] if "unit" in f}
        ),
        digitization=MappingProxyType(dict(resource.get("digitization", {}))),
    )


def value(id: str, folder: PathLike | None = None) -> Number:
    """Return one stored number by its id.

    Parameters
    ----------
    id : str
        Entry of the column ``id`` of any table of single numbers.
    folder : path-like, optional
        See :func:`tables`.

    Returns
    -------
    Number

    Raises
    ------
    DataError
        If there is no such number (the nearest ids are named), or if a table is damaged.

    Examples
    --------
    >>> from lissome import literature
    >>> span = literature.value("gelebart-span")
    >>> float(span), span.place
    (0.957, 'thesis, Sec. 3.4')
    """
    package = Descriptor(folder)
    known: list[str] = []
    for name, resource in package.resources.items():
        names = {f["name"] for f in resource["schema"]["fields"]}
        if not {"id", "value", "unit", "reference"} <= names:
            continue
        _, _, columns = package.read(name)
        ids = columns["id"].tolist()
        known += ids
        if id in ids:
            row = {key: column[ids.index(id)] for key, column in columns.items()}
            plus_minus = float(row.pop("uncertainty"))
            return Number(
                **{**row, "value": float(row["value"])},
                uncertainty=None if np.isnan(plus_minus) else plus_minus,
                table=name,
            )
    raise DataError(f"{package.path}: no table holds a number {id!r}; {nearest(id, known)}")


def describe(name: str, folder: PathLike | None = None) -> str:
    """Return in words what a table or a slot holds, and how a slot is filled.

    Parameters
    ----------
    name : str
        One of :func:`tables`, or a slot.
    folder : path-like, optional
        See :func:`tables`.

    Returns
    -------
    str

    Raises
    ------
    DataError
        If there is no such table.

    Examples
    --------
    >>> from lissome import literature
    >>> print(literature.describe("film-strains").splitlines()[0])
    film-strains: Liquid crystal elastomers: strain against temperature
    """
    package = Descriptor(folder)
    if name not in package.resources and name not in package.slots:
        raise DataError(
            f"{package.path}: there is no table {name!r}; "
            f"{nearest(name, [*package.resources, *package.slots])}"
        )
    filled = name in package.resources
    item = package.resources[name] if filled else package.slots[name]
    lines = [f"{name}: {item['title']}"]
    lines.append(f"  {item['provenance'] if filled else 'awaited: ' + item['figure']}")
    lines.append(f"  {item['description']}")
    lines += [f"  source: {source}" for source in _sources(item)]
    lines.append("  columns:")
    for column in item["schema"]["fields"]:
        rules = column.get("constraints", {})
        parts = [column["type"]]
        if column.get("unit"):
            parts.append(f"unit {column['unit']}")
        if "enum" in rules:
            parts.append("one of " + ", ".join(str(choice) for choice in rules["enum"]))
        if "minimum" in rules or "maximum" in rules:
            parts.append(f"from {rules.get('minimum', '-inf')} to {rules.get('maximum', 'inf')}")
        text = f": {column['description']}" if column.get("description") else ""
        lines.append(f"    {column['name']} ({'; '.join(parts)}){text}")
    if not filled:
        if "monotone" in item:
            rule = item["monotone"]
            within = f" within each {', '.join(rule['within'])}" if rule["within"] else ""
            lines.append(f"  '{rule['column']}' must increase{within}")
        for key, rule in item["declare"].items():
            choices = f": {' | '.join(rule['enum'])}" if "enum" in rule else ""
            lines.append(f"  declare {key} ({rule['description']}){choices}")
        lines += [f"  {i}. {step}" for i, step in enumerate(item["instructions"], start=1)]
        lines.append(f"  {len(item['instructions']) + 1}. {_command(item)}")
    return "\n".join(lines)


def _command(slot: Mapping[str, Any]) -> str:
    numeric = [f["name"] for f in slot["schema"]["fields"] if f["type"] == "number"]
    parts = [
        f"python -m lissome.literature register {slot['name']} points.csv",
        "--project project.json",
        '--tool "WebPlotDigitizer 5.2"',
        "--uncertainty " + " ".join(f"{name}=..." for name in numeric),
    ]
    if slot["declare"]:
        parts.append("--declare " + " ".join(f'{name}="..."' for name in slot["declare"]))
    return " ".join(parts)


def register(
    slot: str,
    file: PathLike,
    *,
    project: PathLike,
    tool: str,
    uncertainty: Mapping[str, float],
    declare: Mapping[str, str] | None = None,
    replace: bool = False,
    folder: PathLike | None = None,
) -> Table:
    """Validate points read off a figure and add them to the data package.

    Parameters
    ----------
    slot : str
        One of :func:`slots`.
    file : path-like
        CSV file with exactly the columns of the slot.
    project : path-like
        The WebPlotDigitizer project (JSON or tar, version 4 or later): the calibration of the axes
        is read from it. Its JSON part is kept beside the table, so that anyone who has the figure
        can lay the points over it; the image is not kept.
    tool : str
        Name and version of the tool.
    uncertainty : mapping of str to float
        One number for each numeric column, in the unit of the column; 0 for exact ones.
    declare : mapping of str to str, optional
        What the slot wants to know about the figure, such as by what an axis is scaled.
    replace : bool, optional
        Replace data that are there already.
    folder : path-like, optional
        See :func:`tables`.

    Returns
    -------
    Table
        The table as it is now stored, with provenance ``digitized``.

    Raises
    ------
    DataError
        If the slot is unknown or filled, or the file or the project is not as it must be.
    InvalidInput
        If another argument is missing or wrong.

    Examples
    --------
    A misspelled slot is refused before any file is read:

    >>> from lissome import literature
    >>> literature.register("slinky-distances", "points.csv", project="project.json",
    ...                     tool="WebPlotDigitizer 5.2", uncertainty={"distance": 0.02})
    Traceback (most recent call last):
        ...
    lissome.errors.DataError: ...there is no slot 'slinky-distances'; did you mean 'slinky-distance'...
    """
    package = Descriptor(folder)
    if slot not in package.slots:
        raise DataError(
            f"{package.path}: there is no slot {slot!r}; {nearest(slot, package.slots)}"
        )
    if slot in package.resources and not replace:
        raise DataError(
            f"{package.path}: the slot '{slot}' is filled already; pass `replace` (--replace) to "
            "put other points in their place"
        )
    item = package.slots[slot]
    path = Path(file)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(
            f"{path}: expected a CSV file, found {error.strerror or error}; check the path"
        ) from error
    columns = parse_csv(path, raw, item["schema"])
    _digitized.check_points(path, item, columns)
    project_raw, axes = _digitized.read_axes(Path(project))
    kept = f"projects/{slot}.json"
    digitization = {
        "tool": _digitized.check_tool(tool),
        "axes": axes,
        "uncertainty": _digitized.check_uncertainty(item, uncertainty),
        "declared": _digitized.check_declarations(item, declare),
        "project": kept,
        "project_hash": digest(project_raw),
    }
    text = _canonical(raw)
    resource = {
        "name": slot,
        "type": "table",
        "path": f"{slot}.csv",
        "scheme": "file",
        "format": "csv",
        "mediatype": "text/csv",
        "encoding": "utf-8",
        "title": item["title"],
        "description": item["description"],
        "provenance": "digitized",
        "digitization": digitization,
        "sources": item["sources"],
        "licenses": package.content["licenses"],
        "hash": digest(text),
        "bytes": len(text),
        "schema": item["schema"],
    }
    write_atomically(package.folder / kept, project_raw)
    write_atomically(package.folder / f"{slot}.csv", text)
    others = [r for r in package.content["resources"] if r["name"] != slot]
    package.content["resources"] = [*others, resource]
    package.write()
    return load(slot, folder=package.folder)


def _canonical(raw: bytes) -> bytes:
    """Return a CSV file with plain line ends and without a byte order mark."""
    rows = csv.reader(io.StringIO(raw.decode("utf-8-sig"), newline=""))
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue().encode("utf-8")


def seal(names: Sequence[str] | None = None, folder: PathLike | None = None) -> tuple[str, ...]:
    """Store hash and size of tables that were changed on purpose.

    Parameters
    ----------
    names : sequence of str, optional
        Tables to seal; all by default.
    folder : path-like, optional
        See :func:`tables`.

    Returns
    -------
    tuple of str
        The tables whose hash has changed.

    Raises
    ------
    DataError
        If a table is unknown or does not obey its schema; nothing is sealed then.

    Examples
    --------
    Nothing is sealed unless all is well:

    >>> from lissome import literature
    >>> literature.seal(["claims", "clams"])
    Traceback (most recent call last):
        ...
    lissome.errors.DataError: ...there is no table 'clams'; did you mean 'claims'?
    """
    package = Descriptor(folder)
    changed = []
    for name in package.resources if names is None else names:
        if name not in package.resources:
            raise DataError(
                f"{package.path}: there is no table {name!r}; {nearest(name, package.resources)}"
            )
        resource = package.resources[name]
        if not resource.get("sealed", True):
            continue
        path = package.folder / resource["path"]
        try:
            raw = path.read_bytes()
        except OSError as error:
            raise DataError(
                f"{path}: expected the table '{name}', found {error.strerror or error}"
            ) from error
        parse_csv(path, raw, resource["schema"])
        if resource.get("hash") != digest(raw):
            changed.append(name)
        schema = resource.pop("schema")
        resource |= {"hash": digest(raw), "bytes": len(raw), "schema": schema}
    package.write()
    return tuple(changed)


def check(folder: PathLike | None = None) -> tuple[str, ...]:
    """Check every table, by the loader and by the frictionless library.

    Parameters
    ----------
    folder : path-like, optional
        See :func:`tables`.

    Returns
    -------
    tuple of str
        The names of the tables, all of them sound.

    Raises
    ------
    DataError
        With the first fault of every table that has one.

    Examples
    --------
    >>> from lissome import literature
    >>> literature.check() == literature.tables()
    True
    """
    import frictionless

    package = Descriptor(folder)
    faults = []
    for name in package.resources:
        try:
            load(name, folder=package.folder)
        except DataError as error:
            faults.append(str(error))
    report = frictionless.Package.from_descriptor(
        package.content, basepath=str(package.folder)
    ).validate()
    for problem in report.errors:
        faults.append(f"{package.path}: {problem.message}")
    for task in report.tasks:
        for problem in task.errors[:1]:
            faults.append(f"{package.folder.joinpath(str(task.place))}: {problem.message}")
    if faults:
        raise DataError("; ".join(faults))
    return tuple(package.resources)


def _sources(item: Mapping[str, Any]) -> tuple[Source, ...]:
    return tuple(
        Source(s["title"], s.get("path", ""), s.get("place", "")) for s in item.get("sources", [])
    )


def _pairs(texts: Sequence[str], option: str) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, separator, content = text.partition("=")
        if not separator:
            raise InvalidInput(f"option {option} has {text!r}; write name=value")
        pairs[name] = content
    return pairs


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InvalidInput(f"option --uncertainty has {name}={text!r}; give a number") from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line ``python -m lissome.literature``; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m lissome.literature", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--folder", help="folder with datapackage.json (default: the library's)")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("list", help="all tables and slots")
    commands.add_parser("check", help="check every table")
    commands.add_parser("describe", help="one table or slot in words").add_argument("name")
    sealing = commands.add_parser("seal", help="store hashes after a wanted change")
    sealing.add_argument("names", nargs="*")
    registering = commands.add_parser("register", help="validate and add digitized points")
    registering.add_argument("slot")
    registering.add_argument("file", help="CSV file with the points")
    registering.add_argument(
        "--project", required=True, help="WebPlotDigitizer project (JSON or tar)"
    )
    registering.add_argument("--tool", required=True, help="'WebPlotDigitizer 5.2'")
    registering.add_argument("--uncertainty", nargs="+", required=True, metavar="COLUMN=NUMBER")
    registering.add_argument("--declare", nargs="+", default=[], metavar="NAME=TEXT")
    registering.add_argument("--replace", action="store_true")
    given = parser.parse_args(arguments)
    try:
        if given.command == "list":
            package = Descriptor(given.folder)
            for provenance in PROVENANCES:
                for name, resource in package.resources.items():
                    if resource["provenance"] == provenance:
                        print(f"{provenance:10} {name:30} {resource['title']}")
            for name in awaited(given.folder):
                print(f"{'awaited':10} {name:30} {package.slots[name]['title']}")
        elif given.command == "describe":
            print(describe(given.name, given.folder))
        elif given.command == "check":
            print(f"{len(check(given.folder))} tables are sound")
        elif given.command == "seal":
            changed = seal(given.names or None, given.folder)
            print("sealed anew: " + (", ".join(changed) or "nothing had changed"))
        else:
            uncertainty = _pairs(given.uncertainty, "--uncertainty")
            table = register(
                given.slot,
                given.file,
                project=given.project,
                tool=given.tool,
                uncertainty={name: _number(name, text) for name, text in uncertainty.items()},
                declare=_pairs(given.declare, "--declare"),
                replace=given.replace,
                folder=given.folder,
            )
            print(f"registered {len(table)} points as '{table.name}'")
    except (DataError, InvalidInput, OSError) as error:  # the last: a folder that cannot be written
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
