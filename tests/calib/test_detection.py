"""Detection: points where the truth says and in its order, and nothing where there is no whole board."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board, parse_board
from calibrary.calib.detection import detect
from calibrary.calib.detectors.checkerboard import _quick
from calibrary.calib.detectors.refinement import DETECTION_SIDE, enlarged, half_window, reduced
from calibrary.calib.detectors.reliability import reliable
from calibrary.calib.found import Found, NotFound, Reason
from calibrary.calib.synthesis import Settings, poses, render, seen_corners
from calibrary.distortion import KannalaBrandt
from calibrary.errors import InputError
from tests.calib.photographs import BOARD, Gray, photograph
from tests.calib.staging import camera
from tests.thorough import every

NOWHERE: Gray = np.clip(np.random.default_rng(1).normal(120, 40, (480, 640)), 0, 255).astype(np.uint8)


def found(gray: Gray, name: str = "checkerboard:9x6") -> Found:
    answer = detect(gray, parse_board(name, 40.0))
    assert isinstance(answer, Found), answer
    return answer


def not_found(gray: Gray, name: str = "checkerboard:9x6") -> NotFound:
    answer = detect(gray, parse_board(name, 40.0))
    assert isinstance(answer, NotFound)
    return answer


def errors(answer: Found, truth: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(*(answer.points - truth[answer.ids]).T))


class TestEveryPattern:
    @pytest.mark.parametrize("number", every(3, range(3)))
    @pytest.mark.parametrize(
        ("name", "limit_px"),
        [
            ("checkerboard:9x6", 0.15),
            ("charuco:8x6", 0.25),
            ("aprilgrid:5x4", 0.25),
            ("circles:9x7", 0.25),
        ],
    )
    def test_points_lie_where_the_truth_says_and_in_its_order(
        self, name: str, limit_px: float, number: int
    ) -> None:
        gray, truth = photograph(name, number)
        answer = found(gray, name)
        assert len(answer.ids) >= 0.9 * len(truth)
        assert errors(answer, truth).max() < limit_px
        assert np.abs((answer.points - truth[answer.ids]).mean(axis=0)).max() < 0.03

    @pytest.mark.parametrize("name", ["checkerboard:9x6", "aprilgrid:5x4", "circles:9x7"])
    def test_where_there_is_no_board_it_says_so(self, name: str) -> None:
        assert not_found(NOWHERE, name).reason is Reason.NO_BOARD

    def test_a_part_of_an_aprilgrid_is_enough(self) -> None:
        gray, truth = photograph("aprilgrid:5x4", 1)
        half = gray.copy()
        half[:, int(truth[:, 0].mean()) :] = 128
        answer = found(half, "aprilgrid:5x4")
        assert 16 <= len(answer.ids) < len(truth)
        assert errors(answer, truth).max() < 0.25


class TestCheckerboard:
    @pytest.mark.parametrize("name", every(3, ["checkerboard:9x6", "checkerboard:8x7", "checkerboard:7x4"]))
    def test_a_board_held_upside_down_begins_at_the_same_square(self, name: str) -> None:
        for upside_down in (False, True):
            gray, truth = photograph(name, 1, upside_down=upside_down)
            assert errors(found(gray, name), truth).max() < 0.15

    @pytest.mark.parametrize("name", every(3, ["checkerboard:8x6", "checkerboard:6x6", "checkerboard:7x7"]))
    def test_a_board_that_looks_alike_from_both_ends_begins_at_the_left(self, name: str) -> None:
        for upside_down in (False, True):
            answer = found(photograph(name, 1, upside_down=upside_down)[0], name)
            assert answer.lattice is not None
            run = (answer.lattice[:, -1] - answer.lattice[:, 0]).mean(axis=0)
            assert run[0] > abs(run[1])

    @pytest.mark.thorough
    @pytest.mark.parametrize(("columns", "rows"), [(9, 5), (8, 5)])
    def test_a_part_of_a_larger_board_is_not_taken_for_the_board(self, columns: int, rows: int) -> None:
        for number in range(2):
            not_found(photograph(number=number)[0], f"checkerboard:{columns}x{rows}")

    @pytest.mark.thorough
    @pytest.mark.parametrize(("columns", "rows"), [(10, 6), (9, 7)])
    def test_a_larger_board_is_not_found_in_a_smaller_one(self, columns: int, rows: int) -> None:
        for number in range(2):
            not_found(photograph(number=number)[0], f"checkerboard:{columns}x{rows}")

    def test_a_covered_corner_is_left_out_and_named(self) -> None:
        gray, truth = photograph(number=1)
        covered = gray.copy()
        x, y = np.rint(truth[23]).astype(int)
        answer = found(gray)
        reach = max(2, int(answer.spacing_px / 7))
        covered[y - reach : y + reach, x - reach : x + reach] = 128
        answer = found(covered)
        if 23 in answer.ids:
            assert errors(answer, truth)[answer.ids == 23] < 0.35
        else:
            assert [remark.reason for remark in answer.remarks] == [Reason.DISPLACED_CORNERS]
        assert np.median(errors(answer, truth)) < 0.1

    def test_corners_whose_window_leaves_the_frame_are_left_out_and_named(self) -> None:
        gray = photograph(number=1)[0]
        seen = found(gray).points
        shifted = seen - (seen[:, 0].min() - 5.0, 0.0)
        answer = reliable(gray, BOARD, np.arange(54), shifted, half=7, spacing_px=30.0)
        assert isinstance(answer, Found)
        assert [remark.reason for remark in answer.remarks] == [Reason.AT_BORDER]
        assert np.array_equal(answer.ids, np.flatnonzero(shifted[:, 0] >= 8))

    def test_the_window_grows_with_the_squares_between_three_and_fifteen(self) -> None:
        assert [half_window(spacing) for spacing in (5, 20, 40, 50, 500)] == [3, 6, 12, 15, 15]

    def test_a_point_of_the_reduced_copy_lies_as_far_across_the_whole_image(self) -> None:
        # A copy of 4 x 3 px of an image of 20 x 12 px: the edges of both lie half a pixel outside.
        corners = np.array([[-0.5, -0.5], [1.5, 1.0], [3.5, 2.5]])
        assert enlarged(corners, np.array([5.0, 4.0])).tolist() == [[-0.5, -0.5], [9.5, 5.5], [19.5, 11.5]]

    def test_an_odd_last_row_or_column_moves_nothing_in_the_reduced_copy(self) -> None:
        frame = np.zeros((2881, 3841), dtype=np.uint8)
        frame[2800:2810, 3800:3810] = 255
        small, scale = reduced(frame)
        middle = (
            np.array([small.sum(axis=0) @ np.arange(1280), small.sum(axis=1) @ np.arange(960)]) / small.sum()
        )
        assert np.abs(enlarged(middle[None], scale) - (3804.5, 2804.5)).max() < 0.2

    def test_a_strip_is_reduced_to_no_less_than_one_row(self) -> None:
        assert reduced(np.zeros((2, 16000), dtype=np.uint8))[0].shape == (1, 1280)

    def test_a_large_frame_gives_the_corners_of_its_full_resolution(self) -> None:
        small, truth = photograph(number=2)
        large = cv2.resize(small, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC).astype(np.uint8)
        assert np.abs(found(large).points - 5 * truth).max() < 5 * 0.15

    def test_noise_blur_and_dim_light_move_corners_by_a_tenth_of_a_pixel(self) -> None:
        gray, truth = photograph(settings=Settings(blur_px=1.5, noise=5.0, tones=(0.05, 0.4), quality=75))
        assert np.sqrt((errors(found(gray), truth) ** 2).mean()) < 0.2


class TestBoardsThatCannotBeLookedFor:
    def test_a_checkerboard_of_two_corners_a_side(self) -> None:
        with pytest.raises(InputError, match="at least 3 points"):
            detect(NOWHERE, Board(columns=2, rows=6, square_mm=40))


@pytest.mark.thorough
def test_a_board_at_the_edge_of_a_fisheyes_view_is_regular() -> None:
    fisheye = camera(fx=431.0, distortion=KannalaBrandt(k1=0.01, k2=-0.004, k3=0.0, k4=0.0))
    board, settings = parse_board("checkerboard:9x6", 40.0), Settings()
    for number, pose in enumerate(poses(board, fisheye, 8, 4, fill=(0.5, 0.7), roll_deg=180.0)):
        gray = render(board, fisheye, pose, settings, number).astype(np.uint8)
        answer = found(gray)
        truth = seen_corners(board, fisheye, pose, settings.sheet, settings.shutter)
        assert errors(answer, truth).max() < 0.3


@pytest.mark.parametrize(("side", "checked"), [(DETECTION_SIDE - 1, False), (DETECTION_SIDE, True)])
def test_an_image_that_was_made_smaller_is_checked_for_a_board_before_it_is_searched(
    side: int, checked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def searched(_: Gray, __: tuple[int, int], *, flags: int) -> tuple[bool, None]:
        asked.append(flags)
        return False, None

    monkeypatch.setattr(cv2, "findChessboardCorners", searched)
    assert _quick(np.zeros((40, side), np.uint8), (9, 6)) is None
    assert [bool(flags & cv2.CALIB_CB_FAST_CHECK) for flags in asked] == [checked]
