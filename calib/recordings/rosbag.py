"""Frames of a bag of ROS 1 or ROS 2, by rosbags, which needs no ROS.

``sensor_msgs/Image`` is taken as it is; a raw mosaic is interpolated to gray, as ROS's image_proc does. Of a
``CompressedImage`` the JPEG or PNG is kept, to the byte.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calibrary.calib.recordings.sharpest import Shot, Unreadable
from calibrary.errors import InputError, ParseError
from calibrary.extras import require

OF_A_FOLDER: Final = frozenset({".mcap", ".db3"})
SUFFIXES: Final = OF_A_FOLDER | {".bag"}
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
DESCRIPTION: Final = "metadata.yaml"
"""The file in the folder of a ROS 2 bag that describes it."""
REINDEX: Final = f"give the bag's folder with its {DESCRIPTION} (ros2 bag reindex FOLDER writes one)"
# OpenCV names a mosaic by the second and third pixel of its second row.
CONVERSIONS: Final[dict[str, tuple[int, str]]] = {
    "mono": (1, ""),
    "rgb": (3, "RGB"),
    "bgr": (3, "BGR"),
    "rgba": (4, "RGBA"),
    "bgra": (4, "BGRA"),
    "bayer_rggb": (1, "BayerBG"),
    "bayer_bggr": (1, "BayerRG"),
    "bayer_gbrg": (1, "BayerGR"),
    "bayer_grbg": (1, "BayerGB"),
}
ENCODINGS: Final[dict[str, tuple[int, int, str]]] = {
    **{
        f"{name}{8 * depth}": (channels, depth, conversion)
        for name, (channels, conversion) in CONVERSIONS.items()
        for depth in (1, 2)
    },
    "8UC1": (1, 1, ""),
    "16UC1": (1, 2, ""),
}
"""Channels, bytes of each and OpenCV's name of the colours, by the names of sensor_msgs/image_encodings."""
FILES: Final = {b"\xff\xd8\xff": ".jpg", b"\x89PNG\r\n\x1a\n": ".png"}
LISTED: Final = 8


def read(path: Path, topic: str | None = None) -> Iterator[Shot | Unreadable]:
    """Yield the images of a topic; an empty or damaged one as :class:`Unreadable`.

    Args:
        path: a .bag, or the folder or file of a ROS 2 bag.
        topic: None for the only one with images.

    Raises:
        InputError: the bag cannot be read, or several topics have images and none is chosen.
        MissingExtraError: rosbags is not installed.
    """
    require(("rosbags",), "reading a bag of ROS")
    from rosbags.highlevel import AnyReader, AnyReaderError
    from rosbags.typesys import Stores, get_typestore

    whole = path
    if path.suffix.lower() in OF_A_FOLDER:
        whole = path.parent
        if not (whole / DESCRIPTION).is_file():
            raise InputError(
                f"is one file of a ROS 2 bag without the {DESCRIPTION} that belongs beside it: {REINDEX}",
                source=path.name,
            )
    try:
        with AnyReader([whole], default_typestore=get_typestore(Stores.LATEST)) as reader:
            of_images = [one for one in reader.connections if one.msgtype in {IMAGE, COMPRESSED}]
            chosen = _chosen(sorted({one.topic for one in of_images}), topic, path.name)
            wanted = [one for one in of_images if one.topic == chosen]
            for connection, time_ns, raw in reader.messages(connections=wanted):
                message: Any = reader.deserialize(raw, connection.msgtype)
                seconds = (time_ns - reader.start_time) * 1e-9
                yield _shot(message, seconds, path.name)
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        if isinstance(error, InputError):
            raise
        raise ParseError(f"cannot be read as a bag of ROS: {error}", source=path.name) from None


def _chosen(topics: list[str], topic: str | None, source: str) -> str:
    if topic is None and len(topics) == 1:
        return topics[0]
    listed = ", ".join(topics[:LISTED]) or "none"
    if topic is None and topics:
        raise InputError(
            f"has images on {len(topics)} topics, {listed}; name one: {source}:{topics[0]}", source=source
        )
    if topic not in topics:
        wanted = f"no images on {topic:.80}" if topic else "no topic with images"
        raise InputError(f"has {wanted}; topics with images: {listed}", source=source)
    return topic


def _shot(message: Any, seconds: float, source: str) -> Shot | Unreadable:
    """Return the image of a message; an encoding that is not read is that of the whole topic, and ends the run."""
    import cv2

    if not hasattr(message, "encoding"):
        return _compressed(message, seconds)
    try:
        found = ENCODINGS[message.encoding]
    except KeyError:
        raise ParseError(
            f"has images of encoding {message.encoding!r:.40}, expected gray, colours or a Bayer mosaic of 8 or 16 "
            "bits, such as mono8, rgb8 or bayer_rggb8; convert the topic first",
            source=source,
        ) from None
    try:
        return _raw(message, seconds, *found)
    except cv2.error as error:
        return Unreadable(
            why=f"an image of {message.width}×{message.height} px that OpenCV refuses: {error.err}"
        )


def _compressed(message: Any, seconds: float) -> Shot | Unreadable:
    import cv2

    file = bytes(message.data)
    if not file:
        return Unreadable(why="an empty compressed image")
    suffix = next((suffix for head, suffix in FILES.items() if file.startswith(head)), None)
    try:
        pixels = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    except cv2.error:  # of a size beyond OpenCV's limits
        pixels = None
    if suffix is None or pixels is None:
        return Unreadable(why=f"a compressed image ({message.format:.40}) that is no whole JPEG or PNG")
    return Shot(seconds=seconds, pixels=pixels, file=file, suffix=suffix)


def _raw(message: Any, seconds: float, channels: int, depth: int, conversion: str) -> Shot | Unreadable:
    """Return the pixels of an Image in gray; its rows may be padded, and its bytes in either order."""
    import cv2

    height, width, step = message.height, message.width, message.step
    rows = np.frombuffer(bytes(message.data), np.uint8)
    row = width * channels * depth
    if not rows.size or not row:
        return Unreadable(why=f"an empty image of {width}×{height} px")
    if rows.size != height * step or step < row:
        return Unreadable(
            why=f"an image of {rows.size} bytes, expected {height} rows of {step} with {width} px of "
            f"{message.encoding}"
        )
    pixels: NDArray[Any] = np.ascontiguousarray(rows.reshape(height, step)[:, :row])
    if depth == 2:
        pixels = pixels.view(">u2" if message.is_bigendian else "<u2").astype(np.uint16)
    if conversion:
        colours = pixels if channels == 1 else pixels.reshape(height, width, channels)
        pixels = np.asarray(cv2.cvtColor(colours, getattr(cv2, f"COLOR_{conversion}2GRAY")))
    return Shot(seconds=seconds, pixels=pixels)
