"""``calibrary registry check``: check all entries; for users, and for a hook or CI that accepts a push."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.registry import OfRegistry
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.fleet import CheckDocument

DESCRIPTION = "Check entries against the schema, their digest, path, provenance, the policy and one another."
EXAMPLES = """\
examples:
  calibrary registry check                               all that is committed
  calibrary registry check origin/main..HEAD             what a branch changes, and what that affects
  calibrary registry check --worktree                    the files in the folder, before they are committed

exit code 0: no error, possibly warnings; 1: at least one error.
"""


class _Check(OfRegistry):
    def show(self, done: CheckDocument, arguments: argparse.Namespace, **_: Any) -> None:
        """Show each finding in a line that begins with its place, as compilers do."""
        from calibrary.cli.console import out

        screen, styles = out(arguments), {"error": "bold red", "warning": "yellow"}
        for finding in done.findings:
            said = f"{finding.message}; {finding.remedy}" if finding.remedy else finding.message
            severity = (finding.severity.value, styles.get(finding.severity.value, ""))
            screen.say(f"{finding.place or ''}: ", severity, f": {said} ", (f"({finding.rule})", "dim"))
        errors = len(done.errors)
        warnings = len(done.findings) - errors
        counts = f"{errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"
        verdict = ("good", "bold green") if done.is_good else ("bad", "bold red")
        screen.say(verdict, f": {done.what}: {counts}")


COMMAND = _Check(
    Fleet.check,
    DESCRIPTION,
    EXAMPLES,
    positional={"span": "REV..REV"},
    doing="checking",
    exits={"is_good": 1},
)
