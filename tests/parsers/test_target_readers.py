"""What the writers make, opened by the target's own program or by the formula that it publishes."""

from __future__ import annotations

import ast
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
import pytest
import yaml
from lxml import etree
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    MetashapeFrame,
    NoDistortion,
    Rational,
    ThinPrism,
    ThinPrismFisheye,
    Tilted,
    Unified,
)
from tests.parsers.cameras import BROWN, camera

Array = NDArray[np.float64]
METASHAPE = "width height f cx cy b1 b2 k1 k2 k3 k4 p1 p2 p3 p4".split()  # noqa: SIM905
Seen = Callable[[Path], Array]
"""The pixels of RAYS by a file's numbers, from the corner of the image."""

FOUR = BrownConrady(k1=-0.11, k2=0.024, p1=-0.00037, p2=0.00081)
EIGHT = Rational(k1=0.21, k2=-0.03, p1=4e-4, p2=-7e-4, k3=0.004, k4=0.17, k5=-0.02, k6=0.003)
TWELVE = ThinPrism(
    **{name: getattr(EIGHT, name) for name in EIGHT.names()}, s1=3e-4, s2=-2e-4, s3=5e-4, s4=1e-4
)
FOURTEEN = Tilted(**{name: getattr(TWELVE, name) for name in TWELVE.names()}, tau_x=0.012, tau_y=-0.017)
FISHEYE = KannalaBrandt(k1=-0.021, k2=0.0083, k3=-0.0061, k4=0.0012)
FRAME = MetashapeFrame(k1=-0.11, k2=0.024, k3=-0.006, k4=0.002, p1=3e-4, p2=-8e-4, p3=0.1)
MEI = Unified(xi=0.83, k1=-0.11, k2=0.024, p1=-3e-4, p2=8e-4)

EUCM = ExtendedUnified(alpha=0.57, beta=1.09)
SPHERES = DoubleSphere(xi=-0.18, alpha=0.59)
FOV = FieldOfView(omega=0.93)
PRISMS = ThinPrismFisheye(k1=-0.02, k2=0.008, p1=3e-4, p2=-8e-4, k3=-0.006, k4=0.001, sx1=1e-3, sy1=-7e-4)

u, v = np.meshgrid(np.linspace(-0.6, 0.6, 7), np.linspace(-0.45, 0.45, 5))
RAYS = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)])
X, Y = RAYS[:, 0], RAYS[:, 1]
FORWARD = RAYS / np.linalg.norm(RAYS, axis=1)[:, None]


def brown(
    x: Array, y: Array, k1: float, k2: float, p1: float, p2: float, *more: float
) -> tuple[Array, Array]:
    """OpenCV's model of 4, 5, 8 or 12 coefficients."""
    k3, k4, k5, k6, s1, s2, s3, s4 = (*more, *[0.0] * (8 - len(more)))
    r = x**2 + y**2
    radial = (1 + k1 * r + k2 * r**2 + k3 * r**3) / (1 + k4 * r + k5 * r**2 + k6 * r**3)
    return (
        x * radial + 2 * p1 * x * y + p2 * (r + 2 * x**2) + s1 * r + s2 * r**2,
        y * radial + 2 * p2 * x * y + p1 * (r + 2 * y**2) + s3 * r + s4 * r**2,
    )


def equidistant(k1: float, k2: float, k3: float, k4: float) -> tuple[Array, Array]:
    """Kannala and Brandt's: the angle's polynomial is the radius."""
    radius = np.hypot(X, Y)
    angle = np.arctan(radius)
    scale = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
    scale /= np.where(radius == 0, 1, radius)
    return X * scale, Y * scale


def at_centres(K: Any, points: tuple[Array, Array]) -> Array:
    """The pixels by fx, fy, cx, cy that count from the centre of the first pixel."""
    fx, fy, cx, cy = K
    return np.column_stack([fx * points[0] + cx + 0.5, fy * points[1] + cy + 0.5])


def omnidirectional(xi: float, *D: float) -> tuple[Array, Array]:
    """Mei's: from a point of the unit sphere, seen from xi behind its centre."""
    return brown(FORWARD[:, 0] / (FORWARD[:, 2] + xi), FORWARD[:, 1] / (FORWARD[:, 2] + xi), *D)


def by_opencv(K: Any, D: Any, xi: float | None, *, fisheye: bool) -> Array:
    """With the module of OpenCV that the file asks for; cv2.omnidir is not in every build."""
    if xi is not None:
        return at_centres((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), omnidirectional(xi, *D.ravel()))
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    still = np.zeros((3, 1))
    seen = project(RAYS.reshape(-1, 1, 3), still, still, K, D)[0]
    return np.asarray(seen, dtype=np.float64).reshape(-1, 2) + 0.5


