"""Pages of a command while it runs, and of what it left; and where its files are, as a person states it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from calibrary.errors import InputError
from calibrary.jobs.desk.work import Job
from calibrary.pages.wording import made_by
from calibrary.records import replace
from calibrary.view import Badge, Block, Code, Details, Field, Form, Link, Note, Running, Section, Tone, View

REPORT: Final = "report.html"
DRY: Final = "--dry-run"
SAME: Final = "The same in a terminal"
FILES: Final = Field(name="files", label="Files, or drop a folder here", type="file", several=True)


def place_of(text: str, *, is_local: bool = True) -> str:
    """The path that a person states; or the address of a bucket, where that is read.

    Raises:
        InputError: it is no whole path, or nothing is there.
    """
    # File managers copy paths in quotation marks.
    text = text.strip().strip("\"'")
    if not text:
        raise InputError("expected files, which need the page's script, or the whole path of their folder")
    if not is_local and urlsplit(text).scheme and "://" in text:
        return text
    path = path_of(text)
    if not path.is_absolute():
        raise InputError("expected the whole path, from the root of the disk", source=text)
    try:
        is_there = path.exists()
    except OSError as error:
        raise InputError(error.strerror or str(error), source=text) from None
    if not is_there:
        raise InputError("there is no such folder on this machine", source=text)
    return str(path)


def path_of(text: str) -> Path:
    """What is stated as a path; ``~`` of somebody whom this machine does not know stays as it is."""
    path = Path(text.strip().strip("\"'"))
    with suppress(RuntimeError):
        return path.expanduser()
    return path


def how(job: Job, *, again: Link) -> tuple[Block, ...]:
    """What the command said, the way to another, and the command itself."""
    said = Details(summary="What the command said", blocks=(Code(text=job.text, label="Its output"),))
    return (*((said,) if job.text.strip() else ()), again, Code(text=job.command, label=SAME))


def files_form(to: str, button: str, place: Field, *fields: Field) -> Form:
    """The one question for files: those of the browser's machine, chosen or dropped, or where they are on this one."""
    return Form(to=to, button=button, drops=f"{to}/drop", fields=(FILES, place, *fields))


def desk_page(title: str, lead: str, sections: tuple[Section, ...], badge: Badge | None = None) -> View:
    """A page of the desk, too short for a table of contents."""
    return View(title=title, lead=lead, badge=badge, sections=sections, contents=False, made_by=made_by())


def running(job: Job, address: str, found: Sequence[Section] = ()) -> View:
    """Make the page of a command that runs, or waits for a processor.

    Args:
        job: the command.
        address: of this page.
        found: what it has found so far.
    """
    done, total, what = job.progress
    return desk_page(
        title=job.title,
        lead="It goes on if you leave this page, and ends with the desk.",
        sections=(
            Section(
                title="Running",
                blocks=(
                    Running(state=f"{address}/state", done=done, total=total, what=what),
                    Form(to=f"{address}/stop", button="Stop", is_aside=True),
                    Code(text=job.command, label=SAME),
                ),
            ),
            *found,
        ),
    )


def without_result(job: Job, *, again: Link, more: Section | None = None) -> View:
    """Make the page of a command that was stopped, or failed, and which may be asked again with ``more`` said."""
    if job.is_cancelled:
        more, note = None, Note(text="Stopped; nothing was kept.")
    else:
        text = job.text.strip().rpartition("\n")[2].removeprefix("calibrary: ")
        note = Note(
            text=text, tone=Tone.BAD, action="say what is missing below" if more is not None else None
        )
    return desk_page(
        title=job.title,
        lead="There is no result.",
        sections=(Section(title="Ended", blocks=(note, *how(job, again=again))), *filter(None, (more,))),
    )


def flags(asked: Mapping[str, str], fields: Sequence[Field]) -> list[str]:
    """The answers as flags of a command; the fields are named after them."""
    return [f"--{one.name}={asked[one.name]}" for one in fields if asked.get(one.name)]


def stated(job: Job) -> dict[str, str]:
    """The answers that a command has as flags."""
    return dict(word[2:].split("=", 1) for word in job.words if word.startswith("--") and "=" in word)


def again_form(
    job: Job, address: str, to: str, button: str, fields: Sequence[Field], *, is_dropped: bool
) -> Form:
    """The question of a command again, on the same files, with what was answered."""
    said = stated(job)
    name, value = ("kept", address.rpartition("/")[2]) if is_dropped else ("place", job.words[1])
    place = Field(name=name, type="hidden", value=value)
    return Form(
        to=to, button=button, fields=(place, *(replace(one, value=said.get(one.name, "")) for one in fields))
    )


def proposal_form(address: str) -> Form:
    """The form that confirms what the dry run at this address showed."""
    job = Field(name="job", type="hidden", value=address.rpartition("/")[2])
    return Form(
        to="/propose", button="Propose it", fields=(job, Field(name="reason", label="Why, for the history"))
    )
