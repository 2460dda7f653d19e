"""Boards by name: their points, their markers, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary.calib.artwork import Cells, Discs, artwork, paper
from calibrary.calib.board import Board, Pattern, parse_board
from calibrary.errors import InputError

KALIBR_TAG_0 = "110101011101011000101000010110000100"
"""t36h11's first code, most significant bit first: as Kalibr prints it, row by row from the top, 1 is white."""


def test_a_name_gives_pattern_points_and_dictionary() -> None:
    board = parse_board(" Charuco:8x6:5X5_100 ", 30.0, 22.0)
    assert (board.pattern, board.columns, board.rows) == (Pattern.CHARUCO, 8, 6)
    assert (board.dictionary, board.marker_mm, board.square_mm) == ("5x5_100", 22.0, 30.0)


@pytest.mark.parametrize("name", ["circles:5x4", "acircles:4x11"])
def test_the_print_of_discs_ends_at_the_rims_of_the_outer_ones(name: str) -> None:
    board = parse_board(name, 20.0, 8.0)
    low, high = board.points[:, :2].min(axis=0) - 4.0, board.points[:, :2].max(axis=0) + 4.0
    assert artwork(board).extent_mm == pytest.approx((*low, *high))


@pytest.mark.parametrize(
    "text",
    ["checkerboard", "chess:9x6", "checkerboard:9", "checkerboard:9x6:4x4_50", "checkerboard:1x6", "x:9x6"],
)
def test_what_is_no_board_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_board(text, 40.0)


def test_points_run_row_by_row_from_the_first() -> None:
    points = Board(columns=3, rows=2, square_mm=10).points
    np.testing.assert_array_equal(
        points, [[0, 0, 0], [10, 0, 0], [20, 0, 0], [0, 10, 0], [10, 10, 0], [20, 10, 0]]
    )


def test_extent_is_that_of_the_outermost_points() -> None:
    assert Board(columns=11, rows=8, square_mm=40).extent == (400, 280)
    tags = parse_board("aprilgrid:6x5", 130.0)
    assert tags.extent == (5 * 130 + 100, 4 * 130 + 100)


def test_a_charuco_board_has_opencvs_corners_and_markers() -> None:
    board = parse_board("charuco:7x4", 40.0)
    assert board.dictionary == "4x4_50"
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    peer = cv2.aruco.CharucoBoard((8, 5), 40.0, 30.0, dictionary)
    corners = np.asarray(peer.getChessboardCorners(), dtype=np.float64)
    np.testing.assert_allclose(board.points, corners - corners[0])
    assert board.markers == len(peer.getIds())
    drawn = peer.generateImage((8 * 40, 5 * 40)) < 128
    cells = artwork(board)
    y, x = (np.mgrid[:200, :320].reshape(2, -1) + 0.5) - 40
    tiny = np.full(x.size, 1e-3)
    np.testing.assert_array_equal(cells.darkness(x, y, tiny, tiny).reshape(200, 320) > 0.5, drawn)


def test_an_april_grid_is_kalibrs() -> None:
    """Tag 0 in the lower left corner, its border two modules wide, dark squares where the gaps cross."""
    board = parse_board("aprilgrid:3x2", 13.0)
    cells = artwork(board)
    assert cells.extent_mm == pytest.approx((-3, -3, 39, 26))
    module = np.arange(10) + 0.5
    y, x = (v.ravel() for v in np.meshgrid(13 + module, module, indexing="ij"))
    tiny = np.full(100, 1e-3)
    tag = cells.darkness(x, y, tiny, tiny).reshape(10, 10) < 0.5
    assert "".join("01"[int(bit)] for bit in tag[2:8, 2:8].ravel()) == KALIBR_TAG_0
    border = np.ones((10, 10), dtype=bool)
    border[2:8, 2:8] = False
    assert not tag[border].any()
    at = np.array([-1.5, 11.5, 37.5, 11.5]), np.array([-1.5, 11.5, 24.5, 5.0])
    tiny = tiny[:4]
    np.testing.assert_allclose(cells.darkness(*at, tiny, tiny), [1, 1, 1, 0], atol=1e-5)


