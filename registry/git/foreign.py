"""Restrictions on the configuration inside a repository.

A registry may come from any source, as a folder with its own ``.git/config``, and git's settings can name programs to
run. So settings in the repository's own files are not followed where they could run a program: such keys are reset,
for every command, to the value in the user's own configuration, or to nothing. A repository with settings that cannot
be reset is not opened. The user's own files (``~/.gitconfig``, the system's) apply as usual: credential helpers, ssh,
signing keys.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary.errors import RegistryError

__all__ = [
    "OPTIONS_OF",
    "PINNED",
    "Environment",
    "Setting",
    "judge_settings",
    "parse_settings",
    "repository_environment",
]

Environment = dict[str, str]

PINNED: tuple[tuple[str, str], ...] = (
    # These two run a program of the repository at almost every command.
    ("core.hooksPath", os.devnull),
    ("core.fsmonitor", "false"),
    ("core.filesRefLockTimeout", "50"),
    ("core.protectHFS", "true"),
    ("core.protectNTFS", "true"),
    ("core.quotePath", "false"),
    ("core.warnAmbiguousRefs", "true"),
    ("color.ui", "false"),
    ("diff.renames", "false"),
    # Git's own value: a small write stays loose objects, which maintenance packs, instead of a pack of its own.
    ("fastimport.unpackLimit", "100"),
    ("fetch.fsckObjects", "true"),
    ("fetch.recurseSubmodules", "false"),
    # Maintenance runs only where Repository asks for it, and keeps what another writer has just begun to write.
    ("gc.auto", "0"),
    ("gc.pruneExpire", "2.weeks.ago"),
    ("http.lowSpeedLimit", "1000"),
    ("http.lowSpeedTime", "60"),
    ("i18n.commitEncoding", "UTF-8"),
    ("i18n.logOutputEncoding", "UTF-8"),
    ("log.follow", "false"),
    # With false, the first revision of an entry would be missing from its history.
    ("log.showRoot", "true"),
    ("log.showSignature", "false"),
    ("maintenance.auto", "false"),
    ("submodule.recurse", "false"),
)
"""Options of every command: no program of the repository runs, and no user setting changes what is read."""

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
    # Cookies could be written to any file; a foreign proxy with a foreign certificate could read passwords.
    (re.compile(r"http\.(.*\.)?(cookiefile|sslcainfo|sslcapath)\Z"), ""),
    (re.compile(r"http\.(.*\.)?savecookies\Z"), "false"),
    (re.compile(r"http\.(.*\.)?sslverify\Z"), "true"),
)
"""Keys and the values they are reset to. Keys of remotes are not included: remotes are addressed only by URL."""

OPTIONS_OF: dict[str, tuple[str, ...]] = {"status": ("--ignore-submodules=all",)}
"""Options of commands that would otherwise enter other repositories, where the settings of those would apply."""

REFUSED = re.compile(
    r"include\.path\Z|includeif\..+|gc\.recentobjectshook\Z|hook\..+",
    re.DOTALL,
)

PARTIAL = re.compile(r"extensions\.partialclone\Z|remote\..+\.(promisor|partialclonefilter)\Z", re.DOTALL)
"""With these, git fetches missing objects during reading from a place that the repository chooses."""


class Setting(Struct, frozen=True, kw_only=True):
    """A line of git's configuration.

    Attributes:
        key: section and name in lower case, the part between them as written.
        is_local: whether it is from the repository itself, and not from the user or the system.
    """

    key: str
    value: str
    is_local: bool


def parse_settings(listed: bytes, folders: Sequence[Path], base: Path) -> tuple[Setting, ...]:
    """Parse the output of ``git config --list --show-origin -z``.

    A setting from a file below one of ``folders``, those of the repository, is local, also if that file is a link;
    file names are relative to ``base``.
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
    """Return the ``-c`` options that disable dangerous settings of a repository, and the keys disabled by them.

    Raises:
        RegistryError: a setting must be removed, or this kind of repository is not supported.
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
        # For -c, the name of a key ends at the first "=".
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
    """Return the variables that tie every command to this repository, whatever a hook or a shell has set.

    For a hook of this repository that checks a push (pre-receive), the pushed objects are in a separate folder inside
    it, which is included.
    """
    objects = common_dir / "objects"
    pushed = Path(os.path.realpath(os.environ.get("GIT_QUARANTINE_PATH", "")))
    is_judging = pushed != objects and pushed.is_relative_to(objects)
    return ISOLATED | {
        "GIT_DIR": str(git_dir),
        "GIT_COMMON_DIR": str(common_dir),
        "GIT_WORK_TREE": str(work_tree or git_dir),
        "GIT_INDEX_FILE": str(git_dir / "index"),
        "GIT_OBJECT_DIRECTORY": str(pushed if is_judging else objects),
        "GIT_ALTERNATE_OBJECT_DIRECTORIES": str(objects) if is_judging else "",
        # A file that does not exist; info/grafts would change the history.
        "GIT_GRAFT_FILE": str(git_dir / "info" / "no-grafts"),
    }


ISOLATED: Environment = {
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
