"""What reading calibration files costs, as files per second and as ratios from one run on one machine.

    python benchmarks/parsers.py [--quick] [--files N] [--repeats R]

* Every format's small file, recognised and read from memory, next to ``yaml.safe_load``, ``lxml.etree`` or
  ``json.loads`` on the same bytes alone. Those do a few microseconds' work on such a file, so that the ratio says
  what recognising it among all formats and building the camera costs beside it.
* The same for files of a real project's length: many cameras, or few among thousands of images and points.
* Ten thousand files of all formats mixed, from disk, in one process.
* COLMAP's, Bundler's and VisualSFM's file with a camera for every image, next to COLMAP's own library.

The rows are those of :mod:`benchmarks.table`. Times are the processor's, which other work on the machine hardly
changes; repetitions are interleaved and the median counts. Nothing here fails on a slow machine; a goal is met or
missed, and that is printed.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

import lxml.etree
import pycolmap
import yaml

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey
from calibrary.parsers.format import Format
from calibrary.records import replace

sys.path.append(str(Path(__file__).parents[1]))

from benchmarks.table import at_least, compared, machine, show
from tests.parsers.cameras import SIZE
from tests.parsers.samples import exported
from tests.parsers.test_contract import a_camera_for

CAMERAS = 300
IMAGES = 3000
SMALL_BYTES = 2_000
LONGEST_SMALL_S = 1e-3
"""For a file below that size, so that a folder of 10 000 takes 10 s; a multiple of a bare parser's few microseconds
would say nothing to a user."""
MOST_TIMES = 3
"""A larger file, of a bare parser's time."""
SHORTEST_S = 0.02
"""How long one repetition of one thing takes at least."""

