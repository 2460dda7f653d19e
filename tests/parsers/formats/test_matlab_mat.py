"""MATLAB's files and structs, against SciPy's own writer and reader, and OpenCV."""

from __future__ import annotations

import contextlib
import io
import json
import struct
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import scipy.io

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError, MissingTagError, ParseError, UnsupportedModelError
from calibrary.parsers.formats._mat5 import variables
from calibrary.parsers.formats._mcos import MARK, Objects
from calibrary.records import Json
from tests.parsers.peers import assert_projects_as_opencv
from tests.parsers.samples import Sample

STRUCT: dict[str, Any] = {
    "RadialDistortion": [-0.2131, 0.0447, 0.0062],
    "TangentialDistortion": [-0.00037, 0.00081],
    "ImageSize": [480, 752],
    "IntrinsicMatrix": [[433.2, 0, 0], [0.7, 432.9, 0], [372.6, 239.3, 1]],
    "WorldUnits": "mm",
    "EstimateSkew": True,
}
OPENCV = (433.2, 432.9, 371.6, 238.3)
BROWN = (-0.2131, 0.0447, -0.00037, 0.00081, 0.0062)
WITHOUT_SKEW = {**STRUCT, "IntrinsicMatrix": [[433.2, 0, 0], [0, 432.9, 0], [372.6, 239.3, 1]]}
BOUGUET: dict[str, Any] = {
    "alpha_c": 0.0, "cc": [[371.6], [238.3]], "fc": [[433.2], [432.9]], "kc": [[value] for value in BROWN],
    "nx": 752.0, "ny": 480.0, "fc_error": [[0.9], [1.2]], "cc_error": [[np.nan], [np.nan]], "n_ima": 20.0,
    "omc_1": np.ones((3, 1)), "X_1": np.ones((3, 156)),
}  # fmt: skip


def mat(values: dict[str, Any], **how: Any) -> bytes:
    buffer = io.BytesIO()
    arrays = {
        key: np.array(value, dtype=float) if isinstance(value, list) else value
        for key, value in values.items()
    }
    scipy.io.savemat(buffer, arrays, **how)
    return buffer.getvalue()


def camera_struct(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        key: np.array(value, dtype=float) if isinstance(value, list) else value
        for key, value in fields.items()
    }


def read(data: bytes, **named: Any) -> Sequence[Calibration]:
    return parsers.decode(data, name="camera.mat", **named)


SAMPLES = {
    "matlab_mat": Sample(mat({"cameraParams": camera_struct(STRUCT)})),
    "matlab_json": Sample(json.dumps(STRUCT).encode()),
}


@pytest.mark.parametrize("packed", [False, True])
def test_a_struct_counts_from_one_and_is_transposed(packed: bool) -> None:
    data = mat(
        {"points": np.ones((400, 3)), "cameraParams": camera_struct(WITHOUT_SKEW)}, do_compression=packed
    )
    [item] = read(data)
    assert_projects_as_opencv(item, OPENCV, BROWN)
    assert item.intrinsics.image_size == (752, 480)
    assert item.provenance.tag == "cameraParams"


def test_the_skew_stands_below_the_diagonal() -> None:
    [item] = read(SAMPLES["matlab_mat"].data)
    assert item.intrinsics.skew == 0.7
    assert item.intrinsics.cx == 372.6 - 0.5


@pytest.mark.parametrize("key", ["K", "IntrinsicMatrix"])
def test_a_matrix_that_is_not_transposed_is_read_as_it_stands(key: str) -> None:
    fields = {k: v for k, v in STRUCT.items() if k != "IntrinsicMatrix"}
    fields[key] = [[433.2, 0.7, 372.6], [0, 432.9, 239.3], [0, 0, 1]]
    [item] = parsers.decode(json.dumps({"camera": fields}).encode(), name="camera.json")
    assert item.intrinsics == read(SAMPLES["matlab_mat"].data)[0].intrinsics


def test_json_and_yaml_of_the_struct_are_the_same_camera() -> None:
    [item] = parsers.decode(SAMPLES["matlab_json"].data, name="camera.json")
    yaml = "".join(f"{key}: {json.dumps(value)}\n" for key, value in STRUCT.items())
    [other] = parsers.decode(yaml.encode(), name="camera.yaml")
    assert item.intrinsics == other.intrinsics == read(SAMPLES["matlab_mat"].data)[0].intrinsics


