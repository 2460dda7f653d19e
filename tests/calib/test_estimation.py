from __future__ import annotations

import json
import re
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary.calib.board import Board
from calibrary.calib.corners_file import decode_corners, encode_corners
from calibrary.calib.detection import Detections
from calibrary.calib.estimation import estimate
from calibrary.calib.lens_models import Solvable
from calibrary.calib.observations import ControlPoints, Observations, View
from calibrary.calib.opencv_state import one_blas_thread
from calibrary.calib.result import CalibrationResult, DismissalReason
from calibrary.calib.verdict import LIMITS
from calibrary.calibration import CameraKey, Grade, Intrinsics
from calibrary.errors import CalibrationError, InputError
from calibrary.jobs.calibrate.report import Asked, CalibrateReport
from calibrary.records import from_json, replace, to_json
from calibrary.schemas import require
from calibrary.validation import Severity, Use
from tests.thorough import every

from .faults import rolling
from .solving import BOARD, SIZE, Session, camera, moved, shoot


@pytest.fixture(scope="module")
def clean() -> CalibrationResult:
    return estimate(replace(shoot(how=Session(views=25)), focus="manual", firmware="01.02"))


def _grave(result: CalibrationResult) -> set[str]:
    return {finding.rule for finding in result.findings if finding.severity is not Severity.NOTE}


def _codes(result: CalibrationResult) -> set[str]:
    return set(result.rules)


def test_a_good_session_passes(clean: CalibrationResult) -> None:
    assert clean.verdict is Use.FIXED
    assert not _grave(clean)
    assert not clean.views_out


def test_the_truth_lies_within_three_standard_deviations(clean: CalibrationResult) -> None:
    K, truth = clean.calibration.intrinsics, camera().intrinsics
    quality = clean.calibration.quality
    assert quality is not None
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(K, name) - getattr(truth, name)) < 3 * quality.std[name]


def test_the_calibration_says_all_that_a_registry_wants_to_know(clean: CalibrationResult) -> None:
    calibration, quality = clean.calibration, clean.calibration.quality
    assert quality is not None
    assert quality.covariance is not None
    assert calibration.grade is Grade.CALIBRATED
    assert quality.covariance.names == clean.model.parameters
    assert (quality.views, quality.points) == (25, 25 * 88)
    assert quality.kappa2 is not None
    assert 0 < quality.kappa2 < 2.5
    assert quality.rms_px == pytest.approx(0.07, abs=0.007)
    assert calibration.provenance.source == "checkerboard:11x8"
    assert (calibration.provenance.focus, calibration.provenance.firmware) == ("manual", "01.02")
    assert calibration.provenance.tool is not None
    assert "OpenCV" in calibration.provenance.tool


def test_the_result_prints_as_its_schema_says(clean: CalibrationResult) -> None:
    report = CalibrateReport.of(clean, Detections(observations=clean.observations), Asked())
    document = json.loads(json.dumps(to_json(report), allow_nan=False))
    require(document, "calibration-result-3")
    assert document["verdict"] == "fixed"
    assert to_json(from_json(CalibrateReport, document)) == document


def test_corners_solved_again_from_their_file_give_the_same_calibration(clean: CalibrationResult) -> None:
    again = estimate(decode_corners(encode_corners(clean.observations)))
    # OpenCV's threads add up in any order.
    for name in ("fx", "fy", "cx", "cy"):
        found, expected = (getattr(result.calibration.intrinsics, name) for result in (again, clean))
        assert found == pytest.approx(expected, rel=1e-9)
    assert again.rules == clean.rules
    assert again.calibration.provenance == clean.calibration.provenance


def test_a_residual_is_where_a_corner_was_seen_less_where_it_is_projected(clean: CalibrationResult) -> None:
    seen, view = clean.observations, clean.views[3]
    assert view.rotation is not None
    assert view.translation is not None
    assert view.residuals_px is not None
    points = BOARD.points - BOARD.points.mean(axis=0)
    expected = seen.views[3].image_points - clean.calibration.project(
        points @ np.array(view.rotation).T + np.array(view.translation)
    )
    np.testing.assert_allclose(np.array(view.residuals_px, dtype=np.float64), expected, atol=1e-9)


