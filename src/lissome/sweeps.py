r"""Independent runs over a grid of parameters, gathered in a table.

The module is named ``sweeps`` because its function is public as ``lissome.sweep``: a module of that
name would take the function's place as soon as somebody imported it.
"""

from __future__ import annotations

import atexit
import concurrent.futures
import functools
import inspect
import itertools
import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from . import _progress
from ._executors import Workers, is_client, worker_died
from ._points import (
    Asker,
    DamagedEntry,
    Failure,
    Result,
    ResultStore,
    Stale,
    die_with,
    one_thread,
    run_point,
    this_process,
)
from ._sources import library_changed, library_sources
from ._validate import one_of
from ._work import Work
from .errors import CacheWarning, InvalidInput, SweepFailed

if TYPE_CHECKING:
    from tqdm import tqdm

__all__ = ["sweep"]

_Outcome = Result | Failure
_PATIENCE = 5.0  # seconds that a thread which is about to end is given
# Seconds after which idle workers end. (One that ends just as the next sweep begins makes loky warn.)
_IDLE = 600


def sweep(
    function: Callable[..., Any],
    grid: Mapping[str, Iterable[Any]] | Sequence[Mapping[str, Any]] | pd.DataFrame,
    executor: Any = None,
    cache: str | os.PathLike[str] | None = None,
    *,
    on_error: str = "raise",
    progress: bool | None = None,
) -> pd.DataFrame:
    """Call a function at every point of a grid and return one tidy table.

    Parameters
    ----------
    function : callable
        Called as ``function(**point)``. It returns a scalar (column ``value``), a mapping of names
        to scalars and numpy arrays (one row; arrays are entries of columns of type object), or a
        `pandas.DataFrame` (as many rows as it has; a named index becomes columns). All points
        return the same names. It should depend on its arguments only.
    grid : mapping, sequence of mappings, or pandas.DataFrame
        A mapping of parameter names to values gives their full product, the last name varying
        fastest; a sequence of mappings, or the rows of a frame, are the points themselves. Scalars
        of numpy are passed as Python scalars where that is exact.
    executor : concurrent.futures.Executor, distributed.Client, "serial" or None, optional
        Where the points are computed. None (default): as many processes of `loky` as there are
        processors; functions of notebooks will do. ``"serial"``: here, one after the other. The
        client of a Dask cluster: on all its workers, which may come and go; points of a worker
        that dies are given to another. Any other executor is used, and left open. BLAS libraries
        are limited to one thread.
    cache : path, optional
        Folder of finished points (JSON, and .npz for arrays; made if missing). Each point is stored
        as soon as it is finished, so that an interrupted sweep goes on where it was. A stored point
        is used only if nothing that it depends on has changed: the arguments (to the last bit), the
        function (code, defaults, closure, and the globals that it reads, also through other
        functions of yours), all sources of this library, and the versions of Python and of the
        packages that the function uses. Comments and formatting do not count. Old entries are never
        wrong, only unused: delete the folder whenever you like.
    on_error : {"raise", "record"}, optional
        What to do if the function raises: stop (default), or go on and leave its result empty, with
        the exception in the column ``error``. Failures are not stored.
    progress : bool, optional
        Show a progress bar on stderr. By default only if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        Parameters, results and, with ``on_error="record"``, ``error`` (None where all is well), in
        the order of the grid whatever the order of completion. ``frame.attrs["sweep"]`` counts
        points, and those computed, taken from the cache, and failed.

    Raises
    ------
    InvalidInput
        If the grid is empty or malformed, does not fit the function's parameters, holds NaN, if the
        cache folder cannot be written, or if a cache is wanted for a function that depends on
        something whose changes cannot be seen (an open file, a random generator, ...).
    SweepFailed
        If the function raises (its exception is the cause), a worker process dies, or points return
        different names. Points that are running are finished and kept first; the exception has the
        failed `point` and the table of `finished` points.

    Warns
    -----
    CacheWarning
        Once, if stored points are damaged (they are computed anew) or can no longer be stored.

    Examples
    --------
    >>> import lissome
    >>> def column(length, stiffness):
    ...     return {"buckling_force": 9.8696 * stiffness / length**2}
    >>> lissome.sweep(column, {"length": [1.0, 2.0], "stiffness": [1.0, 3.0]}, executor="serial")
       length  stiffness  buckling_force
    0     1.0        1.0          9.8696
    1     1.0        3.0         29.6088
    2     2.0        1.0          2.4674
    3     2.0        3.0          7.4022
    """
    if not callable(function):
        raise InvalidInput(
            f"argument `function` is {function!r}; pass a callable that takes the grid's names"
        )
    if not (
        executor is None
        or isinstance(executor, (str, concurrent.futures.Executor))
        or is_client(executor)
    ):
        raise InvalidInput(
            f"argument `executor` is {executor!r}; pass None (processes), 'serial', an instance "
            "of concurrent.futures.Executor, or the client of a Dask cluster"
        )
    if isinstance(executor, str):
        one_of("executor", executor, ["serial"])
    one_of("on_error", on_error, ["raise", "record"])
    points = _points(grid)
    _check_signature(function, points)
    run = _Run(function, points, on_error)
    if cache is not None:
        run.open(cache)
    run.execute(executor, progress)
    return run.table()


