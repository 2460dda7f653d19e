"""A registry in which two of three people with keys approve, what is done to it, and what every reader answers."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.errors import CalibraryError, RegistryError
from calibrary.jobs.extract import extract
from calibrary.jobs.fleet import Fleet
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.writing import FileChange, Person
from calibrary.registry.init import init
from calibrary.registry.locking import locked
from calibrary.registry.proposals import message_of, write_changes
from calibrary.registry.registry import Registry
from calibrary.registry.sshsig import Signer
from calibrary.registry.statements import (
    NAMESPACE,
    Body,
    approved_of,
    encoded,
    statement_bytes,
    statement_path,
    subject_of,
)
from calibrary.registry.stating import Action, state_rules, stated
from tests.jobs.extract.fleet import picture
from tests.registry.entries import a_change, an_entry
from tests.registry.git.repositories import git

PEOPLE: Final = ("ada", "bob", "cy")
EVIL: Final = 500.0
"""What an attack adds to fx."""
REFUSED: Final = "refused"
Answer = float | None | Literal["refused"]


def keys_in(folder: Path) -> Path:
    """Make the keys of three people and of a stranger."""
    for name in (*PEOPLE, "eve"):
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(folder / name)]
        subprocess.run(command, check=True)
    return folder


def rules_yaml(keys: Path, rest: str, people: Sequence[str] = PEOPLE) -> str:
    lines = [
        f'  - {{name: "{name}", keys: ["{(keys / f"{name}.pub").read_text().strip()}"]}}\n' for name in people
    ]
    return f"people:\n{''.join(lines)}{rest}"


class Desk(Struct, frozen=True):
    """The registry, and the keys of all people.

    Attributes:
        fleet: folder of the registry.
        keys: folder of the keys.
    """

    fleet: Path
    keys: Path

    def by(self, who: str) -> Registry:
        """The registry as a person opens it."""
        git(self.fleet, "config", "user.signingkey", str(self.keys / who))
        return Registry.open(self.fleet, durable=False)

    def states(self, who: str, *acts: tuple[Action, Entry], files: bool = True, **more: Any) -> None:
        """A person states something of entries, and writes their files."""
        registry = self.by(who)
        done = [a_change(what, replace(one, reason="looked at"), **more) for what, one in acts]
        found = stated(registry.snapshot(), done, author=Person(name=who, email=f"{who}@example.com"))
        there = registry.snapshot().cameras
        written = {
            one.path: FileChange(path=one.path, data=entry_yaml(one), base=there.get(one.path))
            for _, one in acts
        }
        write_changes(registry.repo, [*(written.values() if files else ()), *found.changes], message_of(who))

    def approves(self, *entries: Entry, who: Sequence[str] = ("ada", "bob")) -> None:
        """People approve entries, one after the other."""
        for one in who:
            self.states(one, *(("approve", entry) for entry in entries))

    def asks(self, rest: str, *who: str, people: Sequence[str] = PEOPLE) -> None:
        """Rules are written into registry.yaml, and some people approve them."""
        file = self.fleet / "registry.yaml"
        file.write_text(
            file.read_text().partition("\npeople:")[0].rstrip("\n")
            + "\n"
            + rules_yaml(self.keys, rest, people)
        )
        git(self.fleet, "commit", "-qam", "rules")
        for one in who:
            registry = self.by(one)
            found = state_rules(registry.snapshot(), registry.configuration.rules, None)
            write_changes(registry.repo, found.changes, message_of(one))

    def body(self, entry: Entry, action: str = "approve", **more: Any) -> Body:
        """A statement on an entry as a forger writes it, after all that there is."""
        book = Registry.open(self.fleet).snapshot().book
        found, approves = book.in_force(subject_of(entry.path)), action == "approve"
        members: dict[str, Any] = {
            "action": action,
            "registry": book.rulebook.foundation,
            "subject": subject_of(entry.path),
            "content": approved_of(entry) if approves else None,
            "replaces": tuple(sorted(one.id for one in found.heads())) if approves else (),
            "restores": tuple(sorted(one.id for one in found.ends)) if approves else (),
            "person": "ada",
            "email": "ada@example.com",
            "made": "2026-05-01T10:00:00+00:00",
        }
        return Body(**(members | more))

    def forge(self, body: Body, key: str | None) -> Path:
        """A statement put into the work tree, signed by any key."""
        armored = Signer(str(self.keys / key)).sign(encoded(body), NAMESPACE) if key is not None else ""
        file = self.fleet / statement_path(body)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(statement_bytes(body, armored))
        return file

    def statements(self, entry: Entry, action: str | None = None) -> list[Path]:
        """The statements on an entry, by the names of their people."""
        folder = self.fleet / "events" / entry.path.removesuffix(".yaml")
        found = list(folder.iterdir()) if folder.is_dir() else []
        of = (action or "",) if action else ("approve", "retire")
        return sorted(file for file in found if any(f"-{one}-" in file.name for one in of))

    def put(self, entry: Entry, path: str | None = None) -> None:
        """An entry's file, written by hand."""
        file = self.fleet / (path or entry.path)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(entry_yaml(entry))

    def commit(self) -> None:
        """All that lies there, by plain git."""
        git(self.fleet, "add", "-A")
        git(self.fleet, "-c", "user.signingkey=", "commit", "-qm", "by hand")


