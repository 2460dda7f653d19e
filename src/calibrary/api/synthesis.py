"""Synthetic images of a board by a known camera, to test a set-up before a board is printed."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from calibrary.arguments import Reading
from calibrary.calib.board import parse_board
from calibrary.calib.synthesis import Settings, Sheet, Shutter, Truth, poses
from calibrary.calib.synthesis.cameras import example_camera, head, unit_of
from calibrary.calib.synthesis.files import check_empty, write_frames
from calibrary.calibration import Calibration
from calibrary.catalogue import camera_named
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.files.reading import choose, read_file
from calibrary.known_camera import KnownCamera
from calibrary.progress import Progress

__all__ = ["render_frames"]


def render_frames(
    out: str | Path,
    board: str,
    *,
    square_mm: float,
    marker_mm: float | None = None,
    frames: int = 20,
    seed: int = 1,
    camera: str | None = None,
    calibration: str | Path | None = None,
    max_tilt_deg: float = 35.0,
    reach: float = 1.0,
    blur_px: float = 0.8,
    motion_px: float = 0.0,
    noise: float = 2.0,
    glare: float = 0.0,
    bow_mm: float = 0.0,
    stretch_pct: float = 0.0,
    readout_ms: float = 0.0,
    turn_deg_s: float = 0.0,
    quality: int = 92,
    progress: Progress | None = None,
) -> Truth:
    """Render images of a board as a camera would take them, and write the truth to OUT/truth.json.

    Args:
        out: a new or empty folder.
        board: board type and number of inner corners, such as "checkerboard:11x8".
        square_mm: side of a square in mm; for circles, the distance of their centres.
        marker_mm: side of a marker, or diameter of a circle, in mm.
        frames: number of images.
        seed: the same seed gives the same images.
        camera: Model or name of a camera of the catalogue, of which a unit is simulated; by default an example camera.
        calibration: file with the calibration to use, instead of ``camera``.
        max_tilt_deg: largest tilt of the board in degrees.
        reach: share of the image, around its centre, that the board covers.
        blur_px: standard deviation of the blur in px.
        motion_px: motion along x during the exposure in px.
        noise: standard deviation of the noise, in grey levels of 255.
        glare: strength of a lamp's reflection; 1 saturates.
        bow_mm: bow of the board: distance of its middle behind its ends, in mm.
        stretch_pct: excess width of the print, in percent.
        readout_ms: readout time of a rolling shutter, first to last row, in ms.
        turn_deg_s: rate at which the camera turns sideways during readout, in degrees/s.
        quality: JPEG quality.
        progress: called with (images done, number of images, "frames").

    Raises:
        InputError: the folder is not empty, or the board or camera is unknown.
        MissingExtraError: OpenCV is not installed.
    """
    require(CALIBRATE, "rendering frames")
    out = Path(out)
    check_empty(out)
    made = parse_board(board, square_mm, marker_mm)
    source, known = _camera(camera, calibration, seed)
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
    counted = (lambda done: progress(done, len(chosen), "frames")) if progress is not None else None
    write_frames(out, truth, seed, partial(head, source, known), counted)
    return truth


def _camera(
    name: str | None, calibration: str | Path | None, seed: int
) -> tuple[Calibration, KnownCamera | None]:
    """Return the calibration of the simulated camera, and the catalogue's entry for its model."""
    if calibration is not None:
        path = Path(calibration)
        how = "'calibrary convert --camera N' and take its output"
        return choose(read_file(path, Reading()), None, source=path.name, how=how), None
    if name is None:
        return example_camera(seed), None
    known = camera_named(name)
    return unit_of(known, seed), known
