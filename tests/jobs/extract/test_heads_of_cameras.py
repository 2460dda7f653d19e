"""Heads as many kinds of cameras write them, and what editors leave of them, each judged by itself.

``heads_of_cameras.csv`` holds one image a row, with fx by the published width of its sensor. Rows whose truth
no tag can tell are not in it: a crop that keeps the proportions and whose program rewrote EXIF's size looks
like a smaller image of the whole frame.
"""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.jobs.extract.cameras import Camera, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.policy import FLEET
from calibrary.validation import Verdict

HEADS = Path(__file__).with_name("heads_of_cameras.csv")
UNITS = {"2": FocalPlaneUnit.INCH, "3": FocalPlaneUnit.CENTIMETRE, "4": FocalPlaneUnit.MILLIMETRE}
KNOWLEDGE = Knowledge.load(None)
Judged = tuple[str, Camera, float | None]


def only(metadata: ImageMetadata) -> Camera:
    """The one camera of an image, by the catalogue that ships."""
    [camera] = (
        camera
        for key, states in group_cameras(undated({metadata: ["a.jpg"]}), KNOWLEDGE).items()
        for camera in judge(key, states, policy=FLEET)
    )
    return camera


def off(camera: Camera, fx: float) -> float | None:
    """How far its K is from the truth, as a share."""
    return abs(camera.calibration.intrinsics.fx / fx - 1.0) if camera.calibration is not None else None


def head(row: dict[str, str]) -> ImageMetadata:
    """A row as what an image says."""
    numbers = {name: float(row[name]) for name in ("focal_mm", "focal_35mm", "digital_zoom") if row[name]}
    plane = (float(row["fp_x_res"]), float(row["fp_y_res"])) if row["fp_x_res"] else None
    return ImageMetadata(
        size=(int(row["file_w"]), int(row["file_h"])),
        exif_size=(int(row["exif_w"]), int(row["exif_h"])),
        make=row["make"],
        model=row["model"],
        focal_plane_resolution=plane,
        focal_plane_unit=UNITS.get(row["fp_unit"]),
        has_exif=True,
        **numbers,  # type: ignore[arg-type]  # names of numbers
    )


@pytest.fixture(scope="module")
def found() -> list[Judged]:
    with HEADS.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    outcomes = []
    for row in rows:
        camera = only(head(row))
        name = "{make} {model} {file_w}x{file_h} f {focal_mm} ({focal_35mm}) {note}".format_map(row)
        outcomes.append(
            (f"{name}: {camera.verdict.value}, {camera.reason}", camera, off(camera, float(row["fx"])))
        )
    return outcomes


def test_no_valid_k_is_more_than_3_per_cent_wrong(found: list[Judged]) -> None:
    assert [name for name, camera, by in found if camera.verdict is Verdict.VALID and by and by > 0.03] == []


def test_no_unproven_k_is_more_than_10_per_cent_wrong(found: list[Judged]) -> None:
    assert [
        name for name, camera, by in found if camera.verdict is Verdict.UNPROVEN and by and by > 0.10
    ] == []


def test_at_most_5_per_cent_of_right_ks_are_rejected(found: list[Judged]) -> None:
    right = [(name, camera) for name, camera, by in found if by is not None and by <= 0.10]
    rejected = [name for name, camera in right if camera.verdict is Verdict.REJECTED]
    assert len(rejected) <= 0.05 * len(right), "\n".join(rejected)


def test_most_of_them_are_decided(found: list[Judged]) -> None:
    verdicts = Counter(camera.verdict for _, camera, _ in found)
    assert verdicts[Verdict.VALID] > 0.5 * len(found)


D7000: dict[str, Any] = {
    "make": "NIKON CORPORATION",
    "model": "NIKON D7000",
    "focal_mm": 35.0,
    "has_exif": True,
}


