"""SLStudio's scanner, against OpenCV."""

from __future__ import annotations

import pytest

from calibrary import parsers
from calibrary.errors import ParseError
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample


def matrix(name: str, rows: int, cols: int, data: str) -> str:
    return (
        f'<{name} type_id="opencv-matrix">\n  <rows>{rows}</rows>\n  <cols>{cols}</cols>\n  <dt>f</dt>\n'
        f"  <data>\n    {data}</data></{name}>\n"
    )


FILE = (
    '<?xml version="1.0"?>\n<opencv_storage>\n'
    + matrix("Kc", 3, 3, "433.2 0. 371.6 0. 432.9 238.3 0. 0. 1.")
    + matrix("kc", 5, 1, "-2.131e-01 0.0447 -0.00037 0.00081 0.0062")
    + matrix("Kp", 3, 3, "1895.4 0. 451.8 0. 1895.4 632.6 0. 0. 1.")
    + matrix("kp", 5, 1, "-0.03 0. 0. 0. 0.")
    + "<cam_error>0.32</cam_error>\n<frameWidth>752</frameWidth>\n<frameHeight>480</frameHeight>\n"
    + "<screenResX>912</screenResX>\n<screenResY>1140</screenResY>\n</opencv_storage>\n"
)
SAMPLES = {"slstudio": Sample(FILE.encode())}


def test_camera_and_projector_are_opencvs() -> None:
    camera, projector = parsers.decode(FILE.encode(), name="calibration.xml")
    assert_projects_as_opencv(
        camera, (433.2, 432.9, 371.6, 238.3), (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
    )
    assert_projects_as_opencv(projector, (1895.4, 1895.4, 451.8, 632.6), (-0.03, 0, 0, 0, 0))
    assert [item.intrinsics.image_size for item in (camera, projector)] == [(752, 480), (912, 1140)]
    assert [item.camera.sub_camera for item in (camera, projector)] == ["camera", "projector"]


@pytest.mark.parametrize(
    ("old", "new", "kind", "match"),
    [
        ("<frameWidth>752</frameWidth>", "", ParseError, "there is no 'frameWidth'"),
        ("<rows>5</rows>", "<rows>4</rows>", ParseError, "kc: its header"),
        ("0. 0. 1.</data></Kc>", "0. 0. 2.</data></Kc>", ParseError, "Kc: this is not a camera matrix"),
    ],
)
def test_a_broken_file_names_what_is_wrong(old: str, new: str, kind: type[Exception], match: str) -> None:
    with pytest.raises(kind, match=match):
        parsers.decode(FILE.replace(old, new).encode(), name="calibration.xml")
