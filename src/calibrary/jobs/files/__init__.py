"""Read and write calibration files of any format, read images, and read what an argument of a command names.

>>> from calibrary.jobs.files import read, refit, write
>>> camera = read("camera.xml")
>>> write(camera, "camera.yaml", format="opencv_storage").outcome
<Fidelity.EXACT: 'exact'>
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, TypeAlias

from msgspec import Struct

from calibrary.arguments import Place, Reading
from calibrary.calibration import Calibration
from calibrary.errors import InputError, MissingTagError, RegistryError, first_of
from calibrary.image_size import ImageSize
from calibrary.progress import stage
from calibrary.records import replace

if TYPE_CHECKING:
    from calibrary.parsers import WriteVerdict
    from calibrary.parsers.unsized import UnsizedCalibration
    from calibrary.quality import Quality
    from calibrary.records import Json

__all__ = [
    "Argument",
    "Source",
    "choose",
    "chosen",
    "file_of",
    "is_one_camera",
    "read",
    "read_all",
    "read_arguments",
    "read_file",
    "read_unsized",
    "refit",
    "with_interior_orientation",
    "write",
]

Source: TypeAlias = str | Path | bytes | BinaryIO
"""A path, the bytes of a file, or a file opened in binary mode."""

MAX_BYTES: Final = Reading().max_bytes
LISTED: Final = 8
K_NAMES: Final = ("fx", "fy", "cx", "cy", "skew")
STAC_EXTENSION: Final = "https://stac-extensions.github.io/perspective-imagery/v1.0.0/schema.json"


def read(
    source: Source,
    *,
    camera: str | int | None = None,
    format: str | None = None,  # noqa: A002  the word of the field, and of numpy, PIL and pandas
    image_size: ImageSize | None = None,
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Calibration:
    """Read the camera from a calibration file of any format, or from the metadata of an image.

    Args:
        source: path, bytes, or a file opened in binary mode.
        camera: number of the camera in a file with several, from 1, or its name.
        format: name of the format or its program, if the file itself is ambiguous.
        image_size: (width, height) px, for files that do not state it.
        size_from_centre: whether to use twice the principal point as the image size if nothing states it.
        options: settings that only the owner of the file knows, as listed by the format, such as ``{"distortion":
            "fisheye"}``.
        max_bytes: largest accepted file.

    Raises:
        InputError: the file cannot be read, or contains several cameras and none was selected; also the errors that
            :func:`calibrary.parsers.read` lists.

    >>> camera = calibrary.read("camera.xml")
    >>> camera.intrinsics.fx
    3659.5
    >>> calibrary.read("survey/DJI_0001.JPG").grade
    <Grade.CALIBRATED: 'calibrated'>
    """
    found = read_all(
        source,
        format=format,
        image_size=image_size,
        size_from_centre=size_from_centre,
        options=options,
        max_bytes=max_bytes,
    )
    return choose(
        found, camera, source=_name(source), how="camera=N, or take all of them with calibrary.read_all"
    )


def read_all(
    source: Source,
    *,
    format: str | None = None,  # noqa: A002  as in read
    image_size: ImageSize | None = None,
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Read all cameras from a calibration file, in the file's order.

    Args:
        source: as for :func:`read`.
        format: as for :func:`read`.
        image_size: as for :func:`read`.
        size_from_centre: as for :func:`read`.
        options: as for :func:`read`.
        max_bytes: as for :func:`read`.

    Raises:
        InputError: the file cannot be read; also the errors that :func:`calibrary.parsers.read` lists.

    >>> [camera.camera.sub_camera for camera in calibrary.read_all("stereo.yml")]
    ['left', 'right']
    """
    from calibrary import parsers

    if isinstance(source, str | Path):
        return parsers.read(
            source,
            format=format,
            image_size=image_size,
            size_from_centre=size_from_centre,
            options=options,
            max_bytes=max_bytes,
        )
    data = source if isinstance(source, bytes) else _content(source, max_bytes)
    if format is None:
        from calibrary.parsers.imagery.reader import begins_as_image
        from calibrary.parsers.images import decode_image

        if begins_as_image(data):
            return decode_image(data, _name(source))
    return parsers.decode(
        data,
        name=_name(source),
        format=format,
        image_size=image_size,
        size_from_centre=size_from_centre,
        options=options,
        max_bytes=max_bytes,
    )


