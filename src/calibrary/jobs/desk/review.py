"""Review: what waits, each proposal beside what is in use, and the decisions, which are the commands of a terminal.

A decision names the content that was looked at. If that has changed since, nothing is written, and what is there now is
shown instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from typing import Final
from urllib.parse import urlencode

from calibrary.calibration import Calibration
from calibrary.errors import ConflictError, UsageError
from calibrary.jobs.desk.work import Job
from calibrary.jobs.diff.comparison import DiffReport
from calibrary.jobs.diff.told import badge_of, comparison_sections
from calibrary.jobs.fleet import Fleet
from calibrary.jobs.fleet.changes import MATERIAL
from calibrary.jobs.status.run import Kind, Matter
from calibrary.jobs.status.told import told
from calibrary.pages.wording import count, distortion_blocks, intrinsics_items, made_by
from calibrary.provenance import facts
from calibrary.records import replace
from calibrary.registry.git.writing import identity
from calibrary.registry.paths import PROPOSED, file_path
from calibrary.registry.proposals import Proposals
from calibrary.registry.stating import Change
from calibrary.validation import Severity
from calibrary.view import (
    Badge,
    Block,
    Code,
    Column,
    Details,
    Field,
    Form,
    KeyValues,
    Note,
    Section,
    Table,
    Tone,
    View,
)

ALTITUDE_M: Final = 100.0
TONES: Final = {Severity.ERROR: Tone.BAD, Severity.WARNING: Tone.CAUTION, Severity.UNPROVEN: Tone.CAUTION}
HINTS: Final = {
    "passphrase": "unlock the key in a terminal (ssh-add), then decide again",
    "signing failed": "unlock the key in a terminal (ssh-add), then decide again",
    "--reason": "write a reason, then decide again",
    "--force": "if it is right in spite of that, write a reason and tick the box",
    "git does not know who you are": "tell git your name and address, then decide again",
    "--theirs": "decide in a terminal which version counts; the command is below",
}
"""What to do in the desk, by words of a command's message."""


def queue(fleet: Fleet, said: Sequence[Section] = ()) -> View:
    """Make the page of what waits.

    Args:
        fleet: the registry.
        said: what was just done.
    """
    found = fleet.status()
    view = told(found, page_of=_page_of)
    sync = Form(to="/sync", button="Exchange with the remote", is_aside=True)
    text = "Fetches the commits of others and sends yours; nobody's are overwritten."
    at = f" at commit {found.commit[:12]}" if found.commit is not None else ""
    return replace(
        view,
        title="Review",
        lead=f"{view.lead}{at}.",
        sections=(
            *said,
            *(view.sections or (Section(title="Matters", blocks=("Nothing waits.",)),)),
            Section(title="With others", blocks=(text, sync)),
        ),
    )


def _page_of(matter: Matter) -> str | None:
    """The page on which a proposal is looked at beside what it would replace."""
    return f"/review/one?{urlencode({'key': matter.what})}" if matter.kind is Kind.PROPOSAL else None


def proposal(fleet: Fleet, key: str, said: Sequence[Section] = ()) -> View:
    """Make the page of one proposal, beside the entry that it would replace.

    Args:
        fleet: the registry.
        key: as ``registry status`` names it: KEY@proposed, or KEY@BRANCH where it waits on another.
        said: what was just tried.

    Raises:
        RegistryError: it is no longer proposed, or cannot be read.
    """
    name, _, branch = file_path(key).partition("@")
    change = fleet.propose_approval([name], source=branch or None)
    [one] = change.proposals.items
    if one.seen is None:
        raise ConflictError(f"{one.id}: nothing of it is proposed any more; it was decided meanwhile")
    compared = change.comparisons.get(one.path)
    matter = next((each for each in fleet.status().matters if each.what == key), None)
    person, remarks = identity(fleet.registry.repo)
    blocks: list[Block] = [
        *(Note(text=text, tone=Tone.CAUTION) for text in (*one.warnings, *remarks)),
        *(
            Note(text=str(each), tone=TONES.get(each.severity, Tone.NEUTRAL))
            for each in change.proposals.findings
        ),
        *_approval_forms(one, name, branch, change.proposals),
    ]
    where = (("waits on the branch", branch),) if branch else ()
    facts_ = (
        ("waits", matter.text if matter is not None else "as a proposal"),
        ("since", str(matter.since) if matter is not None and matter.since else "unknown"),
        *where,
        ("content", one.seen[:12]),
        ("you are", f"{person.name} <{person.email}>"),
    )
    return View(
        title=f"Proposal for {one.after.calibration.camera}",
        badge=badge_of(compared) if compared is not None else Badge("new", Tone.NEUTRAL),
        lead=f"{one.id}. What is in use stays in use until this is approved.",
        facts=facts_,
        sections=(
            *said,
            Section(title="Decide", blocks=tuple(blocks)),
            *((_beside(compared),) if compared is not None else ()),
            Section(title="What is proposed", blocks=tuple(_proposed(one))),
        ),
        made_by=made_by(),
    )


