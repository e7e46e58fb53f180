"""Digests of Python values by content, the keys of the library's caches.

A :class:`Digest` of a function covers all that its result depends on, as far as it can be told:
its code (not its place in the file, nor comments), its defaults, its closure, and the values of the
globals that it reads, with attributes of modules followed. Where something cannot be told,
:class:`NoFingerprint` is raised and the caller must not cache: a wrong guess would bring an old
result back.
"""

from __future__ import annotations

import dis
import enum
import hashlib
import itertools
import sys
import types
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

__all__ = ["Digest", "NoFingerprint"]

# Subtypes of int, str and the like hash by their plain value; these kinds are exact.
_PLAIN = (type(None), type(Ellipsis), bool, int, str)


class NoFingerprint(Exception):
    """A value cannot be told by its content; the message says what it is."""


class Digest:
    """Hash of the content of Python values: equal content, equal hash, in any process.

    Parameters
    ----------
    trusted : set of str
        Top-level modules whose content is known by other means (their versions, as a rule):
        what they define counts by its name.
    """

    def __init__(self, trusted: frozenset[str]) -> None:
        self._trusted = trusted
        self._hash = hashlib.sha256()
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []  # ids are only unique among living objects

    def hexdigest(self) -> str:
        return self._hash.hexdigest()

    def put(self, tag: str, *parts: str | bytes) -> None:
        """Add strings, each with its length, so that no two sequences collide."""
        for part in (tag, *parts):
            data = part if isinstance(part, bytes) else part.encode()
            self._hash.update(b"%d:" % len(data))
            self._hash.update(data)

    def first_time(self, value: Any) -> bool:
        """Tell whether `value` is new; if it is not, refer to the first time (recursion ends)."""
        if id(value) in self._seen:
            self.put("again", str(self._seen[id(value)]))
            return False
        self._seen[id(value)] = len(self._seen)
        self._alive.append(value)
        return True

    def add(self, value: Any) -> None:
        """Add a value by its content, or raise :class:`NoFingerprint`."""
        kind = type(value)
        if kind in _PLAIN:
            self.put(kind.__name__, repr(value))
        elif kind is bytes:
            self.put("bytes", value)
        elif kind is float:
            self.put("float", value.hex())
        elif kind is complex:
            self.put("complex", value.real.hex(), value.imag.hex())
        elif isinstance(value, enum.Enum):
            self.put("enum", name_of(kind), value.name)
            self.add(value.value)
        elif isinstance(value, tuple) or kind is list:
            self.put("sequence", name_of(kind), str(len(value)), *getattr(value, "_fields", ()))
            for item in value:
                self.add(item)
        elif kind is frozenset:
            self.put("set", *sorted(self._separately(item) for item in value))
        elif kind is slice:
            self.put("slice")
            self.add((value.start, value.stop, value.step))
        elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
            layout = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
            self.put("array", str(value.dtype.descr), str(value.shape), layout)
            self.put("data", value.tobytes())
        elif isinstance(value, np.generic) and not value.dtype.hasobject:
            self.put("scalar", str(value.dtype.descr), value.tobytes())
        elif isinstance(value, np.dtype):
            self.put("dtype", str(value.descr), str(value.alignment), str(value.isalignedstruct))
        elif isinstance(value, types.CodeType):
            self.code(value)
        elif isinstance(value, types.ModuleType):
            self.module(value)
        elif isinstance(value, np.ufunc):
            name = value.__name__
            if getattr(np, name, None) is not value:
                raise NoFingerprint(f"the universal function {name}")
            self.put("ufunc", name)
        elif isinstance(value, type):
            self.kind(value)
        elif self.is_trusted(value):
            self.put("library", name_of(value))
        else:
            self.other(value)

    def other(self, value: Any) -> None:
        """Add a value of a kind that :meth:`add` does not know; derived classes know more."""
        raise NoFingerprint(f"{value!r} of type {type(value).__qualname__}")

    def module(self, value: types.ModuleType) -> None:
        """Add a module that is used as a value."""
        if not self.knows(value.__name__):
            raise NoFingerprint(f"the module {value.__name__}, used as a value")
        self.put("module", value.__name__)

    def kind(self, value: type) -> None:
        """Add a class."""
        if issubclass(value, BaseException) or self.knows(value.__module__):
            self.put("class", name_of(value))
        elif issubclass(value, enum.Enum):
            self.put("enumeration", name_of(value))
            for member in value:
                self.put("member", member.name)
                self.add(member.value)
        elif issubclass(value, tuple) and hasattr(value, "_fields"):
            self.put("namedtuple", name_of(value), *value._fields)
        else:
            self.other_kind(value)

    def other_kind(self, value: type) -> None:
        """Add a class that :meth:`kind` does not know."""
        raise NoFingerprint(f"the class {name_of(value)}")

    def knows(self, module: str) -> bool:
        """Tell whether a module is trusted."""
        return module.partition(".")[0] in self._trusted

    def is_trusted(self, value: Any) -> bool:
        """Tell whether `value` is a callable that a trusted module has under its own name."""
        module = getattr(value, "__module__", None)
        path = getattr(value, "__qualname__", None) or getattr(value, "__name__", None)
        if not callable(value) or not isinstance(module, str) or not isinstance(path, str):
            return False
        found: Any = sys.modules.get(module) if self.knows(module) else None
        for part in path.split("."):
            found = getattr(found, part, None)
        return found is value or (found is not None and found == value)

    def _separately(self, value: Any) -> str:
        digest = type(self)(self._trusted)
        digest.add(value)
        return digest.hexdigest()

    def code(self, code: types.CodeType) -> None:
        """Add byte code with its constants; not the file, the lines, and the comments."""
        self.put("code", _facts(code).digest)

    def function(self, function: Any) -> None:
        """Add a Python function: code, defaults, closure, and the globals that it reads."""
        self.put("function", function.__module__ or "", function.__qualname__)
        code = function.__code__
        self.code(code)
        self.add(function.__defaults__)
        for name, value in sorted((function.__kwdefaults__ or {}).items()):
            self.put("default", name)
            self.add(value)
        for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            self.put("cell", name)
            try:
                content = cell.cell_contents
            except ValueError:
                self.put("empty")
                continue
            self.add(content)
        facts = _facts(code)
        for module in facts.imports:
            if not self.knows(module):
                raise NoFingerprint(
                    f"the import of {module or 'a relative module'} inside {function.__qualname__}"
                )
            self.put("import", module)
        for path in facts.globals:
            self._global(function.__globals__, path)

    def _global(self, namespace: dict[str, Any], path: tuple[str, ...]) -> None:
        self.put("global", *path)
        if path[0] not in namespace:
            builtins = namespace.get("__builtins__", {})
            known = builtins if isinstance(builtins, dict) else vars(builtins)
            self.put("builtin" if path[0] in known else "undefined")
            return
        value = namespace[path[0]]
        for attribute in path[1:]:
            # Only modules are followed; attributes of anything else belong to that value.
            if not isinstance(value, types.ModuleType) or self.knows(value.__name__):
                break
            value = getattr(value, attribute, None)
        self.add(value)


