"""The cameras of a payload, each with its images, its frames of a board and its calibration files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.errors import InputError, MissingSizeError, MissingTagError
from calibrary.evidence.identity import firmware
from calibrary.image_size import same_aspect
from calibrary.jobs.extract.cameras import DEFAULT_SENSOR_MM, Camera, Sensor, State, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.onboard.classify import LARGEST_CALIBRATION, Payload
from calibrary.known_camera import normalise_sub_camera
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.registry.paths import match_key

__all__ = ["FileCalibration", "PayloadCamera", "PayloadCameras", "find_cameras", "sha256_of"]

NAMES_SHOWN: Final = 4


class FileCalibration(Struct, frozen=True, kw_only=True):
    """One camera of a calibration file.

    Attributes:
        name: of the file, relative to the payload's folder.
        sha256: of its bytes.
        calibration: at the size of the camera's images.
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
    groups = _named(group_cameras(undated(payload.states), knowledge), payload, said, sorted_)
    sensor = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)
    for key, states in groups.items():
        # A payload is one unit, because one unit is onboarded at a time.
        [judged] = judge(key, states, policy=policy, sensor=sensor, one_unit=True)
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


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _named(
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
        except MissingTagError as error:
            remedy = "" if "--image-size" in error.message else "; say --image-size WxH"
            sorted_.skipped.append(SkippedFile(name=name, reason=f"{error.message}{remedy}"))
            continue
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
    except MissingTagError:
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
        scaled = replace(one, calibration=one.calibration.scaled(camera.size))
        sorted_.cameras[fitting[0]] = replace(camera, files=(*camera.files, scaled))
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
        sorted_.skipped.append(
            SkippedFile(name=one.name, reason=f"is of {key}, and the images are of {kept}")
        )
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
    """Whether a file's camera can be this one: same sensor crop, and no other model, unit or sub-camera stated."""
    camera = calibration.camera
    if key.image_size is None or not same_aspect(calibration.intrinsics.image_size, key.image_size):
        return False
    if camera.model is not None and key.model is not None and match_key(camera.model) != match_key(key.model):
        return False
    if camera.serial is not None and key.serial is not None and camera.serial != key.serial:
        return False
    sub = camera.sub_camera
    return sub is None or sub.isdecimal() or key.sub_camera is None or _is_sub_camera(calibration, key)


def _is_sub_camera(calibration: Calibration, key: CameraKey) -> bool:
    stated = calibration.camera.sub_camera
    return (
        stated is not None
        and key.sub_camera is not None
        and normalise_sub_camera(stated) == normalise_sub_camera(key.sub_camera)
    )
