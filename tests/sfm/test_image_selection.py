"""Which images of a flight are chosen, and what they state of where they were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from calibrary.parsers.imagery.taken import Fix, fix_of
from calibrary.records import replace
from calibrary.sfm.engine import FlightImage
from calibrary.sfm.image_selection import ALL_PAIRS, LocatedImage, overlapping_pairs, select_images
from calibrary.synthetic import Head, Position, description, packet, write_image

GREY = np.full((24, 32, 3), 99, dtype=np.uint8)


def taken(name: str, fix: Fix | None, file_bytes: int = 1000) -> LocatedImage:
    image = FlightImage(path=Path(name), name=name, size=(4000, 3000))
    return LocatedImage(image=image, fix=fix, file_bytes=file_bytes)


def strip(
    kind: str, count: int, *, up: float, pitch: float = -90.0, north: float = 47.0
) -> list[LocatedImage]:
    return [
        taken(
            f"{kind}{at:03}",
            Fix(
                latitude_deg=north + at * 2e-4, longitude_deg=8.0, altitude_m=up, pitch_deg=pitch, yaw_deg=0.0
            ),
        )
        for at in range(count)
    ]


def test_heights_and_tilts_that_differ_are_all_chosen_where_they_meet() -> None:
    images = strip("low", 200, up=500.0) + strip("high", 20, up=900.0, north=47.02)
    images += strip("oblique", 12, up=500.0, pitch=-60.0, north=47.021)
    chosen = select_images(images, 30)
    kinds = {
        name: sum(image.name.startswith(name) for image in chosen.images)
        for name in ("low", "high", "oblique")
    }
    assert len(chosen.images) == 30
    assert min(kinds.values()) >= 8
    north = np.array([image.centre_m for image in chosen.images])[:, 1]
    assert np.ptp(north) < 900
    assert "3 kinds" in chosen.how


def flown(passes: list[tuple[float, float, int]], *, bursts: int = 1) -> list[LocatedImage]:
    """Passes of 50 images, 20 m apart, over fields of strips 30 m apart: (east m, up m, heading °) of each.

    A pass with heading 90 is flown across the middle of the others. The receiver's noise is 1.5 m, in a burst 0.2 m.
    """
    random, images = np.random.default_rng(5), []
    for number, (aside, up, heading) in enumerate(passes):
        for at in range(50 // bursts):
            along = 20.0 * (at - 25 // bursts) + random.uniform(-8, 8) / bursts
            spot = np.array((along, aside) if heading % 180 else (aside, along)) + random.normal(0, 1.5, 2)
            for shot in range(bursts):
                east, north = spot + random.normal(0, 0.2, 2)
                fix = Fix(
                    latitude_deg=47 + north / 111_186,
                    longitude_deg=8 + east / 76_060,
                    altitude_m=up,
                    yaw_deg=heading,
                )
                images.append(taken(f"{number:02} {at:02} {shot}", fix))
    return images


LOW, HIGH = 580.0, 620.0
FLIGHTS = {
    "a lawnmower's strips": flown([(30.0 * at, LOW, 180 * (at % 2)) for at in range(20)]),
    "twenty times over one place": flown([(30.0 * (at % 5), LOW, 180 * (at % 2)) for at in range(20)]),
    "one place at two heights, across too": flown(
        [(30.0 * (at // 2 % 5), (LOW, HIGH)[at % 2], 90 * (at % 2)) for at in range(20)]
    ),
    "twenty times along one line": flown([(0.0, LOW, 180 * (at % 2)) for at in range(20)]),
    "bursts of ten": flown([(30.0 * (at % 20), LOW, 180 * (at % 2)) for at in range(20)], bursts=10),
    "bursts of ten over a small field": flown([(30.0 * at, LOW, 180 * at) for at in range(2)], bursts=10)
    + flown([(0.0, HIGH, 90)], bursts=10),
}


@pytest.mark.parametrize("flight", FLIGHTS)
def test_images_lie_apart_and_every_one_is_matched_with_some_beside_it(flight: str) -> None:
    chosen = select_images(FLIGHTS[flight], 30)
    places = np.array([image.centre_m for image in chosen.images])
    first, second = np.array(chosen.pairs).T
    apart = np.linalg.norm(places[first, :2] - places[second, :2], axis=1)
    # From 80 m above the ground: another view of the same ground.
    beside = (apart > 8) & (apart < 75)
    counts = np.bincount(first[beside], minlength=30) + np.bincount(second[beside], minlength=30)
    assert counts.min() >= 3
    assert connected_components(coo_matrix((beside, (first, second)), (30, 30)))[0] == 1
    assert len(np.unique(np.round(places[:, :2] / 15), axis=0)) >= 12


def test_images_of_another_kind_far_from_the_others_are_left_out() -> None:
    images = strip("low", 200, up=500.0) + strip("far", 5, up=500.0, pitch=-60.0, north=47.2)
    assert all(image.name.startswith("low") for image in select_images(images, 30).images)


def test_a_small_file_is_blurred_or_empty() -> None:
    images = strip("a", 20, up=500.0)
    images[7] = replace(images[7], file_bytes=400)
    chosen = select_images(images, 60)
    assert images[7].image.name not in {image.name for image in chosen.images}
    assert chosen.left_out == (0, 1)


def test_without_positions_the_middle_is_taken_in_order() -> None:
    chosen = select_images([taken(f"{at:03}", None) for at in range(100)], 50)
    assert [image.name for image in chosen.images] == [f"{at:03}" for at in range(25, 75)]
    assert all(0 < b - a <= 12 for a, b in chosen.pairs)
    assert len(chosen.pairs) == 50 * 12 - 12 * 13 // 2


@pytest.mark.parametrize("more", [0, 1])
def test_of_a_few_images_all_pairs_are_matched_and_of_one_more_the_neighbours(more: int) -> None:
    images = [
        FlightImage(path=Path("a"), name="a", size=(4000, 3000), centre_m=(40.0 * at, 0.0, 80.0))
        for at in range(ALL_PAIRS + more)
    ]
    pairs = overlapping_pairs(images)
    assert ((0, len(images) - 1) in pairs) is (more == 0)


def test_neighbours_are_matched() -> None:
    images = select_images(strip("a", 40, up=500.0), 40).images
    pairs = overlapping_pairs(images)
    assert all(a < b for a, b in pairs)
    assert {(at, at + 1) for at in range(39)} <= set(pairs)
    assert len(pairs) < 40 * 12


def test_a_position_is_read_with_its_standard_deviation(tmp_path: Path) -> None:
    said = {"RtkStdLon": "0.011", "RtkStdLat": "0.031", "RtkStdHgt": "0.05", "GimbalPitchDegree": "-59.90"}
    head = Head(
        exif={"Make": "DJI"},
        position=Position(latitude_deg=-33.25, longitude_deg=151.5, altitude_m=-4.25),
        xmp=packet(
            [description(about="", attributes={f"drone-dji:{name}": text for name, text in said.items()})]
        ),
    )
    fix = fix_of(write_image(tmp_path / "a.jpg", GREY, head))
    assert fix is not None
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((-33.25, 151.5), abs=1e-8)
    assert (fix.altitude_m, fix.std_m, fix.pitch_deg) == (-4.25, (0.02, 0.031, 0.05), -59.9)


@pytest.mark.parametrize("north", [0.0, 91.0])
def test_no_position_is_none(tmp_path: Path, north: float) -> None:
    place = Position(latitude_deg=north, longitude_deg=0.0, altitude_m=0.0)
    assert fix_of(write_image(tmp_path / "a.jpg", GREY, Head(position=place))) is None
    assert fix_of(write_image(tmp_path / "b.jpg", GREY, Head())) is None
