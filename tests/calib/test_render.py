"""Rendered frames, measured with OpenCV: corners lie where the truth says, and every fault has its size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board, parse_board
from calibrary.calib.synthesis import (
    Pose,
    Settings,
    Sheet,
    Shutter,
    Truth,
    poses,
    render,
    render_raw,
    seen_corners,
)
from calibrary.calib.synthesis.rendering import _way, lamp
from calibrary.calibration import Calibration
from calibrary.distortion import KannalaBrandt, NoDistortion
from calibrary.errors import InputError
from tests.thorough import every

from .staging import BOARD, BROWN, camera, truth

SHARP = Settings(noise=0.0, quality=None)
FACE_ON = Pose(rotation=(0.0, 0.0, 0.0), translation_mm=(-160.0, -100.0, 500.0))


def measured(frame: NDArray[np.uint8], board: Board) -> FloatArray:
    """Inner corners by OpenCV, in the canonical origin, window as wide as the squares allow."""
    found, corners = cv2.findChessboardCorners(frame, (board.columns, board.rows))
    assert found
    grid = corners.reshape(board.rows, board.columns, 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    half = int(np.clip(round(0.3 * spacing), 3, 15))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    refined = cv2.cornerSubPix(frame, corners.reshape(-1, 1, 2), (half, half), (-1, -1), criteria)
    return np.asarray(refined, dtype=np.float64).reshape(-1, 2) + 0.5


def errors(scene: Truth, seed: int = 0) -> FloatArray:
    """(frames · corners, 2) px, measured less true."""
    rows = []
    for number, pose in enumerate(scene.poses):
        frame = render(scene.board, scene.calibration, pose, scene.settings, seed + number)
        seen, exact = measured(frame.astype(np.uint8), scene.board), scene.corners(number)
        rows.append(min((seen - exact, seen[::-1] - exact), key=lambda e: float(np.abs(e).sum())))
    return np.concatenate(rows)


def test_corners_are_found_where_the_truth_says_and_as_well_as_in_real_frames() -> None:
    off = errors(truth(camera(), Settings(blur_px=0.8, noise=2.0, quality=92), count=5))
    assert np.abs(off.mean(axis=0)).max() < 0.01
    assert 0.015 < off.std() < 0.04


@pytest.mark.thorough
def test_hard_frames_are_noisier_but_not_biased() -> None:
    off = errors(truth(camera(), Settings(blur_px=1.5, noise=5.0, quality=75), count=4))
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert 0.04 < off.std() < 0.12


@pytest.mark.thorough
def test_pixels_are_the_mean_light_of_their_area() -> None:
    """Against a plain count over 16×16 points in every pixel, through a homography that OpenCV makes."""
    scene = camera((160, 120), 130.0, NoDistortion())
    pose = Pose(rotation=(0.31, -0.24, 0.12), translation_mm=(-150.0, -110.0, 520.0))
    settings = Settings(
        blur_px=0.0,
        noise=0.0,
        vignetting=0.0,
        gamma=1.0,
        bits=16,
        quality=None,
        texture=0.0,
        tones=(0.0, 1.0),
    )
    frame = render_raw(BOARD, scene, pose, settings, 0) / 65535
    K = scene.intrinsics.matrix
    rotation = cv2.Rodrigues(np.array(pose.rotation))[0]
    to_board = np.linalg.inv(K @ np.column_stack([rotation[:, :2], pose.translation_mm]))
    steps = (np.arange(16) + 0.5) / 16
    x, y = np.meshgrid(np.add.outer(np.arange(160), steps), np.add.outer(np.arange(120), steps))
    u, v, w = np.tensordot(to_board, np.stack([x, y, np.ones_like(x)]), axes=1)
    column, row = np.floor(u / w / 40).astype(int) + 1, np.floor(v / w / 40).astype(int) + 1
    inside = (column >= 0) & (column < 10) & (row >= 0) & (row < 7)
    on_paper = (column >= -1) & (column < 11) & (row >= -1) & (row < 8)
    white = np.where(inside & ((column + row) % 2 == 0), 0.0, np.where(on_paper, 1.0, 0.25))
    counted = white.reshape(120, 16, 160, 16).mean(axis=(1, 3))
    assert np.abs(frame - counted).max() < 0.04
    assert abs((frame - counted).mean()) < 1e-4


@pytest.mark.parametrize("pixels", [1, 1 << 10, 1 << 30])
def test_no_seam_shows_between_the_strips_that_a_frame_is_worked_on_in(
    pixels: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = truth(camera((320, 240), 240.0), SHARP, count=1)
    usual = render(scene.board, scene.calibration, scene.poses[0], SHARP, 0)
    monkeypatch.setattr("calibrary.calib.synthesis.rendering.STRIP_PIXELS", pixels)
    other = render(scene.board, scene.calibration, scene.poses[0], SHARP, 0)
    assert np.abs(usual.astype(int) - other).max() <= 2


def test_the_same_arguments_give_the_same_bytes() -> None:
    scene = truth(camera((320, 240), 240.0), Settings(glare=1.0, shot_noise=3.0), count=1)
    first, again, other = (
        render(scene.board, scene.calibration, scene.poses[0], scene.settings, seed) for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_noise_has_the_standard_deviation_asked_for() -> None:
    scene = camera((320, 240), 240.0)
    away = Pose(rotation=(0.0, 0.0, 0.0), translation_mm=(0.0, 0.0, -500.0))
    quiet, noisy = (
        render_raw(
            BOARD,
            scene,
            away,
            Settings(noise=noise, bits=16, quality=None, texture=0.0, vignetting=0.0),
            3,
        )
        / 257.0
        for noise in (0.0, 4.0)
    )
    assert (noisy - quiet).std() == pytest.approx(4.0, rel=0.02)
    assert (noisy - quiet).mean() == pytest.approx(0.0, abs=0.05)


def test_a_frame_of_16_bits_holds_more_levels() -> None:
    scene = truth(camera((320, 240), 240.0), Settings(noise=0.0, bits=16, quality=None), count=1)
    frame = render(scene.board, scene.calibration, scene.poses[0], scene.settings, 0)
    assert frame.dtype == np.uint16
    assert len(np.unique(frame)) > 1000


def test_a_fisheye_sees_a_circle_and_the_corners_in_it() -> None:
    wide = camera((1280, 960), 330.0, KannalaBrandt(k1=0.01, k2=-0.004, k3=0.0, k4=0.0))
    scene = truth(wide, Settings(texture=0.0), count=3, seed=3)
    assert np.abs(errors(scene).mean(axis=0)).max() < 0.02
    narrow = camera((640, 480), 100.0, KannalaBrandt(k1=0.0, k2=0.0, k3=0.0, k4=0.0))
    frame = render_raw(BOARD, narrow, FACE_ON, Settings(noise=0.0, quality=None, texture=0.0), 0)
    assert frame[0, 0] == 0
    assert frame[240, 20] > 0


def test_a_bowed_board_shifts_corners_by_what_the_sagitta_projects_to() -> None:
    """Face on, at distance d, a point s behind the plane moves towards the centre by r·s/d."""
    scene = camera(distortion=NoDistortion())
    flat, bowed = (
        seen_corners(BOARD, scene, FACE_ON, Sheet.bowed(BOARD, bow), Shutter()) for bow in (0.0, 4.0)
    )
    K = scene.intrinsics
    half = 160.0
    x, y = BOARD.points[:, 0] - 160, BOARD.points[:, 1] - 100
    behind = 4.0 * ((1 - (x / half) ** 2) + (100 / 160) ** 2 * (1 - (y / 100) ** 2))
    expected = (flat - (K.cx, K.cy)) * (1 / (1 + behind / 500) - 1)[:, None]
    np.testing.assert_allclose(bowed - flat, expected[:, :], atol=1e-9)
    settings = Settings(noise=0.0, quality=None, sheet=Sheet.bowed(BOARD, 4.0))
    seen = measured(render(BOARD, scene, FACE_ON, settings, 0).astype(np.uint8), BOARD)
    assert np.abs(seen - bowed).max() < 0.08


def test_a_stretched_print_moves_columns_apart() -> None:
    scene = camera(distortion=NoDistortion())
    true, wide = (
        seen_corners(BOARD, scene, FACE_ON, Sheet(stretch=(stretch, 1.0)), Shutter())
        for stretch in (1.0, 1.01)
    )
    span = scene.intrinsics.fx * 320 / 500
    assert np.ptp(wide[:, 0]) - np.ptp(true[:, 0]) == pytest.approx(0.01 * span)
    np.testing.assert_allclose(wide[:, 1], true[:, 1])
    settings = Settings(noise=0.0, quality=None, sheet=Sheet(stretch=(1.01, 1.0)))
    seen = measured(render(BOARD, scene, FACE_ON, settings, 0).astype(np.uint8), BOARD)
    assert np.abs(seen - wide).max() < 0.08


def test_a_rolling_shutter_shears_the_board_by_rate_times_readout() -> None:
    """About y, a row exposed t after the middle one sees every point shifted by −f·ω·t/cos² of its bearing."""
    scene = camera(distortion=NoDistortion())
    shutter = Shutter(readout_s=0.03, rate_deg_s=(0.0, 5.0, 0.0))
    still, sheared = (seen_corners(BOARD, scene, FACE_ON, Sheet(), s) for s in (Shutter(), shutter))
    K = scene.intrinsics
    seconds = (sheared[:, 1] / 960 - 0.5) * 0.03
    bearing = (still[:, 0] - K.cx) / K.fx
    expected = -K.fx * np.radians(5.0) * seconds * (1 + bearing**2)
    np.testing.assert_allclose(sheared[:, 0] - still[:, 0], expected, atol=2e-3)
    assert np.ptp(sheared[:, 0] - still[:, 0]) > 0.7
    settings = Settings(noise=0.0, quality=None, shutter=shutter)
    seen = measured(render(BOARD, scene, FACE_ON, settings, 0).astype(np.uint8), BOARD)
    assert np.abs(seen - sheared).max() < 0.08


def test_motion_blurs_along_its_way_and_leaves_corners_in_their_middle() -> None:
    scene = truth(camera(), Settings(motion_px=(9.0, 0.0), noise=0.0, quality=None), count=3)
    off = errors(scene)
    assert np.abs(off.mean(axis=0)).max() < 0.02
    still = render_raw(scene.board, scene.calibration, scene.poses[0], SHARP, 0).astype(np.float64)
    moved = render_raw(scene.board, scene.calibration, scene.poses[0], scene.settings, 0).astype(np.float64)
    across, down = (
        np.abs(np.diff(moved, axis=a)).max() / np.abs(np.diff(still, axis=a)).max() for a in (1, 0)
    )
    assert across < 0.4 < down


def test_glare_saturates_part_of_the_board_and_nothing_behind_it() -> None:
    scene = camera((640, 480), 480.0, NoDistortion())
    plain, lit = (
        render_raw(BOARD, scene, FACE_ON, Settings(glare=glare, noise=0.0, quality=None, vignetting=0.0), 2)
        for glare in (0.0, 3.0)
    )
    changed = lit != plain
    rows, columns = np.nonzero(changed)
    corners = seen_corners(BOARD, scene, FACE_ON, Sheet(), Shutter())
    margin = 80 * scene.intrinsics.fx / 500 + 5
    assert (lit[changed] == 255).sum() > 1000
    assert columns.min() > corners[:, 0].min() - margin
    assert rows.max() < corners[:, 1].max() + margin


def test_vignetting_darkens_the_corner_by_its_share() -> None:
    scene = camera((640, 480), 480.0, NoDistortion())
    away = Pose(rotation=(0.0, 0.0, 0.0), translation_mm=(0.0, 0.0, -500.0))
    frame = render_raw(
        BOARD,
        scene,
        away,
        Settings(noise=0, quality=None, texture=0.0, gamma=1.0, bits=16, vignetting=0.4),
        0,
    )
    assert frame[0, 0] / frame[240, 320] == pytest.approx(0.6, abs=0.005)


@pytest.mark.parametrize("name", every(3, ["charuco:8x6", "aprilgrid:5x4", "circles:9x7"]))
def test_other_boards_are_seen_by_opencv_where_they_are(name: str) -> None:
    board = parse_board(name, 40.0)
    scene = camera((1600, 1200), 1300.0, BROWN)
    pose = poses(board, scene, 1, 2, max_tilt_deg=15, fill=(0.75, 0.8))[0]
    exact = seen_corners(board, scene, pose, Sheet(), Shutter())
    frame = render(board, scene, pose, Settings(), 0)
    if board.pattern == "circles":
        exact = _middles_as_seen(board, scene, pose)
    off = _found(frame.astype(np.uint8), board, exact)
    if name.startswith("charuco") and cv2.__version__.startswith("4.10"):
        off -= 0.5  # OpenCV 4.10 counts the corners of a ChArUco board from half a pixel further
    assert len(off) == len(exact)
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert off.std() < 0.06


def _middles_as_seen(board: Board, scene: Calibration, pose: Pose) -> FloatArray:
    """Middles of the areas the discs take up in the frame: not quite where the discs' own middles are seen."""
    assert board.marker_mm is not None
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    rim = board.marker_mm / 2 * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    points = (board.points[:, None] + rim).reshape(-1, 3)
    x, y = scene.project(pose.camera_points(points)).reshape(-1, 90, 2).transpose(2, 0, 1)
    x1, y1 = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
    cross = x * y1 - x1 * y
    area = cross.sum(axis=1)
    return np.column_stack(
        [((x + x1) * cross).sum(axis=1) / (3 * area), ((y + y1) * cross).sum(axis=1) / (3 * area)]
    )