def _beside(compared: DiffReport) -> Section:
    told = "A is the entry in use, B is what is proposed."
    return Section(title="Beside the entry in use", blocks=(told, *comparison_sections(compared, ALTITUDE_M)))


def _approval_forms(one: Change, name: str, branch: str, proposals: Proposals) -> Iterator[Block]:
    hidden = (
        Field(name="key", type="hidden", value=name),
        Field(name="branch", type="hidden", value=branch),
        Field(name="digest", type="hidden", value=one.seen or ""),
    )
    force = Field(
        name="force", type="checkbox", value="yes", label="Use it although it contradicts what is known"
    )
    is_material = any(each.rule == MATERIAL for each in proposals.findings)
    yield Form(
        to="/decide",
        button="Approve",
        fields=(
            *hidden,
            Field(name="what", type="hidden", value="approve"),
            Field(
                name="reason",
                label="Why, for the history",
                hint="needed, for the change is a material one" if is_material else "",
                required=is_material,
            ),
            *((force,) if proposals.errors else ()),
        ),
    )
    if branch:
        yield f"It waits on the branch {branch}; to reject it, delete that branch: git branch -D {branch}"
    else:
        yield Form(
            to="/decide",
            button="Reject",
            fields=(
                *hidden,
                Field(name="what", type="hidden", value="reject"),
                Field(name="reason", label="Why not, for the history", required=True),
            ),
            is_aside=True,
        )


def _proposed(one: Change) -> Iterator[Block]:
    K: Calibration = one.after.calibration
    yield KeyValues((*intrinsics_items(K), ("grade", K.grade.value), *facts(K.provenance)))
    yield from distortion_blocks(K)
    rows = tuple(
        (each.name, *("–" if value is None else str(value) for value in (each.before, each.after)))
        for each in one.fields
    )
    if rows:
        table = Table(
            caption="Every field that changes",
            columns=(Column("field"), Column("in use"), Column("proposed")),
            rows=rows,
        )
        yield Details(summary=count(len(rows), "changed field"), blocks=(table,))


def retirement_form(key: str, digest: str) -> Form:
    """The form that retires an entry in use, whose file has this id."""
    return Form(
        to="/decide",
        button="Retire",
        fields=(
            Field(name="key", type="hidden", value=key),
            Field(name="digest", type="hidden", value=digest),
            Field(name="what", type="hidden", value="retire"),
            Field(name="reason", label="Why retire it", required=True),
            Field(name="start", type="date", label="Only for images from this day on"),
        ),
        is_aside=True,
    )


def decision(
    what: str,
    key: str,
    digest: str,
    *,
    branch: str,
    reason: str,
    start: date | None,
    force: bool,
) -> list[str]:
    """Return the command that makes a decision.

    Args:
        what: approve, reject or retire.
        key: of the entry.
        digest: id in git of the content that was looked at; the command writes nothing if it is another one by then.
        branch: with the proposal to approve; empty for the present one.
        reason: why.
        start: first day of a retirement.
        force: approve a K that contradicts what is known.

    Raises:
        UsageError: there is no such decision.
    """
    # In one word: a reason may begin as a flag does.
    said = [f"--digest={digest}", *([f"--reason={reason}"] if reason else [])]
    if what == "approve":
        on = [f"--from={branch}"] if branch else []
        return [
            "registry",
            "approve",
            key,
            *on,
            *said,
            *(["--force"] if force else []),
        ]
    if what not in {"reject", "retire"}:
        raise UsageError(f"there is no decision {what!r:.20}")
    since = ["--from", start.isoformat()] if start is not None else []
    named = f"{key}{PROPOSED}" if what == "reject" else key
    return ["registry", "retire", named, *said, *since]


def decided(job: Job) -> Section:
    """What came of a command that changes the registry."""
    good = job.code == 0
    lines = [line for line in job.text.splitlines() if line.strip()]
    hint = None if good else next((hint for word, hint in HINTS.items() if word in job.text), None)
    text = f"{job.title}: {'done' if good else 'not done'}. {lines[-1] if lines else ''}"
    if job.is_cancelled:
        text = f"{job.title}: ended after too long; look whether it was written."
    return Section(
        title="Done" if good else "Not done",
        blocks=(
            Note(text=text, action=hint, tone=Tone.GOOD if good else Tone.BAD),
            Details(
                summary="What the command said",
                blocks=(
                    Code(text=job.command, label="The same in a terminal"),
                    Code(text=job.text, label="Its output"),
                ),
            ),
        ),
    )
