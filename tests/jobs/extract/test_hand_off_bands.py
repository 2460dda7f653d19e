"""The bands of a multispectral camera on their way to ODM, against what ODM's own code answered.

``BANDS`` and ``NAMES`` are the answers of ODM at 32cfaacf (``ODM_Photo.camera_id`` of opendm/photo.py,
``ODM_Reconstruction`` of opendm/types.py and ``get_primary_band_name`` of opendm/multispectral.py) for images with
these tags.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.calibration import Calibration
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata, XmpProperty
from calibrary.jobs.export.opensfm_names import odm_name, odm_names, opensfm_names
from calibrary.jobs.extract.hand_off import HandOff, hand_off
from calibrary.jobs.extract.targets import Candidate
from calibrary.validation import Use
from tests.jobs.extract.handed import BROWN, calibrated, candidate

BANDS = {
    "MicaSense RedEdge-M": (("Blue", "Green", "Red", "NIR", "Red edge"), "Green"),
    "MicaSense Altum": (("Blue", "Green", "Red", "NIR", "Red edge", "LWIR"), "Green"),
    "MicaSense Altum-PT": (("Blue", "Green", "Red", "NIR", "Red edge", "Panchro", "LWIR"), "Green"),
    "Parrot Sequoia": (("Green", "Red", "Red edge", "NIR"), "Green"),
    "DJI FC6360": (("Blue", "Green", "Red", "RedEdge", "NIR"), "Green"),
    "MicaSense RedEdge": (("Blue", "NIR"), "Blue"),
}
"""ODM's primary band by camera, of these bands."""

NAMES = (
    ("Parrot", "Sequoia", (4608, 3456), 28.0, "perspective", "parrot sequoia 4608 3456 perspective 0.7777"),
    ("DJI", "FC300S", (4000, 2250), 20.0, None, "dji fc300s 4000 2250 brown 0.5555"),
    ("DJI", "H30T", (1280, 1024), 52.0, None, "dji h30t 1280 1024 brown 1.4444"),
    ("Sony", "HDR-AS300", (3840, 2160), None, None, "sony hdr-as300 3840 2160 brown 0.85"),
    ("GoPro", "HERO6 Black", (8, 8), 15.0, None, "gopro hero6 black 8 8 brown 0.4166"),
    (None, None, (16, 16), None, None, "  16 16 brown 0.85"),
)

OPENSFM = (
    ("DJI", "FC6310R", (5472, 3648), 8.8, 24.0, "dji fc6310r 5472 3648 perspective 0.6666"),
    ("DJI", "FC300S", (4000, 2250), 3.61, None, "dji fc300s 4000 2250 perspective 0.5860"),
    ("DJI", "XT2", (640, 512), 19.0, None, "dji xt2 640 512 perspective 1.7463"),
    ("DJI", "ZenmuseP1", (8192, 5460), 35.0, None, "dji zenmusep1 8192 5460 perspective 0.9749"),
    ("GoPro", "HERO4 Black", (4000, 3000), 2.77, None, "gopro hero4 black 4000 3000 perspective 0.4489"),
    (
        "senseFly",
        "senseFly S.O.D.A.",
        (5472, 3648),
        10.6,
        29.0,
        "sensefly s.o.d.a. 5472 3648 perspective 0.8055",
    ),
    ("Parrot", "Sequoia", (1280, 960), 3.98, None, "parrot sequoia 1280 960 perspective 0.0"),
    (None, None, (16, 16), None, None, "unknown unknown 16 16 perspective 0.0"),
)
"""What ``compute_focal`` and ``camera_id_`` of OpenSfM at 238744cd (opensfm/exif.py) answered."""


@pytest.mark.parametrize(("make", "model", "size", "focal", "mm", "name"), OPENSFM)
def test_a_camera_has_the_name_that_opensfm_gives_it(
    make: str | None,
    model: str | None,
    size: tuple[int, int],
    focal: float | None,
    mm: float | None,
    name: str,
) -> None:
    metadata = ImageMetadata(size=size, make=make, model=model, focal_mm=focal, focal_35mm=mm)
    assert name in opensfm_names([metadata])


def band(
    name: str, *, camera: str = "MicaSense RedEdge-M", K: Calibration | None = None, unit: str | None = None
) -> Candidate:
    """A band of a camera, with its own K."""
    make, _, model = camera.partition(" ")
    xmp = (XmpProperty("Camera", "BandName", tuple(name.split())),)
    told = ImageMetadata(make=make, model=model, size=(1280, 960), xmp=xmp, serial=unit)
    return Candidate(
        slug=f"{model}-{name}-{unit}",
        calibration=K,
        states=(told,),
        names=(f"IMG_0001_{name}.tif",),
    )


