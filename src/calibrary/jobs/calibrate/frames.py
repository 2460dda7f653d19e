"""Selection of frames, those of recordings too, and their metadata: camera, focus, firmware and dates."""

from __future__ import annotations

import glob
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import date
from pathlib import Path

from msgspec import Struct, field

from calibrary.arguments import Stated
from calibrary.calib.board import Board
from calibrary.calib.detection import NamedRemark
from calibrary.calib.found import Reason
from calibrary.calib.frames import Setting, group_frames, of_most_common_size, the_one_setting
from calibrary.calib.observations import ControlPoints, Days, Observations, View
from calibrary.calib.recordings import DESCRIPTION, OF_A_FOLDER, READERS, REINDEX, write_frames
from calibrary.calibration import CameraKey, ImageSize
from calibrary.catalogue import load_catalogue, match_image
from calibrary.errors import InputError
from calibrary.evidence.frame import files_frame
from calibrary.evidence.identity import camera_key, firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import Does, originality, program_in
from calibrary.parsers.files import is_image
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.imagery.taken import focus_of, taken_on
from calibrary.policy import FLEET, Policy
from calibrary.records import replace

FURTHER_SUFFIXES = frozenset({".bmp", ".pgm", ".ppm", ".pnm", ".jp2", ".j2k", ".j2c"})
"""Of frames that industrial cameras write, beside those of images with a camera's metadata."""

MOST_FRAMES = 5_000
"""Most frames accepted; a few hundred suffice, and a folder with more is a flight."""


class FrameMetadata(Struct, frozen=True, kw_only=True):
    """Metadata of the frames.

    Attributes:
        setting: camera, image size and focus, equal for all frames; None if no frame can be read.
        taken: first and last date of the frames, None if none states a date.
        notes: warnings.
    """

    setting: Setting | None
    taken: Days | None = None
    notes: tuple[str, ...] = ()


class Told(Struct, frozen=True, kw_only=True):
    """What the user states of the images and of the calibration, or demands of them.

    Attributes:
        camera: replaces what the images state of the camera.
        focus: focus setting, in place of that of the images.
        stated: day and operator of the calibration; without a day, that of the images.
        image_size: (width, height) px; only points need it, otherwise it is checked.
        needs_key: whether the camera must have a make and a model.
        policy: limits of each use.
    """

    camera: Callable[[CameraKey], CameraKey] = lambda known: known
    focus: str | None = None
    stated: Stated = field(default_factory=Stated)
    image_size: ImageSize | None = None
    needs_key: bool = False
    policy: Policy = FLEET

    def check_size(self, found: ImageSize, what: str, source: str | None = None) -> None:
        """Refuse a stated size that the images contradict."""
        if self.image_size not in {None, found}:
            raise InputError(
                f"{what} are of {found[0]}×{found[1]} px and no other size; leave --image-size out",
                source=source,
            )


def is_frame(path: Path) -> bool:
    """Whether a file name has the suffix of a frame."""
    return is_image(path) or path.suffix.lower() in FURTHER_SUFFIXES


def find_frames(operands: Sequence[Path], of: str = "the frames of the board") -> tuple[Path, ...]:
    """The files that arguments refer to, in order, without duplicates.

    Args:
        operands: files, folders (images by suffix, without sub-folders) and patterns.
        of: what the files are, for messages.

    Raises:
        InputError: an argument matches no file, or there are more than 5000 files in total.
    """
    found: dict[Path, None] = {}
    for path in operands:
        operand = str(path)
        if path.is_dir():
            # A file that is not accessible is kept here and reported when it is read.
            new = [
                item
                for item in sorted(path.iterdir())
                if is_frame(item) and not item.name.startswith(".") and not item.is_dir()
            ]
            problem = "" if new else _without_images(path)
        elif path.exists() or not glob.has_magic(operand):
            new, problem = [path] if path.exists() else [], "no such file or folder"
        else:
            # Path.glob does not accept an absolute pattern.
            matched = sorted(glob.glob(operand, recursive=True))  # noqa: PTH207
            new = [item for item in map(Path, matched) if item.is_file()]
            problem = "a pattern that fits no file"
        if not new:
            raise InputError(f"{problem}; expected {of}", source=operand)
        found.update(dict.fromkeys(new))
    if len(found) > MOST_FRAMES:
        raise InputError(f"{len(found)} frames; expected at most {MOST_FRAMES}, some 15 to 60 are best")
    return tuple(found)