def test_intrinsics_have_vectors_in_place_of_a_matrix() -> None:
    fields = {
        "FocalLength": [433.2, 432.9], "PrincipalPoint": [372.6, 239.3], "ImageSize": [480, 752],
        "RadialDistortion": [-0.2131, 0.0447], "TangentialDistortion": [0, 0], "Skew": 0,
    }  # fmt: skip
    [item] = parsers.decode(json.dumps(fields).encode(), name="camera.json")
    assert_projects_as_opencv(item, OPENCV, (-0.2131, 0.0447, 0, 0))


def test_a_stereo_pair_is_two_cameras() -> None:
    pair = {"stereoParams": {"CameraParameters1": STRUCT, "CameraParameters2": WITHOUT_SKEW}}
    items = parsers.decode(json.dumps(pair).encode(), name="stereo.json", format="matlab_json")
    assert [item.camera.sub_camera for item in items] == [
        "stereoParams.CameraParameters1", "stereoParams.CameraParameters2",
    ]  # fmt: skip


def test_an_empty_image_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(json.dumps({**STRUCT, "ImageSize": []}).encode(), name="camera.json")


def test_bouguets_results_are_those_of_the_script() -> None:
    [item] = read(mat(BOUGUET))
    assert_projects_as_opencv(item, OPENCV, BROWN)
    assert item.quality is not None
    assert dict(item.quality.std) == {"fx": pytest.approx(0.3), "fy": pytest.approx(0.4)}
    assert item.quality.views == 20


def test_what_python_saves_has_opencvs_names() -> None:
    K = [[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]]
    [item] = read(mat({"mtx": K, "dist": [BROWN]}), image_size=(752, 480))
    assert_projects_as_opencv(item, OPENCV, BROWN)
    [item] = read(mat({"K": K}), image_size=(752, 480))
    assert item.distortion is None


def test_no_coefficient_is_no_distortion() -> None:
    fields = {**STRUCT, "RadialDistortion": [0, 0], "TangentialDistortion": [0, 0]}
    assert read(mat({"c": camera_struct(fields)}))[0].distortion == NoDistortion()


@pytest.mark.parametrize("packed", [False, True])
def test_small_variables_are_what_scipy_loads(packed: bool) -> None:
    values: dict[str, Any] = {
        "scalar": 1.5, "row": np.arange(4.0)[None], "column": np.arange(3.0)[:, None],
        "rows": np.arange(6.0).reshape(2, 3),
        "small": np.array([[1, 2], [3, 4]], dtype=np.uint8), "text": "Äpfel", "long": np.ones((9, 9)),
        "nested": {"a": 1.0, "b": {"c": np.eye(2)}},
    }  # fmt: skip
    data = mat(values, do_compression=packed)
    ours = variables(data, source="a.mat").values
    peer = scipy.io.loadmat(io.BytesIO(data), simplify_cells=True)
    assert "long" not in ours
    for name in ("scalar", "row", "column", "rows", "small"):
        np.testing.assert_array_equal(np.array(ours[name]), peer[name])
    assert ours["text"] == peer["text"]
    assert ours["nested"] == {"a": 1.0, "b": {"c": [[1, 0], [0, 1]]}}


def part(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")


def element(value: Any) -> bytes:
    """A variable as SciPy writes it, behind the header of its file."""
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {"v": value})
    return buffer.getvalue()[128:]


def opaque(name: bytes, of_class: bytes, content: bytes) -> bytes:
    return part(
        14,
        part(6, struct.pack("<II", 17, 0))
        + b"".join(part(1, text) for text in (name, b"MCOS", of_class))
        + content,
    )


