"""Files that survive an interruption: arrays and JSON in one ``.npz``, replaced atomically.

No file holds a pickle. A file is written beside its final place and then renamed, so that whoever
is killed leaves either the old file or the new one.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DataError, InvalidInput

_META = "__meta__"
_NAMES = "__names__"

#: What numpy and zipfile raise for a damaged file: a bit may ask for a password or a new version.
UNREADABLE = (
    EOFError,
    KeyError,
    NotImplementedError,
    OSError,
    RuntimeError,
    TypeError,  # one array where many should be
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)


def write(path: str | os.PathLike[str], meta: dict[str, Any], arrays: dict[str, Any]) -> None:
    """Write `arrays` and `meta` (plain JSON values) to `path`, all or nothing."""
    path = Path(path)
    if not path.parent.is_dir():
        raise InvalidInput(
            f"the folder of {path} does not exist; create it, or name a file in another folder"
        )
    partial = path.with_name(path.name + ".partial")
    try:
        with open(partial, "wb") as file:
            # np.savez wants keywords; its type stubs take **arrays for `allow_pickle`.
            text = json.dumps({**meta, _NAMES: sorted(arrays)})
            np.savez(file, **{_META: np.array(text)}, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except BaseException:  # a full disk is not filled further by what nobody reads
        partial.unlink(missing_ok=True)
        raise


def read(path: str | os.PathLike[str], kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return what :func:`write` wrote, if its ``meta["kind"]`` is `kind`.

    Raises
    ------
    DataError
        If the file is damaged or is of another kind.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        meta = json.loads(str(arrays.pop(_META)))
    except FileNotFoundError:
        raise
    except UNREADABLE as error:
        raise DataError(f"the file {path} is damaged or is not a saved {kind}: {error}") from error
    if not isinstance(meta, dict) or meta.get("kind") != kind:
        found = meta.get("kind") if isinstance(meta, dict) else type(meta).__name__
        raise DataError(f"the file {path} holds a {found}; a {kind} was asked for")
    if meta.pop(_NAMES, None) != sorted(arrays):  # the index of the file is not part of a checksum
        raise DataError(
            f"the file {path} is damaged: it does not hold the arrays that were written"
        )
    return meta, arrays


def pack_values(prefix: str, values: Sequence[Any]) -> dict[str, NDArray[Any]]:
    """Stack values of one kind: arrays, numbers, or dataclasses of arrays and numbers."""
    if not values:
        return {}
    first = values[0]
    if not dataclasses.is_dataclass(first) or isinstance(first, type):
        return {prefix: _stack(prefix, values)}
    return {
        f"{prefix}.{item.name}": _stack(
            f"{prefix}.{item.name}", [getattr(value, item.name) for value in values]
        )
        for item in dataclasses.fields(first)
        if item.init
    }


def digest(value: Any) -> str:
    """Return the digest of a value that :func:`pack_values` can pack."""
    found = hashlib.sha256()
    for name, array in pack_values("", [value]).items():
        found.update(f"{name}:{array.dtype.str}:{array.shape}:".encode() + array.tobytes())
    return found.hexdigest()


def unpack_values(prefix: str, arrays: dict[str, NDArray[Any]], like: Any, count: int) -> list[Any]:
    """Return `count` values that :func:`pack_values` stacked; `like` is a value of their kind."""
    if count == 0:
        return []
    if not dataclasses.is_dataclass(like) or isinstance(like, type):
        stack = _column(prefix, arrays, count)
        return [_as(like, stack[i]) for i in range(count)]
    columns = {
        item.name: _column(f"{prefix}.{item.name}", arrays, count)
        for item in dataclasses.fields(like)
        if item.init
    }
    try:
        return [
            type(like)(**{k: _as(getattr(like, k), v[i]) for k, v in columns.items()})
            for i in range(count)
        ]
    except (TypeError, ValueError) as error:
        raise DataError(f"the saved fields do not make a {type(like).__name__}: {error}") from error


def _as(like: Any, value: Any) -> Any:
    if isinstance(like, np.ndarray):
        return np.array(value)
    return type(like)(value.item() if isinstance(value, (np.ndarray, np.generic)) else value)


def _column(name: str, arrays: dict[str, NDArray[Any]], count: int) -> NDArray[Any]:
    if name not in arrays:
        raise DataError(f"the saved data lack {name!r}: another version or structure wrote them")
    if arrays[name].shape[:1] != (count,):
        raise DataError(
            f"the saved data {name!r} have shape {arrays[name].shape}; there must be {count} entries"
        )
    return arrays[name]


def _stack(name: str, values: Sequence[Any]) -> NDArray[Any]:
    try:
        stack = np.stack([np.asarray(value) for value in values])
    except ValueError as error:
        raise InvalidInput(f"{name} cannot be saved: its shape changes ({error})") from error
    if stack.dtype.kind not in "biufcU":
        raise InvalidInput(
            f"{name} cannot be saved: it is of type {stack.dtype}; files hold numbers and strings, "
            "so keep what changes in arrays or dataclasses of arrays"
        )
    return stack
