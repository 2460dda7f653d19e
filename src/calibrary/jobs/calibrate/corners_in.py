"""Corners in place of frames: of an earlier run, or found by another program, in a file or in arrays."""

from __future__ import annotations

import hashlib
from pathlib import Path

from calibrary.calib.board import Board, Pattern
from calibrary.calib.corners_arrays import Corners, views_of
from calibrary.calib.corners_file import read_corners, read_table
from calibrary.calib.corners_table import CornersTable, is_corners_table, read_corners_table
from calibrary.calib.detection import Detections, NamedRemark
from calibrary.calib.found import Reason
from calibrary.calibration import Origin, canonical_from_file
from calibrary.errors import InputError
from calibrary.jobs.calibrate.frames import FrameMetadata, Told, describe_frames, observed
from calibrary.jobs.calibrate.pairing import RigFrames, pair_names
from calibrary.parsers.files import sha256_of
from calibrary.provenance import SourceFile
from calibrary.records import replace


def corners_of_file(
    path: Path,
    told: Told,
    *,
    board: Board | None = None,
    origin: Origin | None = None,
) -> Detections:
    """Read the observations from a corners.json, a corners.vnl of mrcal, or a CSV of corners.

    A table names its frames. If these are in the same folder, the image size and the camera are read from them.

    Args:
        path: the file.
        told: what the user states; the image size, if the frames are not in the folder of a table.
        board: of the corners; needed for a table, a corners.json states it.
        origin: pixel origin of a table; None for the centre of the first pixel, as detectors use.

    Raises:
        InputError: the file cannot be read, or a required argument is missing.
        ParseError: the file is broken.
    """
    content = read_table(path)
    if not is_corners_table(content):
        if board is not None or origin is not None:
            raise InputError(
                "a corners.json states its board and its pixel origin; leave --board and --pixel-origin out",
                source=path.name,
            )
        found = _of_json(path, told)
        told.check_size(found.observations.image_size, "its corners", path.name)
        return found
    table = _table_of(path, content, board)
    if (rig := pair_names(list(table.views))) is not None:
        raise InputError(
            f"has corners of {len(rig.cameras)} cameras, {', '.join(rig.cameras)} ({rig.how}); solve them with --rig",
            source=path.name,
        )
    found = _of_table(path, content, table, told, origin=origin)
    told.check_size(found.observations.image_size, "its corners", path.name)
    return found


def corners_of_rig_table(
    path: Path,
    told: Told,
    *,
    board: Board | None = None,
    pattern: str | None = None,
    reference: str | None = None,
) -> tuple[dict[str, Detections], RigFrames]:
    """Read the observations of several cameras from one table, and which of its images were taken together.

    Args:
        path: the file.
        told: what the user states; the image size, if the frames are not in the folder of the table.
        board: of the corners.
        pattern: how the images' names state camera and shot.
        reference: the camera to which poses refer.

    Raises:
        InputError: the file cannot be read, or its images' names do not say camera and shot.
        ParseError: the file is broken.
    """
    content = read_table(path)
    table = _table_of(path, content, board)
    rig = pair_names(list(table.views), pattern, reference)
    if rig is None:
        raise InputError(
            "the names of its images do not say camera and shot; say --pattern, such as '{camera}-{shot}.png'",
            source=path.name,
        )
    cameras = {}
    for name in rig.cameras:
        own = {str(image): table.views[str(image)] for image in rig.of(name)}
        cameras[name] = _of_table(path, content, replace(table, views=own, empty=()), told)
    return cameras, rig


def corners_of_arrays(
    corners: Corners,
    told: Told,
    *,
    board: Board | None = None,
    square_mm: float | None = None,
    origin: Origin | None = None,
) -> Detections:
    """Take the observations from arrays.

    Args:
        corners: the arrays.
        told: what the user states.
        board: of points that are given by their numbers.
        origin: pixel origin; None for the centre of the first pixel, as detectors use.
        square_mm: distance of neighbouring object points, if they are given in another unit.

    Raises:
        InputError: the arrays do not go together.
    """
    points, size, views = views_of(corners, board, square_mm)
    shift = canonical_from_file((0.0, 0.0), origin or Origin.PIXEL_CENTRE, size)
    shifted = (replace(view, image_points=view.image_points + shift) for view in views)
    return Detections(observations=observed(points, size, shifted, FrameMetadata(setting=None), told))


def _table_of(path: Path, content: bytes, board: Board | None) -> CornersTable:
    if board is None:
        raise InputError(
            "a table of corners does not name the board; say --board, such as --board checkerboard:10x10",
            source=path.name,
        )
    if board.pattern is Pattern.APRILGRID:
        raise InputError(
            "the corners of an AprilGrid are numbered differently by every program; calibrate from the frames",
            source=path.name,
        )
    return read_corners_table(content, board, source=path.name)


def _of_table(
    path: Path,
    content: bytes,
    table: CornersTable,
    told: Told,
    *,
    origin: Origin | None = None,
) -> Detections:
    """The observations of a corners.vnl or CSV, with the frames in its folder."""
    frames = _frames_beside(path, table)
    metadata = describe_frames(list(frames.values()), told) if frames else FrameMetadata(setting=None)
    size = metadata.setting.image_size if metadata.setting is not None else told.image_size
    if size is None:
        raise InputError(
            f"its frames, such as {next(iter(table.views))}, are not beside it, and it states no image size; say "
            "--image-size WxH",
            source=path.name,
        )
    shift = canonical_from_file((0.0, 0.0), origin or Origin.PIXEL_CENTRE, size)
    views = (
        replace(
            view,
            image_points=view.image_points + shift,
            sha256=sha256_of(frames[name]) if name in frames else None,
        )
        for name, view in table.views.items()
    )
    observations = replace(
        observed(table.board, size, views, metadata, told),
        source=SourceFile(name=path.name, sha256=hashlib.sha256(content).hexdigest()),
    )
    return Detections(
        observations=observations,
        rejected=tuple(_empty(path, name) for name in table.empty),
        notes=(*metadata.notes, *_notes(path, table)),
        files={
            view.sha256: frames[name]
            for name, view in zip(table.views, observations.views, strict=True)
            if view.sha256 is not None
        },
    )


def _of_json(path: Path, told: Told) -> Detections:
    kept = read_corners(path)
    camera = replace(told.camera(replace(kept.camera, firmware=kept.firmware)), image_size=kept.image_size)
    return Detections(
        observations=replace(
            kept,
            camera=camera,
            firmware=camera.firmware,
            focus=told.focus if told.focus is not None else kept.focus,
        )
    )


def _frames_beside(path: Path, table: CornersTable) -> dict[str, Path]:
    """The frames that a table names, by name; empty unless all of them exist."""
    found: dict[str, Path] = {}
    for name, view in table.views.items():
        places = (path.parent / name, path.parent / view.name)
        frame = next((place for place in places if place.is_file()), None)
        if frame is None:
            return {}
        found[name] = frame
    return found


def _empty(path: Path, name: str) -> NamedRemark:
    return NamedRemark(name=name, reason=Reason.NO_BOARD, message=f"{path.name} has no corners of it")


def _notes(path: Path, table: CornersTable) -> list[str]:
    if not table.coarse:
        return []
    total = sum(len(view.ids) for view in table.views.values())
    return [
        f"{table.coarse} of {total} corners of {path.name} were measured in a smaller copy of their frame (level > 0); "
        "they count as much as the others"
    ]
