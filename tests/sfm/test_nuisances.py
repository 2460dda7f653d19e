"""What shifts the images of a flight besides the lens: found or bounded, and carried into σ."""

from __future__ import annotations

from dataclasses import replace as changed
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.least_squares import marginal, reduce
from calibrary.calib.lens_models import Solvable
from calibrary.calib.result import CalibrationResult
from calibrary.records import replace
from calibrary.sfm import ripple
from calibrary.sfm.adjust import Adjustment, adjust
from calibrary.sfm.assessment import flight_result
from calibrary.sfm.bundle import Bundle, linearise, projections, unmoved, with_own
from calibrary.sfm.nuisances import (
    HEIGHT_SCALE,
    READOUT,
    READOUT_S,
    NuisancePriors,
    ahead,
    ahead_by_turn,
    readout_of,
    row_shift,
)
from calibrary.sfm.tracks import Scene, Tracks, aligned
from tests.jobs.extract.fleet import picture
from tests.sfm.flights import CAMERA, PLANS, Plan, courses, flown_of, fly

TWO_HEIGHTS = changed(PLANS["two heights, flat, RTK"], points=500)
METRES = changed(PLANS["two heights, relief"], gps_m=(1.0, 1.5), points=500)
OBLIQUE = Plan(
    heights=(1.0, 1.0), cross=True, oblique_deg=30.0, rows=3, columns=5, gps_m=(0.02, 0.03), points=500
)
TRUTH = Solvable.BROWN.values(CAMERA.intrinsics, CAMERA.distortion)
NAMES = ("fx", "fy", "cx", "cy")


@cache
def adjusted(plan: Plan) -> Adjustment:
    return adjust(*fly(plan, 1))


@cache
def flown(plan: Plan) -> CalibrationResult:
    return flight_result(adjusted(plan))


def scores(of: CalibrationResult) -> dict[str, float]:
    """The true error of each number, in its stated σ × κ."""
    quality, K = of.calibration.quality, of.calibration.intrinsics
    assert quality is not None
    std = {name: quality.std[name] * float(np.sqrt(quality.inflation)) for name in NAMES}
    return {name: (getattr(K, name) - getattr(CAMERA.intrinsics, name)) / std[name] for name in NAMES}


def noise_of(result: CalibrationResult) -> float:
    """Standard deviation of fx without the variance factor, px."""
    assert result.calibration.quality is not None
    return result.calibration.quality.std["fx"]


def nuisance(of: CalibrationResult, name: str) -> tuple[float, float]:
    one = next(one for one in flown_of(of).nuisances if one.name.startswith(name))
    return one.value, one.std


