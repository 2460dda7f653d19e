"""Changes of who may approve: what ``registry.yaml`` asks for is put in force by a statement."""

from __future__ import annotations

from calibrary.errors import RegistryError
from calibrary.registry.configuration import RuleSet, parse_configuration
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.proposals import ChangeReport, message_of, require_digest, write_changes
from calibrary.registry.registry import Registry
from calibrary.registry.sshsig import fingerprint, key_blob
from calibrary.registry.stating import state_rules


def stated_rules(registry: Registry) -> tuple[RuleSet, str]:
    """Return what the committed ``registry.yaml`` asks for, and git's id of the file.

    Raises:
        RegistryError: the registry has no such file.
    """
    blob = registry.repo.read(registry.commit(), CONFIGURATION_FILE)
    if blob is None:
        raise RegistryError(f"{registry.repo.path}: has no {CONFIGURATION_FILE}")
    return parse_configuration(blob.data).rules, blob.oid


def rules_text(rules: RuleSet) -> str:
    """Return rules as lines for people."""
    lines = []
    for one in rules.people:
        blobs = [blob for key in one.keys if (blob := key_blob(key)) is not None]
        lines.append(" ".join([one.name, *map(fingerprint, blobs)]))
    rule = rules.approvals
    of_whom = f" of {', '.join(rule.by)}" if rule.by else ""
    lines.append(f"{rule.count} approval{'s' if rule.count != 1 else ''}{of_whom}")
    lines.append(f"limits of the policy {rules.policy.name}")
    return "\n".join(lines)


def approve_rules(registry: Registry, digest: str, reason: str | None) -> ChangeReport:
    """Put in force what ``registry.yaml`` asks for; see :meth:`calibrary.Fleet.approve_rules`."""
    rules, oid = stated_rules(registry)
    if not oid.startswith(require_digest(digest)):
        raise RegistryError(
            f"nothing was written: registry.yaml now has the digest {oid[:12]}; look at that one"
        )
    found = state_rules(registry.snapshot(), rules, reason)
    subject = "Approve new rules" + (", with others to follow" if found.missing else "")
    written = write_changes(registry.repo, found.changes, message_of(subject, reason=reason))
    unused = tuple(
        f"what registry.yaml asks for is not in force yet: it has {why}" for why in found.missing.values()
    )
    return ChangeReport(
        registry=str(registry.repo.path),
        commit=written.commit,
        entries=(),
        findings=(),
        warnings=(*written.warnings, *found.warnings, *unused),
    )
