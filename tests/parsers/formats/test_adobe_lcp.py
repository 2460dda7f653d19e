"""Adobe's profiles: the formulas of its technical report, written down here once more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.errors import InputError, MissingTagError
from tests.parsers.samples import Sample

SIZE = (5472, 3648)
CAMERA = {
    "Make": "DJI",
    "Model": "FC9310",
    "LensPrettyName": "8.8 mm f/2.8",
    "ImageWidth": "5472",
    "ImageLength": "3648",
    "SensorFormatFactor": "2.73",
    "FocalLength": "8.8",
    "FocusDistance": "1000",
    "ApertureValue": "6",
}
LENS = {
    "Version": "2",
    "FocalLengthX": "0.6712",
    "FocalLengthY": "0.6698",
    "ImageXCenter": "0.5013",
    "ImageYCenter": "0.4978",
    "RadialDistortParam1": "-0.0211",
    "RadialDistortParam2": "0.0173",
    "RadialDistortParam3": "-0.0062",
    "TangentialDistortParam1": "0.0008",
    "TangentialDistortParam2": "-0.0003",
}
OF_COLOUR = '<stCamera:ChromaticGreenModel stCamera:ScaleFactor="1.002" stCamera:RadialDistortParam1="0.5"/>'


def attributes(values: dict[str, str]) -> str:
    return " ".join(f'stCamera:{name}="{text}"' for name, text in values.items())


def elements(values: dict[str, str]) -> str:
    return "".join(f"<stCamera:{name}>{text}</stCamera:{name}>" for name, text in values.items())


def profile(
    camera: dict[str, str] = CAMERA, lens: dict[str, str] = LENS, kind: str = "PerspectiveModel"
) -> str:
    model = f"<stCamera:{kind} {attributes(lens)}>{OF_COLOUR}</stCamera:{kind}>"
    return f"<rdf:li><rdf:Description {attributes(camera)}>{model}</rdf:Description></rdf:li>"


def by_elements(camera: dict[str, str] = CAMERA, lens: dict[str, str] = LENS) -> str:
    inner = f"<rdf:Description>{elements(lens)}{OF_COLOUR}</rdf:Description>"
    model = f"<stCamera:PerspectiveModel>{inner}</stCamera:PerspectiveModel>"
    return f'<rdf:li rdf:parseType="Resource">{elements(camera)}{model}</rdf:li>'


def packet(*profiles: str) -> bytes:
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:photoshop="http://ns.adobe.com/photoshop/1.0/" '
        'xmlns:stCamera="http://ns.adobe.com/photoshop/1.0/camera-profile"><photoshop:CameraProfiles><rdf:Seq>'
        f"{''.join(profiles)}</rdf:Seq></photoshop:CameraProfiles></rdf:Description></rdf:RDF></x:xmpmeta>"
    ).encode()


def read(*profiles: str, size: tuple[int, int] | None = None) -> Sequence[Calibration]:
    return parsers.decode(packet(*profiles), name="lens.lcp", image_size=size)


SAMPLES = {"adobe_lcp": Sample(packet(profile()))}


@pytest.mark.parametrize("written", [profile, by_elements])
def test_a_perspective_lens_projects_by_the_reports_formula(written: object) -> None:
    [item] = read(profile() if written is profile else by_elements())
    x, y = np.linspace(-0.6, 0.6, 25), np.linspace(0.4, -0.4, 25) ** 2 - 0.1
    r2 = x**2 + y**2
    common = 1 - 0.0211 * r2 + 0.0173 * r2**2 - 0.0062 * r2**3 + 2 * (0.0008 * y - 0.0003 * x)
    seen = np.column_stack(
        [
            0.6712 * 5472 * (x * common - 0.0003 * r2) + 0.5013 * 5472,
            0.6698 * 5472 * (y * common + 0.0008 * r2) + 0.4978 * 3648,
        ]
    )
    rays = np.column_stack([x, y, np.ones_like(x)])
    np.testing.assert_allclose(item.project(rays), seen, rtol=0, atol=1e-9)


def test_a_fisheye_projects_by_the_reports_formula() -> None:
    lens = {
        "FocalLengthX": "0.45",
        "FocalLengthY": "0.45",
        "RadialDistortParam1": "-0.03",
        "RadialDistortParam2": "0.004",
    }
    [item] = read(profile(lens=lens, kind="FisheyeModel"))
    angle = np.linspace(0.05, 1.3, 9)
    seen = 0.45 * 5472 * (angle - 0.03 * angle**3 + 0.004 * angle**5)
    rays = np.column_stack([0 * angle, np.sin(angle), np.cos(angle)])
    np.testing.assert_allclose(item.project(rays)[:, 1], seen + 1824, rtol=0, atol=1e-9)


def test_without_a_focal_length_of_its_own_it_is_the_nominal_one_times_the_scale() -> None:
    lens = {"Version": "2", "ScaleFactor": "1.027391", "RadialDistortParam1": "-0.127336"}
    camera = CAMERA | {"FocalLength": "24", "SensorFormatFactor": "1"}
    [item] = read(profile(camera, lens))
    assert item.intrinsics.fx == pytest.approx(24 / 36 * 5472 * 1.027391)
    assert (item.intrinsics.cx, item.intrinsics.cy) == (2736, 1824)
    assert any("nominal" in text for text in item.provenance.assumptions)


def test_it_is_a_prior_of_the_camera_and_the_lens_that_it_names() -> None:
    [item] = read(profile())
    assert item.grade is Grade.PRIOR
    assert str(item.camera) == "DJI FC9310 8.8 mm f/2.8 8.8 mm 5472×3648"
    assert item.provenance.focus == "1000 m"
    assert any("never the calibration of one camera" in note for note in item.notes)


def test_each_focus_and_aperture_is_told_apart() -> None:
    near = profile(CAMERA | {"FocusDistance": "3"})
    vignetting = profile(lens={"Version": "2"})
    assert [item.camera.sub_camera for item in read(profile(), near, vignetting)] == [
        "focus 1000, aperture value 6",
        "focus 3, aperture value 6",
    ]


def test_a_centre_in_units_of_the_longer_side_is_noticed() -> None:
    [item] = read(profile(lens=LENS | {"ImageYCenter": "0.3334"}))
    assert item.intrinsics.cy == pytest.approx(0.3334 * 5472)
    assert any("longer side" in text for text in item.provenance.assumptions)


def test_the_size_of_the_image_is_asked_for_where_it_is_not_stated() -> None:
    bare = {name: text for name, text in CAMERA.items() if not name.startswith("Image")}
    with pytest.raises(MissingTagError, match="--image-size"):
        read(profile(bare))
    assert read(profile(bare), size=SIZE)[0].intrinsics == read(profile())[0].intrinsics


@pytest.mark.parametrize(
    ("camera", "lens", "message"),
    [
        ({}, {"Version": "3"}, "profile 1.*version '3'"),
        ({}, {"FocalLengthY": ""}, "no stCamera:FocalLengthY"),
        ({}, {"RadialDistortParam2": "x"}, "profile 1, RadialDistortParam2"),
        ({}, {"RadialDistortParam7": "0.3"}, "RadialDistortParam7"),
        ({}, {"FocalLengthX": "0"}, "focal lengths are 0"),
        ({"ImageWidth": "0"}, {}, "image size"),
        ({"FocalLength": ""}, {}, "no stCamera:FocalLength"),
        ({}, {"RadialDistortParam1": ""}, "colours and brightness alone"),
    ],
)
def test_a_broken_profile_is_named(camera: dict[str, str], lens: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(profile(CAMERA | camera, LENS | lens))


def test_a_model_without_a_profile_around_it_is_refused() -> None:
    namespace = 'xmlns:stCamera="http://ns.adobe.com/photoshop/1.0/camera-profile"'
    data = f"<stCamera:PerspectiveModel {namespace} {attributes(LENS)}/>".encode()
    with pytest.raises(InputError, match="expected it inside the profile of a camera"):
        parsers.decode(data, name="x.lcp", image_size=SIZE, format="adobe_lcp")