def _without_images(folder: Path) -> str:
    """Say what a folder without images has instead."""
    recordings = [item for item in sorted(folder.iterdir()) if item.suffix.lower() in READERS]
    if not recordings:
        return "a folder without images"
    first = recordings[0].name
    if recordings[0].suffix.lower() in OF_A_FOLDER:
        return f"a folder with {first}, but without the {DESCRIPTION} of a ROS 2 bag: {REINDEX}"
    return f"a folder without images, but with recordings, which are given by name ({first})"


def parted(operand: Path) -> tuple[Path, str | None]:
    """Return a path and the topic after it, as in ``flight.bag:/cam0/image_raw``."""
    name, _, topic = str(operand).partition(":/")
    if topic and not operand.exists() and is_recording(Path(name)):
        return Path(name), f"/{topic}"
    return operand, None


def is_recording(path: Path) -> bool:
    """Whether a path is of a recording, by its suffix, or a folder that is a bag of ROS 2."""
    return path.suffix.lower() in READERS or (path / DESCRIPTION).is_file()


def refuse_recordings(operands: Sequence[Path], because: str) -> None:
    """Raise an error where frames have to be image files.

    Raises:
        InputError: an operand is a recording.
    """
    for operand in operands:
        if is_recording(parted(operand)[0]):
            raise InputError(
                f"is a recording; {because} (ffmpeg, or ROS's image_view extract_images, writes its frames as files)",
                source=str(operand),
            )


@contextmanager
def recorded(operands: Sequence[Path]) -> Iterator[tuple[tuple[Path, ...], tuple[str, ...]]]:
    """Yield the operands with the frames of recordings in their place, which are gone afterwards; and notes.

    Raises:
        InputError: a recording cannot be read.
        MissingExtraError: the library that reads it is not installed.
    """
    found: list[Path] = []
    notes: list[str] = []
    with tempfile.TemporaryDirectory(prefix="calibrary-") as folder:
        for at, operand in enumerate(operands):
            path, topic = parted(operand)
            if not is_recording(path):
                found.append(operand)
                continue
            place = Path(folder, str(at))
            place.mkdir()
            kept, count, unreadable = write_frames(path, topic, place)
            found += kept
            notes.append(f"{path.name}: {len(kept)} of {count} frames, the sharpest of each stretch of time")
            if unreadable:
                notes.append(
                    f"{path.name}: {len(unreadable)} more cannot be read and were skipped; the first is "
                    f"{unreadable[0].why}"
                )
        yield tuple(found), tuple(notes)


class SkippedFrames(Struct, frozen=True, kw_only=True):
    """The frames skipped because of their image size, or because a program saved them again.

    Attributes:
        remarks: one for each frame.
        notes: on all of them.
    """

    remarks: tuple[NamedRemark, ...] = ()
    notes: tuple[str, ...] = ()


def without_other_sizes(frames: Sequence[Path]) -> tuple[tuple[Path, ...], SkippedFrames]:
    """The frames with the most frequent image size, and the skipped ones.

    Raises:
        InputError: two sizes are equally frequent.
    """
    size, kept, others = of_most_common_size(frames)
    if size is None or not others:
        return kept, SkippedFrames()
    wanted = "{}×{} px".format(*size)
    remarks = tuple(
        NamedRemark(
            name=path.name,
            reason=Reason.OTHER_SIZE,
            message="is {}×{} px, most frames are {}: skipped".format(*other, wanted),
        )
        for path, other in others.items()
    )
    note = f"{len(others)} of {len(frames)} frames are of another size than {wanted}, which most have, and were skipped"
    return kept, SkippedFrames(remarks=remarks, notes=(note,))


