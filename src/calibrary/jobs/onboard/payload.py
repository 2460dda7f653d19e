"""What came with a payload: its files by what they are, and its cameras, each with its images, board and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary import parsers
from calibrary.admission import admission
from calibrary.calib.board import Board
from calibrary.calib.detection import shows_board
from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.errors import InputError, MissingSizeError, UnknownFormatError
from calibrary.evidence.identity import firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import no_frame
from calibrary.evidence.readings import readings
from calibrary.extras import CALIBRATE, require
from calibrary.jobs.extract.cameras import Camera, State, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.jobs.images.folders import SkippedFile, find_files
from calibrary.jobs.images.reading import gather
from calibrary.jobs.onboard.report import UsedFile
from calibrary.jobs.survey.limits import foreign
from calibrary.known_camera import normalise_sub_camera
from calibrary.parsers.files import is_image, sha256_of
from calibrary.policy import Policy
from calibrary.records import replace

LARGEST_CALIBRATION: Final = 4 << 20
MOST_FILES: Final = 100_000
TRIED: Final = 24
"""Images of one camera in one folder that are searched for a board before the folder counts as a flight."""
FEWEST_FRAMES: Final = 3
"""Fewest images with a board; a single one may be a tiled roof."""
NAMES_SHOWN: Final = 4
FRAME: Final = "frame of a board"


class Payload(Struct, frozen=True, kw_only=True):
    """The classified files of a folder.

    Attributes:
        folder: the folder.
        states: images with an identifiable camera, by metadata; names are relative to the folder.
        frames: names of those that show a board.
        files: calibration files with the name of the format.
        others: all other files, with the reason why they are not used.
    """

    folder: Path
    states: Mapping[ImageMetadata, tuple[str, ...]]
    frames: frozenset[str]
    files: tuple[tuple[Path, str], ...]
    others: tuple[SkippedFile, ...]

    @property
    def images(self) -> int:
        """Number of images, including frames of a board."""
        return sum(len(names) for names in self.states.values())


def classify_payload(folder: Path, *, workers: int = 0) -> Payload:
    """Classify all files in a folder and its sub-folders; none counts as a frame of a board yet.

    Args:
        folder: files that came with the payload.
        workers: processes that read images; 0 for automatic.

    Raises:
        InputError: it is not a folder, cannot be read, or contains far too many files.
    """
    images: list[Path] = []
    rest: list[Path] = []
    for path in find_files(folder, recursive=True):
        # A raw file has the header of a TIFF, but is not a separate image.
        (images if is_image(path) and parsers.is_image_file(path) else rest).append(path)
        if len(images) + len(rest) > MOST_FILES:
            raise InputError(
                f"contains over {MOST_FILES} files; give the folder of one payload", source=str(folder)
            )
    files, others = _calibrations(rest, folder)
    gathered = gather(images, folder, workers=workers)
    others += gathered.unread
    states: dict[ImageMetadata, tuple[str, ...]] = {}
    for metadata, names in gathered.states.items():
        contradiction = no_frame(metadata)
        if contradiction is not None:
            others += [SkippedFile(name=name, reason=contradiction) for name in names]
        else:
            states[metadata] = tuple(names)
    return Payload(
        folder=folder,
        states=states,
        frames=frozenset(),
        files=tuple(files),
        others=tuple(sorted(others, key=lambda one: one.name)),
    )


def _calibrations(paths: Sequence[Path], folder: Path) -> tuple[list[tuple[Path, str]], list[SkippedFile]]:
    """The files of a known calibration format, and the others with the reason."""
    files: list[tuple[Path, str]] = []
    others: list[SkippedFile] = []
    for path in paths:
        name = path.relative_to(folder).as_posix()
        try:
            identity = parsers.identify(path, max_bytes=LARGEST_CALIBRATION)
        except UnknownFormatError:
            others.append(
                SkippedFile(name=name, reason="neither an image nor a calibration file of a known format")
            )
        except InputError as error:
            others.append(SkippedFile(name=name, reason=error.message))
        except OSError as error:
            others.append(SkippedFile(name=name, reason=f"cannot be read: {error.strerror or error}"))
        else:
            if identity.format.read is None:
                others.append(
                    SkippedFile(name=name, reason=f"{identity.format.title}: {identity.format.refuses}")
                )
            else:
                files.append((path, identity.format.name))
    return files, others


def with_frames(
    payload: Payload,
    *,
    board: Board | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Payload:
    """The payload with the images that show a board, for which some of them are looked at.

    Frames of a board come in sets: a few images of each camera and folder are searched, and if half of them
    show a board, the whole set counts, including blurred and cropped frames, which the search at full
    resolution rejects.

    Args:
        payload: the classified files.
        board: the board, if known.
        progress: called with the number of images searched and the total.
    """
    folder = payload.folder
    groups: dict[tuple[ImageMetadata, str], list[str]] = {}
    for metadata, alike in payload.states.items():
        for name in alike:
            groups.setdefault((metadata, name.rpartition("/")[0]), []).append(name)
    groups = {key: names for key, names in groups.items() if len(names) >= FEWEST_FRAMES}
    if groups:
        require(CALIBRATE, "looking for frames of a board")
    looks = sum(min(TRIED, len(names)) for names in groups.values())
    done = 0
    found: set[str] = set()
    for names in groups.values():
        tried = list(_spread(sorted(names)))
        seen = []
        for name in tried:
            if _has_board(folder / name, board):
                seen.append(name)
            done += 1
            if progress is not None:
                progress(done, looks)
        if 2 * len(seen) >= len(tried) and len(seen) >= FEWEST_FRAMES:
            found |= set(names)
        elif len(seen) > 1 or (seen and len(names) > len(tried)):
            more = [name for name in names if name not in tried and _has_board(folder / name, board)]
            found |= {*seen, *more} if len(seen) + len(more) >= FEWEST_FRAMES else set()
    return replace(payload, frames=frozenset(found))


def _spread(names: Sequence[str]) -> Iterator[str]:
    """Yield a few names, evenly spread over the list."""
    count = min(TRIED, len(names))
    for at in range(count):
        yield names[at * len(names) // count]


def _has_board(path: Path, board: Board | None) -> bool:
    try:
        return shows_board(path, board)
    except InputError:
        # In a raw image or a colour mosaic no board can be measured.
        return False


class FileCalibration(Struct, frozen=True, kw_only=True):
    """One camera of a calibration file.

    Attributes:
        name: of the file, relative to the payload's folder.
        sha256: of its bytes.
        calibration: at its own size.
    """

    name: str
    sha256: str
    calibration: Calibration


class PayloadCamera(Struct, frozen=True, kw_only=True):
    """One camera of the payload.

    Attributes:
        key: camera key, with a hash of the serial number and without firmware.
        firmware: as stated by all its images.
        judged: result from its images; None if it has none.
        frames: frames of a board.
        files: its calibration files.
    """

    key: CameraKey
    firmware: str | None = None
    judged: Camera | None = None
    frames: tuple[Path, ...] = ()
    files: tuple[FileCalibration, ...] = ()

    @property
    def examples(self) -> tuple[str, ...]:
        """Name of one image of each state, relative to the payload's folder."""
        states = self.judged.states if self.judged is not None else ()
        return tuple(sorted(min(state.names) for state in states))

    @property
    def size(self) -> ImageSize:
        """(width, height) px of its images, or of its calibration.

        Raises:
            MissingSizeError: neither states a size.
        """
        if self.key.image_size is None:
            raise MissingSizeError(f"{self.key} states no image size")
        return self.key.image_size


