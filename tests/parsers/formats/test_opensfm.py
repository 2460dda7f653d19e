"""OpenSfM's and ODM's cameras, against OpenSfM's own formulas written down here once more."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, Fisheye624, KannalaBrandt, NoDistortion
from calibrary.errors import MissingTagError, ParseError, UnsupportedModelError
from calibrary.parsers.format import Fidelity
from calibrary.parsers.opensfm_models import PROJECTIONS, opensfm_camera
from calibrary.records import replace
from tests.parsers.cameras import BROWN, SIZE, camera

Array = NDArray[np.float64]
Camera = dict[str, Any]  # JSON as OpenSfM has it

NAME = "dji fc6310 5472 3648 brown 0.6666"
FREE = {"focal_x": 0.6671, "focal_y": 0.6669, "c_x": 0.0013, "c_y": -0.0021}
K4 = {"k1": -0.0131, "k2": 0.0247, "k3": -0.0062, "k4": 0.0011}
BROWN_CAMERA: Camera = {
    "projection_type": "brown", "width": 5472, "height": 3648, **FREE,
    "k1": -0.0131, "k2": 0.0247, "p1": -0.00037, "p2": 0.00081, "k3": -0.0062,
}  # fmt: skip
EVERY: dict[str, Camera] = {
    "perspective": {"focal": 0.6671, "k1": -0.0131, "k2": 0.0247},
    "simple_radial": {**FREE, "k1": -0.0131},
    "radial": {**FREE, "k1": -0.0131, "k2": 0.0247},
    "brown": BROWN_CAMERA,
    "fisheye": {"focal": 0.6671, "k1": -0.0131, "k2": 0.0247},
    "fisheye_opencv": {**FREE, **K4},
    "fisheye62": {**FREE, **K4, "k5": 0.0002, "k6": -0.0001, "p1": -0.00037, "p2": 0.00081},
    "fisheye624": {
        **FREE, **K4, "k5": 0.0002, "k6": -0.0001, "p1": -0.00037, "p2": 0.00081,
        "s0": 0.0012, "s1": -0.0002, "s2": -0.0007, "s3": 0.0001,
    },
}  # fmt: skip


def of_type(projection: str, **changes: object) -> Camera:
    return {"projection_type": projection, "width": 5472, "height": 3648, **EVERY[projection], **changes}


def models(camera: Camera, name: str = f"v2 {NAME}") -> bytes:
    return json.dumps({name: camera}).encode()


def read(data: bytes, name: str = "camera_models.json") -> Calibration:
    [calibration] = parsers.decode(data, name=name)
    return calibration


def rays() -> Array:
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.48, 0.48, 25))
    return np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])


def opensfm(camera: Camera, points: Array) -> Array:
    """camera_projections_functions.h, camera_distortions_functions.h and features.denormalized_image_coordinates.

    In px from the outer corner of the top-left pixel; OpenSfM counts from its centre.
    """
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if camera["projection_type"].startswith("fisheye"):
        r = np.hypot(points[:, 0], points[:, 1])
        theta = np.arctan2(r, points[:, 2])
        scale = np.divide(theta, r, out=np.zeros_like(r), where=r > 0)
        x, y = points[:, 0] * scale, points[:, 1] * scale
    c = {
        key: camera.get(key, 0.0)
        for key in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s0", "s1", "s2", "s3")
    }
    r2 = x**2 + y**2
    radial = 1 + sum(c[f"k{i}"] * r2**i for i in range(1, 7))
    dx = 2 * c["p1"] * x * y + c["p2"] * (r2 + 2 * x**2) + c["s0"] * r2 + c["s1"] * r2**2
    dy = 2 * c["p2"] * x * y + c["p1"] * (r2 + 2 * y**2) + c["s2"] * r2 + c["s3"] * r2**2
    u = camera.get("focal_x", camera.get("focal")) * (x * radial + dx) + camera.get("c_x", 0.0)
    v = camera.get("focal_y", camera.get("focal")) * (y * radial + dy) + camera.get("c_y", 0.0)
    width, height = camera["width"], camera["height"]
    size = max(width, height)
    pixel_centres = np.stack([u * size - 0.5 + width / 2, v * size - 0.5 + height / 2], axis=1)
    return np.asarray(pixel_centres + 0.5)


@pytest.mark.parametrize("projection", EVERY)
@pytest.mark.parametrize("size", [(5472, 3648), (3000, 4000)], ids=["landscape", "portrait"])
def test_a_camera_projects_by_opensfms_own_formula(projection: str, size: tuple[int, int]) -> None:
    source = of_type(projection, width=size[0], height=size[1])
    calibration = read(models(source))
    seen = calibration.project(rays())
    np.testing.assert_allclose(seen, opensfm(source, rays()), rtol=0, atol=1e-9)
    np.testing.assert_allclose(calibration.project(calibration.unproject(seen)), seen, rtol=0, atol=1e-9)


def test_every_type_with_a_k_is_tried_above() -> None:
    assert [item.name for item in PROJECTIONS] == list(EVERY)


@pytest.mark.parametrize("projection", EVERY)
def test_a_type_goes_back_as_it_came(projection: str) -> None:
    source = models(of_type(projection))
    data, verdict = parsers.encode([read(source)], "opensfm", name="camera_models.json")
    assert str(verdict) == "exact (0.000 px)"
    [(name, copy)] = json.loads(data).items()
    assert name == f"v2 {NAME}"
    original = of_type(projection)
    assert copy.keys() == original.keys()
    for key, value in original.items():
        assert copy[key] == (
            pytest.approx(value, rel=1e-12, abs=1e-15) if isinstance(value, float) else value
        )


@pytest.mark.parametrize("projection", ["dual", "spherical", "equirectangular", "fisheye_of_tomorrow"])
def test_a_type_without_a_counterpart_is_refused_by_name(projection: str) -> None:
    with pytest.raises(UnsupportedModelError, match=projection):
        read(models({"projection_type": projection, "width": 8, "height": 4, "focal": 1, "transition": 0.5}))


def test_among_other_cameras_one_without_a_counterpart_is_left_out_with_a_note() -> None:
    data = json.dumps({"v2 a": of_type("brown"), "v2 b": {"projection_type": "spherical"}}).encode()
    calibration = read(data)
    assert calibration.camera.sub_camera == "a"
    assert "'v2 b' is spherical" in calibration.notes[0]


@pytest.mark.parametrize(
    ("name", "format_name"),
    [(f"v2 {NAME}", "opensfm"), (NAME, "odm_cameras"), ("all", "opensfm"), ("a b c d e", "opensfm")],
)
def test_odm_is_told_from_opensfm_by_the_names(name: str, format_name: str) -> None:
    data = models(BROWN_CAMERA, name)
    original = read(data)
    again, verdict = parsers.encode([original], format_name, name="cameras.json")
    assert str(verdict) == "exact (0.000 px)"
    assert read(again, "cameras.json") == replace(original, provenance=read(again, "cameras.json").provenance)
    assert list(json.loads(again)) == [name]


def test_odm_takes_off_opensfms_mark_and_opensfm_puts_it_back() -> None:
    from_opensfm = read(models(BROWN_CAMERA))
    data, verdict = parsers.encode([from_opensfm], "odm_cameras")
    assert list(json.loads(data)) == [NAME]
    assert str(verdict) == "exact (0.000 px)"
    data, verdict = parsers.encode([read(data)], "opensfm")
    assert list(json.loads(data)) == [f"v2 {NAME}"]
    assert str(verdict) == "exact (0.000 px)"


def test_without_a_name_of_its_own_a_camera_gets_one_that_the_program_takes() -> None:
    named = replace(camera(BROWN), camera=replace(camera().camera, make="DJI", model="FC6310"))
    assert list(json.loads(parsers.encode([named], "opensfm")[0])) == ["all"]
    assert list(json.loads(parsers.encode([named], "odm_cameras")[0])) == ["dji fc6310 5472 3648 brown 0.0"]


@pytest.mark.parametrize("format_name", ["opensfm", "odm_cameras"])
def test_cameras_of_one_name_are_numbered_and_none_is_lost(format_name: str) -> None:
    names = ("a #2", "a", "a", "a")
    items = [replace(camera(BROWN), camera=replace(camera().camera, sub_camera=name)) for name in names]
    data, verdict = parsers.encode(items, format_name)
    assert len(json.loads(data)) == len(verdict.fits) == 4


def test_odm_would_drop_a_fourth_fisheye_coefficient_so_none_is_written() -> None:
    fisheye = camera(KannalaBrandt(k1=0.03, k2=-0.007, k3=0.004, k4=-0.001))
    with pytest.raises(UnsupportedModelError, match="kannala-brandt"):
        parsers.encode([fisheye], "odm_cameras")


@pytest.mark.parametrize(
    ("lens", "projection"),
    [
        (None, "brown"),
        (NoDistortion(), "brown"),
        (BROWN, "brown"),
        (KannalaBrandt(k1=0.1, k2=0.02, k3=0.003, k4=0.0004), "fisheye_opencv"),
        (Fisheye624(k1=0.1, k2=0, k3=0, k4=0, k5=0, k6=0, p1=1e-3, p2=0), "fisheye62"),
        (Fisheye624(k1=0.1, k2=0, k3=0, k4=0, k5=0, k6=0, p1=1e-3, p2=0, s1=1e-3), "fisheye624"),
    ],
    ids=repr,
)
def test_a_lens_goes_to_the_type_that_holds_it(
    lens: BrownConrady | KannalaBrandt | Fisheye624 | None, projection: str
) -> None:
    written = opensfm_camera(camera(lens))
    assert written["projection_type"] == projection
    expected = camera(lens).project(rays())
    np.testing.assert_allclose(opensfm(dict(written), rays()), expected, rtol=0, atol=1e-9)


def test_skew_has_no_place() -> None:
    with pytest.raises(UnsupportedModelError, match="skew"):
        opensfm_camera(camera(skew=0.3))


def test_a_plain_camera_that_was_moved_off_centre_becomes_one_that_may_be() -> None:
    plain = read(models(of_type("perspective")))
    moved = replace(plain, intrinsics=replace(plain.intrinsics, cx=2741.3))
    data, verdict = parsers.encode([moved], "opensfm")
    assert next(iter(json.loads(data).values()))["projection_type"] == "brown"
    assert verdict.outcome is Fidelity.EXACT


def test_what_only_exif_said_is_a_prior() -> None:
    start = {
        "projection_type": "perspective",
        "width": 4000,
        "height": 3000,
        "focal": 0.97222222,
        "k1": 0.0,
        "k2": 0.0,
    }
    assert read(models(start, "v2 acme x 4000 3000 perspective 0.9722")).grade is Grade.PRIOR
    assert read(models(start, "v2 acme x 4000 3000 perspective 0.85")).grade is Grade.ADJUSTED
    bent = {**start, "k1": 0.01}
    assert read(models(bent, "v2 acme x 4000 3000 perspective 0.9722")).grade is Grade.ADJUSTED


def reconstruction(*parts: dict[str, Camera], shots: dict[str, object] | None = None) -> bytes:
    return json.dumps([{"cameras": part, "shots": shots or {}, "points": {}} for part in parts]).encode()


def test_a_reconstruction_gives_every_camera_and_how_many_images_it_took() -> None:
    shots = {f"{i}.jpg": {"camera": "v2 left" if i else "v2 right"} for i in range(3)}
    data = reconstruction(
        {"v2 left": of_type("brown"), "v2 right": of_type("perspective")}, shots=dict(shots)
    )
    left, right = parsers.decode(data, name="reconstruction.json")
    assert (left.camera.sub_camera, right.camera.sub_camera) == ("left", "right")
    assert left.quality is not None
    assert left.quality.views == 2
    assert {left.grade, right.grade} == {Grade.ADJUSTED}


def test_cameras_of_several_reconstructions_are_given_once_unless_they_differ() -> None:
    one, other = of_type("brown"), of_type("brown", k1=-0.0135)
    found = parsers.decode(reconstruction({"v2 a": one}, {"v2 a": one}, {"v2 a": other}), name="r.json")
    assert [item.camera.sub_camera for item in found] == ["a", "a (reconstruction 3)"]


def test_a_file_called_reconstruction_is_written_as_one() -> None:
    data, verdict = parsers.encode([read(models(BROWN_CAMERA))], "opensfm", name="reconstruction.json")
    [written] = json.loads(data)
    assert written["shots"] == {}
    assert list(written["cameras"]) == [f"v2 {NAME}"]
    assert str(verdict) == "exact (0.000 px)"
    assert read(data).intrinsics == read(models(BROWN_CAMERA)).intrinsics


def test_what_opensfm_does_not_look_at_is_kept_and_pointed_out() -> None:
    calibration = read(models(of_type("perspective", c_x=0.01, k1_prior=0.0, id="x")))
    assert calibration.intrinsics.cx == 2736
    assert "c_x" in calibration.notes[0]
    again = json.loads(parsers.encode([calibration], "opensfm")[0])[f"v2 {NAME}"]
    assert (again["c_x"], again["k1_prior"], again["id"]) == (0.01, 0.0, "x")


@pytest.mark.parametrize(
    ("size", "error"), [({"width": None}, MissingTagError), ({"width": 0, "height": 0}, ParseError)]
)
def test_a_camera_without_a_size_asks_for_it(size: dict[str, int | None], error: type[Exception]) -> None:
    source = {
        key: value for key, value in {**BROWN_CAMERA, "height": None, **size}.items() if value is not None
    }
    with pytest.raises(error, match="--image-size"):
        read(models(source))
    [item] = parsers.decode(models(source), name="x.json", image_size=SIZE)
    assert item.intrinsics.fx == 0.6671 * 5472


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"focal_x": "0,66"}, "decimal point"),
        ({"focal_x": 0}, "focal lengths"),
        ({"k1": None}, "expected a number"),
        ({"c_x": [1]}, "expected a number"),
        ({"width": 5472.5}, "image size"),
        ({"height": -1}, "image size"),
    ],
)
def test_a_broken_camera_names_what_is_wrong(changes: Camera, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(models({**BROWN_CAMERA, **changes}))


def test_a_camera_without_a_focal_length_is_refused() -> None:
    with pytest.raises(ParseError, match="'focal_y'"):
        read(models({key: value for key, value in BROWN_CAMERA.items() if key != "focal_y"}))
