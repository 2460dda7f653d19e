"""What a check of a registry found, and how it is printed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, Self

from msgspec import Struct

from calibrary.records import Meta, Record
from calibrary.registry.git.objects import ObjectId
from calibrary.validation import Finding, Severity

__all__ = ["CheckDocument", "CheckReport", "Checked", "count_of", "document_of", "finding_of"]


class CheckDocument(Record, tag_field="schema", tag="calibrary/registry-check-1"):
    """What ``calibrary registry check --json`` prints.

    Attributes:
        verdict: bad where there is an error or an unsigned commit.
        commit: that was checked; None for files in a folder.
        before: where a range begins; None where everything was checked.
        entries: how many were checked.
        findings: in the order of their paths.
        unsigned: commits without a signature by a person on the list, and why; None where that was not asked.
    """

    verdict: Literal["good", "bad"]
    commit: ObjectId | None
    before: ObjectId | None
    entries: Annotated[int, Meta(ge=0)]
    findings: tuple[Finding, ...]
    unsigned: tuple[str, ...] | None


class CheckReport(Struct, frozen=True, kw_only=True):
    """What a check found.

    Attributes:
        entries: how many were checked.
        findings: in the order of their paths.
    """

    entries: int
    findings: tuple[Finding, ...]

    @classmethod
    def of(cls, entries: int, findings: Iterable[Finding]) -> Self:
        """A report with its findings in order."""
        ordered = sorted(findings, key=lambda one: (one.place or "", one.rule, one.message))
        return cls(entries=entries, findings=tuple(ordered))

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that keep the registry from being good."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @property
    def is_good(self) -> bool:
        """Whether there are no errors; warnings are allowed."""
        return not self.errors


class Checked(Struct, frozen=True, kw_only=True):
    """What was checked, and the report on it.

    Attributes:
        what: was checked, in words.
        commit: of the entries; None for files in a folder.
        before: where a range begins.
        report: what was found.
    """

    what: str
    commit: str | None
    before: str | None = None
    report: CheckReport


def document_of(done: Checked, unsigned: tuple[str, ...] | None) -> CheckDocument:
    """The JSON form of a check; ``unsigned`` is None where signatures were not asked for."""
    return CheckDocument(
        verdict="good" if done.report.is_good and not unsigned else "bad",
        commit=done.commit,
        before=done.before,
        entries=done.report.entries,
        findings=done.report.findings,
        unsigned=unsigned,
    )


def finding_of(path: str, rule: str, message: str, severity: Severity = Severity.ERROR) -> Finding:
    """A finding about a file; a message that begins with its path, as errors of reading do, loses it."""
    said = message.removeprefix(f"{path}: ")
    return Finding(rule=rule, severity=severity, place=path, message=said)


def count_of(count: int) -> str:
    """A number of entries in words."""
    return "1 entry" if count == 1 else f"{count} entries"
