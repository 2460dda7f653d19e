"""Tables of cameras and images: pandas and pyarrow read what was written, spreadsheets run nothing in it."""

from __future__ import annotations

import importlib
import io
import math
from pathlib import Path
from typing import Any

import pytest

import calibrary
from calibrary.cli.main import main
from calibrary.errors import InputError, MissingExtraError
from calibrary.jobs import tables
from calibrary.jobs.catalogue import known_cameras
from calibrary.jobs.tables.rows import Table, catalogue_table
from tests.jobs.extract.fleet import DEWARP, P4R, entry, files, picture

HOSTILE = "=cmd|' /C calc'!A0"


@pytest.fixture(scope="module")
def pd() -> Any:
    """pandas, which takes half a second to import."""
    return importlib.import_module("pandas")


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Two cameras, one with a hostile name, an image that cannot be read, and a registry."""
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    picture(tmp_path / "flight/b.jpg", **P4R, dewarp=DEWARP)
    picture(tmp_path / "flight/c.jpg", make="Example", model=HOSTILE, focal_mm=(132, 10))
    (tmp_path / "flight/torn.jpg").write_bytes(b"\xff\xd8\xff")
    entry(tmp_path / "fleet", fx=3659.0)
    entry(tmp_path / "fleet", model="FC330", image_size=(4000, 3000), fx=2280.1)
    return tmp_path


class TestFiles:
    def test_csv_keeps_every_digit_whatever_the_locale(self, pd: Any) -> None:
        table = Table(
            [{"name": "a;b,c\n", "fx_px": 0.1 + 0.2, "images": 3}, {"name": "zoom 2×", "k1": -1e-17}]
        )
        read = pd.read_csv(io.StringIO(table.to_csv()), dtype={"fx_px": str, "k1": str})
        assert [*read.columns] == ["name", "fx_px", "images", "k1"]
        # Read as numbers, older pandas lose the last digit.
        assert float(read["fx_px"][0]) == 0.1 + 0.2
        assert float(read["k1"][1]) == -1e-17
        assert math.isnan(read["k1"][0])
        assert [*read["name"]] == ["a;b,c\n", "zoom 2×"]

    @pytest.mark.parametrize("start", ["=1+1", "+1", "-1", "@x", "\t=1", "\r=1"])
    def test_no_cell_of_csv_is_a_formula(self, start: str, pd: Any) -> None:
        [cell] = pd.read_csv(io.StringIO(Table([{"model": start}]).to_csv()))["model"]
        assert cell == f"'{start}".replace("\r", "\n")

    def test_parquet_has_the_types_that_the_names_state_even_without_values(self, tmp_path: Path) -> None:
        table = Table(
            [{"name": None, "rms_px": None, "width_px": None, "focal_mm": 8, "k1": 0.5, "ok": True}]
        )
        table.write(tmp_path / "t.parquet")
        import pyarrow as pa
        import pyarrow.parquet as pq

        found = pq.read_table(tmp_path / "t.parquet")
        kinds = {"name": pa.string(), "rms_px": pa.float64(), "width_px": pa.int64()}
        kinds |= {"focal_mm": pa.float64(), "k1": pa.float64(), "ok": pa.bool_()}
        assert {field.name: field.type for field in found.schema} == kinds
        assert found.schema.metadata[b"pixel_origin"] == b"outer corner of the top-left pixel"

    def test_what_is_neither_csv_nor_parquet_is_refused_before_any_work(
        self, flight: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        with pytest.raises(InputError, match=r"\.csv or \.parquet"):
            Table([]).write(flight / "t.xlsx")
        assert main(["extract", str(flight / "flight"), "--table", str(flight / "t.xlsx")]) == 3
        assert "ends in .csv or .parquet" in capsys.readouterr().err

    def test_without_pyarrow_the_extra_is_named(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("calibrary.extras.find_spec", lambda _: None)
        with pytest.raises(MissingExtraError, match=r"calibrary\[tables\]"):
            Table([]).write(tmp_path / "t.parquet")

    def test_a_notebook_shows_the_first_rows_and_nothing_that_runs(self) -> None:
        html = Table([{"model": "<script>alert(1)</script>", "fx_px": 3660.123456789}] * 21)._repr_html_()
        assert "<script" not in html
        assert html.count("<tr>") == 21
        assert "the first 20 of 21" in html
        assert "3660.123" in html


class TestRows:
    def test_cameras_of_a_flight(self, flight: Path, pd: Any) -> None:
        result = calibrary.extract(flight / "flight")
        frame = pd.DataFrame(tables.cameras(result).to_dict()).set_index("model")
        assert frame.loc["FC6310R", ["images", "fx_px", "cx_px", "k1", "verdict"]].tolist() == [
            2,
            3660.5,
            2731.5,
            -0.268,
            "valid",
        ]
        assert frame.loc[HOSTILE, "images"] == 1
        assert frame.loc["FC6310R", ["width_px", "height_px", "date"]].tolist() == [5472, 3648, "2019-03-05"]

    def test_images_of_a_flight_and_those_that_were_not_read(self, flight: Path) -> None:
        rows = {row["image"]: row for row in tables.images(calibrary.extract(flight / "flight")).rows}
        assert [*rows] == ["a.jpg", "b.jpg", "c.jpg", "torn.jpg"]
        assert (rows["b.jpg"]["camera"], rows["b.jpg"]["fx_px"]) == ("dji-fc6310r-5472x3648", 3660.5)
        assert rows["torn.jpg"]["verdict"] == "unreadable"
        assert "fx_px" not in rows["torn.jpg"]

    def test_the_command_writes_both_and_prints_one(
        self, flight: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, pd: Any
    ) -> None:
        monkeypatch.chdir(flight)
        assert main(["extract", "flight", "--table", "-", "--image-table", "images.parquet"]) == 1
        printed = pd.read_csv(io.StringIO(capsys.readouterr().out))
        assert {*printed["model"]} == {"FC6310R", f"'{HOSTILE}"}
        images = pd.read_parquet("images.parquet")
        assert images.dtypes["fx_px"] == "float64"
        assert len(images) == 4
        assert main(["extract", "flight", "--dry-run", "--table", "cameras.csv"]) == 1
        assert not Path("cameras.csv").exists()
        for clash in (["--table", "-", "--json"], ["--table", "-", "--image-table", "-"]):
            with pytest.raises(SystemExit, match="2"):
                main(["extract", "flight", *clash])

    def test_entries_of_a_registry(self, flight: Path, capsys: pytest.CaptureFixture[str], pd: Any) -> None:
        place = ["--registry", str(files(flight / "fleet"))]
        assert main(["registry", "list", *place, "--table", str(flight / "fleet.parquet")]) == 0
        assert "dji/fc6310r/5472x3648" in capsys.readouterr().out
        frame = pd.read_parquet(flight / "fleet.parquet")
        assert frame[["entry", "fx_px", "status", "width_px", "distortion"]].values.tolist() == [
            ["dji/fc330/4000x3000", 2280.1, "approved", 4000, "brown"],
            ["dji/fc6310r/5472x3648", 3659.0, "approved", 5472, "brown"],
        ]
        assert main(["registry", "list", *place, "--columns", "model,fx,cx", "--table", "-"]) == 0
        assert capsys.readouterr().out.splitlines()[0] == "model,fx_px,cx_px"

    def test_an_audit(self, flight: Path, capsys: pytest.CaptureFixture[str], pd: Any) -> None:
        place = ["--registry", str(files(flight / "fleet"))]
        assert main(["registry", "audit", str(flight / "flight"), *place, "--table", "-"]) == 1
        frame = pd.read_csv(io.StringIO(capsys.readouterr().out)).set_index("model")
        used = frame.loc["FC6310R"]
        assert used[["use", "entry", "images"]].tolist() == ["used", "dji/fc6310r/5472x3648", 2]
        assert used[["entry_fx_px", "images_fx_px"]].tolist() == [3659.0, 3660.5]
        assert frame.loc[f"'{HOSTILE}", "use"] == "none"

    def test_files_and_what_is_no_calibration_among_them(
        self, flight: Path, capsys: pytest.CaptureFixture[str], pd: Any
    ) -> None:
        (flight / "K.txt").write_text("3660 0 2731\n0 3655 1850\n0 0 1\n")
        names = [str(flight / name) for name in ("flight/a.jpg", "flight/torn.jpg", "K.txt")]
        assert main(["inspect", *names, "--table", "-"]) == 3
        frame = pd.read_csv(io.StringIO(capsys.readouterr().out))
        assert [*frame["file"]] == names
        assert frame["fx_px"].tolist()[::2] == [3660.5, 3660.0]
        assert frame["error"].isna().tolist() == [True, False, True]

    def test_the_catalogue(self, pd: Any) -> None:
        frame = pd.DataFrame(catalogue_table(known_cameras().cameras).to_dict()).set_index("name")
        assert frame.loc["Phantom 4 RTK", ["pitch_um", "width_px"]].tolist()[0] == pytest.approx(
            2.41, abs=0.02
        )
        assert frame["model"].notna().all()
