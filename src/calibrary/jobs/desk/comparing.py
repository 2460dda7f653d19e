"""Compare: any two calibrations, all of the registry with its earlier state, and units over the days of their flights.

Two are compared as ``calibrary diff`` compares them; what takes its time is the command itself.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

import numpy as np

from calibrary.arguments import Reading
from calibrary.errors import InputError
from calibrary.jobs.desk.running import REPORT, SAME, desk_page, how, path_of, place_of, without_result
from calibrary.jobs.desk.work import Job
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.diff.told import told
from calibrary.jobs.files import read_arguments
from calibrary.jobs.fleet import Fleet
from calibrary.pages.wording import sentence
from calibrary.policy import FLEET
from calibrary.records import replace
from calibrary.registry.paths import id_of
from calibrary.view import Badge, Code, Field, Form, Link, Note, Section, Tone, View

AGAIN: Final = Link("Compare others", "/compare")
SIDES: Final = (("a", "A, the earlier"), ("b", "B, the later"))
HINT: Final = (
    "Each is a camera of the registry by a part of its name or its label, with @2026-05-01, @COMMIT or @firmware:01.08 "
    "after it for what it was then; or the whole path of a calibration file or an image on this machine; or a file "
    "that is chosen here."
)


def questions(asked: Mapping[str, str], problem: str = "") -> View:
    """Make the page that asks what to compare.

    Args:
        asked: what was asked before, by the names of the fields.
        problem: why it has no answer.
    """
    return desk_page(
        title="Has K moved?",
        lead="Two calibrations of one camera, in numbers, in pixels and on the ground.",
        sections=(
            *(
                (Section(title="Not compared", blocks=(Note(text=problem, tone=Tone.BAD),)),)
                if problem
                else ()
            ),
            _two(asked),
            Section(
                title="Everything since a day",
                blocks=(
                    "Each entry with what it was then, proposals too, worst first.",
                    Form(
                        to="/compare/since",
                        button="Compare the registry",
                        is_aside=True,
                        fields=(Field(name="since", label="Day, tag or commit", required=True),),
                    ),
                    Form(
                        to="/compare/since",
                        button="Compare firmwares",
                        is_aside=True,
                        fields=(
                            Field(
                                name="firmware",
                                label="Firmware before and after",
                                hint="such as 01.08..01.09",
                                required=True,
                            ),
                        ),
                    ),
                ),
            ),
            Section(
                title="A unit over time",
                blocks=(
                    "The page of a camera draws its K by the days of its calibrations, and compares each change. "
                    "This compares the registry with what flew: what the images of each unit state by the day, and, by "
                    "the pixels, the K that each flight shows.",
                    Form(
                        to="/compare/flights",
                        button="Compare with flights",
                        is_aside=True,
                        fields=(
                            Field(
                                name="place",
                                label="Folder of flights",
                                hint="the whole path on this machine",
                                required=True,
                            ),
                            Field(
                                name="verify",
                                type="checkbox",
                                value="yes",
                                label="By the pixels too, about a minute a flight",
                            ),
                        ),
                    ),
                ),
            ),
        ),
    )


def _two(asked: Mapping[str, str]) -> Section:
    fields: list[Field] = []
    for name, label in SIDES:
        fields += [
            Field(name=name, label=label, value=asked.get(name, "")),
            Field(name=f"file_{name}", label=f"or a file for {name.upper()}", type="file"),
        ]
    height = asked.get("altitude_m") or "100"
    fields += [
        Field(name="altitude_m", label="Height above ground (m)", value=height),
        Field(name="camera", label="Camera, if a file has several", value=asked.get("camera", "")),
    ]
    return Section(
        title="Two calibrations", blocks=(HINT, Form(to="/compare", button="Compare", fields=tuple(fields)))
    )


def compared(
    fleet: Fleet, place: Path, asked: Mapping[str, str], files: Mapping[str, Path], names: Mapping[str, str]
) -> View:
    """Make the page of a comparison.

    Args:
        fleet: the registry.
        place: its folder.
        asked: the fields of the question.
        files: those that were sent, by the name of their field.
        names: what these are called.

    Raises:
        InputError: a side cannot be read, or is not named.
        RegistryError: neither a file nor an entry has the name.
    """
    for name, label in SIDES:
        if f"file_{name}" not in files and not asked.get(name):
            raise InputError(f"{label}: expected a camera, a path or a file")
    given = {name: str(files.get(f"file_{name}") or _named(fleet, asked[name])) for name, _ in SIDES}
    height = _height(asked.get("altitude_m") or "100")
    reading = Reading(camera=asked.get("camera") or None)
    one, two = read_arguments(given["a"], given["b"], reading, place)
    labels = names.get("file_a", one.label), names.get("file_b", two.label)
    with np.errstate(all="ignore"):
        found = compare(one.calibration, two.calibration, FLEET, labels=labels, altitude_m=height)
        page = told(found, height)
    stated = dict(zip("ab", labels, strict=True)) | {
        "altitude_m": f"{height:g}",
        "camera": asked.get("camera", ""),
    }
    stated = {name: text for name, text in stated.items() if text}
    keep = Section(title="This comparison", blocks=tuple(_to_keep(stated, names, place)))
    return replace(page, sections=(*page.sections, keep, _two(stated)))


def _named(fleet: Fleet, text: str) -> str:
    """What is compared: a path; or a KEY, of which a part of its name is enough."""
    if path_of(text).is_absolute():
        return place_of(text)
    key, at, revision = text.partition("@")
    [*fits] = fleet.listing(key.split()).chosen.paths
    return f"{id_of(fits[0])}{at}{revision}" if len(fits) == 1 else text


def _height(text: str) -> float:
    try:
        height = float(text)
    except ValueError:
        height = np.nan
    if not 0 < height < np.inf:
        raise InputError(f"{text!r:.40} is no height above ground in m")
    return height


def _to_keep(
    stated: Mapping[str, str], names: Mapping[str, str], registry: Path
) -> Iterator[Link | Code | str]:
    if names:
        yield "A file that was sent is not kept, so this page has no address to send on."
    else:
        yield Link("The address of this comparison, to send on", f"/compare?{urlencode(stated)}")
    flags = (
        "--altitude-m",
        stated["altitude_m"],
        *(("--camera", stated["camera"]) if "camera" in stated else ()),
    )
    words = ["calibrary", "diff", stated["a"], stated["b"], *flags, "--registry", str(registry)]
    yield Code(text=shlex.join(words), label=SAME)


def since(registry: Path, folder: Path, asked: Mapping[str, str]) -> tuple[list[str], str]:
    """The command that compares the registry with an earlier state, or firmwares; and its title."""
    [*said] = [(name, asked[name]) for name in ("since", "firmware") if asked.get(name)]
    if len(said) != 1:
        raise InputError("expected a day, tag or commit, or two firmwares such as 01.08..01.09")
    [(name, value)] = said
    words = ["diff", f"--{name}={value}", "--registry", str(registry), "--html", str(folder / REPORT)]
    return words, f"The registry since {value}" if name == "since" else f"Firmware {value}"


def through_flights(registry: Path, folder: Path, asked: Mapping[str, str]) -> tuple[list[str], str]:
    """The command that compares the registry with flights; and its title."""
    place = place_of(asked.get("place", ""))
    words = ["registry", "audit", place, "--registry", str(registry), "--html", str(folder / REPORT)]
    return [
        *words,
        *(["--verify"] if asked.get("verify") else []),
    ], f"The registry and the flights of {place}"


def reported(job: Job, address: str, _: object) -> View:
    """Make the page of a command whose result is a report."""
    if job.is_cancelled or not (job.folder / REPORT).is_file():
        return without_result(job, again=AGAIN)
    verdict = next((line.strip() for line in reversed(job.said[0].splitlines()) if line.strip()), "done")
    good = job.code == 0
    return desk_page(
        title=job.title,
        badge=Badge("good", Tone.GOOD) if good else Badge("needs attention", Tone.CAUTION),
        lead=sentence(verdict.rpartition("attention: ")[2]),
        sections=(
            Section(
                title="Found",
                blocks=(Link("The whole report", f"{address}/{REPORT}"), *how(job, again=AGAIN)),
            ),
        ),
    )
