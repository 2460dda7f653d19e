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
        progress: called with (images done, number of images, "frames").

    Raises:
        UsageError: a camera and a calibration are given.
        InputError: the folder is not empty, or the board or camera is unknown.
        MissingExtraError: OpenCV is not installed.
    """
    from functools import partial

    from calibrary.calib.board import parse_board
    from calibrary.calib.synthesis import Settings, Truth, poses
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
    chosen = poses(made, source, frames, seed)
    truth = Truth(board=made, calibration=source, poses=chosen, settings=Settings())
    told = (lambda done: progress(done, len(chosen), "frames")) if progress is not None else None
    write_frames(Path(out), truth, seed, partial(head, source, known), told)
    return truth