def camera(number: int, **more: Any) -> Entry:
    """One of the cameras."""
    size = (4000, 3000)
    return an_entry(
        make="Example",
        model=f"M{number:02}",
        focal_mm=None,
        size=size,
        fx=3000.0 + number,
        distortion=None,
        **more,
    )


def with_fx(entry: Entry, more: float = EVIL, **fields: Any) -> Entry:
    """The same camera with another K."""
    K = entry.calibration.intrinsics
    K = replace(K, fx=K.fx + more, fy=K.fy + more)
    return replace(entry, calibration=replace(entry.calibration, intrinsics=K), **fields)


def founded(folder: Path, keys: Path) -> Desk:
    """A registry with the rules: two of three people, each with a key."""
    desk = Desk(init(folder).place, keys)
    desk.asks("approvals: {count: 2}\n", "ada")
    return desk


def copied(desk: Desk, to: Path) -> Desk:
    """The same registry at another place, whose readers have seen nothing yet."""
    return Desk(shutil.copytree(desk.fleet, to, symlinks=True), desk.keys)


def pictures(folder: Path, entries: Sequence[Entry]) -> Path:
    """A flight with an image of each camera."""
    folder.mkdir()
    for entry in entries:
        model = entry.calibration.camera.model
        picture(
            folder / f"{model}.jpg",
            (4000, 3000),
            make="Example",
            model=model,
            focal_mm=(24, 1),
            date_time="2026:05:05 09:00:00",
        )
    return folder


def answers(fleet: Path, flight: Path, out: Path) -> dict[str, dict[str, Answer]]:
    """What each reader gives for every model: its fx, None if there is no K to use, or that it is refused."""
    out.mkdir()
    readers: Mapping[str, Callable[[Path, Path, Path], Mapping[str, Answer]]] = {
        "resolve": _resolve,
        "python": _python,
        "show": _show,
        "list": _list,
        "export": _export,
        "lock": _lock,
        "publish": _publish,
        "site": _site,
        "audit": _audit,
        "extract": _extract,
    }
    found: dict[str, dict[str, Answer]] = {}
    for name, read in readers.items():
        try:
            found[name] = dict(read(fleet, flight, out))
        except RegistryError:
            found[name] = {"*": REFUSED}
    return found


def _models(flight: Path) -> list[str]:
    return sorted(file.stem for file in flight.iterdir())


def _resolve(fleet: Path, flight: Path, _: Path) -> dict[str, Answer]:
    found: dict[str, Answer] = {}
    opened = Fleet(fleet)
    for model in _models(flight):
        try:
            K = opened.resolve(flight / f"{model}.jpg").calibration
            found[model] = K.intrinsics.fx if K is not None else None
        except RegistryError:
            found[model] = REFUSED
    return found


def _used(entry: Entry) -> Answer:
    return entry.calibration.intrinsics.fx if entry.is_usable else None


