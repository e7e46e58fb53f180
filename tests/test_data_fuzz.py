"""Whatever stands in a file of data: a table that obeys its description, or a clear error.

The same for the description itself, and for digitized points and projects that come from elsewhere.
"""

import contextlib
import copy
import csv
import io
import json
import math
import subprocess
import sys
import tarfile
import textwrap
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lissome import literature
from lissome._datapackage import digest, parse_csv
from lissome.errors import DataError, InvalidInput, LissomeError

PATH = Path("some.csv")
FIELDS = [
    {"name": "series", "type": "string", "constraints": {"enum": ["a", "b"], "required": True}},
    {"name": "x", "type": "number", "unit": "mm", "constraints": {"minimum": 0, "maximum": 9}},
    {"name": "note", "type": "string"},
]
SCHEMA = {"fields": FIELDS}
FORMULAS = ["=1+1", "=cmd|' /C calc'!A0", "+1", "-2+3", "@SUM(1)", "\t=1", "__import__('os')"]
cells = st.one_of(
    st.sampled_from(
        ["a", "b", "", "0", "9", "1e400", "1e-400", "nan", "inf", "-inf", "1,5", "٣", "1_0"]
    ),
    st.sampled_from(
        ["0x10", " 1", "1 ", "\u00a01", "1\u2009", "\ufeff1", "\x00", '"', "1\r", *FORMULAS]
    ),
    st.floats().map(repr),
    st.text(max_size=6),
)
rows = st.lists(
    st.lists(cells, min_size=2, max_size=4) | st.tuples(*[cells] * 3).map(list), max_size=6
)
encodings = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"])


def written(header, body, *, encoding="utf-8", end="\n", quoting=csv.QUOTE_MINIMAL):
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator=end, quoting=quoting).writerows([header, *body])
    return stream.getvalue().encode(encoding, errors="replace")


def obeys(columns, fields=FIELDS):
    assert list(columns) == [field["name"] for field in fields]
    assert len({len(column) for column in columns.values()}) == 1
    for field in fields:
        rules = field.get("constraints", {})
        for cell in columns[field["name"]].tolist():
            if field["type"] == "number":
                assert type(cell) is float
                if math.isnan(cell):
                    assert not rules.get("required")
                else:
                    assert rules.get("minimum", -math.inf) <= cell <= rules.get("maximum", math.inf)
            else:
                assert type(cell) is str
                assert cell in rules.get("enum", [cell])


@given(st.binary(max_size=200))
@example(b"\xef\xbb\xbf")
@example(b"\x00" * 50)
@example(b'"' * 51)
@example(b"series,x,note\n" + b"a" * 200000)
@example(b"PK\x03\x04 a spreadsheet")
def test_any_bytes_are_a_table_or_an_error(raw):
    with contextlib.suppress(DataError):
        obeys(parse_csv(PATH, raw, SCHEMA))


@settings(max_examples=200)
@given(
    st.permutations(["series", "x", "note"]),
    rows,
    encodings,
    st.sampled_from(["\n", "\r\n", "\r", "\n\n"]),
    st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
)
@example(["series", "x", "note"], [["a", "٣", ""]], "utf-8", "\n", csv.QUOTE_MINIMAL)
@example(["series", "x", "note"], [["a", "1e-400", ""]], "utf-8", "\n", csv.QUOTE_MINIMAL)
@example(["x", "series", "note"], [["1", "a", ""]], "utf-8", "\n", csv.QUOTE_MINIMAL)
def test_any_cells_are_a_table_or_an_error_and_never_another_number(
    header, body, encoding, end, quoting
):
    raw = written(header, body, encoding=encoding, end=end, quoting=quoting)
    columns, message = None, ""
    try:
        columns = parse_csv(PATH, raw, SCHEMA)
    except DataError as error:
        message = str(error)
    if columns is None:
        assert str(PATH) in message
        return
    obeys(columns)
    assert header == ["series", "x", "note"], "shuffled columns are not taken one for another"
    assert len(columns["x"]) == len(body)
    for row, number in zip(body, columns["x"].tolist(), strict=True):
        assert row[1].isascii()
        if row[1] == "":
            assert math.isnan(number)
        else:
            assert number == float(row[1])
            assert number or not set(row[1].lower().partition("e")[0]) & set("123456789")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_files_of_spreadsheets_are_read(end, encoding):
    raw = written(["series", "x", "note"], [["a", "1.5", "é"]], encoding=encoding, end=end)
    assert {name: c.tolist() for name, c in parse_csv(PATH, raw, SCHEMA).items()} == {
        "series": ["a"],
        "x": [1.5],
        "note": ["é"],
    }


# The description ---------------------------------------------------------------------------------

