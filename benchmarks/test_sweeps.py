"""Points of a sweep: what each way of computing them costs, and what two workers gain."""

from __future__ import annotations

import pytest

import lissome

GROUP = "a phase diagram of 16 points, N = 100"
EMPTY = "200 points that compute nothing"
SERIAL = "one after the other"


def flaps(intensity, angle):
    """One point of the phase diagram of the strip: does it flap, and how fast?"""
    from lissome import beams

    found = beams.flapping(
        beams.ClampedStrip(0.95, 100), beams.ParallelLight(intensity, angle=angle)
    )
    return {"flaps": found is not None}


def nothing(n):
    return n


DIAGRAM = {
    "intensity": [5.0, 10.0, 20.0, 40.0],
    "angle": [0.6, 0.8, 1.0, 1.2],
}


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.mark.parametrize(
    ("group", "function", "grid"),
    [(GROUP, flaps, DIAGRAM), (EMPTY, nothing, {"n": range(200)})],
    ids=["diagram", "empty"],
)
@pytest.mark.parametrize("where", [SERIAL, "processes of loky", "a Dask cluster of two workers"])
def test_sweep(benchmark, measure, client, group, function, grid, where):
    executor = {SERIAL: "serial", "processes of loky": None}.get(where, client)
    measure(
        where,
        group=group,
        against=None if where == SERIAL else SERIAL,
        note="" if where == SERIAL else "workers already there, and warm",
    )
    table = benchmark.pedantic(lissome.sweep, (function, grid, executor), rounds=3, warmup_rounds=1)
    assert len(table) == (16 if group == GROUP else 200)