Load = Callable[[bytes], object]
SMALL = (752, 480)
"""Size of the images of the files that formats without a writer export."""
OF_FULL_SIZE = {"adobe_lcp", "lensfun_xml"}
"""Formats without a writer whose exported file is of a camera of full size, and may say so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """A calibration file and what its reader has to be given.

    Attributes:
        record: its format.
        name: its name.
        data: its bytes.
        options: answers to the format's questions.
    """

    record: Format
    name: str
    data: bytes
    options: Mapping[str, str]

    @property
    def size(self) -> tuple[int, int] | None:
        """What the caller gives of the image size: that of a written camera, or the small one of an exported file."""
        if not self.record.needs_image_size:
            return None
        return SIZE if self.record.write is not None or self.record.name in OF_FULL_SIZE else SMALL

    def read(self, *, named: bool = False) -> Sequence[Calibration]:
        """Recognise the file, unless its format is named, and read it."""
        return parsers.decode(
            self.data,
            name=self.name,
            format=self.record if named else None,
            image_size=self.size,
            options=self.options,
        )


def small_files() -> Iterator[File]:
    """One of each format and each syntax."""
    for record in parsers.formats():
        if record.write is not None:
            for suffix in record.suffixes:
                name = f"camera{suffix}"
                data, _ = parsers.encode([a_camera_for(record)], record, name=name)
                yield File(record=record, name=name, data=data, options={})
        elif record.read is not None:
            sample = exported()[record.name]
            if sample.beside:  # a list of other files, whose reading is what it costs
                continue
            name = f"camera{record.suffixes[0]}"
            yield File(record=record, name=name, data=sample.data, options=sample.options)


def long_files() -> Iterator[File]:
    """Many cameras in one file, and one camera among the images of a project."""
    for record in parsers.formats():
        if record.capacity is not None and record.capacity.several_cameras:
            item = a_camera_for(record)
            cameras = [
                replace(item, camera=CameraKey(image_size=SIZE, sub_camera=f"camera {index:03}"))
                for index in range(CAMERAS)
            ]
            for suffix in record.suffixes:
                name = f"cameras{suffix}"
                data, _ = parsers.encode(cameras, record, name=name)
                yield File(record=record, name=name, data=data, options={})
    by_name = {record.name: record for record in parsers.formats()}
    for name, data in (
        ("metashape_document", metashape_project()),
        ("opensfm", opensfm_reconstruction()),
        ("transforms_json", frames()),
        ("pix4d_camera_parameters", pix4d_images()),
    ):
        record = by_name[name]
        yield File(record=record, name=f"project{record.suffixes[0]}", data=data, options={})


def metashape_project() -> bytes:
    """One sensor and the places of thousands of images."""
    transform = " ".join(f"{index / 7:.16f}" for index in range(16))
    images = "".join(
        f'<camera id="{index}" sensor_id="0" label="DJI_{index:04}.JPG"><transform>{transform}</transform>'
        f'<orientation>1</orientation><reference x="7.{index}" y="46.{index}" z="500" enabled="true"/></camera>'
        for index in range(IMAGES)
    )
    document = exported()["metashape_document"].data.decode()
    return document.replace("</sensors>", f"</sensors><cameras>{images}</cameras>").encode()


def opensfm_reconstruction() -> bytes:
    """One camera, thousands of shots and points."""
    [item] = [a_camera_for(record) for record in parsers.formats() if record.name == "opensfm"]
    [document] = [json.loads(parsers.encode([item], "opensfm", name="reconstruction.json")[0])]
    scene = document[0] if isinstance(document, list) else {"cameras": document}
    [name] = scene["cameras"]
    scene["shots"] = {
        f"DJI_{index:04}.JPG": {"rotation": [0.1, 0.2, 0.3], "translation": [1.5, 2.5, 3.5], "camera": name}
        for index in range(IMAGES)
    }
    scene["points"] = {
        str(index): {"color": [1.0, 2.0, 3.0], "coordinates": [index / 3, index / 7, 1.0]}
        for index in range(4 * IMAGES)
    }
    return json.dumps([scene]).encode()


def frames() -> bytes:
    """One camera and the places of thousands of images."""
    [item] = [a_camera_for(record) for record in parsers.formats() if record.name == "transforms_json"]
    document = json.loads(parsers.encode([item], "transforms_json", name="transforms.json")[0])
    place = [[index / 3 for index in range(4)]] * 4
    document["frames"] = [
        {"file_path": f"images/{index}.jpg", "transform_matrix": place} for index in range(IMAGES)
    ]
    return json.dumps(document).encode()


def pix4d_images() -> bytes:
    """Thousands of images that share a camera."""
    heading, _, image = exported()["pix4d_camera_parameters"].data.partition(b"\n\n")
    return heading + b"\n\n" + b"".join(image.replace(b"0001", b"%04d" % index) for index in range(IMAGES))


def alone(file: File) -> tuple[str, Load] | None:
    """The parser that does nothing but take the syntax apart, None where the syntax is the format's own."""
    start = file.data.lstrip()[:1]
    if start == b"<":
        return "lxml", lxml.etree.fromstring
    if start in (b"{", b"[") and file.record.suffixes[0] in {".json", ".sfm", ".yml"}:
        return "json", json.loads
    if Path(file.name).suffix in {".yaml", ".yml"}:
        return "yaml", yaml.safe_load
    return None


def plain(file: File) -> bytes:
    """The bytes in what the plain parser takes: YAML without OpenCV's own marks."""
    if file.data.startswith(b"%YAML") or Path(file.name).suffix in {".yaml", ".yml"}:
        text = re.sub(rb"\A%YAML:1\.0", b"#YAML:1.0", file.data).replace(b"!!opencv-matrix", b"")
        return re.sub(rb"(?m)^(\w+\.\w+):(?=\S)", rb"\1: ", text)
    return file.data