TABLE = written(["series", "x", "note"], [["a", "1", ""], ["b", "2.5", "text"]])
RESOURCE = {
    "name": "some-table",
    "path": "some-table.csv",
    "title": "Title",
    "description": "What it is.",
    "provenance": "published",
    "licenses": [{"name": "CC0-1.0"}],
    "sources": [{"title": "Somebody", "place": "p. 1"}],
    "hash": digest(TABLE),
    "bytes": len(TABLE),
    "schema": {"fields": FIELDS},
}
SLOT = {
    "name": "some-slot",
    "title": "Title",
    "figure": "Fig. 1",
    "description": "What it is.",
    "instructions": ["Look."],
    "sources": [{"title": "Somebody"}],
    "schema": {"fields": FIELDS},
    "declare": {"scale": {"description": "what", "enum": ["one", "two"]}},
    "monotone": {"column": "x", "within": ["series"]},
}
PACKAGE = {"licenses": [{"name": "CC0-1.0"}], "resources": [RESOURCE], "awaited": [SLOT]}
scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
values = st.recursive(
    scalars | st.sampled_from(["../x.csv", "/etc/hostname", "(", "number", "some-slot", 10**400]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=5,
)


def places(value, path=()):
    """Yield the path of every part of a JSON value."""
    yield path
    if isinstance(value, (dict, list)):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from places(value[key], (*path, key))


def damaged(content, path, value, how):
    if not path:
        return value
    content = copy.deepcopy(content)
    inner = content
    for key in path[:-1]:
        inner = inner[key]
    if how == "delete":
        del inner[path[-1]]
    elif how == "twice" and isinstance(inner, list):
        inner.append(inner[path[-1]])
    else:
        inner[path[-1]] = value
    return content


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    (folder / "some-table.csv").write_bytes(TABLE)
    return folder


def use_all(folder):
    """Do everything that can be done with a data package; return the tables that came of it."""
    found = []
    for name in literature.tables(folder):
        found.append(literature.load(name, folder))
        assert found[-1].name in literature.describe(name, folder)
        found[-1]._repr_html_()
    for name in literature.slots(folder):
        literature.is_available(name, folder)
        literature.describe(name, folder)
    with contextlib.suppress(DataError):
        literature.value("nothing", folder)
    return found


def test_the_description_of_these_tests_is_sound(folder):
    (folder / "datapackage.json").write_text(json.dumps(PACKAGE))
    (table,) = use_all(folder)
    assert table["x"].tolist() == [1.0, 2.5]


@settings(max_examples=300)
@given(st.sampled_from(list(places(PACKAGE))), values, st.sampled_from(["set", "delete", "twice"]))
@example(("resources", 0, "path"), "../elsewhere.csv", "set")
@example(("resources", 0, "schema", "fields", 2, "constraints"), {"pattern": "("}, "set")
@example(("awaited", 0, "name"), "../../evil", "set")
def test_a_damaged_description_is_refused_or_does_no_harm(folder, path, value, how):
    content = damaged(PACKAGE, path, value, how)
    (folder / "datapackage.json").write_text(json.dumps(content))
    message = ""
    try:
        for table in use_all(folder):
            assert table["x"].tolist() == [1.0, 2.5]
    except LissomeError as error:
        message = str(error)
    assert not message or "datapackage.json" in message or "some-table" in message


@pytest.mark.parametrize("path", ["../x.csv", "/etc/hostname", "a/../../x", "C:\\x", "file:x"])
def test_tables_outside_the_folder_are_refused(folder, path):
    content = damaged(PACKAGE, ("resources", 0, "path"), path, "set")
    (folder / "datapackage.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match="expected a file in the folder"):
        literature.tables(folder)


# Registration ------------------------------------------------------------------------------------

AXES = {
    "name": "XY",
    "type": "XYAxes",
    "isLogX": False,
    "isLogY": False,
    "calibrationPoints": [
        {"px": 10, "py": 200, "dx": "1", "dy": "0"},
        {"px": 210, "py": 200, "dx": "3", "dy": "0"},
        {"px": 10, "py": 200, "dx": "1", "dy": "0"},
        {"px": 10, "py": 20, "dx": "1", "dy": "1"},
    ],
}
PROJECT = {"version": [4, 2], "axesColl": [AXES]}
POINTS = written(["series", "x", "note"], [["a", "1", ""], ["a", "2", "t"], ["b", "0.5", ""]])


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    return tmp_path_factory.mktemp("stage")


def state(data):
    return {path.name: path.read_bytes() for path in data.rglob("*") if path.is_file()}


def register(stage, *, points=POINTS, project=None, **changes):
    """Register points in a fresh data package; check that it is all or nothing."""
    data = stage / "data"
    data.mkdir(exist_ok=True)
    for name in ("some-slot.csv", "projects/some-slot.json"):
        (data / name).unlink(missing_ok=True)
    (data / "datapackage.json").write_text(json.dumps(PACKAGE | {"resources": []}))
    (stage / "points.csv").write_bytes(points)
    raw = json.dumps(PROJECT).encode() if project is None else project
    (stage / "project").write_bytes(raw)
    before = state(data)
    arguments = {
        "slot": "some-slot",
        "file": stage / "points.csv",
        "project": stage / "project",
        "tool": "WebPlotDigitizer 5.2",
        "uncertainty": {"x": 0.1},
        "declare": {"scale": "one"},
        "folder": data,
    }
    try:
        table = literature.register(**(arguments | changes))
    except (DataError, InvalidInput):
        assert state(data) == before
        raise
    obeys(dict(table.columns))
    assert literature.check(folder=data) == ("some-slot",)
    return table


def test_good_points_are_registered(stage):
    assert register(stage)["x"].tolist() == [1.0, 2.0, 0.5]


@settings(max_examples=60)
@given(rows, encodings, st.sampled_from(["\n", "\r\n"]))
@example([["a", "1", formula] for formula in FORMULAS], "utf-8", "\n")
@example([["a", "1", ""], ["a", "1", ""], ["a", "1", ""]], "utf-8", "\n")
def test_any_points_are_registered_or_refused(stage, body, encoding, end):
    raw = written(["series", "x", "note"], body, encoding=encoding, end=end)
    try:
        table = register(stage, points=raw)
    except DataError:
        return
    for series in ("a", "b"):
        x = table["x"][table["series"] == series]
        assert not (np.diff(x) <= 0).any()
    stored = (stage / "data" / "some-slot.csv").read_text(encoding="utf-8")
    for row in csv.reader(io.StringIO(stored, newline="")):
        assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for cell in row[::2])


@settings(max_examples=150)
@given(st.sampled_from(list(places(PROJECT))), values, st.sampled_from(["set", "delete", "twice"]))
@example(("axesColl", 0), [], "set")
@example(("axesColl", 0, "calibrationPoints", 0, "px"), 10**400, "set")
@example(("axesColl", 0, "isLogY"), True, "set")
def test_any_project_is_understood_or_refused(stage, path, value, how):
    content = damaged(PROJECT, path, value, how)
    with contextlib.suppress(DataError):
        table = register(stage, project=json.dumps(content).encode())
        for axes in table.digitization["axes"]:
            for label in "xy":
                low, high = axes[label]
                assert math.isfinite(low) and math.isfinite(high) and low != high
                assert not axes[f"log_{label}"] or min(low, high) > 0


def packed(name, raw, mode="w"):
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode=mode) as archive:
        member = tarfile.TarInfo(name)
        member.size = len(raw)
        archive.addfile(member, io.BytesIO(raw))
    return stream.getvalue()


