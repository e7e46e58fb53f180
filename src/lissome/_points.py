"""What runs at one point of a sweep, and how its result is stored: the worker's side of `sweeps`.

Kept apart so that a worker process imports little before the function itself.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import platform
import secrets
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ._sources import Witness, differing_function, differing_source
from .errors import InvalidInput

__all__ = [
    "Asker",
    "DamagedEntry",
    "Failure",
    "Result",
    "ResultStore",
    "Stale",
    "die_with",
    "one_thread",
    "run_point",
    "this_process",
]

_FORMAT = 1
_STORABLE = "biufcUMm"  # kinds of numpy types that a .npz file holds without pickle


@dataclass(frozen=True)
class Result:
    """What a function returned at one point, in canonical types.

    Attributes
    ----------
    kind : {"scalar", "mapping", "table"}
        What the function returned.
    columns : dict
        Name -> Python scalar or array; for a table, name -> array of shape (rows,).
    """

    kind: str
    columns: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Failure:
    """An exception that a function raised at one point, in a form that crosses processes."""

    summary: str
    trace: str
    exception: BaseException | None


@dataclass(frozen=True)
class Stale:
    """A worker process has other code than the process that asks it."""

    name: str


@dataclass(frozen=True)
class Asker:
    """The process that asks for points, and the code that it has."""

    process: tuple[str, int]
    sources: dict[str, str]
    witnesses: tuple[Witness, ...]


def this_process() -> tuple[str, int]:
    """Return what tells this process from all others, also from those of another machine."""
    return platform.node(), os.getpid()


def die_with(parent: int) -> None:
    """Let this worker end when the process that started it is gone, even in the middle of a point.

    Nobody would take the result, and whoever killed that process wants its processors back.
    """
    if not hasattr(os, "fork"):  # elsewhere a process never learns that its parent is gone
        return

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="die-with-parent").start()


def run_point(
    function: Callable[..., Any], point: Mapping[str, Any], asker: Asker
) -> Result | Failure | Stale:
    """Call `function` at `point`; return what it returns, or how it failed.

    In another process than the asker's the code is compared first, and the BLAS libraries are
    limited to one thread: the executor is the only source of parallelism, and sums have one order.
    """
    elsewhere = this_process() != asker.process
    if elsewhere:
        name = differing_function(asker.witnesses)
        if name is not None:
            return Stale(name)
        _limit_threads()
    outcome = _call(function, point)
    if elsewhere:
        name = differing_source(asker.sources)  # now that the function has imported what it needs
        if name is not None:
            return Stale(name)
    return outcome


def _call(function: Callable[..., Any], point: Mapping[str, Any]) -> Result | Failure:
    try:
        return canonical(function(**point), point)
    except Exception as error:
        trace = "".join(traceback.format_exception(error))
        return Failure(f"{type(error).__qualname__}: {error}", trace, _portable(error))


_modules_seen = 0


def _limit_threads() -> None:
    global _modules_seen
    if len(sys.modules) != _modules_seen:  # a module may have brought its own BLAS along
        one_thread()
        _modules_seen = len(sys.modules)


def one_thread() -> Any:
    """Limit the BLAS libraries of this process to one thread; as a context, until its end.

    A limit reaches only what is loaded, and scipy brings a library of its own: a function that
    imports it late would sum in another order at its first point.
    """
    import scipy.linalg
    import threadpoolctl

    assert scipy.linalg is not None  # it is the import that counts
    return threadpoolctl.threadpool_limits(limits=1)


def _portable(error: Exception) -> Exception | None:
    """Return `error` if it survives pickling, else None."""
    try:
        copy = pickle.loads(pickle.dumps(error))
    except Exception:
        return None
    return error if type(copy) is type(error) else None


def canonical(returned: Any, point: Mapping[str, Any]) -> Result:
    """Bring what a function returned into the form in which it is tabulated and stored."""
    pandas = sys.modules.get("pandas")  # whoever returns a frame has imported it
    if pandas is not None and isinstance(returned, pandas.DataFrame):
        named = [name for name in returned.index.names if name is not None]
        frame = returned.reset_index() if named else returned
        result = Result("table", {name: _column(name, frame[name]) for name in frame.columns})
    elif isinstance(returned, Mapping):
        columns = {name: _entry(f"[{name!r}]", value) for name, value in returned.items()}
        result = Result("mapping", columns)
    else:
        value = _entry("", returned)
        if isinstance(value, np.ndarray):
            raise InvalidInput(
                f"the function returned an array of shape {value.shape}; "
                "return a mapping that names it, such as {'shape': array}"
            )
        result = Result("scalar", {"value": value})
    for name in result.columns:
        if not isinstance(name, str) or not name:
            raise InvalidInput(f"the function returned a column named {name!r}; names are strings")
        if name in point or name == "error":
            raise InvalidInput(
                f"the function returned a column `{name}`, which is also "
                f"{'a parameter' if name in point else 'the column of errors'}; rename it"
            )
    return result


def _entry(place: str, value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.ndim:
        if value.dtype.kind not in _STORABLE or value.dtype.itemsize == 0:
            raise InvalidInput(
                f"the function returned{place} an array of type {value.dtype}; "
                "return arrays of numbers, booleans, strings or times"
            )
        return value
    item = value[()] if isinstance(value, np.ndarray) else value
    if isinstance(item, np.generic) and item.dtype.kind in "biufcU" and item.dtype.itemsize != 0:
        plain = item.item()
        if isinstance(plain, np.generic):  # long doubles have no Python type
            raise InvalidInput(f"the function returned{place} {item!r}; convert it to float")
        item = plain
    if item is None or type(item) in (bool, int, float, complex, str):
        return item
    raise InvalidInput(
        f"the function returned{place} {_short(item)} of type {type(item).__name__}; return a "
        "scalar, a mapping of names to scalars and numpy arrays, or a pandas.DataFrame"
    )


def _column(name: Any, series: Any) -> Any:
    values = series.to_numpy()
    if values.dtype == object and len(values):
        if not all(isinstance(value, str) for value in values):
            raise InvalidInput(
                f"column `{name}` of the returned table mixes types or lacks values; "
                "give it one numpy type or strings"
            )
        return values.astype(str)
    if values.dtype == object:
        return values.astype(str)
    return _entry(f"[{name!r}]", values)


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


# ---------------------------------------------------------------------------------------------
# Files


class DamagedEntry(Exception):
    """A stored result is not what was written."""


class ResultStore:
    """A folder of results: for each point a JSON file, and beside it an .npz file for arrays.

    The JSON file is written last, in one step, and holds digests of itself and of the arrays.
    """

    def __init__(self, folder: Path, label: str) -> None:
        self.folder = folder
        self._label = "".join(c if c.isalnum() else "-" for c in label)[-60:].strip("-")

    def path(self, key: str) -> Path:
        """Return the JSON file of a key."""
        return self.folder / f"{self._label}-{key[:40]}.json"

    def read(self, key: str) -> Result | None:
        """Return the stored result, None if there is none, or raise :class:`DamagedEntry`."""
        path = self.path(key)
        try:
            text = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DamagedEntry(f"{path}: {error}") from error
        try:
            outer = json.loads(text)
            body = outer["entry"]
            if outer["sha256"] != hashlib.sha256(_dump(body)).hexdigest():
                raise DamagedEntry(f"{path}: its content does not match its digest")
            if body["format"] != _FORMAT or body["key"] != key:
                raise DamagedEntry(f"{path}: it belongs to another point or format")
            arrays: dict[str, Any] = {}
            if body["arrays"] is not None:
                data = path.with_suffix(".npz").read_bytes()
                if hashlib.sha256(data).hexdigest() != body["arrays"]:
                    raise DamagedEntry(f"{path.with_suffix('.npz')}: not the arrays of its entry")
                with np.load(io.BytesIO(data), allow_pickle=False) as loaded:
                    arrays = {name: loaded[name] for name in loaded.files}
            columns = {
                name: arrays[_member(place)] if encoded == "array" else _decode(encoded)
                for place, (name, encoded) in enumerate(body["columns"])
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError) as error:
            raise DamagedEntry(f"{path}: {error!r}") from error
        return Result(body["kind"], columns)

    def write(self, key: str, function: str, point: Mapping[str, Any], result: Result) -> None:
        """Store a result; an interruption leaves either all of it or nothing that is read."""
        path = self.path(key)
        columns: list[list[Any]] = []
        arrays: dict[str, Any] = {}
        for place, (name, value) in enumerate(result.columns.items()):
            if isinstance(value, np.ndarray):
                arrays[_member(place)] = value
                columns.append([name, "array"])
            else:
                columns.append([name, _encode(value)])
        digest = None
        if arrays:
            file = io.BytesIO()
            np.savez(file, allow_pickle=False, **arrays)
            data = file.getvalue()
            digest = hashlib.sha256(data).hexdigest()
            _write(path.with_suffix(".npz"), data)
        body = {
            "format": _FORMAT,
            "key": key,
            "function": function,
            "point": {name: _short(value) for name, value in point.items()},  # for human readers
            "kind": result.kind,
            "columns": columns,
            "arrays": digest,
        }
        outer = {"sha256": hashlib.sha256(_dump(body)).hexdigest(), "entry": body}
        _write(path, json.dumps(outer, indent=1, ensure_ascii=True).encode())


def _member(place: int) -> str:
    return f"column{place}"  # names of columns may be no names of files


def _dump(body: Any) -> bytes:
    return json.dumps(body, sort_keys=True, ensure_ascii=True, separators=(",", ":")).encode()


def _write(path: Path, data: bytes) -> None:
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}.tmp")
    try:
        temporary.write_bytes(data)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _encode(value: Any) -> Any:
    """Encode a scalar for JSON so that it comes back with its type and every bit."""
    if isinstance(value, float) and not np.isfinite(value):
        return {"float": value.hex()}
    if isinstance(value, complex):
        return {"complex": [value.real.hex(), value.imag.hex()]}
    if isinstance(value, str):
        return {"str": value}
    return value  # the shortest decimal of a finite float is exact


def _decode(value: Any) -> Any:
    if isinstance(value, dict):
        (kind, content), *more = value.items()
        if more:
            raise ValueError(f"unknown encoding {value!r}")
        if kind == "float":
            return float.fromhex(content)
        if kind == "complex":
            return complex(float.fromhex(content[0]), float.fromhex(content[1]))
        if kind == "str" and isinstance(content, str):
            return content
        raise ValueError(f"unknown encoding {value!r}")
    if value is None or isinstance(value, (bool, int, float)):
        return value
    raise ValueError(f"unknown encoding {value!r}")
