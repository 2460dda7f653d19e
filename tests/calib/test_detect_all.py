"""Collecting: every frame read, judged and listed, whatever becomes of the others."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from calibrary.arrays import FloatArray
from calibrary.calib.detection import Detections, detect, detect_all, find_board
from calibrary.calib.found import Found, Reason, Remark
from calibrary.calib.frames import Setting
from calibrary.calib.observations import View
from calibrary.calib.synthesis import Settings
from calibrary.calib.view_quality import judge_repeats, judge_view
from calibrary.calibration import CameraKey
from calibrary.errors import CalibrationError, InputError
from calibrary.records import replace
from tests.calib.photographs import BOARD, PLAIN, SIZE, encoded, photograph, saved
from tests.thorough import every


def reasons(collected: Detections) -> list[tuple[str, Reason]]:
    return [(entry.name, entry.reason) for entry in collected.rejected]


def remarks_on(settings: Settings, *, number: int = 1) -> tuple[Remark, ...]:
    gray, _ = photograph(number=number, settings=settings)
    answer = detect(gray, BOARD)
    assert isinstance(answer, Found), answer
    return judge_view(gray, BOARD, answer)[1]


class TestOneView:
    def test_a_good_one_has_no_remarks(self) -> None:
        assert remarks_on(PLAIN) == ()

    def test_blur_is_measured_in_pixels(self) -> None:
        (remark,) = remarks_on(Settings(blur_px=3.0))
        assert remark.reason is Reason.BLURRED
        assert remark.text.startswith("blurred 8.")
        assert "expected < 8" in remark.text
        assert not remark.rejects

    def test_a_dragged_view_is_wide_in_one_direction_only(self) -> None:
        (remark,) = remarks_on(Settings(motion_px=(10.0, 0.0)))
        assert remark.reason is Reason.DRAGGED
        assert "hold still" in remark.text

    def test_white_that_saturates(self) -> None:
        assert [remark.reason for remark in remarks_on(Settings(tones=(0.05, 1.0), vignetting=0.0))] == [
            Reason.OVEREXPOSED
        ]

    def test_a_board_in_the_dark(self) -> None:
        assert Reason.LOW_CONTRAST in {remark.reason for remark in remarks_on(Settings(tones=(0.02, 0.04)))}

    def test_glare_over_dark_squares_is_counted(self) -> None:
        gray, _ = photograph(number=1)
        answer = detect(gray, BOARD)
        assert isinstance(answer, Found)
        assert answer.lattice is not None
        flooded = gray.copy()
        dark_cell = answer.lattice[2:4, 2:4].reshape(-1, 2)[[0, 1, 3, 2]]
        cv2.fillConvexPoly(flooded, np.rint(dark_cell).astype(np.int32), 240)
        (remark,) = judge_view(flooded, BOARD, answer)[1]
        assert remark.reason is Reason.GLARE
        assert remark.text.startswith("glare over 1 of 20 dark squares")

    def test_small_squares(self) -> None:
        gray, _ = photograph(number=1)
        small = cv2.resize(gray, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA).astype(np.uint8)
        answer = detect(small, BOARD)
        assert isinstance(answer, Found)
        assert [remark.reason for remark in judge_view(small, BOARD, answer)[1]] == [Reason.SMALL]


class TestRepeats:
    def view(self, name: str, points: FloatArray, sha256: str | None = None) -> View:
        return View(
            name=name, sha256=sha256, ids=np.arange(len(points)), image_points=points, spacing_px=30.0
        )

    def test_the_same_file_under_another_name(self) -> None:
        points = photograph()[1]
        printed = judge_repeats([self.view("a", points, "11"), self.view("b", points, "11")])
        assert {index: remark.text for index, remark in printed.items()} == {1: "the same file as a"}

    def test_the_same_pose_in_another_file(self) -> None:
        points = photograph()[1]
        tremble = np.random.default_rng(0).normal(0, 0.1, points.shape)
        printed = judge_repeats([self.view("a", points, "11"), self.view("b", points + tremble, "22")])
        assert printed[1].reason is Reason.SAME_POSE
        assert printed[1].text.startswith("the same pose as a, corners 0.1")

    def test_a_board_that_was_moved_is_no_repeat(self) -> None:
        points = photograph()[1]
        assert judge_repeats([self.view("a", points), self.view("b", points + 2.0)]) == {}

    def test_views_of_different_parts_are_compared_by_what_they_share(self) -> None:
        points = photograph()[1]
        part = replace(self.view("b", points[:40]), ids=np.arange(40))
        few = replace(self.view("c", points[:20]), ids=np.arange(20))
        assert set(judge_repeats([self.view("a", points), part, few])) == {1}


class TestFrames:
    def test_views_come_in_the_order_of_the_frames(self, tmp_path: Path) -> None:
        paths = saved(tmp_path, 4)
        ticks: list[int] = []
        setting = Setting(camera=CameraKey(make="Acme", firmware="1.2"), image_size=SIZE, focus="1.5 m")
        collected = detect_all(paths, BOARD, setting=setting, progress=ticks.append)
        seen = collected.observations
        assert [view.name for view in seen.views] == [path.name for path in paths]
        assert (seen.image_size, seen.camera.image_size, seen.focus, seen.firmware) == (
            SIZE,
            SIZE,
            "1.5 m",
            "1.2",
        )
        assert ticks == [1, 1, 1, 1]
        for number, view in enumerate(seen.views):
            assert np.abs(view.image_points - photograph(number=number)[1][view.ids]).max() < 0.15
        assert collected.rejected == ()

    def test_workers_give_the_same_to_the_bit(self, tmp_path: Path) -> None:
        paths = saved(tmp_path, 3)
        alone, together = (detect_all(paths, BOARD, workers=workers).observations.views for workers in (1, 2))
        for one, other in zip(alone, together, strict=True):
            assert np.array_equal(one.image_points, other.image_points)
            assert (one.name, one.sha256, one.sharpness_px) == (other.name, other.sha256, other.sharpness_px)

    def test_bad_frames_are_listed_and_stop_no_other(self, tmp_path: Path) -> None:
        paths = saved(tmp_path, 2)
        good = paths[0].read_bytes()
        empty = encoded(np.full((480, 640), 90, np.uint8), "PNG")
        for name, content in (
            ("text.jpg", b"no image"),
            ("cut.png", good[:9000]),
            ("empty.png", empty),
            ("copy.png", good),
        ):
            (tmp_path / name).write_bytes(content)
            paths.append(tmp_path / name)
        collected = detect_all(paths, BOARD)
        assert len(collected.observations.views) == 2
        assert reasons(collected) == [
            ("text.jpg", Reason.UNREADABLE),
            ("cut.png", Reason.UNREADABLE),
            ("empty.png", Reason.NO_BOARD),
            ("copy.png", Reason.SAME_FILE),
        ]
        assert str(collected.rejected[3]) == "copy.png: the same file as frame_00.png"

    def test_frames_of_two_sizes_are_not_mixed(self, tmp_path: Path) -> None:
        paths = saved(tmp_path, 2)
        Image.fromarray(photograph()[0][:400]).save(tmp_path / "odd.png")
        with pytest.raises(
            InputError, match=r"2 sizes: 2 of 640×480 px \(frame_00.png, frame_01.png\); 1 of 640×400"
        ):
            detect_all([*paths, tmp_path / "odd.png"], BOARD)

    def test_no_frames_at_all(self) -> None:
        with pytest.raises(InputError, match="no frames"):
            detect_all([], BOARD)

    def test_no_readable_frame_at_all(self, tmp_path: Path) -> None:
        (tmp_path / "a.jpg").write_bytes(b"")
        (tmp_path / "b.jpg").write_bytes(b"")
        with pytest.raises(
            InputError, match=r"none of 2 frames can be read; the first, a.jpg: an empty file"
        ):
            detect_all([tmp_path / "a.jpg", tmp_path / "b.jpg"], BOARD)
        with pytest.raises(InputError, match=r"^a.jpg: an empty file"):
            detect_all([tmp_path / "a.jpg"], BOARD)

    def test_no_board_anywhere(self, tmp_path: Path) -> None:
        path = tmp_path / "wall.png"
        path.write_bytes(encoded(np.full((480, 640), 90, np.uint8), "PNG"))
        with pytest.raises(
            CalibrationError,
            match="no checkerboard:9x6 found in any of 1 frames; neither squares nor markers",
        ):
            detect_all([path], BOARD)

    @pytest.mark.parametrize(("columns", "rows"), every(2, [(10, 7), (8, 5)]))
    def test_a_wrong_board_size_is_answered_by_the_right_one(
        self, tmp_path: Path, columns: int, rows: int
    ) -> None:
        with pytest.raises(CalibrationError, match=r"it has 9×6 inner corners; give checkerboard:9x6"):
            detect_all(saved(tmp_path, 2), replace(BOARD, columns=columns, rows=rows))

    def test_where_most_frames_show_a_larger_board_it_is_named(self, tmp_path: Path) -> None:
        part = tmp_path / "part.png"
        part.write_bytes(encoded(photograph("checkerboard:6x4")[0], "PNG"))
        with pytest.raises(
            CalibrationError,
            match=r"in 1 of 3 frames, but it has 9×6 inner corners; give checkerboard:9x6",
        ):
            detect_all([part, *saved(tmp_path, 2)], replace(BOARD, columns=6, rows=4))

    def test_a_board_of_unknown_size_is_found_by_trying(self, tmp_path: Path) -> None:
        paths = saved(tmp_path, 2)
        (tmp_path / "broken.png").write_bytes(b"\x89PNG")
        assert find_board([tmp_path / "broken.png", *paths], 40.0)[0] == BOARD

    def test_opencvs_threads_are_left_as_they_were(self, tmp_path: Path) -> None:
        before = cv2.getNumThreads()
        detect_all(saved(tmp_path, 1), BOARD)
        assert cv2.getNumThreads() == before