@pytest.mark.parametrize("mode", ["w", "w:gz"])
def test_an_archive_is_read_but_never_unpacked(stage, mode):
    table = register(stage, project=packed("../../wpd.json", json.dumps(PROJECT).encode(), mode))
    assert table.digitization["axes"][0]["x"] == [1.0, 3.0]
    assert not list(stage.parent.rglob("wpd.json"))


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"\x1f\x8b" + bytes(50),
        packed("wpd.json", b"{", "w:gz")[:-20],
        packed("wpd.json", bytes(21 * 2**20), "w:gz"),
        packed("other.json", b"{}"),
        b"[" * 100000,
        b"\x80\x04\x95",
    ],
    ids=["empty", "no gzip", "cut", "a bomb", "another", "deep", "a pickle"],
)
def test_what_is_no_project_is_refused(stage, raw):
    with pytest.raises(DataError, match="expected a WebPlotDigitizer project"):
        register(stage, project=raw)


def test_no_content_of_a_file_is_executed():
    """Python tells an audit hook whatever it compiles, runs, starts or unpickles."""
    formulas = [*FORMULAS, "os.system('true')", "!!python/object:os.system", "${jndi:x}"]
    code = f"""
        import json, pathlib, sys, tempfile
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import test_data_fuzz as fuzz
        from lissome.errors import LissomeError
        stage = pathlib.Path(tempfile.mkdtemp())
        fuzz.register(stage)  # whatever is imported late is imported now
        fuzz.use_all(stage / "data")
        seen = []
        watched = ("exec", "compile", "os.", "subprocess.", "pickle.", "marshal.", "ctypes.", "socket.")
        harmless = ("os.chmod", "os.rename", "os.remove", "os.mkdir", "os.listdir", "os.scandir")
        def hook(event, arguments):
            if event.startswith(watched) and event not in harmless:
                seen.append(event)
        sys.addaudithook(hook)
        refused = 0
        for text in {formulas!r}:
            rows = [["a", "1", text], ["a", "2", text], ["b", "3", text]]
            for column in range(3):
                body = [[*row[:column], text, *row[column + 1:]] for row in rows]
                points = fuzz.written(["series", "x", "note"], body)
                try:
                    fuzz.register(stage, points=points)
                except LissomeError:
                    refused += 1
            project = json.loads(json.dumps(fuzz.PROJECT))
            project["axesColl"][0]["name"] = text
            fuzz.register(stage, project=json.dumps(project).encode())
            fuzz.use_all(stage / "data")
        print(refused, sorted(set(seen)))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    refused, events = done.stdout.split(maxsplit=1)
    assert int(refused) > 2 * len(formulas)
    assert events.strip() == "[]"
