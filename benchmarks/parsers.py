"""What reading and writing files of many cameras costs, beside a bare parser of the syntax and COLMAP's own library.

    python -m benchmarks.parsers [--cameras N] [--repeats R]

A format's file of so many cameras is recognised and read next to ``yaml.safe_load``, ``lxml.etree`` or ``json.loads``
on the same bytes alone. COLMAP's, Bundler's and VisualSFM's file with a camera for every image stands next to COLMAP's
own library. Times are the processor's; contestants take turns and the median counts.
"""

from __future__ import annotations

import argparse
import json
import re
import struct
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import lxml.etree
import pycolmap
import yaml

from benchmarks.table import compared, machine
from calibrary import parsers
from calibrary.calibration import CameraKey
from calibrary.parsers.format import Format
from calibrary.records import replace
from tests.parsers.cameras import SIZE
from tests.parsers.test_contract import a_camera_for

MOST_TIMES = 3
"""Of a bare parser's time."""
SHORTEST_S = 0.02
"""How long one repetition of one thing takes at least."""


def long_files(cameras: int) -> Iterator[tuple[Format, str, bytes]]:
    """A format that holds several cameras, a file's name, and its bytes."""
    for record in parsers.formats():
        if record.capacity is not None and record.capacity.several_cameras:
            item = a_camera_for(record)
            several = [
                replace(item, camera=CameraKey(image_size=SIZE, sub_camera=f"camera {index:03}"))
                for index in range(cameras)
            ]
            for suffix in record.suffixes:
                name = f"cameras{suffix}"
                yield record, name, parsers.encode(several, record, name=name)[0]


def alone(name: str, data: bytes) -> tuple[str, Callable[[], object]] | None:
    """The parser that does nothing but take the syntax apart, None where the syntax is the format's own."""
    if data.lstrip()[:1] == b"<":
        return "lxml", partial(lxml.etree.fromstring, data)
    suffix = Path(name).suffix
    if data.lstrip()[:1] in (b"{", b"[") and suffix in {".json", ".sfm", ".yml"}:
        return "json", partial(json.loads, data)
    if suffix in {".yaml", ".yml"}:
        # YAML without OpenCV's own marks.
        text = re.sub(rb"\A%YAML:1\.0", b"#YAML:1.0", data).replace(b"!!opencv-matrix", b"")
        return "yaml", partial(yaml.safe_load, re.sub(rb"(?m)^(\w+\.\w+):(?=\S)", rb"\1: ", text))
    return None


def beside_bare_parsers(cameras: int, repeats: int) -> None:
    """Every format whose syntax somebody else parses."""
    for record, name, data in long_files(cameras):
        peer = alone(name, data)
        if peer is None:
            continue
        size = SIZE if record.needs_image_size else None
        times = interleaved(
            {"read": partial(parsers.decode, data, name=name, image_size=size), "plain": peer[1]}, repeats
        )
        compared(
            f"read {record.name}, {name}, {cameras} cameras",
            times["read"],
            times["plain"],
            scale=1e3,
            unit="ms",
            name=peer[0],
            most=MOST_TIMES,
        )


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
    parser = argparse.ArgumentParser(description="What reading files of many cameras costs.")
    parser.add_argument("--cameras", type=int, default=300, metavar="N", help="in a file")
    parser.add_argument("--repeats", type=int, default=5, metavar="R", help="of what is compared")
    given = parser.parse_args()
    print(machine())
    beside_bare_parsers(given.cameras, given.repeats)
    many_cameras(20_000, given.repeats)


if __name__ == "__main__":
    main()
