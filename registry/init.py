"""Creation of a registry: in a new folder, in an empty repository, or as a clone; and its initial files."""

from __future__ import annotations

import re
import shutil
from datetime import date
from pathlib import Path
from typing import Final

from calibrary import schemas
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.distortion.described import document
from calibrary.errors import CalibraryError, RegistryError
from calibrary.records import Record, replace
from calibrary.registry.configuration import LAYOUT, configuration_yaml, parse_configuration
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import entry_yaml, parsed, without_status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.git.program import check_url, without_secret
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository, create, index_paths
from calibrary.registry.git.writing import FileChange, identity
from calibrary.registry.paths import CAMERAS, DOCUMENT, EVENTS, ROOT, check_path, is_entry
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.proposals import message_of, write_changes
from calibrary.registry.registry import Registry
from calibrary.registry.stating import founded
from calibrary.version import __version__

REQUIREMENT: Final = f"=={__version__}"
"""Version that created this registry: checks must not change with an unreviewed release."""

FIRST: Final = message_of("Create a registry of camera calibrations")
LAST_NAME: Final = re.compile(r"([\w.-]+?)(?:\.git)?/*\Z")


class InitReport(Record, tag_field="schema", tag="calibrary/registry-begun-1"):
    """Output of ``calibrary registry init --json``.

    Attributes:
        registry: folder of the registry.
        commit: newest commit.
        cloned_from: address it was cloned from, without a password.
        files: files that were written; empty for a clone.
        outer: enclosing repository, if there is one, which should ignore this folder.
    """

    registry: str
    commit: ObjectId
    cloned_from: str | None
    files: tuple[str, ...]
    outer: Path | None = None
    _unwritten = frozenset({"outer"})

    @property
    def place(self) -> Path:
        """Folder of the registry."""
        return Path(self.registry)


def init(place: Path, *, bare: bool = False) -> InitReport:
    """Create a registry.

    A repository without commits, such as a clone of a new one at a host, can be used. One with commits belongs to
    another project: a registry has its own repository, so that its history is only that of its cameras.

    Args:
        place: folder; it is created if absent.
        bare: without a work tree, to push to.

    Raises:
        RegistryError: there already is a registry, or other files; nothing was changed.
    """
    files = scaffold()
    in_the_way = [name for name in files if not bare and (place / name).exists()]
    if (place / ".git").exists() or (place / "HEAD").exists():
        repo = _empty_repository(place, in_the_way)
    elif CONFIGURATION_FILE in in_the_way:
        raise RegistryError(
            f"{place}: a registry's files, but not a git repository; nothing was changed: add them with git init, "
            "git add and git commit, or name another folder"
        )
    elif in_the_way:
        raise RegistryError(
            f"{place}: {', '.join(in_the_way)} exists already, and a registry writes its own; nothing was "
            "changed: name another folder"
        )
    else:
        repo = create(place, bare=bare, check_path=check_path)
    return _initialised(repo, files)


def init_from(url: str, place: Path, *, bare: bool = False) -> InitReport:
    """Clone another registry; if it is still empty, start it here, to be pushed.

    Args:
        url: https://, ssh://, user@host:path or a folder.
        place: a new or empty folder.
        bare: without a work tree.

    Raises:
        RegistryError: the address cannot be reached or is not a registry; nothing is left behind.
    """
    shown, existed = without_secret(check_url(url)), place.exists()
    repo = clone(url, place, bare=bare, check_path=check_path)
    try:
        made = _initialised(repo, scaffold() if repo.tip() is None else {})
    except CalibraryError:
        for leftover in place.iterdir() if existed else [place]:
            shutil.rmtree(leftover, ignore_errors=True)
        raise
    return replace(made, cloned_from=shown)


def migrated(place: Path) -> InitReport:
    """Bring a registry of the former layout to this one, in one commit; what is in force stays in force.

    There, ``statements/`` held what ``events/`` holds, ``proposals/`` what was proposed, and each file a status.

    Raises:
        RegistryError: it is not a registry of that layout, or a file in it cannot be read; nothing was changed.
    """
    repo = Repository.open(place, check_path=str)
    tip = repo.newest()
    files = repo.listing(tip)
    configuration = repo.read(tip, CONFIGURATION_FILE)
    former = f"\nlayout: {LAYOUT - 1}\n".encode()
    if configuration is None or former not in b"\n" + configuration.data:
        raise RegistryError(
            f"{place}: is not of layout {LAYOUT - 1}, so there is nothing to bring to {LAYOUT}"
        )
    new = {CONFIGURATION_FILE: configuration.data.replace(former.strip(), f"layout: {LAYOUT}".encode(), 1)}
    ours = {name: data for name, data in scaffold().items() if name not in {CONFIGURATION_FILE, OWNERS}}
    new |= {name: data for name, data in ours.items() if name in files}
    for top, now in (("cameras/", ROOT), ("proposals/", ROOT), ("statements/", EVENTS)):
        # What was proposed comes last: approvals hold what is in use.
        for path in (path for path in files if path.startswith(top)):
            data, becomes = repo.blob(files[path]), f"{now}{path.removeprefix(top)}"
            new[becomes] = without_status(data) if now == ROOT else data
            if is_entry(becomes):
                parsed(new[becomes], path, require_digest=False)
    gone = [path for path in files if path.startswith(("proposals/", "statements/"))]
    changes = [FileChange(path=path, data=data, base=files.get(path)) for path, data in new.items()]
    changes += [FileChange(path=path, data=None, base=files[path]) for path in gone]
    written = write_changes(
        repo, changes, message_of(f"Bring the registry to layout {LAYOUT}"), is_checked=True
    )
    return InitReport(
        registry=str(repo.path), commit=written.commit, cloned_from=None, files=tuple(sorted(new))
    )