def opencv(path: Path) -> Array:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    names = storage.root().keys()
    K, D = (storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients"))
    xi = storage.getNode("xi").real() if "xi" in names else None
    return by_opencv(K, D, xi, fisheye="fisheye_model" in names)


def numpys(path: Path) -> Array:
    with np.load(path) as file:
        K, D = file["camera_matrix"], file["distortion_coefficients"]
        return by_opencv(K, D, file["xi"].item() if "xi" in file else None, fisheye="fisheye_model" in file)


def kalibr(path: Path) -> Array:
    chain = yaml.safe_load(path.read_text())["cam0"]
    *own, fu, fv, pu, pv = chain["intrinsics"]
    D = chain["distortion_coeffs"]
    K = (fu, fv, pu, pv)
    x, y, z = RAYS.T
    match chain["camera_model"], chain["distortion_model"]:
        case "pinhole", "radtan":
            return at_centres(K, brown(x, y, *D))
        case "pinhole", "equidistant":
            return at_centres(K, equidistant(*D))
        case "pinhole", "fov":
            radius = np.hypot(x, y)
            scale = np.arctan(2 * radius * np.tan(D[0] / 2)) / D[0]
            scale = np.where(
                radius == 0, 2 * np.tan(D[0] / 2) / D[0], scale / np.where(radius == 0, 1, radius)
            )
            return at_centres(K, (x * scale, y * scale))
        case "omni", "radtan":
            return at_centres(K, omnidirectional(*own, *D))
        case "eucm", "none":
            alpha, beta = own
            depth = alpha * np.sqrt(beta * (x**2 + y**2) + z**2) + (1 - alpha) * z
            return at_centres(K, (x / depth, y / depth))
        case "ds", "none":
            xi, alpha = own
            first = np.sqrt(x**2 + y**2 + z**2)
            beyond = xi * first + z
            depth = alpha * np.sqrt(x**2 + y**2 + beyond**2) + (1 - alpha) * beyond
            return at_centres(K, (x / depth, y / depth))
        case model:
            raise AssertionError(model)


def ros(path: Path) -> Array:
    file = yaml.safe_load(path.read_text())
    K, D = (file[name]["data"] for name in ("camera_matrix", "distortion_coefficients"))
    is_fisheye = file["distortion_model"] == "equidistant"
    assert is_fisheye or len(D) == {"plumb_bob": 5, "rational_polynomial": 8}[file["distortion_model"]]
    return at_centres((K[0], K[4], K[2], K[5]), equidistant(*D) if is_fisheye else brown(X, Y, *D))


def opensfm(path: Path) -> Array:
    [model] = json.loads(path.read_text()).values()
    if model["projection_type"] == "brown":
        x, y = brown(X, Y, *(model[name] for name in ("k1", "k2", "p1", "p2", "k3")))
    else:
        assert model["projection_type"] == "fisheye_opencv"
        x, y = equidistant(*(model[name] for name in ("k1", "k2", "k3", "k4")))
    longer = max(model["width"], model["height"])
    return np.column_stack(
        [
            (model["focal_x"] * x + model["c_x"]) * longer + model["width"] / 2,
            (model["focal_y"] * y + model["c_y"]) * longer + model["height"] / 2,
        ]
    )


def metashape(path: Path) -> Array:
    root = etree.fromstring(path.read_bytes())
    width, height, f, cx, cy, b1, b2, *lens = (float(root.findtext(name) or 0) for name in METASHAPE)
    k1, k2, k3, k4, p1, p2, p3, p4 = lens
    x, y = equidistant(0, 0, 0, 0) if root.findtext("projection") == "fisheye" else (X, Y)
    r = x**2 + y**2
    radial, more = 1 + k1 * r + k2 * r**2 + k3 * r**3 + k4 * r**4, 1 + p3 * r + p4 * r**2
    u = x * radial + (p1 * (r + 2 * x**2) + 2 * p2 * x * y) * more
    v = y * radial + (p2 * (r + 2 * y**2) + 2 * p1 * x * y) * more
    return np.column_stack([width / 2 + cx + u * f + u * b1 + v * b2, height / 2 + cy + v * f])


def mrcal(path: Path) -> Array:
    model = ast.literal_eval(path.read_text())
    K, D = model["intrinsics"][:4], model["intrinsics"][4:]
    assert model["lensmodel"] == (f"LENSMODEL_OPENCV{len(D)}" if D else "LENSMODEL_PINHOLE")
    return at_centres(K, brown(X, Y, *(D or [0.0] * 4)))


def colmap(path: Path) -> Array:
    for name in ("images", "points3D"):
        path.with_name(name + path.suffix).write_bytes(b"" if path.suffix == ".txt" else bytes(8))
    peer = pycolmap.Reconstruction()
    (peer.read_text if path.suffix == ".txt" else peer.read_binary)(str(path.parent))
    [seen] = peer.cameras.values()
    return np.asarray(seen.img_from_cam(RAYS))


LENSES: dict[str, tuple[Distortion, ...]] = {
    "opencv": (BROWN, EIGHT, TWELVE, FOURTEEN, FISHEYE, MEI),
    "colmap": (NoDistortion(), FOUR, EIGHT, FISHEYE, PRISMS),
}
WRITTEN: tuple[tuple[str, str, Seen, tuple[Distortion, ...]], ...] = (
    ("opencv_storage", "camera.yml", opencv, LENSES["opencv"]),
    ("opencv_storage", "camera.xml", opencv, LENSES["opencv"]),
    ("opencv_storage", "camera.json", opencv, LENSES["opencv"]),
    ("numpy_npz", "camera.npz", numpys, LENSES["opencv"]),
    ("colmap_text", "cameras.txt", colmap, LENSES["colmap"]),
    ("colmap_binary", "cameras.bin", colmap, LENSES["colmap"]),
    ("kalibr", "chain.yaml", kalibr, (NoDistortion(), FOUR, FISHEYE, FOV, MEI, EUCM, SPHERES)),
    ("ros_camera_info", "front.yaml", ros, (NoDistortion(), BROWN, EIGHT, FISHEYE)),
    ("opensfm", "camera_models.json", opensfm, (NoDistortion(), BROWN, FISHEYE)),
    ("odm_cameras", "cameras.json", opensfm, (NoDistortion(), BROWN)),
    ("agisoft_xml", "camera.xml", metashape, (NoDistortion(), BROWN, FRAME, FISHEYE)),
    ("mrcal", "camera.cameramodel", mrcal, (NoDistortion(), FOUR, BROWN, EIGHT, TWELVE)),
)


def cases() -> Iterator[Any]:
    for target, name, seen, lenses in WRITTEN:
        for lens in lenses:
            yield pytest.param(target, name, seen, lens, id=f"{target}-{Path(name).suffix}-{lens.model}")


@pytest.mark.parametrize(("target", "name", "seen", "lens"), list(cases()))
def test_the_target_sees_what_the_camera_sees(
    target: str, name: str, seen: Seen, lens: Distortion, tmp_path: Path
) -> None:
    item, path = camera(lens), tmp_path / name
    parsers.write([item], path, target)
    np.testing.assert_allclose(seen(path), item.project(RAYS), rtol=0, atol=1e-6)


def test_numpy_loads_the_matrix(tmp_path: Path) -> None:
    item, path = camera(None), tmp_path / "K.npy"
    parsers.write([item], path, "k_npy")
    np.testing.assert_array_equal(np.load(path, allow_pickle=False), item.intrinsics.matrix)


EXTRAS: dict[str, Any] = {
    "session": "Tue Oct  8 10:53:15 2024",
    "camera_note": 'left: "front" # 2, <a & b>',
    "serial": "00123",
    "empty_note": "",
    "switch": "no",
    "delay": -3,
    "square_size": 25.4,
    "grid_points": np.arange(12, dtype=np.float32).reshape(4, 3),
    "image_points": np.arange(24, dtype=np.float32).reshape(4, 3, 2),
    "per_view_errors": np.array([[0.25], [0.5]]),
}


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
@pytest.mark.parametrize("target", [".yml", ".xml", ".json"])
def test_opencv_reads_the_extras_it_wrote(suffix: str, target: str, tmp_path: Path) -> None:
    K = np.array([[3650.1, 0, 2740.8], [0, 3648.7, 1815.4], [0, 0, 1]])
    stated: dict[str, Any] = {"image_width": 5472, "image_height": 3648, "camera_matrix": K, **EXTRAS}
    given, path = tmp_path / f"given{suffix}", tmp_path / f"made{target}"
    storage = cv2.FileStorage(str(given), cv2.FILE_STORAGE_WRITE)
    for name, value in stated.items():
        storage.write(name, value)
    storage.release()
    parsers.write(parsers.read(given), path, "opencv_storage")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    for name, value in stated.items():
        node = storage.getNode(name)
        if isinstance(value, str):
            assert node.string() == value, name
        else:
            np.testing.assert_array_equal(
                node.mat() if isinstance(value, np.ndarray) else node.real(), value, name
            )
