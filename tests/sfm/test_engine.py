"""Features and verified matches: their pixels, their pairs, and what is refused."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calibration import Intrinsics
from calibrary.errors import InputError
from calibrary.sfm import engine
from calibrary.sfm.engine import FlightImage, Matches, match, read_keypoints, read_matches

SIZE = (640, 480)
START = Intrinsics(fx=500.0, fy=500.0, cx=320.0, cy=240.0, image_size=SIZE)
SHIFT = np.array([90.0, 40.0])


def texture(width: int, height: int, seed: int) -> FloatArray:
    """Grey levels with detail at several scales."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.normal(size=(height // s, width // s)), (width, height)) for s in (4, 8, 24)]
    picture = np.sum(layers, axis=0)
    return np.asarray(20 + 215 * (picture - picture.min()) / np.ptp(picture))


@pytest.fixture(scope="module")
def matches(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Matches], list[tuple[int, int, str]]]:
    """Two windows of one scene, 90 and 40 px apart, and an image of another scene; a blank in each name."""
    folder = tmp_path_factory.mktemp("flight")
    scene, other = texture(800, 600, seed=1), texture(*SIZE, seed=2)
    (dx, dy), (w, h) = SHIFT.astype(int), SIZE
    images = []
    for n, picture in enumerate((scene[:h, :w], other, scene[dy : dy + h, dx : dx + w])):
        path = folder / f"image {n}.png"
        cv2.imwrite(str(path), picture)
        images.append(FlightImage(path=path, name=path.name, size=SIZE))
    seen: list[tuple[int, int, str]] = []
    work = tmp_path_factory.mktemp("work")
    matched = match(images, folder=work, start=START, features=600, progress=lambda *step: seen.append(step))
    return read_matches(matched), seen


def test_only_the_images_that_overlap_match_each_by_its_place(
    matches: tuple[list[Matches], list[tuple[int, int, str]]],
) -> None:
    (found,), _ = matches
    assert (found.first, found.second) == (0, 2)
    assert len(found.pixels_first) > 100


def test_the_pixels_are_those_of_the_images(
    matches: tuple[list[Matches], list[tuple[int, int, str]]],
) -> None:
    (found,), _ = matches
    shift = found.pixels_first - found.pixels_second
    assert np.median(shift, axis=0) == pytest.approx(SHIFT, abs=0.02)


def test_one_homography_explains_a_flat_scene(
    matches: tuple[list[Matches], list[tuple[int, int, str]]],
) -> None:
    assert matches[0][0].by_homography


def test_the_progress_counts_images_then_pairs_to_the_end(
    matches: tuple[list[Matches], list[tuple[int, int, str]]],
) -> None:
    _, seen = matches
    assert [seen[0], seen[-1]] == [(0, 3, "features"), (3, 3, "pairs")]
    assert [*dict.fromkeys(what for *_, what in seen)] == ["features", "pairs"]


def test_a_feature_in_a_reduced_image_lies_where_it_is_in_the_full_one(tmp_path: Path) -> None:
    """From the outer corner of the top-left pixel: a spot's centre, half a pixel further than OpenCV counts."""
    at = np.array([[200.25, 150.5], [900.0, 120.75], [260.5, 640.0], [850.5, 600.5]])
    x, y = np.meshgrid(np.arange(1280) + 0.5, np.arange(800) + 0.5)
    spots = sum(np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * 14.0**2)) for u, v in at)
    images = []
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), 20 + 200 * np.asarray(spots))
        images.append(FlightImage(path=tmp_path / name, name=name, size=(1280, 800)))
    start = Intrinsics(fx=900.0, fy=900.0, cx=640.0, cy=400.0, image_size=(1280, 800))
    (tmp_path / "work").mkdir()
    matched = match(images, folder=tmp_path / "work", start=start, max_side=640)
    pixels = read_keypoints(matched)[1]
    nearest = [np.linalg.norm(pixels - spot, axis=1).min() for spot in at]
    assert max(nearest) < 0.25


@pytest.mark.thorough
def test_an_image_with_few_large_features_is_searched_for_small_ones(tmp_path: Path) -> None:
    """Fine grain in the left half of one image alone: features that only the doubled image has."""
    grain = np.random.default_rng(4).normal(0, 40, (480, 320))
    images, found = [], []
    for name in ("smooth.png", "grain.png"):
        picture = texture(*SIZE, seed=3)
        if name == "grain.png":
            picture[:, :320] = cv2.GaussianBlur(128 + grain, (0, 0), 0.7)
        cv2.imwrite(str(tmp_path / name), picture)
        images.append(FlightImage(path=tmp_path / name, name=name, size=SIZE))
    for features in (100, 3000):
        (work := tmp_path / str(features)).mkdir()
        found.append(read_keypoints(match(images, folder=work, start=START, features=features))[1])
    few, many = ((pixels[:, 0] < 320).sum() for pixels in found)
    assert few < 50
    assert many > 500


@pytest.mark.parametrize(("max_side", "px"), [(1000, 16.0), (4000, 4.0), (8000, 4.0)])
def test_matches_may_be_off_by_four_pixels_of_the_reduced_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, max_side: int, px: float
) -> None:
    options = SimpleNamespace(ransac=SimpleNamespace())
    colmap = SimpleNamespace(
        set_random_seed=int,
        FeatureMatchingOptions=SimpleNamespace,
        TwoViewGeometryOptions=lambda: options,
        ImportedPairingOptions=SimpleNamespace,
    )
    monkeypatch.setitem(sys.modules, "pycolmap", colmap)
    monkeypatch.setattr(engine, "_begin_database", lambda *_: None)
    monkeypatch.setattr(engine, "_find_features", lambda *_: None)
    start = Intrinsics(fx=3000.0, fy=3000.0, cx=2000.0, cy=1500.0, image_size=(4000, 3000))
    engine._match(
        lambda *_: None, engine.MatchedFlight(folder=tmp_path, images=()), [], [], start, max_side, 100
    )
    assert options.ransac.max_error == px


def test_images_of_another_size_than_k_are_refused(tmp_path: Path) -> None:
    images = [FlightImage(path=tmp_path / n, name=n, size=(480, 640)) for n in ("a.jpg", "b.jpg")]
    with pytest.raises(InputError, match=r"a\.jpg: is 480×640 px, expected 640×480"):
        match(images, folder=tmp_path, start=START)


def test_what_colmap_cannot_read_is_named(tmp_path: Path) -> None:
    images = []
    for name in ("good.png", "broken.png"):
        path = tmp_path / name
        cv2.imwrite(str(path), texture(*SIZE, seed=3))
        images.append(FlightImage(path=path, name=name, size=SIZE))
    images[1].path.write_bytes(b"not an image")
    (tmp_path / "work").mkdir()
    with pytest.raises(InputError, match=r"COLMAP cannot read broken\.png"):
        match(images, folder=tmp_path / "work", start=START)
