"""Reader of COLMAP's sparse model: a folder with ``cameras``, ``images`` and ``points3D``, each as .bin or .txt.

In the format's own words, all of it little endian::

    images.bin    uint64 number of images, of each: uint32 image id, double qw qx qy qz, double tx ty tz,
                  uint32 camera id, name up to a zero byte, uint64 number of features, of each: double x y, int64 point
    points3D.bin  uint64 number of points, of each: uint64 id, double x y z, uint8 red green blue, double error,
                  uint64 length of its track, of each: uint32 image id, uint32 feature

The text files contain the same, two lines for an image and one for a point. A feature without a point has the point
−1. Pixel coordinates are relative to the outer corner of the first pixel; world to camera is R(q) x + t.

Source: COLMAP documentation, "Output Format", and ``scripts/python/read_write_model.py``.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from calibrary import parsers
from calibrary.arrays import FloatArray, IntArray
from calibrary.calibration import Calibration, SourceFile
from calibrary.errors import InputError, ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.files import read_regular_file
from calibrary.rotations import from_quaternion
from calibrary.sfm.reconstruction import Reconstruction

PARTS: Final = ("cameras", "images", "points3D")
BELOW: Final = (".", "sparse/0", "0", "sparse")
"""Location of a project's first model relative to the folders that users name."""
MAX_BYTES: Final = 1 << 31
LOOKED_PX: Final = 3200
"""SiftExtractionOptions.max_image_size."""
COUNT: Final = struct.Struct("<Q")
IMAGE: Final = struct.Struct("<I4d3dI")
POINT: Final = struct.Struct("<Q3d3BdQ")
TRACK_BYTES: Final = 8
FEATURE: Final = np.dtype([("xy", "<f8", 2), ("point", "<i8")])


class _Image(NamedTuple):
    """One image: quaternion, translation, camera id, name, (n, 2) px and (n,) ids of the points there."""

    pose: FloatArray
    camera: int
    name: str
    xy: FloatArray
    points: IntArray


def is_colmap_folder(folder: Path) -> bool:
    """Return whether the folder contains such a model or is a project with one."""
    return _home(folder) is not None


def colmap_cameras(folder: Path) -> Path | None:
    """Return the file of the cameras of such a model; None if the folder has none."""
    home = _home(folder)
    return home / f"cameras{_suffix(home)}" if home is not None else None


def read_colmap(folder: Path) -> Reconstruction:
    """Read the model in a folder.

    Raises:
        InputError: a file is missing or cannot be read.
        ParseError: a file is damaged.
    """
    home = _home(folder)
    if home is None:
        raise InputError("expected cameras, images and points3D, each .bin or .txt", source=str(folder))
    suffix = _suffix(home)
    paths = [home / f"{part}{suffix}" for part in PARTS]
    cameras = _cameras(paths[0])
    data = [read_regular_file(path, max_bytes=MAX_BYTES) for path in paths]
    binary = suffix == ".bin"
    images = [*(_images if binary else _images_of_text)(data[1], paths[1].name)]
    ids, points = (_points if binary else _points_of_text)(data[2], paths[2].name)
    if not images or not len(ids):
        raise ParseError("the model holds no images, or no points", source=home.name)
    return _assembled(cameras, images, ids, points, tuple(map(_source, paths, data)))


def _assembled(
    cameras: dict[str, Calibration],
    images: list[_Image],
    ids: IntArray,
    points: FloatArray,
    files: tuple[SourceFile, ...],
) -> Reconstruction:
    named = [str(image.camera) for image in images]
    if len(cameras) == 1 and len(set(named)) == 1:
        cameras = {named[0]: next(iter(cameras.values()))}
    missing = sorted(set(named) - set(cameras))
    if missing:
        raise ParseError(
            f"images are of camera {missing[0]}, which has no K or is missing", source=files[0].name
        )
    poses = np.array([image.pose for image in images])
    if not np.isfinite(poses).all() or not np.linalg.norm(poses[:, :4], axis=1).all():
        raise ParseError("an image's pose is not a rotation and translation", source=files[1].name)
    rotations = np.stack([from_quaternion(pose[:4]) for pose in poses])
    order = np.argsort(ids)
    which = np.concatenate([image.points for image in images])
    at = np.minimum(np.searchsorted(ids, which, sorter=order), len(ids) - 1)
    pixels = np.concatenate([image.xy for image in images])
    # Features can refer to missing points if the model was cropped.
    known = (ids[order[at]] == which) & np.isfinite(pixels).all(axis=1)
    return Reconstruction(
        program="COLMAP",
        cameras=cameras,
        names=tuple(image.name for image in images),
        camera=tuple(named),
        rotations=rotations,
        centres=-np.einsum("vji,vj->vi", rotations, poses[:, 4:]),
        points=points,
        image=np.repeat(np.arange(len(images)), [len(image.points) for image in images])[known],
        point=order[at][known],
        pixels=pixels[known],
        positions=None,
        # Without the camera file: two flights solved with one fixed K share it, but no observations.
        files=files[1:],
        looked_px=LOOKED_PX,
    )


