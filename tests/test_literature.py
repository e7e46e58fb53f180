"""Loading stored data, refusing damaged ones, and registering digitized points."""

import csv
import errno
import json
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lissome import literature
from lissome._datapackage import Descriptor, parse_csv
from lissome.errors import DataAwaited, DataError, InvalidInput

SCHEMA = {
    "fields": [
        {"name": "name", "type": "string", "constraints": {"required": True, "unique": True}},
        {
            "name": "x",
            "type": "number",
            "unit": "mm",
            "constraints": {"required": True, "minimum": 0, "maximum": 10},
        },
        {"name": "y", "type": "number"},
    ]
}
GOOD = "name,x,y\na,1,2.5e-3\nb,10,\n"


def parse(text):
    return parse_csv(Path("some.csv"), text.encode(), SCHEMA)


@pytest.fixture
def copy(tmp_path):
    """A copy of the data that a test may damage, all slots empty."""
    folder = tmp_path / "data"
    shutil.copytree(Descriptor().folder, folder)
    package = Descriptor(folder)
    resources = package.content["resources"]
    package.content["resources"] = [r for r in resources if r["provenance"] != "digitized"]
    package.write()
    return folder


@pytest.fixture
def points(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(
        "series,overcurvature,distance\n"
        "experiment,1.0,1.0\nexperiment,1.5,0.7\nsimulation,2.0,0.4\n",
        encoding="utf-8",
    )
    return path


def project(path, **changes):
    calibration = [
        {"px": 10, "py": 200, "dx": "1", "dy": "0", "dz": None},
        {"px": 210, "py": 200, "dx": "3", "dy": "0", "dz": None},
        {"px": 10, "py": 200, "dx": "1", "dy": "0", "dz": None},
        {"px": 10, "py": 20, "dx": "1", "dy": "1", "dz": None},
    ]
    axes = {"name": "XY", "type": "XYAxes", "isLogX": False, "isLogY": False}
    axes |= {"calibrationPoints": calibration} | changes
    path.write_text(json.dumps({"version": [4, 2], "axesColl": [axes]}), encoding="utf-8")
    return path


@pytest.fixture
def arguments(tmp_path, points, copy):
    """Arguments that fill a slot of the copy."""
    return {
        "slot": "slinky-distance",
        "file": points,
        "project": project(tmp_path / "project.json"),
        "tool": "WebPlotDigitizer 5.2",
        "uncertainty": {"overcurvature": 0.01, "distance": 0.02},
        "declare": {"distance_scale": "ring length"},
        "folder": copy,
    }


class TestParsing:
    def test_a_good_table(self):
        columns = parse(GOOD)
        assert columns["name"].tolist() == ["a", "b"]
        assert columns["x"].tolist() == [1.0, 10.0]
        assert columns["y"][0] == 2.5e-3
        assert np.isnan(columns["y"][1])

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "expected a header line, found an empty file"),
            ("name,x\na,1\n", "missing column 'y'"),
            ("name,x,z\na,1,2\n", "missing column 'y'; unknown column 'z'"),
            ("x,name,y\n1,a,2\n", "the columns in another order"),
            ("name,x,y\na,1\n", "row 2: expected 3 cells, found 2"),
            ("name,x,y\na,1,2,3\n", "row 2: expected 3 cells, found 4"),
            ("name,x,y\na,,2\n", "row 2, column 'x': expected a number in mm, found an empty cell"),
            ("name,x,y\na,1 mm,2\n", "found '1 mm'; write one number a cell"),
            ("name,x,y\na,1;2,2\n", "found '1;2'"),
            ("name,x,y\na,nan,2\n", "found 'nan'"),
            ("name,x,y\na,1e999,2\n", "found '1e999'"),
            ("name,x,y\na,11,2\n", "from 0 to 10, found 11; check unit and calibration"),
            ("name,x,y\na,1,2\na,2,2\n", "found 'a' in rows 2 and 3"),
            ('name,x,y\n"a,1,2\n', "expected a CSV table in UTF-8"),
        ],
    )
    def test_faults_are_named_with_their_place(self, text, message):
        with pytest.raises(DataError) as caught:
            parse(text)
        assert message in str(caught.value)
        assert "some.csv" in str(caught.value)

    def test_other_encodings_are_refused(self):
        with pytest.raises(DataError, match="UTF-8"):
            parse_csv(Path("some.csv"), "name,x,y\nä,1,2\n".encode("latin-1"), SCHEMA)

    @given(st.text(max_size=12))
    @example("0\x1f")  # white space to str.strip, but not to float
    @example("\u20030")
    def test_a_cell_is_a_finite_number_in_range_or_an_error(self, cell):
        quoted = '"' + cell.replace('"', '""') + '"'
        try:
            columns = parse(f"name,x,y\na,{quoted},2\n")
        except DataError:
            return
        assert 0 <= columns["x"][0] <= 10

    @given(st.floats(min_value=0, max_value=10))
    def test_every_float_survives_the_journey(self, number):
        assert parse(f"name,x,y\na,{number!r},2\n")["x"][0] == number


