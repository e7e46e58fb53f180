"""tools/bench.py: ratios to what each time is held against; anything unclear is refused."""

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
    }


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