FAULTS = {
    "positions late, aside and too high": changed(
        TWO_HEIGHTS, late_s=0.04, lever_m=(0.12, 0.2), height_scale=0.004
    ),
    "rolling shutter": changed(OBLIQUE, readout_s=0.04),
    "rolling shutter without positions": changed(
        PLANS["oblique, relief, no GPS"], readout_s=0.03, points=500
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_that_no_residual_shows_leaves_k_within_its_sigma(fault: str) -> None:
    found = scores(flown(FAULTS[fault]))
    assert max(map(abs, found.values())) < 3, found


def test_late_positions_and_a_lever_are_found_together_and_the_scale_of_heights_in_percent() -> None:
    found = flown(FAULTS["positions late, aside and too high"])
    for name, true in (
        ("positions ahead", 10.0 * 0.04 + 0.12),
        ("positions to the right", 0.2),
        ("scale of the heights", 0.4),
    ):
        value, std = nuisance(found, name)
        assert abs(value - true) < 3 * std < true


def test_the_travel_during_a_readout_is_found() -> None:
    value, std = nuisance(flown(FAULTS["rolling shutter"]), "travel")
    assert abs(value - 0.4) < 3 * std < 0.15


def test_a_readout_without_positions_is_a_share_of_the_height() -> None:
    found = flown(FAULTS["rolling shutter without positions"])
    one = next(one for one in flown_of(found).nuisances if one.name.startswith("travel"))
    assert one.unit == "‰ of the flying height"
    assert abs(one.value - 1000 * 0.3 / 80) < 3 * one.std < 6


def test_a_mechanical_shutter_has_no_readout_to_find() -> None:
    found = flight_result(adjust(*fly(OBLIQUE, 1), readout_s=(0.0, 0.0)))
    assert [one.name for one in flown_of(found).nuisances if one.name.startswith("travel")] == []


@pytest.mark.thorough
def test_positions_of_metres_say_nothing_of_levers_and_heights() -> None:
    found = flown(METRES)
    assert [one.name for one in flown_of(found).nuisances] == ["travel during the readout"]


def test_what_cannot_be_told_apart_from_the_principal_point_is_said() -> None:
    one_height = flown(Plan(gps_m=(0.02, 0.03)))
    lever = next(one for one in flown_of(one_height).nuisances if one.name.startswith("positions ahead"))
    assert lever.trades_with == "cy"
    assert lever.words.endswith("cannot be told apart from cy, whose σ includes it")


@pytest.mark.thorough
def test_a_lens_that_departs_from_every_model_widens_sigma() -> None:
    straight, rippled = flown(OBLIQUE), flown(changed(OBLIQUE, ripple_px=0.6))
    std = [noise_of(of) for of in (straight, rippled)]
    assert std[1] > 2 * std[0]


@pytest.mark.thorough
def test_a_principal_point_that_wanders_from_image_to_image_widens_sigma() -> None:
    tracks, scene = fly(OBLIQUE, 1)
    wander = np.random.default_rng(1).normal(0, 3.0, (len(tracks.names), 2))
    moved = flight_result(adjust(replace(tracks, pixels=tracks.pixels + wander[tracks.image]), scene))
    std = [noise_of(of) for of in (flown(OBLIQUE), moved)]
    assert std[1] > 2 * std[0]
    assert all(abs(score) < 3 for score in scores(moved).values())


def test_a_corner_of_the_frame_that_shows_no_point_leaves_the_camera_known() -> None:
    tracks, scene = fly(OBLIQUE, 1)
    seen = tracks.only(np.asarray((tracks.pixels > 0.3 * np.array(tracks.image_size)).any(axis=1)))
    assert all(abs(score) < 3 for score in scores(flight_result(adjust(seen, scene))).values())


def test_a_field_may_stand_for_a_focal_length_that_is_held() -> None:
    """Only what is free imitates a field."""
    tracks, scene = fly(OBLIQUE, 1)
    free, held = (
        beside(adjust(tracks, scene, held=names, model=Solvable.BROWN).bundle)[2]
        for names in ((), ("fx", "fy"))
    )
    assert held.shape[1] == free.shape[1] + 2


def beside(bundle: Bundle) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The derivatives by the lens and by the fields, and which fields are beside the lens."""
    fields = ripple.basis(bundle.tracks.pixels, bundle.tracks.image_size)
    linear = linearise(bundle.tracks, bundle.scene, bundle.place_variance, lambda _: fields)
    assert linear is not None
    return linear.by_lens, fields, ripple.beside_the_lens(bundle, linear, len(bundle.scene.parameters))


def test_no_field_beside_the_lens_stands_for_a_longer_focal_length() -> None:
    by_lens, fields, chosen = beside(adjusted(OBLIQUE).bundle)

    def unexplained(by: FloatArray) -> float:
        """Share of the derivative by fx that these fields leave."""
        by_fx, columns = by_lens[..., 0].ravel(), by.reshape(-1, by.shape[-1])
        rest = by_fx - columns @ np.linalg.lstsq(columns, by_fx, rcond=None)[0]
        return float(np.linalg.norm(rest) / np.linalg.norm(by_fx))

    assert unexplained(fields) < 0.01
    assert unexplained(fields @ chosen) > 0.9


def test_centimetres_that_a_receiver_states_are_not_taken_for_less() -> None:
    tracks, scene = fly(TWO_HEIGHTS, 1)
    assert tracks.positions is not None
    modest = replace(tracks, positions=replace(tracks.positions, std=3 * tracks.positions.std))
    positions = adjust(modest, scene).bundle.tracks.positions
    assert positions is not None
    assert positions.std.min() >= 3 * 0.02


def test_a_usual_sigma_of_a_receiver_that_states_none_follows_its_residuals() -> None:
    positions = adjusted(METRES).bundle.tracks.positions
    assert positions is not None
    assert 0.6 < positions.std[0, 0] < 1.6


# Derivatives


def moving(seed: int = 1) -> tuple[Tracks, Scene]:
    tracks, scene = fly(changed(OBLIQUE, rows=2, columns=3, readout_s=0.04, outliers=0.0), seed)
    assert tracks.positions is not None
    priors = NuisancePriors.of(readout_s=(0.02, 0.02), positions_m=0.02, height=80.0)
    start = replace(
        aligned(scene, tracks.positions), parameters=TRUTH, nuisances=np.array([0.1, -0.05, 0.002, 0.4])
    )
    tracks = replace(tracks, nuisances=priors)
    for _ in range(3):
        tracks = replace(tracks, pixels=projections(tracks, start).pixels)
    return tracks, start


def test_top_of_the_image_points_ahead_on_the_ground() -> None:
    tracks, scene = fly(changed(OBLIQUE, attitude_deg=0.0), 1)
    turns = aligned(scene, tracks.positions).rotations if tracks.positions is not None else scene.rotations
    np.testing.assert_allclose(ahead(turns), courses(OBLIQUE)[:, 0], atol=0.15)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_heading_turns_with_the_camera(axis: int) -> None:
    turns, step = moving()[1].rotations, 1e-6
    skew = np.cross(np.eye(3), step * np.eye(3)[axis])
    moved = (np.eye(3) + skew) @ turns
    here, there = ahead(turns), ahead(moved)
    to_left = (here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]) / step
    np.testing.assert_allclose(to_left, ahead_by_turn(turns)[:, axis], atol=1e-5)


@pytest.mark.parametrize(
    "what", ["nuisance 0", "nuisance 1", "nuisance 2", "nuisance 3", "turn 0", "turn 1", "turn 2"]
)
def test_derivatives_of_a_moving_camera_are_those_of_its_projections_and_positions(what: str) -> None:
    tracks, scene = moving()
    linear, step = linearise(tracks, scene, 0.25), 1e-6
    kind, at = what.split()
    number = int(at)
    if kind == "nuisance":
        moved = replace(scene, nuisances=scene.nuisances + step * np.eye(4)[number])
    else:
        skew = np.cross(np.eye(3), step * np.eye(3)[number])
        moved = replace(scene, rotations=(np.eye(3) + skew) @ scene.rotations)
    again = linearise(tracks, moved, 0.25)
    assert linear is not None
    assert again is not None
    pixels = (linear.residuals - again.residuals) / step
    places = (linear.priors.off_place - again.priors.off_place) / step
    known = linear.priors.known
    by_pixel = (
        linear.shared[..., len(scene.parameters) + number]
        if kind == "nuisance"
        else linear.kept.jac[..., number]
    )
    by_place = known.place_by[..., number] if kind == "nuisance" else known.place_by_turn[..., number]
    np.testing.assert_allclose(pixels, by_pixel, rtol=1e-3, atol=0.02)
    np.testing.assert_allclose(places, by_place, atol=1e-5)


def test_rows_are_those_of_the_projection_not_of_the_measurement() -> None:
    tracks, scene = moving()
    noisy = replace(
        tracks, pixels=tracks.pixels + np.random.default_rng(0).normal(0, 2.0, tracks.pixels.shape)
    )
    off = projections(noisy, scene).pixels - projections(tracks, scene).pixels
    assert float(np.abs(off).max()) < 0.01


def test_observations_of_a_still_camera_are_those_without_the_readout() -> None:
    tracks, scene = moving()
    still = replace(scene, nuisances=scene.nuisances * (np.arange(4) != READOUT))
    left = unmoved(tracks, scene) - projections(tracks, still).pixels
    np.testing.assert_allclose(left, tracks.pixels - projections(tracks, scene).pixels, atol=1e-9)


def test_a_height_scale_keeps_the_middle_of_the_heights() -> None:
    tracks, scene = moving()
    assert tracks.positions is not None
    linear = linearise(tracks, scene, 0.25)
    assert linear is not None
    by = linear.priors.known.place_by[:, 2, HEIGHT_SCALE]
    middle = float(tracks.positions.places[:, 2].mean())
    np.testing.assert_allclose(by, scene.centres[:, 2] - middle)


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        pytest.param({"model": "FC330"}, (0.033, 0.005), id="a rolling shutter that is listed"),
        pytest.param(
            {"model": "FC330", "dji:ShutterType": "Mechanical"}, (0.0, 0.0), id="the image says mechanical"
        ),
        pytest.param({"model": "FC330", "dji:ShutterType": "Electronic"}, (0.033, 0.005), id="or electronic"),
        pytest.param({"model": "FC9999"}, READOUT_S, id="an unknown camera"),
    ],
)
def test_a_readout_is_what_the_image_and_the_catalogue_say_of_the_shutter(
    tmp_path: Path, tags: dict[str, Any], expected: tuple[float, float]
) -> None:
    assert readout_of(picture(tmp_path / "a.jpg", make="DJI", **tags)) == expected


def test_without_an_image_nothing_is_known_of_a_readout(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"no image")
    assert readout_of(tmp_path / "a.jpg") == readout_of(None) == READOUT_S


@pytest.mark.thorough
def test_a_shutter_that_is_known_leaves_less_to_find() -> None:
    tracks, start = fly(TWO_HEIGHTS, 1)
    known = flight_result(adjust(tracks, start, readout_s=(0.0, 0.0)))
    quality, less = known.calibration.quality, flown(TWO_HEIGHTS).calibration.quality
    assert quality is not None
    assert less is not None
    assert quality.std["fy"] < less.std["fy"]


def test_a_travel_that_differs_from_image_to_image_widens_the_camera() -> None:
    still, moving = (flown(changed(OBLIQUE, readout_s=readout)).calibration for readout in (0.0, 0.04))
    assert still.quality is not None
    assert moving.quality is not None
    assert moving.quality.std["cx"] > 1.1 * still.quality.std["cx"]


def test_parameters_of_single_images_enter_as_so_many_columns_of_the_lens_would() -> None:
    bundle = adjusted(OBLIQUE).bundle
    tracks, g = bundle.tracks, len(bundle.free)
    own = bundle.linear.by_lens[..., 2:4]
    columns = np.zeros((len(tracks.point), 2, len(tracks.names), 2))
    columns[np.arange(len(tracks.point)), :, tracks.image] = own
    lens, nuisances = np.split(bundle.linear.shared, [g], axis=2)
    shared = np.concatenate([lens, columns.reshape(len(own), 2, -1), nuisances], axis=2)
    size = shared.shape[2] - nuisances.shape[2]
    whole = reduce(replace(bundle.linear, shared=shared), np.arange(size))
    matrix, right, _ = marginal(whole, size)
    found, its = with_own(bundle, own)
    assert len(found) == g + 2 * len(tracks.names)
    np.testing.assert_allclose(found, matrix, atol=1e-6 * np.abs(matrix).max())
    np.testing.assert_allclose(its, right, atol=1e-6 * np.abs(right).max())


def test_an_image_that_does_not_tell_its_own_principal_point_leaves_the_camera_known() -> None:
    """Three points give its pose and nothing more: such equations are singular."""
    tracks, scene = fly(OBLIQUE, 1)
    few = np.flatnonzero(tracks.image == 0)[3:]
    found = adjust(tracks.only(~np.isin(np.arange(len(tracks.point)), few)), scene, model=Solvable.BROWN)
    shift = ripple.wander_shift(found.bundle, 1.0)
    assert np.isfinite(shift).all()
    assert (np.diag(shift)[:4] < 1.0).all()


def test_a_projection_is_moved_to_the_moment_of_its_own_row() -> None:
    """A camera that flies past by 0.2 px a row: what is seen on the row that is read is what that row saw."""
    pixels, measured = np.array([[300.0, 400.0]]), np.array([[298.0, 250.0]])
    by_arm, travel = np.array([[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]), np.array([[0.0, -200.0, 0.0]])
    shifted, carry, rows = row_shift(pixels, measured, by_arm, travel, 1000)
    row = 1000 * (rows + 0.5)
    assert shifted[:, 1] == pytest.approx(row)
    assert shifted[:, 1] == pytest.approx(400.0 + 0.2 * (row - 250.0))
    assert carry[0] == pytest.approx(np.array([[1.0, 0.0], [0.0, 1.25]]))