class PayloadCameras(Struct, frozen=True, kw_only=True):
    """The cameras, and the files that could not be assigned to a camera.

    Attributes:
        found: the cameras, in a fixed order.
        skipped: files and images that belong to none of them, with the reason.
        nameless: image sizes of cameras that could be onboarded if make and model were stated.
    """

    found: tuple[PayloadCamera, ...]
    skipped: tuple[SkippedFile, ...]
    nameless: tuple[ImageSize, ...] = ()


class _Sorted(Struct):
    cameras: list[PayloadCamera] = field(default_factory=list)
    skipped: list[SkippedFile] = field(default_factory=list)
    nameless: list[ImageSize] = field(default_factory=list)


def find_cameras(
    payload: Payload,
    policy: Policy,
    said: Callable[[CameraKey], CameraKey],
    *,
    image_size: ImageSize | None = None,
) -> PayloadCameras:
    """Identify the cameras of a payload and assign its files to them.

    Args:
        payload: the classified files.
        policy: with the limits for K.
        said: replaces known camera fields by those that the user states; used only for cameras without a name.
        image_size: for calibration files that do not state theirs.
    """
    knowledge = Knowledge.load(None)
    sorted_ = _Sorted()
    groups = _cameras_with_names(group_cameras(undated(payload.states), knowledge), payload, said, sorted_)
    for key, states in groups.items():
        # A payload is one unit, because one unit is onboarded at a time.
        [judged] = judge(key, states, policy=policy, one_unit=True)
        versions = {firmware(state.metadata) for state in states}
        sorted_.cameras.append(
            PayloadCamera(
                key=key,
                firmware=versions.pop() if len(versions) == 1 else None,
                judged=judged,
                frames=tuple(payload.folder / name for name in judged.names if name in payload.frames),
            )
        )
    _hand_out_files(payload, sorted_, said, image_size)
    return PayloadCameras(
        found=tuple(sorted_.cameras),
        skipped=tuple(sorted_.skipped),
        nameless=tuple(dict.fromkeys(sorted_.nameless)),
    )


def used_files(camera: PayloadCamera, payload: Payload) -> tuple[UsedFile, ...]:
    """All files that were used; of images with equal metadata one, of frames of a board all."""
    found = [("image", name, sha256_of(payload.folder / name)) for name in camera.examples]
    found += [("calibration file", one.name, one.sha256) for one in camera.files]
    found += [(FRAME, path.relative_to(payload.folder).as_posix(), sha256_of(path)) for path in camera.frames]
    return tuple(UsedFile(what=what, name=name, sha256=sha256) for what, name, sha256 in dict.fromkeys(found))