def _dismiss(executor: Any, wait: bool) -> None:
    """Shut an executor of loky down and kill its workers.

    The thread that feeds them is a daemon, and nobody joins it. Once the executor is gone it is the
    last that holds semaphores: an interpreter that ends while it removes one leaves that one on the
    books of the process that tracks them, which then reports a leak on stderr. Hence it is awaited
    here, or at exit; not for ever, because it may be stuck in a pipe that nobody reads any more.
    """
    feeder = getattr(getattr(executor, "_call_queue", None), "_thread", None)
    executor.shutdown(wait=wait, kill_workers=True)
    if feeder is not None:
        if wait:
            feeder.join(_PATIENCE)
        else:
            atexit.register(feeder.join, _PATIENCE)


class _StaleWorkersError(Exception):
    def __init__(self, index: int, name: str) -> None:
        super().__init__(index, name)
        self.index = index
        self.name = name


class _Run:
    """One sweep: its points, their outcomes, and the store."""

    def __init__(
        self, function: Callable[..., Any], points: list[dict[str, Any]], on_error: str
    ) -> None:
        self.function = function
        self.points = points
        self.on_error = on_error
        self.outcomes: dict[int, _Outcome] = {}
        self._work = Work(function)
        self._asker = Asker(this_process(), library_sources(), self._work.witnesses)
        self.cached = 0
        self._store: ResultStore | None = None
        self._keys: list[str] = []

    @property
    def label(self) -> str:
        inner: Any = self.function
        while isinstance(inner, functools.partial):
            inner = inner.func
        return getattr(inner, "__qualname__", type(inner).__qualname__)

    # Cache ---------------------------------------------------------------------------------------

    def open(self, cache: str | os.PathLike[str]) -> None:
        """Open the folder and take what is there."""
        try:
            folder = Path(cache)
        except TypeError:
            raise InvalidInput(
                f"argument `cache` is {cache!r}; pass the path of a folder"
            ) from None
        self._keys = self._work.keys(self.points)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            probe = folder / f".probe-{os.getpid()}-{os.urandom(4).hex()}"
            probe.write_bytes(b"")
            probe.unlink()
        except (OSError, ValueError) as error:
            raise InvalidInput(
                f"argument `cache` is {os.fspath(cache)!r}, which cannot be written ({error}); "
                "pass a folder that can, or None"
            ) from error
        if library_changed():
            warnings.warn(
                "source files of the library were edited since this process imported them: this "
                "sweep neither takes nor stores points; start a new process",
                CacheWarning,
                stacklevel=3,
            )
            return
        self._store = ResultStore(folder, self.label)
        damaged = []
        for index, key in enumerate(self._keys):
            try:
                result = self._store.read(key)
            except DamagedEntry as error:
                damaged.append(str(error))
                continue
            if result is not None:
                self.outcomes[index] = result
        self.cached = len(self.outcomes)
        if damaged:
            warnings.warn(
                f"{len(damaged)} stored point(s) of this sweep are damaged and are computed anew; "
                f"the first: {damaged[0]}",
                CacheWarning,
                stacklevel=3,
            )

    def finish(self, index: int, outcome: _Outcome) -> None:
        """Keep the outcome of a point, in memory and in the store."""
        self.outcomes[index] = outcome
        if self._store is not None and isinstance(outcome, Result):
            try:
                if library_changed():
                    raise OSError("source files of the library were edited in the meantime")
                self._store.write(self._keys[index], self.label, self.points[index], outcome)
            except OSError as error:
                self._store = None
                warnings.warn(
                    f"finished points can no longer be stored ({error}); the sweep goes on without",
                    CacheWarning,
                    stacklevel=5,
                )

    # Execution -----------------------------------------------------------------------------------

    def execute(self, executor: Any, progress: bool | None) -> None:
        pending = [index for index in range(len(self.points)) if index not in self.outcomes]
        if not pending:
            return
        with _progress.bar(
            self.label, progress, len(self.points), initial=self.cached, delay=0.0
        ) as bar:
            if executor == "serial":
                self._serially(pending, bar)
            elif executor is None:
                self._in_processes(pending, bar)
            else:
                try:
                    self._concurrently(pending, bar, Workers.of(executor))
                except _StaleWorkersError as stale:
                    raise self._stale(stale.index, stale.name) from None
        self._raise_first_failure()

    def _serially(self, pending: list[int], bar: tqdm[Any]) -> None:
        with one_thread():
            for index in pending:
                outcome = run_point(self.function, self.points[index], self._asker)
                assert not isinstance(outcome, Stale)  # there is no other process
                self.finish(index, outcome)
                bar.update()
                if isinstance(outcome, Failure) and self.on_error == "raise":
                    return

    def _in_processes(self, pending: list[int], bar: tqdm[Any]) -> None:
        import loky

        one = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
        )
        workers = min(loky.cpu_count(), len(pending))
        for last in (False, True):
            executor = loky.get_reusable_executor(
                max_workers=workers, env=one, timeout=_IDLE,
                initializer=die_with, initargs=(os.getpid(),),
            )  # fmt: skip
            try:
                self._concurrently(pending, bar, Workers.of(executor))
                return
            except _StaleWorkersError as stale:
                # They may be left from a former sweep, before a module was reloaded.
                _dismiss(executor, wait=True)
                if last:
                    raise self._stale(stale.index, stale.name) from None
                pending = [index for index in pending if index not in self.outcomes]
            except BaseException as error:
                if not isinstance(error, Exception):  # an interruption: wait for nothing
                    _dismiss(executor, wait=False)
                raise

    def _concurrently(self, pending: list[int], bar: tqdm[Any], workers: Workers) -> None:
        queue = iter(pending)
        running: dict[concurrent.futures.Future[_Outcome | Stale], int] = {}
        broken: tuple[int, Exception] | None = None
        stale: _StaleWorkersError | None = None
        # Threads share this process, whose limit is set here; processes set their own.
        with one_thread():
            try:
                while broken is None:
                    try:
                        # A short queue keeps all busy, and little is in vain if a point fails.
                        room = max(2 * workers.slots() + 1 - len(running), 0)
                        for index in itertools.islice(queue, room):
                            future = workers.executor.submit(
                                run_point, self.function, self.points[index], self._asker
                            )
                            running[future] = index
                    except RuntimeError as error:  # the executor is broken, or shut down
                        broken = index, error
                        break
                    if not running:
                        break
                    done, _ = concurrent.futures.wait(
                        running, return_when=concurrent.futures.FIRST_COMPLETED
                    )
                    for future in sorted(done, key=running.__getitem__):
                        index = running[future]
                        try:
                            outcome = future.result()
                        except Exception as error:  # of the executor: the function's are outcomes
                            broken = broken or (index, error)
                            continue
                        del running[future]
                        if isinstance(outcome, Stale):
                            stale = _StaleWorkersError(index, outcome.name)
                        else:
                            self.finish(index, outcome)
                            bar.update()
                        failed = isinstance(outcome, Failure) and self.on_error == "raise"
                        if failed or stale is not None:
                            queue = iter(())
                            for waiting in [f for f in running if f.cancel()]:
                                del running[waiting]
            finally:
                for future, index in running.items():
                    future.cancel()
                    finished = future.done() and not future.cancelled()
                    if finished and future.exception() is None:  # in the meantime
                        outcome = future.result()
                        if not isinstance(outcome, Stale):
                            self.finish(index, outcome)
        if broken is not None:
            raise self._broken(*broken) from broken[1]
        if stale is not None:
            raise stale

    def _stale(self, index: int, name: str) -> SweepFailed:
        return SweepFailed(
            f"worker processes have other code than this process: {name} was edited after one of "
            "them imported it. Start a new process, and a new executor",
            point=self.points[index],
            finished=self._finished(),
        )

    def _broken(self, index: int, error: BaseException) -> SweepFailed:
        """Describe a failure of the executor, not of the function."""
        kept = f"{len(self.outcomes)} of {len(self.points)} points are finished"
        kept += " and stored; run again to go on" if self._store is not None else ""
        if worker_died(error):
            why = (
                "a worker process died (killed, out of memory, or crashed in compiled code) near "
                f"the point {_shown(self.points[index])}"
            )
        else:
            why = (
                f"the point {_shown(self.points[index])} could not be sent to or from its worker "
                "(functions of a script or notebook need executor=None)"
            )
        return SweepFailed(
            f"{why}: {type(error).__name__}: {error}. {kept}",
            point=self.points[index],
            finished=self._finished(),
        )

    def _raise_first_failure(self) -> None:
        if self.on_error == "record":
            return
        for index, outcome in sorted(self.outcomes.items(), key=lambda item: item[0]):
            if isinstance(outcome, Failure):
                done = sum(isinstance(o, Result) for o in self.outcomes.values())
                cause = outcome.exception or RuntimeError(outcome.trace)
                if cause.__traceback__ is None:  # it comes from another process
                    cause.add_note(outcome.trace)
                raise SweepFailed(
                    f"the point {_shown(self.points[index])} failed with {outcome.summary} "
                    f"({done} of {len(self.points)} points are finished"
                    f"{' and stored' if self._store is not None else ''}); mend the function or "
                    'the grid, or pass on_error="record"',
                    point=self.points[index],
                    finished=self._finished(),
                ) from cause

    # Table ---------------------------------------------------------------------------------------

    def _finished(self) -> pd.DataFrame:
        return self._frame(
            [i for i, outcome in sorted(self.outcomes.items()) if isinstance(outcome, Result)]
        )

    def table(self) -> pd.DataFrame:
        return self._frame(list(range(len(self.points))))

    def _frame(self, indices: list[int]) -> pd.DataFrame:
        names = _result_names(self.points, self.outcomes, indices)
        parameters = list(self.points[0])
        columns: dict[str, list[Any]] = {name: [] for name in (*parameters, *names)}
        errors: list[str | None] = []
        for index in indices:
            outcome = self.outcomes[index]
            count = 1
            if isinstance(outcome, Failure):
                for name in names:
                    columns[name].append(None)
            elif outcome.kind == "table":
                count = len(next(iter(outcome.columns.values()), ()))
                for name in names:
                    columns[name].extend(_cells(outcome.columns[name]))
            else:
                for name in names:
                    columns[name].append(outcome.columns[name])
            for name in parameters:
                columns[name].extend([self.points[index][name]] * count)
            errors.extend([outcome.summary if isinstance(outcome, Failure) else None] * count)
        frame = pd.DataFrame({name: _series(values) for name, values in columns.items()})
        if self.on_error == "record":
            frame["error"] = pd.Series(errors, dtype=object)
        failed = sum(isinstance(outcome, Failure) for outcome in self.outcomes.values())
        frame.attrs["sweep"] = {
            "points": len(self.points),
            "computed": len(self.outcomes) - self.cached - failed,
            "cached": self.cached,
            "failed": failed,
        }
        return frame