def folder_for(url: str) -> Path:
    """Return the folder that git would clone to: the last part of the address, in the current folder.

    Raises:
        RegistryError: the address has no such part.
    """
    found = LAST_NAME.search(url.replace("\\", "/").rstrip("/"))
    if found is None or set(found[1]) <= {"."}:
        raise RegistryError(
            f"{without_secret(url)}: does not contain a folder name; give one: init PATH --remote URL"
        )
    return Path(found[1])


def _empty_repository(place: Path, in_the_way: list[str]) -> Repository:
    repo = Repository.open(place, check_path=check_path)
    if repo.tip() is not None:
        if _is_registry(repo):
            raise RegistryError(
                f"{place}: there is a registry already; nothing was changed. 'calibrary registry list' shows its "
                "entries"
            )
        raise RegistryError(
            f"{place}: a git repository of another project, and a registry needs its own; nothing was changed: "
            f"name a folder next to it, or in it: calibrary registry init {place / 'cameras-registry'}"
        )
    if in_the_way:
        raise RegistryError(f"{place}: {', '.join(in_the_way)} exists already; nothing was changed")
    return repo


def _is_registry(repo: Repository) -> bool:
    tip = repo.tip()
    return tip is not None and (
        repo.read(tip, CONFIGURATION_FILE) is not None or bool(repo.listing(tip, CAMERAS))
    )


def _initialised(repo: Repository, files: dict[str, bytes]) -> InitReport:
    """Make the first commit, if there are files to write."""
    if files:
        keeper, unknown = identity(repo)
        if not unknown:
            files = {**files, OWNERS: CODEOWNERS.format(mark="", owner=keeper.email).encode()}
        rules = parse_configuration(files[CONFIGURATION_FILE]).rules
        files |= {one.path: one.data for one in founded(repo, rules) if one.data is not None}
        write_changes(repo, [FileChange(path=name, data=data) for name, data in files.items()], FIRST)
    index_paths(repo)
    return InitReport(
        registry=str(repo.path),
        commit=Registry(repo).commit(),
        cloned_from=None,
        files=tuple(sorted(files)),
        outer=_enclosing_repository(repo.path),
    )


def _enclosing_repository(place: Path) -> Path | None:
    return next((folder for folder in place.parents if (folder / ".git").exists()), None)


AS_WRITTEN: Final = b"/events/** -text\n"
ATTRIBUTES: Final = b"*.yaml text eol=lf\n*.md text eol=lf\n*.yml text eol=lf\n*.json text eol=lf\n"
"""``.gitattributes``: the bytes of an entry must be the same in every checkout, or its digest would not match."""

WORKFLOW: Final = ".github/workflows/registry-check.yml"

README: Final = """\
# Camera calibrations

One YAML file per camera, in `cameras/<make>/<model>/<variant>.yaml`: its newest calibration, to read and to edit. A
unit with its own calibration has a folder `sn-<hash>/` between the two; the serial number itself is not stored.

Which calibration is used is decided in `events/`, beside the same names: one file for each approval, retirement and
label, called by its day, what it does and who did it, such as `2026-05-01-approve-ada-0e25….json`. An approval holds
the content that it approves, and is signed where people have keys; these files are only ever added. What stands in
`cameras/` and too few people have approved is a proposal, and nothing uses it; the last approved one stays in use.

`registry.yaml` is the configuration: the schema versions, the limits that entries are checked against, and who
approves. The history of a camera is that of its file and its events.

## An entry

```yaml
{example}```

- `intrinsics` is K. `distortion` is separate: `null` is unknown, `model: none` means known to be none. The formula of
  each model, with its parameters in order, is in [DISTORTION.md](DISTORTION.md).
- `grade`, best first: `calibrated` (measured on this unit), `adjusted` (from a bundle adjustment), `design` (the
  manufacturer's nominal value), `derived` (focal length over pixel pitch).
- `digest` is a checksum over the numbers. To edit a number, delete that line and run `calibrary registry add FILE`.

## Reading it with git alone

    git log -p cameras/dji/fc6310r/5472x3648.yaml              every calibration of a camera, with reasons
    git log --stat events/cameras/dji/fc6310r/5472x3648        who approved and retired what of it
    git log --grep '^Camera: dji/fc6310r'                      the commits that name it
    git diff main...proposal                                   what a branch proposes
    git show v2026.1:cameras/dji/fc6310r/5472x3648.yaml        as it was at a tag

The trailers of each commit name the cameras (`Camera:`), the source files (`Source-File:`, `Source-Sha256:`), the
grade, the firmware and the reason (`Reason:`).

## Reviewing a change

1. Is the camera the right one: make, model, sub-camera, lens, image size?
2. Do fx and fy move by more than their uncertainty? 0.05 % of the focal length is drift; several per cent mean
   another lens, another image size or a wrong sensor size.
3. Are cx and cy near the middle, within 5 % of the sides?
4. Does `provenance` name a file with its sha256 and state when it was made, and does `Reason:` give the reason?
5. Does `calibrary registry check` pass? It runs on every push ({workflow}).

## With calibrary

    calibrary registry list                       list the entries
    calibrary registry add camera.xml             propose an entry; shows the difference and asks
    calibrary registry show KEY@proposed          show what is proposed
    calibrary registry approve KEY                show what it changes, and approve it for use
    calibrary registry log KEY                    show its history
    calibrary diff KEY@2026-05-01 KEY             compare two revisions
"""

