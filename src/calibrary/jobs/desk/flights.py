"""Check a flight: by the path of its images, or by images that are dropped, of which only what readers ask for is sent.

The browser sends the first bytes of each dropped image. They are read here, and where a reader asks for more, as of a
file on a server, the browser sends that range too. All ranges together make a sparse file: whoever reads the same of it
gets the same answer, so that the check is the command of a terminal on a folder of them. No name of a dropped file is a
path: of each part only letters, digits and a few signs are kept.
"""

from __future__ import annotations

import io
import json
import re
import threading
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO, Final, cast

import msgspec

from calibrary.errors import InputError, first_of
from calibrary.jobs.desk.running import REPORT, desk_page, files_form, how, place_of, without_result
from calibrary.jobs.desk.work import Job
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.targets import TARGETS
from calibrary.jobs.extract.told import told
from calibrary.jobs.images.observation import Image, observe
from calibrary.jobs.images.ranged import FIRST, Ranged
from calibrary.pages.wording import count
from calibrary.parsers.files import is_image
from calibrary.parsers.imagery.source import Source
from calibrary.records import from_json, replace
from calibrary.view import Field, Link, Note, Section, View

MATRIX: Final = "K_matrix.npy"
MOST_FILES: Final = 100_000
MOST_ROUNDS: Final = 12
"""Most ranges of one image that are asked for."""
MOST_WHOLE: Final = 16 << 30
"""Bytes of all files of one drop that are sent whole."""
PART: Final = 4 << 20
"""Bytes of a file that are sent at once."""
LARGEST_BESIDE: Final = 4 << 20
"""Bytes of a file that is no image and may be a calibration; larger ones are not read as one either."""