def _cameras_with_names(
    groups: dict[CameraKey, tuple[State, ...]],
    payload: Payload,
    said: Callable[[CameraKey], CameraKey],
    sorted_: _Sorted,
) -> dict[CameraKey, tuple[State, ...]]:
    """The cameras with a name, their own or stated by the user; frames of a board are assigned by image size."""
    named = {key: states for key, states in groups.items() if _has_name(key)}
    for key, states in groups.items():
        if _has_name(key):
            continue
        names = [name for state in states for name in state.names]
        alike = [other for other in named if other.image_size == key.image_size]
        if len(alike) == 1 and payload.frames.issuperset(names):
            named[alike[0]] = (*named[alike[0]], *states)
            continue
        told = said(key)
        if _has_name(told):
            named[told] = (*named.get(told, ()), *states)
            continue
        if key.image_size is not None:
            sorted_.nameless.append(key.image_size)
        sorted_.skipped += [
            SkippedFile(name=name, reason="states no make and model; give --make and --model")
            for name in names
        ]
    return named


def _has_name(key: CameraKey) -> bool:
    return bool((key.make or "").strip() and (key.model or "").strip())


def _hand_out_files(
    payload: Payload,
    sorted_: _Sorted,
    said: Callable[[CameraKey], CameraKey],
    image_size: ImageSize | None,
) -> None:
    from_images = len(sorted_.cameras)
    for path, _ in payload.files:
        name = path.relative_to(payload.folder).as_posix()
        sizes = {camera.size for camera in sorted_.cameras}
        size = image_size or (sizes.pop() if len(sizes) == 1 else None)
        try:
            calibrations = _read(path, size)
            sha256 = sha256_of(path)
        except InputError as error:
            sorted_.skipped.append(SkippedFile(name=name, reason=error.message))
            continue
        for at, calibration in enumerate(calibrations, start=1):
            label = name if len(calibrations) == 1 else f"{name}, camera {at}"
            one = FileCalibration(name=label, sha256=sha256, calibration=calibration)
            _hand_out(one, sorted_, said, from_images)


def _read(path: Path, size: ImageSize | None) -> Sequence[Calibration]:
    """Read a calibration file; ``size`` is used only if the file states no image size."""
    try:
        return parsers.read(path, max_bytes=LARGEST_CALIBRATION)
    except MissingSizeError:
        if size is None:
            raise
        return parsers.read(path, image_size=size, max_bytes=LARGEST_CALIBRATION)


def _hand_out(
    one: FileCalibration, sorted_: _Sorted, said: Callable[[CameraKey], CameraKey], from_images: int
) -> None:
    fitting = [at for at, camera in enumerate(sorted_.cameras) if _fits(one.calibration, camera.key)]
    if len(fitting) > 1:
        same = [at for at in fitting if _is_sub_camera(one.calibration, sorted_.cameras[at].key)]
        fitting = same if len(same) == 1 else fitting
    if len(fitting) == 1:
        camera = sorted_.cameras[fitting[0]]
        sorted_.cameras[fitting[0]] = replace(camera, files=(*camera.files, one))
        return
    key = replace(one.calibration.camera, image_size=one.calibration.intrinsics.image_size)
    if len(fitting) > 1:
        names = ", ".join(str(sorted_.cameras[at].key) for at in fitting[:NAMES_SHOWN])
        why = (
            f"does not state which of {len(fitting)} cameras it is of: {names}; "
            "put it beside the images of that camera alone"
        )
        sorted_.skipped.append(SkippedFile(name=one.name, reason=why))
        return
    if from_images:
        kept = ", ".join(str(camera.key) for camera in sorted_.cameras[:NAMES_SHOWN])
        other = foreign(one.calibration, sorted_.cameras[0].key)
        why = other if other is not None else f"is of {key}, and the images are of {kept}"
        unlikely = admission(one.calibration)
        why += f"; its K is unlikely: {unlikely.message}" if unlikely is not None else ""
        sorted_.skipped.append(SkippedFile(name=one.name, reason=why))
        return
    told = said(key)
    if _has_name(told):
        named = replace(told, firmware=None)
        sorted_.cameras.append(PayloadCamera(key=named, firmware=told.firmware, files=(one,)))
    else:
        sorted_.nameless.append(one.calibration.intrinsics.image_size)
        sorted_.skipped.append(
            SkippedFile(name=one.name, reason="states no make and model; give --make and --model")
        )


def _fits(calibration: Calibration, key: CameraKey) -> bool:
    """Whether a file's camera can be this one: all of its frame, and no other model, unit or sub-camera stated."""
    if key.image_size is None or foreign(calibration, key) is not None:
        return False
    ways = readings(calibration.intrinsics, ImageMetadata(size=key.image_size))
    return any(one.is_scaled or not one.steps for one in ways)


def _is_sub_camera(calibration: Calibration, key: CameraKey) -> bool:
    stated = calibration.camera.sub_camera
    return (
        stated is not None
        and key.sub_camera is not None
        and normalise_sub_camera(stated) == normalise_sub_camera(key.sub_camera)
    )
