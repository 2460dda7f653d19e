"""Pages of a command while it runs, and of what it left; and where its files are, as a person states it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from calibrary.errors import InputError
from calibrary.jobs.desk.work import Job
from calibrary.pages import (
    Badge,
    Block,
    Code,
    Details,
    Form,
    Link,
    Note,
    Page,
    Running,
    Section,
    Tone,
)
from calibrary.pages.wording import made_by

__all__ = ["REPORT", "SAME", "how", "place_of", "reported", "running", "without_result"]

REPORT: Final = "report.html"
SAME: Final = "The same in a terminal"


def place_of(text: str, *, is_local: bool = True) -> str:
    """The path that a person states; or the address of a bucket, where that is read.

    Raises:
        InputError: it is no whole path, or nothing is there.
    """
    # File managers copy paths in quotation marks.
    text = text.strip().strip("\"'")
    if not is_local and urlsplit(text).scheme and "://" in text:
        return text
    path = Path(text).expanduser()
    if not path.is_absolute():
        raise InputError("expected the whole path, from the root of the disk", source=text)
    if not path.exists():
        raise InputError("there is no such folder on this machine", source=text)
    return str(path)


def how(job: Job, *, again: Link) -> tuple[Block, ...]:
    """What the command said, the way to another, and the command itself."""
    said = Details(summary="What the command said", blocks=(Code(text=job.text, label="Its output"),))
    return (*((said,) if job.text.strip() else ()), again, Code(text=job.command, label=SAME))


def running(job: Job, address: str, found: Sequence[Section] = ()) -> Page:
    """Make the page of a command that runs, or waits for a processor.

    Args:
        job: the command.
        address: of this page.
        found: what it has found so far.
    """
    done, total, what = job.progress
    return Page(
        title=job.title,
        lead="It goes on if you leave this page, and ends with the desk.",
        sections=(
            Section(
                title="Running",
                blocks=(
                    Running(state=f"{address}/state", done=done, total=total, what=what),
                    Form(to=f"{address}/stop", button="Stop"),
                    Code(text=job.command, label=SAME),
                ),
            ),
            *found,
        ),
        contents=False,
        made_by=made_by(),
    )


def without_result(job: Job, *, again: Link, more: Sequence[Section] = ()) -> Page:
    """Make the page of a command that was stopped, or failed."""
    text = "Stopped; nothing was kept." if job.is_cancelled else job.text.strip().rpartition("\n")[2]
    note = Note(text=text, tone=Tone.NEUTRAL if job.is_cancelled else Tone.BAD)
    return Page(
        title=job.title,
        lead="There is no result.",
        sections=(Section(title="Ended", blocks=(note, *how(job, again=again))), *more),
        contents=False,
        made_by=made_by(),
    )


def reported(job: Job, address: str, *, again: Link) -> Page:
    """Make the page of a command whose result is a report."""
    if job.is_cancelled or not (job.folder / REPORT).is_file():
        return without_result(job, again=again)
    verdict = next((line.strip() for line in reversed(job.said[0].splitlines()) if line.strip()), "done")
    good = job.code == 0
    return Page(
        title=job.title,
        badge=Badge("good", Tone.GOOD) if good else Badge("needs attention", Tone.CAUTION),
        lead=verdict,
        sections=(
            Section(
                title="Found",
                blocks=(Link("The whole report", f"{address}/{REPORT}"), *how(job, again=again)),
            ),
        ),
        contents=False,
        made_by=made_by(),
    )
