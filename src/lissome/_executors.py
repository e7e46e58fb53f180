"""Where the points of a sweep run: any executor, or the client of a Dask cluster."""

from __future__ import annotations

import concurrent.futures
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

__all__ = ["Workers", "is_client", "worker_died"]


@dataclass(frozen=True)
class Workers:
    """An executor, and how many points it runs side by side at this moment.

    Attributes
    ----------
    executor : concurrent.futures.Executor
        Takes the points.
    slots : callable
        Returns the number of points that run side by side: a cluster may grow and shrink.
    """

    executor: concurrent.futures.Executor
    slots: Callable[[], int]

    @classmethod
    def of(cls, executor: Any) -> Workers:
        """Return the workers behind an executor or the client of a Dask cluster."""
        if is_client(executor):
            # pure=False: two equal points are two tasks; whoever wants to keep results has the cache
            return cls(
                executor.get_executor(pure=False), lambda: sum(executor.nthreads().values()) or 1
            )
        count = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
        return cls(executor, lambda: count)


def is_client(executor: Any) -> bool:
    """Tell whether `executor` is the client of a Dask cluster; Dask itself is not imported."""
    distributed = sys.modules.get("distributed")  # whoever has a client has imported it
    return distributed is not None and isinstance(executor, distributed.Client)


def worker_died(error: BaseException) -> bool:
    """Tell whether an executor failed because a process that computed for it is gone."""
    distributed = sys.modules.get("distributed")
    return isinstance(error, concurrent.futures.BrokenExecutor) or (
        distributed is not None and isinstance(error, distributed.KilledWorker)
    )
