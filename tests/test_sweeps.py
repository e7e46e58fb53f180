"""Sweeps: order, equality over executors, resumption, keys of the cache, faults."""

import concurrent.futures
import dataclasses
import functools
import itertools
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lissome
from lissome.errors import CacheWarning, InvalidInput, NotConverged, SweepFailed

sweep = functools.partial(lissome.sweep, executor="serial")
GRID = {"a": [1.0, 0.1, -2.5], "b": [1, 2]}


@pytest.fixture(autouse=True)
def _nobody_edits(monkeypatch):
    # While the library is edited nothing is cached (tested in processes of their own): an editor
    # at work must not disturb the other tests.
    monkeypatch.setattr("lissome.sweeps.library_changed", lambda: False)


def make_work():
    """Return a function that goes to worker processes by value (this module may not be there)."""

    def work(a, b):
        import numpy as np

        matrix = np.outer(np.arange(1, 40) ** a.real, np.arange(40) + b)
        return {
            "norm": float(np.linalg.norm(matrix @ matrix.T)),
            "sign": a > 0,
            "name": f"a{b}",
            "phase": complex(a, b),
            "count": b * 10**6,
            "odd": float("nan") if b == 2 else float("inf"),
            "small": -0.0,
            "curve": np.sin(a * np.arange(5)),
            "flags": np.array([True, False]),
        }

    return work


def same(first, second):
    """Tell whether two tables are equal in every bit and type."""
    pd.testing.assert_frame_equal(first, second, check_exact=True)
    for name in first:
        for one, two in zip(first[name], second[name], strict=True):
            assert type(one) is type(two)
            if isinstance(one, np.ndarray):
                assert one.dtype == two.dtype
                assert one.tobytes() == two.tobytes()
            elif isinstance(one, float):
                assert np.float64(one).tobytes() == np.float64(two).tobytes()
    return True


# Results -----------------------------------------------------------------------------------------


def test_product_has_the_last_name_fastest():
    frame = sweep(lambda a, b: a + b, GRID)
    assert list(frame.columns) == ["a", "b", "value"]
    points = list(itertools.product(*GRID.values()))
    assert list(zip(frame["a"], frame["b"], strict=True)) == points
    assert frame["value"].tolist() == [a + b for a, b in points]
    assert frame.attrs["sweep"] == {"points": 6, "computed": 6, "cached": 0, "failed": 0}


def test_given_points_keep_their_order():
    points = [{"b": 2, "a": 1.0}, {"a": -1.0, "b": 5}, {"b": 2, "a": 1.0}]
    frame = sweep(lambda a, b: a * b, points)
    assert frame["value"].tolist() == [2.0, -5.0, 2.0]
    same(frame, sweep(lambda a, b: a * b, pd.DataFrame(points)))
    same(frame, sweep(lambda a, b: a * b, iter(points)))


def test_tables_become_rows(tmp_path):
    def history(n):
        index = pd.Index(np.arange(n) * 0.5, name="time")
        return pd.DataFrame({"x": np.arange(n), "kind": ["p"] * n}, index=index)

    for _ in range(2):
        frame = sweep(history, {"n": [2, 0, 1]}, cache=tmp_path)
        assert frame.to_dict("list") == {
            "n": [2, 2, 1],
            "time": [0.0, 0.5, 0.0],
            "x": [0, 1, 0],
            "kind": ["p", "p", "p"],
        }
    assert frame.attrs["sweep"]["cached"] == 3


def test_times_survive_the_cache(tmp_path):
    def stamp(day):
        return {"at": np.array([f"2020-01-0{day}"], dtype="datetime64[ns]")}

    fresh = sweep(stamp, {"day": [1, 2]})
    for _ in range(2):
        same(fresh, sweep(stamp, {"day": [1, 2]}, cache=tmp_path))


@pytest.fixture(scope="module")
def serial():
    return sweep(make_work(), GRID)