def _bad_corners() -> Observations:
    by = np.zeros((88, 2))
    by[[3, 40, 41]] = [[8, 3], [-5, 9], [4, -4]]
    return moved(shoot(seed=3), 4, by)


def _dragged() -> Observations:
    by = np.zeros((88, 2))
    by[:, 0] = np.linspace(0, 6, 88) ** 2 / 12
    return moved(shoot(seed=3), 9, by)


def _burst() -> Observations:
    seen, rng = shoot(how=Session(views=6)), np.random.default_rng(0)
    views = [
        replace(
            view, name=f"{view.name}-{shot}", image_points=view.image_points + rng.normal(0, 0.05, (88, 2))
        )
        for view in seen.views
        for shot in range(4)
    ]
    return replace(seen, views=tuple(views))


FAULTS: dict[str, tuple[Callable[[], Observations], Severity]] = {
    "corners-rejected": (_bad_corners, Severity.NOTE),
    "views-rejected": (_dragged, Severity.NOTE),
    "duplicates": (_burst, Severity.NOTE),
    "rolling-shutter": (rolling, Severity.UNPROVEN),
    "unproven-region": (lambda: shoot(how=Session(reach=0.55, fill=(0.1, 0.35))), Severity.UNPROVEN),
    "stretched-print": (lambda: shoot(how=Session(stretch=(1.0, 1.001))), Severity.UNPROVEN),
    "board-warp": (lambda: shoot(how=Session(bow_mm=0.3)), Severity.NOTE),
    "wrong-square": (
        lambda: replace(shoot(), board=Board(columns=11, rows=8, square_mm=0.04)),
        Severity.UNPROVEN,
    ),
    "focus-not-locked": (lambda: replace(shoot(), focus="autofocus"), Severity.UNPROVEN),
    "focus-unknown": (shoot, Severity.NOTE),
}


@pytest.mark.parametrize("code", FAULTS)
def test_each_fault_is_called_by_its_name(code: str) -> None:
    make, severity = FAULTS[code]
    result = estimate(make())
    found = {finding.rule: finding for finding in result.findings}
    assert code in found
    assert found[code].severity is severity
    outcome = {
        Severity.NOTE: Use.FIXED,
        Severity.UNPROVEN: Use.START,
        Severity.ERROR: Use.NONE,
    }
    order = list(Use)
    assert order.index(result.verdict) >= order.index(outcome[severity])


def test_a_rolling_shutter_is_not_seen_where_there_is_another_fault() -> None:
    for how in (Session(stretch=(1.0, 1.001)), Session(bow_mm=0.3), Session(reach=0.4, fill=(0.1, 0.35))):
        assert "rolling-shutter" not in _codes(estimate(shoot(how=how, seed=5)))


def test_low_tilt_says_what_to_do() -> None:
    result = estimate(shoot(how=Session(tilt_deg=2.0)))
    found = next(finding for finding in result.findings if finding.rule == "low-tilt")
    assert re.match(r"board normals spread \d°, need 20°", found.message)
    assert found.remedy == "tilt the board"


@pytest.mark.parametrize("tilt_deg", every(3, [0.1, 0.0, 0.5]))
def test_boards_parallel_to_the_sensor_are_refused_and_nothing_worse(tilt_deg: float) -> None:
    try:
        result = estimate(shoot(how=Session(tilt_deg=tilt_deg)))
    except CalibrationError as error:
        message = str(error)
        assert "tilt the board" in message
    else:
        assert result.verdict is Use.NONE
        assert "low-tilt" in _grave(result)


def test_the_limits_can_be_set() -> None:
    strict = replace(LIMITS, views_fixed=40, views_wanted=40)
    assert "few-views" in _grave(estimate(shoot(), limits=strict))


def test_repeats_name_the_view_they_repeat() -> None:
    out = estimate(_burst()).views_out
    assert len(out) == 18
    assert out[0].without is not None
    assert out[0].without.reason is DismissalReason.DUPLICATE
    assert out[0].without.message == "shows the pose of view-000-0"


def test_a_view_that_was_rejected_has_a_residual_and_none_of_those_that_count() -> None:
    result = estimate(_dragged())
    [out] = result.views_out
    assert out.rms_px is not None
    assert result.rms_by_view == {view.name: view.rms_px for view in result.views if view is not out}


