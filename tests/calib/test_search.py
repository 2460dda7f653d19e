"""A board that is not known, or named wrongly: what was seen decides, and is said."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrary.calib.board import Board, parse_board
from calibrary.calib.detection import detect, detect_all
from calibrary.calib.detectors.anymarkers import Markers, laid_out
from calibrary.calib.found import Found
from calibrary.calib.search import Seen, board_of, contradiction, look, look_until_sure
from calibrary.errors import CalibrationError
from tests.calib.photographs import BOARD, Gray, encoded, photograph
from tests.thorough import every

NOWHERE: Gray = np.clip(np.random.default_rng(1).normal(120, 40, (480, 640)), 0, 255).astype(np.uint8)


def seen_from_the_side(print_: Gray, number: int) -> Gray:
    """A photograph of a print on a dark table, from one of several sides."""
    height, width = print_.shape
    paper = np.pad(print_, 30, constant_values=255)
    rim = np.array([(0, 0), (width + 60, 0), (width + 60, height + 60), (0, height + 60)], np.float32)
    tilt = 0.06 * (number + 1)
    seen = np.array(
        [(70 + 200 * tilt, 60), (590, 70 + 90 * tilt), (570 - 90 * tilt, 420), (60, 400)], np.float32
    )
    view = cv2.warpPerspective(
        paper, cv2.getPerspectiveTransform(rim, seen), (640, 480), flags=cv2.INTER_AREA, borderValue=(60,)
    )
    noise = np.random.default_rng(number).normal(0, 2, view.shape)
    soft = np.asarray(cv2.GaussianBlur(view, (0, 0), 0.7), dtype=np.float64)
    return np.asarray(np.clip(soft * 0.8 + 15 + noise, 0, 255), dtype=np.uint8)


@cache
def charuco(across: int, down: int, dictionary: str, *, legacy: bool = False) -> tuple[Gray, ...]:
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))
    board = cv2.aruco.CharucoBoard((across, down), 1.0, 0.75, markers)
    board.setLegacyPattern(legacy)
    drawn = np.asarray(board.generateImage((across * 56, down * 56)), dtype=np.uint8)
    return tuple(seen_from_the_side(drawn, number) for number in range(3))


def cut_board(columns: int, rows: int, share: float) -> Gray:
    """A checkerboard whose outer squares are narrower than the others."""
    edges = [np.cumsum([0, share, *[1] * (corners - 1), share]) * 50 for corners in (columns, rows)]
    x, y = (np.searchsorted(edge, np.arange(int(edge[-1])), side="right") for edge in edges)
    return np.asarray(np.where((x[None, :] + y[:, None]) % 2, 255, 0), dtype=np.uint8)


def saved(folder: Path, frames: tuple[Gray, ...]) -> list[Path]:
    paths = [folder / f"{number}.png" for number in range(len(frames))]
    for path, frame in zip(paths, frames, strict=True):
        path.write_bytes(encoded(frame, "PNG"))
    return paths


class TestCheckerboards:
    @pytest.mark.parametrize("size", every(2, ["9x6", "8x6", "7x7", "6x4"]))
    def test_the_size_is_found(self, size: str) -> None:
        frames = [photograph(f"checkerboard:{size}", number)[0] for number in range(2)]
        assert str(board_of(look_until_sure(frames), None)[0]) == f"checkerboard:{size}"

    @pytest.mark.parametrize("share", [0.4, 0.5])
    def test_outer_squares_may_be_cut(self, share: float) -> None:
        frame = seen_from_the_side(cut_board(9, 6, share), 0)
        assert str(board_of([look(frame)], None)[0]) == "checkerboard:9x6"
        answer = detect(frame, BOARD)
        assert isinstance(answer, Found)
        assert len(answer.ids) == 54

    def test_frames_without_a_board_do_not_vote(self) -> None:
        assert board_of(look_until_sure([NOWHERE, photograph()[0]]), 40.0)[0] == BOARD

    def test_two_boards_are_a_question_for_the_user(self) -> None:
        records = look_until_sure([photograph("checkerboard:6x4")[0], photograph()[0]])
        with pytest.raises(CalibrationError, match="name the right one"):
            board_of(records, None)

    def test_no_more_frames_are_read_than_are_needed(self) -> None:
        frames = iter([photograph(number=number)[0] for number in (0, 1, 2, 0, 1)])
        look_until_sure(frames)
        assert len(list(frames)) == 2

    def test_a_part_of_a_board_is_said_to_be_seen(self) -> None:
        part = photograph()[0].copy()
        part[:300, :320] = NOWHERE[:300, :320]
        with pytest.raises(
            CalibrationError, match=r"squares seen in 1 of 1 frames, but no checkerboard as a whole"
        ):
            board_of([look(part)], None)

    def test_nothing_is_said_of_frames_that_show_nothing(self) -> None:
        with pytest.raises(CalibrationError, match="neither squares nor markers found in 1 frames"):
            board_of([look(NOWHERE)], None)


class TestMarkers:
    @pytest.mark.thorough
    @pytest.mark.parametrize(
        ("across", "down", "dictionary", "legacy"),
        every(
            2,
            [
                (8, 6, "5X5_100", True),
                (8, 6, "4X4_50", False),
                (5, 7, "6X6_250", False),
                (7, 5, "APRILTAG_36h11", False),
            ],
        ),
    )
    def test_a_charuco_board_is_found(self, across: int, down: int, dictionary: str, legacy: bool) -> None:
        board, described = board_of(look_until_sure(charuco(across, down, dictionary, legacy=legacy)), None)
        assert (board.columns, board.rows) == (across - 1, down - 1)
        assert (board.dictionary or "")[:3] == dictionary.lower()[:3]
        assert ("before OpenCV 4.6" in described) == legacy

    @pytest.mark.thorough
    def test_an_aprilgrid_is_found(self) -> None:
        frames = [photograph("aprilgrid:6x5", number)[0] for number in range(2)]
        board, _ = board_of(look_until_sure(frames), 40.0)
        assert board == parse_board("aprilgrid:6x5", 40.0)

    def test_a_layout_of_before_opencv_4_6_is_measured_if_named(self) -> None:
        answers = [
            detect(frame, parse_board("charuco:7x5", 40.0)) for frame in charuco(8, 6, "4X4_50", legacy=True)
        ]
        assert [len(answer.ids) for answer in answers if isinstance(answer, Found)] == [35, 35, 35]

    def test_unarranged_markers_are_said_to_be_seen(self) -> None:
        at = np.random.default_rng(4).uniform(100, 500, (8, 1, 2))
        quads = at + 9 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        markers = Markers(dictionary="4x4_1000", ids=np.arange(8), quads=quads)
        assert laid_out(markers) is None
        seen = Seen(lattice=None, whole=False, markers=(markers,))
        with pytest.raises(
            CalibrationError, match="8 markers of 4x4_1000 seen in 1 of 1 frames, arranged as on no"
        ):
            board_of([seen], None)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        (
            "charuco:5x7",
            "its columns and rows are exchanged, it has 7×5 inner corners; give charuco:7x5:4x4_50",
        ),
        ("charuco:8x6", "8×6 are its squares, it has 7×5 inner corners; give charuco:7x5:4x4_50"),
        ("charuco:7x5:5x5_50", "its markers are of 4x4_50, not 5x5_50; give charuco:7x5:4x4_50"),
        ("checkerboard:7x5", "the frames show 7×5 inner corners on a charuco; give charuco:7x5:4x4_50"),
        ("charuco:7x4", "it has 7×5 inner corners; give charuco:7x5:4x4_50"),
    ],
)
def test_a_board_named_wrongly_is_answered_by_the_right_one(stated: str, expected: str) -> None:
    assert contradiction(parse_board(stated, None), parse_board("charuco:7x5", None)) == expected


@pytest.mark.parametrize("stated", ["charuco:7x5:4x4_250", "charuco:7x9"])
def test_a_board_of_which_a_part_is_seen_is_no_other(stated: str) -> None:
    assert contradiction(parse_board(stated, None), parse_board("charuco:7x5", None)) is None


def test_a_checkerboard_may_be_turned() -> None:
    assert (
        contradiction(parse_board("checkerboard:6x9", None), Board(columns=9, rows=6, square_mm=None)) is None
    )


@pytest.mark.thorough
def test_what_frames_show_is_said_when_the_board_is_not_found(tmp_path: Path) -> None:
    paths = saved(tmp_path, charuco(8, 6, "4X4_50"))
    with pytest.raises(
        CalibrationError,
        match=r"no charuco:5x7 found in any of 3 frames, but its columns and rows are exchanged",
    ):
        detect_all(paths, parse_board("charuco:5x7", 40.0))
    assert len(detect_all(paths, None).observations.views) == 3