@pytest.mark.parametrize("cached", [False, True])
@pytest.mark.parametrize("kind", ["serial", "threads", "loky"])
def test_all_executors_and_the_cache_agree_bit_for_bit(serial, kind, cached, tmp_path):
    cache = tmp_path if cached else None
    with concurrent.futures.ThreadPoolExecutor(3) as threads:
        executor = {"serial": "serial", "threads": threads, "loky": None}[kind]
        assert same(serial, lissome.sweep(make_work(), GRID, executor, cache))
        if cached:
            again = lissome.sweep(make_work(), GRID, executor, cache)
            assert same(serial, again)
            assert again.attrs["sweep"] == {"points": 6, "computed": 0, "cached": 6, "failed": 0}
        assert threads.submit(int).result() == 0  # it is left open


def test_order_does_not_depend_on_completion():
    def late_first(n):
        time.sleep(0.05 * (4 - n))
        return n

    with concurrent.futures.ThreadPoolExecutor(4) as threads:
        frame = lissome.sweep(late_first, {"n": range(5)}, threads)
    assert frame["value"].tolist() == list(range(5))


ONE_THREAD = """
    import concurrent.futures, sys, lissome
    def threads(n):
        import numpy as np
        import scipy.linalg  # not before: it brings a BLAS of its own
        import threadpoolctl
        scipy.linalg.lu_factor(np.eye(3))
        return max([lib["num_threads"] for lib in threadpoolctl.threadpool_info()], default=1)
    if __name__ == "__main__":
        kinds = {"serial": lambda: "serial", "loky": lambda: None,
                 "threads": lambda: concurrent.futures.ThreadPoolExecutor(2),
                 "processes": lambda: concurrent.futures.ProcessPoolExecutor(2)}
        executor = kinds[sys.argv[1]]()
        print(lissome.sweep(threads, {"n": [1, 2, 3]}, executor)["value"].tolist())
"""