def write(
    cameras: Calibration | Sequence[Calibration],
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002  as in read
    max_error_px: float | None = None,
    allow_prior: bool = False,
    drop_distortion: bool = False,
) -> WriteVerdict:
    """Write a calibration file atomically, and report what the format could not represent.

    Args:
        cameras: one calibration, or several if the format allows it.
        path: file to create or replace.
        format: name of the format or of the program that reads it; by default determined by the path's suffix, if only
            one format uses it.
        max_error_px: largest allowed error in px, anywhere in the image, of a fitted distortion model, if the format
            lacks the original one; 0.05 px by default.
        allow_prior: whether to write a K that was not measured.
        drop_distortion: whether to write K alone if the format has no place for the distortion, and an unknown
            distortion as none if the format always states one.

    Returns:
        Whether the file represents the cameras exactly, by a fit or by K alone, the largest error in px, and what the
        format cannot represent.

    Raises:
        InputError: no format or several formats match the name, the file cannot be written, or a K is only an
            estimate.
        UnsupportedModelError: the format can represent the calibration only with a larger error, or would lose a
            distortion.

    >>> verdict = calibrary.write(calibrary.read("camera.xml"), "camera.yaml", format="opencv_storage")
    >>> verdict.outcome
    <Fidelity.EXACT: 'exact'>
    >>> calibrary.read("camera.yaml").intrinsics.fx
    3659.5
    """
    from calibrary import parsers
    from calibrary.calibration import Calibration

    return parsers.write(
        [cameras] if isinstance(cameras, Calibration) else cameras,
        path,
        format or parsers.format_by_suffix(path),
        max_error_px=max_error_px,
        allow_prior=allow_prior,
        drop_distortion=drop_distortion,
    )


def refit(camera: Calibration, model: str = "opencv", *, max_error_px: float | None = None) -> Calibration:
    """Return the closest calibration with a distortion model of another program.

    Args:
        camera: the original.
        model: "opencv" or "colmap", for the first of their models with an error of at most 0.05 px, else the closest
            one; or the name of one model.
        max_error_px: largest allowed error of a projection in px, anywhere in the image; 0.05 px by default.

    Returns:
        The same K with the new distortion, and without skew if the program has none. Equivalent models are converted
        exactly; after a fit, only the uncertainty of K alone is kept.

    Raises:
        UnsupportedModelError: no such model is close enough; the message states the error of the closest one.
        InputError: there is no model of that name.

    >>> camera = calibrary.read("AutoCal.xml")
    >>> camera.distortion.model
    'observed-brown'
    >>> K, dist = calibrary.refit(camera, "opencv").to_opencv()
    >>> dist.shape
    (5,)
    """
    from calibrary.distortion import MODELS
    from calibrary.interop.colmap import COLMAP_LENSES
    from calibrary.interop.opencv import OPENCV_LENSES
    from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX, adapt
    from calibrary.parsers.format import Capacity, UnknownLens
    from calibrary.records import replace

    families = {"opencv": OPENCV_LENSES, "colmap": COLMAP_LENSES}
    if model in families:
        capacity = Capacity(models=families[model], unknown_lens=UnknownLens.STATED)
    elif model in MODELS:
        capacity = Capacity(models=(MODELS[model],), skew=True, unknown_lens=UnknownLens.STATED)
    else:
        raise InputError(
            f"no distortion model {model!r:.60}; expected one of {', '.join([*families, *MODELS])}"
        )
    limit = DEFAULT_MAX_ERROR_PX if max_error_px is None else max_error_px
    fitted = adapt(camera, capacity, max_error_px=limit)
    if fitted.distortion == camera.distortion or fitted.quality is None:
        return fitted
    return replace(fitted, quality=_of_k_alone(fitted.quality))


def with_interior_orientation(item: Mapping[str, Any], calibration: Calibration) -> dict[str, Any]:
    """Return a copy of an Item or a Collection with K as ``pers:interior_orientation``, which has no distortion.

    Args:
        item: the Item as JSON, such as the result of ``pystac.Item.to_dict()``.
        calibration: calibration of the image's camera, at the image's size.

    >>> from calibrary.jobs.files import with_interior_orientation
    >>> camera = calibrary.read("camera.xml")
    >>> item = {"type": "Feature", "properties": {"datetime": "2026-05-03T10:00:00Z"}, "assets": {}}
    >>> stated = with_interior_orientation(item, camera)["properties"]["pers:interior_orientation"]
    >>> stated["sensor_array_dimensions"]
    [5472, 3648]
    """
    from calibrary.parsers.formats.stac_interior_orientation import FIELD, interior_orientation

    stated = {FIELD: interior_orientation(calibration)}
    extensions = list(dict.fromkeys([*item.get("stac_extensions", ()), STAC_EXTENSION]))
    if item.get("type") == "Collection":
        return {**item, **stated, "stac_extensions": extensions}
    return {**item, "properties": {**item.get("properties", {}), **stated}, "stac_extensions": extensions}


