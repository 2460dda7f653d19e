"""What the configuration inside a repository may not do.

A registry may have come from anywhere, as a folder with its own ``.git/config``; and settings of git name programs
to run. What the repository's own files set is therefore not believed where it could run something: such keys are
set back to what the person's own configuration says, or to nothing, for every command. Those that cannot be set
back make the repository one that is not opened. The person's own files (``~/.gitconfig``, the machine's) hold as
they always do: credential helpers, ssh, signing keys.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary.errors import RegistryError

__all__ = [
    "ALWAYS",
    "PINNED",
    "Environment",
    "Setting",
    "judge_settings",
    "parse_settings",
    "repository_environment",
]

Environment = dict[str, str]

PINNED: tuple[tuple[str, str], ...] = (
    ("core.hooksPath", os.devnull),
    ("core.fsmonitor", "false"),
    ("core.filesRefLockTimeout", "50"),
    ("core.protectHFS", "true"),
    ("core.protectNTFS", "true"),
    ("core.quotePath", "false"),
    ("core.warnAmbiguousRefs", "true"),
    ("color.ui", "false"),
    ("diff.renames", "false"),
    ("fastimport.unpackLimit", "100"),
    ("fetch.fsckObjects", "true"),
    ("fetch.recurseSubmodules", "false"),
    ("gc.auto", "0"),
    ("gc.pruneExpire", "2.weeks.ago"),
    ("http.lowSpeedLimit", "1000"),
    ("http.lowSpeedTime", "60"),
    ("i18n.commitEncoding", "UTF-8"),
    ("i18n.logOutputEncoding", "UTF-8"),
    ("log.follow", "false"),
    ("log.showRoot", "true"),
    ("log.showSignature", "false"),
    ("maintenance.auto", "false"),
    ("submodule.recurse", "false"),
)
"""Said to every command: no program of the repository's runs, and no setting of the user changes what is read."""

RUNS_A_PROGRAM: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"core\.sshcommand\Z"), "ssh"),
    (re.compile(r"core\.(askpass|gitproxy|editor|pager)\Z"), ""),
    (re.compile(r"core\.alternaterefscommand\Z"), "true"),
    (re.compile(r"credential\.(.*\.)?helper\Z"), ""),
    (re.compile(r"filter\..*\.(clean|smudge|process)\Z"), ""),
    (re.compile(r"filter\..*\.required\Z"), "false"),
    (re.compile(r"diff\.external\Z|diff\..*\.(command|textconv)\Z"), ""),
    (re.compile(r"gpg\.(openpgp\.)?program\Z"), "gpg"),
    (re.compile(r"gpg\.x509\.program\Z"), "gpgsm"),
    (re.compile(r"gpg\.ssh\.program\Z"), "ssh-keygen"),
    (re.compile(r"gpg\.ssh\.defaultkeycommand\Z"), ""),
    # Cookies are written to any file one names; and a proxy of theirs with a certificate of theirs reads passwords.
    (re.compile(r"http\.(.*\.)?(cookiefile|sslcainfo|sslcapath)\Z"), ""),
    (re.compile(r"http\.(.*\.)?savecookies\Z"), "false"),
    (re.compile(r"http\.(.*\.)?sslverify\Z"), "true"),
)
"""Keys and what they fall back to. Keys of remotes are not among them: remotes are addressed by URL, never by name."""

ALWAYS: dict[str, tuple[str, ...]] = {"status": ("--ignore-submodules=all",)}
"""Options of commands that go into other repositories otherwise, where those repositories' own settings hold."""

REFUSED = re.compile(
    r"include\.path\Z|includeif\..+|gc\.recentobjectshook\Z|hook\..+",
    re.DOTALL,
)

PARTIAL = re.compile(r"extensions\.partialclone\Z|remote\..+\.(promisor|partialclonefilter)\Z", re.DOTALL)
"""By these git fetches what a clone lacks while it is read, from wherever the repository says."""


class Setting(Struct, frozen=True, kw_only=True):
    """One line of git's configuration.

    Attributes:
        key: section and name in lower case, the part between them as written.
        is_local: whether the repository itself says so, not the person or the machine.
    """

    key: str
    value: str
    is_local: bool


