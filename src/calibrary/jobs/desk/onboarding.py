"""Onboard: what came with a payload, each source of its K beside the others, and the best of them proposed.

It is ``calibrary onboard``: first as a dry run, whose result is shown; then, if a person confirms it, the same again
with what it proposes written on a branch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from calibrary.jobs.desk.flights import Drop
from calibrary.jobs.desk.running import (
    DRY,
    REPORT,
    again_form,
    desk_page,
    files_form,
    flags,
    how,
    place_of,
    proposal_form,
    without_result,
)
from calibrary.jobs.desk.work import Job
from calibrary.jobs.onboard.report import Decision, OnboardReport
from calibrary.jobs.onboard.told import told
from calibrary.records import from_json, replace
from calibrary.view import Block, Field, Link, Note, Section, Tone, View

AGAIN: Final = Link("Onboard another payload", "/onboard")
ASKED: Final = (
    Field(
        name="square-mm",
        label="Side of a square of the board (mm)",
        hint="--square-mm; if there are frames of one",
    ),
    Field(
        name="for",
        label="A measured K is valid for",
        hint="--for",
        choices=(("", "I do not know yet"), ("unit", "this unit only"), ("model", "every unit of the model")),
    ),
    Field(name="label", label="Your name for the unit", hint="--label"),
    Field(
        name="trust",
        label="If sources disagree, trust",
        hint="--trust",
        choices=(
            ("", "none of them"),
            *((name, f"the {name}") for name in ("board", "flight", "file", "tags")),
        ),
    ),
    Field(name="make", label="Make, if nothing states it", hint="--make"),
    Field(name="model", label="Model, if nothing states it", hint="--model"),
    Field(name="serial", label="Serial number, if nothing states it", hint="--serial; kept as a hash"),
)
"""What only a person knows, under the names of the command's flags."""
OFTEN: Final = ASKED[:3]
"""What is asked beforehand; the rest is, once it is needed."""


def questions() -> View:
    """Make the page that asks what came with a payload."""
    # The entry has the hash of each file, so all of it is needed.
    whole = Field(name="whole", type="hidden", value="yes")
    place = Field(name="place", label="Or their folder", hint="its whole path on this machine")
    flight = Field(
        name="flight", type="checkbox", value="yes", label="K from the pixels of its flight too, in minutes"
    )
    told = (
        "Images, frames of a board, calibration files, in any folders; they are copied to the desk, and stay on this "
        "machine. What only you know can also be answered once it is needed."
    )
    return desk_page(
        title="Onboard a payload",
        lead="Each source of K beside the others, and the best proposed. Nothing is written before you confirm it.",
        sections=(
            Section(
                title="What came with it",
                blocks=(
                    told,
                    files_form("/onboard", "Look at these files", place, whole, *OFTEN, flight),
                ),
            ),
        ),
    )


def command(registry: Path, folder: Path, asked: Mapping[str, str]) -> tuple[list[str], str]:
    """The command that looks at a payload and writes nothing, and its title.

    Raises:
        InputError: the path is not a whole one.
    """
    place = place_of(asked.get("place", ""))
    words = ["onboard", place, "--registry", str(registry), "--html", str(folder / REPORT), "--json"]
    words += flags(asked, ASKED)
    return [*words, *(["--flight"] if asked.get("flight") else []), DRY], f"Payload in {place}"


def proposing(job: Job, folder: Path, asked: Mapping[str, str]) -> list[str]:
    """The command that does what a run showed that wrote nothing, if the files are still the same."""
    page, found, said = str(job.folder / REPORT), _found(job), ("--digest=", "--reason=", "--date=")
    words = [
        str(folder / REPORT) if one == page else one
        for one in job.words
        if one != DRY and not one.startswith(said)
    ]
    # Frames that state no day have that of the run, which may be over once somebody confirms it. A file that states
    # none would get it too.
    made = [one.entry.calibration.provenance for one in found.cameras if one.entry is not None]
    days = {one.date for one in made if one.kind == "board"} if all(one.date for one in made) else set()
    words += [f"--date={day}" for day in days if len(days) == 1]
    reason = [f"--reason={asked['reason']}"] if asked.get("reason") else []
    return [*words, f"--digest={found.digest[:12]}", *reason]


def _found(job: Job) -> OnboardReport:
    return from_json(OnboardReport, msgspec.json.decode(job.documents[-1]))


def decided(job: Job, address: str, drop: Drop | None) -> View:
    """Make the page of a payload that was looked at.

    Args:
        job: the command.
        address: of this page.
        drop: the files that it is of, if they were dropped.
    """
    form = again_form(job, address, "/onboard", "Look again", ASKED, is_dropped=drop is not None)
    again = Section(title="Answer what only you know", blocks=(form,), printed=False)
    if job.is_cancelled or not job.documents:
        return without_result(job, again=AGAIN, more=again)
    done = _found(job)
    page = told(done)
    return replace(
        page,
        sections=(
            Section(title="Propose", blocks=tuple(_next(job, address, done))),
            *page.sections,
            again,
        ),
    )


def _next(job: Job, address: str, done: OnboardReport) -> Iterator[Block]:
    if done.branches:
        yield Note(
            text=f"Written on {', '.join(done.branches)}: not used until it is approved.", tone=Tone.GOOD
        )
        yield Link("Review it", "/review")
    elif not done.is_good:
        yield "One was refused, so nothing is proposed. What to do is with each camera; answer it below."
    elif any(one.decision is Decision.READY for one in done.cameras):
        if DRY not in job.words:
            text = "Nothing was written: the files changed since they were looked at. This is of what is there now."
            yield Note(text=text, tone=Tone.CAUTION)
        yield "It becomes a draft on a branch of its own, in your name. What is in use stays in use."
        yield proposal_form(address)
    else:
        yield "There is nothing new to propose."
    yield Link("The whole report, with every plot", f"{address}/{REPORT}")
    yield from how(job, again=AGAIN)
