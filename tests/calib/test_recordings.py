"""Recordings are frames: the sharpest of each stretch of a video or of a topic of a bag, named by their time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calibrary
from calibrary.calib.recordings import write_frames
from calibrary.errors import InputError, ParseError
from calibrary.jobs.calibrate.frames import find_frames, is_recording, parted, recorded
from calibrary.jobs.calibrate.pairing import find_rig
from calibrary.jobs.calibrate_watch.session import Watch
from tests.calib.photographs import BOARD, Gray, photograph

RATE = 10


def blurred(gray: Gray) -> Gray:
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), 4), dtype=np.uint8)


def scenes(count: int) -> list[Gray]:
    """Half a second of each pose, of which the fourth frame alone is sharp."""
    shown = []
    for number in range(count):
        sharp = photograph("checkerboard:9x6", number)[0]
        shown += [sharp if at == 3 else blurred(sharp) for at in range(RATE // 2)]
    return shown


def video(path: Path, frames: Sequence[Gray]) -> Path:
    av = pytest.importorskip("av")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=RATE)
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt, stream.bit_rate = "yuv420p", 40_000_000
        for gray in frames:
            made = av.VideoFrame.from_ndarray(np.dstack([gray] * 3), format="rgb24")
            container.mux(stream.encode(made))
        container.mux(stream.encode())
    return path


def bag(path: Path, frames: Sequence[Gray], topics: Sequence[str] = ("/image_raw",), **made: Any) -> Path:
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "sensor_msgs/msg/" + ("CompressedImage" if made.get("compressed") else "Image")
    message, time = store.types[kind], store.types["builtin_interfaces/msg/Time"]
    with Writer(path) as writer:
        connections = [writer.add_connection(topic, kind, typestore=store) for topic in topics]
        for at, gray in enumerate(frames):
            header = store.types["std_msgs/msg/Header"](seq=at, stamp=time(0, 0), frame_id="")
            if made.get("compressed"):
                data = np.frombuffer(cv2.imencode(".png", gray)[1] if gray.size else b"", np.uint8)
                one = message(header=header, format="png", data=data)
            else:
                pixels = made.get("pixels", lambda gray: gray)(gray)
                one = message(
                    header=header, height=gray.shape[0], width=gray.shape[1], encoding=made.get("encoding", "mono8"),
                    is_bigendian=made.get("is_bigendian", 0), step=pixels.strides[0],
                    data=np.frombuffer(pixels.tobytes(), np.uint8),
                )  # fmt: skip
            for connection in connections:
                writer.write(connection, at * 1_000_000_000 // RATE, store.serialize_ros1(one, kind))
    return path


def read(path: Path) -> Gray:
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))


def test_of_each_half_second_of_a_video_the_sharpest_frame_is_kept(tmp_path: Path) -> None:
    kept, count, _ = write_frames(video(tmp_path / "clip.mp4", scenes(3)), None, tmp_path)
    assert count == 15
    assert [path.name for path in kept] == [f"clip-00000.{at}00s.png" for at in (3, 8)] + [
        "clip-00001.300s.png"
    ]
    assert np.abs(read(kept[0]).astype(int) - photograph("checkerboard:9x6", 0)[0]).mean() < 4


def test_a_video_is_calibrated_from_and_its_frames_are_named_by_time(tmp_path: Path) -> None:
    result = calibrary.calibrate(video(tmp_path / "clip.mp4", scenes(6)), board="checkerboard:9x6")
    assert [view.name for view in result.views][:2] == ["clip-00000.300s.png", "clip-00000.800s.png"]
    assert "clip.mp4: 6 of 30 frames, the sharpest of each stretch" in " ".join(result.notes)


@pytest.mark.parametrize(
    "made",
    [
        {},
        {"compressed": True},
        {"encoding": "rgb8", "pixels": lambda gray: np.dstack([gray] * 3)},
        {"encoding": "bgra8", "pixels": lambda gray: np.dstack([gray] * 4)},
        {"encoding": "mono8", "pixels": lambda gray: np.pad(gray, ((0, 0), (0, 8)))},
    ],
)
def test_images_of_a_bag_are_kept_to_the_bit(tmp_path: Path, made: dict[str, Any]) -> None:
    [sharp, *_] = frames = [scenes(1)[3], *scenes(1)[:2]]
    kept, count, _ = write_frames(bag(tmp_path / "run.bag", frames, **made), None, tmp_path)
    assert (count, [path.name for path in kept]) == (3, ["run-00000.000s.png"])
    assert np.array_equal(read(kept[0]), sharp)


def test_sixteen_bits_and_a_mosaic(tmp_path: Path) -> None:
    gray = scenes(1)[3]
    deep = bag(tmp_path / "deep.bag", [gray], encoding="mono16", pixels=lambda gray: gray.astype("<u2") * 16)
    assert np.array_equal(read(write_frames(deep, None, tmp_path)[0][0]), gray.astype(np.uint16) * 16)
    swapped = bag(
        tmp_path / "swapped.bag", [gray], encoding="bgr16", is_bigendian=1,
        pixels=lambda gray: (np.dstack([gray] * 3).astype(np.uint16) * 16).astype(">u2"),
    )  # fmt: skip
    assert np.array_equal(read(write_frames(swapped, None, tmp_path)[0][0]), gray.astype(np.uint16) * 16)
    mosaic = bag(tmp_path / "mosaic.bag", [gray], encoding="bayer_rggb8")
    shown = read(write_frames(mosaic, None, tmp_path)[0][0])
    assert np.abs(shown.astype(int) - gray)[2:-2, 2:-2].mean() < 3


@pytest.mark.parametrize(
    "encoding", ["mono12", "bayer_rggb12", "mono10p", "bayer_xxxx8", "8UC3", "yuv422", ""]
)
def test_other_encodings_are_refused_by_name(tmp_path: Path, encoding: str) -> None:
    path = bag(tmp_path / "run.bag", [scenes(1)[3]], encoding=encoding)
    with pytest.raises(ParseError, match=rf"run.bag: has images of encoding '{encoding}', expected gray"):
        write_frames(path, None, tmp_path)


EMPTY = np.zeros((0, 64), np.uint8)


@pytest.mark.parametrize("compressed", [True, False])
def test_an_empty_image_of_a_bag_is_skipped_and_counted(tmp_path: Path, compressed: bool) -> None:
    path = bag(tmp_path / "run.bag", [EMPTY, scenes(1)[3], EMPTY], compressed=compressed)
    kept, count, unreadable = write_frames(path, None, tmp_path)
    assert (len(kept), count, len(unreadable)) == (1, 1, 2)
    with recorded([path]) as (_, notes):
        assert "run.bag: 2 more cannot be read and were skipped; the first is an empty" in notes[1]


@pytest.mark.parametrize("compressed", [True, False])
def test_a_bag_of_empty_images_is_refused(tmp_path: Path, compressed: bool) -> None:
    path = bag(tmp_path / "run.bag", [EMPTY], compressed=compressed)
    with pytest.raises(ParseError, match=r"run.bag: none of its 1 frames can be read; the first is an empty"):
        write_frames(path, None, tmp_path)


@pytest.mark.parametrize("name", ["run.mcap", "run.db3"])
def test_a_file_out_of_the_folder_of_its_bag_is_told(tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags")
    (tmp_path / name).write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(InputError, match=rf"{name}: .*give the bag's folder with its metadata.yaml"):
        write_frames(tmp_path / name, None, tmp_path)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("run_0.mcap", "with run_0.mcap, but without the metadata.yaml of a ROS 2 bag: .*ros2 bag reindex"),
        ("clip.mp4", r"with recordings, which are given by name \(clip.mp4\)"),
    ],
)
def test_of_a_folder_without_images_it_is_told_what_recordings_it_has(
    tmp_path: Path, name: str, said: str
) -> None:
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(InputError, match=said):
        find_frames([tmp_path])


def test_a_rig_and_a_watch_refuse_recordings_by_what_they_take(tmp_path: Path) -> None:
    left, right = tmp_path / "left.mp4", tmp_path / "right.bag"
    with pytest.raises(InputError, match=r"left.mp4: is a recording; .* give image files"):
        find_rig([left, right])
    with pytest.raises(InputError, match=r"right.bag:/cam0: is a recording; expected the folder in which"):
        Watch(Path(f"{right}:/cam0"), BOARD)


def test_of_several_topics_one_is_named(tmp_path: Path) -> None:
    path = bag(tmp_path / "two.bag", scenes(1), topics=("/cam0/image_raw", "/cam1/image_raw"))
    with pytest.raises(InputError, match=r"images on 2 topics, /cam0/image_raw, /cam1/image_raw; name one"):
        write_frames(path, None, tmp_path)
    assert parted(Path(f"{path}:/cam1/image_raw")) == (path, "/cam1/image_raw")
    assert len(write_frames(*parted(Path(f"{path}:/cam1/image_raw")), tmp_path)[0]) == 1
    with pytest.raises(InputError, match="no images on /cam2"):
        write_frames(path, "/cam2", tmp_path)


def test_a_long_recording_is_thinned(tmp_path: Path) -> None:
    gray = np.random.default_rng(1).integers(0, 255, (64, 64), dtype=np.uint8)
    kept, count, _ = write_frames(bag(tmp_path / "long.bag", [gray] * 700), None, tmp_path)
    assert (count, len(kept)) == (700, 35)


@pytest.mark.parametrize("name", ["clip.mp4", "run.bag"])
def test_what_is_no_recording_is_told(tmp_path: Path, name: str) -> None:
    pytest.importorskip("av" if name.endswith("mp4") else "rosbags")
    (tmp_path / name).write_bytes(b"no recording at all" * 20)
    with pytest.raises(InputError, match=rf"{name}: cannot be (decoded|read)"):
        write_frames(tmp_path / name, None, tmp_path)
    assert is_recording(tmp_path / name)
    with pytest.raises(InputError, match="no such file"):
        write_frames(tmp_path / f"not-{name}", None, tmp_path)
