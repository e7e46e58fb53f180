"""Compiled kernels: never stale, shared between processes, right without a cache.

Every case runs in processes of its own, on a small package in a temporary folder that is compiled
by the same machinery as the library (``make_jit`` pointed at it).
"""

import hashlib
import json
import os
import pickle
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from lissome import _compile
from lissome._compile import fingerprint, jit

COMPILER = "from pathlib import Path\nfrom lissome._compile import make_jit\n"
SOURCES = {
    "__init__.py": COMPILER + "jit = make_jit(Path(__file__).parent)\n",
    "constants.py": "SCALE = 2.0\nOFFSETS = (1.0, 2.0)\n",
    "callee.py": """
        from . import jit
        @jit
        def deep(x):
            return x * 10.0
    """,
    "kernels.py": """
        import numpy as np
        from . import callee, constants, jit
        from .callee import deep

        @jit
        def plain(x):
            return x + 0.5

        @jit
        def by_module(x):
            return callee.deep(x) + constants.SCALE

        @jit
        def by_name(x):
            return deep(x)

        @jit
        def twice_removed(x):
            return by_name(x)

        def close(function, factor):
            @jit
            def closure(x):
                return function(x) * factor
            return closure

        over_deep = close(deep, 2.0)
        over_plain = close(plain, 3.0)

        @jit
        def apply(function, x):
            return function(x) + 1.0

        @jit
        def both(x):
            return over_deep(x) - over_plain(x)

        @jit
        def factorial(n):
            return 1 if n < 2 else n * factorial(n - 1)
    """,
    "first_class.py": """
        import warnings
        from numba import float64, types
        from numba.core.errors import NumbaExperimentalFeatureWarning
        from . import jit
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)

        @jit([float64(types.FunctionType(float64(float64)), float64)])
        def apply_pointer(function, x):
            return function(x) + 1.0
    """,
}
CALLS = """
    import json, sys, warnings
    warnings.simplefilter("ignore")
    from tiny import kernels as k, callee, first_class
    results = {
        "plain": k.plain(1.0),
        "by_module": k.by_module(1.0),
        "by_name": k.by_name(1.0),
        "twice_removed": k.twice_removed(1.0),
        "over_deep": k.over_deep(1.0),
        "over_plain": k.over_plain(1.0),
        "apply": [k.apply(k.plain, 1.0), k.apply(callee.deep, 1.0), k.apply(k.over_deep, 1.0)],
        "both": k.both(1.0),
        "factorial": k.factorial(5),
    }
    hits = {name: [sum(getattr(k, name).stats.cache_hits.values()),
                   sum(getattr(k, name).stats.cache_misses.values())] for name in results}
    pointer = first_class.apply_pointer
    results["apply_pointer"] = [pointer(k.plain, 1.0), pointer(k.over_deep, 1.0)]
    hits["apply_pointer"] = [sum(pointer.stats.cache_hits.values()),
                             sum(pointer.stats.cache_misses.values())]
    print(json.dumps([results, hits]))
"""
RESULTS = {
    "plain": 1.5,
    "by_module": 12.0,
    "by_name": 10.0,
    "twice_removed": 10.0,
    "over_deep": 20.0,
    "over_plain": 4.5,
    "apply": [2.5, 11.0, 21.0],
    "both": 15.5,
    "factorial": 120,
    "apply_pointer": [2.5, 21.0],
}


class Tiny:
    """A small package and a cache folder, and processes that use them."""

    def __init__(self, folder):
        self.folder = folder
        self.package = folder / "tiny"
        self.cache = folder / "cache"
        self.package.mkdir()
        for name, text in SOURCES.items():
            (self.package / name).write_text(textwrap.dedent(text))

    def edit(self, name, old, new):
        path = self.package / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    def environment(self, **changes):
        source = str(Path(_compile.__file__).parents[1])
        path = os.pathsep.join([str(self.folder), source])
        keep = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "LISSOME_"))}
        values = {**keep, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
        values |= {"LISSOME_CACHE": str(self.cache), **changes}
        return {name: value for name, value in values.items() if value is not None}

    def start(self, code=CALLS, **changes):
        return subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(code)],
            env=self.environment(**changes),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, code=CALLS, **changes):
        process = self.start(code, **changes)
        out, err = process.communicate()
        assert process.returncode == 0, err
        return json.loads(out.splitlines()[-1])

    def entries(self):
        return sorted((self.cache / "compiled").glob("*.bin"))