def task(tmp_path: Path, *cameras: Candidate) -> HandOff:
    """The plan of a task with an image of each camera."""
    for name in (name for one in cameras for name in one.names):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return hand_off("odm", cameras, root=tmp_path, folder=tmp_path, task=tmp_path / "task")


def places(plan: HandOff) -> dict[str, list[str]]:
    """The cameras in each folder."""
    found: dict[str, list[str]] = {}
    for one in plan.cameras:
        found.setdefault(one.into or "", []).append(one.camera)
    return found


@pytest.mark.parametrize(("make", "model", "size", "mm", "kind", "name"), NAMES)
def test_a_camera_has_the_name_that_odm_gives_it(
    make: str | None, model: str | None, size: tuple[int, int], mm: float | None, kind: str | None, name: str
) -> None:
    xmp = (XmpProperty("Camera", "ModelType", (kind,)),) if kind is not None else ()
    metadata = ImageMetadata(size=size, make=make, model=model, focal_35mm=mm, xmp=xmp)
    assert odm_name(metadata) == name
    assert name in odm_names([metadata])


def test_a_camera_without_an_equivalent_focal_length_has_the_name_of_its_focal_plane() -> None:
    metadata = ImageMetadata(
        size=(1280, 960),
        make="MicaSense",
        model="RedEdge",
        focal_mm=5.5,
        focal_plane_resolution=(266.666667, 266.666667),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
    )
    assert odm_name(metadata) == "micasense rededge 1280 960 brown 1.1458"


@pytest.mark.parametrize("camera", BANDS)
def test_the_bands_are_one_task_with_the_k_of_the_band_that_odm_places(tmp_path: Path, camera: str) -> None:
    bands, primary = BANDS[camera]
    plan = task(tmp_path, *(band(name, camera=camera, K=calibrated(BROWN)) for name in bands))
    assert [*places(plan)] == [str(tmp_path / "task/images")]
    assert [one.camera.split("-")[-2] for one in plan.cameras if one.use is Use.START] == [primary]
    assert f"--primary-band {primary} ".encode() in plan.files[tmp_path / "task/odm.sh"]
    assert len(plan.images) == len(bands)


def test_a_band_without_a_k_is_in_and_the_primary_is_one_with_a_k(tmp_path: Path) -> None:
    plan = task(tmp_path, band("Green"), band("NIR", K=calibrated(BROWN)))
    assert [(one.use, one.into is not None) for one in plan.cameras] == [(Use.NONE, True), (Use.START, True)]
    assert b"--primary-band NIR" in plan.files[tmp_path / "task/odm.sh"]


def test_bands_of_which_none_has_a_k_stay_out(tmp_path: Path) -> None:
    plan = task(tmp_path, band("Green"), band("NIR"), candidate(calibrated(BROWN)))
    assert [one.into is None for one in plan.cameras] == [True, True, False]


def test_a_colour_camera_is_apart_for_odm_would_drop_one_of_the_two(tmp_path: Path) -> None:
    head = [band(name, camera="Parrot Sequoia", K=calibrated(BROWN)) for name in ("Green", "NIR")]
    colour = band("Red Green Blue", camera="Parrot Sequoia", K=calibrated(BROWN))
    plan = task(tmp_path, *head, colour)
    assert sorted(len(cameras) for cameras in places(plan).values()) == [1, 2]


def test_two_multispectral_cameras_are_two_tasks(tmp_path: Path) -> None:
    bands = [band(name, K=calibrated(BROWN), unit=unit) for unit in "AB" for name in ("Green", "NIR")]
    found = places(task(tmp_path, *bands))
    assert [{name[-1] for name in cameras} for cameras in found.values()] == [{"A"}, {"B"}]


def test_a_pair_of_one_name_takes_only_these_two_apart(tmp_path: Path) -> None:
    twins = [candidate(calibrated(BROWN), slug=name) for name in ("one", "two")]
    others = [candidate(calibrated(BROWN), slug=f"other{i}", model=f"Other {i}") for i in range(5)]
    cameras = [
        Candidate(slug=one.slug, calibration=one.calibration, states=one.states, names=(f"{one.slug}/a.jpg",))
        for one in (*twins, *others)
    ]
    found = places(task(tmp_path, *cameras))
    assert sorted(found.values()) == [["one"], [f"other{i}" for i in range(5)], ["two"]]


def test_images_without_a_k_stay_out_of_a_task_and_take_nothing_apart(tmp_path: Path) -> None:
    plan = task(tmp_path, candidate(calibrated(BROWN)), band("RGB"), candidate(None, slug="zoomed"))
    assert [one.into is None for one in plan.cameras] == [False, True, True]
    assert tmp_path / "task/cameras.json" in plan.files
