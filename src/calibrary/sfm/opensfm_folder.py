"""Reader of OpenSfM's and ODM's result: ``reconstruction.json``, and ``tracks.csv`` with the observations.

In the format's own words::

    reconstruction.json   [{"cameras": {NAME: …}, "shots": {IMAGE: {"camera": NAME, "rotation": [x, y, z],
                          "translation": [x, y, z], "gps_position": [east, north, up], "gps_dop": m}},
                          "points": {TRACK: {"coordinates": [x, y, z]}}}, …]
    tracks.csv            OPENSFM_TRACKS_VERSION_v2, then a line for each feature, by tabs: image, track, feature,
                          x, y, scale, red, green, blue, segmentation, instance

rotation is axis times angle; world to camera is R x + t. x and y are relative to the image centre, in units of the
longer side. Of several reconstructions, the largest is read.

Source: OpenSfM documentation, "Reconstruction file format"; ``opensfm/features.py``, ``src/map/src/tracks_manager.cc``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from calibrary import parsers
from calibrary.arrays import FloatArray, IntArray
from calibrary.calibration import Calibration, SourceFile
from calibrary.errors import InputError, ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.files import read_regular_file
from calibrary.parsers.formats._opensfm import plain_name
from calibrary.rotations import rotation_matrix
from calibrary.sfm.image_selection import RECEIVER_STD_M
from calibrary.sfm.reconstruction import Reconstruction
from calibrary.sfm.tracks import Positions
from calibrary.strictjson import parse_json

RECONSTRUCTION: Final = "reconstruction.json"
TRACKS: Final = "tracks.csv"
VERSION: Final = "OPENSFM_TRACKS_VERSION_"
BELOW: Final = (".", "opensfm", "project/opensfm")
"""Location of the files, relative to an ODM project."""
MAX_BYTES: Final = 1 << 31
LOOKED_PX: Final = 2048
"""feature_process_size."""


def is_opensfm_folder(folder: Path) -> bool:
    """Return whether the folder contains a reconstruction with its tracks, or is an ODM project with one."""
    return _home(folder) is not None


def opensfm_cameras(folder: Path) -> Path | None:
    """Return the file of the cameras of such a reconstruction; None if the folder has none."""
    home = _home(folder)
    return home / RECONSTRUCTION if home is not None else None


def read_opensfm(folder: Path) -> Reconstruction:
    """Read the largest reconstruction in a folder.

    Raises:
        InputError: a file is missing or cannot be read.
        ParseError: a file is damaged.
    """
    home = _home(folder)
    if home is None:
        raise InputError(f"expected {RECONSTRUCTION} and {TRACKS}", source=str(folder))
    data = {name: read_regular_file(home / name, max_bytes=MAX_BYTES) for name in (RECONSTRUCTION, TRACKS)}
    document = parse_json(data[RECONSTRUCTION], source=RECONSTRUCTION)
    found = [one for one in document if isinstance(one, dict)] if isinstance(document, list) else []
    if not found:
        raise ParseError("expected a list of reconstructions", source=RECONSTRUCTION)
    try:
        largest: Mapping[str, Any] = max(found, key=_shots)
        return _assembled(largest, data)
    except (KeyError, TypeError, ValueError) as error:
        raise ParseError(
            f"a camera, shot or point is not as OpenSfM writes it: {strict.shown(repr(error))}",
            source=RECONSTRUCTION,
        ) from None


def _home(folder: Path) -> Path | None:
    for below in BELOW:
        home = folder / below
        if (home / RECONSTRUCTION).is_file() and (home / TRACKS).is_file():
            return home
    return None


def _shots(reconstruction: Mapping[str, Any]) -> int:
    return len(reconstruction["shots"])


def _cameras(largest: Mapping[str, Any]) -> dict[str, Calibration]:
    """Read the cameras of one reconstruction only; others in the file may have other parameters for the same name."""
    alone = json.dumps([{"cameras": largest["cameras"]}]).encode()
    found = parsers.decode(alone, name=RECONSTRUCTION, format="opensfm")
    return {plain_name(one.provenance.tag or ""): one for one in found}


def _assembled(largest: Mapping[str, Any], data: Mapping[str, bytes]) -> Reconstruction:
    shots, names = largest["shots"], [*largest["shots"]]
    by_name = _cameras(largest)
    used = [plain_name(str(shots[name]["camera"])) for name in names]
    if missing := sorted(set(used) - set(by_name)):
        raise ParseError(f"camera {strict.shown(missing[0])} has no K or is missing", source=RECONSTRUCTION)
    rotations = np.stack([rotation_matrix(_vector(shots[name]["rotation"])) for name in names])
    moved = np.array([_vector(shots[name]["translation"]) for name in names])
    tracks = {track: number for number, track in enumerate(largest["points"])}
    points = np.array([_vector(one["coordinates"]) for one in largest["points"].values()]).reshape(-1, 3)
    image, point, xy = _observations(data[TRACKS], {name: at for at, name in enumerate(names)}, tracks)
    sizes = np.array([by_name[one].intrinsics.image_size for one in used], dtype=np.float64)[image]
    return Reconstruction(
        program="OpenSfM",
        cameras=by_name,
        names=tuple(names),
        camera=tuple(used),
        rotations=rotations,
        centres=-np.einsum("vji,vj->vi", rotations, moved),
        points=points,
        image=image,
        point=point,
        pixels=xy * sizes.max(axis=1, keepdims=True) + sizes / 2,
        positions=_positions([shots[name] for name in names]),
        files=tuple(
            SourceFile(name=name, sha256=hashlib.sha256(content).hexdigest())
            for name, content in data.items()
        ),
        looked_px=LOOKED_PX,
    )


def _vector(values: Any) -> FloatArray:
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{values!r}, expected three numbers")
    return vector


def _observations(
    data: bytes, shots: Mapping[str, int], tracks: Mapping[str, int]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return (N,) images, (N,) points and (N, 2) normalised coordinates of the observations in the reconstruction."""
    rows = strict.decode(data, source=TRACKS).split("\n")
    if rows[0].startswith(VERSION):
        rows = rows[1:]
    image, point, places = [], [], []
    for number, row in enumerate(rows, start=2):
        parts = row.split("\t")
        if len(parts) < 5:
            if not row.strip():
                continue
            raise ParseError(
                f"{len(parts)} columns, expected 5 and more", source=TRACKS, place=f"line {number}"
            )
        at, track = shots.get(parts[0]), tracks.get(parts[1])
        if at is not None and track is not None:
            image.append(at)
            point.append(track)
            places.append(strict.numbers(f"{parts[3]} {parts[4]}", source=TRACKS, place=f"line {number}"))
    if not image:
        raise ParseError("no line is of an image and a track of the reconstruction", source=TRACKS)
    return np.array(image, dtype=np.intp), np.array(point, dtype=np.intp), np.array(places)


def _positions(shots: list[Mapping[str, Any]]) -> Positions | None:
    """Return the stated positions of the images, in the reconstruction's frame; None if there are none."""
    places = np.full((len(shots), 3), np.nan)
    std = np.tile(RECEIVER_STD_M, (len(shots), 1))
    for row, shot in enumerate(shots):
        if shot.get("gps_position") is None:
            continue
        places[row] = _vector(shot["gps_position"])
        # Small values are RTK standard deviations found by ODM; a dilution of precision is not a standard deviation.
        across = float(shot.get("gps_dop") or 0.0)
        if 0 < across < RECEIVER_STD_M[0]:
            std[row] = across, across, 1.5 * across
    return Positions(places=places, std=std) if np.isfinite(places).any() else None