def _home(folder: Path) -> Path | None:
    for below in BELOW:
        home = folder / below
        if any(all((home / f"{part}{suffix}").is_file() for part in PARTS) for suffix in (".bin", ".txt")):
            return home
    return None


def _suffix(home: Path) -> str:
    return ".bin" if (home / "images.bin").exists() else ".txt"


def _cameras(path: Path) -> dict[str, Calibration]:
    found = parsers.read(path, format="colmap_binary" if path.suffix == ".bin" else "colmap_text")
    return {one.camera.sub_camera or "1": one for one in found}


def _source(path: Path, data: bytes) -> SourceFile:
    return SourceFile(name=path.name, sha256=hashlib.sha256(data).hexdigest())


def _images(data: bytes, name: str) -> Iterator[_Image]:
    at = COUNT.size
    for number in range(1, _count(data, IMAGE.size + 1 + COUNT.size, name) + 1):
        place = f"image {number}"
        end = data.find(b"\0", at + IMAGE.size, at + IMAGE.size + 4096)
        if end < 0 or end + 1 + COUNT.size > len(data):
            raise ParseError("the file ends inside it", source=name, place=place)
        _, *pose, camera = IMAGE.unpack_from(data, at)
        label = data[at + IMAGE.size : end].decode("utf-8", "replace")
        [count] = COUNT.unpack_from(data, end + 1)
        at = end + 1 + COUNT.size
        if count > (len(data) - at) // FEATURE.itemsize:
            raise ParseError("the file ends inside it", source=name, place=place)
        features = np.frombuffer(data, FEATURE, count, at)
        at += count * FEATURE.itemsize
        used = features[features["point"] >= 0]
        yield _Image(np.array(pose), camera, label, used["xy"].copy(), used["point"].astype(np.int64))


def _points(data: bytes, name: str) -> tuple[IntArray, FloatArray]:
    at, ids, places = COUNT.size, [], []
    for number in range(1, _count(data, POINT.size, name) + 1):
        if at + POINT.size > len(data):
            raise ParseError("the file ends inside it", source=name, place=f"point {number}")
        identity, x, y, z, *_, length = POINT.unpack_from(data, at)
        ids.append(identity)
        places.append((x, y, z))
        at += POINT.size + TRACK_BYTES * length
    if at > len(data) or (ids and max(ids) >= 1 << 63):
        raise ParseError("the file ends inside its last point", source=name)
    return _finite_points(ids, places, name)


def _count(data: bytes, least: int, name: str) -> int:
    """Return the number at the beginning of a file, checked against the file's size."""
    if len(data) < COUNT.size or COUNT.unpack_from(data)[0] > len(data) // least:
        raise ParseError("the file is shorter than the number it begins with says", source=name)
    return int(COUNT.unpack_from(data)[0])


def _images_of_text(data: bytes, name: str) -> Iterator[_Image]:
    rows = [line for line in strict.decode(data, source=name).split("\n") if not line.startswith("#")]
    # The second line of an image without features is empty, so only an odd empty line at the end can be dropped.
    while rows and not rows[-1].strip() and len(rows) % 2:
        rows.pop()
    if len(rows) % 2:
        raise ParseError("expected two lines for each image", source=name)
    for number in range(0, len(rows), 2):
        place = f"image {number // 2 + 1}"
        parts = rows[number].split(maxsplit=9)
        if len(parts) != 10:
            raise ParseError(f"{len(parts)} columns, expected 10", source=name, place=place)
        pose = strict.numbers(" ".join(parts[1:8]), count=7, place=place)
        camera = strict.whole(parts[8], source=name, place=place)
        features = np.array(strict.numbers(rows[number + 1], place=place)).reshape(-1, 1)
        if len(features) % 3:
            raise ParseError("expected x, y and point of each feature", source=name, place=place)
        features = features.reshape(-1, 3)
        used = features[features[:, 2] >= 0]
        yield _Image(np.array(pose), camera, parts[9].strip(), used[:, :2], used[:, 2].astype(np.int64))


def _points_of_text(data: bytes, name: str) -> tuple[IntArray, FloatArray]:
    ids, places = [], []
    for number, line in enumerate(strict.decode(data, source=name).split("\n"), start=1):
        if line.strip() and not line.startswith("#"):
            place = f"line {number}"
            parts = line.split(maxsplit=4)
            if len(parts) < 5:
                raise ParseError(f"{len(parts)} columns, expected 8 and more", source=name, place=place)
            ids.append(strict.whole(parts[0], source=name, place=place))
            places.append(tuple(strict.numbers(" ".join(parts[1:4]), count=3, place=place)))
    return _finite_points(ids, places, name)


def _finite_points(
    ids: list[int], places: Sequence[tuple[float, ...]], name: str
) -> tuple[IntArray, FloatArray]:
    found = np.array(places).reshape(-1, 3)
    if not np.isfinite(found).all():
        raise ParseError("a point is not finite", source=name)
    return np.array(ids, dtype=np.int64), found