@pytest.fixture
def tiny(tmp_path):
    return Tiny(tmp_path)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    first = Tiny(tmp_path_factory.mktemp("compiled"))
    assert first.run()[0] == RESULTS
    return first


@pytest.fixture
def known(tiny, compiled):
    """The small package with all its machine code in the cache; its place is not in the keys."""
    shutil.copytree(compiled.cache, tiny.cache)
    return tiny


def hit(names, hits):
    return {name: hits[name][1] == 0 and hits[name][0] > 0 for name in names}


def test_every_kind_of_function_hits_in_a_second_process_and_edits_reach_all_callers(tiny):
    results, hits = tiny.run()
    assert results == RESULTS
    assert not any(hit(RESULTS, hits).values())

    results, hits = tiny.run()
    assert results == RESULTS
    assert all(hit(RESULTS, hits).values()), hits

    # A callee in another file: everything that reaches it is compiled anew, nothing else is.
    tiny.edit("callee.py", "x * 10.0", "x * 100.0")
    results, hits = tiny.run()
    changed = {
        "by_module": 102.0,
        "by_name": 100.0,
        "twice_removed": 100.0,
        "over_deep": 200.0,
        "apply": [2.5, 101.0, 201.0],
        "both": 195.5,
        "apply_pointer": [2.5, 201.0],
    }
    assert results == {**RESULTS, **changed}
    untouched = {"plain", "over_plain", "factorial", "apply_pointer"}
    assert hit(RESULTS, hits) == {name: name in untouched for name in RESULTS}
    assert hits["apply"] == [1, 2]

    # A constant of another module, and a value in a closure.
    tiny.edit("constants.py", "SCALE = 2.0", "SCALE = 3.0")
    tiny.edit("kernels.py", "close(plain, 3.0)", "close(plain, 4.0)")
    results, hits = tiny.run()
    assert results["by_module"] == 103.0
    assert results["over_plain"] == 6.0
    assert results["both"] == 194.0
    missed = {name for name, found in hit(RESULTS, hits).items() if not found}
    assert missed == {"by_module", "over_plain", "both"}

    # Back to the first text: its machine code is still there.
    tiny.edit("callee.py", "x * 100.0", "x * 10.0")
    tiny.edit("constants.py", "SCALE = 3.0", "SCALE = 2.0")
    tiny.edit("kernels.py", "close(plain, 4.0)", "close(plain, 3.0)")
    results, hits = tiny.run()
    assert results == RESULTS
    assert all(hit(RESULTS, hits).values()), hits


def test_comments_and_moves_recompile_nothing(known):
    known.edit("kernels.py", "@jit\ndef plain", "# a remark\n\n\n@jit\ndef plain")
    _, hits = known.run()
    assert all(hit(RESULTS, hits).values()), hits


def test_options_and_settings_are_part_of_the_key(known):
    known.edit("kernels.py", "@jit\ndef plain", "@jit(fastmath=True)\ndef plain")
    _, hits = known.run()
    found = hit(RESULTS, hits)
    assert not found["plain"]
    assert not found["over_plain"]
    assert found["by_name"]
    _, hits = known.run(NUMBA_BOUNDSCHECK="1")
    assert not any(hit(RESULTS, hits).values())


def test_an_extension_of_numba_in_the_package_is_part_of_every_key(known):
    (known.package / "extras.py").write_text("from numba import extending\n")
    _, hits = known.run()
    assert not any(hit(RESULTS, hits).values())


