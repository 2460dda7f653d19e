"""A rig's lenses and places in one adjustment: right, with honest σ, and with a cause where shots contradict it."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import TypeAlias

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calib.artwork import artwork
from calibrary.calib.board import Board, parse_board
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import f_test
from calibrary.calib.rig.estimation import _rigidity, estimate_rig
from calibrary.calib.rig.lens import Place, RigLens
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.rig.start import _is_ambiguous
from calibrary.calib.rig.verdict import RigResult
from calibrary.errors import InputError
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.validation import Use
from tests.calib.rigs import BOARD, off, seen_by, true_rig
from tests.thorough import every

FloatArray32: TypeAlias = NDArray[np.float32]


def rules(result: RigResult) -> list[str]:
    return [finding.rule for finding in result.findings]


def turned(
    place: Place, degrees: tuple[float, float, float], mm: tuple[float, float, float] = (0, 0, 0)
) -> Place:
    return Place(
        rotation=rotation_matrix(np.radians(degrees)) @ place.rotation,
        translation=place.translation + np.array(mm),
    )


def test_the_derivatives_of_a_rig_are_its_slopes() -> None:
    lens = RigLens(
        names=("a", "b"), models=(Solvable.BROWN, Solvable.FISHEYE), noise_px=(0.2, 0.5), corners=3
    )
    values = lens.of(
        [
            np.array([900.0, 910, 640, 480, -0.1, 0.05, 1e-3, -2e-3, 0.01]),
            np.array([700.0, 690, 600, 500, 0.02, -0.01, 0.003, 1e-3]),
        ],
        [Place(rotation=rotation_matrix(np.array([0.3, -0.8, 0.2])), translation=np.array([-120.0, 5, 20]))],
    )
    points = np.random.default_rng(3).normal((0, 0, 900), 120, (2, 6, 3))
    pixels, by_parameter, by_point = lens.project(values, points)
    for at in range(len(values)):
        step = 1e-6 * max(1.0, abs(values[at]))
        move = step * np.eye(len(values))[at]
        slope = (lens.project(values + move, points)[0] - lens.project(values - move, points)[0]) / (2 * step)
        assert by_parameter[..., at] == pytest.approx(slope, rel=1e-4, abs=1e-5), lens.parameters[at]
    for axis in range(3):
        move = 1e-3 * np.eye(3)[axis]
        slope = (lens.project(values, points + move)[0] - lens.project(values, points - move)[0]) / 2e-3
        assert by_point[..., axis] == pytest.approx(slope, rel=1e-4, abs=1e-6)
    assert pixels.shape == (2, 6, 2)


@pytest.mark.parametrize("bow_mm", every(2, [0.6, 0.0]))
def test_places_are_found_and_their_sigma_covers_the_truth(bow_mm: float) -> None:
    turns, baselines, z = [], [], []
    for seed in (1, 2):
        truth = true_rig(seed)
        result = estimate_rig(seen_by(truth, seed, bow_mm=bow_mm))
        degrees, share, sigmas = off(result.poses["cam1"], truth.places[1])
        turns.append(degrees)
        baselines.append(share)
        z.append(sigmas)
        assert result.verdict is not Use.NONE
        assert result.rigid_p is not None
        assert result.rigid_p > 1e-3
    assert max(turns) < 0.01
    assert max(baselines) < 0.002
    assert np.abs(z).max() < 3.5
    assert 0.3 < float(np.sqrt(np.mean(np.square(z)))) < 1.6


@pytest.mark.thorough
def test_three_cameras_of_different_noise_are_weighed_by_it() -> None:
    truth = true_rig(4, cameras=3, step_mm=60.0)
    result = estimate_rig(seen_by(truth, 4, sigma=(0.05, 0.05, 0.4)))
    for camera in (1, 2):
        degrees, share, z = off(result.poses[f"cam{camera}"], truth.places[camera])
        assert degrees < (0.01 if camera == 1 else 0.05)
        assert share < 0.002
        assert np.abs(z).max() < 3.5
    first, noisy = (result.poses[name].rotation_std_deg for name in ("cam1", "cam2"))
    assert first is not None
    assert noisy is not None
    assert noisy[0] > 2 * first[0]


def test_it_is_opencvs_stereo_calibration_on_the_same_corners() -> None:
    truth = true_rig(5)
    seen = seen_by(truth, 5)
    result = estimate_rig(seen, "brown", warp=False)
    K, D = zip(*(one.calibration.to_opencv() for one in result.cameras.values()), strict=True)
    rows = seen.rows[(seen.rows >= 0).all(axis=1)]
    points: list[FloatArray32] = []
    pixels: tuple[list[FloatArray32], list[FloatArray32]] = ([], [])
    for row in rows:
        views = [camera.views[view] for camera, view in zip(seen.cameras.values(), row, strict=True)]
        both = np.intersect1d(views[0].ids, views[1].ids)
        points.append(BOARD.points[both].astype(np.float32))
        for side, view in zip(pixels, views, strict=True):
            side.append((view.image_points[np.searchsorted(view.ids, both)] - 0.5).astype(np.float32))
    *_, R, t, _, _ = cv2.stereoCalibrate(
        points, *pixels, K[0].copy(), D[0].copy(), K[1].copy(), D[1].copy(), (1920, 1440),
        flags=cv2.CALIB_FIX_INTRINSIC,
    )  # fmt: skip
    peer = Place(rotation=np.asarray(R, dtype=np.float64), translation=np.ravel(t).astype(np.float64))
    degrees, share, _ = off(result.poses["cam1"], peer)
    assert degrees < 0.004
    assert share < 3e-4


def test_a_frame_that_one_camera_alone_saw_serves_its_lens() -> None:
    truth = true_rig(6)
    seen = seen_by(truth, 6)
    # Of the other camera, only every second shot is left.
    kept = [at for at in range(len(seen.cameras["cam1"].views)) if at % 2 == 0]
    other = seen.cameras["cam1"]
    names = {view.name for view in other.views}
    fewer = replace(other, views=tuple(other.views[at] for at in kept))
    shots = {
        f"shot-{number:03}": {"cam0": f"view-{number:03}", "cam1": f"view-{number:03}"}
        for number in range(len(truth.shots))
    }
    half = RigObservations.of({"cam0": seen.cameras["cam0"], "cam1": fewer}, shots)
    result = estimate_rig(half)
    assert len(names) > len(fewer.views)
    assert result.cameras["cam0"].evidence.views == len(seen.cameras["cam0"].views)
    assert result.shared["cam1"] == len(fewer.views)


@pytest.mark.thorough
def test_a_shot_in_which_something_moved_is_taken_apart() -> None:
    truth = true_rig(7)

    def moved(camera: int, shot: int, place: Place) -> Place:
        return turned(place, (0.0, 0.6, 0.0), (4.0, 0.0, 0.0)) if camera == 1 and shot == 8 else place

    result = estimate_rig(seen_by(truth, 7, moved=moved))
    assert [shot for shot, _ in result.apart] == ["shot-008"]
    degrees, share, z = off(result.poses["cam1"], truth.places[1])
    assert degrees < 0.01
    assert share < 0.002
    assert np.abs(z).max() < 3.5
    assert "shots-apart" in rules(result)


@pytest.mark.thorough
def test_a_camera_that_moved_in_the_rig_is_named_with_the_shot() -> None:
    truth = true_rig(8)

    def moved(camera: int, shot: int, place: Place) -> Place:
        return turned(place, (0.3, 0.4, 0.0)) if camera == 1 and shot >= 9 else place

    result = estimate_rig(seen_by(truth, 8, moved=moved))
    [trouble] = result.troubles
    assert trouble.rule == "camera-moved"
    assert re.match(r"cam1 moved in the rig before the shot shot-0(08|09|10):", trouble.message)
    assert result.verdict is Use.NONE


@pytest.mark.thorough
def test_cameras_that_did_not_fire_together_are_named() -> None:
    truth, random = true_rig(9), np.random.default_rng(9)
    hand = [(random.normal(0, 0.25, 3), random.normal(0, 3.0, 3)) for _ in truth.shots]

    def moved(camera: int, shot: int, place: Place) -> Place:
        turn, shift = hand[shot]
        return turned(place, tuple(turn), tuple(shift)) if camera == 1 else place

    result = estimate_rig(seen_by(truth, 9, moved=moved))
    assert "not-simultaneous" in rules(result)
    assert not result.troubles


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("order", "rule"), [("shifted", "shifted-pairing"), ("reversed", "reversed-pairing")]
)
def test_frames_that_are_paired_wrongly_are_named_and_no_pose_is_stated(order: str, rule: str) -> None:
    truth = true_rig(10)
    seen = seen_by(truth, 10)
    rows = seen.rows.copy()
    rows[:, 1] = rows[::-1, 1] if order == "reversed" else np.roll(rows[:, 1], 1)
    result = estimate_rig(replace(seen, rows=rows))
    assert rule in rules(result)
    assert result.verdict is Use.NONE
    assert not result.poses
    # Each camera by itself is as good as ever.
    assert all(one.verdict is not Use.NONE for one in result.cameras.values())


def test_a_camera_whose_images_are_mirrored_is_named() -> None:
    truth = true_rig(11)
    seen = seen_by(truth, 11)
    camera = seen.cameras["cam1"]
    across, down = BOARD.lattice
    width = camera.image_size[0]
    flipped = tuple(
        replace(
            view,
            # A detector finds the mirrored checkerboard from its other corner, row by row.
            ids=(down - 1 - view.ids // across) * across + view.ids % across,
            image_points=np.column_stack([width - view.image_points[:, 0], view.image_points[:, 1]]),
        )
        for view in camera.views
    )
    mirrored = replace(seen, cameras={**seen.cameras, "cam1": replace(camera, views=flipped)})
    assert "mirrored-camera" in rules(estimate_rig(mirrored))


@pytest.mark.thorough
def test_exchanged_frames_of_single_shots_are_named() -> None:
    truth = true_rig(12)
    truth = replace(truth, calibrations=(truth.calibrations[0],) * 2)
    seen = seen_by(truth, 12)
    shot = next(row for row, views in enumerate(seen.rows) if (views >= 0).all())
    views = [camera.views[view] for camera, view in zip(seen.cameras.values(), seen.rows[shot], strict=True)]
    exchanged = {}
    for (name, camera), own, other in zip(seen.cameras.items(), views, reversed(views), strict=True):
        swapped = replace(other, name=own.name)
        exchanged[name] = replace(camera, views=tuple(swapped if v is own else v for v in camera.views))
    result = estimate_rig(replace(seen, cameras=exchanged))
    [trouble] = result.troubles
    assert trouble.rule == "swapped-frames"
    assert trouble.message.startswith(f"in {seen.shots[shot]} the frame of cam1")


@pytest.mark.thorough
def test_a_board_that_looks_the_same_upside_down_is_counted_from_one_end() -> None:
    board = Board(columns=9, rows=7, square_mm=40.0)
    truth = true_rig(13, board=board)
    seen = seen_by(truth, 13, board=board)
    camera, random = seen.cameras["cam1"], np.random.default_rng(13)
    some = [at for at in range(len(camera.views)) if random.random() < 0.4]
    result = estimate_rig(seen.turned(1, some))
    degrees, share, _ = off(result.poses["cam1"], truth.places[1])
    assert some
    assert degrees < 0.05
    assert share < 0.002


def test_rigidity_is_judged_by_the_shots_of_several_cameras_the_first_included() -> None:
    found = SimpleNamespace(
        adjusted=SimpleNamespace(rss=100.0, dof=200),
        rss_apart=50.0,
        rows=np.array([[0, 0], [1, 1], [2, -1], [3, 3]]),
        joint=np.array([[0.5, 0.3], [0.2, 0.2], [9.0, np.nan], [0.2, 0.2]]),
        alone=np.array([[0.1, 0.1], [0.1, 0.1], [0.1, np.nan], [0.2, 0.2]]),
        lens=SimpleNamespace(names=("left", "right")),
    )
    px, p = _rigidity(found)  # type: ignore[arg-type]  # what it reads of a solution
    assert px == pytest.approx(np.sqrt((0.24 + 0.08 + 0.03 + 0.03) / 6))
    # Each of three shots has a pose of six numbers more, less the one place of the second camera.
    assert p == f_test(100.0, 50.0, 12, 188)[1]
    found.rows = np.array([[0, -1], [-1, 1], [2, -1], [3, -1]])
    assert _rigidity(found) == (0.0, 1.0)  # type: ignore[arg-type]  # as above


@pytest.mark.parametrize(
    "name",
    [
        "checkerboard:9x6",
        "checkerboard:8x6",
        "checkerboard:7x7",
        "circles:5x4",
        "acircles:4x11",
        "acircles:4x10",
        "charuco:8x6",
    ],
)
def test_a_board_is_ambiguous_if_its_print_is_the_same_turned_by_half(name: str) -> None:
    board = parse_board(name, 40.0)
    print_of, box = artwork(board), 0.1 * np.ones(2000)
    low, high = np.array(print_of.extent_mm).reshape(2, 2)
    x, y = np.random.default_rng(1).uniform(low, high, (2000, 2)).T
    turned_by_half = print_of.darkness(low[0] + high[0] - x, low[1] + high[1] - y, box, box)
    assert _is_ambiguous(board) == np.allclose(print_of.darkness(x, y, box, box), turned_by_half)


def test_a_rig_needs_the_boards_scale() -> None:
    seen = seen_by(true_rig(14), 14)
    unscaled = replace(BOARD, square_mm=None)
    cameras = {name: replace(one, board=unscaled) for name, one in seen.cameras.items()}
    with pytest.raises(InputError, match="--square-mm"):
        estimate_rig(replace(seen, cameras=cameras))


def test_cameras_that_never_saw_the_board_together_are_not_tied() -> None:
    seen = seen_by(true_rig(15), 15)
    apart: FloatArray = np.full((2 * len(seen.rows), 2), -1)
    apart[::2, 0], apart[1::2, 1] = seen.rows[:, 0], seen.rows[:, 1]
    rows = apart.astype(np.intp)
    some = (rows >= 0).any(axis=1)
    loose = RigObservations(
        cameras=seen.cameras, shots=tuple(f"s{at}" for at in range(int(some.sum()))), rows=rows[some]
    )
    result = estimate_rig(loose)
    assert "not-tied" in rules(result)
    assert not result.poses