class TestLoading:
    def test_a_table_carries_its_provenance(self):
        table = literature.load("audoly-neukirch-phi")
        assert table.provenance == "derived"
        assert "10.1016/j.jmps.2021.104457" in table.sources[0].address
        assert table.sources[0].place == "(2.8)"
        assert table.units["phi"] == "1"
        assert len(table) == len(table.frame) == len(table["v"])
        assert table.title in table._repr_html_()

    def test_columns_are_frozen_and_frames_are_copies(self):
        table = literature.load("audoly-neukirch-phi")
        with pytest.raises(ValueError):
            table["v"][0] = 1.0
        frame = table.frame
        frame.loc[0, "v"] = 99.0
        assert table["v"][0] == 0.0

    def test_unknown_names_come_with_the_nearest(self):
        with pytest.raises(DataError, match="did you mean 'thesis-table-3-1'"):
            literature.load("thesis-table-31")
        with pytest.raises(DataError, match="did you mean 'phi'"):
            literature.load("audoly-neukirch-phi")["phy"]
        with pytest.raises(DataError, match=r"did you mean .*'gelebart-span'"):
            literature.value("gelebert-span")
        with pytest.raises(DataError, match="did you mean 'slinky-distance'"):
            literature.is_available("slinky-distances")

    def test_values_carry_units_and_place(self):
        thickness = literature.value("t31-thickness")
        assert float(thickness) == 15.0
        assert thickness.to("m") == pytest.approx(15e-6, rel=1e-15)
        assert thickness.place == "Table 3.1"
        assert literature.value("ta1-stiff-modulus-parallel").uncertainty == 0.6
        assert thickness.uncertainty is None

    def test_units_that_do_not_fit_are_refused(self):
        with pytest.raises(InvalidInput, match="stored in micrometer"):
            literature.value("t31-thickness").to("second")
        with pytest.raises(InvalidInput, match="stored in no unit"):
            literature.value("ta1-soft-strain-rate").to("1/kelvin")

    def test_slots_without_data_say_how_to_fill_them(self):
        for name in literature.awaited():
            assert not literature.is_available(name)
            with pytest.raises(DataAwaited, match=f"describe {name}"):
                literature.load(name)

    def test_description_holds_a_command_that_parses(self):
        for name in literature.slots():
            text = literature.describe(name)
            assert f"register {name} points.csv" in text
            assert "unit" in text

    def test_loading_needs_neither_frictionless_nor_pandas(self):
        code = (
            "import sys; from lissome import literature; literature.load('claims');"
            "literature.value('t31-depth');"
            "heavy = {'frictionless', 'pandas', 'pint', 'matplotlib', 'numba'};"
            "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
        )
        subprocess.run([sys.executable, "-c", code], check=True)