def _result_names(
    points: list[dict[str, Any]], outcomes: dict[int, _Outcome], indices: list[int]
) -> list[str]:
    first: tuple[int, Result] | None = None
    for index in indices:
        outcome = outcomes[index]
        if isinstance(outcome, Failure):
            continue
        if first is None:
            first = index, outcome
        elif set(outcome.columns) != set(first[1].columns) or (
            (outcome.kind == "table") != (first[1].kind == "table")
        ):
            raise SweepFailed(
                f"the point {_shown(points[index])} returned {_described(outcome)}, but "
                f"{_shown(points[first[0]])} returned {_described(first[1])}; return the same "
                "names at every point",
                point=points[index],
            )
    return list(first[1].columns) if first is not None else []


def _described(result: Result) -> str:
    return f"a {result.kind} of {sorted(result.columns)}"


def _cells(column: np.ndarray[Any, Any]) -> list[Any]:
    """Return the entries of a column as Python scalars; times stay what they are."""
    return list(column) if column.dtype.kind in "mM" else column.tolist()


def _series(values: list[Any]) -> pd.Series:
    plain = all(value is None or isinstance(value, (bool, int, float, str)) for value in values)
    if plain:
        return pd.Series(values, dtype=None if values else object)
    if all(isinstance(value, complex) for value in values):
        return pd.Series(np.array(values, dtype=complex))
    if all(isinstance(value, (np.datetime64, np.timedelta64)) for value in values):
        return pd.Series(np.array(values))
    cells = np.empty(len(values), dtype=object)
    for place, value in enumerate(values):
        cells[place] = value
    return pd.Series(cells)


