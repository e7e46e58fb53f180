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

from ._fingerprint import Digest, NoFingerprint, name_of
from ._sources import Witness, code_witness, library_digest
from .errors import InvalidInput

__all__ = ["Work"]

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


class Work:
    """The function of a sweep, as seen by the cache and by other processes.

    Attributes
    ----------
    witnesses : tuple
        The functions that worker processes import for themselves; see `differing_function`.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        digest = _WorkDigest()
        self._digest: str | None = None
        self._reason = ""
        try:
            digest.add(library_digest())
            digest.add(function)
            self._digest = digest.hexdigest()
        except NoFingerprint as reason:
            self._reason = str(reason)
        self.witnesses: tuple[Witness, ...] = tuple(digest.witnesses)

    def keys(self, points: list[dict[str, Any]]) -> list[str]:
        """Return for each point the digest of all that its result depends on."""
        if self._digest is None:
            raise InvalidInput(
                "argument `cache` is set, but it cannot be told when `function` changes: it "
                f"depends on {self._reason}. Make that inside the function from its arguments, "
                "import modules at the top, or pass cache=None"
            )
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
            found.append(
                hashlib.sha256(f"{self._digest}:{digest.hexdigest()}".encode()).hexdigest()
            )
        return found


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
        self.witnesses: list[Witness] = []

    def function(self, function: Any) -> None:
        witness = code_witness(function)
        if witness is not None:
            self.witnesses.append(witness)
        super().function(function)

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
        numba, pandas = sys.modules.get("numba"), sys.modules.get("pandas")
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
        elif pandas is not None and isinstance(value, (pandas.DataFrame, pandas.Series)):
            self.put("pandas", type(value).__name__)
            frame = value.reset_index() if isinstance(value, pandas.DataFrame) else value.to_frame()
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
