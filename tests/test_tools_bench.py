"""tools/bench.py: ratios to what each time is held against; anything unclear is refused."""

import subprocess

import pytest


def entry(what, median, group="g", **info):
    named = {"what": what, "against": None, "at_most": None, "at_least": None, "note": ""} | info
    stats = {"median": median, "q1": median, "q3": median, "rounds": 3}
    return {"name": what, "group": group, "extra_info": named, "stats": stats}


@pytest.fixture
def bench(tools):
    import bench

    return bench


def test_ratios(bench):
    rows = bench.summary(
        {
            "benchmarks": [
                entry("floor", 2e-6),
                entry("step", 8e-6, against="floor", at_most=5),
                entry("slow step", 12e-6, against="floor", at_most=5),
                entry("peer", 2e-3),
                entry("fast step", 1e-6, against="peer", at_least=1000),
                entry("lame step", 4e-6, against="peer", at_least=1000),
                entry("told only", 1e-3, against="peer"),
                entry("in time", 0.9, within=1.0),
                entry("late", 1.1, within=1.0),
            ]
        }
    )
    found = {row["what"]: (row["ratio"], row["met"]) for row in rows}
    assert found == {
        "floor": (None, None),
        "step": (pytest.approx(4), True),
        "slow step": (pytest.approx(6), False),
        "peer": (None, None),
        "fast step": (pytest.approx(2000), True),
        "lame step": (pytest.approx(500), False),
        "told only": (pytest.approx(0.5), None),
        "in time": (None, True),
        "late": (None, False),
    }
    lines = {row["what"]: bench.line(row) for row in rows}
    assert lines["slow step"] == "g: slow step: 1.2e-05 s, 6 of floor (at most 5: MISSED)"
    assert lines["fast step"].endswith("2e+03 times faster than peer (at least 1000: met)")
    assert lines["told only"] == "g: told only: 0.001 s, 0.5 of peer"
    assert lines["late"] == "g: late: 1.1 s (within 1 s: MISSED)"
    assert lines["floor"] == "g: floor: 2e-06 s"


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([entry("step", 1.0, against="floor", at_most=5)], "not measured in 'g'"),
        (
            [entry("floor", 1.0, "h"), entry("step", 1.0, against="floor", at_most=5)],
            "not measured in 'g'",
        ),
        ([entry("a", 1.0), entry("a", 2.0)], "two benchmarks"),
        ([entry("a", 1.0) | {"extra_info": {}}], "does not call `measure`"),
    ],
)
def test_unclear_measurements_are_refused(bench, entries, words):
    with pytest.raises(SystemExit, match=words):
        bench.summary({"benchmarks": entries})


def test_fingerprint_follows_the_sources(bench, tmp_path):
    source = tmp_path / "src" / "a.py"
    source.parent.mkdir()
    source.write_text("x = 1\n")
    first = bench.fingerprint(tmp_path)
    assert bench.fingerprint(tmp_path) == first
    source.write_text("x = 2\n")
    second = bench.fingerprint(tmp_path)
    source.rename(source.with_name("b.py"))
    assert len({first, second, bench.fingerprint(tmp_path)}) == 3


def test_names_of_the_machine_are_found(bench):
    assert bench.processor()
    assert bench.commit()


def test_results_of_an_earlier_run_are_no_change_of_the_commit(bench, tmp_path):
    assert bench.commit(tmp_path) == "unknown"

    def git(*command):
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *who, *command], cwd=tmp_path, check=True, capture_output=True)

    results, source = tmp_path / "benchmarks" / "results.json", tmp_path / "a.py"
    results.parent.mkdir()
    results.write_text("{}")
    source.write_text("x = 1")
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    name = bench.commit(tmp_path)
    assert len(name) == 12
    results.write_text("{ }")
    assert bench.commit(tmp_path) == name
    source.write_text("x = 2")
    assert bench.commit(tmp_path) == f"{name}-dirty"