# ---------------------------------------------------------------------------------------------
# The grid


def _points(grid: Any) -> list[dict[str, Any]]:
    """Return the points of a grid, in order."""
    if isinstance(grid, pd.DataFrame):
        if not grid.columns.is_unique:
            raise InvalidInput("argument `grid` has columns of equal names; rename them")
        names = list(grid.columns)
        columns = [grid[name].tolist() for name in names]
        points = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
    elif isinstance(grid, Mapping):
        axes = {name: _axis(name, values) for name, values in grid.items()}
        points = [
            dict(zip(axes, combination, strict=True))
            for combination in itertools.product(*axes.values())
        ]
        if not axes:
            points = []
    elif isinstance(grid, Iterable) and not isinstance(grid, (str, bytes)):
        points = []
        for place, point in enumerate(grid):
            if not isinstance(point, Mapping):
                raise InvalidInput(
                    f"argument `grid`[{place}] is {_short(point)}; each point is a mapping of "
                    "parameter names to values"
                )
            points.append(dict(point))
    else:
        raise InvalidInput(
            f"argument `grid` is {_short(grid)}; pass a mapping of names to values, a sequence "
            "of mappings, or a pandas.DataFrame"
        )
    if not points:
        raise InvalidInput("argument `grid` holds no point; give each parameter at least one value")
    names = list(points[0])
    for name in names:
        if not isinstance(name, str) or not name.isidentifier() or name == "error":
            raise InvalidInput(
                f"argument `grid` has the parameter {name!r}; names are identifiers other than "
                "'error'"
            )
    return [
        {name: _value(place, name, value) for name, value in _ordered(place, point, names)}
        for place, point in enumerate(points)
    ]


