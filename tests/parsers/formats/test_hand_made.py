"""What people write by hand: the same camera in every container, at every depth, with every way to state its size."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
import scipy.io
import yaml

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import InputError, MissingSizeError, ParseError, UnsupportedModelError
from tests.parsers.samples import Sample

FX, FY, CX, CY = 1000.5, 1001.5, 640.25, 360.75
ROWS = [[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]]
LENS = BrownConrady(k1=-0.1131, k2=0.0247, p1=0.0002, p2=-0.0004, k3=0.0031)
VECTOR = [-0.1131, 0.0247, 0.0002, -0.0004, 0.0031]
BY_NAME = dict(zip(("k1", "k2", "p1", "p2", "k3"), VECTOR, strict=True))
SIDES = {"w": 1280, "h": 720}
PAIRS = [
    ("K", "D"), ("mtx", "dist"), ("cam_mtx", "dist_coefs"), ("camera_matrix", "dist_coefs"),
    ("cameraMatrix", "distCoeffs"), ("intrinsic_matrix", "distortion_coefficients"), ("intrinsics", "kc"),
    ("intrinsic", "distortion_vector"), ("matrix", "distortion_params"),
]  # fmt: skip
SIZES: list[dict[str, object]] = [
    {"resolution": [1280, 720]}, {"size": [1280, 720]}, {"image_size": [1280, 720]}, {"img_size": [1280, 720]},
    {"DIM": [1280, 720]}, {"image_shape": [720, 1280]}, {"image_shape": [720, 1280, 3]}, {"image_shape": [1280, 720]},
    {"w": 1280, "h": 720}, {"cols": 1280, "rows": 720}, {"image_width": 1280, "image_height": 720},
    {"frame_width": 1280, "frame_height": 720},
]  # fmt: skip


def as_json(tree: Mapping[str, object]) -> tuple[str, bytes]:
    return "camera.json", json.dumps(tree).encode()


def as_yaml(tree: Mapping[str, object]) -> tuple[str, bytes]:
    return "camera.yaml", yaml.safe_dump(dict(tree)).encode()


def as_npz(tree: Mapping[str, object]) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {key: np.array(value) for key, value in tree.items()}
    np.savez(buffer, **arrays)
    return "camera.npz", buffer.getvalue()


def as_mat(tree: Mapping[str, object]) -> tuple[str, bytes]:
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, {key: np.array(value) for key, value in tree.items()})
    return "camera.mat", buffer.getvalue()


CONTAINERS = (as_json, as_yaml, as_npz, as_mat)
Container = Callable[[Mapping[str, object]], tuple[str, bytes]]


def read(made: tuple[str, bytes], *, sized: bool = True) -> Sequence[Calibration]:
    name, data = made
    return parsers.decode(data, name=name, image_size=None if sized else (1280, 720))


def same(item: Calibration) -> None:
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (FX, FY, CX + 0.5, CY + 0.5)
    assert K.image_size == (1280, 720)
    assert item.distortion == LENS


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize(("matrix", "coefficients"), PAIRS)
def test_every_pair_of_names_is_read_in_every_container(
    container: Container, matrix: str, coefficients: str
) -> None:
    [item] = read(container({matrix: ROWS, coefficients: [VECTOR]}), sized=False)
    same(item)


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_every_way_to_state_the_size_is_read(container: Container, size: Mapping[str, object]) -> None:
    [item] = read(container({"K": ROWS, "dist": VECTOR, **size}))
    same(item)


@pytest.mark.parametrize("container", [as_json, as_yaml])
@pytest.mark.parametrize(
    "tree",
    [
        {
            "calibration": {"camera_matrix": ROWS, "dist_coeffs": [VECTOR]},
            "camera": {"resolution": {"w": 1280, "h": 720}},
        },
        {"intrinsics": {"K": ROWS, "D": VECTOR, "resolution": [1280, 720]}},
        {"camera": {"matrix": ROWS, "distortion": VECTOR, "size": [1280, 720]}},
        {
            "K": ROWS,
            "distortion": BY_NAME,
            "image_size": [1280, 720],
        },
        {
            "K": ROWS,
            "radial": [-0.1131, 0.0247, 0.0031],
            "tangential": [0.0002, -0.0004],
            "image_size": [1280, 720],
        },
        {"intrinsics": {"fx": FX, "fy": FY, "cx": CX, "cy": CY}, "dist": VECTOR, "w": 1280, "h": 720},
        {"focal_length": [FX, FY], "principal_point": [CX, CY], "dist": VECTOR, "w": 1280, "h": 720},
    ],
    ids=str,
)
def test_one_table_below_another_and_every_shape_of_both_is_read(
    container: Container, tree: Mapping[str, object]
) -> None:
    [item] = read(container(tree))
    same(item)


def test_a_wrapped_yaml_is_recognised_without_its_format() -> None:
    name, data = as_yaml(
        {"calibration": {"camera_matrix": ROWS, "dist_coeffs": [VECTOR], "image_size": [1280, 720]}}
    )
    [item] = parsers.decode(data, name=name)
    same(item)


@pytest.mark.parametrize(
    "lens",
    [
        {"distortion": BY_NAME},
        {"dist_coeffs": VECTOR},
        {"distortion": VECTOR},
    ],
)
def test_fx_by_name_with_a_nested_lens_is_read(lens: Mapping[str, object]) -> None:
    name, data = as_json({"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": 1280, "height": 720, **lens})
    [item] = parsers.decode(data, name=name)
    same(item)


def test_four_coefficients_without_a_model_are_asked_in_every_shape_of_k() -> None:
    names = {"fx": FX, "fy": FY, "cx": CX, "cy": CY, "width": 1280, "height": 720}
    for tree in ({"K": ROWS, "dist": VECTOR[:4], "image_size": [1280, 720]}, {**names, "dist": VECTOR[:4]}):
        name, data = as_json(tree)
        with pytest.raises(InputError, match="--set distortion=brown"):
            parsers.decode(data, name=name)
        [item] = parsers.decode(data, name=name, options={"distortion": "fisheye"})
        assert isinstance(item.distortion, KannalaBrandt)


def test_a_projector_beside_a_camera_is_another() -> None:
    found = read(
        as_json({"cam_K": ROWS, "cam_dist": VECTOR, "proj_K": ROWS, "proj_dist": [0.1] * 5}), sized=False
    )
    same(found[0])
    assert [item.distortion.coefficients["k1"] for item in found if item.distortion] == [-0.1131, 0.1]


def test_a_table_that_is_called_fisheye_has_a_fisheyes_four() -> None:
    camera = {"K": ROWS, "distortion": VECTOR[:4], "image_size": [1280, 720]}
    plain = {**camera, "distortion": []}
    found = read(as_json({"pinhole_1": plain, "fisheye_1": camera}))
    assert [type(item.distortion) for item in found] == [NoDistortion, KannalaBrandt]


@pytest.mark.parametrize(
    "lens",
    [
        {"kc": VECTOR},
        {"distortionCoefficients": VECTOR},
        {"radial": [-0.1131, 0.0247, 0.0031], "tangential": [0.0002, -0.0004]},
    ],
    ids=str,
)
def test_matlabs_matrix_is_transposed_counts_from_one_and_keeps_the_lens_beside_it(
    lens: Mapping[str, object],
) -> None:
    transposed = np.array(ROWS).T.tolist()
    [item] = read(as_mat({"IntrinsicMatrix": transposed, "ImageSize": [720, 1280], **lens}))
    K = item.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (FX, FY, CX - 0.5, CY - 0.5)
    assert item.distortion == LENS


def test_matlabs_matrix_alone_has_an_unknown_distortion() -> None:
    [item] = read(as_mat({"IntrinsicMatrix": np.array(ROWS).T.tolist(), "ImageSize": [720, 1280]}))
    assert item.distortion is None


def test_a_shape_that_nothing_decides_is_asked() -> None:
    centred = [[FX, 0.0, 500.0], [0.0, FY, 500.0], [0.0, 0.0, 1.0]]
    with pytest.raises(MissingSizeError, match="rows and columns, or width and height"):
        read(as_json({"K": centred, "dist": VECTOR, "image_shape": [720, 1280]}))


def flat(tree: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in tree.items():
        found |= flat(value, f"{path}{key}.") if isinstance(value, dict) else {path + key: value}
    return found


def words(value: Any) -> str:
    return " ".join(map(str, np.ravel(value))) if isinstance(value, list) else str(value)


def printed(value: Any) -> str:
    return str(np.array(value)) if isinstance(value, list) else str(value)


def as_sections(tree: Mapping[str, Any], sign: str, write: Callable[[Any], str], path: str = "") -> str:
    own = {key: value for key, value in tree.items() if not isinstance(value, dict)}
    rows = "".join(f"{key}{sign}{write(value)}\n" for key, value in own.items())
    below = (
        as_sections(value, sign, write, f"{path}.{key}".strip("."))
        for key, value in tree.items()
        if isinstance(value, dict)
    )
    return (f"[{path}]\n" if path and own else "") + rows + "".join(below)


def as_elements(tree: Mapping[str, Any]) -> str:
    return "".join(
        f"<{key}>{as_elements(value) if isinstance(value, dict) else words(value)}</{key}>"
        for key, value in tree.items()
    )


def as_attributes(tree: Mapping[str, Any], tag: str = "camera") -> str:
    own = "".join(f' {key}="{words(value)}"' for key, value in tree.items() if not isinstance(value, dict))
    below = (as_attributes(value, key) for key, value in tree.items() if isinstance(value, dict))
    return f"<{tag}{own}>{''.join(below)}</{tag}>"


def as_printed(tree: Mapping[str, Any], indent: int = 0) -> str:
    text = "" if indent else "[ INFO] done\nRMS: 0.31\n"
    for key, value in tree.items():
        margin = " " * indent
        if isinstance(value, dict):
            text += f"{margin}{key}:\n{as_printed(value, indent + 2)}"
        elif isinstance(value, list):
            rows = "".join(f"{margin} {row}\n" for row in printed(value).split("\n"))
            text += f"{margin}{key.replace('_', ' ')}:\n{rows}"
        else:
            text += f"{margin}{key}:   \t{value}\n"
    return text


def as_python(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key!r}: {as_python(item)}" for key, item in value.items()) + "}"
    return repr(np.array(value)) if isinstance(value, list) else repr(value)


WRITTEN: dict[str, Callable[[Mapping[str, Any]], str | bytes]] = {
    "JSON": json.dumps,
    "YAML": lambda tree: yaml.safe_dump(dict(tree), sort_keys=False),
    "YAML in flow style": lambda tree: (
        "# by hand\n" + "".join(f"{key}: {json.dumps(tree[key])}\n" for key in tree)
    ),
    "TOML": lambda tree: as_sections(tree, " = ", json.dumps),
    "INI": lambda tree: as_sections(tree, "=", words),
    "INI with colons": lambda tree: as_sections(tree, ": ", words),
    "CSV": lambda tree: "".join(
        f"{key},{words(value).replace(' ', ',')}\n" for key, value in flat(tree).items()
    ),
    "XML elements": lambda tree: f"<camera>{as_elements(tree)}</camera>",
    "XML attributes": as_attributes,
    "npz": lambda tree: as_npz(flat(tree))[1],
    "mat": lambda tree: as_mat(tree)[1],
    "Python": repr,
    "printed dictionary of arrays": as_python,
    "terminal": as_printed,
    "sheet": lambda tree: "".join(f"{key}: {printed(value)}\n" for key, value in flat(tree).items()),
}
NAMES = {"fx": FX, "fy": FY, "cx": CX, "cy": CY}
NESTED: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "names": lambda size: {**NAMES, **BY_NAME, **size},
    "matrix": lambda size: {"camera_matrix": ROWS, "dist_coeffs": VECTOR, **size},
    "below calibration": lambda size: {"calibration": {**NAMES, **BY_NAME, **size}},
    "size above": lambda size: {**size, "intrinsics": {**NAMES, **BY_NAME}},
    "two tables": lambda size: {"intrinsics": NAMES, "distortion": BY_NAME, **size},
    "two deep": lambda size: {"camera": {"intrinsics": {"K": ROWS, "D": VECTOR}, **size}},
    "below a camera's name": lambda size: {"rgb": {**NAMES, **BY_NAME, **size}},
    "pairs": lambda size: {
        "focal_length": [FX, FY],
        "principal_point": [CX, CY],
        "distortion_coefficients": VECTOR,
        **size,
    },
    "radial": lambda size: {"K": ROWS, "radial": VECTOR[:2] + VECTOR[4:], "tangential": VECTOR[2:4], **size},
    "four deep": lambda size: {
        "results": {"cameras": {"front": {"calib": {"K": ROWS, "D": VECTOR, **size}}}}
    },
    "size in a table": lambda size: {
        "camera_matrix": ROWS,
        "dist_coeffs": VECTOR,
        **({"image": size} if size else {}),
    },
    "flat matrix": lambda size: {"mtx": [*ROWS[0], *ROWS[1], *ROWS[2]], "dist": [VECTOR], **size},
}
STATED: tuple[dict[str, Any], ...] = (
    {"width": 1280, "height": 720},
    {"image_width": 1280, "image_height": 720},
    {"image_size": [1280, 720]},
    {"resolution": "1280x720"},
    {"image_size": "1280,720"},
    {"resolution": "[1280 720]"},
    {"image_shape": [720, 1280]},
    {},
)


@pytest.mark.parametrize("container", WRITTEN)
@pytest.mark.parametrize("nesting", NESTED)
def test_a_camera_is_the_same_in_every_container_at_every_depth_and_by_every_size(
    container: str, nesting: str
) -> None:
    for size in STATED:
        made = WRITTEN[container](NESTED[nesting](size))
        data = made if isinstance(made, bytes) else f"{made}\n".encode()
        if not size:
            with pytest.raises(MissingSizeError, match="--image-size"):
                parsers.decode(data, name="camera")
        [item] = parsers.decode(data, name="camera", image_size=None if size else (1280, 720))
        same(item)


@pytest.mark.parametrize(
    ("text", "cameras"),
    [
        ("fx=1000.5 fy=1001.5 cx=640.25 cy=360.75 k1=-0.1131 k2=0.0247 p1=0.0002 p2=-0.0004 k3=0.0031\n", [None]),
        ("Intrinsics: fx=1000.5, fy=1001.5, cx=640.25, cy=360.75, D=[-0.1131 0.0247 0.0002 -0.0004 0.0031]\n", [None]),
        ("[INFO] [17.5]: K: [1000.5, 0, 640.25, 0, 1001.5,\n 360.75, 0, 0, 1]\n"
         "D = -0.1131 0.0247 0.0002 -0.0004 0.0031\n", [None]),
        ("Left:\n('D = ', [0.1, 0, 0, 0, 0])\n('K = ', [900, 0, 640, 0, 900, 360, 0, 0, 1])\nRight:\n"
         "('D = ', [-0.1131, 0.0247, 0.0002, -0.0004, 0.0031])\n"
         "('K = ', [1000.5, 0, 640.25, 0, 1001.5, 360.75, 0, 0, 1])\n", ["Left", "Right"]),
        ("name,fx,fy,cx,cy,k1,k2,p1,p2,k3\na,900,900,640,360,0.1,0,0,0,0\n"
         "b,1000.5,1001.5,640.25,360.75,-0.1131,0.0247,0.0002,-0.0004,0.0031\n", ["a", "b"]),
        ("K = [1000.5 0 640.25; 0 1001.5 360.75; 0 0 1];\nD = [-0.1131; 0.0247; 0.0002; -0.0004; 0.0031];\n", [None]),
        ("array([[1000.5, 0, 640.25],\n [0, 1001.5, 360.75], [0, 0, 1]])\n"
         "array([[-0.1131, 0.0247, 0.0002, -0.0004, 0.0031]])\n", [None]),
        ("误差：0.31\n相机内参：\n[1000.5, 0, 640.25;\n 0, 1001.5, 360.75;\n 0, 0, 1]\n"
         "畸变系数：\n[-0.1131, 0.0247, 0.0002, -0.0004, 0.0031]\n旋转：\n[-1.3;\n 0.4;\n 2.1]\n", [None]),
        ("1000.5 0 640.25 0 1001.5 360.75 0 0 1\n-0.1131 0.0247 0.0002 -0.0004 0.0031\n0.063\n", [None]),
        ("K = [1000.5 0 640.25; 0 1001.5 360.75; 0 0 1]\nD = -0.1131 0.0247 0.0002 -0.0004 0.0031\n"
         "Camera height: 1.65 m\n", [None]),
    ],
)  # fmt: skip
def test_what_programs_print_is_read(text: str, cameras: list[str | None]) -> None:
    found = parsers.decode(text.encode(), name="log.txt", image_size=(1280, 720))
    assert [item.camera.sub_camera for item in found] == cameras
    same(found[-1])


@pytest.mark.parametrize(
    ("tree", "cameras"),
    [
        ({"left": {"K": ROWS, "D": VECTOR}, "right": {"K": ROWS, "D": VECTOR}, "size": "1280x720"}, ["left", "right"]),
        ({"K1": ROWS, "D1": VECTOR, "K2": ROWS, "D2": VECTOR, "size": [1280, 720]}, ["1", "2"]),
        ({"mtx": {"l": ROWS, "r": ROWS}, "dist": {"l": VECTOR, "r": VECTOR}, "w": 1280, "h": 720}, ["l", "r"]),
        ({"frames": [{"K": ROWS, "D": VECTOR, "w": 1280, "h": 720}] * 3}, [None]),
        ({"K": ROWS, "D": VECTOR, "distortion": BY_NAME, "w": 1280, "h": 720}, [None]),
        ({"K": ROWS, "D": VECTOR, "new_camera_matrix": [[900, 0, 600], [0, 900, 300], [0, 0, 1]], "size": [1280, 720]},
         [None]),
        ({"calibration": [FX, FY, CX, CY, *VECTOR], "size": [1280, 720]}, [None]),
        ({"K": ROWS, "D": VECTOR, "size": [720, 1280]}, [None]),
        ({"rgb_intrinsic": NAMES, "ir_intrinsic": NAMES, "rgb_distortion": BY_NAME, "ir_distortion": BY_NAME,
          "size": [1280, 720]}, ["rgb_intrinsic", "ir_intrinsic"]),
        ({"focallength": [FX, FY], "principalx": CX, "principaly": CY, "D": VECTOR, "size": [1280, 720]}, [None]),
        ({"K": ROWS, "D": VECTOR, "distortion_model": "rectilinear", "size": [1280, 720]}, [None]),
    ],
)  # fmt: skip
def test_one_k_is_one_camera_and_equal_statements_are_one(
    tree: Mapping[str, Any], cameras: list[str | None]
) -> None:
    found = parsers.decode(json.dumps(tree).encode(), name="rig.json")
    assert [item.camera.sub_camera for item in found] == cameras
    for item in found:
        same(item)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"distortion": {**BY_NAME, "k2": 0.03}}, "D.*stated as well, with other numbers"),
        ({"fx": 900.0}, "fx: it is 900, and 1000.5 in 'K'"),
        ({"distortion_model": "splines"}, "'splines'"),
        ({"camera_model": "double sphere"}, "'double sphere'"),
        ({"D2": VECTOR}, "D2: there is no camera matrix beside these coefficients"),
        ({"resolution": "640x480"}, "two image sizes"),
        ({"warp": [0.1, 0.2, 0.3, 0.4], "k7": 0.5}, "'k7'"),
    ],
)  # fmt: skip
def test_what_contradicts_or_is_not_known_is_named(more: Mapping[str, Any], message: str) -> None:
    tree = {"K": ROWS, "D": VECTOR, "image_size": [1280, 720], **more}
    with pytest.raises((ParseError, UnsupportedModelError), match=message):
        parsers.decode(json.dumps(tree).encode(), name="camera.json")


def test_zeros_at_the_end_of_a_long_vector_are_no_other_model() -> None:
    rational = [-0.24, 0.14, 0.001, -0.0002, -0.07, -0.01, 0.02, 0.003]
    [item] = read(as_json({"K": ROWS, "D": [*rational, *[0.0] * 6], "xi": 0.0, "image_size": [1280, 720]}))
    assert item.distortion == Rational(**dict(zip(Rational.names(), rational, strict=True)))
    [item] = read(as_json({"K": ROWS, "D": [*VECTOR, 0, 0, 0], "image_size": [1280, 720]}))
    same(item)


def test_a_size_of_zeros_is_none() -> None:
    with pytest.raises(MissingSizeError):
        read(as_json({"K": ROWS, "D": VECTOR, "width": 0, "height": 0}))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"camera_matrix: !!python/object/apply:os.system [ls]\n", "K.tolist()"),
        (b"camera_matrix = [1, [" + b"[" * 2000 + b"\n", "not closed"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><a fx='1000' fy='1000' cx='640' cy='360'>&b;</a>", "DOCTYPE"),
        (b"fx = 1000\nfy = 1000\ncx = 640\ncy = 360\n" + b"# filled\n" * 300_000, "over 2 MiB"),
    ],
    ids=["object", "brackets", "entities", "long"],
)  # fmt: skip
def test_what_is_hostile_or_long_is_refused_by_its_name(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        parsers.decode(data, name="camera")


ORIGIN = {
    "calibrated on": "2019-05-14",
    "software": "Solver 3",
    "calibrated by": "A. Lab",
    "focus": "infinity",
}
SAMPLES = {"hand_made": Sample(json.dumps({**NAMES, **BY_NAME, "w": 1280, "h": 720, **ORIGIN}).encode())}
