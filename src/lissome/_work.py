"""What the result at a point of a sweep depends on: the keys of the cache of `sweeps`."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import importlib.metadata
import importlib.util
import platform
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from ._fingerprint import Digest, NoFingerprint, name_of
from .errors import InvalidInput

__all__ = ["keys"]

# Attributes of classes that say nothing of what their instances do.
_SILENT = frozenset(
    {
        "__abstractmethods__",
        "__annotations__",
        "__dataclass_fields__",
        "__dataclass_params__",
        "__dict__",
        "__doc__",
        "__firstlineno__",
        "__static_attributes__",
        "__weakref__",
        "_abc_impl",
    }
)
_WRITTEN_BY_DATACLASSES = frozenset(
    [
        "__init__",
        "__repr__",
        "__eq__",
        "__hash__",
        "__lt__",
        "__le__",
        "__gt__",
        "__ge__",
        "__setattr__",
        "__delattr__",
        "__replace__",
    ]
)
_DESCRIPTORS = (types.MemberDescriptorType, types.GetSetDescriptorType)


def _generated(kind: type, name: str, member: Any) -> bool:
    """Tell whether `dataclasses` wrote a method from the fields, which count by themselves."""
    if not dataclasses.is_dataclass(kind) or name not in _WRITTEN_BY_DATACLASSES:
        return False
    function = getattr(member, "__wrapped__", member)
    return member is None or (
        isinstance(function, types.FunctionType) and function.__code__.co_filename == "<string>"
    )


def keys(function: Callable[..., Any], points: list[dict[str, Any]]) -> list[str]:
    """Return for each point the digest of all that its result depends on."""
    digest = _WorkDigest()
    try:
        digest.add(_library_digest())
        digest.add(function)
    except NoFingerprint as reason:
        raise InvalidInput(
            f"argument `cache` is set, but it cannot be told when `function` changes: it depends "
            f"on {reason}. Make that inside the function from its arguments, import modules at "
            "the top, or pass cache=None"
        ) from None
    work = digest.hexdigest()
    found = []
    for point in points:
        digest = _WorkDigest()
        try:
            digest.add(point)
        except NoFingerprint as reason:
            raise InvalidInput(
                f"argument `cache` is set, but the value of {reason} in the point "
                f"{point} cannot be told by its content; use numbers, strings, arrays, or "
                "dataclasses of these, or pass cache=None"
            ) from None
        found.append(hashlib.sha256(f"{work}:{digest.hexdigest()}".encode()).hexdigest())
    return found


def _library_digest() -> str:
    """Digest of every source file of this library and of what it computes with."""
    hashed = hashlib.sha256()
    hashed.update(f"{sys.implementation.name} {platform.machine()}".encode())
    hashed.update(repr(sys.version_info[:2]).encode())
    for package in ("numpy", "scipy", "numba", "llvmlite"):
        hashed.update(f"{package} {importlib.metadata.version(package)}".encode())
    root = Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        with contextlib.suppress(FileNotFoundError):
            text = path.read_bytes()
            hashed.update(path.relative_to(root).as_posix().encode())
            hashed.update(hashlib.sha256(text).digest())
    return hashed.hexdigest()


@functools.cache
def _installed(root: str) -> str | None:
    """Return the version of an installed top-level module; None for the user's own modules."""
    if root in sys.stdlib_module_names:
        return platform.python_version()
    if root == __package__:
        return "its sources"  # they are in the key
    try:
        spec = importlib.util.find_spec(root)
    except (ImportError, ValueError):  # __main__ has none
        return None
    parts = Path(spec.origin).parts if spec is not None and spec.origin else ()
    if not {"site-packages", "dist-packages"} & set(parts):
        return None
    for distribution in importlib.metadata.packages_distributions().get(root, []):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            return importlib.metadata.version(distribution)
    return None


class _WorkDigest(Digest):
    """Digest of the function of a sweep and of its arguments: follows the user's own code."""

    def __init__(self, trusted: frozenset[str] = frozenset()) -> None:
        super().__init__(trusted)

    def knows(self, module: str) -> bool:
        root = module.partition(".")[0]
        version = _installed(root)
        if version is None:
            return False
        self.put("version", root, version)
        return True

    def kind(self, value: type) -> None:
        if self.knows(value.__module__):
            self.put("class", name_of(value))
        elif self.first_time(value):
            self.put("user's class", name_of(value))
            for base in value.__bases__:
                self.add(base)
            if dataclasses.is_dataclass(value):
                for member in dataclasses.fields(value):
                    self.put("field", member.name, str(member.init), str(member.kw_only))
                    for default in (member.default, member.default_factory):
                        if default is not dataclasses.MISSING:
                            self.add(default)
            for name, content in sorted(vars(value).items()):
                if name in _SILENT or isinstance(content, _DESCRIPTORS):
                    continue
                if _generated(value, name, content):
                    continue
                self.put("member", name)
                self.add(content)

    def other(self, value: Any) -> None:
        numba = sys.modules.get("numba")
        if isinstance(value, types.FunctionType):
            if self.first_time(value):
                self.function(value)
        elif isinstance(value, types.MethodType):
            self.put("method")
            self.add(value.__func__)
            self.add(value.__self__)
        elif isinstance(value, (staticmethod, classmethod)):
            self.put(type(value).__name__)
            self.add(value.__func__)
        elif isinstance(value, property):
            self.put("property")
            self.add((value.fget, value.fset, value.fdel))
        elif isinstance(value, functools.cached_property):
            self.put("cached property")
            self.add(value.func)
        elif isinstance(value, functools.partial):
            self.put("partial")
            self.add((value.func, value.args, value.keywords))
        elif isinstance(value, (dict, types.MappingProxyType)):
            self.put("mapping", str(len(value)))
            for key, item in sorted((self._separately(key), item) for key, item in value.items()):
                self.put("key", key)
                self.add(item)
        elif isinstance(value, set):
            self.put("set", *sorted(self._separately(item) for item in value))
        elif isinstance(value, range):
            self.put("range", repr(value))
        elif isinstance(value, Path):
            self.put("path", str(value))
        elif dataclasses.is_dataclass(value):
            if self.first_time(value):
                self.put("dataclass")
                self.add(type(value))
                for member in dataclasses.fields(value):
                    self.put("field", member.name)
                    self.add(getattr(value, member.name))
        elif isinstance(value, (pd.DataFrame, pd.Series)):
            self.put("pandas", type(value).__name__)
            frame = value.reset_index() if isinstance(value, pd.DataFrame) else value.to_frame()
            for name in frame.columns:
                self.add(name)
                values = frame[name].to_numpy()
                self.add(values.tolist() if values.dtype == object else values)
        elif numba is not None and isinstance(value, numba.core.dispatcher.Dispatcher):
            from ._compile import fingerprint

            found = fingerprint(value)
            if found is None:
                raise NoFingerprint(f"the compiled function {value.__name__}")
            self.put("compiled", found)
        elif callable(value) and callable(getattr(value, "__wrapped__", None)):
            self.put("wrapper", type(value).__name__)
            self.add(value.__wrapped__)
        else:
            super().other(value)
