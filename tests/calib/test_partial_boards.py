"""Checkerboards that leave the frame, or of which something hides a part."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.detection import detect
from calibrary.calib.estimation import estimate
from calibrary.calib.found import Found, NotFound, Reason
from calibrary.calib.observations import View
from calibrary.calib.synthesis import Pose, Settings, poses, render, seen_corners
from calibrary.calibration import Calibration
from calibrary.records import replace
from tests.calib.photographs import CAMERA, SIZE, Gray, photograph
from tests.calib.solving import Session, shoot
from tests.calib.staging import BOARD
from tests.thorough import every


def towards(board: Board, camera: Calibration, pose: Pose, x: float, y: float) -> Pose:
    """The pose with the board's middle moved to a place of the frame, in shares of it."""
    middle = pose.matrix @ board.points.mean(axis=0) + np.array(pose.translation_mm)
    width, height = camera.intrinsics.image_size
    ray = camera.unproject([[x * width, y * height]])[0]
    moved = np.array(pose.translation_mm) + ray / ray[2] * middle[2] - middle
    return replace(pose, translation_mm=(float(moved[0]), float(moved[1]), float(moved[2])))


def off_centre(x: float, y: float, *, number: int = 0, board: Board = BOARD) -> tuple[Gray, FloatArray]:
    """A frame with the board's middle at a place, and where all of its points would be seen."""
    pose = poses(board, CAMERA, number + 1, 5, 25.0, (0.6, 0.9))[number]
    pose = towards(board, CAMERA, pose, x, y)
    settings = Settings(noise=4.0)
    truth = seen_corners(board, CAMERA, pose, settings.sheet, settings.shutter)
    return np.ascontiguousarray(render(board, CAMERA, pose, settings, number).astype(np.uint8)), truth


def inside(truth: FloatArray, margin: float = 12.0) -> int:
    return int(((truth > margin) & (truth < np.array(SIZE) - margin)).all(axis=1).sum())


def remark(found: Found) -> str:
    [text] = [one.text for one in found.remarks if one.reason is Reason.PARTIAL_BOARD]
    return text


@pytest.mark.parametrize(("x", "y"), every(2, [(0.95, 0.5), (0.1, 0.3), (0.5, 1.0), (0.85, 0.1)]))
def test_what_is_inside_the_frame_is_found_and_counted_from_the_boards_first_corner(
    x: float, y: float
) -> None:
    gray, truth = off_centre(x, y)
    assert inside(truth) < 0.8 * len(truth)
    found = detect(gray, BOARD)
    assert isinstance(found, Found)
    assert len(found.ids) > 0.7 * inside(truth)
    assert np.hypot(*(found.points - truth[found.ids]).T).max() < 0.5
    assert "corners seen" in remark(found)


def test_a_part_without_an_end_is_counted_from_somewhere_and_says_so() -> None:
    board = Board(columns=20, rows=16, square_mm=20)
    pose = Pose(rotation=(0.15, 0.1, 0.05), translation_mm=(-190.0, -150.0, 150.0))
    truth = seen_corners(board, CAMERA, pose, Settings().sheet, Settings().shutter)
    gray = np.ascontiguousarray(render(board, CAMERA, pose, Settings(), 1).astype(np.uint8))
    found = detect(gray, board)
    assert isinstance(found, Found)
    assert "is not known" in remark(found)
    # Every corner is one of the board's, and neighbours are neighbours: all are off by the same step.
    nearest = np.nan_to_num(np.hypot(*np.moveaxis(found.points[:, None] - truth, 2, 0)), nan=np.inf).argmin(
        axis=1
    )
    assert np.hypot(*(found.points - truth[nearest]).T).max() < 0.5
    rows, columns = np.divmod(found.ids, 20) - np.array(np.divmod(nearest, 20))
    assert len(set(rows)) == len(set(columns)) == 1
    assert (rows[0] + columns[0]) % 2 == 0


def test_a_marker_in_the_middle_leaves_the_corners_around_it_in_their_place() -> None:
    frame, truth = photograph("checkerboard:11x9")
    gray, grid = frame.copy(), truth.reshape(9, 11, 2)
    hole = np.array([grid[3, 4], grid[3, 6], grid[5, 6], grid[5, 4]]).round().astype(np.int32)
    cv2.fillConvexPoly(gray, hole, 20)
    board = Board(columns=11, rows=9, square_mm=None)
    found = detect(gray, board)
    assert isinstance(found, Found)
    # The middle of the hole and the middles of its sides are no corners any more, two of its own corners still are.
    gone = {4 * 11 + 5, 3 * 11 + 5, 5 * 11 + 5, 4 * 11 + 4, 4 * 11 + 6}
    assert not gone & set(found.ids.tolist())
    assert len(found.ids) >= 90
    # Even so a board that looks alike from both ends begins at either.
    turned = truth[::-1]
    assert min(np.abs(found.points - there[found.ids]).max() for there in (truth, turned)) < 1.0


def test_a_heated_board_shows_its_colours_the_other_way_round() -> None:
    gray, truth = off_centre(0.95, 0.5)
    found = detect(255 - gray, BOARD)
    assert isinstance(found, Found)
    nearest = np.hypot(*np.moveaxis(found.points[:, None] - truth, 2, 0)).min(axis=1)
    assert nearest.max() < 0.5


@pytest.mark.thorough
@pytest.mark.parametrize(("columns", "rows"), [(12, 9), (10, 6), (9, 8)])
def test_a_whole_smaller_board_is_no_part_of_a_larger_one(columns: int, rows: int) -> None:
    found = detect(photograph()[0], Board(columns=columns, rows=rows, square_mm=40))
    assert isinstance(found, NotFound)


def test_a_bowed_boards_k_does_not_depend_on_where_its_parts_are_counted_from() -> None:
    seen = shoot(how=Session(views=16, bow_mm=0.6), seed=4)
    columns = seen.board.columns if isinstance(seen.board, Board) else 0

    def part(view: View, by: int) -> View:
        row, column = np.divmod(view.ids, columns)
        kept = (column < 7) & (row < 6)
        return replace(
            view, ids=row[kept] * columns + column[kept] + by, image_points=view.image_points[kept]
        )

    here, there = (
        replace(seen, views=tuple(part(one, by) if at % 4 == 0 else one for at, one in enumerate(seen.views)))
        for by in (0, 2 * columns + 4)
    )
    one, other = (estimate(each, "brown").calibration for each in (here, there))
    assert one.quality is not None
    for name in ("fx", "fy", "cx", "cy"):
        change = getattr(one.intrinsics, name) - getattr(other.intrinsics, name)
        assert abs(change) < 0.5 * one.quality.std[name]