def _ordered(place: int, point: dict[str, Any], names: list[str]) -> Iterator[tuple[str, Any]]:
    if set(point) != set(names):
        raise InvalidInput(
            f"argument `grid`[{place}] has the parameters {sorted(map(str, point))}, the first "
            f"point has {sorted(names)}; give all points the same"
        )
    return ((name, point[name]) for name in names)


def _axis(name: Any, values: Any) -> list[Any]:
    if isinstance(values, (str, bytes, Mapping, set, frozenset)) or not isinstance(
        values, Iterable
    ):
        raise InvalidInput(
            f"argument `grid`[{name!r}] is {_short(values)}; pass a list of values "
            "(for one value a list of one)"
        )
    if isinstance(values, np.ndarray) and values.ndim != 1:
        raise InvalidInput(
            f"argument `grid`[{name!r}] has shape {values.shape}; pass a one-dimensional array"
        )
    return list(values)


def _value(place: int, name: str, value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()  # itself, where Python has no such type
    if value is pd.NA or value is pd.NaT or (isinstance(value, float) and math.isnan(value)):
        raise InvalidInput(
            f"argument `grid`: parameter `{name}` of point {place} is {value!r}; "
            "leave such points out"
        )
    return value


def _check_signature(function: Callable[..., Any], points: list[dict[str, Any]]) -> None:
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return  # compiled functions may have none; the call will tell
    try:
        signature.bind(**points[0])
    except TypeError as error:
        raise InvalidInput(
            f"argument `grid` has the parameters {list(points[0])}, which do not fit the signature "
            f"{signature} of the function: {error}"
        ) from None


def _shown(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={_short(value)}" for name, value in point.items())


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."