def per_format(files: list[File], repeats: int) -> None:
    """What each format takes, recognised first or named, and how many times longer than the plain parser that is."""
    for file in files:
        peer = alone(file)
        contestants: dict[str, Callable[[], object]] = {
            "read": file.read,
            "named": partial(file.read, named=True),
        }
        if peer is not None:
            contestants["plain"] = partial(peer[1], plain(file))
        times = interleaved(contestants, repeats)
        measure = (
            f"read {file.record.name}, {file.name}, {len(file.data)} bytes "
            f"({median(times['named']) * 1e6:.0f} µs with the format named)"
        )
        ours = median(times["read"])
        if peer is None:
            limit, met = _limit(file, ours, None)
            show(measure, f"{ours * 1e6:.0f} µs", limit=limit, met=met)
            continue
        ratio = median(a / b for a, b in zip(times["read"], times["plain"], strict=True))
        limit, met = _limit(file, ours, ratio)
        theirs = f"{median(times['plain']) * 1e6:.3g} µs ({peer[0]})"
        show(measure, f"{ours * 1e6:.3g} µs", theirs, ratio=f"{ratio:.3g} ×", limit=limit, met=met)


def _limit(file: File, ours: float, ratio: float | None) -> tuple[str, bool | None]:
    """What reading a file may cost, and whether it costs no more."""
    if len(file.data) < SMALL_BYTES:
        return f"≤ {LONGEST_SMALL_S * 1e3:g} ms", ours <= LONGEST_SMALL_S
    return ("", None) if ratio is None else (f"≤ {MOST_TIMES} ×", ratio <= MOST_TIMES)


def mixed(count: int, files: list[File]) -> None:
    """Files of all formats in one folder, each with numbers of its own where its format is written."""
    dice = random.Random(1)  # noqa: S311  nothing secret is drawn
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as folder:
        wanted: list[tuple[Path, File]] = []
        for index in range(count):
            file = files[index % len(files)]
            if file.record.write is not None and index < 20 * len(files):
                item = a_camera_for(file.record)
                K = replace(item.intrinsics, fx=item.intrinsics.fx + dice.random())
                K = replace(K, fy=K.fx) if item.intrinsics.fx == item.intrinsics.fy else K
                again = replace(item, intrinsics=K)
                file = replace(file, data=parsers.encode([again], file.record, name=file.name)[0])
            path = Path(folder) / f"{index}-{file.name}"
            path.write_bytes(file.data)
            wanted.append((path, file))
        dice.shuffle(wanted)
        for path, file in wanted[: len(files)]:
            read(path, file)
        start, busy = time.perf_counter(), time.process_time()
        cameras = sum(len(read(path, file)) for path, file in wanted)
        rate = count / (time.process_time() - busy)
        by_the_clock = count / (time.perf_counter() - start)
    assert cameras >= count
    measure = f"{count} files of {len(files)} kinds, shuffled, identified and read"
    at_least(f"{measure}, in one second of CPU", rate, "files", 500)
    show(f"{measure}, in one second of the clock", f"{by_the_clock:.0f} files")


