"""What counts as lost when a calibration is written: what is gone, never the last digit of a number."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from math import inf, nextafter

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Intrinsics, Origin, Quality
from calibrary.distortion import BrownConrady, NoDistortion, Rational
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.convention import Convention
from calibrary.parsers.fit import compare
from calibrary.parsers.format import (
    FREE_LENS,
    UNKNOWN_LENS,
    Capacity,
    Fidelity,
    Format,
    ReadContext,
    Sniff,
    Sure,
    UnknownLens,
    WriteContext,
)
from calibrary.quality import Covariance
from calibrary.records import replace
from tests.parsers.cameras import BROWN, camera

QUALITY = Quality(
    rms_px=0.31,
    points=4711,
    views=21,
    std={"fx": 0.4, "k1": 1e-5},
    covariance=Covariance(names=("fx", "fy"), upper=(0.16, 0.1, 0.16)),
    kappa2=1.3,
    coverage=0.71,
)
FULL = replace(camera(BROWN), quality=QUALITY)
SIZE = (4000, 3000)
BARRELLED = replace(
    FULL,
    intrinsics=Intrinsics(fx=3000.0, fy=3000.0, cx=2000.0, cy=1500.0, image_size=SIZE),
    camera=replace(FULL.camera, image_size=SIZE),
    distortion=BrownConrady(k1=-0.1, k2=0.02, p1=0.0, p2=0.0, k3=0.0),
)


def holding(copy: Calibration) -> Format:
    """A format out of which ``copy`` is read, whatever was written."""

    def write(_items: Sequence[Calibration], _context: WriteContext) -> bytes:
        return b"x"

    def read(_data: bytes, _context: ReadContext) -> list[Calibration]:
        return [copy]

    return Format(
        name="holding",
        title="Holding",
        suffixes=(".x",),
        reference="https://example.org",
        convention=Convention(origin=Origin.CORNER),
        sniff=lambda _content: Sniff(Sure.WEAK, "always"),
        read=read,
        write=write,
        capacity=Capacity(models=(BrownConrady,), skew=True),
    )


def dropped(copy: Calibration, original: Calibration = FULL) -> tuple[str, ...]:
    return parsers.encode([original], holding(copy))[1].dropped


def ulp(value: float) -> float:
    return nextafter(value, inf)


def test_the_last_digit_of_a_number_is_no_loss() -> None:
    near = Quality(
        rms_px=ulp(0.31),
        points=4711,
        views=21,
        std={"fx": ulp(0.4), "k1": ulp(1e-5)},
        covariance=Covariance(names=("fx", "fy"), upper=(ulp(0.16), ulp(0.1), ulp(0.16))),
        kappa2=ulp(1.3),
        coverage=ulp(0.71),
    )
    key = replace(FULL.camera, focal_mm=8.8)
    copy = replace(FULL, quality=near, camera=replace(key, focal_mm=ulp(8.8)))
    assert dropped(copy, replace(FULL, camera=key)) == ()


@pytest.mark.parametrize(
    ("quality", "words"),
    [
        (replace(QUALITY, rms_px=0.32), "rms of the reprojection error"),
        (replace(QUALITY, points=None), "number of points"),
        (replace(QUALITY, views=20), "number of views"),
        (replace(QUALITY, std={"fx": 0.4}), "standard deviations"),
        (replace(QUALITY, covariance=None), "covariance"),
        (replace(QUALITY, covariance=Covariance(names=("fx", "fy"), upper=(0.16, 0, 0.16))), "covariance"),
        (replace(QUALITY, kappa2=None), "scatter against the covariance"),
        (replace(QUALITY, coverage=None), "coverage of the frame"),
    ],
)
def test_what_is_gone_is_named(quality: Quality, words: str) -> None:
    assert dropped(replace(FULL, quality=quality)) == (words,)


def test_what_was_not_known_before_is_no_loss() -> None:
    assert dropped(FULL, replace(FULL, quality=None)) == ()


def test_two_focal_lengths_that_differ_in_the_last_digit_are_one() -> None:
    K = replace(FULL.intrinsics, fy=FULL.intrinsics.fx, skew=0.0)
    nearly = replace(FULL, intrinsics=replace(K, fy=ulp(K.fy), skew=5e-324))
    file, verdict = parsers.encode([nearly], holding(replace(FULL, intrinsics=K)))
    assert (file, verdict.outcome, verdict.dropped) == (b"x", Fidelity.EXACT, ())


@pytest.mark.parametrize("other", [0.0, -1e-18])
def test_a_coefficient_of_almost_nothing_need_not_come_back(other: float) -> None:
    lens = BrownConrady(k1=-0.1, k2=0.02, p1=1e-18, p2=0.0, k3=0.0)
    fit = compare(camera(lens), camera(replace(lens, p1=other)))
    assert fit.exact
    assert fit.max_px < 1e-8


def test_a_coefficient_that_moves_a_ray_must_come_back() -> None:
    lens = BrownConrady(k1=-0.1, k2=0.02, p1=1e-9, p2=0.0, k3=0.0)
    assert not compare(camera(lens), camera(replace(lens, p1=0.0))).exact


def test_a_file_of_k_alone_is_not_called_exact_but_says_how_far_the_lost_distortion_moves_pixels() -> None:
    _, verdict = parsers.encode([BARRELLED], "k_npy", drop_distortion=True)
    K = BARRELLED.intrinsics
    corners = np.array([[0.0, 0.0], [4000.0, 0.0], [0.0, 3000.0], [4000.0, 3000.0]])
    camera = np.array([[K.fx, 0.0, K.cx], [0.0, K.fy, K.cy], [0.0, 0.0, 1.0]])
    straight = cv2.undistortPoints(corners[:, None], camera, np.array([-0.1, 0.02, 0.0, 0.0, 0.0]), P=camera)[
        :, 0
    ]
    farthest = np.linalg.norm(straight - corners, axis=1).max()
    assert verdict.outcome is Fidelity.K_ONLY
    assert verdict.lost_px == pytest.approx(farthest, rel=0.01)
    assert str(verdict).startswith(f"K only: distortion of up to {verdict.lost_px:.4g} px is lost; dropped: ")


def test_what_k_loses_beside_the_distortion_is_in_the_px_that_are_said() -> None:
    slight = BrownConrady(k1=1e-6, k2=0.0, p1=0.0, p2=0.0, k3=0.0)
    skewed = replace(BARRELLED, intrinsics=replace(BARRELLED.intrinsics, skew=13.0), distortion=slight)
    _, verdict = parsers.encode(
        [skewed], "stac_interior_orientation", max_error_px=10.0, drop_distortion=True
    )
    straight = replace(skewed, intrinsics=replace(skewed.intrinsics, skew=0.0), distortion=NoDistortion())
    u, v = np.meshgrid(np.linspace(0.0, 4000.0, 41), np.linspace(0.0, 3000.0, 31))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    apart = np.linalg.norm(straight.project(skewed.unproject(pixels)) - pixels, axis=1).max()
    assert apart > 1
    assert verdict.outcome is Fidelity.K_ONLY
    assert verdict.lost_px == pytest.approx(apart, rel=0.01)
    assert str(verdict).startswith(
        f"K only: what is lost moves pixels by up to {verdict.lost_px:.4g} px; dropped: "
    )


@pytest.mark.parametrize("form", ["k_npy", "esri_cameras"])
def test_a_distortion_is_lost_only_on_the_users_word(form: str) -> None:
    one_focal = replace(BARRELLED, intrinsics=replace(BARRELLED.intrinsics, fy=BARRELLED.intrinsics.fx))
    with pytest.raises(UnsupportedModelError, match=r"of up to (.*) px would be lost") as refused:
        parsers.encode([one_focal], form)
    limit = float(re.search(r"--max-error-px ([\d.]+)", str(refused.value))[1])  # type: ignore[index]
    _, allowed = parsers.encode([one_focal], form, max_error_px=limit)
    _, said = parsers.encode([one_focal], form, drop_distortion=True)
    assert (allowed.outcome, said.outcome) == (Fidelity.K_ONLY, Fidelity.K_ONLY)
    assert 0.95 * limit < allowed.lost_px == said.lost_px <= limit


def test_k_of_a_lens_without_distortion_loses_none() -> None:
    _, verdict = parsers.encode([replace(BARRELLED, distortion=NoDistortion())], "k_npy")
    assert verdict.outcome is Fidelity.EXACT


UNKNOWN = replace(BARRELLED, distortion=None)


@pytest.mark.parametrize("form", ["opencv_storage", "keyed_text", "numpy_npz", "blocksexchange_xml", "k_npy"])
def test_what_is_unknown_is_written_as_unknown_where_the_format_can_say_so(form: str) -> None:
    data, verdict = parsers.encode([UNKNOWN], form)
    size = UNKNOWN.intrinsics.image_size
    [copy] = parsers.decode(data, name="x", format=form, image_size=size if form == "k_npy" else None)
    assert copy.distortion is None
    assert str(verdict).startswith("exact (0.000 px)")


def test_colmap_gets_coefficients_that_it_can_find_for_what_is_unknown() -> None:
    data, verdict = parsers.encode([UNKNOWN], "colmap_text")
    assert b" OPENCV 4000 3000 " in data
    assert str(verdict).startswith("K is exact (0.000 px); dropped: that the distortion is unknown")


@pytest.mark.parametrize("form", ["ros_camera_info", "kalibr", "transforms_json", "mrcal", "stella_vslam"])
def test_what_is_unknown_is_written_as_none_only_on_the_users_word(form: str) -> None:
    with pytest.raises(UnsupportedModelError, match=r"the distortion is unknown.* or --drop-distortion"):
        parsers.encode([UNKNOWN], form, max_error_px=1e9)
    _, verdict = parsers.encode([UNKNOWN], form, drop_distortion=True)
    assert str(verdict).startswith("K is exact (0.000 px); dropped: ")
    assert "the file says that there is none" in str(verdict)


def test_a_word_about_distortion_does_not_excuse_a_fisheye_without_coefficients() -> None:
    with pytest.raises(UnsupportedModelError, match="always states one"):
        parsers.encode([UNKNOWN], "gyroflow", drop_distortion=True)


def test_the_largest_difference_is_found_beside_the_axis_too() -> None:
    """A rational lens whose numerator and denominator cancel everywhere but at the axis."""
    K = BARRELLED.intrinsics
    lens = Rational(k1=0.5e8, k2=0.0, p1=0.0, p2=0.0, k3=0.0, k4=1e8, k5=0.0, k6=0.0)
    half = replace(BARRELLED, intrinsics=replace(K, fx=K.fx / 2, fy=K.fy / 2), distortion=NoDistortion())
    fit = compare(half, replace(BARRELLED, distortion=lens))
    assert fit.max_px == pytest.approx(max(K.fx, K.fy) * 0.5 / (2 * math.sqrt(1e8)), rel=0.05)
    assert fit.rms_px < fit.max_px / 10


@pytest.mark.parametrize("unknown_lens", [UnknownLens.FREE, UnknownLens.NONE])
def test_a_lens_that_was_unknown_reads_as_none_or_as_free(unknown_lens: UnknownLens) -> None:
    form = holding(camera(NoDistortion()))
    assert form.capacity is not None
    form = replace(form, capacity=replace(form.capacity, unknown_lens=unknown_lens))
    _, verdict = parsers.encode([camera(None)], form, drop_distortion=unknown_lens is UnknownLens.NONE)
    assert (FREE_LENS in verdict.dropped) is (unknown_lens is UnknownLens.FREE)
    assert (UNKNOWN_LENS in verdict.dropped) is (unknown_lens is UnknownLens.NONE)
