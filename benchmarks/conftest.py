"""What the benchmarks share: a name for each measurement, and what it is held against.

A benchmark is an ordinary function with the fixtures ``benchmark`` (of pytest-benchmark) and
``measure``::

    def bench_band_solve(benchmark, measure):
        measure("LAPACK dgtsv", group="one step, N = 100")
        benchmark(dgtsv, ...)

    def bench_first_order_step(benchmark, measure):
        measure("first-order step", group="one step, N = 100", against="LAPACK dgtsv", at_most=5)
        benchmark(step, ...)

The ratio of the two medians, both taken in the same run, is what is judged. Without a bound the
ratio is told, and not judged. ``within`` bounds the seconds themselves, where that is what was asked
for.
"""

import pytest

#: Runs in another Python, where its package is.
collect_ignore = ["peer_dolfinx.py"]


@pytest.fixture
def measure(benchmark):
    """Say what is measured, in which group, and what it is held against."""

    def say(what, *, group, against=None, at_most=None, at_least=None, within=None, note=""):
        if (at_most is not None or at_least is not None) and against is None:
            raise ValueError("a bound of a ratio needs `against`")
        if within is not None and against is not None:
            raise ValueError("what is bounded in seconds is held against nothing")
        benchmark.group = group
        benchmark.extra_info.update(
            what=what, against=against, at_most=at_most, at_least=at_least, within=within, note=note
        )

    return say
