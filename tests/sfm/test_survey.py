"""Ground control as files state it, the coordinates against published ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrary.errors import ParseError
from calibrary.sfm.geodesy import LocalFrame
from calibrary.sfm.survey import Survey, read_survey

ROWS = "463000 5240000 430.5 100 200 IMG_1.JPG A\n463050 5240000 433 7.5 8 IMG_2.JPG B\n"


def given(folder: Path, text: str) -> Survey:
    path = folder / "gcp_list.txt"
    path.write_text(text)
    return read_survey(path)


@pytest.mark.parametrize(
    ("head", "x", "y", "expected"),
    [
        # GeographicLib's example of UTMUPS: 38SMB4414084706.
        ("WGS84 UTM 38N", 444140.54, 3684706.36, (44.4, 33.3)),
        # Swiss Federal Office of Topography, "Formeln und Konstanten", 2016: the origin of the projection.
        ("EPSG:2056", 2600000.0, 1200000.0, (7.438632, 46.951083)),
        ("EPSG:4326", 8.5, 47.25, (8.5, 47.25)),
        ("WGS84", 8.5, 47.25, (8.5, 47.25)),
        ("+init=epsg:32631", 500000.0, 0.0, (3.0, 0.0)),
        ("WGS84 UTM 31N", 500000.0, 0.0, (3.0, 0.0)),
        ("wgs84 utm 19S", 500000.0, 10000000.0, (-69.0, 0.0)),
    ],
)
def test_coordinates_are_those_of_the_system_in_the_first_line(
    tmp_path: Path, head: str, x: float, y: float, expected: tuple[float, float]
) -> None:
    found = given(tmp_path, f"{head}\n{x} {y} 430.5 100 200 IMG_1.JPG A\n")
    np.testing.assert_allclose(found.places[0], (*expected, 430.5), atol=1e-6)


def test_a_metre_of_the_map_is_not_a_metre_of_the_ground(tmp_path: Path) -> None:
    """UTM's scale at its middle is 0.9996."""
    found = given(tmp_path, "WGS84 UTM 32N\n500000 5240000 0 1 1 a.jpg\n501000 5240000 0 1 1 a.jpg\n")
    apart = np.diff(LocalFrame.around(found.places).metres(found.places), axis=0)[0]
    assert np.linalg.norm(apart) == pytest.approx(1000 / 0.9996, abs=0.01)


def test_marks_count_from_the_centre_of_the_first_pixel(tmp_path: Path) -> None:
    """As OpenSfM reads them, which adds half a pixel."""
    found = given(tmp_path, f"# a remark\nWGS84 UTM 32N\n\n{ROWS}463000 5240000 430.5 1 2 My%20Image.JPG A\n")
    assert found.names == ("A", "B")
    assert [mark.pixel for mark in found.marks] == [(100.5, 200.5), (8.0, 8.5), (1.5, 2.5)]
    assert [mark.line for mark in found.marks] == [4, 5, 6]
    assert found.points_of(["img_1.jpg", "My Image.JPG", "c.jpg"]) == {
        "img_1.jpg": {0}, "My Image.JPG": {0}, "c.jpg": set(),
    }  # fmt: skip
    assert found.file.name == "gcp_list.txt"


def test_images_of_one_name_are_told_apart_by_their_folder(tmp_path: Path) -> None:
    """DJI counts from 0001 again in each folder."""
    found = given(tmp_path, f"WGS84 UTM 32N\n{ROWS}463000 5240000 430.5 1 2 D:\\flight\\101\\IMG_1.JPG A\n")
    images = ["100/IMG_1.JPG", "101/IMG_1.JPG", "IMG_2.JPG"]
    assert [(at, mark.line) for at, mark in found.marks_in(images)] == [(1, 4), (2, 3)]


def test_the_table_of_control_points_is_read_too(tmp_path: Path) -> None:
    found = given(tmp_path, "X,Y,Z,u,v,image\n1.5,2,3,10,20,a.jpg\n1.5,2,3,11,21,b.jpg\n4,5,6,7,8,b.jpg\n")
    assert found.is_local
    assert found.names == ("(1.5, 2, 3)", "(4, 5, 6)")
    np.testing.assert_allclose(found.places, [(1.5, 2, 3), (4, 5, 6)])
    assert [(mark.point, mark.image, mark.pixel) for mark in found.marks] == [
        (0, "a.jpg", (10, 20)), (0, "b.jpg", (11, 21)), (1, "b.jpg", (7, 8)),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (f"UTM what\n{ROWS}", "line 1: 'UTM what' is no coordinate system, expected WGS84 UTM 32N"),
        (f"EPSG:2263\n{ROWS}", "line 1: .*counts in US survey foot.*convert the points to metres"),
        (f"EPSG:4326\n{ROWS}", "line 1: 463000 5.24e.06 are no coordinates of WGS 84"),
        (f"WGS84 UTM 32N\n{ROWS}1 2 x 4 5 c.jpg", "line 4: 1 2 x 4 5 c.jpg: expected x y z im_x im_y image"),
        (f"WGS84 UTM 32N\n{ROWS}1 2 nan 4 5 c.jpg", "line 4: .*five numbers"),
        (f"WGS84 UTM 32N\n{ROWS}1 2 3 4 5", "line 4: .*a file name"),
        (f"WGS84 UTM 32N\n{ROWS}1 2 3 4 5 c.jpg A", "line 4: point A has other coordinates than above"),
        (f"WGS84 UTM 32N\n{ROWS}{ROWS}", "line 4: point A is in IMG_1.JPG on line 2 already"),
        ("WGS84 UTM 32N\n", "has no line below its first"),
        ("", "has 0 lines"),
        ("\udcff", "is not UTF-8"),
    ],
)
def test_a_bad_file_is_refused_by_its_line(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "gcp_list.txt"
    path.write_text(text, errors="surrogateescape")
    with pytest.raises(ParseError, match=problem):
        read_survey(path)
