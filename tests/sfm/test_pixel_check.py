"""What the pixels of a few images say of K: the labelled cases, a row of each kind."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.jobs.verify.look import Look
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.alterations import MeasuredCamera
from calibrary.sfm.pixel_check import PixelVerdict
from calibrary.sfm.two_view import TwoViewFocal, focal_of_fundamental
from tests.sfm.flights import CAMERA
from tests.sfm.pixel_cases import FLIGHTS, looked_at, scaled_k

AGREES, CONTRADICTS, CANNOT_TELL = PixelVerdict
FX = CAMERA.intrinsics.fx


@pytest.fixture(scope="module")
def looks() -> dict[str, Look]:
    """One flight of each kind, adjusted once."""
    names = ("oblique, relief, no GPS", "flat, one height", "relief, six images")
    return {name: looked_at(FLIGHTS[name], 1) for name in names}


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [(1.0, AGREES), (1.03, CONTRADICTS), (0.97, CONTRADICTS), (0.8, CONTRADICTS), (2.7, CONTRADICTS)],
)
def test_a_flight_that_determines_f_tells_right_from_wrong(
    factor: float, verdict: PixelVerdict, looks: dict[str, Look]
) -> None:
    assert looks["oblique, relief, no GPS"].check(scaled_k(factor), 0.05).verdict is verdict


@pytest.mark.parametrize("factor", [1.0, 0.9, 2.7])
@pytest.mark.parametrize("flight", ["flat, one height", "relief, six images"])
def test_one_that_does_not_says_nothing_of_any_k(flight: str, factor: float, looks: dict[str, Look]) -> None:
    assert looks[flight].check(scaled_k(factor), 0.05).verdict is CANNOT_TELL


def test_the_reason_names_what_the_flight_lacks(looks: dict[str, Look]) -> None:
    assert "cannot be told apart" in looks["flat, one height"].check(CAMERA, 0.05).reason
    assert looks["relief, six images"].check(CAMERA, 0.05).reason == "6 images fit one another, need 8"


def test_pairs_alone_come_to_the_same_focal_length_without_a_start(looks: dict[str, Look]) -> None:
    pairs = looks["oblique, relief, no GPS"].pairs
    assert pairs is not None
    assert pairs.focal_px == pytest.approx(FX, rel=0.03)
    assert abs(pairs.focal_px / FX - 1) < 3 * pairs.std
    assert looks["flat, one height"].pairs is None


def found(**over: float) -> MeasuredCamera:
    values = {"focal_px": FX, "std": 0.005, "by_px": 0.3, "edge": -11.0, "edge_std": 0.3} | over
    return MeasuredCamera(
        focal_px=values["focal_px"],
        std=values["std"],
        by_px=values["by_px"],
        images=12,
        corner_px=(values["edge"], values["edge_std"]),
        split=True,
    )


def look(measured: MeasuredCamera, pairs: TwoViewFocal | None = None) -> Look:
    return Look(chosen=12, found=measured, pairs=pairs)


@pytest.mark.parametrize(
    ("difference", "std", "verdict"),
    [
        (0.02, 0.005, CONTRADICTS),
        (0.014, 0.001, AGREES),  # beyond doubt, and no more than focus and heat do
        (0.02, 0.01, AGREES),
        (0.034, 0.015, CANNOT_TELL),  # neither within 5 % at ±2 σ nor beyond doubt
        (0.0, 0.026, CANNOT_TELL),
        (-0.08, 0.02, CONTRADICTS),
    ],
)
def test_the_verdict_needs_both_size_and_certainty(
    difference: float, std: float, verdict: PixelVerdict
) -> None:
    assert look(found(focal_px=FX * (1 + difference), std=std)).check(CAMERA, 0.05).verdict is verdict


def test_pairs_that_contradict_the_adjustment_leave_both_in_doubt() -> None:
    pairs = TwoViewFocal(focal_px=FX * 1.1, std=0.01, pairs=20)
    check = look(found(focal_px=FX * 1.04), pairs).check(CAMERA, 0.05)
    assert check.verdict is CANNOT_TELL
    assert "further apart than their uncertainties explain" in check.reason


def test_a_longer_focal_length_is_named_as_a_crop_or_zoom() -> None:
    assert "digital zoom of 1.25×" in look(found(focal_px=FX * 1.25)).check(CAMERA, 0.05).reason


LENS = BrownConrady(k1=-0.08, k2=0.05, p1=0.0, p2=0.0, k3=-0.012)


def test_a_distortion_that_was_removed_in_the_camera_is_noticed() -> None:
    stated = replace(CAMERA, distortion=LENS)
    lens = look(found(edge=0.4)).check(stated, 0.05).distortion
    assert lens is not None
    assert lens.stated_px < -10
    assert (lens.removed, lens.present) == (True, False)
    same = look(found(edge=lens.stated_px + 0.5)).check(stated, 0.05).distortion
    assert same is not None
    assert not same.removed


def test_a_distortion_in_images_that_state_none_is_noticed() -> None:
    dewarped = replace(CAMERA, distortion=NoDistortion())
    lens = look(found(edge=-11.0)).check(dewarped, 0.05).distortion
    assert lens is not None
    assert (lens.removed, lens.present) == (False, True)
    unsure = look(found(edge=-11.0, edge_std=4.0)).check(dewarped, 0.05).distortion
    assert unsure is not None
    assert not unsure.present


def test_an_unknown_distortion_is_not_compared() -> None:
    assert look(found()).check(replace(CAMERA, distortion=None), 0.05).distortion is None


def test_the_focal_length_of_a_fundamental_matrix_is_exact() -> None:
    """Of pairs of tilted cameras, by E = [t]× R; the quadratic equation has a second solution for many of them."""
    random = np.random.default_rng(1)
    for _ in range(100):
        focal, R = random.uniform(0.6, 2.0), rotation_matrix(random.normal(0, 0.4, 3))
        x, y, z = random.normal(0, 1, 3)
        E = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R
        inverse = np.diag([1 / focal, 1 / focal, 1.0])
        assert focal_of_fundamental(inverse @ E @ inverse) == pytest.approx(focal, rel=1e-6)