class TestDamage:
    def test_a_changed_byte_is_noticed(self, copy):
        path = copy / "thesis-table-3-1.csv"
        path.write_bytes(path.read_bytes().replace(b"0.56", b"0.57"))
        with pytest.raises(DataError) as caught:
            literature.load("thesis-table-3-1", folder=copy)
        message = str(caught.value)
        assert str(path) in message
        assert message.count("sha256:") == 2
        assert "seal thesis-table-3-1" in message
        with pytest.raises(DataError, match="sha256"):
            literature.value("t31-depth", folder=copy)
        with pytest.raises(DataError, match="thesis-table-3-1"):
            literature.check(folder=copy)

    def test_a_lost_file_is_noticed(self, copy):
        (copy / "claims.csv").unlink()
        with pytest.raises(DataError, match=r"claims\.csv.*restore the file"):
            literature.load("claims", folder=copy)

    def test_a_lost_column_is_noticed_even_under_a_valid_hash(self, copy):
        path = copy / "thesis-outcomes.csv"
        rows = list(csv.reader(path.read_text("utf-8").splitlines()))
        with path.open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream).writerows(row[:-1] for row in rows)
        with pytest.raises(DataError, match="missing column 'place'"):
            literature.seal(["thesis-outcomes"], folder=copy)

    def test_sealing_accepts_a_wanted_change(self, copy):
        path = copy / "thesis-table-3-1.csv"
        path.write_bytes(path.read_bytes().replace(b"0.56", b"0.57"))
        assert literature.seal(folder=copy) == ("thesis-table-3-1",)
        assert float(literature.value("t31-depth", folder=copy)) == 0.57
        assert literature.check(folder=copy) == literature.tables(folder=copy)

    def test_a_broken_description_is_refused(self, copy):
        for text in ("{", "[]", '{"resources": []}', "[" * 100000):
            (copy / "datapackage.json").write_text(text)
            with pytest.raises(DataError, match=r"datapackage\.json: .*restore the file"):
                literature.tables(folder=copy)

    def test_folders_without_data_are_refused(self, tmp_path, monkeypatch):
        with pytest.raises(DataError, match="argument `folder`"):
            literature.tables(folder=tmp_path)
        monkeypatch.setenv("LISSOME_DATA", str(tmp_path))
        with pytest.raises(DataError, match="LISSOME_DATA"):
            literature.tables()

    def test_the_environment_may_name_the_folder(self, copy, monkeypatch):
        (copy / "thesis-outcomes.csv").unlink()
        monkeypatch.setenv("LISSOME_DATA", str(copy))
        assert float(literature.value("t31-depth")) == 0.56
        with pytest.raises(DataError, match="thesis-outcomes"):
            literature.load("thesis-outcomes")