class _Sent(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    """What the browser says of one file whose bytes follow: its number, name and size, and the ranges that follow."""

    number: int
    name: str
    size: int
    ranges: list[tuple[int, int]]


class _MoreError(Exception):
    """A reader needs a range that was not sent yet."""

    def __init__(self, start: int, end: int) -> None:
        super().__init__()
        self.range = (start, end)


class Drop:
    """Files that are being dropped.

    Args:
        folder: for them.
        many: number of files.
        whole: keep all of each file, where the pixels are needed, and not only what readers ask for.

    Attributes:
        folder: where they are kept.
        done: number of files that are complete.
        left_out: names of files that are neither images nor small enough to be calibrations.
    """

    def __init__(self, folder: Path, many: int, *, whole: bool = False) -> None:
        if not 0 < many <= MOST_FILES:
            raise InputError(
                f"{many} files were dropped, expected 1 … {MOST_FILES}; name their folder instead"
            )
        self.done, self.left_out = 0, list[str]()
        self.folder, self._many = folder / "dropped", many
        self.folder.mkdir()
        self._whole, self._room, self._paths = whole, MOST_WHOLE, dict[int, Path]()
        self._parts: dict[int, list[tuple[int, bytes]]] = {}
        self._over, self._names, self._lock = set[int](), set[str](), threading.Lock()

    def take(self, body: bytes) -> list[tuple[int, tuple[int, int]]]:
        """Take some ranges of some files; return the ranges that are still needed, by the number of the file.

        Raises:
            InputError: the message is not as the desk's page sends it.
        """
        length = int.from_bytes(body[:4], "big")
        try:
            sent = msgspec.json.decode(body[4 : 4 + length], type=list[_Sent])
        except (msgspec.MsgspecError, UnicodeDecodeError):
            raise InputError("what was sent is not what the desk's page sends; reload it") from None
        at, more = 4 + length, []
        with self._lock:
            for one in sent:
                parts = self._parts.setdefault(one.number, [])
                for start, end in one.ranges:
                    is_range = 0 <= start <= end <= one.size and at + end - start <= len(body)
                    if not is_range or not 0 <= one.number < self._many:
                        raise InputError("what was sent is not what the desk's page sends; reload it")
                    parts.append((start, body[at : at + end - start]))
                    at += end - start
                if one.number not in self._over and (needed := self._needed(one, parts)) is not None:
                    more.append((one.number, needed))
        return more

    def _needed(self, one: _Sent, parts: list[tuple[int, bytes]]) -> tuple[int, int] | None:
        """The next range that is needed of a file; None if it is complete, or left out."""
        if self._whole:
            have = self._keep(one, parts)
            parts.clear()
            if have < one.size:
                return have, min(one.size, have + PART)
        elif len(parts) <= MOST_ROUNDS:
            if is_image(one.name):
                wanted = _wanted(one, parts)
            else:
                have = sum(len(data) for _, data in parts)
                wanted = (have, one.size) if have < one.size <= LARGEST_BESIDE else None
            if wanted is not None:
                return wanted
        self._over.add(one.number)
        self._parts.pop(one.number)
        self.done += 1
        if self._whole:
            return None
        if is_image(one.name) or one.size <= LARGEST_BESIDE:
            self._keep(one, parts)
        else:
            self.left_out.append(one.name)
        return None

    def _keep(self, one: _Sent, parts: Sequence[tuple[int, bytes]]) -> int:
        """Write parts of a file where they belong; return where the last ends."""
        self._room -= sum(len(data) for _, data in parts)
        if self._room < 0:
            raise InputError(f"more than {MOST_WHOLE >> 30} GB were dropped; name their folder instead")
        path = self._paths[one.number] = self._paths.get(one.number) or self._path(one)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("r+b" if path.exists() else "xb") as file:
                file.truncate(one.size)
                for start, data in parts:
                    file.seek(start)
                    file.write(data)
                return file.tell()
        except OSError as error:
            raise InputError(f"cannot be kept: {error.strerror or error}", source=one.name) from None

    def _path(self, one: _Sent) -> Path:
        names = [_safe(part) for part in re.split(r"[/\\]", one.name) if part.strip(" .")][-8:] or ["file"]
        *above, last = names
        # On some systems names that differ in case alone are one file.
        if "/".join(names).casefold() in self._names:
            last = f"{one.number}-{last}"
        self._names.add("/".join([*above, last]).casefold())
        return self.folder.joinpath(*above, last)


def _wanted(one: _Sent, parts: Sequence[tuple[int, bytes]]) -> tuple[int, int] | None:
    """The range that reading an image stops at; None if all of it that is read is there."""
    have = dict(
        zip(((start, start + len(data)) for start, data in parts), (d for _, d in parts), strict=True)
    )

    def fetch(start: int, end: int) -> bytes:
        if (start, end) not in have:
            raise _MoreError(start, end)
        return have[start, end]

    first = have.get((0, min(FIRST, one.size)))
    if first is None:
        return (0, min(FIRST, one.size))
    source = Source(cast("BinaryIO", Ranged(fetch, first, one.size)), name=one.name, size=one.size)
    try:
        observe(source, Image(one.name, one.name), days=True)
    except _MoreError as more:
        return more.range
    return None


def _safe(part: str) -> str:
    """A part of a name as part of a path: letters, digits and signs that mean nothing to any system."""
    # Of a letter's four bytes, 255 make a name.
    kept = "".join(c if c.isalnum() or c in "._- ()" else "_" for c in part[-60:]).strip(" .")
    # Windows takes these for devices, with any suffix.
    return f"_{kept}" if re.match(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\.|$)", kept) or not kept else kept


PLACE: Final = Field(
    name="place",
    label="Or their folder or address",
    hint="the whole path on this machine, or s3://…, gs://…, https://…; nothing is copied",
)


def questions() -> View:
    """Make the page that asks which flight."""
    programs = (("", "no program"), *((name, name) for name in TARGETS))
    program = Field(name="to", label="Also files for", choices=programs)
    pixels = Field(
        name="verify",
        type="checkbox",
        value="yes",
        label="Compare K with the pixels too, which takes minutes",
    )
    return desk_page(
        title="Check a flight",
        lead="One K for each camera of a flight's images, judged before a reconstruction starts from it.",
        sections=(
            Section(
                title="Images",
                blocks=(
                    "Of files that are chosen or dropped only what is read is sent here, mostly the first bytes, "
                    "and nothing leaves this machine. Calibration files beside the images are weighed too.",
                    files_form("/flight", "Check these images", PLACE, program, pixels),
                ),
            ),
        ),
    )


def command(registry: Path, folder: Path, asked: Mapping[str, str]) -> tuple[list[str], str]:
    """The command that checks a flight, and its title.

    Args:
        registry: the registry to use.
        folder: for its results.
        asked: the place, the program that K is handed to, and whether to compare K with the pixels.

    Raises:
        InputError: the path is not a whole one, or there is no such program.
    """
    place, program = place_of(asked.get("place", ""), is_local=False), asked.get("to")
    if program and program not in TARGETS:
        raise InputError(f"{program!r:.40} is none of {', '.join(TARGETS)}")
    words = ["extract", place, "--recursive", "--registry", str(registry)]
    words += ["--out", str(folder / MATRIX), "--html", str(folder / REPORT)]
    words += [*(["--to", program] if program else []), *(["--verify"] if asked.get("verify") else [])]
    return words, f"Check of {place}"


def checked(job: Job, address: str, drop: Drop | None) -> View:
    """Make the page of a check that is over.

    Args:
        job: the check.
        address: of this page.
        drop: the files that it is of, if they were dropped.
    """
    file = job.folder / Path(MATRIX).with_suffix(".json")
    again = Link("Check another flight", "/flight")
    if job.is_cancelled or not file.is_file():
        return without_result(job, again=again)
    found = from_json(ExtractReport, json.loads(file.read_bytes()))
    view = told(found)
    [answer] = view.sections[:1]
    left: tuple[Note, ...] = ()
    if left_out := drop.left_out if drop is not None else ():
        names = f"{count(len(left_out), 'file')}: {first_of(left_out)}"
        left = (Note(text=f"left out, neither images nor small enough for calibrations: {names}"),)
    along = Section(
        title="To take along",
        blocks=(
            Link("The whole report: every source, every camera", f"{address}/{REPORT}"),
            Link("Everything as a zip: K, report and files for the program", f"{address}/all.zip"),
            *how(job, again=again),
        ),
    )
    sections = (replace(answer, blocks=(*answer.blocks, *left)), along)
    return replace(view, title=job.title, sections=sections, contents=False)


def archive(folder: Path) -> bytes:
    """The files that a check wrote, as a zip."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.iterdir()):
            if path.is_file() and not path.name.startswith("."):
                file.write(path, path.name)
    return out.getvalue()
