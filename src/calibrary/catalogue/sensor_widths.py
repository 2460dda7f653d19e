"""Sensor widths by make and model, from the databases of OpenSfM, AliceVision and, where these are silent, lensfun.

A width is evidence for cameras that are not in the catalogue, never a K by itself: two cameras can share a
name, and the databases contain errors. The file is read only for such a camera, one maker at a time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Final

from msgspec import Struct

from calibrary.catalogue import shipped_folder
from calibrary.known_camera import KnownCamera, SensorWidth

AGREEMENT: Final = 0.03
"""If databases, or two entries that match a name, differ by more than this fraction, no width is returned."""

OTHER_NAMES: Final = {
    "asahi": ("pentax",),
    "eastman": ("kodak",),
    "fuji": ("fujifilm",),
    "hewlett": ("hp", "hewlett-packard"),
    "hmd": ("nokia", "hmd"),
    "jk": ("kodak",),
    "konica": ("konica-minolta", "konica"),
    "lge": ("lg", "lge"),
    "minolta": ("minolta", "konica-minolta"),
    "om": ("olympus",),
    "ricoh": ("ricoh", "pentax"),
}
"""Makers' names in the databases, by the first word of EXIF Make where the two differ."""

ADDED_WORDS: Final = frozenset({"camera", "digital", "zoom"})
"""Words that cameras append to their Model and the databases omit."""

MARK: Final = re.compile(r"(.*\d)m([2-7])(a?)")
NUMERALS: Final = {2: "ii", 3: "iii", 4: "iv", 5: "v", 6: "vi", 7: "vii"}
"""Sony writes DSC-RX100M3 for the camera that is sold and listed as RX100 III."""

SHORTEST_TAIL: Final = 3
"""Fewest letters and digits of a Model that may match the end of a longer name ("DSC-P52")."""


def listed_width(camera: KnownCamera | None, make: str | None, model: str | None) -> SensorWidth | None:
    """The sensor width that the catalogue states of a camera, or else the lists; None if neither does."""
    if camera is not None and camera.sensor_width_mm is not None:
        return SensorWidth(camera.sensor_width_mm, "the catalogue")
    return sensor_width(make, model)


def sensor_width(make: str | None, model: str | None) -> SensorWidth | None:
    """The sensor width listed for a camera; None if none is listed or the lists disagree.

    Args:
        make: EXIF Make; the databases use one word per maker.
        model: EXIF Model, with or without the maker's name before it.
    """
    if not make or not model:
        return None
    first = re.split(r"[\s\-_,.]", make.casefold().strip(), maxsplit=1)[0]
    makers = OTHER_NAMES.get(first, (first,))
    for name in _names(model, {first, *makers}):
        found = [width for maker in makers for width in _widths_of(maker, name)]
        if found:
            return _agreed(found)
    return None


def _names(model: str, makers: set[str]) -> Iterator[str]:
    """Possible spellings of the Model in the databases, closest first."""
    words = model.casefold().replace("_", " ").split()
    while len(words) > 1 and re.split(r"[\-,.]", words[0])[0] in makers:
        words = words[1:]
    before, _, rest = words[0].partition("-") if words else ("", "", "")
    if before in makers and rest:
        words[0] = rest
    yield _squeezed(" ".join(words))
    if words and (marked := MARK.fullmatch(words[-1])):
        yield _squeezed(" ".join((*words[:-1], marked[1], NUMERALS[int(marked[2])], marked[3])))
    shorter = list(words)
    while len(shorter) > 1 and (shorter[-1] in ADDED_WORDS or shorter[-1].startswith("(")):
        shorter.pop()
        yield _squeezed(" ".join(shorter))
    # OM Digital Solutions' OM-1 does not begin with its maker.
    yield _squeezed(model.casefold())


def _widths_of(maker: str, name: str) -> tuple[SensorWidth, ...]:
    listed = _of_maker(maker)
    if name in listed.whole:
        return listed.whole[name]
    long_enough = len(name) >= SHORTEST_TAIL and any(c.isdigit() for c in name)
    return listed.tails.get(name, ()) if long_enough else ()


def _agreed(found: list[SensorWidth]) -> SensorWidth | None:
    widths = [one.mm for one in found]
    return found[0] if max(widths) / min(widths) - 1.0 <= AGREEMENT else None


class _Listed(Struct, frozen=True):
    """One maker's cameras, by name without separators and by the ends of their names at word boundaries."""

    whole: dict[str, tuple[SensorWidth, ...]]
    tails: dict[str, tuple[SensorWidth, ...]]


@cache
def _of_maker(maker: str) -> _Listed:
    whole: dict[str, tuple[SensorWidth, ...]] = {}
    tails: dict[str, tuple[SensorWidth, ...]] = {}
    for line in re.findall(rf"^{re.escape(maker)}[ ][^\n]*", _text(), re.IGNORECASE | re.MULTILINE):
        camera, *columns = line.split("\t")
        words = camera.casefold().split()[1:]
        widths = tuple(_widths(*columns))
        for start in range(len(words)):
            kept = tails if start else whole
            name = _squeezed(" ".join(words[start:]))
            kept[name] = (*kept.get(name, ()), *widths)
    return _Listed(whole, tails)


def _widths(opensfm: str, alicevision: str, lensfun: str = "") -> Iterator[SensorWidth]:
    if alicevision == "=":
        yield SensorWidth(float(opensfm), "OpenSfM and AliceVision")
        return
    if opensfm:
        yield SensorWidth(float(opensfm), "OpenSfM")
    if alicevision:
        yield SensorWidth(float(alicevision), "AliceVision")
    if lensfun:
        yield SensorWidth(float(lensfun), "lensfun's crop factor")


@cache
def _text() -> str:
    return (shipped_folder() / "sensor_widths.tsv").read_text(encoding="utf-8")


def _squeezed(text: str) -> str:
    return "".join(c for c in text if c.isalnum())