@pytest.mark.parametrize("kind", ["serial", "loky", "threads", "processes"])
def test_points_have_one_blas_thread_whatever_the_environment_says(kind, tmp_path, library):
    (tmp_path / "script.py").write_text(textwrap.dedent(ONE_THREAD))
    done = subprocess.run(
        [sys.executable, "script.py", kind],
        cwd=tmp_path,
        env={**environment(library), "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
    )
    assert done.stdout == "[1, 1, 1]\n", done.stderr


def test_numpy_scalars_of_the_grid_arrive_as_python_scalars():
    frame = sweep(lambda x: type(x).__name__, {"x": [np.float64(1), np.int64(1), np.bool_(True)]})
    assert frame["value"].tolist() == ["float", "int", "bool"]


def test_nothing_is_written_to_a_stderr_that_is_no_terminal(capfd):
    lissome.sweep(make_work(), GRID)
    assert capfd.readouterr() == ("", "")
    sweep(lambda a, b: a, GRID, progress=True)
    assert "6/6" in capfd.readouterr().err


# Keys of the cache -------------------------------------------------------------------------------


class Calls:
    """Counts calls of functions that are made from source, as in a notebook."""

    def __init__(self, folder):
        self.folder = folder

    def run(self, source, grid=None, **names):
        namespace = {"__name__": "__main__", "np": np, "dataclasses": dataclasses, **names}
        exec(textwrap.dedent(source), namespace)
        frame = sweep(namespace["f"], grid or {"x": [1.0]}, cache=self.folder)
        return frame["value"].tolist(), frame.attrs["sweep"]["computed"]


@pytest.fixture
def calls(tmp_path):
    return Calls(tmp_path)


HELPER = """
    SCALE = {scale}
    @dataclasses.dataclass(frozen=True)
    class Law:
        stiffness: float = {stiffness}
        def energy(self, x):
            return {coefficient} * self.stiffness * x**2
    def inner(x, power={power}):
        return SCALE * x**power
    def f(x):
        # {comment}
        return inner(x) + Law().energy(x) + np.cos(0.0)
"""
DEFAULTS = {"scale": 2.0, "power": 2, "stiffness": 4.0, "coefficient": 0.5, "comment": "none"}


def test_every_change_of_the_users_code_counts_and_no_comment_does(calls):
    def run(**changes):
        return calls.run(HELPER.format(**{**DEFAULTS, **changes}), {"x": [2.0]})

    assert run() == ([17.0], 1)
    assert run() == ([17.0], 0)
    assert run(comment="some remark") == ([17.0], 0)
    assert run(scale=3.0) == ([21.0], 1)
    assert run(power=3) == ([25.0], 1)
    assert run(stiffness=8.0) == ([25.0], 1)
    assert run(coefficient=1.0) == ([25.0], 1)
    assert run() == ([17.0], 0)


def test_arguments_count_to_the_last_bit_and_by_type(calls):
    source = "def f(x): return repr(x)"
    nearly = float(np.nextafter(0.1, 1))
    values = [0.1, nearly, 1, 1.0, True, 0.0, -0.0, "1", None, (1, 2), (1.0, 2), [1, 2], 10**30]
    assert calls.run(source, {"x": values}) == ([repr(v) for v in values], len(values))
    assert calls.run(source, {"x": values}) == ([repr(v) for v in values], 0)


def test_arrays_and_dataclasses_are_arguments_too(calls):
    law = Stiff(np.array([1.0, 2.0]))
    source = "def f(x): return float(np.sum(getattr(x, 'values', x)))"
    assert calls.run(source, {"x": [np.ones(3), np.ones(4), law]}) == ([3, 4, 3], 3)
    assert calls.run(source, {"x": [law, np.ones(3), Stiff(np.array([1.0, 3.0]))]})[1] == 1


@dataclasses.dataclass(frozen=True)
class Stiff:
    values: np.ndarray


def test_closures_partials_and_compiled_functions_count(tmp_path):
    from lissome._compile import jit

    def scaled(factor):
        return lambda x: factor * x

    def product(x, factor):
        return factor * x

    def kernel(factor):
        @jit
        def compiled(x):
            return factor * x

        return lambda x: compiled(x)

    makers = [
        scaled,
        lambda factor: functools.partial(product, factor=factor),
        kernel,
        lambda factor: functools.lru_cache(scaled(factor)),
        lambda factor: Multiplier(factor).times,
    ]
    for number, make in enumerate(makers):
        folder = tmp_path / str(number)
        for factor, computed in ((2.0, 1), (2.0, 0), (3.0, 1), (2.0, 0)):
            frame = sweep(make(factor), {"x": [5.0]}, cache=folder)
            assert frame["value"].tolist() == [5.0 * factor]
            assert frame.attrs["sweep"]["computed"] == computed


@dataclasses.dataclass
class Multiplier:
    factor: float

    def times(self, x):
        return self.factor * x


def test_modules_of_the_user_are_followed(tmp_path, library):
    (tmp_path / "mine.py").write_text("def g(x):\n    return x * 2\n")
    (tmp_path / "other.py").write_text("SHIFT = 1\n")
    code = """
        import json, lissome, mine, other, sys
        def f(x):
            return mine.g(x) + other.SHIFT
        frame = lissome.sweep(f, {"x": [1, 2]}, "serial", "cache")
        print(json.dumps([frame["value"].tolist(), frame.attrs["sweep"]["computed"]]))
    """
    assert script(tmp_path, code, path=library) == [[3, 5], 2]
    assert script(tmp_path, code, path=library) == [[3, 5], 0]
    (tmp_path / "mine.py").write_text("def g(x):\n    return x * 3\n")
    assert script(tmp_path, code, path=library) == [[4, 7], 2]
    (tmp_path / "other.py").write_text("SHIFT = 5\n")
    assert script(tmp_path, code, path=library) == [[8, 11], 2]


def copied(folder):
    """Copy the library, so that nobody but the test edits it, and return where it is."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(lissome.__file__).parent, folder / "lissome", ignore=ignored)
    return folder


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return copied(tmp_path_factory.mktemp("library"))


def environment(path):
    return {**os.environ, "PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1"}


def script(folder, code, *arguments, path):
    (folder / "script.py").write_text(textwrap.dedent(code))
    done = subprocess.run(
        [sys.executable, "script.py", *arguments],
        cwd=folder,
        env=environment(path),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return json.loads(done.stdout.splitlines()[-1])


def test_the_librarys_sources_and_versions_are_part_of_the_key(tmp_path):
    copy = copied(tmp_path) / "lissome"
    code = """
        import importlib.metadata, json, lissome, sys
        if len(sys.argv) > 1:
            version = importlib.metadata.version
            importlib.metadata.version = lambda n: "0.0" if n == sys.argv[1] else version(n)
        frame = lissome.sweep(lambda x: x, {"x": [1, 2]}, "serial", "cache")
        print(json.dumps([lissome.__file__, frame.attrs["sweep"]["computed"]]))
    """
    for expected, version in ((2, ""), (0, ""), (2, "scipy"), (0, "scipy"), (0, "")):
        where, computed = script(tmp_path, code, *version.split(), path=tmp_path)
        assert Path(where).parent == copy
        assert computed == expected
    with open(copy / "_version.py", "a") as file:
        file.write("# edited\n")
    assert script(tmp_path, code, path=tmp_path)[1] == 2


def test_a_library_edited_under_a_running_process_is_not_cached(tmp_path):
    copied(tmp_path)
    code = """
        import json, lissome, warnings
        from pathlib import Path
        def f(x):
            if x == 2:
                with open(Path(lissome.__file__).with_name("_version.py"), "a") as file:
                    file.write("# edited\\n")
            return x
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            Path(lissome.__file__).touch()
            one = lissome.sweep(f, {"x": [1, 2, 3]}, "serial", "cache")
            two = lissome.sweep(f, {"x": [1]}, "serial", "cache")
        print(json.dumps([[w.category.__name__ for w in caught], len(list(Path("cache").iterdir())),
                          one["value"].tolist(), two["value"].tolist()]))
    """
    assert script(tmp_path, code, path=tmp_path) == [["CacheWarning"] * 2, 1, [1, 2, 3], [1]]


def test_workers_never_run_other_code_than_this_process(tmp_path, library):
    mine = tmp_path / "mine.py"
    mine.write_text("def g(x):\n    return x * 2\n")
    code = """
        import importlib, json, lissome, mine
        from pathlib import Path
        results = []
        def run(executor=None):
            try:
                results.append(lissome.sweep(mine.g, {"x": [1]}, executor)["value"].tolist())
            except lissome.SweepFailed as error:
                results.append(str(error))
        if __name__ == "__main__":
            run()
            Path("mine.py").write_text("def g(x):\\n    return x * 30\\n")
            run()  # neither side has read the file again
            importlib.reload(mine)
            run()  # this process has: the workers are replaced
            Path("mine.py").write_text("def g(x):\\n    return x * 400\\n")
            import loky
            loky.get_reusable_executor().shutdown(kill_workers=True)
            run()  # new workers read what this process does not know yet
            print(json.dumps(results))
    """
    first, second, third, fourth = script(tmp_path, code, path=library)
    assert (first, second, third) == ([2], [2], [30])
    assert "mine.g was edited" in fourth


ENDING = """
    import atexit, importlib, json, os, signal, sys, threading, time
    from pathlib import Path
    import loky.backend.queues as queues
    feed = queues.Queue._feed
    def slowly(*arguments):  # a thread to which the system gives no processor when it should end
        feed(*arguments)
        time.sleep(0.3)
    queues.Queue._feed = staticmethod(slowly)
    def report():
        bystanders = {"MainThread", "tqdm_monitor"}
        print(json.dumps([t.name for t in threading.enumerate() if t.name not in bystanders]))
    atexit.register(report)
    import lissome, mine
    def replaced():
        lissome.sweep(mine.g, {"x": [1]})
        Path("mine.py").write_text("def g(x):\\n    return x * 30\\n")
        importlib.reload(mine)
        Path("mine.py").write_text("def g(x):\\n    return x * 400\\n")
        try:
            lissome.sweep(mine.g, {"x": [1]})
        except lissome.SweepFailed as error:
            assert "mine.g was edited" in str(error)
    def interrupted():
        def asks_to_be_interrupted(x):
            os.kill(asker, signal.SIGINT)
            time.sleep(60)
        asker = os.getpid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            lissome.sweep(asks_to_be_interrupted, {"x": [1]})
        except KeyboardInterrupt:
            pass
    if __name__ == "__main__":
        {"replaced": replaced, "interrupted": interrupted}[sys.argv[1]]()
"""


@pytest.mark.parametrize("how", ["replaced", "interrupted"])
def test_no_thread_of_dismissed_workers_outlives_the_interpreter(tmp_path, library, how):
    # Such a thread removes semaphores; killed amid that, it makes a leak be reported on stderr.
    (tmp_path / "mine.py").write_text("def g(x):\n    return x * 2\n")
    assert script(tmp_path, ENDING, how, path=library) == []


def test_what_cannot_be_followed_is_refused_only_with_a_cache(tmp_path):
    generator = np.random.default_rng(1)

    def draws(x):
        return x + 0 * generator.random()

    def imports(x):
        import script_of_mine  # noqa: F401

        return x

    assert sweep(draws, {"x": [1.0]})["value"].tolist() == [1.0]
    with pytest.raises(InvalidInput, match=r"`cache`.*Generator.*cache=None"):
        sweep(draws, {"x": [1.0]}, cache=tmp_path)
    with pytest.raises(InvalidInput, match="import of script_of_mine"):
        sweep(imports, {"x": [1.0]}, cache=tmp_path)
    with pytest.raises(InvalidInput, match="value of <object"):
        sweep(lambda x: 1, {"x": [object()]}, cache=tmp_path)


# Faults ------------------------------------------------------------------------------------------


def fragile(x):
    if x == 3:
        raise NotConverged("residual 1e-3", history=[1.0, 1e-3])
    return 10.0 * x


@pytest.mark.parametrize("kind", ["serial", "threads", "loky"])
def test_a_failing_point_is_named_and_the_others_are_kept(kind, tmp_path):
    def local(x):
        if x == 3:
            raise NotConverged("residual 1e-3", history=[1.0, 1e-3])
        return 10.0 * x

    with concurrent.futures.ThreadPoolExecutor(2) as threads:
        executor = {"serial": "serial", "threads": threads, "loky": None}[kind]
        with pytest.raises(SweepFailed, match=r"x=3 failed with NotConverged: residual") as caught:
            lissome.sweep(local, {"x": range(5)}, executor, tmp_path)
        assert caught.value.point == {"x": 3}
        cause = caught.value.__cause__
        assert isinstance(cause, NotConverged)
        assert cause.history == [1.0, 1e-3]
        finished = caught.value.finished
        assert set(finished["x"]) >= {0, 1, 2}
        assert (finished["value"] == 10.0 * finished["x"]).all()

        frame = lissome.sweep(local, {"x": range(5)}, executor, tmp_path, on_error="record")
    assert frame["error"].tolist() == [None] * 3 + ["NotConverged: residual 1e-3", None]
    assert frame["value"].isna().tolist() == [False] * 3 + [True, False]
    assert frame.attrs["sweep"]["cached"] == len(finished)
    assert frame.attrs["sweep"]["failed"] == 1


def test_failures_are_not_stored(tmp_path):
    for _ in range(2):
        frame = sweep(fragile, {"x": [3, 4]}, cache=tmp_path, on_error="record")
        assert frame.attrs["sweep"]["failed"] == 1
    assert frame.attrs["sweep"]["cached"] == 1


def test_exceptions_that_cannot_be_pickled_are_reported(tmp_path):
    def stubborn(x):
        class Local(Exception):
            def __reduce__(self):
                raise TypeError("no")

        raise Local("deep trouble")

    with pytest.raises(SweepFailed, match="Local: deep trouble") as caught:
        lissome.sweep(stubborn, {"x": [1, 2]})
    assert "deep trouble" in str(caught.value.__cause__)


@pytest.mark.parametrize(
    "returned",
    [
        object(),
        [1, 2],
        np.zeros(3),
        {"a": [1]},
        {"a": np.array([object()])},
        {1: 2.0},
        {"": 1},
        {"x": 1},
        {"error": 1},
        np.longdouble(1),
        {"a": {1}},
        pd.DataFrame({"a": [1, "b"]}),
        pd.DataFrame({"a": ["b", None]}),
        pd.DataFrame({"x": [1]}),
        pd.Series([1.0]),
    ],
    ids=lambda value: repr(value).partition(" at 0x")[0],
)
def test_results_that_no_table_holds_are_refused(returned):
    with pytest.raises(SweepFailed) as caught:
        sweep(lambda x: returned, {"x": [1]})
    assert isinstance(caught.value.__cause__, InvalidInput)


def test_points_that_return_different_names_are_refused():
    with pytest.raises(SweepFailed, match=r"x=2 returned .*'b'.* x=1 returned .*'a'"):
        sweep(lambda x: {"a": 1} if x == 1 else {"b": 1}, {"x": [1, 2]})


INTERRUPTED = """
    import os, signal, sys, time, lissome
    from pathlib import Path
    def slow(n):
        if n == int(sys.argv[1]):
            Path("reached").write_text("")
            time.sleep(60)
        with open("log", "a") as log:
            log.write(f"{n}\\n")
        return {"square": n * n, "twice": 2 * n}
    if __name__ == "__main__":
        # Whoever runs the tests in the background may have told all children to ignore SIGINT.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        frame = lissome.sweep(slow, {"n": range(8)}, EXECUTOR, "cache")
        print(frame.attrs["sweep"]["computed"], frame["square"].tolist())
"""


@pytest.mark.parametrize("executor", ['"serial"', "None"])
@pytest.mark.parametrize("how", ["SIGKILL", "SIGINT"])
def test_an_interrupted_sweep_goes_on_where_it_was(tmp_path, library, how, executor):
    # `sys.argv` is read inside: it is no part of the key.
    code = INTERRUPTED.replace("EXECUTOR", executor)
    (tmp_path / "script.py").write_text(textwrap.dedent(code))

    def start(stop_at):
        return subprocess.Popen(
            [sys.executable, "script.py", str(stop_at)],
            cwd=tmp_path,
            env={**environment(library), "LOKY_MAX_CPU_COUNT": "2"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    process = start(5)
    deadline = time.monotonic() + 60
    while not (tmp_path / "reached").exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    stored = 5 if executor == '"serial"' else 7
    while len(list(tmp_path.glob("cache/*.json"))) < stored:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.killpg(process.pid, getattr(signal, how))
    process.communicate(timeout=30)
    assert process.returncode != 0
    assert not list(tmp_path.glob("cache/*.tmp"))

    process = start(-1)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert out.split(maxsplit=1)[0] == str(8 - stored)
    assert out.split(maxsplit=1)[1].strip() == str([n * n for n in range(8)])
    log = [int(line) for line in (tmp_path / "log").read_text().split()]
    assert sorted(log) == list(range(8))  # no point twice


ORPHANS = """
    import os, time, lissome
    def slow(n):
        with open(f"worker-{os.getpid()}", "w"):
            time.sleep(600)
    lissome.sweep(slow, {"n": [1, 2]})
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes of this system know no parent")
def test_workers_end_with_the_process_that_asked_for_them(tmp_path, library):
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(ORPHANS)],
        cwd=tmp_path,
        env={**environment(library), "LOKY_MAX_CPU_COUNT": "2"},
    )
    deadline = time.monotonic() + 120
    while len(workers := list(tmp_path.glob("worker-*"))) < 2:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.kill()  # no chance to tell them
    process.wait()
    for path in workers:
        while runs(int(path.name.removeprefix("worker-"))):
            assert time.monotonic() < deadline, "a worker goes on for nobody"
            time.sleep(0.05)