def of_objects(of_class: bytes, saved: dict[str, Any], *, version: int = 4) -> bytes:
    """A file of one variable, an object whose saveobj gave a struct, as MATLAB lays it out."""
    names = of_class + b"\0any\0"
    names = names.ljust(-(-len(names) // 8) * 8, b"\0")
    regions = [
        (0, 0, 0, 0, 0, 1, 0, 0),
        (0, 0, 1, 2, 1, 0),
        (0,) * 6 + (1, 0, 0, 1, 0, 1),
        (0, 0),
        (0, 0, 0, 0),
    ]
    packed = [struct.pack(f"<{len(region)}i", *region) for region in regions]
    starts = np.cumsum([40 + len(names), *map(len, packed), 0, 0])
    meta = struct.pack("<2i8i", version, 2, *starts) + names + b"".join(packed)
    after = [np.zeros((1, 0))] * {2: 1, 3: 2, 4: 3}[version]
    values: list[Any] = [np.frombuffer(meta, dtype=np.uint8)[:, None], np.zeros((0, 0)), saved, *after]
    cells = b"".join(map(element, values))
    cell = part(
        14,
        part(6, struct.pack("<II", 1, 0))
        + part(5, struct.pack("<ii", len(values), 1))
        + part(1, b"")
        + cells,
    )
    field = part(
        14,
        part(6, struct.pack("<II", 2, 0))
        + part(5, struct.pack("<ii", 1, 1))
        + part(1, b"")
        + part(5, struct.pack("<i", 8))
        + part(1, b"MCOS\0\0\0\0")
        + opaque(b"", b"FileWrapper__", cell),
    )
    subsystem = b"\0\1IM\0\0\0\0" + field
    reference = element(np.array([[0xDD000000], [2], [1], [1], [1], [1]], dtype=np.uint32))
    variable = opaque(b"params", of_class, reference)
    head = SAMPLES["matlab_mat"].data[:116] + struct.pack("<Q", 128 + len(variable)) + b"\0\1IM"
    return head + variable + element(np.frombuffer(subsystem, dtype=np.uint8)[None, :])


@pytest.mark.parametrize("version", [2, 3, 4])
def test_a_saved_object_is_the_struct_that_it_was_saved_as(version: int) -> None:
    [item] = read(of_objects(b"cameraParameters", camera_struct(STRUCT), version=version))
    [peer] = read(mat({"params": camera_struct(STRUCT)}))
    assert (item.intrinsics, item.distortion) == (peer.intrinsics, peer.distortion)


def of_shared_cell(properties: int) -> tuple[Objects, list[bytes]]:
    """An object whose properties are all the same cell, and the list of the cells that were decoded."""
    regions = [
        (0, 0, 0, 0),
        (0, 0),
        (0,) * 6 + (1, 0, 0, 0, 1, 0),
        (0, 0, properties, *(1, 1, 0) * properties),
    ]
    packed = [struct.pack(f"<{len(region)}i", *region) for region in regions]
    names = b"Intrinsics\0".ljust(16, b"\0")
    starts = np.cumsum([40 + len(names), *map(len, packed), 0, 0, 0])
    meta = struct.pack("<2i8i", 4, 1, *starts) + names + b"".join(packed)
    decoded: list[bytes] = []

    def value(cell: bytes) -> Json:
        decoded.append(cell)
        return {f"field{number}": 1.0 for number in range(1000)}

    return Objects([b""] * 2 + [b"shared"] + [b""] * 3, meta, "<", value), decoded


def test_a_cell_that_properties_share_is_decoded_once() -> None:
    objects, decoded = of_shared_cell(3)
    table = objects.resolved([MARK, 2, 1, 1, 1, 1])
    assert isinstance(table, dict)
    assert list(table) == ["Intrinsics"]
    assert decoded == [b"shared"]


def test_objects_of_more_values_than_a_calibration_has_are_refused() -> None:
    objects, decoded = of_shared_cell(1000)
    with pytest.raises(
        ParseError, match=r"over 20000 values.*the most that are looked into; save its cameraParams alone"
    ):
        objects.resolved([MARK, 2, 1, 1, 1, 1])
    assert len(decoded) == 1


def test_more_objects_than_are_looked_into_are_a_limit_and_no_damage() -> None:
    objects, _ = of_shared_cell(1)
    with pytest.raises(
        ParseError, match=r"over 20000 values in MATLAB's objects, the most that are looked into"
    ):
        objects.resolved([MARK, 2, 20_001, *[1] * 20_001, 1])


def test_a_pair_of_cameras_is_two() -> None:
    pair = {
        "CameraParameters1": camera_struct(STRUCT),
        "CameraParameters2": camera_struct(WITHOUT_SKEW),
        "RotationOfCamera2": np.eye(3),
    }
    first, second = read(of_objects(b"stereoParameters", pair))
    assert first.intrinsics.skew == 0.7
    assert second.intrinsics.skew == 0.0


def test_a_fisheye_is_scaramuzzas_with_the_axis_ahead() -> None:
    """The MathWorks: (u, v) = S·(x, y) + centre, the ray is (x, y, a0 + a2·ρ² + a3·ρ³ + a4·ρ⁴), from (1, 1)."""
    a, stretch, centre = (
        (320.5, -8.1e-4, 2.3e-8, -1.9e-9),
        np.array([[0.998, 0.002], [0.0, 1.0]]),
        (377.3, 241.9),
    )
    lens = {
        "MappingCoefficients": np.array(a),
        "StretchMatrix": stretch,
        "DistortionCenter": np.array(centre),
        "ImageSize": np.array([480.0, 752.0]),
    }
    [item] = read(of_objects(b"fisheyeParameters", {"Intrinsics": lens, "EstimateAlignment": True}))
    assert item.intrinsics.image_size == (752, 480)
    x, y = np.meshgrid(np.linspace(-250, 250, 11), np.linspace(-200, 200, 9))
    plane = np.column_stack([x.ravel(), y.ravel()])
    rho = np.linalg.norm(plane, axis=1)
    rays = np.column_stack([plane, a[0] + a[1] * rho**2 + a[2] * rho**3 + a[3] * rho**4])
    pixels = plane @ stretch.T + centre - 0.5
    np.testing.assert_allclose(item.project(rays), pixels, atol=1e-6)


def test_objects_that_cannot_be_read_and_newer_files_are_refused_with_the_lines_that_export_them() -> None:
    whole = of_objects(b"cameraParameters", camera_struct(STRUCT))
    without = whole[:116] + bytes(8) + whole[124:]
    with pytest.raises(UnsupportedModelError, match=r"class 'cameraParameters'.*toStruct.*jsonencode"):
        read(without)
    with pytest.raises(UnsupportedModelError, match=r"7\.3.*jsonencode"):
        read(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b"\0"))


def test_a_damaged_subsystem_is_refused_and_never_runs_away() -> None:
    whole = of_objects(b"cameraParameters", camera_struct(STRUCT))
    rng = np.random.default_rng(7)
    for _ in range(300):
        changed = bytearray(whole)
        for at in rng.integers(128, len(whole), 3):
            changed[at] = rng.integers(256)
        with contextlib.suppress(InputError):
            read(bytes(changed), image_size=(752, 480))


def test_many_bombs_are_given_up() -> None:
    count = 480_000
    inner = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, 1, count) + struct.pack("<II", 1, 0)
    inner += struct.pack("<II", 9, 8 * count) + b"\0" * (8 * count)
    bomb = zlib.compress(struct.pack("<II", 14, len(inner)) + inner, 9)
    data = SAMPLES["matlab_mat"].data[:128] + (struct.pack("<II", 15, len(bomb)) + bomb) * 40
    with pytest.raises(ParseError, match="bytes unpacked"):
        read(data)


