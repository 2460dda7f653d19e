"""Which frames are meant, and what their metadata state: the camera, its focus and firmware, and the days."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path

from msgspec import Struct

from calibrary.calib.collect import NamedRemark
from calibrary.calib.found import Reason, Remark
from calibrary.calib.frames import Setting, group_frames, of_most_common_size, the_one_setting
from calibrary.calib.observations import Days
from calibrary.calibration import CameraKey
from calibrary.catalogue import load_catalogue, match_image
from calibrary.errors import InputError
from calibrary.evidence.edits import edits
from calibrary.evidence.frame import files_frame
from calibrary.evidence.identity import camera_key, firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.image_names import is_image
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.imagery.focus import focus_of
from calibrary.parsers.imagery.taken import taken_on
from calibrary.records import replace

__all__ = ["FrameMetadata", "SkippedSizes", "describe_frames", "find_frames", "without_other_sizes"]

MOST_FRAMES = 5_000
"""Some hundred are plenty; a folder of more is a flight."""


class FrameMetadata(Struct, frozen=True, kw_only=True):
    """What the frames state of themselves.

    Attributes:
        setting: camera, size and focus, the same for all; None where none of them can be read.
        taken: the first and the last day they were taken on, None where none states one.
        notes: warnings about them.
    """

    setting: Setting | None
    taken: Days | None = None
    notes: tuple[str, ...] = ()


def find_frames(operands: Sequence[str]) -> tuple[Path, ...]:
    """The files that words of a command line mean, each once, in order.

    Args:
        operands: files, folders (their images by suffix, not those of folders within) and patterns.

    Raises:
        InputError: one means no file, or all together mean more than 5000.
    """
    found: dict[Path, None] = {}
    for operand in operands:
        path = Path(operand)
        if path.is_dir():
            # A file that cannot be looked at is found by name and reported when it is read.
            new = [
                item for item in sorted(path.iterdir()) if is_image(item) and not item.name.startswith(".")
            ]
            problem = "a folder without images"
        elif path.exists() or not glob.has_magic(operand):
            new, problem = [path] if path.exists() else [], "no such file or folder"
        else:
            # Path.glob takes no absolute pattern.
            matched = sorted(glob.glob(operand, recursive=True))  # noqa: PTH207
            new = [item for item in map(Path, matched) if item.is_file()]
            problem = "a pattern that fits no file"
        if not new:
            raise InputError(f"{problem}; expected the frames of the board", source=operand)
        found.update(dict.fromkeys(new))
    if len(found) > MOST_FRAMES:
        raise InputError(f"{len(found)} frames; expected at most {MOST_FRAMES}, some 15 to 60 are best")
    return tuple(found)


class SkippedSizes(Struct, frozen=True, kw_only=True):
    """The frames that were left out for their size.

    Attributes:
        remarks: one for each.
        notes: on all of them.
    """

    remarks: tuple[NamedRemark, ...] = ()
    notes: tuple[str, ...] = ()


def without_other_sizes(frames: Sequence[Path]) -> tuple[tuple[Path, ...], SkippedSizes]:
    """The frames of the size that most have, and what was left out.

    Raises:
        InputError: two sizes are as frequent.
    """
    size, kept, others = of_most_common_size(frames)
    if size is None or not others:
        return kept, SkippedSizes()
    wanted = "{}×{} px".format(*size)
    remarks = tuple(
        NamedRemark(
            name=path.name,
            remark=Remark(
                reason=Reason.OTHER_SIZE,
                text="is {}×{} px, most frames are {}: skipped".format(*other, wanted),
                rejects=True,
            ),
        )
        for path, other in others.items()
    )
    note = f"{len(others)} of {len(frames)} frames are of another size than {wanted}, which most have, and were skipped"
    return kept, SkippedSizes(remarks=remarks, notes=(note,))


def describe_frames(
    frames: Sequence[Path], said: Callable[[CameraKey], CameraKey], focus: str | None = None
) -> FrameMetadata:
    """What all frames agree on.

    Args:
        frames: files; those that cannot be read are left to the search for the board, which tells of them.
        said: replaces by what the user states what its frames say.
        focus: how the lens was focused, in place of what the frames say.

    Raises:
        InputError: they are of several cameras, sizes or focus settings, or an editor has moved their pixels.
    """
    settings: dict[Path, Setting] = {}
    notes: dict[str, None] = {}
    days: list[date] = []
    for path in frames:
        try:
            metadata = read_metadata(path)
            distance = focus if focus is not None else focus_of(path)
            day = taken_on(path, by_shutter=True)
        except InputError:
            continue
        if changed := edits(metadata):
            raise InputError(
                f"the image was {' and '.join(changed)}, so its pixels are no longer where the lens put them; "
                "expected the original frames from the camera",
                source=path.name,
            )
        notes.update(dict.fromkeys(_notes(metadata)))
        days += [day] if day is not None else []
        # The size is the file's, whatever was said of the camera; the caller reports who states another.
        camera = replace(said(_key(metadata)), image_size=metadata.size)
        settings[path] = Setting(camera=camera, image_size=metadata.size, focus=distance)
    if not settings:
        return FrameMetadata(setting=None)
    return FrameMetadata(
        setting=the_one_setting(group_frames(settings, settings)),
        taken=(min(days), max(days)) if days else None,
        notes=tuple(notes),
    )


def _key(metadata: ImageMetadata) -> CameraKey:
    """Which camera, its firmware included: between two of them K may move."""
    known = match_image(load_catalogue(), metadata).camera
    key = camera_key(metadata, known.sub_camera if known is not None else None)
    return replace(key, firmware=firmware(metadata))


def _notes(metadata: ImageMetadata) -> list[str]:
    written = files_frame(metadata)
    if written == metadata.size:
        return []
    return [
        "EXIF says that the camera wrote {}×{} px, the frames are {}×{}: K is of these, and frames of the other size "
        "need it scaled".format(*written, *metadata.size)
    ]
