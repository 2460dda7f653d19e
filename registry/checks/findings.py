"""Results of a registry check, and their printed form."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, Self

from msgspec import Struct

from calibrary.records import Meta, Record
from calibrary.registry.git.objects import ObjectId
from calibrary.validation import Finding, Severity

__all__ = ["CheckDocument", "CheckReport", "Checked", "count_of", "document_of", "finding_of"]


class CheckDocument(Record, tag_field="schema", tag="calibrary/registry-check-1"):
    """Output of ``calibrary registry check --json``.

    Attributes:
        verdict: bad if there is an error or an unsigned commit.
        commit: checked commit; None for files in a folder.
        before: start of the checked range; None if everything was checked.
        entries: number of checked entries.
        findings: findings, sorted by path.
        unsigned: commits without a signature of a listed person, with the reason; None if signatures were not checked.
    """

    verdict: Literal["good", "bad"]
    commit: ObjectId | None
    before: ObjectId | None
    entries: Annotated[int, Meta(ge=0)]
    findings: tuple[Finding, ...]
    unsigned: tuple[str, ...] | None


class CheckReport(Struct, frozen=True, kw_only=True):
    """Findings of a check.

    Attributes:
        entries: number of checked entries.
        findings: findings, sorted by path.
    """

    entries: int
    findings: tuple[Finding, ...]

    @classmethod
    def of(cls, entries: int, findings: Iterable[Finding]) -> Self:
        """Make a report with sorted findings."""
        ordered = sorted(findings, key=lambda one: (one.place or "", one.rule, one.message))
        return cls(entries=entries, findings=tuple(ordered))

    @property
    def errors(self) -> tuple[Finding, ...]:
        """Findings with severity error."""
        return tuple(finding for finding in self.findings if finding.severity is Severity.ERROR)

    @property
    def is_good(self) -> bool:
        """Whether there are no errors; warnings are allowed."""
        return not self.errors


class Checked(Struct, frozen=True, kw_only=True):
    """A check and its report.

    Attributes:
        what: description of what was checked.
        commit: commit of the entries; None for files in a folder.
        before: start of the checked range.
        report: findings.
    """

    what: str
    commit: str | None
    before: str | None = None
    report: CheckReport


def document_of(done: Checked, unsigned: tuple[str, ...] | None) -> CheckDocument:
    """Return the JSON form of a check; ``unsigned`` is None if signatures were not checked."""
    return CheckDocument(
        verdict="good" if done.report.is_good and not unsigned else "bad",
        commit=done.commit,
        before=done.before,
        entries=done.report.entries,
        findings=done.report.findings,
        unsigned=unsigned,
    )


def finding_of(path: str, rule: str, message: str, severity: Severity = Severity.ERROR) -> Finding:
    """Make a finding about a file; its path is removed from the start of the message."""
    said = message.removeprefix(f"{path}: ")
    return Finding(rule=rule, severity=severity, place=path, message=said)


def count_of(count: int) -> str:
    """Return a number of entries in words."""
    return "1 entry" if count == 1 else f"{count} entries"