def test_a_tags_points_are_in_opencvs_order() -> None:
    board = parse_board("aprilgrid:3x2", 13.0)
    lower_right, lower_left, upper_left, upper_right = board.points[list(board.tag_points(0))]
    np.testing.assert_allclose(lower_right, [10, 23, 0])
    np.testing.assert_allclose(lower_left, [0, 23, 0])
    np.testing.assert_allclose(upper_left, [0, 13, 0])
    np.testing.assert_allclose(upper_right, [10, 13, 0])
    assert board.lattice == (6, 4)
    every = [point for tag in range(board.markers) for point in board.tag_points(tag)]
    assert sorted(every) == list(range(24))


def test_the_smallest_dictionary_that_has_enough_markers_is_taken() -> None:
    assert parse_board("charuco:12x9", 20.0).dictionary == "4x4_100"
    with pytest.raises(InputError, match="has 65 markers, 4x4_50 only 50"):
        parse_board("charuco:12x9:4x4_50", 20.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"square_mm": 0.0}, "positive length"),
        ({"square_mm": float("nan")}, "positive length"),
        ({"columns": 201}, "2 to 200"),
        ({"marker_mm": 10.0}, "expected none"),
        ({"pattern": Pattern.CHARUCO, "marker_mm": 41.0}, "expected a smaller one"),
        ({"pattern": Pattern.CHARUCO, "dictionary": "9x9_50"}, "not a known dictionary"),
        ({"pattern": Pattern.APRILGRID, "dictionary": "4x4_50"}, "AprilTags"),
    ],
)
def test_a_board_that_cannot_be_is_refused(changes: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"columns": 9, "rows": 6, "square_mm": 40.0}
    with pytest.raises(InputError, match=message):
        Board(**(given | changes))  # type: ignore[arg-type]  # fields of several types


def test_the_dark_share_of_a_box_is_exact() -> None:
    """Against a count over a fine grid, for boxes that lie across several squares and over the rim."""
    cells = artwork(Board(columns=3, rows=2, square_mm=10))
    assert isinstance(cells, Cells)
    for x, y, width, height in ((0, 0, 4, 6), (9, 3, 25, 7), (-10, -10, 5, 5), (29, 19, 8, 8), (3, 4, 1, 1)):
        u = x + width * ((np.arange(200) + 0.5) / 200 - 0.5)
        v = y + height * ((np.arange(200) + 0.5) / 200 - 0.5)
        column, row = np.floor(u / 10).astype(int) + 1, np.floor(v / 10).astype(int) + 1
        dark = (column[None] + row[:, None]) % 2 == 0
        dark &= ((column >= 0) & (column < 4))[None] & ((row >= 0) & (row < 3))[:, None]
        [share] = cells.darkness(*(np.array([float(value)]) for value in (x, y, width, height)))
        assert share == pytest.approx(dark.mean(), abs=0.005)


def test_one_tone_is_claimed_only_where_it_is_true() -> None:
    random = np.random.default_rng(1)
    for board in (
        Board(columns=4, rows=3, square_mm=10),
        parse_board("charuco:4x3", 16.0),
        parse_board("circles:4x3", 12.0),
    ):
        art = artwork(board)
        x, y = random.uniform(-40, 80, (2, 4000))
        width, height = random.uniform(0.1, 3.0, (2, 4000))
        tone = art.tone(x, y, width, height)
        known = ~np.isnan(tone)
        assert 0.2 < known.mean() < 1
        np.testing.assert_allclose(tone[known], art.darkness(x, y, width, height)[known], atol=1e-9)


def test_circles_are_dark_discs_on_every_point() -> None:
    art = artwork(parse_board("circles:4x3", 20.0))
    assert isinstance(art, Discs)
    x, y = np.array([0.0, 60.0, 4.9, 5.1, 10.0]), np.array([0.0, 40.0, 0.0, 0.0, 10.0])
    tiny = np.full(5, 1e-6)
    np.testing.assert_allclose(art.darkness(x, y, tiny, tiny), [1, 1, 1, 0, 0])


def test_the_sheet_leaves_a_square_of_white_around_the_print() -> None:
    assert paper(Board(columns=3, rows=2, square_mm=10)) == (-20, -20, 40, 30)