@pytest.mark.parametrize("equivalent", [None, 52.0])
@pytest.mark.parametrize(
    "tags",
    [
        {"exif_size": (4928, 3264)},
        {
            "exif_size": (4000, 2650),
            "focal_plane_resolution": (208.8, 208.8),
            "focal_plane_unit": FocalPlaneUnit.MILLIMETRE,
        },
    ],
    ids=["EXIF keeps the size", "the focal plane is of another width"],
)
def test_a_sign_of_resizing_is_never_settled_by_sources_that_cannot_see_a_crop(
    tags: dict[str, Any], equivalent: float | None
) -> None:
    """The listed width and the equivalent describe the whole frame, and this one was cut out of it."""
    camera = only(ImageMetadata(size=(4000, 2650), focal_35mm=equivalent, **D7000, **tags))
    assert camera.verdict is Verdict.UNPROVEN
    assert camera.calibration is not None
    assert "the image was resized, not cropped" in camera.calibration.provenance.assumptions


@pytest.mark.parametrize("size", [(4264, 3264), (4080, 3264), (3264, 3264), (3264, 4264)])
def test_a_frame_narrower_than_the_sensor_had_its_width_cut(size: tuple[int, int]) -> None:
    """Nikon's 5:4, everybody's squares, and an editor's 4:3, out of 3:2."""
    camera = only(ImageMetadata(size=size, exif_size=size, **D7000))
    assert camera.calibration is not None
    assert off(camera, 35 / 23.6 * 4928) == pytest.approx(0, abs=0.01)
    assert "of its 23.6 mm" in camera.calibration.provenance.assumptions[0]


@pytest.mark.parametrize(
    ("model", "size", "equivalent", "pitch_um"),
    [("ILCE-7RM4", (6240, 4160), 36.0, 3.76), ("ILCE-7M2", (3936, 2624), 36.0, 5.97)],
)
def test_the_aps_c_mode_of_a_full_frame_body_is_a_part_of_its_sensor(
    model: str, size: tuple[int, int], equivalent: float, pitch_um: float
) -> None:
    tags: dict[str, Any] = {"make": "SONY", "model": model, "focal_mm": 24.0, "has_exif": True}
    part = only(ImageMetadata(size=size, exif_size=size, focal_35mm=equivalent, **tags))
    assert part.verdict is Verdict.VALID
    assert off(part, 24000 / pitch_um) == pytest.approx(0, abs=0.01)
    whole = only(ImageMetadata(size=size, exif_size=size, focal_35mm=24.0, **tags))
    assert whole.verdict is Verdict.VALID
    assert off(whole, 24 / 35.7 * size[0]) == pytest.approx(0, abs=0.01)


def test_a_nonsense_focal_length_is_not_confirmed_by_two_statements_of_the_sensors_size() -> None:
    tags: dict[str, Any] = {
        "focal_plane_resolution": (208.8, 208.8),
        "focal_plane_unit": FocalPlaneUnit.MILLIMETRE,
    }
    camera = only(ImageMetadata(size=(4928, 3264), **(D7000 | tags | {"focal_mm": 1.0})))
    assert camera.verdict is Verdict.REJECTED
    assert "of any lens" in str(camera.reason)


def test_a_focal_plane_in_another_unit_is_no_sensor() -> None:
    tags: dict[str, Any] = {
        "focal_plane_resolution": (2088.0, 2088.0),
        "focal_plane_unit": FocalPlaneUnit.INCH,
    }
    camera = only(
        ImageMetadata(size=(4928, 3264), make="Acme", model="Nine", focal_mm=35.0, has_exif=True, **tags)
    )
    assert "another unit" in camera.evidence.dropped[0].reason


def test_an_assumed_sensor_that_the_equivalent_confirms_is_unproven_outside_the_band() -> None:
    tags: dict[str, Any] = {"make": "Acme", "model": "One Inch", "focal_mm": 8.8, "focal_35mm": 24.0}
    camera = only(ImageMetadata(size=(5472, 3648), has_exif=True, **tags))
    assert camera.verdict is Verdict.UNPROVEN
    assert off(camera, 8.8 / 13.2 * 5472) == pytest.approx(0)