def many_cameras(count: int, repeats: int) -> None:
    """Compare files with a camera for every image with COLMAP's own library, on its file of as many cameras.

    A binary file is compared with its ``cameras.bin``, a text file with its ``cameras.txt``: text has to be parsed.
    """
    half = count // 2
    heads = ((index, 4, *SIZE, 3650.0 + index, 3651.0, 2736.0, 1824.0) for index in range(1, count + 1))
    colmap = [struct.pack("<IiQQ8d", *head, 0.01, 0.002, 1e-4, 2e-4) for head in heads]
    pose = "1 0 0\n0 1 0\n0 0 1\n0 0 0\n"
    bundle = "".join(f"{3650 + index} -0.01 0.002\n{pose}" for index in range(half))
    nvm = "".join(f"{index}.jpg {3650 + index} 1 0 0 0 1 2 3 -0.01 0\n" for index in range(half))
    files = {
        "cameras.bin": (count, struct.pack("<Q", count) + b"".join(colmap)),
        "bundle.out": (half, f"# Bundle file v0.3\n{half} 0\n{bundle}".encode()),
        "scene.nvm": (half, f"NVM_V3\n\n{half}\n{nvm}\n0\n".encode()),
    }
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as folder:
        for name, (cameras, data) in files.items():
            binary = name == "cameras.bin"
            their = _colmap_model(Path(folder), colmap[:cameras], binary=binary)
            act = partial(parsers.decode, data, name=name, image_size=None if binary else SIZE)
            assert len(act()) == cameras
            times = interleaved({"read": act, "pycolmap": their}, repeats)
            compared(
                f"read {name} with {cameras} cameras",
                times["read"],
                times["pycolmap"],
                scale=1e3,
                unit="ms",
                name=f"pycolmap, cameras.{'bin' if binary else 'txt'} of {cameras}",
                most=5,
            )
        found, model = parsers.decode(files["cameras.bin"][1], name="cameras.bin"), pycolmap.Reconstruction()
        (Path(folder) / "cameras.bin").write_bytes(files["cameras.bin"][1])
        model.read_binary(folder)
        for name, format_name in (("bin", "colmap_binary"), ("txt", "colmap_text")):
            theirs = partial(model.write_binary if name == "bin" else model.write_text, folder)
            out = Path(folder) / f"written.{name}"
            ours = partial(parsers.write, found, out, format_name)
            times = interleaved({"write": ours, "pycolmap": theirs}, repeats)
            compared(
                f"write cameras.{name} with {count} cameras, verified",
                times["write"],
                times["pycolmap"],
                scale=1e3,
                unit="ms",
                name="pycolmap, not verified",
                most=3,
            )


def _colmap_model(folder: Path, cameras: Sequence[bytes], *, binary: bool) -> Callable[[], object]:
    """Write a model of these cameras and no images; returns what reads it with pycolmap."""
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", len(cameras)) + b"".join(cameras))
    for empty in ("images.bin", "points3D.bin", "rigs.bin", "frames.bin"):
        (folder / empty).write_bytes(struct.pack("<Q", 0))
    if binary:
        return lambda: pycolmap.Reconstruction().read_binary(folder)
    model = pycolmap.Reconstruction(folder)
    assert len(model.cameras) == len(cameras)
    model.write_text(folder)
    return lambda: pycolmap.Reconstruction().read_text(folder)


def read(path: Path, file: File) -> Sequence[Calibration]:
    """As a caller reads a file of which nothing is known but what the file cannot say."""
    return parsers.read(path, image_size=file.size, options=file.options)


def interleaved(contestants: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Seconds of the processor for one call of each, in turns, each turn long enough to be measured."""
    counts = {name: calls_in(act, SHORTEST_S) for name, act in contestants.items()}
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(repeats):
        for name, act in contestants.items():
            start = time.process_time()
            for _ in range(counts[name]):
                act()
            times[name].append((time.process_time() - start) / counts[name])
    return times


def calls_in(act: Callable[[], object], seconds: float) -> int:
    """How often something can be done in that time, at least once."""
    act()
    start, calls = time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
        act()
        calls += 1
    return max(calls, 1)


def main() -> None:
    """Measure everything."""
    parser = argparse.ArgumentParser(description="What reading calibration files costs.")
    parser.add_argument("--quick", action="store_true", help="a small run, to see that everything runs")
    parser.add_argument("--files", type=int, metavar="N", help="in the mixed folder")
    parser.add_argument("--repeats", type=int, metavar="R", help="of what is compared")
    arguments = parser.parse_args()
    count = arguments.files or (500 if arguments.quick else 10_000)
    repeats = arguments.repeats or (1 if arguments.quick else 5)
    if min(count, repeats) < 1:
        parser.error("wanted numbers from 1 on")
    print(machine())
    few = list(small_files())
    print("\nOne camera in a file")
    per_format(few, repeats)
    print(f"\n{CAMERAS} cameras in a file, or one among {IMAGES} images")
    per_format(list(long_files()), repeats)
    print("\nMany files, and files of many cameras")
    mixed(count, few)
    many_cameras(min(2 * count, 20_000), repeats)


if __name__ == "__main__":
    main()