def runs(process):
    """Tell whether a process runs; one that has ended and whose parent has not asked does not."""
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat")
        return not state.is_file() or state.read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_a_worker_that_dies_is_reported_and_the_finished_points_are_kept(tmp_path):
    folder = str(tmp_path)

    def mortal(n):
        import os
        import time

        while n == 3:  # die when all others are stored
            time.sleep(0.05)
            if sum(name.endswith(".json") for name in os.listdir(folder)) == 3:
                os._exit(1)
        return n

    with pytest.raises(SweepFailed, match=r"(?s)worker process died.*stored; run again") as caught:
        lissome.sweep(mortal, {"n": [0, 1, 2, 3]}, cache=tmp_path)
    assert caught.value.finished["value"].tolist() == [0, 1, 2]
    frame = lissome.sweep(mortal, {"n": [0, 1, 2, 4]}, cache=tmp_path)
    assert frame.attrs["sweep"] == {"points": 4, "computed": 1, "cached": 3, "failed": 0}


def test_functions_that_an_executor_cannot_send_are_reported():
    # Other tests have left threads in this process: a fork of it could wait for a lock for ever.
    spawn = multiprocessing.get_context("spawn")
    processes = concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn)
    with processes, pytest.raises(SweepFailed, match=r"could not be sent.*executor=None"):
        lissome.sweep(lambda x: x, {"x": [1]}, processes)
    with pytest.raises(SweepFailed, match="shutdown"):
        lissome.sweep(lambda x: x, {"x": [1]}, processes)


