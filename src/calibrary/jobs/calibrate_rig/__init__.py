"""Calibrate the lenses and the relative poses of cameras that see one board at the same time.

>>> from calibrary.jobs.calibrate_rig import calibrate_rig
>>> result = calibrate_rig(corners="rig/rig.json")
>>> result.reference, list(result.poses)
('cam0', ['cam1'])
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta

from calibrary.arguments import CameraLike, Edge, File, Folder, LensModel, Place, Stated, Text, Workers, paths
from calibrary.errors import UsageError
from calibrary.known_camera import CameraKey
from calibrary.progress import Progress
from calibrary.view import view_of

if TYPE_CHECKING:
    from calibrary.calib.corners_arrays import Corners
    from calibrary.jobs.calibrate_rig.report import RigReport

    RigCornersLike: TypeAlias = str | Path | Mapping[str, Corners]
else:
    RigCornersLike = File  # the class loads NumPy, and a flag never gives one

__all__ = ["calibrate_rig"]


def calibrate_rig(
    frames: Folder | Sequence[Folder] = (),
    *,
    board: Annotated[str, Meta(title="BOARD")] | None = None,
    square_mm: Edge | None = None,
    marker_mm: Edge | None = None,
    pattern: Annotated[str, Meta(title="PATTERN")] | None = None,
    in_order: bool = False,
    reference: Annotated[str, Meta(title="CAMERA")] | None = None,
    corners: RigCornersLike | None = None,
    camera: CameraLike | None = None,
    focus: Text | None = None,
    lens_model: LensModel = "auto",
    flat: bool = False,
    stated: Stated | None = None,
    compare: File | None = None,
    html: File | None = None,
    keep_corners: Folder | None = None,
    out: File | None = None,
    to: Literal["kalibr", "opencv", "colmap", "micasense"] | None = None,
    registry: Place | None = None,
    rig_name: str | None = None,
    workers: Workers = 0,
    progress: Progress | None = None,
) -> RigReport:
    """Calibrate K and distortion of every camera of a rig and their relative poses, in one adjustment.

    The result becomes entries with ``open_registry(registry).propose_entries(result.entries)``.

    Args:
        frames: folders, one for each camera; or files, folders or patterns whose names state camera and shot, as a
            payload writes them or as ``pattern`` says.
        board: the board, in inner corners: checkerboard:11x8 (default: found by trying, unless of circles).
        square_mm: side of a square; for circles, the distance of their centres. Distances between cameras scale with
            it.
        marker_mm: side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square).
        pattern: how names state camera and shot, such as '{camera}/{shot}.png'; * is anything.
        in_order: pair the n-th frames of all folders.
        reference: the camera to which poses refer (default: the first).
        corners: the rig.json of an earlier run instead of frames; or a table of corners as of ``calibrate``, whose
            images are named as frames are. In Python also ``calibrary.Corners`` by camera: views of one name, or of
            one number, belong together.
        camera: facts about the cameras, the same for all, that the images do not state or state wrongly.
        focus: how the lenses were focused: "locked at infinity".
        lens_model: distortion model; auto chooses one for each camera by the corners.
        flat: assume that the board is flat, instead of testing it for a warp.
        stated: day and operator of the calibration (default: the day of the images, else today).
        compare: show how far the poses of this rig's file are from these.
        html: a page with every number and plot.
        keep_corners: folder that keeps the corners, as rig.json and a file for each camera, for ``corners``.
        out: the rig as another program's file; not written if the rig is refused.
        to: format of ``out`` (default: by its name: camchain.yaml, extrinsics.yml, rig_config.json).
        registry: the registry in which each camera becomes a draft; needs ``rig_name``.
        rig_name: name of the rig in the entries.
        workers: processes that find the board; 0 chooses their number.
        progress: called with (images done, number of images, "frames").

    Raises:
        UsageError: the arguments do not go together.
        InputError: the pairing of the images is ambiguous, or a file cannot be read or written.
        CalibrationError: no image of a camera shows the board, or the corners do not determine a camera.
        MissingExtraError: OpenCV is not installed.
    """
    from calibrary.calib.board import parse_board
    from calibrary.calib.lens_models import Solvable
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.calibrate.frames import Told
    from calibrary.jobs.calibrate.outputs import Outputs
    from calibrary.jobs.calibrate.pairing import find_rig
    from calibrary.jobs.calibrate.report import Asked
    from calibrary.jobs.calibrate.run import not_in_future, stated_camera
    from calibrary.jobs.calibrate_rig.report import encoder, rig_report
    from calibrary.jobs.calibrate_rig.run import (
        corner_files,
        detect_rig,
        folder_of_corners,
        rig_from_arrays,
        rig_from_table,
        saved_rig,
        solved_rig,
    )
    from calibrary.parsers.rigs import read_rig
    from calibrary.records import replace

    given = paths(frames)
    if bool(given) is (corners is not None):
        raise UsageError("expected frames or --from FILE, and one of them only")
    file = Path(corners) if isinstance(corners, str | Path) else None
    arrays = None if corners is None or isinstance(corners, str | Path) else corners
    if (given or arrays or (file is not None and file.suffix.lower() != ".json")) and square_mm is None:
        raise UsageError("distances between cameras need the side of a square: say --square-mm MM")
    if pattern is not None and in_order:
        raise UsageError("--pattern and --in-order are two ways to pair frames; give one")
    if (registry is None) is not (rig_name is None):
        raise UsageError("entries of a rig name it: say --registry PATH and --rig-name NAME, or neither")
    outputs = Outputs.of(encoder, html=html, corners=folder_of_corners(keep_corners), out=out, to=to)
    require(CALIBRATE, "a calibration")
    Solvable.named(lens_model)
    told = Told(camera=stated_camera(camera, registry), focus=focus, stated=not_in_future(stated))
    other = read_rig(Path(compare)) if compare is not None else None
    named = parse_board(board, square_mm, marker_mm) if board is not None else None
    if arrays is not None:
        detections = rig_from_arrays(arrays, told, named, square_mm, reference)
    elif file is not None and file.suffix.lower() != ".json":
        size = camera.image_size if isinstance(camera, CameraKey) else None
        detections = rig_from_table(file, replace(told, image_size=size), named, pattern, reference)
    elif file is not None:
        detections = saved_rig(file, told, reference)
    else:
        found = find_rig(given, pattern=pattern, in_order=in_order, reference=reference)
        detections = detect_rig(found, named or square_mm, told, workers=workers, progress=progress)
    asked = Asked(model=lens_model, warp=not flat)
    result = solved_rig(detections, asked, told, corners_from=file)
    report = rig_report(result, detections, asked, compared=other, name=rig_name)
    return outputs.write(report, view_of, lambda folder: corner_files(detections, folder))
