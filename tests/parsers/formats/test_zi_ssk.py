"""Z/I's camera block, against collinearity in mm, rows first and y up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from tests.parsers.samples import Sample


def block(name: str = "FC_8.8_5472x3648 (RGB)(1)", **changes: str) -> str:
    rows = {
        "focal_length": "8.76024", "ppac": "0.02793 -0.02181", "ppbs": "0 0", "film_format": "8.79168 13.1328",
        "lens_distortion_flag": "off", "io_required": "yes", "camera_type": "frame", "media_type": "digital",
        "pixel_size": "2.41 2.40", "image_size_in_pixels": "3648 5472", "scanline_orientation": "4",
        "photo_coord_sys_orientation": "1", "photo_coord_sys_origin": "1823.5 2735.5",
    }  # fmt: skip
    body = "".join(f"    {key}:      {value}\n" for key, value in (rows | changes).items() if value)
    return f"begin camera_parameters {name}\n{body}end camera_parameters\n"


def read(text: str) -> Sequence[Calibration]:
    return parsers.decode(text.encode(), name="camera.ssk")


SAMPLES = {"zi_ssk": Sample(block().encode())}


def test_a_point_is_seen_by_collinearity_in_rows_and_columns() -> None:
    [calibration] = read(block())
    u, v = np.meshgrid(np.linspace(-0.7, 0.7, 15), np.linspace(-0.48, 0.48, 15))
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
    x_mm, y_up_mm = 8.76024 * rays[:, 0] + 0.02793, -8.76024 * rays[:, 1] - 0.02181
    column, row = 2735.5 + x_mm / 0.0024, 1823.5 - y_up_mm / 0.00241
    # Rows and columns count pixels' centres, and so half a pixel less than from the corner.
    np.testing.assert_allclose(
        calibration.project(rays), np.stack([column, row], axis=1) + 0.5, rtol=0, atol=1e-9
    )
    assert calibration.grade is Grade.ADJUSTED


def test_the_flag_off_means_images_free_of_distortion() -> None:
    [calibration] = read(block())
    assert calibration.distortion == NoDistortion()
    assert "free of distortion" in calibration.notes[0]


def test_the_flag_on_leaves_the_lens_unknown() -> None:
    [calibration] = read(block(lens_distortion_flag="on"))
    assert calibration.distortion is None
    assert "unknown" in calibration.notes[0]


def test_several_cameras_come_in_order_by_name() -> None:
    cameras = read(block("a") + "\n" + block("b", focal_length="20"))
    assert [item.camera.sub_camera for item in cameras] == ["a", "b"]
    assert cameras[1].intrinsics.fx == pytest.approx(20 / 0.0024)


@pytest.mark.parametrize(
    "changes",
    [{"camera_type": "pushbroom"}, {"media_type": "film"}, {"scanline_orientation": "1"}],
)
def test_a_value_whose_meaning_is_not_known_is_refused(changes: dict[str, str]) -> None:
    with pytest.raises(UnsupportedModelError, match=next(iter(changes))):
        read(block(**changes))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (block(focal_length=""), "there is no 'focal_length'"),
        (block(ppac="0.1"), "ppac: 1 numbers, expected 2"),
        (block(focal_length="8,76"), "decimal point"),
        (block(focal_length="0"), "focal lengths"),
        (block(pixel_size="2.4 0"), "not positive"),
        (block(image_size_in_pixels="3648 x"), "not a number"),
        (block().replace("ppbs", "ppac"), "ppac is a duplicate key"),
        (block().replace("end camera_parameters\n", ""), "no 'end camera_parameters'"),
    ],
)
def test_a_broken_file_names_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(text.encode(), name="camera.ssk", format="zi_ssk")