DAMAGES = {
    "empty": lambda data: b"",
    "cut": lambda data: data[: len(data) // 2],
    "one digit": lambda data: data.replace(b"1.75", b"1.76"),
    "one bit": lambda data: data[:-40] + bytes([data[-40] ^ 1]) + data[-39:],
    "a list": lambda data: b"[1]",
    "a number": lambda data: b"1",
    "not text": lambda data: b"\xff\xfe" * 50,
}


@pytest.mark.parametrize("suffix", [".json", ".npz"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_entries_are_computed_anew_with_one_warning(tmp_path, damage, suffix):
    def work(x):
        return {"y": 1.75 * x, "curve": np.array([1.0, x])}

    fresh = sweep(work, {"x": [1.0, 2.0, 3.0]}, cache=tmp_path)
    files = sorted(tmp_path.glob(f"*{suffix}"))
    changed = 0
    for path in files[:2] if damage != "one digit" else files:
        data = path.read_bytes()
        path.write_bytes(DAMAGES[damage](data))
        changed += path.read_bytes() != data
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        again = sweep(work, {"x": [1.0, 2.0, 3.0]}, cache=tmp_path)
    assert same(fresh, again)
    assert again.attrs["sweep"]["computed"] == changed
    assert [w.category for w in caught] == [CacheWarning] * (changed > 0)
    assert all(w.filename == __file__ for w in caught)
    assert sweep(work, {"x": [1.0, 2.0, 3.0]}, cache=tmp_path).attrs["sweep"]["cached"] == 3


def test_arrays_that_are_missing_or_of_another_point_are_computed_anew(tmp_path):
    def work(x):
        return {"curve": np.array([1.0, x])}

    fresh = sweep(work, {"x": [1.0, 2.0]}, cache=tmp_path)
    one, two = sorted(tmp_path.glob("*.npz"))
    one.write_bytes(two.read_bytes())
    two.unlink()
    with pytest.warns(CacheWarning, match=r"2 stored point\(s\)"):
        again = sweep(work, {"x": [1.0, 2.0]}, cache=tmp_path)
    assert same(fresh, again)


def test_an_entry_under_a_wrong_name_is_not_believed(tmp_path):
    sweep(lambda x: x, {"x": [1.0, 2.0]}, cache=tmp_path)
    one, two = sorted(tmp_path.glob("*.json"))
    one.write_bytes(two.read_bytes())
    with pytest.warns(CacheWarning, match="another point"):
        frame = sweep(lambda x: x, {"x": [1.0, 2.0]}, cache=tmp_path)
    assert frame["value"].tolist() == [1.0, 2.0]


def test_files_are_json_and_npz_without_pickles(tmp_path):
    sweep(make_work(), GRID, cache=tmp_path)
    assert {path.suffix for path in tmp_path.iterdir()} == {".json", ".npz"}
    for path in tmp_path.glob("*.json"):
        entry = json.loads(path.read_text())["entry"]
        assert set(entry["point"]) == {"a", "b"}
    for path in tmp_path.glob("*.npz"):
        with np.load(path, allow_pickle=False) as arrays:
            assert len(arrays.files) == 2


def test_a_cache_that_cannot_be_written_is_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file", tmp_path / "file" / "below", "a\0b"):
        with pytest.raises(InvalidInput, match="argument `cache`"):
            sweep(lambda x: pytest.fail("called"), {"x": [1]}, cache=place)
    with pytest.raises(InvalidInput, match="argument `cache` is 3"):
        sweep(lambda x: x, {"x": [1]}, cache=3)


def test_a_disk_that_fills_up_gives_one_warning_and_all_results(tmp_path, monkeypatch):
    real = Path.write_bytes

    def write_bytes(self, data):
        if self.suffix == ".tmp":
            real(self, data[:10])
            raise OSError(28, "No space left on device")
        return real(self, data)

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    with pytest.warns(CacheWarning, match="No space left") as caught:
        frame = sweep(lambda x: x, {"x": [1, 2, 3]}, cache=tmp_path)
    assert frame["value"].tolist() == [1, 2, 3]
    assert len(caught) == 1
    assert list(tmp_path.iterdir()) == []


# Grids -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ({}, "holds no point"),
        ([], "holds no point"),
        ({"x": []}, "holds no point"),
        (pd.DataFrame({"x": []}), "holds no point"),
        (3, "argument `grid` is 3"),
        ("x", "argument `grid` is 'x'"),
        (None, "argument `grid` is None"),
        ([1], r"`grid`\[0\] is 1"),
        ({"x": 1.0}, "list of one"),
        ({"x": "abc"}, "list of one"),
        ({"x": {1, 2}}, "list"),
        ({"x": {"a": 1}}, "list"),
        ({"x": np.zeros((2, 2))}, "shape"),
        ({"x": [float("nan")]}, "parameter `x` of point 0 is nan"),
        ({"x": [1.0, np.float64("nan")]}, "parameter `x` of point 1 is nan"),
        (pd.DataFrame({"x": [1.0, None]}), "point 1"),
        ({"y": [1]}, "signature"),
        ({"x": [1], "y": [2]}, "signature"),
        ({1: [1]}, "identifiers"),
        ({"not a name": [1]}, "identifiers"),
        ({"error": [1]}, "identifiers"),
        ([{"x": 1}, {"y": 1}], r"`grid`\[1\]"),
        ([{"x": 1}, {"x": 1, "y": 1}], r"`grid`\[1\]"),
        (pd.DataFrame([[1, 2]], columns=["x", "x"]), "equal names"),
    ],
)
def test_bad_grids_are_refused_before_any_work(grid, message):
    with pytest.raises(InvalidInput, match=message):
        sweep(lambda x: pytest.fail("called"), grid)


def test_other_bad_arguments():
    with pytest.raises(InvalidInput, match="`function` is 3"):
        sweep(3, {"x": [1]})
    for executor in ("parallel", 4, object()):
        with pytest.raises(InvalidInput, match="argument `executor` is"):
            lissome.sweep(fragile, {"x": [1]}, executor)
    with pytest.raises(InvalidInput, match="`on_error` is 'ignore'"):
        sweep(fragile, {"x": [1]}, on_error="ignore")


values = st.one_of(
    st.integers(), st.floats(allow_nan=False), st.booleans(), st.text(max_size=3), st.none()
)


@settings(deadline=None, max_examples=40)
@given(st.dictionaries(st.sampled_from("abc"), st.lists(values, min_size=1, max_size=3)))
def test_any_grid_comes_back_from_the_cache_as_it_was(tmp_path_factory, grid):
    if not grid:
        return
    folder = tmp_path_factory.mktemp("sweep")
    fresh = sweep(lambda **point: {f"same_{n}": v for n, v in point.items()}, grid, cache=folder)
    assert len(fresh) == np.prod([len(axis) for axis in grid.values()])
    cached = sweep(lambda **point: {f"same_{n}": v for n, v in point.items()}, grid, cache=folder)
    assert cached.attrs["sweep"]["computed"] == 0
    assert same(fresh, cached)
    for name in grid:
        assert same(fresh[[name]], fresh[[f"same_{name}"]].set_axis([name], axis=1))
