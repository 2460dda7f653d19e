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

from calibrary.calib.recordings.sharpest import Shot
from calibrary.errors import InputError, ParseError
from calibrary.extras import require

__all__ = ["SUFFIXES", "read"]

SUFFIXES: Final = frozenset({".bag", ".mcap", ".db3"})
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CHANNELS: Final = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4, "bayer_": 1, "8UC": 1, "16UC": 1}
MOSAICS: Final = {"rggb": "BayerBG", "bggr": "BayerRG", "gbrg": "BayerGR", "grbg": "BayerGB"}
"""OpenCV names a mosaic by the second and third pixel of its second row."""
LISTED: Final = 8


def read(path: Path, topic: str | None = None) -> Iterator[Shot]:
    """Yield the images of a topic.

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

    # A ROS 2 bag is its folder, with the file that describes it.
    whole = path.parent if path.suffix.lower() in {".mcap", ".db3"} else path
    try:
        with AnyReader([whole], default_typestore=get_typestore(Stores.LATEST)) as reader:
            of_images = [one for one in reader.connections if one.msgtype in {IMAGE, COMPRESSED}]
            chosen = _chosen(sorted({one.topic for one in of_images}), topic, path.name)
            wanted = [one for one in of_images if one.topic == chosen]
            for connection, time_ns, raw in reader.messages(connections=wanted):
                message: Any = reader.deserialize(raw, connection.msgtype)
                seconds = (time_ns - reader.start_time) * 1e-9
                if connection.msgtype == COMPRESSED:
                    yield _compressed(message, seconds, path.name)
                else:
                    yield Shot(seconds=seconds, pixels=_gray(message, path.name))
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


def _compressed(message: Any, seconds: float, source: str) -> Shot:
    import cv2

    file = bytes(message.data)
    pixels = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if pixels is None:
        raise ParseError(
            f"has a compressed image ({message.format:.40}) that is no JPEG or PNG", source=source
        )
    suffix = ".jpg" if file.startswith(b"\xff\xd8") else ".png"
    return Shot(seconds=seconds, pixels=pixels, file=file, suffix=suffix)


def _gray(message: Any, source: str) -> NDArray[Any]:
    """Return the pixels of an Image, (H, W); its rows may be padded, and its bytes in either order."""
    import cv2

    encoding = str(message.encoding)
    deep = encoding.endswith("16") or encoding.startswith("16UC1")
    kind = next((name for name in sorted(CHANNELS, key=len, reverse=True) if encoding.startswith(name)), None)
    if kind is None or (kind.endswith("UC") and not encoding.endswith("C1")):
        raise ParseError(
            f"has images of encoding {encoding!r:.40}, which are not gray or colours", source=source
        )
    channels, width = CHANNELS[kind], 2 if deep else 1
    rows = np.frombuffer(bytes(message.data), np.uint8)
    if rows.size != message.height * message.step or message.step < message.width * channels * width:
        raise ParseError(
            f"has an image of {rows.size} bytes, expected {message.height} rows of {message.step}",
            source=source,
        )
    rows = rows.reshape(message.height, message.step)[:, : message.width * channels * width]
    pixels: NDArray[Any] = np.ascontiguousarray(rows)
    if deep:
        pixels = pixels.view(np.dtype(np.uint16).newbyteorder(">" if message.is_bigendian else "<"))
        pixels = pixels.astype(np.uint16)
    if kind == "bayer_":
        return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{MOSAICS[encoding[6:10]]}2GRAY")))
    if channels == 1:
        return pixels
    order = "RGB" if kind.startswith("rgb") else "BGR"
    alpha = "A" if channels == 4 else ""
    colours = pixels.reshape(message.height, message.width, channels)
    return np.asarray(cv2.cvtColor(colours, getattr(cv2, f"COLOR_{order}{alpha}2GRAY")))
