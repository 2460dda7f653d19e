"""Cameras from simulated flights: found within what they state, and refused where the geometry determines none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace as changed
from functools import cache

import numpy as np
import pytest

from calibrary.calib.least_squares import marginal, reduce
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import Candidate
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Grade
from calibrary.distortion import KannalaBrandt, Rational
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.assessment import FLIGHT, flight_result
from calibrary.sfm.bundle import adjust_bundle, linearise
from calibrary.sfm.priors import Known, Priors, anchored
from calibrary.sfm.sigma import FOCAL_BY_PX, covariance, flight_geometry, halves
from calibrary.sfm.tracks import Scene, Tracks, aligned, thinned
from calibrary.validation import Use
from tests.sfm.flights import CAMERA, PLANS, Plan, flown_of, fly
from tests.thorough import every

SMALL = Plan(relief=0.05, heights=(1.0, 1.4), cross=True, rows=2, columns=4, points=250, outliers=0.0)
TRUTH = Solvable.BROWN.values(CAMERA.intrinsics, CAMERA.distortion)


@cache
def adjusted(name: str, seed: int = 3) -> Adjustment:
    return adjust(*fly(PLANS[name], seed))


@cache
def judged(name: str, seed: int = 3) -> CalibrationResult:
    return flight_result(adjusted(name, seed))


def rules(of: CalibrationResult) -> set[str]:
    return {finding.rule for finding in of.findings}


def near(tracks: Tracks, scene: Scene) -> Scene:
    """The start with the true lens, so that one step is small."""
    return replace(aligned(scene, tracks.positions) if tracks.positions else scene, parameters=TRUTH)


# Derivatives and elimination


@pytest.mark.parametrize("what", ["lens", "turn", "place", "point"])
def test_derivatives_are_those_of_the_projection(what: str) -> None:
    tracks, scene = fly(SMALL, 1)
    scene = near(tracks, scene)
    linear = linearise(tracks, scene, 0.0)
    assert linear is not None
    step = 1e-6
    move: dict[str, Callable[[Scene], Scene]] = {
        "lens": lambda s: replace(s, parameters=s.parameters + step * np.eye(9)[1]),
        "place": lambda s: replace(s, centres=s.centres + step * np.eye(3)[2]),
        "point": lambda s: replace(s, points=s.points + step * np.eye(3)[0]),
        "turn": lambda s: replace(s, rotations=_turned(s.rotations, step)),
    }
    moved = linearise(tracks, move[what](scene), 0.0)
    assert moved is not None
    expected = {
        "lens": linear.by_lens[..., 1],
        "place": linear.kept.jac[..., 5],
        "point": linear.gone[..., 0],
        "turn": linear.kept.jac[..., 1],
    }[what]
    np.testing.assert_allclose((linear.residuals - moved.residuals) / step, expected, rtol=2e-4, atol=2e-3)


def _turned(rotations: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ rotations)


def test_the_points_are_eliminated_as_a_dense_solution_would() -> None:
    tracks, scene = fly(replace(SMALL, points=70), 2)
    scene = near(tracks, scene)
    linear = linearise(tracks, scene, 0.25)
    assert linear is not None
    n, views, points = len(tracks.point), len(tracks.names), np.unique(tracks.point, return_inverse=True)[1]
    dense = np.zeros((n, 2, 9 + 6 * views + 3 * (points.max() + 1)))
    dense[..., :9] = linear.by_lens
    rows = np.arange(n)
    for axis in range(6):
        dense[rows, :, 9 + 6 * tracks.image + axis] = linear.kept.jac[..., axis]
    for axis in range(3):
        dense[rows, :, 9 + 6 * views + 3 * points + axis] = linear.gone[..., axis]
    A = dense.reshape(2 * n, -1)
    N = A.T @ A
    at = 9 + 6 * np.repeat(np.arange(views), 3) + np.tile([3, 4, 5], views)
    N[at, at] += linear.priors.by_place.ravel() ** 2
    scale = np.sqrt(np.diag(N))
    whole = np.linalg.inv(N / np.outer(scale, scale))[:9, :9] / np.outer(scale[:9], scale[:9])
    matrix, _, _ = marginal(reduce(linear, np.arange(9)), 9)
    std = np.sqrt(np.diag(whole))
    np.testing.assert_allclose(
        np.linalg.inv(matrix) / np.outer(std, std), whole / np.outer(std, std), atol=1e-4
    )


def test_sigma_does_not_depend_on_where_the_world_is() -> None:
    tracks, scene = fly(replace(SMALL, gps_m=None), 1)
    free = adjust_bundle(tracks, near(tracks, scene))
    turn = _turned(np.eye(3)[None], 0.7)[0]
    elsewhere = replace(
        free.scene,
        rotations=free.scene.rotations @ turn.T,
        centres=40.0 * free.scene.centres @ turn.T + (7e3, -2e3, 300.0),
        points=40.0 * free.scene.points @ turn.T + (7e3, -2e3, 300.0),
    )
    again = adjust_bundle(tracks, elsewhere)
    np.testing.assert_allclose(np.diag(covariance(again)), np.diag(covariance(free)), rtol=1e-3)


@pytest.mark.thorough
def test_the_search_ends_at_the_minimum_of_a_long_valley() -> None:
    """Flat ground from one height: it once ended at its limit of steps, 3 % of fx before the minimum."""
    bundle = adjusted("flat, cross strips", 15).bundle
    further = adjust_bundle(bundle.tracks, bundle.scene, place_variance=bundle.place_variance)
    std = float(np.sqrt(covariance(bundle)[0, 0]))
    assert abs(further.scene.parameters[0] - bundle.scene.parameters[0]) < 0.05 * std


# The camera


@pytest.mark.parametrize("name", every(2, ["two heights, flat, RTK", "oblique, relief, no GPS"]))
def test_a_good_flight_finds_the_camera_within_what_it_states(name: str) -> None:
    result = judged(name)
    quality = result.calibration.quality
    assert quality is not None
    assert quality.covariance is not None
    K = result.calibration.intrinsics
    found = np.array([K.fx, K.fy, K.cx, K.cy])
    std = np.sqrt(np.diag(quality.covariance.matrix)[:4] * quality.inflation)
    assert (np.abs(found - TRUTH[:4]) < 3 * std).all()
    assert std[0] < 0.002 * K.fx
    assert result.verdict is not Use.NONE
    assert result.calibration.grade is Grade.ADJUSTED
    assert result.calibration.provenance.kind == FLIGHT


def test_a_flight_at_two_heights_with_good_positions_passes() -> None:
    result = judged("two heights, flat, RTK")
    assert result.verdict is Use.FIXED, result.rules


@pytest.mark.parametrize(
    ("part", "fault", "said"),
    every(
        3,
        [
            ("shift_of_term", None, "next radial term"),
            ("held_in_the_middle", np.linalg.LinAlgError(), "principal point in the middle"),
            ("_nuisances_found", CalibrationError("singular"), "shifts the images"),
        ],
    ),
)
def test_what_sigma_lacks_is_told_and_the_camera_is_not_kept_fixed(
    part: str, fault: Exception | None, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        if fault is not None:
            raise fault

    monkeypatch.setattr(f"calibrary.sfm.sigma.{part}", fails)
    result = flight_result(adjusted("two heights, flat, RTK"))
    assert result.verdict is Use.START
    told = next(one for one in result.findings if one.rule == "unknown-uncertainty")
    assert said in told.message


@pytest.mark.thorough
def test_a_fisheye_is_told_from_the_models_that_can_follow_it() -> None:
    camera = replace(
        CAMERA,
        intrinsics=replace(CAMERA.intrinsics, fx=700.0, fy=700.0),
        distortion=KannalaBrandt(k1=-0.02, k2=0.003, k3=-0.002, k4=3e-4),
    )
    found = adjust(*fly(PLANS["oblique, flat"], 1, camera))
    assert found.bundle.scene.model is Solvable.FISHEYE
    np.testing.assert_allclose(found.bundle.scene.parameters[:2], 700.0, rtol=2e-3)


@pytest.mark.thorough
def test_beside_a_lens_that_may_not_be_chosen_the_others_are_searched_to_their_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lens = Rational(k1=0.35, k2=0.05, p1=0.0, p2=0.0, k3=0.002, k4=0.7, k5=0.18, k6=0.01)
    wide = replace(CAMERA.intrinsics, fx=900.0, fy=900.0)
    plan = changed(PLANS["two heights, relief"], relief=0.05)
    tracks, start = fly(plan, 2, replace(CAMERA, intrinsics=wide, distortion=lens))

    def brown() -> Candidate:
        return next(one for one in adjust(tracks, start).candidates if one.model is Solvable.BROWN)

    def unfit(model: Solvable, *_: object) -> str | None:
        return "it folds" if model is Solvable.FISHEYE else None

    stopped = brown()
    assert "no better than fisheye where its search ended" in (stopped.refused or "")
    monkeypatch.setattr("calibrary.sfm.adjust.reason_unfit", unfit)
    assert brown().rms_px < 0.6 * stopped.rms_px


@pytest.mark.thorough
def test_a_lens_that_no_model_has_keeps_the_simpler_one_and_its_focal_length() -> None:
    judged = flight_result(adjust(*fly(changed(PLANS["two heights, relief"], ripple_px=0.25), 101)))
    assert judged.calibration.distortion is not None
    assert judged.calibration.distortion.model == "brown"
    quality = judged.calibration.quality
    assert quality is not None
    assert judged.calibration.intrinsics.fx == pytest.approx(1123.5, abs=3 * quality.std["fx"])


@pytest.mark.thorough
def test_outliers_do_not_count() -> None:
    plan = PLANS["oblique, noise 0.8, 8 % out"]
    found = adjusted("oblique, noise 0.8, 8 % out")
    left = 1 - len(found.bundle.tracks.point) / len(found.everything.point)
    assert 0.75 * plan.outliers < left < 1.3 * plan.outliers
    assert found.bundle.rms_px == pytest.approx(plan.noise_px * np.sqrt(2), rel=0.1)


@pytest.mark.parametrize("name", every(2, ["flat, one height", "flat, cross strips"]))
def test_a_flat_flight_at_one_height_never_passes_and_says_what_to_fly(name: str) -> None:
    found = judged(name)
    assert found.verdict is not Use.FIXED
    weak = next(one for one in found.findings if one.rule == "focal-length-or-height")
    assert "cannot be told apart" in weak.message
    assert "one height" in weak.message
    assert "straight down" in weak.message
    assert weak.remedy is not None
    assert "second height" in weak.remedy
    assert "30°" in weak.remedy


@pytest.mark.thorough
def test_what_to_fly_is_what_the_flight_lacks() -> None:
    found = judged("oblique, noise 0.8, 8 % out")
    assert flown_of(found).geometry.tilt_deg > 20
    wide = next(one for one in found.findings if one.rule == "uncertain-focal-length")
    assert wide.remedy is not None
    assert "30°" not in wide.remedy
    assert ("second height" in wide.remedy) == (flown_of(found).geometry.height_ratio < 1.15)


def test_geometry_is_told_from_what_was_flown() -> None:
    flat, good = (
        flown_of(judged("flat, one height")).geometry,
        flown_of(judged("two heights, flat, RTK")).geometry,
    )
    assert flat.height_ratio < 1.1
    assert good.height_ratio > 1.4
    assert flat.headings_deg < 20
    assert good.headings_deg > 80
    assert flat.focal_by_px > FOCAL_BY_PX
    assert good.focal_by_px < 0.3


def test_a_flight_is_judged_alike_whatever_the_camera_resolves() -> None:
    def by_px(width: int) -> float:
        """Of the same flight by a camera of that many columns, with noise that grows with the image."""
        camera = CAMERA.scaled((width, width * 2 // 3))
        bundle = adjust(*fly(replace(SMALL, noise_px=0.3 * width / 1600), 3, camera)).bundle
        return flight_geometry(bundle, covariance(bundle)).focal_by_px

    assert by_px(6000) == pytest.approx(by_px(2000), rel=0.03)


def test_halves_of_images_with_noise_alone_agree() -> None:
    kappa2 = judged("two heights, flat, RTK").evidence.kappa2
    assert kappa2 is not None
    assert 0.3 < kappa2 < 2.0


def test_halves_disagree_where_images_are_bent() -> None:
    """A rolling shutter: every image is sheared by its own motion."""
    tracks, scene = fly(replace(PLANS["two heights, flat, RTK"], outliers=0.0), 5)
    shear = np.random.default_rng(1).normal(0, 3e-3, (len(tracks.names), 2))[tracks.image]
    rows = tracks.pixels[:, 1:] - 500
    bent = replace(tracks, pixels=tracks.pixels + shear * rows)
    split = halves(adjust(bent, scene, model=Solvable.BROWN).bundle)
    assert split is not None
    assert split.kappa2 > 2.0


def test_anchoring_turns_the_world_to_where_its_images_were_and_changes_none_of_them() -> None:
    tracks, scene = fly(PLANS["two heights, relief"], seed=3)
    assert tracks.positions is not None
    weights = 1 / tracks.positions.std
    places = 1.1 * scene.centres @ rotation_matrix(np.array([0.02, -0.03, 0.05])).T + 7.0
    found = anchored(scene, places, weights)
    assert np.abs(found.centres - places).max() < 0.01
    arms = [
        np.einsum(
            "nij,nj->ni", one.rotations[tracks.image], one.points[tracks.point] - one.centres[tracks.image]
        )
        for one in (scene, found)
    ]
    assert np.allclose(arms[1], arms[0] * 1.1, rtol=1e-3)


def test_a_held_principal_point_stays() -> None:
    tracks, scene = fly(SMALL, 4)
    found = adjust(tracks, scene, model=Solvable.K1K2, held=("cx", "cy"))
    assert found.bundle.scene.parameters[2:4].tolist() == [750.0, 500.0]
    assert (np.diag(covariance(found.bundle))[2:4] == 0).all()


def test_too_little_is_no_camera() -> None:
    tracks, scene = fly(replace(SMALL, points=40), 1)
    with pytest.raises(CalibrationError, match="need 60 points"):
        adjust(tracks, scene)
    with pytest.raises(CalibrationError, match="0 points in 0 images"):
        adjust(tracks.only(np.zeros(len(tracks.point), dtype=np.bool_)), scene)


def test_thinning_keeps_every_image() -> None:
    tracks, _ = fly(SMALL, 1)
    few = thinned(tracks, 120)
    assert len(np.unique(few.point)) <= 120
    assert few.used.all()


def test_the_cost_of_what_is_known_is_the_sum_of_its_weighted_squares() -> None:
    known = Known(
        place_by=np.zeros((2, 3, 1)),
        place_by_turn=np.zeros((2, 3, 3)),
        up_by=0.0,
        weight=np.array([2.0]),
        off=np.array([3.0]),
        by_aspect=5.0,
        aspect=0.2,
        aspect_by=np.zeros(2),
        by_lens=np.array([0.0, 4.0]),
        lens=np.array([9.0, 0.5]),
    )
    priors = Priors(
        by_place=np.ones((2, 3)),
        off_place=np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]),
        by_point=np.full((1, 3), 2.0),
        off_point=np.array([[1.0, 0.0, 0.0]]),
        by_offset=None,
        known=known,
    )
    # Places 18, points 4, nuisances 36, square pixels 1, lens parameters 4.
    assert priors.cost == pytest.approx(63.0)
    # A constant offset of 2 m takes half of what all places are off by 4 m.
    moved = replace(priors, off_place=np.tile([4.0, 0.0, 0.0], (2, 1)), by_offset=2.0)
    assert moved.cost == pytest.approx(8.0 + 8.0 + 45.0)
