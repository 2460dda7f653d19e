"""Calibrate a camera from frames of a board or the images of a flight, or the cameras of a rig; write a board.

>>> from calibrary.jobs.calibrate import calibrate
>>> result = calibrate("frames", board="checkerboard:9x6", square_mm=40)
>>> result.verdict, result.calibration.camera.model
(<Use.START: 'start'>, 'Board One')
>>> result = calibrate_rig(corners="rig/rig.json")
>>> result.reference, list(result.poses)
('cam0', ['cam1'])
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta, Struct

from calibrary.arguments import (
    CameraLike,
    Edge,
    File,
    Folder,
    FormatName,
    LensModel,
    Place,
    PolicyLike,
    Stated,
    Text,
    Workers,
    paths,
)
from calibrary.errors import UsageError
from calibrary.known_camera import CameraKey
from calibrary.progress import Progress
from calibrary.view import view_of

if TYPE_CHECKING:
    from calibrary.calib.board import Board
    from calibrary.calib.corners_arrays import Corners
    from calibrary.calib.printing import Page
    from calibrary.jobs.calibrate.report import CalibrateReport
    from calibrary.jobs.calibrate.rig_report import RigReport

    CornersLike: TypeAlias = str | Path | Corners
    RigCornersLike: TypeAlias = str | Path | Mapping[str, Corners]
else:
    CornersLike = RigCornersLike = File  # the class loads NumPy, and a flag never gives one

__all__ = ["Flight", "calibrate", "calibrate_rig", "write_board"]

UseName: TypeAlias = Literal["fixed", "map", "start", "metrology"]
"""A use that K has to be good for."""


class Flight(Struct, frozen=True, kw_only=True):
    """How a flight is calibrated.

    Attributes:
        most: number of images to choose (default: 30; from a reconstruction 60).
        result_of: a finished reconstruction: COLMAP's cameras, images and points3D (.bin or .txt), or
            reconstruction.json and tracks.csv of OpenSfM or ODM. The images may then be left out: they state the
            camera and where it was, and limit which images are used.
        camera_number: which camera of a reconstruction with several, from 1, if no image states it.
        from_registry: start from the K of this entry of the registry.
        max_side_px: image size for finding points (default: 1600); twice the size takes four times the time and
            memory.
        points_std_m: σ of each coordinate of a surveyed point (default: 0.03).
        mark_std_px: σ of each coordinate of a mark (default: 1).
        same_datum_m: positions in the images have the points' datum and height system, within this σ (default: the
            offset is unknown).
    """

    most: Annotated[int, Meta(ge=3, le=200)] | None = None
    result_of: Folder | None = None
    camera_number: Annotated[int, Meta(ge=1)] | None = None
    from_registry: Annotated[str, Meta(title="KEY")] | None = None
    max_side_px: Annotated[int, Meta(ge=400, le=8000)] | None = None
    points_std_m: Annotated[float, Meta(ge=1e-4, le=100)] | None = None
    mark_std_px: Annotated[float, Meta(ge=0.01, le=100)] | None = None
    same_datum_m: Annotated[float, Meta(ge=0.001, le=1000)] | None = None


def calibrate(
    frames: Folder | Sequence[Folder] = (),
    *,
    board: Annotated[str, Meta(title="BOARD")] | None = None,
    square_mm: Edge | None = None,
    marker_mm: Edge | None = None,
    skip_other_sizes: bool = False,
    corners: CornersLike | None = None,
    points: File | None = None,
    pixel_origin: Literal["corner", "centre"] | None = None,
    flight: Flight | None = None,
    camera: CameraLike | None = None,
    focus: Text | None = None,
    lens_model: LensModel = "auto",
    flat: bool = False,
    seed_k: Annotated[str | float | Path, Meta(title="K")] | None = None,
    stated: Stated | None = None,
    html: File | None = None,
    keep_corners: File | None = None,
    out: File | None = None,
    to: FormatName | None = None,
    registry: Place | None = None,
    as_: Annotated[str, Meta(title="KEY")] | None = None,
    use: UseName = "fixed",
    policy: PolicyLike | None = None,
    workers: Workers = 0,
    progress: Progress | None = None,
) -> CalibrateReport:
    """Calibrate a camera (K and distortion) from images of a board or of a flight, and assess the result.

    The result becomes an entry with ``open_registry(registry).propose_entries(result.entry)``.

    Args:
        frames: files, folders and patterns; all of one camera at one focus setting. Of a board in a video or a bag of
            ROS the sharpest frames are taken; a topic is named as in flight.bag:/cam0/image_raw.
        board: the board, in inner corners: checkerboard:11x8 (default: found by trying, unless of circles).
        square_mm: side of a square; for circles, the distance of their centres. K does not depend on it; without it,
            poses and the board's warp are in squares.
        marker_mm: side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square).
        skip_other_sizes: skip frames of another size than most frames; otherwise they are an error.
        corners: the corners.json of an earlier run, or the corners of another detector: corners.vnl of mrcal and
            mrgingham, or a CSV with the columns image, x, y and id; these need ``board``, and the image size if the
            frames that they name are not beside them. In Python also ``calibrary.Corners``, arrays as of OpenCV.
        points: points at known places: a table of X,Y,Z,u,v,image in metres and px; needs the image size. Of a flight
            its surveyed points, also as the gcp_list.txt of ODM (coordinate system, then x y z im_x im_y image [name]).
        pixel_origin: pixel origin of a table: the outer corner of the first pixel (default for ``points``), or its
            centre as in OpenCV and mrcal (default for ``corners``).
        flight: the images are of a flight, and show no board.
        camera: facts about the camera that the images do not state or state wrongly.
        focus: how the lens was focused: "locked at infinity".
        lens_model: distortion model; auto chooses it by the corners.
        flat: assume that the board is flat, instead of testing it for a warp.
        seed_k: a K to start from: a calibration file, such as the seed that extract writes, or a focal length in px.
        stated: day and operator of the calibration (default: the day of the images; of a board's else today).
        html: a page with every number and plot.
        keep_corners: keep the corners for ``corners``, .json; also if they do not determine a camera.
        out: K and distortion as a calibration file; not written if the calibration is refused.
        to: format of ``out``, or the program that reads it (default: by its suffix).
        registry: the registry in which it becomes a draft; a camera without make and model is then refused at once.
        as_: it is for the camera of this entry.
        use: what K has to be good for: to be kept fixed in a solver, the same in maps whose heights GNSS alone places,
            to start a solver from, or to measure with.
        policy: limits of each use: fleet, source or your own file (default: that of ``registry``, else fleet).
        workers: processes that find the board; 0 chooses their number.
        progress: called with (done, total, what).

    Raises:
        UsageError: the arguments do not go together.
        InputError: there are no images, they are of several cameras, or a file cannot be read or written.
        CalibrationError: no image shows the board, the images cannot be matched, or they do not determine a camera.
        MissingExtraError: OpenCV is not installed, or for a flight pycolmap.

    >>> result = calibrary.calibrate("frames", board="checkerboard:9x6", square_mm=40)
    >>> result.findings[0].rule
    'few-views'
    >>> from calibrary.jobs.calibrate import Flight
    >>> calibrary.calibrate(flight=Flight(result_of="sparse")).findings[0].rule
    'unproven-region'
    """
    from calibrary.calib.board import parse_board
    from calibrary.calib.corners_file import encode_corners
    from calibrary.calib.lens_models import Solvable
    from calibrary.calib.verdict import AskedUse
    from calibrary.calibration import Origin
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.calibrate import run
    from calibrary.jobs.calibrate.flight import solve_flight
    from calibrary.jobs.calibrate.frames import Told, recorded
    from calibrary.jobs.calibrate.outputs import Outputs, file_to_write
    from calibrary.jobs.calibrate.report import Asked, CalibrateReport, encoder
    from calibrary.records import replace

    Solvable.named(lens_model)
    given = paths(frames)
    file = Path(corners) if isinstance(corners, str | Path) else None
    of_corners = (board, square_mm, marker_mm)
    if flight is not None:
        if any(one is not None for one in (*of_corners, corners, pixel_origin, keep_corners)):
            raise UsageError("a flight has no board, and no corners of one")
    elif [bool(given), corners is not None, points is not None].count(True) != 1:
        raise UsageError("expected frames, --from CORNERS or --points CSV, and one of them only")
    is_table = corners is not None and (file is None or file.suffix.lower() != ".json")
    if not (given or is_table) and any(of_corners):
        raise UsageError(
            "--board, --square-mm and --marker-mm are of frames and of other detectors' corners; what a corners.json "
            "and --points hold is known"
        )
    if marker_mm is not None and square_mm is None:
        raise UsageError("--marker-mm needs the size of the squares too: say --square-mm MM")
    kept = file_to_write(keep_corners, "--corners", ".json")
    outputs = Outputs.of(encoder, html=html, corners=kept, out=out, to=to)
    told = Told(
        camera=run.stated_camera(camera, registry, as_),
        focus=focus,
        stated=run.not_in_future(stated),
        image_size=camera.image_size if isinstance(camera, CameraKey) else None,
        needs_key=registry is not None or as_ is not None,
        policy=run.policy_for(policy, registry, as_),
    )
    asked = Asked(model=lens_model, warp=not flat and flight is None, use=AskedUse(use))
    if flight is not None:
        result, detections, guess = solve_flight(
            given, flight, told, asked, points=points, start=seed_k, registry=registry, progress=progress
        )
        report = CalibrateReport.of(
            result, detections, replace(asked, guess_fx=guess.fx if guess is not None else None)
        )
        return outputs.write(report, partial(view_of, detections=detections), lambda _: {})
    require(CALIBRATE, "a calibration")
    named = parse_board(board, square_mm, marker_mm) if board is not None else None
    found_before = corners if file is None else file
    origin = {"corner": Origin.CORNER, "centre": Origin.PIXEL_CENTRE}.get(pixel_origin or "")
    with recorded(given) if given else nullcontext(((), ())) as (images, notes):
        if points is not None:
            detections = run.detections_from_points(Path(points), told, origin or Origin.CORNER)
        elif found_before is not None and not isinstance(found_before, str):
            detections = run.detections_from_corners(found_before, told, named, origin, square_mm)
        else:
            detections = run.detections_from_frames(
                images,
                named or square_mm,
                told,
                skip_other_sizes=skip_other_sizes,
                workers=workers,
                progress=progress,
            )
        detections = replace(detections, notes=(*notes, *detections.notes))
        size = detections.observations.image_size
        guess = run.starting_k(seed_k, size) if seed_k is not None else None
        result = run.solved(
            detections, asked, told, guess=guess, corners_from=file, corners_to=outputs.corners
        )
        report = CalibrateReport.of(
            result, detections, replace(asked, guess_fx=guess.fx if guess is not None else None)
        )
        return outputs.write(
            report,
            partial(view_of, detections=detections),
            lambda path: {path: encode_corners(detections.observations)},
        )


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
    use: UseName = "fixed",
    policy: PolicyLike | None = None,
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
        use: what K of every camera has to be good for, as of ``calibrate``.
        policy: limits of each use: fleet, source or your own file (default: that of ``registry``, else fleet).
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
    from calibrary.calib.verdict import AskedUse
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.calibrate.frames import Told
    from calibrary.jobs.calibrate.outputs import Outputs
    from calibrary.jobs.calibrate.pairing import find_rig
    from calibrary.jobs.calibrate.report import Asked
    from calibrary.jobs.calibrate.rig import (
        corner_files,
        detect_rig,
        folder_of_corners,
        rig_from_arrays,
        rig_from_table,
        saved_rig,
        solved_rig,
    )
    from calibrary.jobs.calibrate.rig_report import encoder, rig_report
    from calibrary.jobs.calibrate.run import not_in_future, policy_for, stated_camera
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
    told = Told(
        camera=stated_camera(camera, registry),
        focus=focus,
        stated=not_in_future(stated),
        policy=policy_for(policy, registry),
    )
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
    asked = Asked(model=lens_model, warp=not flat, use=AskedUse(use))
    result = solved_rig(detections, asked, told, corners_from=file)
    report = rig_report(result, detections, asked, compared=other, name=rig_name)
    return outputs.write(report, view_of, lambda folder: corner_files(detections, folder))


def write_board(
    board: Annotated[str, Meta(title="BOARD")],
    out: File,
    *,
    square_mm: Edge,
    marker_mm: Edge | None = None,
    page: Annotated[str, Meta(title="PAGE")] | None = None,
) -> tuple[Board, Page]:
    """Write a board to scale as PDF or SVG; return the board and its page.

    Args:
        board: pattern and number of inner corners, such as checkerboard:11x8.
        out: a .pdf or .svg file.
        square_mm: side of a square; for circles the distance of centres, for an aprilgrid from tag to tag.
        marker_mm: side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square).
        page: a0 … a4, letter, tabloid or WIDTHxHEIGHT in mm (default: the smallest A size on which the board fits).

    Raises:
        InputError: the board type or page is unknown, the board is too large, or the file cannot be written.
        MissingExtraError: OpenCV is not installed.

    >>> from calibrary.jobs.calibrate import write_board
    >>> board, page = write_board("checkerboard:9x6", "board.svg", square_mm=25)
    >>> page.width_mm, page.height_mm
    (420.0, 297.0)
    """
    from calibrary.atomic import write_files
    from calibrary.calib.board import parse_board
    from calibrary.calib.printing import lay_out, page_size, to_pdf, to_svg
    from calibrary.errors import InputError
    from calibrary.extras import CALIBRATE, require

    require(CALIBRATE, "a board")
    write = {".pdf": to_pdf, ".svg": to_svg}.get(Path(out).suffix.lower())
    if write is None:
        raise InputError("expected a file that ends in .pdf or .svg", source=str(out))
    made = parse_board(board, square_mm, marker_mm)
    laid = lay_out(made, page_size(page) if page else None)
    write_files({Path(out): write(made, laid)})
    return made, laid
