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

Entries are pickles of machine code: whoever can write one can run code. So an entry is read only if
it belongs to this user or to root and nobody else may write it, however open its folder is; others
are compiled anew and replaced. An entry is sealed together with its name: under another one it is
damaged.

Importing this module imports numba; ``import lissome`` does not.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import logging
import os
import pickle
import re
import secrets
import stat
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

from ._fingerprint import Digest, NoFingerprint
from .errors import CacheWarning

# numba makes these names at run time, out of sight of a type checker.
types: Any = numba.core.types
numba_config: Any = numba.core.config
_CPUDispatcher: Any = CPUDispatcher

__all__ = ["fingerprint", "jit", "make_jit"]

_log = logging.getLogger(__name__)

_MAGIC = b"lissome compiled 2\n"
_BUDGET = 512 * 2**20  # bytes; above it the least recently used entries go, down to half of it
_BINARY = getattr(os, "O_BINARY", 0)
_READ = os.O_RDONLY | _BINARY | getattr(os, "O_NONBLOCK", 0)  # a pipe in its place blocks nobody
_WRITE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY
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


class _CodeDigest(Digest):
    """Digest of compiled functions, of their argument types, and of what they depend on."""

    def __init__(self, trusted: frozenset[str] = _TRUSTED) -> None:
        super().__init__(trusted)

    def other(self, value: Any) -> None:
        if isinstance(value, Dispatcher):
            if self.first_time(value):
                self.put("compiled", type(value).__name__)
                self._options(value.targetoptions)
                for name, variable in sorted(value.locals.items()):
                    self.put("local", name)
                    self.type(variable)
                self.function(value.py_func)
        elif isinstance(value, types.Type):
            self.type(value)
        else:
            # Also a plain Python function: compiled code can only call it through an overload.
            super().other(value)

    def _options(self, options: dict[str, Any]) -> None:
        for name, value in sorted(options.items()):
            self.put("option", name)
            if isinstance(value, (set, frozenset)):
                self.put("flags", *sorted(map(str, value)))
            elif isinstance(value, (bool, str, int, type(None))):
                self.add(value)
            else:
                raise NoFingerprint(f"the option {name}={value!r}")

    def type(self, kind: Any) -> None:
        """Add a numba type."""
        if isinstance(kind, types.Dispatcher):
            self.put("type of")
            self.add(kind.dispatcher)
        elif isinstance(kind, types.BaseTuple):
            self.put("tuple type", type(kind).__name__)
            if isinstance(kind, types.BaseNamedTuple):
                self.kind(kind.instance_class)
            for member in kind:
                self.type(member)
        elif isinstance(kind, types.Optional):
            self.put("optional")
            self.type(kind.type)
        elif isinstance(kind, types.Omitted):
            self.put("omitted")
            self.add(kind.value)
        elif isinstance(kind, types.Literal):
            self.put("literal")
            self.add(kind.literal_value)
        elif isinstance(kind, types.FunctionType):
            self.put("function type")
            self.type(kind.signature.return_type)
            for argument in kind.signature.args:
                self.type(argument)
            self.put("end")
        elif isinstance(kind, types.NumberClass):
            self.put("number class", str(kind))
        elif isinstance(kind, types.Array):
            self.put(
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
            self.put("type", type(kind).__name__, str(kind))  # these are named by their content
        else:
            raise NoFingerprint(f"the type {kind}")


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
        digest = _CodeDigest()
        digest.add(function)
        return digest.hexdigest()
    except NoFingerprint as reason:
        _log.debug("%r has no fingerprint because of %s", function, reason)
        return None


# ---------------------------------------------------------------------------------------------
# The folder of compiled code


def _seal(path: Path, payload: bytes) -> bytes:
    """Return the head of an entry: what is stored, and under which name (it holds the key)."""
    return _MAGIC + hashlib.sha256(path.name.encode() + b"\0" + payload).digest()


def _only_ours(status: os.stat_result) -> bool:
    """Tell whether nobody but this user and root can have written a file."""
    if not hasattr(os, "geteuid"):  # Windows: the folders of a user are closed to others
        return True
    alone = not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return stat.S_ISREG(status.st_mode) and status.st_uid in (0, os.geteuid()) and alone


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
            own = [Path(__file__), Path(__file__).with_name("_fingerprint.py")]
            for path in [*own, *sorted(self.package_root.rglob("*.py"))]:
                try:
                    text = path.read_bytes()
                except OSError:  # an editor may be replacing it
                    text = secrets.token_bytes(16)
                if path in own or _EXTENDS_NUMBA.search(text):
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
                with tempfile.TemporaryFile(dir=path) as probe:
                    if not _only_ours(os.fstat(probe.fileno())):
                        raise OSError("files made there belong to another user")
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
            with open(os.open(path, _READ), "rb") as file:
                # of the open file: what a path names may change between a look and a read
                if not _only_ours(os.fstat(file.fileno())):
                    _log.debug("entry %s may have been written by another user", path)
                    return None
                data = file.read()
        except OSError:
            return None
        head = len(_MAGIC) + 32
        payload = data[head:]
        if data[:head] != _seal(path, payload):
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
            mode = 0o644  # whatever the umask: others may read, nobody else may write
            with open(os.open(temporary, _WRITE, mode), "wb") as file:
                file.write(_seal(path, payload) + payload)
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
        digest = _CodeDigest()
        digest.add((self._store.stamp(), repr(codegen.magic_tuple())))
        digest.add(self._dispatcher)
        digest.put("arguments", str(len(args)))
        for kind in args:
            digest.type(kind)
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
        except NoFingerprint as reason:
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
