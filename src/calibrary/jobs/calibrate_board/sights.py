"""What a calibration starts from: the board as seen in frames, in a corners.json, or points of known places."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calibrary import parsers
from calibrary.calib.board import Board
from calibrary.calib.collect import NamedRemark, collect, try_board_sizes
from calibrary.calib.corners_file import corners_sha256, read_corners
from calibrary.calib.observations import Observations
from calibrary.calibration import CameraKey, ImageSize, Intrinsics
from calibrary.errors import FrameError, InputError, MissingTagError
from calibrary.jobs.calibrate_board.frames import Told
from calibrary.records import replace

__all__ = ["Sights", "read_seed", "saved_sights", "search"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sights:
    """Corners, and what was said on the way to them.

    Attributes:
        observations: to calibrate with.
        rejected: frames without a view, each with its reason.
        remarks: on views that are kept.
        notes: on the set as a whole.
        files: the frames by the SHA-256 of their bytes, where they are at hand.
    """

    observations: Observations
    rejected: tuple[NamedRemark, ...] = ()
    remarks: tuple[NamedRemark, ...] = ()
    notes: tuple[str, ...] = ()
    files: Mapping[str, Path] = field(default_factory=dict)

    @property
    def sha256(self) -> str:
        """Of the corners, as corners.json holds them."""
        return corners_sha256(self.observations)


def search(
    frames: Sequence[Path],
    told: Told,
    board: Board | float,
    *,
    workers: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Sights:
    """Look for the board in frames.

    Args:
        frames: files.
        told: what their metadata say.
        board: what to look for, or only the side of its squares in mm: the corners are then counted by trying.
        workers: processes; 0 takes as many as there are cores once it is worth it.
        progress: called with the number of frames done since the last call.

    Raises:
        InputError: no frame can be read, or they differ in size.
        CalibrationError: no frame shows the board.
    """
    notes = told.notes
    if not isinstance(board, Board):
        board = try_board_sizes(frames, board)
        notes = (*notes, f"the board was taken for {board}, which was found by trying")
    found = collect(frames, board, setting=told.setting, workers=workers, progress=progress)
    return Sights(
        observations=found.observations,
        rejected=found.rejected,
        remarks=found.remarks,
        notes=notes,
        files=_files(frames, found.observations),
    )


def saved_sights(path: Path, said: Callable[[CameraKey], CameraKey], focus: str | None = None) -> Sights:
    """The corners that an earlier run wrote.

    Args:
        path: a corners.json.
        said: puts what was said of the camera in the place of what the file says.
        focus: how the lens was focused, in place of what the file says.

    Raises:
        InputError: it cannot be read.
        ParseError: it is broken.
    """
    kept = read_corners(path)
    camera = replace(said(replace(kept.camera, firmware=kept.firmware)), image_size=kept.image_size)
    observations = replace(
        kept,
        camera=camera,
        firmware=camera.firmware,
        focus=focus if focus is not None else kept.focus,
    )
    return Sights(observations=observations)


def read_seed(path: Path, image_size: ImageSize) -> Intrinsics:
    """The K to start from: a self-calibration seed of the ingest gate, or a calibration of any format.

    Args:
        path: the file.
        image_size: (width, height) px of the frames; a K of the same frame at another size is scaled to it.

    Raises:
        InputError: it cannot be read, or holds several cameras, or one of another frame.
    """
    try:
        found = parsers.read(path)
    except MissingTagError:
        # A bare matrix says nothing of the frame it is of.
        found = parsers.read(path, image_size=image_size)
    if len(found) != 1:
        raise InputError(f"holds {len(found)} cameras, wanted one to start from", source=path.name)
    try:
        return found[0].intrinsics.scaled(image_size)
    except FrameError as error:
        raise InputError(f"no K to start from for these frames: {error.message}", source=path.name) from None


def _files(frames: Sequence[Path], observations: Observations) -> dict[str, Path]:
    """Frames share names across folders; what tells them apart is what is in them."""
    by_name: dict[str, list[Path]] = {}
    for path in frames:
        by_name.setdefault(path.name, []).append(path)
    return {
        view.sha256: by_name[view.name][0]
        for view in observations.views
        if view.sha256 is not None and len(by_name.get(view.name, ())) == 1
    }
