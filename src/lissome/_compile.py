r"""Compilation of numerical kernels by numba, with an on-disk cache that is never stale.

Use :func:`jit` in place of ``numba.njit``::

    from lissome._compile import jit

    @jit                       # or @jit(fastmath=..., inline=...), @jit("float64(float64)")
    def kernel(x): ...

Why not ``numba.njit(cache=True)``: its key is the text of the file that holds the function, so that
an edited callee in *another* file, or a changed global constant, goes unnoticed and the old machine
code runs. Here an entry is found by a fingerprint of everything that the machine code depends on:

* the function's own code, its options and its closure, and the values of the globals that it reads;
* all of this again for each compiled function that it calls, wherever that is defined
  (attributes of modules, as in ``kernels.step(x)``, are followed);
* the types of the arguments; a compiled function passed as an argument counts with its fingerprint;
* every source file of the package that extends numba itself (``numba.extending``), this file, the
  versions of Python, numpy, numba and llvmlite, numba's settings, and the processor.

What cannot be fingerprinted is compiled in each process and not stored (the reason goes to the
logger ``lissome._compile`` at level DEBUG). Functions of notebooks and tests are cached alike.

What hits the cache in a second process (tested in ``tests/test_compile.py``):

=======================================================================  ===========  ==========
kind of function                                                         numba alone  this module
=======================================================================  ===========  ==========
plain jitted function                                                    yes          yes
calling jitted functions of other modules                                stale        yes
explicit signature with a first-class function, ``types.FunctionType``   yes          yes
made by a factory, closed over numbers                                   yes          yes
made by a factory, closed over jitted functions                          no           yes
jitted function passed as an argument (specialized, can be inlined)      no           yes
=======================================================================  ===========  ==========

So a solver that takes a kernel as an argument needs no ``FunctionType`` signature: pass the jitted
function itself. Each kernel gives one specialization, whose call to the kernel is direct; a
``FunctionType`` is compiled once for all kernels but calls through a pointer.

The folder is ``$LISSOME_CACHE``, else ``$NUMBA_CACHE_DIR/lissome``, else the user's cache folder,
else ``__pycache__`` of the package. If none can be written there is one
:class:`~lissome.errors.CacheWarning`, and functions are compiled in each process. A damaged entry
is recompiled. Entries are written atomically, and the least recently used ones are removed when the
folder exceeds its budget.

Importing this module imports numba; ``import lissome`` does not.
"""

from __future__ import annotations

import contextlib
import dis
import enum
import hashlib
import io
import itertools
import logging
import os
import pickle
import re
import secrets
import sys
import tempfile
import types as pytypes
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite  # type: ignore[import-untyped]
import numba
import numpy as np
import platformdirs
from numba.core import compiler, sigutils, typeinfer
from numba.core.caching import _Cache
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher
from numba.core.serialize import NumbaPickler

from .errors import CacheWarning

# numba makes these names at run time, out of sight of a type checker.
types: Any = numba.core.types
numba_config: Any = numba.core.config
_CPUDispatcher: Any = CPUDispatcher

__all__ = ["fingerprint", "jit", "make_jit"]

_log = logging.getLogger(__name__)

_MAGIC = b"lissome compiled 1\n"
_BUDGET = 512 * 2**20  # bytes; above it the least recently used entries go, down to half of it
_EXTENDS_NUMBA = re.compile(
    rb"\b(extending|overload\w*|intrinsic|jitclass|structref|register_\w+)\b"
)
# The code of these does not change without a change of the versions in the stamp.
_TRUSTED = frozenset(sys.stdlib_module_names) | {"numpy", "numba", "llvmlite"}
_SETTINGS = (
    "BOUNDSCHECK",
    "CPU_FEATURES",
    "CPU_NAME",
    "DEBUGINFO_DEFAULT",
    "DEBUG_NRT",
    "DISABLE_INTEL_SVML",
    "ENABLE_AVX",
    "EXTEND_VARIABLE_LIFETIMES",
    "LLVM_REFPRUNE_FLAGS",
    "LLVM_REFPRUNE_PASS",
    "LOOP_VECTORIZE",
    "OPT",
    "SLP_VECTORIZE",
    "USING_SVML",
)