def test_closures_from_two_processes_keep_their_own_code(tiny):
    # Both come from one factory, each was the first function compiled in its process: numba's own
    # symbols for them are equal, and linking them together would take one for the other.
    code = """
        import json
        from tiny.kernels import over_deep, over_plain, both
        print(json.dumps({}))
    """
    for call in ("over_deep(1.0)", "over_plain(1.0)"):
        tiny.run(code.format(call))
    assert tiny.run(code.format("[over_deep(1.0), over_plain(1.0), both(1.0)]")) == [20, 4.5, 15.5]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data, path: b"",
        lambda data, path: data[: len(data) // 2],
        lambda data, path: b"rubbish" * 1000,
        lambda data, path: data[:-100] + bytes(b ^ 0x55 for b in data[-100:]),
        lambda data, path: data[:400] + bytes([data[400] ^ 1]) + data[401:],
        lambda data, path: sealed(path, b"not a pickle"),
        lambda data, path: sealed(path, pickle.dumps(("some", "other", "content"))),
        lambda data, path: sealed(path.with_name("another.bin"), data[HEAD:]),
    ],
    ids=[
        "empty",
        "truncated",
        "rubbish",
        "tail",
        "one bit",
        "unreadable",
        "other content",
        "another name",
    ],
)
def test_damaged_entries_are_compiled_anew(tiny, filled, damage):
    tiny.cache = tiny.folder / "copy"
    shutil.copytree(filled.cache, tiny.cache)
    for path in tiny.entries():
        path.write_bytes(damage(path.read_bytes(), path))
    assert tiny.run(BY_MODULE) == [12.0, 0]
    assert len(tiny.entries()) == len(filled.entries())
    for path in tiny.entries():  # whole again
        data = path.read_bytes()
        assert data == sealed(path, data[HEAD:])


BY_MODULE = """
    import json
    from tiny.kernels import by_module as f
    print(json.dumps([f(1.0), sum(f.stats.cache_hits.values())]))
"""


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    filled = Tiny(tmp_path_factory.mktemp("filled"))
    assert filled.run(BY_MODULE) == [12.0, 0]
    assert filled.run(BY_MODULE) == [12.0, 1]
    return filled


HEAD = len(_compile._MAGIC) + 32


def sealed(path, payload):
    digest = hashlib.sha256(path.name.encode() + b"\0" + payload).digest()
    return _compile._MAGIC + digest + payload


class Bomb:
    """A pickle that leaves a mark when it is loaded."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __reduce__(self):
        return open, (self.mark, "w")


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files of this system have no mode")
@pytest.mark.parametrize("whose", ["ours alone", "our group's", "another user's"])
def test_an_entry_that_another_user_could_have_written_is_not_loaded(tiny, filled, whose):
    """A pickle runs code when it is loaded: one that is only ours does, others are replaced."""
    tiny.cache = tiny.folder / "copy"
    shutil.copytree(filled.cache, tiny.cache)
    mark = tiny.folder / "mark"
    entries = tiny.entries()
    for path in entries:
        path.write_bytes(sealed(path, pickle.dumps(Bomb(mark))))
        path.chmod(0o664 if whose == "our group's" else 0o644)
        if whose == "another user's":
            if os.geteuid() != 0:
                pytest.skip("only root gives files away")
            os.chown(path, 12345, -1)
    assert tiny.run(BY_MODULE) == [12.0, 0]
    assert mark.exists() == (whose == "ours alone")
    for path in entries:
        status = path.stat()
        assert status.st_uid == os.geteuid() and not status.st_mode & 0o022


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_in_the_place_of_an_entry_blocks_nobody(tiny, filled):
    tiny.cache = tiny.folder / "copy"
    shutil.copytree(filled.cache, tiny.cache)
    for path in tiny.entries():
        path.unlink()
        os.mkfifo(path, 0o600)
    assert tiny.run(BY_MODULE) == [12.0, 0]
    assert all(path.is_file() for path in tiny.entries())


@pytest.mark.skipif(not hasattr(os, "umask"), reason="files of this system have no mode")
def test_entries_are_written_by_us_alone_whatever_the_umask(tiny):
    assert tiny.run("import os; os.umask(0)\n" + textwrap.dedent(BY_MODULE)) == [12.0, 0]
    assert {path.stat().st_mode & 0o022 for path in tiny.entries()} == {0}
    assert tiny.run(BY_MODULE) == [12.0, 1]


WARNINGS = """
    import json, warnings
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        from tiny import kernels as k
        results = [k.plain(1.0), k.by_module(1.0), k.both(1.0), k.apply(k.plain, 1)]
    from lissome.errors import CacheWarning
    print(json.dumps([results, [str(w.message) for w in caught if w.category is CacheWarning],
                      k.plain.stats.cache_path]))
