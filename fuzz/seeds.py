"""Where the fuzzer starts: random cameras by every writer, the formats' own samples, and the words in them."""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from pathlib import Path

from hypothesis import Phase, given, seed, settings

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.jobs.demo.flight import write_flight
from calibrary.parsers.content import Content
from calibrary.parsers.format import Capacity, Format
from calibrary.records import replace
from fuzz.target import IDENTIFY, IMAGE
from tests.parsers.cameras import calibrations
from tests.parsers.samples import FOLDER, exported

__all__ = ["write_dictionary", "write_samples", "write_seeds"]

CAMERAS = 12
"""For every writer and every suffix; the fuzzer changes them soon enough."""
LONGEST_SEED = 16 * 1024
_WORD = re.compile(rb"[A-Za-z_$%<\[][\w.:$%<>\[\]=-]{2,30}")


def seeds() -> Mapping[str, list[bytes]]:
    """What every target starts from."""
    found: dict[str, list[bytes]] = defaultdict(list)
    for record in parsers.formats():
        if record.write is not None and record.capacity is not None:
            found[record.name] += _written(record, record.capacity)
        elif record.name in exported():
            found[record.name].append(exported()[record.name].data)
    for text in _constants():
        content = Content(text, "seed")
        for record in parsers.formats():
            if record.sniff(content) is not None:
                found[record.name].append(text)
    found[IDENTIFY] = [data for name in list(found) for data in found[name][:6]]
    found[IMAGE] = list(_images())
    return found


def write_seeds(folder: Path) -> None:
    """One folder of small files for every target; files already there stay."""
    for name, items in seeds().items():
        _write(items, folder / name)


def write_samples(samples: Path, folder: Path) -> None:
    """The small files below a folder, each for every reader that takes it for its own."""
    for path in sorted(samples.rglob("*")):
        if path.is_file() and path.stat().st_size <= LONGEST_SEED:
            data = path.read_bytes()
            content = Content(data, path.name)
            for record in parsers.formats():
                if record.sniff(content) is not None:
                    _write([data], folder / record.name)


def _write(items: Iterable[bytes], folder: Path) -> None:
    """Files named by what is in them."""
    folder.mkdir(parents=True, exist_ok=True)
    for data in items:
        (folder / hashlib.sha1(data, usedforsecurity=False).hexdigest()).write_bytes(data)


def write_dictionary(corpus: Path, path: Path) -> None:
    """The words of a corpus, as libFuzzer's dictionaries spell them."""
    words = {word for item in corpus.iterdir() for word in _WORD.findall(item.read_bytes()[:LONGEST_SEED])}
    escaped = ("".join(f"\\x{byte:02x}" for byte in word) for word in sorted(words)[:2000])
    path.write_text("".join(f'"{word}"\n' for word in escaped))


def _written(record: Format, capacity: Capacity) -> Iterator[bytes]:
    drawn: list[Calibration] = []

    @seed(1)
    @settings(max_examples=CAMERAS, database=None, deadline=None, phases=[Phase.generate])
    @given(calibrations(capacity))
    def draw(item: Calibration) -> None:
        drawn.append(item)

    draw()
    for suffix in record.suffixes:
        for item in drawn:
            yield parsers.encode([item], record, name=f"camera{suffix}")[0]
        if capacity.several_cameras:
            yield parsers.encode(_as_a_rig(drawn[:3]), record, name=f"camera{suffix}", max_error_px=1e9)[0]


def _as_a_rig(items: list[Calibration]) -> list[Calibration]:
    """Several of one size: the first one with other names."""
    return [
        replace(items[0], camera=replace(items[0].camera, sub_camera=f"camera {index}"))
        for index in range(len(items))
    ]


def _constants() -> Iterator[bytes]:
    """The small files that the formats' tests are made of."""
    for path in sorted(FOLDER.glob("test_*.py")):
        for value in vars(import_module(f"tests.parsers.formats.{path.stem}")).values():
            data = value.encode() if isinstance(value, str) else value
            if isinstance(data, bytes) and 40 < len(data) < LONGEST_SEED:
                yield data


def _images() -> Iterator[bytes]:
    """The heads of a flight's frames."""
    with tempfile.TemporaryDirectory() as name:
        write_flight(Path(name))
        for path in sorted(Path(name).rglob("*.*"))[:40]:
            yield path.read_bytes()[:LONGEST_SEED]