def test_a_bomb_is_not_unpacked() -> None:
    bomb = zlib.compress(b"\0" * 50_000_000, 9)
    data = SAMPLES["matlab_mat"].data[:128] + struct.pack("<II", 15, len(bomb)) + bomb
    with pytest.raises(ParseError, match="no camera; the variables are none"):
        read(data)


@pytest.mark.parametrize(
    ("values", "match"),
    [
        ({"a": 1.0}, "no camera; the variables are 'a'"),
        ({"c": camera_struct({**STRUCT, "IntrinsicMatrix": np.eye(2)})}, "c.IntrinsicMatrix"),
        ({"c": camera_struct({**STRUCT, "RadialDistortion": [1, 2, 3, 4]})}, "4 numbers, expected 2 or 3"),
        (
            {"c": camera_struct({**STRUCT, "IntrinsicMatrix": [[1, 2, 3], [4, 5, 6], [7, 8, 9]]})},
            "not a camera matrix",
        ),
    ],
)
def test_a_broken_file_names_what_is_wrong(values: dict[str, Any], match: str) -> None:
    with pytest.raises(ParseError, match=match):
        read(mat(values))


def test_a_coefficient_beyond_all_measure_projects_without_a_warning() -> None:
    """Found by fuzzing: a byte of k3's exponent was changed."""
    camera = Calibration.from_opencv(
        np.array([[433.2, 0, 371.6], [0, 432.9, 238.3], [0, 0, 1]]),
        [-0.2, 0.04, 0, 0, 1.1e306],
        image_size=(752, 480),
    )
    pixels = camera.project([[0.0, 0.0, 1.0], [0.3, -0.2, 1.0], [-0.9, 0.7, 1.0]])
    assert pixels[0].tolist() == [372.1, 238.8]
    assert not np.isfinite(pixels[2]).any()
    seen = np.array([[372.1, 238.8], [900.0, 900.0]])
    assert camera.project(camera.unproject(seen)) == pytest.approx(seen)
