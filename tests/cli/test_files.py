"""``inspect``, ``convert`` and ``formats``: calibration files from the command line."""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import calibrary
from calibrary import parsers
from calibrary.cli.main import main
from calibrary.distortion import MODELS
from calibrary.errors import ParseError
from calibrary.jobs.inspect.run import InspectReport
from calibrary.records import from_json
from calibrary.schemas import require
from tests.house.project import ROOT
from tests.jobs.extract.fleet import DEWARP, P4R, picture
from tests.parsers.formats.test_gyroflow import PROFILE

AGISOFT = (
    "<calibration><projection>frame</projection><width>5472</width><height>3648</height>"
    "<f>3660.5</f><cx>-4.5</cx><cy>22.75</cy><k1>-0.1</k1><p1>0.001</p1></calibration>"
)


@pytest.fixture
def xml(tmp_path: Path) -> Path:
    path = tmp_path / "camera.xml"
    path.write_text(AGISOFT)
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    code = main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_convert_writes_the_k_of_a_part_and_of_another_size(
    xml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.yml"
    written = ("convert", xml, out, "--to", "opencv", "--force")
    assert run(capsys, *written, "--scale-to", "2736x1824")[0] == 0
    assert calibrary.read(out).intrinsics == calibrary.read(xml).intrinsics.scaled((2736, 1824))
    assert run(capsys, *written, "--crop", "100,50,4000,3000", "--scale-to", "2000x1500")[0] == 0
    part = calibrary.read(xml).cropped((100, 50, 4000, 3000)).scaled((2000, 1500))
    assert calibrary.read(out).intrinsics == part.intrinsics
    assert run(capsys, *written, "--scale-to", "2000x2000")[0] == 3
    assert run(capsys, *written, "--crop", "5000,0,1000,1000")[0] == 3
    with pytest.raises(SystemExit):
        run(capsys, *written, "--crop", "100x50")
    assert "expected X,Y,W,H" in capsys.readouterr().err


def test_inspect_tells_what_a_file_is_why_and_how_it_counts(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "inspect", xml)
    assert code == 0
    assert "Agisoft Metashape camera calibration" in out
    assert "fx 3660.5000" in out
    assert "cx 2731.5000" in out
    assert "the principal point counts from the middle of the image" in out


def test_inspect_reads_the_format_of_a_program_that_the_name_of_the_file_tells(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = xml.with_name("cameras.bin")
    assert run(capsys, "convert", xml, out, "--to", "colmap")[0] == 0
    code, said, _ = run(capsys, "inspect", out, "--format", "colmap", "--json")
    assert (code, json.loads(said)["format"]) == (0, "colmap_binary")


def test_inspect_prints_one_document_for_machines(xml: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "inspect", "--json", xml)
    document = json.loads(out)
    require(document, "inspect-1")
    assert (code, document["format"], document["warnings"]) == (0, "agisoft_xml", [])
    assert document["calibrations"][0]["intrinsics"]["cx"] == 2731.5


def test_a_word_that_inspect_does_not_print_breaks_its_schema(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(run(capsys, "inspect", "--json", xml)[1])
    for wrong in ({**document, "grade": "calibrated"}, {**document, "error": 3}, {"files": [document]}):
        with pytest.raises(ParseError):
            require(wrong, "inspect-1")


def test_inspect_reads_an_image_by_its_metadata(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP)
    _, out, _ = run(capsys, "inspect", "--json", image)
    document = json.loads(out)
    require(document, "inspect-1")
    assert document["format"] == "image"
    assert document["calibrations"][0]["grade"] == "calibrated"


def test_inspect_lists_the_exif_tags_of_an_image_that_yields_no_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = picture(tmp_path / "a.jpg", make="Example", model="Unheard-Of 1", body_serial="SERIAL-7")
    code, out, _ = run(capsys, "inspect", "--tags", image)
    assert code == 0
    rows = dict(
        re.split(r"  +", line.strip(), maxsplit=1) for line in out.splitlines() if line[2:7] == "Image"
    )
    assert rows["Image Model"] == "Unheard-Of 1"
    assert re.search(r"^  1 more are not shown: positions, serial", out, re.MULTILINE)
    assert "SERIAL-7" not in out
    document = json.loads(run(capsys, "inspect", "--tags", "--json", image)[1])
    require(document, "inspect-1")
    assert {"name": "Image Make", "value": "Example"} in document["tags"]
    assert document["tags_left_out"] == 1


def test_inspect_lists_the_tags_of_the_images_of_a_folder(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture(xml.with_name("a.jpg"), **P4R)
    code, out, _ = run(capsys, "inspect", "--tags", "--json", xml.parent)
    document = json.loads(out)
    require(document, "inspect-files-1")
    assert code == 0
    assert [one["file"] for one in document["files"]] == ["a.jpg"]


def test_tags_are_of_images_and_a_table_is_of_calibrations(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "inspect", "--tags", xml)
    assert code == 3
    assert "this is not a JPEG, TIFF, DNG, PNG or HEIF image" in " ".join(out.split())
    with pytest.raises(SystemExit):
        run(capsys, "inspect", "--tags", "--table", "-", xml)
    assert "--table is a table of calibrations" in capsys.readouterr().err


def test_inspect_walks_a_folder_and_a_file_that_is_none_does_not_stop_it(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (xml.parent / "notes.txt").write_text("nothing to see")
    code, out, _ = run(capsys, "inspect", "--json", xml.parent)
    document = json.loads(out)
    require(document, "inspect-files-1")
    files = {one["file"]: one for one in document["files"]}
    assert code == 3
    assert files["camera.xml"]["error"] is None
    assert files["notes.txt"]["calibrations"] == []
    assert "notes.txt" in files["notes.txt"]["error"]


def test_an_answer_is_given_with_a_flag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "K.npy", np.array([[3660.5, 0, 2731.5], [0, 3655.25, 1846.75], [0, 0, 1]]))
    code, out, _ = run(capsys, "inspect", tmp_path / "K.npy")
    assert code == 0
    assert "unknown size" in out
    assert "--image-size" in out
    code, out, _ = run(capsys, "inspect", "--image-size", "5472x3648", tmp_path / "K.npy")
    assert code == 0
    assert "5472×3648" in out


def test_convert_writes_the_other_format_and_says_what_survived(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = run(capsys, "convert", xml, xml.with_name("camera.yml"), "--to", "opencv_storage")
    [before], [after] = parsers.read(xml), parsers.read(xml.with_name("camera.yml"))
    assert code == 0
    assert "exact" in out
    assert after.intrinsics == before.intrinsics
    assert after.distortion == before.distortion


WITHOUT_SIZE = {
    "camera_matrix": [[3660.5, 0, 2731.0], [0, 3655.25, 1846.5], [0, 0, 1]],
    "dist_coeffs": [0.1, 0, 0, 0, 0],
}


def test_inspect_shows_what_it_can_of_a_file_without_an_image_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(WITHOUT_SIZE))
    code, out, _ = run(capsys, "inspect", "--json", path)
    document = json.loads(out)
    require(document, "inspect-1")
    [found] = document["calibrations"]
    assert code == 0
    assert found["intrinsics"]["image_size"] is None
    assert [found["intrinsics"][name] for name in ("fx", "fy", "cx", "cy")] == [
        3660.5,
        3655.25,
        2731.5,
        1847.0,
    ]
    assert found["distortion"]["k1"] == 0.1
    assert from_json(InspectReport, document).unsized[0].intrinsics.cx == 2731.5


def test_what_needs_the_size_refuses_until_it_has_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, made = tmp_path / "camera.json", tmp_path / "camera.yaml"
    path.write_text(json.dumps(WITHOUT_SIZE))
    code, _, err = run(capsys, "convert", path, made, "--to", "kalibr")
    assert code == 3
    assert "--image-size" in err
    assert "--size-from-centre" in err
    assert run(capsys, "convert", path, made, "--to", "kalibr", "--size-from-centre")[0] == 0
    assert parsers.read(made)[0].intrinsics.image_size == (5463, 3694)


def test_a_k_of_no_camera_is_shown_loudly_and_passed_on_only_by_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, made = tmp_path / "transforms.json", tmp_path / "camera.yml"
    frame = {"w": 1500, "h": 1000, "fl_x": 35.7, "fl_y": 35.7, "cx": 750, "cy": 500, "camera_model": "OPENCV"}
    path.write_text(json.dumps({**frame, "frames": []}))
    code, out, _ = run(capsys, "inspect", path)
    assert code == 1
    assert "35.7 px" in out
    document = json.loads(run(capsys, "inspect", "--json", path)[1])
    require(document, "inspect-1")
    assert "perhaps mm" in document["implausible"][0]
    code, _, err = run(capsys, "convert", path, made, "--to", "opencv_storage")
    assert (code, made.exists()) == (3, False)
    assert "--force" in err
    assert run(capsys, "convert", path, made, "--to", "opencv_storage", "--force")[0] == 0
    assert parsers.read(made)[0].intrinsics.fx == 35.7


def test_a_prior_is_written_when_it_is_asked_for_and_named_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, made = tmp_path / "prior.json", tmp_path / "camera.yml"
    path.write_text(json.dumps(PROFILE))
    [prior] = parsers.read(path)
    code, _, err = run(capsys, "convert", path, made, "--to", "opencv_storage")
    assert (code, made.exists()) == (3, False)
    assert "--allow-prior" in err
    code, out, _ = run(capsys, "convert", path, made, "--to", "opencv_storage", "--allow-prior")
    assert code == 0
    assert "not measured" in out
    assert prior.grade.value in out


def test_what_is_in_a_file_decides_against_an_images_name(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = xml.rename(xml.with_name("camera.jpg"))
    code, out, _ = run(capsys, "inspect", path)
    assert code == 0
    assert "Agisoft" in out
    assert calibrary.read(path).intrinsics.fx == 3660.5
    (broken := xml.with_name("broken.jpg")).write_bytes(b"no image")
    assert "image" in run(capsys, "inspect", broken)[1]


def test_convert_asks_for_the_format_when_the_name_does_not_tell(
    xml: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = run(capsys, "convert", xml, xml.with_name("camera.unheard"))
    assert code == 2
    assert "--to" in err
    assert not xml.with_name("camera.unheard").exists()


def test_convert_refuses_a_camera_the_file_has_not(xml: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = xml.with_name("camera.yml")
    code, _, err = run(capsys, "convert", xml, out, "--to", "opencv_storage", "--camera", "2")
    assert code == 3
    assert "--camera" in err
    assert not out.exists()


def test_formats_lists_every_format_by_its_own_record(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "formats", "--json")
    document = json.loads(out)
    require(document, "formats-1")
    listed = document["formats"]
    assert code == 0
    assert [one["name"] for one in listed] == [record.name for record in parsers.formats()]


def test_a_format_nobody_knows_is_said_so(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "formats", "no-such-format")
    assert code == 1
    assert "'calibrary formats' lists them all" in err
    assert "did you mean colmap?" in run(capsys, "formats", "colmp")[2]
    assert "did you mean FC6310R?" in run(capsys, "catalogue", "fc6130r")[2]


def test_one_format_is_explained_in_its_own_words(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "formats", "mvsnet_cam")[1]
    assert "extrinsic" in out
    assert "``" not in out


def test_the_documentation_lists_the_formats_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """``make docs`` writes it: a row for each format."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    made = runpy.run_path(str(ROOT / "docs" / "make_formats.py"))["documents"]()
    for record in parsers.formats():
        words = record.refuses or f"[{record.title}]({record.reference})"
        assert any(
            line.startswith(f"| `{record.name}` |") and words in line
            for line in made["formats.md"].splitlines()
        )
    for name, text in made.items():
        assert (ROOT / "docs" / name).read_text(encoding="utf-8") == text, "run `make docs`"
    for model, kind in MODELS.items():
        section = made["distortion.md"].partition(f"## {model}\n")[2].partition("\n## ")[0]
        assert all(f"`{parameter}`" in section for parameter in kind.names())


def test_convert_takes_folders_and_patterns_and_lists_the_verdicts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given, made = tmp_path / "given", tmp_path / "made"
    (given / "deeper").mkdir(parents=True)
    (given / "a.xml").write_text(AGISOFT)
    (given / "deeper" / "a.xml").write_text(AGISOFT.replace("3660.5", "3661.5"))
    (given / "README.txt").write_text("nothing to see")
    (given / "b.json").write_text(json.dumps(WITHOUT_SIZE))
    code, out, _ = run(capsys, "convert", given, made, "--to", "opencv_storage")
    assert code == 3
    assert "exact" in out
    assert "--image-size" in " ".join(out.split())
    assert "README" not in out
    assert "wrote 2 of 3" in out
    assert {parsers.read(path)[0].intrinsics.fx for path in made.iterdir()} == {3660.5, 3661.5}
    code, out, _ = run(capsys, "convert", given / "*.xml", made, "--to", "opencv_storage", "--json")
    [one] = json.loads(out)["files"]
    assert (code, one["source"], one["verdict"], one["error"]) == (0, "a.xml", "exact", None)


def test_cameras_of_one_file_get_files_of_their_own_where_the_format_holds_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "cameras.txt"
    rig.write_text("1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 800 600 600 600 400 300\n")
    made = tmp_path / "made"
    code, out, _ = run(capsys, "convert", rig, rig, made, "--to", "agisoft_xml")
    assert (code, "cameras.txt, camera 2" in out) == (0, True)
    assert sorted(path.name for path in made.iterdir())[:2] == ["cameras-1.xml", "cameras-2.xml"]
    assert run(capsys, "convert", rig, rig, tmp_path / "one", "--to", "agisoft_xml", "--camera", "2")[0] == 0
    assert parsers.read(tmp_path / "one" / "cameras.xml")[0].intrinsics.image_size == (800, 600)
    code, _, err = run(capsys, "convert", rig, rig, made)
    assert code == 2
    assert "--to" in err


def test_colons_around_a_word_in_a_name_are_no_emoji(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "inspect", "DJI_:camera:.xml")
    assert code == 3
    assert "DJI_:camera:.xml" in out.split()
