"""Read and write calibration files of any format, and read images.

>>> from calibrary.jobs.files import read, refit, write
>>> camera = read("camera.xml")
>>> write(camera, "camera.yaml", format="opencv_storage").outcome
<Fidelity.EXACT: 'exact'>
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, TypeAlias

from calibrary import parsers
from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import MODELS
from calibrary.errors import InputError
from calibrary.interop.colmap import COLMAP_LENSES
from calibrary.interop.opencv import OPENCV_LENSES
from calibrary.jobs.files.reading import choose
from calibrary.parsers.discovery import listing as format_listing
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX, adapt
from calibrary.parsers.format import Capacity, Format
from calibrary.quality import Covariance, Quality
from calibrary.records import replace

__all__ = [
    "MAX_BYTES",
    "Source",
    "format_listing",
    "formats",
    "read",
    "read_all",
    "refit",
    "write",
]

Source: TypeAlias = str | Path | bytes | BinaryIO
"""A path, the bytes of a file, or a file opened in binary mode."""

K_NAMES = ("fx", "fy", "cx", "cy", "skew")


def read(
    source: Source,
    *,
    camera: int | None = None,
    format: str | None = None,  # noqa: A002  the word of the field, and of numpy, PIL and pandas
    image_size: ImageSize | None = None,
    size_from_centre: bool = False,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Calibration:
    """Read the camera from a calibration file of any format, or from the metadata of an image.

    Args:
        source: path, bytes, or a file opened in binary mode.
        camera: number of the camera in a file with several, from 1.
        format: name of the format, if the file itself is ambiguous.
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
) -> parsers.WriteVerdict:
    """Write a calibration file atomically, and report what the format could not represent.

    Args:
        cameras: one calibration, or several if the format allows it.
        path: file to create or replace.
        format: name of the format; by default determined by the path's suffix, if only one format uses it.
        max_error_px: largest allowed error in px, anywhere in the image, of a fitted distortion model, if the format
            lacks the original one; 0.05 px by default.
        allow_prior: whether to write a K that was not measured.

    Returns:
        Whether the file represents the cameras exactly or by a fit, the error of the fit in px, and what the format
        cannot represent.

    Raises:
        InputError: no format or several formats match the name, the file cannot be written, or a K is only an
            estimate.
        UnsupportedModelError: the format can represent the calibration only with a larger error.

    >>> verdict = calibrary.write(calibrary.read("camera.xml"), "camera.yaml", format="opencv_storage")
    >>> verdict.outcome
    <Fidelity.EXACT: 'exact'>
    >>> calibrary.read("camera.yaml").intrinsics.fx
    3659.5
    """
    chosen = [cameras] if isinstance(cameras, Calibration) else list(cameras)
    return parsers.write(
        chosen,
        path,
        format or parsers.format_by_suffix(path),
        max_error_px=max_error_px,
        allow_prior=allow_prior,
    )


def refit(
    camera: Calibration, model: str = "opencv", *, max_error_px: float = DEFAULT_MAX_ERROR_PX
) -> Calibration:
    """Return the closest calibration with a distortion model of another program.

    Args:
        camera: the original.
        model: "opencv" or "colmap", for the first of their models with an error of at most 0.05 px, else the closest
            one; or the name of one model.
        max_error_px: largest allowed error of a projection in px, anywhere in the image.

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
    families = {"opencv": OPENCV_LENSES, "colmap": COLMAP_LENSES}
    if model in families:
        capacity = Capacity(models=families[model])
    elif model in MODELS:
        capacity = Capacity(models=(MODELS[model],), skew=True)
    else:
        raise InputError(
            f"no distortion model {model!r:.60}; expected one of {', '.join([*families, *MODELS])}"
        )
    fitted = adapt(camera, capacity, max_error_px=max_error_px)
    if fitted.distortion == camera.distortion or fitted.quality is None:
        return fitted
    return replace(fitted, quality=_of_k_alone(fitted.quality))


def formats(word: str = "") -> list[Format]:
    """Return the formats that contain ``word`` in their name or title; by default all formats.

    >>> from calibrary.jobs.files import formats
    >>> [one.name for one in formats("kalibr")]
    ['kalibr', 'kalibr_results']
    """
    wanted = word.casefold()
    return [
        one for one in parsers.formats() if wanted in one.name.casefold() or wanted in one.title.casefold()
    ]


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
    covariance = quality.covariance
    held = tuple(name for name in K_NAMES if covariance is not None and name in covariance.names)
    return replace(
        quality,
        std={name: value for name, value in quality.std.items() if name in K_NAMES},
        covariance=Covariance.from_matrix(held, covariance.of(held))
        if covariance is not None and held
        else None,
    )