OWNERS: Final = ".github/CODEOWNERS"
CODEOWNERS: Final = """\
# Whose review a change needs, on hosts that read this file; for it to count, the host's rules for the main branch have
# to ask for it. registry.yaml (approvals:) asks for approvals whatever the host.
{mark}/cameras/ {owner}
{mark}/registry.yaml {owner}
{mark}/.github/ {owner}
"""

HOOKS: Final = ".pre-commit-config.yaml"
PRE_COMMIT: Final = """\
# What is committed by hand is checked before; 'pre-commit install' has git do it (https://pre-commit.com).
repos:
  - repo: local
    hooks:
      - id: calibrary-registry-check
        name: calibrary registry check
        entry: calibrary registry check --worktree
        language: python
        additional_dependencies: ["calibrary{requirement}"]
        files: ^cameras/.*\\.yaml$|^registry\\.yaml$
        pass_filenames: false
"""

EDITED: Final = ("entry-1", "registry-1")
"""Schemas of the files that people edit; a registry contains them, so that an editor needs no network."""
EDITOR: Final = ".vscode/settings.json"
SETTINGS: Final = b"""\
{
  "yaml.schemas": {
    "schema/entry-1.schema.json": ["cameras/**/*.yaml"],
    "schema/registry-1.schema.json": "registry.yaml"
  }
}
"""
"""For VS Code's YAML extension. Entries are associated by their folders, since an entry must have the same bytes in
each registry and at every depth."""

CHECK: Final = """\
# Checks every entry against the schema, its digest, its path and the policy of registry.yaml; a pull request also by
# what it changes; events/ says what is approved.
name: registry check
on: [push, pull_request]
permissions:
  contents: read
jobs:
  check:
    runs-on: ubuntu-latest
    steps:
      - uses: actions/checkout@v4
        with:
          fetch-depth: 0
          persist-credentials: false
      - uses: actions/setup-python@v5
        with:
          python-version: "3.13"
      - run: pip install "calibrary{requirement}"
      - run: calibrary registry check --registry .
      - if: github.event_name == 'pull_request'
        run: calibrary registry check --registry . "$BASE..HEAD"
        env:
          BASE: ${{{{ github.event.pull_request.base.sha }}}}
"""


def scaffold() -> dict[str, bytes]:
    """Return the files of a new registry by path."""
    readme = README.format(example=entry_yaml(example_entry()).decode(), workflow=WORKFLOW)
    return {
        CONFIGURATION_FILE: configuration_yaml(),
        "README.md": readme.encode(),
        DOCUMENT: document("The models of the entries here, as calibrary describes them.").encode(),
        ".gitattributes": ATTRIBUTES + AS_WRITTEN,
        WORKFLOW: CHECK.format(requirement=REQUIREMENT).encode(),
        HOOKS: PRE_COMMIT.format(requirement=REQUIREMENT).encode(),
        OWNERS: CODEOWNERS.format(mark="# ", owner="@your-team").encode(),
        EDITOR: SETTINGS,
        **{f"schema/{name}.schema.json": schemas.text(name) for name in EDITED},
    }


def example_entry() -> Entry:
    """Return an example entry of a fictitious camera."""
    size = (4000, 3000)
    return Entry.of(
        Calibration(
            camera=CameraKey(make="Example", model="Camera One", focal_mm=8.8, image_size=size),
            intrinsics=Intrinsics(fx=2931.4, fy=2930.85, cx=2004.25, cy=1496.1, image_size=size),
            distortion=BrownConrady(k1=-0.021, k2=0.0135, p1=0.0002, p2=-0.0001, k3=-0.004),
            grade=Grade.CALIBRATED,
            quality=Quality(rms_px=0.31, views=42, std={"fx": 0.41, "fy": 0.4, "cx": 0.29, "cy": 0.33}),
            provenance=Provenance(
                kind="calibration-file",
                source="camera-one.xml",
                sha256="0" * 64,
                tool="board calibration 1.0",
                date=date(2026, 1, 31).isoformat(),
                operator="A. Keeper",
            ),
        )
    )