def name_of(value: Any) -> str:
    """Return where `value`, a class or a function, is defined."""
    return f"{value.__module__}:{getattr(value, '__qualname__', value.__name__)}"


class _Facts(NamedTuple):
    """What a code object says by itself."""

    digest: str
    globals: list[tuple[str, ...]]
    imports: list[str]


_known: dict[int, tuple[types.CodeType, _Facts]] = {}  # the code is kept, so that its id is


def _facts(code: types.CodeType) -> _Facts:
    known = _known.get(id(code))
    if known is not None:
        return known[1]
    digest = Digest(frozenset())
    digest.put("code", code.co_name, code.co_code, getattr(code, "co_exceptiontable", b""))
    digest.add((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
    digest.add((code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags))
    for constant in code.co_consts:
        digest.add(constant)
    facts = _Facts(
        digest.hexdigest(), sorted(set(_global_paths(code))), sorted(set(_imports(code)))
    )
    _known[id(code)] = code, facts
    return facts


def _instructions(code: types.CodeType) -> list[dis.Instruction]:
    silent = ("CACHE", "NOP", "EXTENDED_ARG")
    return [i for i in dis.get_instructions(code) if i.opname not in silent]


def _global_paths(code: types.CodeType) -> Iterator[tuple[str, ...]]:
    """Yield the globals that `code` reads, with the chain of attributes taken right after each."""
    instructions = _instructions(code)
    for position, instruction in enumerate(instructions):
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"):
            chain = itertools.takewhile(
                lambda i: i.opname in ("LOAD_ATTR", "LOAD_METHOD"), instructions[position + 1 :]
            )
            yield (instruction.argval, *(i.argval for i in chain))
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _global_paths(constant)


def _imports(code: types.CodeType) -> Iterator[str]:
    """Yield the modules that `code` imports when it runs; "" for a relative import."""
    instructions = _instructions(code)
    for position, instruction in enumerate(instructions):
        if instruction.opname == "IMPORT_NAME":
            level = instructions[position - 2].argval  # pushed before the list of names
            yield instruction.argval if level == 0 else ""
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _imports(constant)
