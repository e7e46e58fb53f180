"""Does everybody run the same code? Guards of the cache and of the workers of a sweep.

A process runs the sources as they were when it imported them. If a file is edited afterwards, or a
module reloaded, then keys that are made from the files, or workers that import them later, belong
to other code than the one at hand, and results would silently be mixed.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.metadata
import platform
import sys
import types
from pathlib import Path
from typing import Any

from ._fingerprint import Digest

__all__ = [
    "Witness",
    "code_witness",
    "differing_function",
    "differing_source",
    "library_changed",
    "library_digest",
    "library_sources",
]

# Module, qualified name, and the digest of the code.
Witness = tuple[str, str, str]

_ROOT = Path(__file__).parent


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return "missing"


# The files as they were when this process imported the first part of the library that needs them.
_stamps = {path: _stamp(path) for path in _ROOT.rglob("*.py")}
_at_import = {path.relative_to(_ROOT).as_posix(): _digest(path) for path in sorted(_stamps)}


@functools.cache
def library_sources() -> dict[str, str]:
    """Return the digest of every source file of the library, and under "" that of the versions."""
    parts = [sys.implementation.name, platform.machine(), *map(str, sys.version_info[:2])]
    for package in ("numpy", "scipy", "numba", "llvmlite"):
        parts += [package, importlib.metadata.version(package)]
    return {"": hashlib.sha256("\n".join(parts).encode()).hexdigest(), **_at_import}


def library_digest() -> str:
    """Return the digest of all of the library's sources and of the versions that it runs on."""
    return hashlib.sha256(repr(sorted(library_sources().items())).encode()).hexdigest()


def _loaded() -> set[str]:
    """Return the source files of the library that this process has imported."""
    package = __package__ or "lissome"
    found = set()
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and (name == package or name.startswith(f"{package}.")):
            found.add(Path(file).relative_to(_ROOT).as_posix())
    return found


def library_changed() -> bool:
    """Tell whether a file that this process has imported differs from what its keys say."""
    for name in _loaded():
        path = _ROOT / name
        stamp = _stamp(path)
        if stamp != _stamps.get(path):
            if _digest(path) != _at_import.get(name):
                return True
            _stamps[path] = stamp  # touched, not edited
    return False


def differing_source(theirs: dict[str, str]) -> str | None:
    """Return a source file that is imported here and that another process has otherwise."""
    ours = library_sources()
    for name in sorted(_loaded() | {""}):
        if ours.get(name) != theirs.get(name):
            return f"{__package__}/{name}" if name else "a version of Python or of a package"
    return None


def _found(module: Any, qualname: str) -> Any:
    for part in qualname.split("."):
        module = getattr(module, part, None)
    return module


def code_witness(function: types.FunctionType) -> Witness | None:
    """Return the witness of a function that other processes import by name, else None."""
    name, qualname = function.__module__, function.__qualname__
    if name == "__main__" or _found(sys.modules.get(name), qualname) is not function:
        return None
    return name, qualname, _code_digest(function)


def _code_digest(function: types.FunctionType) -> str:
    digest = Digest(frozenset())
    digest.code(function.__code__)
    return digest.hexdigest()


_agreed: set[Witness] = set()


def differing_function(witnesses: tuple[Witness, ...]) -> str | None:
    """Return the name of a function that is other code here than in the process that asks."""
    for witness in witnesses:
        if witness in _agreed:
            continue
        name, qualname, digest = witness
        try:
            function = _found(importlib.import_module(name), qualname)
        except ImportError:
            continue  # the call itself will say so
        if not isinstance(function, types.FunctionType) or _code_digest(function) != digest:
            return f"{name}.{qualname}"
        _agreed.add(witness)
    return None