def _found(frame: NDArray[np.uint8], board: Board, exact: FloatArray) -> FloatArray:
    if board.pattern == "circles":
        found, centres = cv2.findCirclesGrid(frame, (board.columns, board.rows))
        assert found
        seen = np.asarray(centres, dtype=np.float64).reshape(-1, 2) + 0.5
        return min((seen - exact, seen[::-1] - exact), key=lambda e: float(np.abs(e).sum()))
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary}".upper()))
    if board.pattern == "charuco":
        assert board.marker_mm is not None
        layout = cv2.aruco.CharucoBoard(
            (board.columns + 1, board.rows + 1), board.pitch, board.marker, dictionary
        )
        corners, ids, _, _ = cv2.aruco.CharucoDetector(layout).detectBoard(frame)
        return np.asarray(corners.reshape(-1, 2) + 0.5 - exact[ids.ravel()], dtype=np.float64)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = 2
    tags, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(frame)
    corners = np.concatenate([tag.reshape(4, 1, 2) for tag in tags])
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
    refined = cv2.cornerSubPix(frame, corners, (5, 5), (-1, -1), criteria).reshape(-1, 2)
    points = np.concatenate([board.tag_points(int(tag)) for tag in ids.ravel()])
    return np.asarray(refined + 0.5 - exact[points], dtype=np.float64)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("blur_px", -1.0),
        ("noise", float("nan")),
        ("gamma", 0.0),
        ("bits", 12),
        ("quality", 0),
        ("tones", (0.0, 2.0)),
    ],
)
def test_a_setting_that_makes_no_sense_is_named(field: str, value: object) -> None:
    with pytest.raises(InputError, match=field):
        Settings(**{field: value})  # type: ignore[arg-type]  # one field of any type


