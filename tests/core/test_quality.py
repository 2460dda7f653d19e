from __future__ import annotations

import numpy as np
import pytest

from calibrary.calibration import Calibration, CameraKey, Covariance, Grade, Intrinsics, Provenance, Quality
from calibrary.errors import InputError

NAMES = ("fx", "fy", "cx")
MATRIX = np.array([[4.0, 3.5, 0.1], [3.5, 4.1, 0.0], [0.1, 0.0, 1.0]])


def test_a_matrix_survives_being_held_as_its_upper_triangle() -> None:
    np.testing.assert_array_equal(Covariance.from_matrix(NAMES, MATRIX).matrix, MATRIX)


def test_standard_deviations_are_the_roots_of_the_diagonal() -> None:
    assert Covariance.from_matrix(NAMES, MATRIX).std == {"fx": 2.0, "fy": np.sqrt(4.1), "cx": 1.0}


def test_a_part_comes_in_the_order_that_was_asked_for() -> None:
    part = Covariance.from_matrix(NAMES, MATRIX).of(("cx", "fx"))
    np.testing.assert_array_equal(part, [[1.0, 0.1], [0.1, 4.0]])


def test_a_parameter_it_does_not_hold_is_named() -> None:
    with pytest.raises(InputError, match="does not hold k1"):
        Covariance.from_matrix(NAMES, MATRIX).of(("fx", "k1"))


@pytest.mark.parametrize(
    ("names", "upper", "message"),
    [
        (("fx", "fx"), (1.0, 0.0, 1.0), "names a parameter twice"),
        (("fx", "fy"), (1.0, 0.0), "3 numbers in its upper triangle, found 2"),
        (("fx",), (float("nan"),), "NaN or infinity"),
        (("fx",), (-1.0,), "negative variance"),
    ],
)
def test_what_is_no_covariance_is_refused(
    names: tuple[str, ...], upper: tuple[float, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Covariance(names=names, upper=upper)


def test_a_matrix_that_is_not_symmetric_is_refused() -> None:
    with pytest.raises(InputError, match="not symmetric"):
        Covariance.from_matrix(("fx", "fy"), [[1.0, 0.5], [0.4, 1.0]])


def test_a_half_size_image_has_half_the_error_in_px() -> None:
    quality = Quality(
        rms_px=0.4, std={"fx": 2.0, "k1": 0.01}, covariance=Covariance.from_matrix(NAMES, MATRIX)
    )
    camera = Calibration(
        camera=CameraKey(model="X", image_size=(4000, 3000)),
        intrinsics=Intrinsics(fx=3000, fy=3000, cx=2000, cy=1500, image_size=(4000, 3000)),
        grade=Grade.CALIBRATED,
        quality=quality,
        provenance=Provenance(kind="checkerboard"),
    )
    half = camera.scaled((2000, 1500)).quality
    assert half is not None
    assert half.rms_px == pytest.approx(0.2)
    assert half.std == {"fx": 1.0, "k1": 0.01}
    assert half.covariance is not None
    np.testing.assert_allclose(half.covariance.matrix, MATRIX / 4)


@pytest.mark.parametrize(("kappa2", "inflation"), [(None, 1.0), (0.6, 1.0), (5.7, 5.7)])
def test_variances_are_inflated_and_never_shrunk(kappa2: float | None, inflation: float) -> None:
    assert Quality(kappa2=kappa2).inflation == inflation


def test_the_correlation_is_that_of_the_samples_and_unknown_without_variance() -> None:
    samples = np.random.default_rng(3).normal(size=(3, 50)) * [[1.0], [30.0], [0.02]]
    samples[1] += samples[0]
    found = Covariance.from_matrix(("fx", "fy", "k1"), np.cov(samples)).correlation
    np.testing.assert_allclose(found, np.corrcoef(samples))
    assert np.isnan(Covariance.from_matrix(("fx", "k1"), np.diag([1.0, 0.0])).correlation[0, 1])