def test_a_model_can_be_asked_for() -> None:
    result = estimate(shoot(), "k1k2")
    assert result.model is Solvable.K1K2
    assert result.calibration.distortion is not None
    assert result.calibration.distortion.coefficients["k3"] == 0.0


def test_points_in_space_are_solved_from_a_seed() -> None:
    rng, truth = np.random.default_rng(1), camera()
    ground = rng.uniform(-1, 1, (150, 3)) * [4e5, 4e5, 3e4] + [4e8, 5e9, 2e5]
    down = np.diag([1.0, -1.0, -1.0])
    views = []
    for index in range(8):
        at = np.array([4e8, 5e9, 1e6]) + rng.uniform(-1, 1, 3) * [1e5, 1e5, 2e5]
        pixels = truth.project((ground - at) @ down.T)
        ids = np.flatnonzero(((pixels > 0) & (pixels < SIZE)).all(axis=1))
        seen = pixels[ids] + rng.normal(0, 0.2, (len(ids), 2))
        views.append(View(name=f"{index}.jpg", ids=ids, image_points=seen))
    board = ControlPoints(points=ground)
    observations = Observations(board=board, image_size=SIZE, views=tuple(views), camera=CameraKey())
    found = []
    for guess in (None, Intrinsics(fx=900, fy=900, cx=960, cy=720, image_size=SIZE)):
        result = estimate(observations, guess=guess)
        found.append(result.calibration.intrinsics.fx)
        assert result.calibration.quality is not None
        assert abs(found[-1] - truth.intrinsics.fx) < 4 * result.calibration.quality.std["fx"]
        assert result.warp is None
    assert found[0] == pytest.approx(found[1], abs=1e-4)


def _spoilt(ids: NDArray[np.intp] | None = None, points: NDArray[np.float64] | None = None) -> Observations:
    seen = shoot(how=Session(views=3))
    first = seen.views[0]
    changed = replace(
        first,
        ids=first.ids if ids is None else ids,
        image_points=first.image_points if points is None else points,
    )
    return replace(seen, views=(changed, *seen.views[1:]))


@pytest.mark.parametrize(
    ("observations", "words"),
    [
        (lambda: _spoilt(ids=np.zeros(88, dtype=np.intp)), "names points twice"),
        (lambda: _spoilt(ids=np.arange(1, 89)), "beyond the 88"),
        (lambda: _spoilt(points=np.full((88, 2), np.nan)), "NaN"),
        (lambda: _spoilt(points=np.zeros((87, 2))), "shape"),
        (lambda: replace(_spoilt(), image_size=(0, 0)), "at least 16 px"),
    ],
)
def test_observations_that_contradict_themselves_are_refused(
    observations: Callable[[], Observations], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        estimate(observations())


def test_two_views_are_too_few_and_one_pose_is_none() -> None:
    with pytest.raises(CalibrationError, match="2 of 2 views"):
        estimate(shoot(how=Session(views=2)))
    seen = shoot(how=Session(views=3))
    with pytest.raises(CalibrationError, match="move and tilt it"):
        estimate(replace(seen, views=(seen.views[0],) * 5))


def test_views_without_enough_corners_are_listed_and_left_out() -> None:
    seen = shoot(how=Session(views=10))
    few = replace(seen.views[0], ids=np.arange(5), image_points=seen.views[0].image_points[:5])
    line = replace(seen.views[1], ids=np.arange(11), image_points=seen.views[1].image_points[:11])
    result = estimate(replace(seen, views=(few, line, *seen.views[2:])))
    assert [view.without.reason for view in result.views_out if view.without] == [
        DismissalReason.TOO_FEW_CORNERS
    ] * 2


def test_an_unknown_model_is_refused() -> None:
    with pytest.raises(InputError, match="expected auto, k1k2"):
        estimate(shoot(how=Session(views=3)), "spline")


def test_a_solve_uses_one_thread_and_leaves_the_callers_number_as_it_was() -> None:
    threadpoolctl = pytest.importorskip("threadpoolctl")
    seen: list[int] = []

    def threads() -> list[int]:
        return [one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"]

    with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        with one_blas_thread():
            with one_blas_thread():
                seen += threads()
            seen += threads()
        assert threads() == before
    assert set(seen) == {1}
