"""A table of points whose places are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrary.calib.control_points import read_control_points
from calibrary.calib.estimation import estimate
from calibrary.calib.observations import Observations
from calibrary.calibration import CameraKey, Origin
from calibrary.errors import ParseError
from tests.calib.solving import camera

HEAD = "X,Y,Z,u,v,image\n"
SIZE = (640, 480)


def read(path: Path, text: str, origin: Origin = Origin.CORNER) -> Observations:
    path.write_text(text, encoding="utf-8")
    return read_control_points(path, SIZE, CameraKey(), origin)


def test_points_are_told_by_their_place(tmp_path: Path) -> None:
    seen = read(tmp_path / "p.csv", HEAD + "1,2,3,10,20,a\n1,2,3,11,21,b\n4,5,6,30,40,b\n")
    assert seen.board.points.tolist() == [[1000, 2000, 3000], [4000, 5000, 6000]]
    assert [view.name for view in seen.views] == ["a", "b"]
    assert seen.views[1].ids.tolist() == [0, 1]
    assert seen.views[1].image_points.tolist() == [[11, 21], [30, 40]]


def test_pixels_counted_from_the_first_ones_centre_are_moved(tmp_path: Path) -> None:
    seen = read(tmp_path / "p.csv", HEAD + "1,2,3,10,20,a\n", Origin.PIXEL_CENTRE)
    assert seen.views[0].image_points.tolist() == [[10.5, 20.5]]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_come_in_any_order_and_under_any_separator(tmp_path: Path, delimiter: str) -> None:
    rows = ("\ufeffimage,V,u,z,Y,x,note", "a,20,10,3,2,1,by hand", "")
    seen = read(tmp_path / "p.csv", "\r\n".join(rows).replace(",", delimiter))
    assert seen.board.points.tolist() == [[1000, 2000, 3000]]
    assert seen.views[0].image_points.tolist() == [[10, 20]]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,2,3,4,5,a\n", "line 1: has no column x, y, z"),
        (HEAD, "no rows"),
        (HEAD + "1,2,3,4\n", "line 2: has 4 cells"),
        (HEAD + "1,2,three,4,5,a\n", "line 2: could not convert"),
        (HEAD + "1,2,nan,4,5,a\n", "line 2: expected five finite numbers"),
        (HEAD + "1,2,3,4,5, \n", "line 2: expected five finite numbers and an image"),
        (HEAD + "1,2,3,4,5,a\n1,2,3,6,7,a\n", "line 3: repeats the point"),
    ],
)
def test_a_row_that_is_none_is_named_with_its_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ParseError, match=said):
        read(tmp_path / "p.csv", text)


def test_a_picture_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_bytes(b"\x89PNG\r\n\xff")
    with pytest.raises(ParseError, match="UTF-8"):
        read_control_points(tmp_path / "p.csv", SIZE, CameraKey(), Origin.CORNER)


def test_points_in_space_lead_to_the_camera_that_saw_them(tmp_path: Path) -> None:
    """Projected by an exact camera from three places, far from the origin as survey coordinates are."""
    truth = camera((1920, 1440), distortion=None)
    random = np.random.default_rng(3)
    points = random.uniform((-20, -15, 60), (20, 15, 90), (60, 3))
    rows = [HEAD]
    for name, shift in (("a", (0, 0, 0)), ("b", (6, -2, -5)), ("c", (-7, 4, 3))):
        pixels = truth.project(points - shift)
        rows += [
            f"{x + 500_000},{y + 4_600_000},{z},{u!r},{v!r},{name}\n"
            for (x, y, z), (u, v) in zip(points.tolist(), pixels.tolist(), strict=True)
        ]
    (tmp_path / "p.csv").write_text("".join(rows))
    seen = read_control_points(tmp_path / "p.csv", (1920, 1440), CameraKey(), Origin.CORNER)
    found = estimate(seen, "k1k2").calibration
    assert found.intrinsics.fx == pytest.approx(truth.intrinsics.fx, abs=1e-2)
    assert found.intrinsics.cx == pytest.approx(truth.intrinsics.cx, abs=1e-2)
