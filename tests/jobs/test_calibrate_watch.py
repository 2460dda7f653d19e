"""Frames of a board that arrive one by one."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from calibrary.calib.board import Board
from calibrary.calib.estimation import estimate
from calibrary.calib.next_pose import next_pose
from calibrary.calib.synthesis.sheet import Pose
from calibrary.cli.main import main
from calibrary.jobs.calibrate_watch.session import Watch
from calibrary.records import replace
from calibrary.rotations import rotation_matrix, rotation_vector
from calibrary.schemas import require
from calibrary.validation import Use
from tests.calib.observing import observe
from tests.calib.photographs import BOARD as SMALL
from tests.calib.photographs import saved
from tests.calib.solving import BOARD, Session, camera, shoot


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return saved(tmp_path_factory.mktemp("taken"), 5)


def arrive(folder: Path, frame: Path) -> None:
    folder.mkdir(exist_ok=True)
    shutil.copy(frame, folder / frame.name)


class TestArrival:
    def test_a_frame_counts_once_it_no_longer_grows(self, tmp_path: Path, frames: list[Path]) -> None:
        watch = Watch(tmp_path, SMALL)
        content, path = frames[0].read_bytes(), tmp_path / "a.png"
        path.write_bytes(content[:1000])
        assert watch.poll() is None
        time.sleep(0.02)
        path.write_bytes(content)
        # It has changed since the last look: still being written.
        assert watch.poll() is None
        status = watch.poll()
        assert status is not None
        assert [(frame.name, frame.corners) for frame in status.new] == [("a.png", 54)]
        assert watch.poll() is None

    def test_it_says_what_each_frame_showed_and_what_to_photograph_next(
        self, tmp_path: Path, frames: list[Path]
    ) -> None:
        (tmp_path / "cut.png").write_bytes(frames[0].read_bytes()[:5000])
        arrive(tmp_path, frames[0])
        shutil.copy(frames[0], tmp_path / "again.png")
        watch = Watch(tmp_path, SMALL)
        status = watch.poll(settled=True)
        assert status is not None
        corners = {frame.name: frame.corners for frame in status.new}
        assert corners == {"again.png": 54, "cut.png": 0, frames[0].name: 54}
        # The same file twice is one view.
        assert (status.frames, status.views, status.verdict) == (3, 1, None)
        assert status.missing == ("1 views count, need 3",)
        assert status.next is not None
        assert status.next.gain > 0

    @pytest.mark.thorough
    def test_what_was_watched_is_read_again_by_the_next_session(
        self, tmp_path: Path, frames: list[Path]
    ) -> None:
        for frame in frames[:3]:
            arrive(tmp_path, frame)
        first = Watch(tmp_path, SMALL)
        first.poll(settled=True)
        for frame in frames[3:]:
            arrive(tmp_path, frame)
        one, other = first.poll(settled=True), Watch(tmp_path, SMALL).poll(settled=True)
        assert one is not None
        assert other is not None
        assert replace(one, new=()) == replace(other, new=())

    @pytest.mark.thorough
    def test_sigma_is_that_of_the_calibration_from_the_same_frames(
        self, tmp_path: Path, frames: list[Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        for frame in frames:
            arrive(tmp_path, frame)
        status = Watch(tmp_path, SMALL).poll(settled=True)
        assert status is not None
        assert status.sigma is not None
        capsys.readouterr()
        main(["calibrate", str(tmp_path), "--board", str(SMALL), "--json"])
        quality = json.loads(capsys.readouterr().out)["calibration"]["quality"]
        wider = max(1.0, quality["kappa2"] or 1.0) ** 0.5
        assert status.sigma.fx == pytest.approx(quality["std"]["fx"] * wider, rel=1e-6)
        assert status.sigma.cx == pytest.approx(quality["std"]["cx"] * wider, rel=1e-6)


def held(board: Board, at: tuple[float, float], tilts: tuple[float, float], fill: float) -> Pose:
    """The pose that a proposal asks for, before the true camera."""
    K = camera().intrinsics
    width, height = K.image_size
    zero = 0.0
    turn = rotation_matrix(np.array([np.radians(tilts[0]), zero, zero]))
    turn = turn @ rotation_matrix(np.array([zero, np.radians(tilts[1]), zero]))
    ray = np.array([(at[0] * width - K.cx) / K.fx, (at[1] * height - K.cy) / K.fy, 1.0])
    place = ray * K.fx * max(board.extent) / (fill * width) - turn @ board.points.mean(axis=0)
    x, y, z = rotation_vector(turn)
    return Pose(
        rotation=(float(x), float(y), float(z)),
        translation_mm=(float(place[0]), float(place[1]), float(place[2])),
    )


class TestProposal:
    def test_before_any_frame_there_is_one(self) -> None:
        assert next_pose(BOARD, (1920, 1440)).gain > 0.3

    @pytest.mark.thorough
    def test_following_it_does_better_than_a_pose_in_the_middle(self) -> None:
        seen = shoot(how=Session(views=8, reach=0.5), seed=3)
        result = estimate(seen, "brown")
        proposed = next_pose(BOARD, seen.image_size, result)

        def edge(pose: Pose) -> float:
            [view] = observe(BOARD, camera(), [pose], 0.05, 9).views
            more = replace(seen, views=(*seen.views, replace(view, name="new")))
            found = estimate(more, "brown").evidence.edge_px
            assert found is not None
            return found

        followed = edge(
            held(BOARD, (proposed.x, proposed.y), (proposed.tilt_x_deg, proposed.tilt_y_deg), proposed.fill)
        )
        before = result.evidence.edge_px
        assert before is not None
        assert followed < 0.8 * before
        assert followed < edge(held(BOARD, (0.5, 0.5), (0.0, 0.0), 0.3))
        # What was expected is what came, but for what no linear forecast sees.
        assert 0.4 < followed / proposed.edge_px < 2.5


class TestCommand:
    def test_once_prints_a_line_of_json_and_writes_the_page(
        self, tmp_path: Path, frames: list[Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        for frame in frames:
            arrive(tmp_path / "in", frame)
        page = tmp_path / "watch.html"
        argv = [
            "calibrate",
            "watch",
            str(tmp_path / "in"),
            "--board",
            str(SMALL),
            "--once",
            "--html",
            str(page),
        ]
        assert main([*argv, "--json"]) == 1
        [line] = capsys.readouterr().out.splitlines()
        document = json.loads(line)
        require(document, "calibrate-watch-1")
        assert document["views"] == len(frames)
        text = page.read_text(encoding="utf-8")
        assert '<meta http-equiv="refresh" content="2">' in text
        assert "hold the board" in text.lower()
        assert main(argv) == 1
        said = capsys.readouterr().out
        assert "Next" in said
        assert "5 of 5 frames count" in said

    def test_ctrl_c_keeps_the_frames_and_says_how_to_go_on(
        self,
        tmp_path: Path,
        frames: list[Path],
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        arrive(tmp_path, frames[0])
        looks = iter(range(3))

        def stop_at_the_third_look(_seconds: float) -> None:
            if next(looks) == 2:
                raise KeyboardInterrupt

        monkeypatch.setattr("calibrary.jobs.calibrate_watch.run.time.sleep", stop_at_the_third_look)
        assert main(["calibrate", "watch", str(tmp_path), "--board", str(SMALL)]) == 1
        said = capsys.readouterr().out
        assert frames[0].name in said
        assert "the same command goes on" in said

    def test_it_ends_when_the_calibration_passes(
        self, tmp_path: Path, frames: list[Path], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        arrive(tmp_path, frames[0])
        watch = Watch(tmp_path, SMALL)
        good = estimate(shoot(how=Session(views=20), seed=2))
        assert good.verdict is Use.FIXED
        monkeypatch.setattr("calibrary.jobs.calibrate_watch.session.estimate", lambda *_: good)
        monkeypatch.setattr("calibrary.jobs.calibrate_watch.session.FEWEST_VIEWS", 1)
        status = watch.poll(settled=True)
        assert status is not None
        assert status.done
        assert status.missing == ()
