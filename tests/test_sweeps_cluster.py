"""Sweeps on a Dask cluster of two workers: same numbers, dead workers, a run that is killed."""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import time

import pandas as pd
import pytest

import lissome
from lissome.errors import SweepFailed

dask = pytest.importorskip("dask", reason="the extra `cluster` is not installed")
distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")


@contextlib.contextmanager
def two_workers():
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def client():
    with two_workers() as client:
        yield client


@pytest.fixture
def mortals():
    """A cluster of its own for workers that die: on a busy machine none may take their place."""
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}), two_workers() as client:
        yield client


@pytest.fixture(autouse=True)
def _nobody_edits(monkeypatch):
    monkeypatch.setattr("lissome.sweeps.library_changed", lambda: False)


def make_outcome():
    """Return a function of a phase diagram: when does a spot of light snap a buckled strip?"""

    def outcome(intensity, offset):
        from lissome import beams

        strip = beams.ClampedStrip(span=0.95, segments=30)
        light = beams.GaussianSpot(intensity, center=0.475 - offset, width=0.1)
        return beams.first_snap(strip, light, step=0.05, rest=1e-4, until=20.0).time

    return outcome


DIAGRAM = {"intensity": [3.0, 8.0, 20.0], "offset": [0.01, 0.1, 0.3]}


def test_a_phase_diagram_is_the_same_to_the_last_bit(client):
    outcome = make_outcome()
    here = lissome.sweep(outcome, DIAGRAM, "serial")
    assert here["value"].nunique() > 3
    for executor in (None, client, client.get_executor()):
        there = lissome.sweep(outcome, DIAGRAM, executor)
        pd.testing.assert_frame_equal(here, there, check_exact=True)
        assert here["value"].to_numpy().tobytes() == there["value"].to_numpy().tobytes()


def test_points_run_on_all_workers_with_one_blas_thread_each(client):
    def where(n):
        import os
        import time

        import threadpoolctl

        time.sleep(0.2)
        threads = max([info["num_threads"] for info in threadpoolctl.threadpool_info()] or [1])
        return {"process": os.getpid(), "threads": threads}

    table = lissome.sweep(where, {"n": range(8)}, client)
    assert table["process"].nunique() == 2
    assert os.getpid() not in set(table["process"])
    assert (table["threads"] == 1).all()


def test_points_of_a_dead_worker_go_to_another(mortals, tmp_path):
    marker = str(tmp_path / "died")

    def mortal(n):
        import os
        import time

        if n == 2 and not os.path.exists(marker):
            open(marker, "w").close()
            os._exit(1)
        time.sleep(0.05)
        return n * n

    table = lissome.sweep(mortal, {"n": range(6)}, mortals, tmp_path / "cache")
    assert os.path.exists(marker)
    assert table["value"].tolist() == [n * n for n in range(6)]


def test_a_point_that_kills_every_worker_is_named_and_the_others_are_kept(mortals, tmp_path):
    def deadly(n):
        import os
        import time

        if n == 3:
            time.sleep(1.0)
            os._exit(1)
        return n

    with pytest.raises(SweepFailed, match=r"(?s)worker process died.*n=3.*stored; run again"):
        lissome.sweep(deadly, {"n": [0, 1, 2, 3]}, mortals, tmp_path)
    table = lissome.sweep(deadly, {"n": [0, 1, 2]}, mortals, tmp_path)
    assert table.attrs["sweep"] == {"points": 3, "computed": 0, "cached": 3, "failed": 0}


def test_a_failing_point_reports_its_own_exception(client):
    def halves(n):
        if n == 1:
            raise ZeroDivisionError("no half of one")
        return n / 2

    with pytest.raises(SweepFailed, match="no half of one") as caught:
        lissome.sweep(halves, {"n": [0, 1, 2]}, client)
    assert caught.value.point == {"n": 1}
    table = lissome.sweep(halves, {"n": [0, 1, 2]}, client, on_error="record")
    assert table["value"].tolist()[::2] == [0.0, 1.0]


KILLED = """
    import sys, time
    from pathlib import Path
    import distributed
    import lissome

    def slow(n):
        if n == int(sys.argv[1]):
            Path("reached").write_text("")
            time.sleep(120)
        with open("log", "a") as log:
            log.write(f"{n}\\n")
        return {"square": n * n}

    if __name__ == "__main__":
        with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                                      silence_logs=50) as cluster:
            with distributed.Client(cluster) as client:
                client.run(lambda argument: sys.argv.__setitem__(slice(None), ["", argument]),
                           sys.argv[1])
                frame = lissome.sweep(slow, {"n": range(8)}, client, "cache")
        print(frame.attrs["sweep"]["computed"], frame["square"].tolist())
"""


def test_a_run_that_is_killed_goes_on_where_it_was(tmp_path):
    (tmp_path / "script.py").write_text(textwrap.dedent(KILLED))

    def start(stop_at):
        return subprocess.Popen(
            [sys.executable, "script.py", str(stop_at)],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    process = start(5)
    deadline = time.monotonic() + 120
    while not (tmp_path / "reached").exists() or len(list(tmp_path.glob("cache/*.json"))) < 7:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)  # the client, the scheduler and both workers
    process.communicate(timeout=30)

    process = start(-1)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    computed, squares = out.split(maxsplit=1)
    assert computed == "1"
    assert squares.strip() == str([n * n for n in range(8)])
    assert sorted(map(int, (tmp_path / "log").read_text().split())) == list(range(8))