"""


@pytest.mark.parametrize("kind", ["below a file", "in a file system of the kernel"])
def test_a_folder_that_cannot_be_written_gives_one_warning_and_right_numbers(tiny, kind):
    if kind == "below a file":
        (tiny.folder / "file").write_text("")
        place = tiny.folder / "file" / "cache"
    else:
        place = Path("/proc/self/nowhere")
        if not Path("/proc/self").exists():
            pytest.skip("this system has no /proc")
    results, messages, path = tiny.run(WARNINGS, LISSOME_CACHE=str(place))
    assert results == [1.5, 12.0, 15.5, 2.5]
    assert len(messages) == 1
    assert str(place) in messages[0]
    assert "LISSOME_CACHE" in messages[0]
    assert path is None


def test_a_full_disk_gives_one_warning_and_right_numbers(tiny):
    pytest.importorskip("resource", reason="this system has no limits for files")
    full = """
        import resource
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # writing fails in the middle
    """
    results, messages, _ = tiny.run(textwrap.dedent(full) + textwrap.dedent(WARNINGS))
    assert results == [1.5, 12.0, 15.5, 2.5]
    assert len(messages) == 1
    assert "File too large" in messages[0]
    assert "LISSOME_CACHE" in messages[0]
    assert list((tiny.cache / "compiled").iterdir()) == []


def test_default_folders(tiny):
    code = """
        import json
        from tiny.kernels import plain
        plain(1.0)
        print(json.dumps(plain.stats.cache_path))
    """
    user = tiny.folder / "user"
    variables = {"LISSOME_CACHE": None, "XDG_CACHE_HOME": str(user), "HOME": str(user)}
    numba_dir = str(tiny.folder / "numba")
    chosen = tiny.run(code, **variables, NUMBA_CACHE_DIR=numba_dir)
    assert chosen == str(Path(numba_dir, "lissome", "compiled"))
    chosen = tiny.run(code, **variables)
    assert Path(chosen).parts[-2:] == ("lissome", "compiled")
    assert Path(chosen).is_relative_to(user)
    # The user's folder cannot be written: the package's own takes its place, without a warning.
    blocked = tiny.folder / "blocked"
    blocked.write_text("")
    variables = {"LISSOME_CACHE": None, "XDG_CACHE_HOME": str(blocked), "HOME": str(blocked)}
    results, messages, path = tiny.run(WARNINGS, **variables)
    assert messages == []
    assert Path(path).is_relative_to(tiny.package)
    # Nor the package's: uncached.
    (tiny.package / "__pycache__").rename(tiny.folder / "moved")
    (tiny.package / "__pycache__").write_text("")
    results, messages, path = tiny.run(WARNINGS, **variables)
    assert results == [1.5, 12.0, 15.5, 2.5]
    assert len(messages) == 1


def test_processes_at_the_same_time_share_one_folder(tiny):
    processes = [tiny.start() for _ in range(3)]
    for process in processes:
        out, err = process.communicate()
        assert process.returncode == 0, err
        assert json.loads(out)[0] == RESULTS
    assert not list((tiny.cache / "compiled").glob("*.tmp"))
    _, hits = tiny.run()
    assert all(hit(RESULTS, hits).values())


def test_functions_outside_the_package_are_fingerprinted_too(tiny):
    code = """
        import json
        from tiny import kernels as k, jit
        FACTOR = {factor}
        @jit
        def mine(x):
            return k.by_module(x) * FACTOR
        print(json.dumps([mine(1.0), sum(mine.stats.cache_hits.values())]))
    """
    assert tiny.run(code.format(factor="2.0")) == [24.0, 0]
    assert tiny.run(code.format(factor="2.0")) == [24.0, 1]
    assert tiny.run(code.format(factor="3.0")) == [36.0, 0]
    tiny.edit("callee.py", "10.0", "20.0")
    assert tiny.run(code.format(factor="3.0")) == [66.0, 0]


def test_the_folder_keeps_within_its_budget(tiny):
    code = """
        import json, os
        import lissome._compile as c
        from tiny import kernels as k
        k.plain(1.0)
        folder = c.Path(k.plain.stats.cache_path)
        for number in range(10):
            old = folder / f"old-{number}.bin"
            old.write_bytes(bytes(10000))
            os.utime(old, (number, number))
        c._BUDGET = 90000
        for store in c._stores.values():
            store._pruned = False
        k.by_name(1.0)
        print(json.dumps(sorted(p.name for p in folder.iterdir())))
    """
    names = tiny.run(code)
    sizes = [(tiny.cache / "compiled" / name).stat().st_size for name in names]
    assert sum(sizes) <= 90000
    assert any("plain" in name for name in names)
    assert any("by_name" in name for name in names)
    kept = [number for number in range(10) if f"old-{number}.bin" in names]
    assert 0 < len(kept) < 10
    assert kept == list(range(10 - len(kept), 10))  # the least recently used went


def test_without_jit_the_python_function_runs(tiny):
    code = """
        import json
        from tiny.kernels import both, plain
        print(json.dumps([both(1.0), type(plain).__name__]))
    """
    assert tiny.run(code, NUMBA_DISABLE_JIT="1") == [15.5, "function"]


# In this process ---------------------------------------------------------------------------------


@jit
def square(x):
    """Square."""
    return x * x


@jit
def total(function, values):
    s = 0.0
    for v in values:
        s += function(v)
    return s


def make_power(n):
    @jit
    def power(x):
        return x**n

    return power


def helper(x):
    return x


def test_decorator_forms():
    assert jit(lambda x: x + 1)(1) == 2
    assert jit(fastmath=True)(lambda x: x + 1)(1) == 2
    typed = jit("float64(float64)")(lambda x: x + 1)
    assert typed(1) == 2.0
    assert [str(s.return_type) for s in typed.nopython_signatures[:1]] == ["float64"]
    several = jit(["int64(int64)", "float64(float64)"])(lambda x: x + 1)
    assert type(several(1)) is int
    assert type(several(1.0)) is float
    assert square.__name__ == "square"
    assert square.__doc__ == "Square."


@pytest.mark.parametrize("option", ["cache", "nopython", "forceobj", "pipeline_class"])
def test_options_that_it_sets_itself_are_refused(option):
    with pytest.raises(TypeError, match=option):
        jit(**{option: True})


@pytest.mark.parametrize("wrong", [len, 3, square])
def test_only_python_functions_are_compiled(wrong):
    with pytest.raises(TypeError, match="jit"):
        jit(wrong)


def test_functions_as_arguments_and_closures():
    values = np.array([1.0, 2.0, 3.0])
    assert total(square, values) == 14.0
    assert total(make_power(3), values) == 36.0
    assert total(make_power(1), values) == 6.0


def test_fingerprint_tells_content():
    assert fingerprint(make_power(2)) == fingerprint(make_power(2))
    assert fingerprint(make_power(2)) != fingerprint(make_power(3))
    # Equal in Python, but not to a compiler.
    assert len({fingerprint(make_power(n)) for n in (1, 1.0, True, 0.0, -0.0, 1 + 0j)}) == 6
    assert fingerprint(make_power(np.arange(3.0))) != fingerprint(make_power(np.arange(3)))
    assert fingerprint(jit(fastmath=True)(square.py_func)) != fingerprint(square)


def test_what_cannot_be_told_has_no_fingerprint_and_is_not_stored():
    assert fingerprint(make_power(object())) is None
    assert fingerprint(make_power(helper)) is None
    generator = np.random.default_rng(1)
    draw = jit(lambda: generator.random())
    assert fingerprint(draw) is None


def test_pickling_is_by_name_where_possible_else_by_value():
    import cloudpickle

    assert pickle.loads(pickle.dumps(square)) is square
    power = make_power(3)
    copy = cloudpickle.loads(cloudpickle.dumps(power))
    assert copy(2.0) == 8.0
    assert fingerprint(copy) == fingerprint(power)