def _model(entry: Entry) -> str:
    return entry.calibration.camera.model or ""


def _python(fleet: Path, _: Path, __: Path) -> dict[str, Answer]:
    snapshot = Fleet(fleet).snapshot
    found: dict[str, Answer] = {}
    for path, entry in snapshot.parsed(sorted(snapshot.paths)):
        if isinstance(entry, Entry):
            found[_model(entry)] = _used(entry)
        else:
            found[path.split("/")[2].upper()] = REFUSED
    return found


def _show(fleet: Path, flight: Path, _: Path) -> dict[str, Answer]:
    found: dict[str, Answer] = {}
    opened = Fleet(fleet)
    for model in _models(flight):
        try:
            found[model] = _used(opened.show(f"example/{model.lower()}").stored.entry)  # type: ignore[union-attr]
        except RegistryError as error:
            found[model] = None if "no such camera" in str(error) or "nearest" in str(error) else REFUSED
    return found


def _list(fleet: Path, _: Path, __: Path) -> dict[str, Answer]:
    listed = Fleet(fleet).listing()
    found: dict[str, Answer] = {
        str(row["camera.model"]): float(str(row["intrinsics.fx"])) if row["status"] == "approved" else None
        for row in listed.chosen.rows
    }
    # A file that cannot be read beside an entry in use takes nothing from it.
    refused: dict[str, Answer] = {str(error).split("/")[2].upper(): REFUSED for error in listed.unreadable}
    return refused | found


def _export(fleet: Path, _: Path, out: Path) -> dict[str, Answer]:
    Fleet(fleet).export(out / "all.csv")
    lines = [line.split(",") for line in (out / "all.csv").read_text().splitlines()]
    at = {name: lines[0].index(name) for name in ("model", "fx")}
    return {line[at["model"]]: float(line[at["fx"]]) for line in lines[1:]}


def _lock(fleet: Path, flight: Path, out: Path) -> dict[str, Answer]:
    opened = Fleet(fleet)
    opened.lock(out=out / "fleet.lock")
    index = locked(opened.snapshot, out / "fleet.lock").index
    keys = {
        model: CameraKey(make="Example", model=model, image_size=(4000, 3000)) for model in _models(flight)
    }
    resolved = {model: index.resolve(key) for model, key in keys.items()}
    return {
        model: one.calibration.intrinsics.fx if one is not None else None for model, one in resolved.items()
    }


def _publish(fleet: Path, _: Path, out: Path) -> dict[str, Answer]:
    Fleet(fleet).publish(out / "public", workers=1)
    files = [json.loads(file.read_text()) for file in (out / "public/data").iterdir()]
    rows = [row for file in files for row in file.get("entries", ())]
    used = [row["entry"] for row in rows if row["status"] == "approved"]
    return {one["camera"]["model"]: one["intrinsics"]["fx"] for one in used}


def _site(fleet: Path, _: Path, out: Path) -> dict[str, Answer]:
    cards = Fleet(fleet).write_site(out / "site", workers=1).cards
    return {
        card.model or card.path.split("/")[2].upper(): REFUSED
        if card.problem is not None
        else card.fx
        if card.status is Status.APPROVED
        else None
        for card in cards
    }


def _audit(fleet: Path, flight: Path, _: Path) -> dict[str, Answer]:
    cameras = Fleet(fleet).audit(flight, workers=1).cameras
    return {
        str(one.camera.model): one.fx
        if one.use.value == "used"
        else REFUSED
        if one.use.value == "unknown"
        else None
        for one in cameras
    }


def _extract(fleet: Path, flight: Path, _: Path) -> dict[str, Answer]:
    found: dict[str, Answer] = {}
    try:
        report = extract([flight], registry=fleet, dry_run=True, workers=1)
    except RegistryError:
        raise
    except CalibraryError:
        return found
    for one in report.judged:
        K = one.calibration
        is_ours = K is not None and one.camera.states[0].known.resolution is not None
        found[str(one.camera.key.model)] = K.intrinsics.fx if K is not None and is_ours else None
    return found