class TestRegistration:
    def test_points_are_stored_with_everything_about_them(self, arguments, copy):
        table = literature.register(**arguments)
        assert table.provenance == "digitized"
        assert table["distance"].tolist() == [1.0, 0.7, 0.4]
        assert literature.is_available("slinky-distance", folder=copy)
        assert "slinky-distance" not in literature.awaited(folder=copy)
        about = table.digitization
        assert about["tool"] == "WebPlotDigitizer 5.2"
        assert about["axes"][0]["x"] == [1.0, 3.0]
        assert about["axes"][0]["y"] == [0.0, 1.0]
        assert about["uncertainty"] == {"overcurvature": 0.01, "distance": 0.02}
        assert about["declared"] == {"distance_scale": "ring length"}
        assert (copy / about["project"]).read_bytes() == arguments["project"].read_bytes()
        assert literature.check(folder=copy)[-1] == "slinky-distance"

    def test_projects_with_the_image_are_read_but_the_image_is_not_kept(
        self, arguments, tmp_path, copy
    ):
        original = arguments["project"].read_bytes()
        image = tmp_path / "image.png"
        image.write_bytes(b"the figure of somebody else")
        arguments["project"] = tmp_path / "project.tar"
        with tarfile.open(arguments["project"], "w") as archive:
            archive.add(image, "project/image.png")
            archive.add(tmp_path / "project.json", "project/wpd.json")
        table = literature.register(**arguments)
        assert (copy / table.digitization["project"]).read_bytes() == original
        assert not any(b"somebody else" in p.read_bytes() for p in copy.rglob("*") if p.is_file())
        with tarfile.open(arguments["project"], "w") as archive:
            archive.add(image, "project/image.png")
        with pytest.raises(DataError, match=r"without wpd\.json"):
            literature.register(**arguments, replace=True)

    def test_filled_slots_are_replaced_only_on_request(self, arguments, points, copy):
        literature.register(**arguments)
        points.write_text(points.read_text().replace("0.4", "0.45"))
        with pytest.raises(DataError, match="filled already"):
            literature.register(**arguments)
        table = literature.register(**arguments, replace=True)
        assert table["distance"][-1] == 0.45
        assert literature.tables(folder=copy).count("slinky-distance") == 1

    def test_spreadsheet_files_are_made_plain(self, arguments, points, copy):
        points.write_bytes(b"\xef\xbb\xbf" + points.read_bytes().replace(b"\n", b"\r\n"))
        literature.register(**arguments)
        stored = (copy / "slinky-distance.csv").read_bytes()
        assert stored.startswith(b"series,")
        assert b"\r" not in stored

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("0.7", "nan", "found 'nan'"),
            ("0.7", "70", "check unit and calibration"),
            ("experiment,1.5", "measured,1.5", "expected one of 'experiment', 'simulation'"),
            (",distance", "", "missing column 'distance'"),
            ("experiment,1.5,0.7\nsimulation,2.0,0.4\n", "", "at least 3 points"),
        ],
    )
    def test_bad_points_leave_everything_as_it_was(
        self, arguments, points, copy, old, new, message
    ):
        points.write_text(points.read_text().replace(old, new))
        before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
        with pytest.raises(DataError, match=message):
            literature.register(**arguments)
        assert before == {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"type": "PolarAxes"}, "PolarAxes"),
            ({"calibrationPoints": []}, "0 calibration points"),
            ({"calibrationPoints": [{"px": 1, "py": 1, "dx": 0, "dy": 0}] * 4}, "coincide"),
            (
                {"calibrationPoints": [{"px": 1, "py": 1, "dx": "x", "dy": 0}] * 4},
                "could not convert",
            ),
        ],
    )
    def test_projects_without_calibrated_axes_are_refused(
        self, arguments, tmp_path, changes, message
    ):
        project(tmp_path / "project.json", **changes)
        with pytest.raises(DataError, match=message):
            literature.register(**arguments)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"tool": "by eye"}, "`tool`.*version"),
            ({"uncertainty": {"distance": 0.1}}, "`uncertainty` lacks overcurvature"),
            ({"uncertainty": {"overcurvature": -1, "distance": 0.1}}, "at least 0"),
            ({"uncertainty": {"overcurvature": float("nan"), "distance": 0.1}}, "finite"),
            ({"uncertainty": {"overcurvature": 0, "distance": 0}}, "0 for every column"),
            ({"uncertainty": {"overcurvature": 1, "distance": 1, "distanz": 1}}, "unknown name"),
            ({"uncertainty": 0.1}, "mapping"),
            ({"declare": None}, "`declare` lacks distance_scale"),
            ({"declare": {"distance_scale": "meters"}}, "one of 'ring length'"),
        ],
    )
    def test_incomplete_metadata_are_refused(self, arguments, changes, message):
        with pytest.raises(InvalidInput, match=message):
            literature.register(**{**arguments, **changes})

    def test_curves_must_advance(self, arguments, points):
        points.write_text(
            "film,temperature,strain\nstiff,30,0\nsoft,30,0\nstiff,60,-1\nsoft,25,-1\n"
        )
        arguments |= {
            "slot": "film-strains",
            "uncertainty": {"temperature": 1, "strain": 0.5},
            "declare": None,
        }
        with pytest.raises(DataError, match=r"row 5.*'temperature' to increase.*\(soft\)"):
            literature.register(**arguments)
        points.write_text(points.read_text().replace("25", "61"))
        assert len(literature.register(**arguments)) == 4

    def test_the_command_line_does_the_same(self, arguments, copy, capsys):
        command = [
            *("--folder", str(copy), "register", "slinky-distance", str(arguments["file"])),
            *("--project", str(arguments["project"]), "--tool", "WebPlotDigitizer 5.2"),
            *("--uncertainty", "overcurvature=0.01", "distance=0.02"),
            *("--declare", "distance_scale=ring length"),
        ]
        assert literature.main(command) == 0
        assert "registered 3 points" in capsys.readouterr().out
        assert literature.main(command) == 1
        assert "filled already" in capsys.readouterr().err
        assert literature.main(["--folder", str(copy), "check"]) == 0
        assert literature.main(["--folder", str(copy), "list"]) == 0
        output = capsys.readouterr().out
        assert "digitized  slinky-distance" in output
        assert "awaited    film-strains" in output

    def test_the_command_line_explains_a_folder_that_cannot_be_written(
        self, arguments, copy, capsys, monkeypatch
    ):
        def full(path, raw):
            raise OSError(errno.ENOSPC, "No space left on device", str(path))

        monkeypatch.setattr("lissome._datapackage.write_atomically", full)
        assert literature.main(["--folder", str(copy), "seal"]) == 1
        assert "error: [Errno 28] No space left on device" in capsys.readouterr().err

    def test_the_command_line_explains_bad_options(self, arguments, copy, capsys):
        command = ["--folder", str(copy), "register", "slinky-distance", str(arguments["file"])]
        command += ["--project", str(arguments["project"]), "--tool", "WebPlotDigitizer 5.2"]
        assert literature.main([*command, "--uncertainty", "distance"]) == 1
        assert "name=value" in capsys.readouterr().err
        assert literature.main([*command, "--uncertainty", "distance=small"]) == 1
        assert "give a number" in capsys.readouterr().err
