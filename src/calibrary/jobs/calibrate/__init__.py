"""Calibrate a camera from frames of a board, and write the board.

>>> from calibrary.jobs.calibrate import calibrate
>>> result = calibrate("frames", board="checkerboard:9x6", square_mm=40)
>>> result.verdict, result.calibration.camera.model
(<Use.START: 'start'>, 'Board One')
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta

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

    CornersLike: TypeAlias = str | Path | Corners
else:
    CornersLike = File  # the class loads NumPy, and a flag never gives one

__all__ = ["calibrate", "write_board"]


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
    camera: CameraLike | None = None,
    focus: Text | None = None,
    lens_model: LensModel = "auto",
    flat: bool = False,
    seed_k: File | None = None,
    stated: Stated | None = None,
    html: File | None = None,
    keep_corners: File | None = None,
    out: File | None = None,
    to: FormatName | None = None,
    registry: Place | None = None,
    as_: Annotated[str, Meta(title="KEY")] | None = None,
    use: Literal["fixed", "map", "start", "metrology"] = "fixed",
    policy: PolicyLike | None = None,
    workers: Workers = 0,
    progress: Progress | None = None,
) -> CalibrateReport:
    """Calibrate a camera (K and distortion) from images of a board, and assess the result.

    The result becomes an entry with ``open_registry(registry).propose_entries(result.entry)``.

    Args:
        frames: files, folders and patterns; all of one camera at one focus setting. Of a video or a bag of ROS the
            sharpest frames are taken; a topic is named as in flight.bag:/cam0/image_raw.
        board: the board, in inner corners: checkerboard:11x8 (default: found by trying, unless of circles).
        square_mm: side of a square; for circles, the distance of their centres. K does not depend on it; without it,
            poses and the board's warp are in squares.
        marker_mm: side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square).
        skip_other_sizes: skip frames of another size than most frames; otherwise they are an error.
        corners: the corners.json of an earlier run, or the corners of another detector: corners.vnl of mrcal and
            mrgingham, or a CSV with the columns image, x, y and id; these need ``board``, and the image size if the
            frames that they name are not beside them. In Python also ``calibrary.Corners``, arrays as of OpenCV.
        points: points at known places: a table of X,Y,Z,u,v,image in metres and px; needs the image size.
        pixel_origin: pixel origin of a table: the outer corner of the first pixel (default for ``points``), or its
            centre as in OpenCV and mrcal (default for ``corners``).
        camera: facts about the camera that the images do not state or state wrongly.
        focus: how the lens was focused: "locked at infinity".
        lens_model: distortion model; auto chooses it by the corners.
        flat: assume that the board is flat, instead of testing it for a warp.
        seed_k: a K to start from, such as the seed that extract writes.
        stated: day and operator of the calibration (default: the day of the images, else today).
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
        progress: called with (images done, number of images, "frames").

    Raises:
        UsageError: the arguments do not go together.
        InputError: there are no images, they are of several cameras, or a file cannot be read or written.
        CalibrationError: no image shows the board, or the corners do not determine a camera.
        MissingExtraError: OpenCV is not installed.

    >>> result = calibrary.calibrate("frames", board="checkerboard:9x6", square_mm=40)
    >>> result.findings[0].rule
    'few-views'
    """
    from calibrary.calib.board import parse_board
    from calibrary.calib.corners_file import encode_corners
    from calibrary.calib.lens_models import Solvable
    from calibrary.calib.verdict import AskedUse
    from calibrary.calibration import Origin
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.calibrate import run
    from calibrary.jobs.calibrate.frames import Told, recorded
    from calibrary.jobs.calibrate.outputs import Outputs, file_to_write
    from calibrary.jobs.calibrate.report import Asked, encoder, report_of
    from calibrary.records import replace

    given = paths(frames)
    if [bool(given), corners is not None, points is not None].count(True) != 1:
        raise UsageError("expected frames, --from CORNERS or --points CSV, and one of them only")
    file = Path(corners) if isinstance(corners, str | Path) else None
    is_table = corners is not None and (file is None or file.suffix.lower() != ".json")
    if not (given or is_table) and (board or square_mm or marker_mm):
        raise UsageError(
            "--board, --square-mm and --marker-mm are of frames and of other detectors' corners; what a corners.json "
            "and --points hold is known"
        )
    if marker_mm is not None and square_mm is None:
        raise UsageError("--marker-mm needs the size of the squares too: say --square-mm MM")
    kept = file_to_write(keep_corners, "--corners", ".json")
    outputs = Outputs.of(encoder, html=html, corners=kept, out=out, to=to)
    require(CALIBRATE, "a calibration")
    Solvable.named(lens_model)
    told = Told(
        camera=run.stated_camera(camera, registry, as_),
        focus=focus,
        stated=run.not_in_future(stated),
        image_size=camera.image_size if isinstance(camera, CameraKey) else None,
        needs_key=registry is not None or as_ is not None,
        policy=run.policy_for(policy, registry, as_),
    )
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
        guess = (
            run.read_seed(Path(seed_k), detections.observations.image_size) if seed_k is not None else None
        )
        asked = Asked(
            model=lens_model,
            warp=not flat,
            guess_fx=guess.fx if guess is not None else None,
            use=AskedUse(use),
        )
        result = run.solved(
            detections,
            asked,
            told,
            guess=guess,
            corners_from=file,
            corners_to=outputs.corners,
        )
        report = report_of(result, detections, asked)
        return outputs.write(
            report,
            partial(view_of, detections=detections),
            lambda path: {path: encode_corners(detections.observations)},
        )


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