def read_file(path: Path, reading: Reading) -> Sequence[Calibration]:
    """Read all cameras in a file, or of a reconstruction in a folder, regardless of ``reading.camera``.

    Raises:
        InputError: as for :func:`calibrary.parsers.read`.
    """
    from calibrary import parsers

    with stage(f"read {path}"):
        if path.is_dir():
            path = file_of(path) or path
        if reading.format is None and (own := _printed(path, reading.max_bytes)):
            return own
        return parsers.read(
            path,
            format=reading.format,
            image_size=reading.image_size,
            size_from_centre=reading.size_from_centre,
            options=reading.options,
            max_bytes=reading.max_bytes,
        )


def file_of(folder: Path) -> Path | None:
    """The file with the cameras of a reconstruction by COLMAP, OpenSfM or ODM in a folder; None if there is none."""
    if not folder.is_dir():
        return None
    from calibrary.sfm.colmap_folder import colmap_cameras
    from calibrary.sfm.opensfm_folder import opensfm_cameras

    return colmap_cameras(folder) or opensfm_cameras(folder)


def _printed(path: Path, max_bytes: int) -> list[Calibration]:
    """The calibrations of a document that calibrary itself printed with --json; empty for any other file."""
    from calibrary.calibration import Calibration
    from calibrary.parsers.files import read_regular_file
    from calibrary.strictjson import parse_json

    if path.suffix.lower() != ".json" or not path.is_file():
        return []
    data = read_regular_file(path, max_bytes=max_bytes)
    if b'"pixel_origin"' not in data:
        return []
    document = parse_json(data, source=path.name)
    if not isinstance(document, dict):
        return []
    listed: list[Json] = [document]
    for name in ("calibrations", "cameras"):
        several = document.get(name)
        listed += several if isinstance(several, list) else []
    nodes = [one.get("calibration", one) for one in listed if isinstance(one, dict)]
    try:
        return [Calibration.from_dict(one) for one in nodes if isinstance(one, dict) and "intrinsics" in one]
    except InputError as error:
        raise type(error)(f"printed by calibrary, and changed since: {error}", source=path.name) from None


def read_unsized(path: Path, reading: Reading) -> list[Calibration | UnsizedCalibration]:
    """Read all cameras in a file that may not state its image size; such cameras are returned without it.

    Raises:
        InputError: as for :func:`calibrary.parsers.read`.
    """
    from calibrary import parsers

    return parsers.read_unsized(
        path, format=reading.format, options=reading.options, max_bytes=reading.max_bytes
    )


def chosen(path: Path, reading: Reading) -> Calibration:
    """Read the camera of a file that ``reading.camera`` chooses.

    Raises:
        InputError: as for :func:`calibrary.parsers.read` and :func:`choose`.
    """
    return choose(read_file(path, reading), reading.camera, source=path.name)


def choose(
    cameras: Sequence[Calibration], which: str | int | None, *, source: str, how: str = "--camera N"
) -> Calibration:
    """Choose one of a file's cameras.

    Args:
        cameras: all cameras of the file.
        which: number of the camera, from 1, or what only its name has; None for the only one.
        source: file name, for messages.
        how: how the user chooses a camera, for messages.

    Raises:
        InputError: there are several cameras and none is chosen, or none or several are of this number or name.
    """
    if which is None and len(cameras) == 1:
        return cameras[0]
    listed = first_of((f"{at} {item.camera}" for at, item in enumerate(cameras, start=1)), LISTED, "; ")
    if which is None:
        raise InputError(f"holds {len(cameras)} cameras, choose one with {how}: {listed}", source=source)
    name = str(which).casefold()
    if name.isdecimal():
        found = [one for at, one in enumerate(cameras, start=1) if at == int(name)]
    else:
        # A whole field of the key goes before a part of the camera's name: cam1 is not cam10.
        found = [one for one in cameras if name in map(str.casefold, _words_of(one))]
        found = found or [one for one in cameras if name in str(one.camera).casefold()]
    if len(found) != 1:
        number = "no" if not found else f"{len(found)} times a"
        raise InputError(
            f"has {number} camera {which!s:.80}; it holds {len(cameras)}, counted from 1, choose one with {how}: "
            f"{listed}",
            source=source,
        )
    return found[0]


def _words_of(one: Calibration) -> list[str]:
    key = one.camera
    return [word for word in (key.sub_camera, key.model, key.lens, str(key)) if word]


def _content(file: BinaryIO, max_bytes: int) -> bytes:
    if isinstance(file, io.TextIOBase):
        raise InputError("is open as text, open it in binary mode", source=_name(file))
    data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise InputError(f"is longer than {max_bytes} bytes, raise max_bytes to read it", source=_name(file))
    return data


