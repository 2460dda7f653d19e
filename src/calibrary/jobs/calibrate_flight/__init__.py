"""Calibrate a camera from the images of a flight themselves, without a board.

>>> from calibrary.jobs.calibrate_flight import calibrate_flight
>>> result = calibrate_flight(result_of="sparse")
>>> result.verdict, result.findings[0].rule
(<Use.START: 'start'>, 'unproven-region')
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, Struct

from calibrary.arguments import CameraLike, File, Folder, FormatName, Place, Stated, Text, paths
from calibrary.errors import UsageError
from calibrary.known_camera import CameraKey
from calibrary.progress import Progress
from calibrary.view import view_of

if TYPE_CHECKING:
    from calibrary.jobs.calibrate.report import CalibrateReport

__all__ = ["GroundControl", "calibrate_flight"]


class GroundControl(Struct, frozen=True, kw_only=True):
    """Ground control.

    Attributes:
        points: surveyed points and the marks that show where images see them: the gcp_list.txt of ODM (coordinate
            system, then x y z im_x im_y image [name]), or the table of ``calibrate --points``.
        points_std_m: σ of each coordinate of a point.
        mark_std_px: σ of each coordinate of a mark.
        same_datum_m: positions in the images have the points' datum and height system, within this σ (default: the
            offset is unknown).

    Raises:
        UsageError: there are no points.
    """

    points: File | None = None
    points_std_m: Annotated[float, Meta(ge=1e-4, le=100)] = 0.03
    mark_std_px: Annotated[float, Meta(ge=0.01, le=100)] = 1.0
    same_datum_m: Annotated[float, Meta(ge=0.001, le=1000)] | None = None

    def __post_init__(self) -> None:
        if self.points is None:
            raise UsageError(
                "--points-std-m, --mark-std-px and --same-datum-m are of ground control, --points FILE"
            )


def calibrate_flight(
    images: Folder | Sequence[Folder] = (),
    *,
    most: Annotated[int, Meta(ge=3, le=200)] | None = None,
    result_of: Folder | None = None,
    camera_number: Annotated[int, Meta(ge=1)] | None = None,
    control: GroundControl | None = None,
    start: Annotated[str | float | Path, Meta(title="K")] | None = None,
    from_registry: Annotated[str, Meta(title="KEY")] | None = None,
    lens_model: Literal["auto", "k1k2", "k1k2p1p2", "brown", "rational", "fisheye"] = "auto",
    max_side_px: Annotated[int, Meta(ge=400, le=8000)] | None = None,
    camera: CameraLike | None = None,
    focus: Text | None = None,
    stated: Stated | None = None,
    html: File | None = None,
    out: File | None = None,
    to: FormatName | None = None,
    registry: Place | None = None,
    as_: Annotated[str, Meta(title="KEY")] | None = None,
    progress: Progress | None = None,
) -> CalibrateReport:
    """Calibrate a camera (K and distortion) from the images of a flight, and assess the result.

    The result becomes an entry with ``open_registry(registry).propose_entries(result.entry)``.

    Args:
        images: folders, files or patterns; all of one camera at one focus and zoom setting. With ``result_of`` they
            may be left out: they state the camera and where it was, and limit which images are used.
        most: number of images to choose (default: 30; from a reconstruction 60).
        result_of: a finished reconstruction: COLMAP's cameras, images and points3D (.bin or .txt), or
            reconstruction.json and tracks.csv of OpenSfM or ODM.
        camera_number: which camera of a reconstruction with several, from 1, if no image states it.
        control: surveyed points.
        start: start from this focal length in px, or this calibration file.
        from_registry: start from the K of this entry of ``registry``.
        lens_model: distortion model; auto chooses it by the images.
        max_side_px: image size for finding points (default: 1600); twice the size takes four times the time and
            memory.
        camera: facts about the camera that the images do not state or state wrongly.
        focus: how the lens was focused: "locked at infinity".
        stated: day and operator of the calibration (default: the day of the images, if they state one).
        html: a page with every number and plot.
        out: K and distortion as a calibration file; not written if the calibration is refused.
        to: format of ``out``, or the program that reads it (default: by its suffix).
        registry: the registry in which it becomes a draft; a camera without make and model is then refused at once.
        as_: it is for the camera of this entry.
        progress: called with (done, total, what).

    Raises:
        UsageError: the arguments do not go together.
        InputError: there are no images, they are of several cameras, or a file cannot be read or written.
        CalibrationError: the images cannot be matched, or do not determine a camera.
        MissingExtraError: pycolmap is not installed.
    """
    from calibrary.calib.lens_models import Solvable
    from calibrary.extras import SFM, require
    from calibrary.jobs.calibrate.frames import Told, describe_frames, find_frames
    from calibrary.jobs.calibrate.outputs import Outputs
    from calibrary.jobs.calibrate.report import Asked, encoder, report_of, require_key
    from calibrary.jobs.calibrate.run import not_in_future, stated_camera
    from calibrary.jobs.calibrate_flight.reconstruction import MOST_IMAGES, solve_reconstruction
    from calibrary.jobs.calibrate_flight.run import FlightOptions, read_control, solve_images, starting_k
    from calibrary.records import replace
    from calibrary.sfm.engine import MAX_SIDE

    given = paths(images)
    if result_of is None and not given:
        raise UsageError("expected DIR, the images of a flight, or --from FOLDER, a finished reconstruction")
    if result_of is not None and not (start is None and from_registry is None and max_side_px is None):
        raise UsageError(
            "--start, --from-registry and --max-side-px are of images: a reconstruction has its points"
        )
    if camera_number is not None and (result_of is None or given):
        raise UsageError("--camera is of a reconstruction by several cameras, --from FOLDER without DIR")
    if result_of is None:
        require(SFM, "a calibration from a flight")
    outputs = Outputs.of(encoder, html=html, out=out, to=to)
    told = Told(
        camera=stated_camera(camera, registry, as_),
        focus=focus,
        stated=not_in_future(stated),
        needs_key=registry is not None or as_ is not None,
    )
    options = FlightOptions(
        images=most or (30 if result_of is None else MOST_IMAGES),
        model=Solvable.named(lens_model),
        max_side=max_side_px or MAX_SIDE,
        survey=read_control(control) if control is not None else None,
    )
    files = find_frames(given, "the images of the flight") if given else ()
    setting = describe_frames(files[:1], told).setting if files else None
    if told.needs_key:
        require_key(setting.camera if setting is not None else told.camera(CameraKey()))
    if result_of is not None:
        flight = solve_reconstruction(Path(result_of), files, told, options, camera=camera_number)
    else:
        size = setting.image_size if setting is not None else None
        options = replace(options, start=starting_k(start, from_registry, registry, size))
        flight = solve_images(files, told, options, progress=progress)
    result, detections = flight.calibrated(told)
    asked = Asked(
        model=lens_model, warp=False, guess_fx=options.start.fx if options.start is not None else None
    )
    report = report_of(result, detections, asked)
    return outputs.write(report, partial(view_of, detections=detections), lambda _: {})