def test_16_bits_go_through_no_jpeg() -> None:
    with pytest.raises(InputError, match="quality"):
        Settings(bits=16)


@pytest.mark.parametrize(("dx", "dy"), [(6.0, 3.0), (-5.0, 2.0), (0.0, 4.0)])
def test_motion_smears_along_its_direction_about_where_a_point_is(dx: float, dy: float) -> None:
    kernel = _way((dx, dy)).astype(np.float64)
    half = len(kernel) // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    assert kernel.sum() == pytest.approx(1.0)
    assert ((kernel * x).sum(), (kernel * y).sum()) == pytest.approx((0.0, 0.0), abs=1e-6)
    # The second moments of a uniform line; sharing out to adjacent pixels widens either by up to a sixth.
    assert (kernel * x * y).sum() == pytest.approx(dx * dy / 12, rel=0.02, abs=1e-6)
    for moment, length in (((kernel * x**2).sum(), dx), ((kernel * y**2).sum(), dy)):
        assert length**2 / 12 - 0.02 <= moment <= length**2 / 12 + 0.25


def test_a_lamp_shines_somewhere_on_the_middle_half_of_the_board() -> None:
    outline = np.array([[100.0, 50.0], [500.0, 50.0], [500.0, 250.0], [100.0, 250.0]])
    seen = []
    for seed in range(30):
        light = lamp((640, 320), outline, 0.8, np.random.default_rng(seed))
        assert light is not None
        row, column = np.unravel_index(np.argmax(light), light.shape)
        assert light.max() == pytest.approx(0.8, rel=1e-3)
        seen.append((float(column) + 0.5, float(row) + 0.5))
    low, high = np.min(seen, axis=0), np.max(seen, axis=0)
    assert (low >= (200, 100)).all()
    assert (high <= (400, 200)).all()
    assert (high - low > (150, 75)).all()
    assert lamp((640, 320), outline, 0.0, np.random.default_rng(1)) is None
    assert lamp((640, 320), outline * np.nan, 0.8, np.random.default_rng(1)) is None