def _name(source: object) -> str:
    if isinstance(source, str | Path):
        return Path(source).name
    name = getattr(source, "name", None)
    return Path(name).name if isinstance(name, str) else "bytes"


def _of_k_alone(quality: Quality) -> Quality:
    """Keep only the uncertainty of K: that of the original coefficients does not apply to fitted ones."""
    from calibrary.quality import Covariance
    from calibrary.records import replace

    covariance = quality.covariance
    held = tuple(name for name in K_NAMES if covariance is not None and name in covariance.names)
    return replace(
        quality,
        std={name: value for name, value in quality.std.items() if name in K_NAMES},
        covariance=Covariance.from_matrix(held, covariance.of(held))
        if covariance is not None and held
        else None,
        proven=None,
    )


class Argument(Struct, frozen=True, kw_only=True):
    """A calibration and its label.

    Attributes:
        label: file name, or KEY@REV.
        calibration: the calibration.
    """

    label: str
    calibration: Calibration


def read_arguments(
    first: Calibration | str | Path,
    second: Calibration | str | Path,
    reading: Reading,
    registry: Place | Sequence[Place] | None = None,
) -> tuple[Argument, Argument]:
    """Read two calibrations of one camera; a file without an image size gets that of the other.

    A file takes precedence over an entry. ``reading.camera`` may name two, "cam0,cam1", one for each; one alone is that
    of a file with several.

    Raises:
        MissingTagError: neither states an image size.
        InputError: a file cannot be read, or contains several cameras and none is chosen.
        RegistryError: neither a file nor an entry has that name.
    """
    a, b = _labelled("a", first), _labelled("b", second)
    size = reading.image_size
    of_a, of_b = reading, reading
    read = partial(_read, registry=registry, is_for_several="," not in str(reading.camera))
    if isinstance(reading.camera, str) and "," in reading.camera:
        left, _, right = (part.strip() for part in reading.camera.partition(","))
        of_a, of_b = replace(reading, camera=left), replace(reading, camera=right)
    try:
        one = read(a, of_a, image_size=size)
    except MissingTagError:
        two = read(b, of_b, image_size=size)
        return read(a, of_a, image_size=two.calibration.intrinsics.image_size), two
    try:
        return one, read(b, of_b, image_size=size)
    except MissingTagError:
        return one, read(b, of_b, image_size=one.calibration.intrinsics.image_size)


def _labelled(label: str, given: Calibration | str | Path) -> Argument | str | Path:
    return Argument(label=label, calibration=given) if isinstance(given, Calibration) else given


def _read(
    given: Argument | str | Path,
    reading: Reading,
    registry: Place | Sequence[Place] | None,
    *,
    image_size: ImageSize | None,
    is_for_several: bool = False,
) -> Argument:
    from calibrary.registry.entry import noted
    from calibrary.registry.entry_yaml import entry_file, parse_entry

    if isinstance(given, Argument):
        return given
    text, path = str(given), Path(given)
    if not path.exists():
        return _entry(text, registry)
    if not path.is_file() and (inside := file_of(path)) is not None:
        path = inside
    if not path.is_file():
        raise InputError("is not a regular file, expected one calibration file or image", source=text)
    if reading.format is None and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        return Argument(label=text, calibration=noted(entry))
    calibrations = read_file(path, replace(reading, image_size=image_size))
    is_only = len(calibrations) == 1 and is_for_several
    number = 1 if is_only or (reading.camera is None and is_one_camera(calibrations)) else reading.camera
    return Argument(label=text, calibration=choose(calibrations, number, source=text))


def is_one_camera(calibrations: Sequence[Calibration]) -> bool:
    """Whether all have equal K and distortion, because some programs list a camera under several names."""
    first = calibrations[0]
    return all(
        (one.intrinsics, one.distortion) == (first.intrinsics, first.distortion) for one in calibrations
    )


def _entry(text: str, registry: Place | Sequence[Place] | None) -> Argument:
    from calibrary.registry.entry import noted
    from calibrary.registry.places import one_registry
    from calibrary.registry.registry import Registry

    ending = Path(text).suffix[1:]
    # What a KEY ends in after a full stop are digits of a focal length.
    looks_like_a_file = ending and not ending.isdigit() and "@" not in text
    try:
        stored = Registry.open(one_registry(registry)).get(text)
    except RegistryError:
        if looks_like_a_file:
            raise InputError("no such file, and no such entry in a registry", source=text) from None
        raise
    rev = text.partition("@")[2]
    return Argument(label=f"{stored.id}@{rev or (stored.commit or '')[:12]}", calibration=noted(stored.entry))