# ---------------------------------------------------------------------------------------------
# Fingerprints


class _NoFingerprint(Exception):
    """The value of something that compiled code depends on cannot be told from its text."""


class _Digest:
    """Hash of the content of Python objects: equal content, equal hash, in any process."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []  # ids are only unique among living objects

    def hexdigest(self) -> str:
        return self._hash.hexdigest()

    def _put(self, tag: str, *parts: str | bytes) -> None:
        for part in (tag, *parts):
            data = part if isinstance(part, bytes) else part.encode()
            self._hash.update(b"%d:" % len(data))
            self._hash.update(data)

    def _first_time(self, value: Any) -> bool:
        """Tell whether `value` is new; if it is not, refer to the first time (recursion ends)."""
        if id(value) in self._seen:
            self._put("again", str(self._seen[id(value)]))
            return False
        self._seen[id(value)] = len(self._seen)
        self._alive.append(value)
        return True

    def add(self, value: Any) -> None:
        kind = type(value)
        if value is None or value is Ellipsis or kind in (bool, int, str):
            self._put(kind.__name__, repr(value))
        elif kind is bytes:
            self._put("bytes", value)
        elif kind is float:
            self._put("float", value.hex())
        elif kind is complex:
            self._put("complex", value.real.hex(), value.imag.hex())
        elif isinstance(value, enum.Enum):
            self._put("enum", _name(kind), value.name)
            self.add(value.value)
        elif isinstance(value, tuple) or kind is list:
            self._put("sequence", _name(kind), str(len(value)), *getattr(value, "_fields", ()))
            for item in value:
                self.add(item)
        elif kind is frozenset:
            self._put("set", *sorted(_digest_of(item) for item in value))
        elif kind is slice:
            self._put("slice")
            self.add((value.start, value.stop, value.step))
        elif isinstance(value, np.ndarray) and value.dtype.hasobject is False:
            self._put(
                "array", str(value.dtype.descr), str(value.shape), str(value.flags.f_contiguous)
            )
            self._put("data", value.tobytes())
        elif isinstance(value, np.generic) and value.dtype.hasobject is False:
            self._put("scalar", str(value.dtype.descr), value.tobytes())
        elif isinstance(value, np.dtype):
            self._put("dtype", str(value.descr), str(value.alignment), str(value.isalignedstruct))
        elif isinstance(value, pytypes.CodeType):
            self._code(value)
        elif isinstance(value, Dispatcher):
            if self._first_time(value):
                self._put("compiled", type(value).__name__)
                self._options(value.targetoptions)
                for name, variable in sorted(value.locals.items()):
                    self._put("local", name)
                    self.type(variable)
                self.function(value.py_func)
        elif isinstance(value, types.Type):
            self.type(value)
        elif isinstance(value, pytypes.ModuleType):
            if not _trusted(value.__name__):
                raise _NoFingerprint(f"the module {value.__name__} as a value")
            self._put("module", value.__name__)
        elif isinstance(value, np.ufunc):
            name = value.__name__
            if getattr(np, name, None) is not value:
                raise _NoFingerprint(f"the universal function {name}")
            self._put("ufunc", name)
        elif isinstance(value, type):
            self._class(value)
        elif (
            callable(value)
            and isinstance(getattr(value, "__name__", None), str)
            and _trusted(getattr(value, "__module__", None) or "")
        ):
            self._put("library", _name(value))
        else:
            # Also a plain Python function: compiled code can only call it through an overload.
            raise _NoFingerprint(f"{value!r} of type {kind.__qualname__}")

    def _options(self, options: dict[str, Any]) -> None:
        for name, value in sorted(options.items()):
            self._put("option", name)
            if isinstance(value, (set, frozenset)):
                self._put("flags", *sorted(map(str, value)))
            elif isinstance(value, (bool, str, int, type(None))):
                self.add(value)
            else:
                raise _NoFingerprint(f"the option {name}={value!r}")

    def _class(self, value: type) -> None:
        if issubclass(value, BaseException) or _trusted(value.__module__):
            self._put("class", _name(value))  # only its identity is compiled in
        elif issubclass(value, enum.Enum):
            self._put("enumeration", _name(value))
            for member in value:
                self._put("member", member.name)
                self.add(member.value)
        elif issubclass(value, tuple) and hasattr(value, "_fields"):
            self._put("namedtuple", _name(value), *value._fields)
        else:
            raise _NoFingerprint(f"the class {_name(value)}")

    def _code(self, code: pytypes.CodeType) -> None:
        self._put("code", code.co_name, code.co_code, getattr(code, "co_exceptiontable", b""))
        self.add((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
        self.add((code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags))
        for constant in code.co_consts:
            self.add(constant)

    def function(self, function: Callable[..., Any]) -> None:
        """Add a function that is compiled: code, defaults, closure, globals that it reads."""
        self._put("function", function.__module__ or "", function.__qualname__)
        code = function.__code__
        self._code(code)
        self.add(function.__defaults__)
        for name, value in sorted((function.__kwdefaults__ or {}).items()):
            self._put("default", name)
            self.add(value)
        cells = function.__closure__ or ()
        for name, cell in zip(code.co_freevars, cells, strict=True):
            self._put("cell", name)
            try:
                content = cell.cell_contents
            except ValueError:
                raise _NoFingerprint(f"the empty closure variable {name}") from None
            self.add(content)
        namespace = function.__globals__
        for path in sorted(set(_global_paths(code))):
            self._global(namespace, path)

    def _global(self, namespace: dict[str, Any], path: tuple[str, ...]) -> None:
        self._put("global", *path)
        if path[0] not in namespace:
            builtins = namespace.get("__builtins__", {})
            known = builtins if isinstance(builtins, dict) else vars(builtins)
            self._put("builtin" if path[0] in known else "undefined")
            return
        value = namespace[path[0]]
        for attribute in path[1:]:
            # Only modules are followed; attributes of anything else belong to that value.
            if not isinstance(value, pytypes.ModuleType) or _trusted(value.__name__):
                break
            value = getattr(value, attribute, None)
        self.add(value)

    def type(self, kind: Any) -> None:
        """Add a numba type."""
        if isinstance(kind, types.Dispatcher):
            self._put("type of")
            self.add(kind.dispatcher)
        elif isinstance(kind, types.BaseTuple):
            self._put("tuple type", type(kind).__name__)
            if isinstance(kind, types.BaseNamedTuple):
                self._class(kind.instance_class)
            for member in kind:
                self.type(member)
        elif isinstance(kind, types.Optional):
            self._put("optional")
            self.type(kind.type)
        elif isinstance(kind, types.Omitted):
            self._put("omitted")
            self.add(kind.value)
        elif isinstance(kind, types.Literal):
            self._put("literal")
            self.add(kind.literal_value)
        elif isinstance(kind, types.FunctionType):
            self._put("function type")
            self.type(kind.signature.return_type)
            self.type(types.Tuple(kind.signature.args))
        elif isinstance(kind, types.NumberClass):
            self._put("number class", str(kind))
        elif isinstance(kind, types.Array):
            self._put(
                "array type", kind.layout, str(kind.ndim), str(kind.mutable), str(kind.aligned)
            )
            self.type(kind.dtype)
        elif isinstance(
            kind,
            (
                types.Number,
                types.Boolean,
                types.NoneType,
                types.UnicodeType,
                types.Record,
                types.SliceType,
                types.RangeType,
                types.StringLiteral,
                types.NPDatetime,
                types.NPTimedelta,
                types.DType,
            ),
        ):
            self._put("type", type(kind).__name__, str(kind))  # these are named by their content
        else:
            raise _NoFingerprint(f"the type {kind}")


def _digest_of(value: Any) -> str:
    digest = _Digest()
    digest.add(value)
    return digest.hexdigest()


def _name(value: Any) -> str:
    """Return where `value`, a class or a function, is defined."""
    return f"{value.__module__}:{getattr(value, '__qualname__', value.__name__)}"


def _trusted(module: str) -> bool:
    return module.partition(".")[0] in _TRUSTED


def _global_paths(code: pytypes.CodeType) -> Iterator[tuple[str, ...]]:
    """Yield the globals that `code` reads, with the chain of attributes taken right after each."""
    instructions = [i for i in dis.get_instructions(code) if i.opname not in ("CACHE", "NOP")]
    for position, instruction in enumerate(instructions):
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            chain = itertools.takewhile(
                lambda i: i.opname in ("LOAD_ATTR", "LOAD_METHOD"), instructions[position + 1 :]
            )
            yield (instruction.argval, *(i.argval for i in chain))
    for constant in code.co_consts:
        if isinstance(constant, pytypes.CodeType):
            yield from _global_paths(constant)


def fingerprint(function: Any) -> str | None:
    """Return a digest of everything that the result of a jitted function depends on.

    It covers the function's code, options, closure and globals, and all of these for every jitted
    function that it calls. Two processes with the same sources and versions agree on it.

    Parameters
    ----------
    function : compiled function
        As returned by :func:`jit` (or by ``numba.njit``).

    Returns
    -------
    str or None
        Hexadecimal SHA-256, or None if something in it cannot be told from its text.
    """
    try:
        return _digest_of(function)
    except _NoFingerprint as reason:
        _log.debug("%r has no fingerprint because of %s", function, reason)
        return None


# ---------------------------------------------------------------------------------------------
# The folder of compiled code


class _Store:
    """The folder that holds the compiled functions of one package."""

    def __init__(self, package_root: Path) -> None:
        self.package_root = package_root
        self._stamp: str | None = None
        self._folder: Path | None = None
        self._writable = True
        self._opened = False
        self._pruned = False

    def stamp(self) -> str:
        """Digest of what all functions depend on: versions, settings, extensions of numba."""
        if self._stamp is None:
            hashed = hashlib.sha256()
            for part in (
                sys.implementation.cache_tag or sys.implementation.name,
                sys.version,
                np.__version__,
                numba.__version__,
                llvmlite.__version__,
                *(f"{name}={getattr(numba_config, name, None)!r}" for name in _SETTINGS),
            ):
                hashed.update(part.encode() + b"\0")
            for path in [Path(__file__), *sorted(self.package_root.rglob("*.py"))]:
                try:
                    text = path.read_bytes()
                except OSError:  # an editor may be replacing it
                    text = secrets.token_bytes(16)
                if path == Path(__file__) or _EXTENDS_NUMBA.search(text):
                    hashed.update(path.name.encode() + b"\0" + hashlib.sha256(text).digest())
            self._stamp = hashed.hexdigest()
        return self._stamp

    def _candidates(self) -> list[tuple[str, Path]]:
        for variable, below in (("LISSOME_CACHE", ""), ("NUMBA_CACHE_DIR", "lissome")):
            if value := os.environ.get(variable):
                return [(f"${variable}", Path(value).absolute() / below / "compiled")]
        places = [("the package", self.package_root / "__pycache__" / "lissome-compiled")]
        with contextlib.suppress(RuntimeError, OSError):
            user = Path(platformdirs.user_cache_dir("lissome", appauthor=False))
            if user.is_absolute():  # not so where there is no home
                places.insert(0, ("the user's cache folder", user / "compiled"))
        return places

    def _open(self) -> Path | None:
        """Return the folder, or None where there is none to read."""
        if self._opened:
            return self._folder
        self._opened = True
        failures = []
        for origin, path in self._candidates():
            try:
                path.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=path).close()
            except OSError as error:
                failures.append((origin, path, error))
            else:
                self._folder = path
                return path
        self._folder = next((path for _, path, _ in failures if path.is_dir()), None)
        self._give_up("; ".join(f"{path} ({origin}): {error}" for origin, path, error in failures))
        return self._folder

    def _give_up(self, why: str) -> None:
        """Write no more in this process, and say so once."""
        if self._writable:
            self._writable = False
            warnings.warn(
                f"compiled functions cannot be stored ({why}); they are compiled anew in each "
                "process. Set the environment variable LISSOME_CACHE to a folder with free space "
                "that can be written",
                CacheWarning,
                stacklevel=2,
            )

    def _path(self, folder: Path, name: str, key: str) -> Path:
        return folder / f"{re.sub('[^A-Za-z0-9_]+', '-', name)[-60:]}-{key[:40]}.bin"

    @property
    def folder(self) -> str | None:
        return str(self._folder) if self._folder else None

    def read(self, name: str, key: str) -> bytes | None:
        folder = self._open()
        if folder is None:
            return None
        path = self._path(folder, name, key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        head = len(_MAGIC) + 32
        payload = data[head:]
        if data[:head] != _MAGIC + hashlib.sha256(payload).digest():
            _log.debug("damaged entry %s is removed", path)
            with contextlib.suppress(OSError):
                path.unlink()
            return None
        with contextlib.suppress(OSError):
            os.utime(path)  # the mark of its use
        return payload

    def remove(self, name: str, key: str) -> None:
        if self._folder is not None:
            with contextlib.suppress(OSError):
                self._path(self._folder, name, key).unlink()

    def write(self, name: str, key: str, payload: bytes) -> None:
        folder = self._open()
        if folder is None or not self._writable:
            return
        path = self._path(folder, name, key)
        temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}.tmp")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(_MAGIC + hashlib.sha256(payload).digest() + payload)
            os.replace(temporary, path)
        except OSError as error:
            with contextlib.suppress(OSError):
                temporary.unlink()
            if not path.exists():  # otherwise another process was quicker
                self._give_up(f"{path}: {error}")
            return
        if not self._pruned:
            self._pruned = True
            self._prune(folder)

    def _prune(self, folder: Path) -> None:
        entries = []
        with contextlib.suppress(OSError), os.scandir(folder) as found:
            for entry in found:
                with contextlib.suppress(OSError):
                    status = entry.stat()
                    entries.append((status.st_mtime, status.st_size, entry.path))
        size = sum(length for _, length, _ in entries)
        if size <= _BUDGET:
            return
        for _, length, path in sorted(entries):
            if size <= _BUDGET // 2:
                break
            with contextlib.suppress(OSError):
                os.unlink(path)
                size -= length


class _StorePickler(NumbaPickler):
    """Refers to compiled functions among the arguments by their place, not by their content."""

    def __init__(self, file: io.BytesIO, arguments: list[Any]) -> None:
        super().__init__(file, protocol=4)
        self._places = {id(d): place for place, d in enumerate(arguments)}

    def persistent_id(self, value: Any) -> int | None:
        dispatcher = value.dispatcher if isinstance(value, types.Dispatcher) else value
        if not isinstance(dispatcher, Dispatcher):
            return None
        if id(dispatcher) not in self._places:
            raise pickle.PicklingError(f"{dispatcher} is not an argument")
        place = self._places[id(dispatcher)]
        return place if dispatcher is value else -1 - place


class _StoreUnpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, arguments: list[Any]) -> None:
        super().__init__(file)
        self._arguments = arguments

    def persistent_load(self, place: int) -> Any:
        if place >= 0:
            return self._arguments[place]
        return types.Dispatcher(self._arguments[-1 - place])


def _compiled_arguments(kinds: Any) -> Iterator[Any]:
    """Yield the compiled functions among argument types, in order."""
    for kind in kinds:
        if isinstance(kind, types.Dispatcher):
            yield kind.dispatcher
        elif isinstance(kind, types.BaseTuple):
            yield from _compiled_arguments(kind)


class _FunctionStore(_Cache):
    """The cache of one dispatcher (the interface that numba's dispatcher calls)."""

    def __init__(self, dispatcher: Any, store: _Store) -> None:
        self._dispatcher = dispatcher
        self._store = store
        self._name = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"
        self._enabled = True
        self._keys: dict[Any, str] = {}

    @property
    def cache_path(self) -> str | None:
        return self._store.folder

    def enable(self) -> None:
        self._enabled = True

    def disable(self) -> None:
        self._enabled = False

    def flush(self) -> None:
        for key in self._keys.values():
            self._store.remove(self._name, key)

    def _key(self, args: Any, return_type: Any, codegen: Any) -> str:
        digest = _Digest()
        digest.add((self._store.stamp(), repr(codegen.magic_tuple())))
        digest.add(self._dispatcher)
        digest.type(types.Tuple(tuple(args)))
        if return_type is not None:
            digest.type(return_type)
        return digest.hexdigest()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        if not self._enabled:
            return None
        target_context.refresh()
        args, return_type = sigutils.normalize_signature(sig)
        self._keys.pop(sig, None)
        try:
            key = self._key(args, return_type, target_context.codegen())
        except _NoFingerprint as reason:
            _log.debug("%s is not cached because of %s", self._name, reason)
            return None
        # Kept for the time of saving: globals may have changed by then, but not what was compiled.
        self._keys[sig] = key
        payload = self._store.read(self._name, key)
        if payload is None:
            return None
        try:
            arguments = list(_compiled_arguments(args))
            parts = _StoreUnpickler(io.BytesIO(payload), arguments).load()
            return compiler.CompileResult._rebuild(target_context, *parts)
        except Exception as error:  # whatever is wrong with an entry, compiling anew is right
            _log.debug("entry of %s cannot be used (%r)", self._name, error)
            self._store.remove(self._name, key)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        key = self._keys.get(sig)
        if not self._enabled or key is None:
            return
        if any(not lifted.can_cache for lifted in data.lifted) or data.library.has_dynamic_globals:
            _log.debug("%s is not cached: it holds addresses of this process", self._name)
            return
        args, _ = sigutils.normalize_signature(sig)
        file = io.BytesIO()
        try:
            _StorePickler(file, list(_compiled_arguments(args))).dump(data._reduce())
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            _log.debug("%s is not cached: %r", self._name, error)
            return
        self._store.write(self._name, key, file.getvalue())


# ---------------------------------------------------------------------------------------------
# The decorator


class _UniqueNames(compiler.Compiler):
    """Gives each compilation symbols that no other process has used.

    numba numbers its functions from 1 in each process. Two closures of one factory that come from
    the caches of two processes could then share a symbol, and the linker would silently take one
    for both.
    """

    def _compile_bytecode(self) -> Any:
        identity = self.state.func_id
        identity.unique_id = secrets.randbits(62)
        identity.unique_name = f"{identity.func_qualname}${identity.unique_id}"
        return super()._compile_bytecode()


class CachedDispatcher(_CPUDispatcher):
    """A numba dispatcher with the cache of this module; made by :func:`jit`."""

    def __init__(
        self,
        py_func: Callable[..., Any],
        locals: dict[str, Any] | None = None,
        targetoptions: dict[str, Any] | None = None,
        pipeline_class: type = _UniqueNames,
        *,
        store: _Store | None = None,
    ) -> None:
        super().__init__(py_func, locals or {}, targetoptions or {}, pipeline_class)
        self._cache = _FunctionStore(self, store or _store_of(Path(__file__).parent))

    def enable_caching(self) -> None:
        """Do nothing: the cache is always on."""

    def __reduce__(self) -> Any:
        # By name where that leads back here, so that worker processes share the cache; by value
        # (as numba does) for functions of notebooks.
        found: Any = sys.modules.get(self.py_func.__module__)
        for part in self.py_func.__qualname__.split("."):
            found = getattr(found, part, None)
        if found is self and self.py_func.__module__ != "__main__":
            return _by_name, (self.py_func.__module__, self.py_func.__qualname__)
        return super().__reduce__()

    def _reduce_states(self) -> dict[str, Any]:
        root = self._cache._store.package_root
        return {**super()._reduce_states(), "package_root": str(root)}

    @classmethod
    def _rebuild(
        cls,
        uuid: str,
        py_func: Any,
        locals: Any,
        targetoptions: Any,
        can_compile: bool,
        sigs: Any,
        package_root: str,
    ) -> Any:
        known = cls._memo.get(uuid)
        if known is not None:
            return known
        self = cls(py_func, locals, targetoptions, store=_store_of(Path(package_root)))
        self._set_uuid(uuid)
        for sig in sigs:
            self.compile(sig)
        self._can_compile = can_compile
        return self


def _by_name(module: str, qualname: str) -> Any:
    found: Any = __import__(module, fromlist=["_"])
    for part in qualname.split("."):
        found = getattr(found, part)
    return found


_stores: dict[Path, _Store] = {}


def _store_of(package_root: Path) -> _Store:
    return _stores.setdefault(package_root, _Store(package_root))


def make_jit(package_root: str | os.PathLike[str]) -> Callable[..., Any]:
    """Return a decorator like ``numba.njit`` for the package whose sources lie below a folder.

    Parameters
    ----------
    package_root : path
        Folder with the package's sources. Those of its files that extend numba are part of the
        key of every entry; if no other folder can be written, its ``__pycache__`` holds the cache.

    Returns
    -------
    callable
        The decorator; see :func:`jit`.
    """
    store = _store_of(Path(package_root).absolute())

    def decorator(
        signature_or_function: Any = None,
        /,
        *,
        locals: dict[str, Any] | None = None,
        **options: Any,
    ) -> Any:
        for refused in ("cache", "nopython", "forceobj", "pipeline_class"):
            if refused in options:
                raise TypeError(f"jit() got the option {refused!r}, which it sets itself")

        signatures: list[Any] | None = None
        if isinstance(signature_or_function, (list, tuple)) and not isinstance(
            signature_or_function, types.Type
        ):
            whole = sigutils.is_signature(signature_or_function)
            signatures = [signature_or_function] if whole else list(signature_or_function)
        elif signature_or_function is not None and sigutils.is_signature(signature_or_function):
            signatures = [signature_or_function]

        def wrap(function: Any) -> Any:
            if not isinstance(function, pytypes.FunctionType):
                raise TypeError(
                    f"jit() compiles Python functions, not {function!r} of type "
                    f"{type(function).__name__}"
                )
            if numba_config.DISABLE_JIT:
                return function
            targetoptions = {"nopython": True, "boundscheck": None, **options}
            dispatcher = CachedDispatcher(function, locals, targetoptions, store=store)
            if signatures is not None:
                with typeinfer.register_dispatcher(dispatcher):
                    for signature in signatures:
                        dispatcher.compile(signature)
                    dispatcher.disable_compile()
            return dispatcher

        if signature_or_function is None or signatures is not None:
            return wrap
        return wrap(signature_or_function)

    return decorator


jit = make_jit(Path(__file__).parent)
jit.__name__ = jit.__qualname__ = "jit"
jit.__doc__ = """Compile a function at its first call, as ``numba.njit`` does, and store the result.

Used bare, ``@jit``, with numba's options, ``@jit(fastmath=True)``, or with one or more signatures,
``@jit("float64(float64)")``, which compile at once. See the module's description for the cache.

Returns
-------
numba dispatcher
    ``stats.cache_hits`` tells which signatures were found in the cache.
"""