def parse_settings(listed: bytes, folders: Sequence[Path], base: Path) -> tuple[Setting, ...]:
    """The output of ``git config --list --show-origin -z``.

    A setting in a file below one of ``folders``, the repository's own, is local, and so is what such a file is
    only a link to; names of files count from ``base``.
    """
    fields = listed.split(b"\0")
    settings = []
    for origin, line in zip(fields[0::2], fields[1::2], strict=False):
        key, _, value = os.fsdecode(line).partition("\n")
        kind, _, name = os.fsdecode(origin).partition(":")
        file = base / name
        places = (Path(os.path.realpath(file)), Path(os.path.realpath(file.parent), file.name))
        is_local = kind == "file" and any(
            place.is_relative_to(folder) for place in places for folder in folders
        )
        settings.append(Setting(key=key, value=value, is_local=is_local))
    return tuple(settings)


def judge_settings(settings: Sequence[Setting], source: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Which ``-c`` options keep a repository's own settings from running anything, and which keys that silences.

    Raises:
        RegistryError: a setting can only be removed, or the repository is of a kind that is not read.
    """
    _check_kind(settings, source)
    local = [setting.key for setting in settings if setting.is_local]
    if lazy := [key for key in dict.fromkeys(local) if PARTIAL.match(key)]:
        unset = "; ".join(f"git -C {source} config --local --unset-all {key}" for key in lazy)
        raise RegistryError(
            f"{source}: a partial clone, which lacks files that git would fetch while it is read. To make it whole: "
            f"git -C {source} fetch --refetch --no-filter; {unset}. Or clone it without a filter: calibrary registry "
            "init FOLDER --remote URL"
        )
    flags = [f"{key}={value}" for key, value in PINNED]
    silenced = []
    for key in dict.fromkeys(local):
        fallback = next((value for pattern, value in RUNS_A_PROGRAM if pattern.match(key)), None)
        # To -c the name of a key ends at its first "=".
        if REFUSED.match(key) or (fallback is not None and "=" in key):
            raise RegistryError(
                f"{source}: its own git configuration sets {key}, which can make reading it run a program or "
                f"reach elsewhere; check it, then remove it: git -C {source} config --local --unset-all {key}"
            )
        if fallback is None:
            continue
        silenced.append(key)
        mine = [setting.value for setting in settings if setting.key == key and not setting.is_local]
        flags.append(f"{key}={fallback}")
        flags += [f"{key}={value}" for value in mine]
    return tuple(part for flag in flags for part in ("-c", flag)), tuple(silenced)


def _check_kind(settings: Sequence[Setting], source: str) -> None:
    for setting in settings:
        found = setting.value.lower()
        if setting.key == "extensions.objectformat" and found != "sha1":
            raise RegistryError(
                f"{source}: a git repository with {found} object names; GitPython reads sha1 only. Make the "
                "registry with calibrary, or by: git init --object-format=sha1"
            )
        if setting.key == "extensions.refstorage" and found != "files":
            raise RegistryError(
                f"{source}: a git repository that stores its branches as {found}; expected plain files. Convert "
                "it: git refs migrate --ref-format=files"
            )


def repository_environment(git_dir: Path, common_dir: Path, work_tree: Path | None) -> Environment:
    """The variables that tie every command to this repository, whatever a hook or a shell has set around it.

    To a hook of this very repository that judges a push (pre-receive), what was pushed lies in a place of its own
    inside; it is looked into as well.
    """
    objects = common_dir / "objects"
    pushed = Path(os.path.realpath(os.environ.get("GIT_QUARANTINE_PATH", "")))
    is_judging = pushed != objects and pushed.is_relative_to(objects)
    return PEACE | {
        "GIT_DIR": str(git_dir),
        "GIT_COMMON_DIR": str(common_dir),
        "GIT_WORK_TREE": str(work_tree or git_dir),
        "GIT_INDEX_FILE": str(git_dir / "index"),
        "GIT_OBJECT_DIRECTORY": str(pushed if is_judging else objects),
        "GIT_ALTERNATE_OBJECT_DIRECTORIES": str(objects) if is_judging else "",
        # One that is not there: info/grafts would change the history.
        "GIT_GRAFT_FILE": str(git_dir / "info" / "no-grafts"),
    }


PEACE: Environment = {
    "GIT_ALLOW_PROTOCOL": "https:ssh:file",
    "GIT_EDITOR": ":",
    "GIT_GLOB_PATHSPECS": "0",
    "GIT_ICASE_PATHSPECS": "0",
    "GIT_LITERAL_PATHSPECS": "1",
    "GIT_NAMESPACE": "",
    "GIT_NOGLOB_PATHSPECS": "0",
    "GIT_NO_LAZY_FETCH": "1",
    "GIT_NO_REPLACE_OBJECTS": "1",
    "GIT_OPTIONAL_LOCKS": "0",
    "GIT_PAGER": "cat",
    "GIT_TERMINAL_PROMPT": "0",
}
"""git asks no questions, fetches nothing during a read, and uses no other protocol."""