def without_resaved(frames: Sequence[Path]) -> tuple[tuple[Path, ...], SkippedFrames]:
    """The frames without those that a program saved again, which may have moved their pixels, and the skipped ones.

    Where the originals are not more than the others, all are kept: the program may have saved the whole flight alike.
    """
    saved: dict[Path, str] = {}
    for path in frames:
        with suppress(InputError):
            program = program_in(read_metadata(path).software or "")
            if program is not None and program.does is not Does.TAGS:
                saved[path] = program.name
    if not saved or 2 * len(saved) >= len(frames):
        return tuple(frames), SkippedFrames()
    remarks = tuple(
        NamedRemark(
            name=path.name,
            reason=Reason.RESAVED,
            message=f"was saved by {name}, which may have moved its pixels, and most were not: skipped",
        )
        for path, name in saved.items()
    )
    note = (
        f"{len(saved)} of {len(frames)} images were saved by {' and '.join(dict.fromkeys(saved.values()))}, which may "
        f"have moved their pixels, and were left out: {', '.join(path.name for path in saved)}"
    )
    kept = tuple(path for path in frames if path not in saved)
    return kept, SkippedFrames(remarks=remarks, notes=(note,))


def describe_frames(frames: Sequence[Path], told: Told) -> FrameMetadata:
    """Read the metadata that all frames have in common.

    Args:
        frames: files; unreadable ones are skipped here and reported by the corner detection.
        told: what the user states of them.

    Raises:
        InputError: the frames differ in camera, size or focus, or an editor has moved their pixels.
    """
    settings: dict[Path, Setting] = {}
    notes: dict[str, None] = {}
    days: list[date] = []
    for path in frames:
        try:
            metadata = read_metadata(path)
            distance = told.focus if told.focus is not None else focus_of(path)
            day = taken_on(path, by_shutter=True)
        except InputError:
            continue
        if changed := originality(metadata).moved:
            raise InputError(
                f"the image was {' and '.join(changed)}, so its pixels are no longer where the lens put them; "
                "expected the original frames from the camera",
                source=path.name,
            )
        notes.update(dict.fromkeys(_notes(metadata)))
        days += [day] if day is not None else []
        known = match_image(load_catalogue(), metadata).camera
        key = camera_key(metadata, known.sub_camera if known is not None else None)
        # With the firmware, because K may change with it. The image size is that of the file, whatever the user states;
        # the caller reports a contradiction.
        camera = replace(told.camera(replace(key, firmware=firmware(metadata))), image_size=metadata.size)
        settings[path] = Setting(camera=camera, image_size=metadata.size, focus=distance)
    if not settings:
        return FrameMetadata(setting=None)
    return FrameMetadata(
        setting=the_one_setting(group_frames(settings, settings)),
        taken=(min(days), max(days)) if days else None,
        notes=tuple(notes),
    )


def observed(
    board: Board | ControlPoints, size: ImageSize, views: Iterable[View], metadata: FrameMetadata, told: Told
) -> Observations:
    """Return views of a board, with what their frames, if there are any, and the user say of the camera."""
    setting = metadata.setting
    camera = setting.camera if setting is not None else told.camera(CameraKey(image_size=size))
    return Observations(
        board=board,
        image_size=size,
        views=tuple(views),
        camera=replace(camera, image_size=size),
        focus=setting.focus if setting is not None else told.focus,
        firmware=camera.firmware,
        taken=metadata.taken,
    )


def _notes(metadata: ImageMetadata) -> list[str]:
    written = files_frame(metadata)
    if written == metadata.size:
        return []
    return [
        "EXIF says that the camera wrote {}×{} px, the frames are {}×{}: K is of these, and frames of the other size "
        "need it scaled".format(*written, *metadata.size)
    ]
