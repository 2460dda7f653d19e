"""Render frames of a board with an exactly known camera, to test a set-up before a board is printed.

>>> from calibrary.jobs.synth import render_frames
>>> truth = render_frames("rendered", "checkerboard:9x6", square_mm=40, frames=1, camera="RedEdge-M")
>>> truth.calibration.camera.model
'RedEdge-M'
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import Edge, File, Folder, Reading
from calibrary.errors import UsageError
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.calib.synthesis import Truth

__all__ = ["render_frames"]


def render_frames(
    out: Folder,
    board: Annotated[str, Meta(title="BOARD")],
    *,
    square_mm: Edge,
    marker_mm: Edge | None = None,
    frames: Annotated[int, Meta(ge=1, le=1000)] = 20,
    seed: Annotated[int, Meta(ge=0, le=2**31)] = 1,
    camera: str | None = None,
    calibration: File | None = None,
    max_tilt_deg: Annotated[float, Meta(ge=0, le=80)] = 35.0,
    reach: Annotated[float, Meta(ge=0.05, le=1, title="SHARE")] = 1.0,
    blur_px: Annotated[float, Meta(ge=0, le=50)] = 0.8,
    motion_px: Annotated[float, Meta(ge=0, le=200)] = 0.0,
    noise: Annotated[float, Meta(ge=0, le=100, title="LEVELS")] = 2.0,
    glare: Annotated[float, Meta(ge=0, le=100, title="LIGHT")] = 0.0,
    bow_mm: Annotated[float, Meta(ge=-100, le=100)] = 0.0,
    stretch_pct: Annotated[float, Meta(ge=-10, le=10)] = 0.0,
    readout_ms: Annotated[float, Meta(ge=0, le=1000)] = 0.0,
    turn_deg_s: Annotated[float, Meta(ge=-1000, le=1000, title="DEG/S")] = 0.0,
    quality: Annotated[int, Meta(ge=1, le=95)] = 92,
    progress: Progress | None = None,
) -> Truth:
    """Render images of a board as a camera would take them, and write the truth to OUT/truth.json.

    Args:
        out: a new or an empty folder.
        board: pattern and number of inner corners, such as checkerboard:11x8.
        square_mm: side of a square; for circles the distance of centres, for an aprilgrid from tag to tag.
        marker_mm: side of a marker, diameter of a circle (default: 3/4, 1/1.3 or 1/2 of the square).
        frames: how many.
        seed: the same seed, the same frames.
        camera: camera of the catalogue of which a unit is simulated, by its Model or name.
        calibration: calibration of the camera to simulate.
        max_tilt_deg: largest tilt.
        reach: share of the frame, around its middle, that the boards cover.
        blur_px: standard deviation of the blur.
        motion_px: motion along x while the shutter is open.
        noise: standard deviation of the noise, of 255.
        glare: brightness of a lamp's mirror image; 1 saturates.
        bow_mm: distance of the board's middle behind its ends.
        stretch_pct: by how much the print is too wide.
        readout_ms: readout of a rolling shutter, first to last row.
        turn_deg_s: speed of the camera's turn during the readout.
        quality: of the JPEGs.
        progress: called with (images done, number of images, "frames").

    Raises:
        UsageError: a camera and a calibration are given.
        InputError: the folder is not empty, or the board or camera is unknown.
        MissingExtraError: OpenCV is not installed.
    """
    from functools import partial

    from calibrary.calib.board import parse_board
    from calibrary.calib.synthesis import Settings, Sheet, Shutter, Truth, poses
    from calibrary.calib.synthesis.cameras import example_camera, head, unit_of
    from calibrary.calib.synthesis.files import check_empty, write_frames
    from calibrary.catalogue import camera_named
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.files import choose, read_file

    if camera is not None and calibration is not None:
        raise UsageError("--camera and --calibration are two cameras to simulate; give one")
    require(CALIBRATE, "rendering frames")
    check_empty(Path(out))
    made = parse_board(board, square_mm, marker_mm)
    known = camera_named(camera) if camera is not None else None
    if calibration is not None:
        path, how = Path(calibration), "'calibrary convert --camera N' and take its output"
        source = choose(read_file(path, Reading()), None, source=path.name, how=how)
    else:
        source = unit_of(known, seed) if known is not None else example_camera(seed)
    settings = Settings(
        sheet=Sheet.bowed(made, bow_mm, (1 + stretch_pct / 100, 1.0)),
        shutter=Shutter(readout_s=readout_ms / 1000, rate_deg_s=(0.0, turn_deg_s, 0.0)),
        blur_px=blur_px,
        motion_px=(motion_px, 0.0),
        noise=noise,
        glare=glare,
        quality=quality,
    )
    chosen = poses(made, source, frames, seed, max_tilt_deg=max_tilt_deg, reach=reach)
    truth = Truth(board=made, calibration=source, poses=chosen, settings=settings)
    told = (lambda done: progress(done, len(chosen), "frames")) if progress is not None else None
    write_frames(Path(out), truth, seed, partial(head, source, known), told)
    return truth
