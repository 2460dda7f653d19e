"""What readers of a published registry accept: attacks and accidents on the server, on the way and at the keeper's."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import CameraKey
from calibrary.errors import RegistryError
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published import manifest as trust
from calibrary.registry.published import read, write
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.read import Published
from calibrary.registry.sshsig import Signer
from tests.registry.entries import an_entry
from tests.registry.published.publications import camera, commit, document, manifest, nobodys_git, published
from tests.registry.published.server import Answer, Server, serving

__all__ = ["nobodys_git"]

KEY = CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648))
P4R, OTHER = "dji/fc6310r", "dji/other"
OLD_FX, NEW_FX, OTHER_FX = 3650.0, 3661.25, 1234.5


def make_key(file: Path, *, kind: str = "ed25519", passphrase: str = "") -> Path:
    """A private key of ssh, with its public one beside it."""
    command = ["ssh-keygen", "-q", "-t", kind, "-N", passphrase, "-f", str(file)]
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL)
    return file


@dataclass(slots=True)
class World:
    """A registry in two states, each published; the newer one is served.

    Attributes:
        folder: that everything is in.
        server: of ``served/``.
        signers: accepted signers of the readers.
        cache: of a reader who has seen the newer state.
    """

    folder: Path
    server: Server
    cache: Cache
    signers: Path | None = None
    keys: dict[str, Path] = field(default_factory=dict)

    @property
    def served(self) -> Path:
        return self.folder / "served"

    @property
    def file(self) -> Path:
        """The manifest that is served."""
        return self.served / PUBLISHED_FILE

    def key(self, name: str) -> Path:
        """Somebody's key."""
        if name not in self.keys:
            self.keys[name] = make_key(self.folder / name)
        return self.keys[name]

    def publish(self, *, key: str | None = "ada", valid_days: int = 90) -> None:
        """Publish the newer state again."""
        own = self.key(key) if key is not None else None
        published(self.folder / "fleet", self.served, own, valid_days=valid_days)

    def serve(self, other: str) -> None:
        """Serve another folder in place of this one."""
        shutil.rmtree(self.served)
        shutil.copytree(self.folder / other, self.served)

    def accept(self, *names: str, options: str = "") -> None:
        """Accept the signatures of some alone."""
        self.signers = self.folder / "signers"
        public = [self.key(name).with_suffix(".pub").read_text() for name in names]
        self.signers.write_text("# ours\n" + "".join(f"us@example.com {options} {one}" for one in public))

    def edit(self, change: Callable[[dict[str, Any]], object]) -> None:
        """Change the manifest without a key."""
        whole = document(self.served, PUBLISHED_FILE)
        change(whole)
        self.file.write_text(json.dumps(whole, separators=(",", ":")))

    def answer(self, path: str, body: bytes) -> None:
        """Answer something else in place of a file."""
        self.server.faults[path] = [Answer(200, body)] * 8

    def fx(self, cache: Cache) -> float:
        registry = Published(self.server.url, cache=cache, signers=self.signers)
        found = registry.index_for(KEY).resolve(KEY)
        assert found is not None
        return found.calibration.intrinsics.fx


def clock(days: int) -> type[datetime]:
    """The clock of another day."""

    class Clock(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
            return datetime.now(tz) + timedelta(days=days)

    return Clock


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The two states, by one key; a foreign registry; the old state expired; one without a key."""
    folder = tmp_path_factory.mktemp("made")
    ada = make_key(folder / "ada")
    commit(folder / "fleet", an_entry(focal_mm=None, fx=OLD_FX), an_entry(model="OTHER", fx=OTHER_FX))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(write, "datetime", clock(-180))
        published(folder / "fleet", folder / "expired", ada)
        patch.setattr(write, "datetime", clock(-1))
        published(folder / "fleet", folder / "older", ada)
        published(folder / "fleet", folder / "unsigned-older")
    commit(folder / "fleet", an_entry(focal_mm=None, fx=NEW_FX))
    shutil.copytree(folder / "older", folder / "newer")
    published(folder / "fleet", folder / "newer", ada)
    published(folder / "fleet", folder / "unsigned")
    commit(folder / "foreign-fleet", an_entry(focal_mm=None, fx=9999.0))
    published(folder / "foreign-fleet", folder / "foreign", make_key(folder / "eve"))
    return folder


@pytest.fixture
def world(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setattr(read, "PAUSES_S", (0.0, 0.0, 0.0))
    folder = tmp_path / "world"
    shutil.copytree(made, folder)
    shutil.copytree(folder / "newer", folder / "served")
    with serving(folder / "served") as server:
        found = World(folder, server, Cache(tmp_path / "seen"))
        found.keys = {"ada": folder / "ada", "eve": folder / "eve"}
        assert found.fx(found.cache) == NEW_FX
        yield found


def signature_of(folder: Path) -> str:
    return str(document(folder, PUBLISHED_FILE)["signature"])


def relist(world: World) -> None:
    """The newer manifest leads to the list of the older state, which the attacker has kept."""
    old = world.folder / "older"
    (world.served / f"data/{manifest(world.served)['cameras']}.json").write_bytes(
        (old / f"data/{manifest(old)['cameras']}.json").read_bytes()
    )


def swap(world: World) -> None:
    """The file of another camera in place of this one's."""
    camera(world.served, P4R).write_bytes(camera(world.served, OTHER).read_bytes())


def roll_back_one(world: World) -> None:
    """The former file of a camera under the name of the new one."""
    camera(world.served, P4R).write_bytes(camera(world.folder / "older", P4R).read_bytes())


def tamper(world: World) -> None:
    file = camera(world.served, P4R)
    file.write_bytes(file.read_bytes().replace(b"3661.25", b"3999.25"))


def resign(world: World) -> None:
    """Everything by an attacker's own key, under a newer version."""
    world.file.unlink()
    world.publish(key="eve")


def steps(*acts: Callable[[World], object]) -> Callable[[World], None]:
    def act(world: World) -> None:
        for one in acts:
            one(world)

    return act


def later(member: str, value: object) -> Callable[[World], None]:
    """A member of the manifest changed, under the signature of the former one."""
    return lambda world: world.edit(lambda whole: whole["manifest"].update({member: value}))


BY_NOBODY, BY_OTHERS, BROKEN, DAMAGED, NONE, OLDER, EXPIRED = (
    "is not signed, and was signed by SHA256:",
    "is signed by SHA256:.* and was signed by SHA256:",
    "its signature is wrong",
    "damaged on the server or on the way",
    "this is no manifest",
    "is older than what was read",
    "has expired on",
)

SEEN: dict[str, tuple[Callable[[World], object], str | float]] = {
    "nothing": (lambda _: None, NEW_FX),
    "rolled back: everything": (lambda world: world.serve("older"), OLDER),
    "rolled back: the manifest": (
        lambda world: shutil.copy(world.folder / "older" / PUBLISHED_FILE, world.file),
        OLDER,
    ),
    "rolled back: to an expired state": (lambda world: world.serve("expired"), OLDER),
    "unsigned: the state without a key": (lambda world: world.serve("unsigned"), BY_NOBODY),
    "unsigned: the signature is taken away": (
        lambda world: world.edit(lambda whole: whole.update(signature=None)),
        BY_NOBODY,
    ),
    "wrong key: a foreign registry": (lambda world: world.serve("foreign"), BY_OTHERS),
    "wrong key: the same registry, signed by another": (resign, BY_OTHERS),
    "tampered: a signature of other bytes": (
        lambda world: world.edit(
            lambda whole: whole.update(signature=signature_of(world.folder / "foreign"))
        ),
        BROKEN,
    ),
    "tampered: the version": (later("version", 1 << 40), BROKEN),
    "tampered: the last day": (later("until", "2099-01-01T00:00:00Z"), BROKEN),
    "tampered: the list": (later("cameras", "0" * 64), BROKEN),
    "huge: an endless manifest": (
        lambda world: world.answer(PUBLISHED_FILE, b"{" + b" " * (1 << 20)),
        "longer than",
    ),
    "the keeper publishes again": (lambda world: world.publish(), NEW_FX),
    "the keeper lost the folder": (
        steps(lambda world: shutil.rmtree(world.served), lambda world: world.publish()),
        NEW_FX,
    ),
    "a key was replaced, and the reader accepts both": (
        steps(
            lambda world: world.accept("ada", "bo"),
            lambda world: world.file.unlink(),
            lambda world: world.publish(key="bo"),
        ),
        NEW_FX,
    ),
}
"""What happens after a reader has seen the newer state, and what he gets: K, or the reason why not."""

FRESH: dict[str, tuple[Callable[[World], object], str | float]] = {
    "trust on first use": (lambda _: None, NEW_FX),
    "frozen: a state that has expired": (lambda world: world.serve("expired"), EXPIRED),
    "mixed: the list of the former state": (relist, DAMAGED),
    "mixed: the former file of a camera": (roll_back_one, DAMAGED),
    "swapped: the file of another camera": (swap, DAMAGED),
    "tampered: a camera's file": (tamper, DAMAGED),
    "tampered: the manifest": (later("version", 1 << 40), BROKEN),
    "truncated: the manifest": (lambda world: world.file.write_bytes(world.file.read_bytes()[:300]), NONE),
    "truncated: a camera's file": (
        lambda world: camera(world.served, P4R).write_bytes(camera(world.served, P4R).read_bytes()[:100]),
        DAMAGED,
    ),
    "truncated: a camera's file is gone": (
        lambda world: camera(world.served, P4R).unlink(),
        "answers 404.*damaged",
    ),
    "huge: a camera's file": (
        lambda world: camera(world.served, P4R).write_bytes(b" " * (trust.LARGEST_CAMERA + 1)),
        "longer than",
    ),
    "huge: nested deeply": (lambda world: world.answer(PUBLISHED_FILE, b'{"manifest":' * 5000), NONE),
    "unsigned: a last day without a time zone": (
        steps(lambda world: world.serve("unsigned"), later("until", "2099-01-01T00:00:00")),
        NONE,
    ),
    "unsigned: a name that leads out of the folder": (
        steps(lambda world: world.serve("unsigned"), later("cameras", "../../secret")),
        NONE,
    ),
    "wrong key: a signer who is not accepted": (lambda world: world.accept("eve"), "expected a key in"),
    "wrong key: accepted for something else": (
        lambda world: world.accept("ada", options='namespaces="git"'),
        "expected a key in",
    ),
    "unsigned: where signers are named": (
        steps(lambda world: world.accept("ada"), lambda world: world.serve("unsigned")),
        "is not signed, expected a key in",
    ),
    "the accepted signer": (lambda world: world.accept("ada"), NEW_FX),
    "the accepted signer, for publications": (
        lambda world: world.accept("ada", options='namespaces="git,calibrary-published"'),
        NEW_FX,
    ),
    "no file of signers": (lambda world: setattr(world, "signers", world.folder / "none"), "no such file"),
}
"""The same for a reader who has never read this address."""


@pytest.mark.parametrize("case", SEEN)
def test_who_has_read_before_is_not_led_astray(world: World, case: str) -> None:
    act, expected = SEEN[case]
    act(world)
    check(world, world.cache, expected)


@pytest.mark.parametrize("case", FRESH)
def test_who_reads_for_the_first_time(world: World, tmp_path: Path, case: str) -> None:
    act, expected = FRESH[case]
    act(world)
    check(world, Cache(tmp_path / "fresh"), expected)


def check(world: World, cache: Cache, expected: str | float) -> None:
    if isinstance(expected, float):
        assert world.fx(cache) == expected
        return
    for _ in range(2):  # refused today is refused tomorrow
        with pytest.raises(RegistryError, match=expected) as raised:
            world.fx(cache)
        assert "\n" not in str(raised.value)


def test_a_signature_for_another_purpose_is_none_of_a_publication(world: World, tmp_path: Path) -> None:
    signed = world.file.read_bytes().partition(b'"manifest":')[2].partition(b',"signature"')[0]
    own = Signer(str(world.key("ada"))).sign(signed, "git")
    world.edit(lambda whole: whole.update(signature=own))
    check(world, Cache(tmp_path / "fresh"), "its signature is not made for calibrary-published")


def test_without_a_key_nobody_goes_back_either(world: World, tmp_path: Path) -> None:
    world.serve("unsigned")
    cache = Cache(tmp_path / "fresh")
    assert world.fx(cache) == NEW_FX
    world.serve("unsigned-older")
    check(world, cache, OLDER)


def test_who_begins_to_sign_takes_his_readers_along_and_not_back(world: World, tmp_path: Path) -> None:
    world.serve("unsigned")
    cache = Cache(tmp_path / "fresh")
    assert world.fx(cache) == NEW_FX
    world.publish()
    assert world.fx(cache) == NEW_FX
    with pytest.raises(RegistryError, match="was signed by"):
        world.publish(key=None)
    world.serve("unsigned")
    check(world, cache, BY_NOBODY)


def test_a_copy_on_a_stick_is_held_to_the_same_rules(world: World, tmp_path: Path) -> None:
    for folder, expected in (("newer", NEW_FX), ("expired", EXPIRED), ("older", OLD_FX)):
        stick = tmp_path / "stick"
        shutil.rmtree(stick, ignore_errors=True)
        shutil.copytree(world.folder / folder, stick)
        world.server.url = str(stick)
        check(world, Cache(tmp_path / folder), expected)
    check(world, Cache(tmp_path / "newer"), OLDER)


def test_offline_the_last_state_serves_until_it_expires(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.server.faults = {PUBLISHED_FILE: [Answer(503)] * 8}
    assert world.fx(world.cache) == NEW_FX
    monkeypatch.setattr(trust, "datetime", clock(91))
    check(world, world.cache, EXPIRED)


def test_who_was_refused_for_his_signers_is_not_trusted_afterwards(world: World, tmp_path: Path) -> None:
    cache = Cache(tmp_path / "fresh")
    world.serve("foreign")
    world.accept("ada")
    check(world, cache, "expected a key in")
    world.serve("newer")
    assert world.fx(cache) == NEW_FX


def test_a_memory_that_was_cut_short_names_what_to_remove(world: World) -> None:
    kept = world.cache.trusted(world.server.url)
    kept.write_bytes(kept.read_bytes()[:100])
    check(world, world.cache, f"{kept}: is damaged; remove it, and .* trusted anew")


def test_a_cache_that_may_not_be_written_still_holds_what_is_trusted(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError("read-only")

    monkeypatch.setattr(read, "writer_lock", refused)
    [warning] = Published(world.server.url, cache=world.cache).warnings
    assert "a later run would not notice" in warning
    world.serve("older")
    check(world, world.cache, OLDER)


def test_what_another_process_read_meanwhile_is_not_forgotten(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = world.cache.trusted(world.server.url)
    newer = memory.read_bytes()
    memory.unlink()
    world.serve("older")
    real = writer_lock

    def lock(*what: Any, **how: Any) -> object:
        memory.write_bytes(newer)
        return real(*what, **how)

    monkeypatch.setattr(read, "writer_lock", lock)
    assert world.fx(world.cache) == OLD_FX
    assert memory.read_bytes() == newer


class TestKeeper:
    def test_a_registry_founded_anew_goes_on_at_an_address_without_a_key(
        self, world: World, tmp_path: Path
    ) -> None:
        world.serve("unsigned")
        cache = Cache(tmp_path / "fresh")
        assert world.fx(cache) == NEW_FX
        published(world.folder / "foreign-fleet", world.served)
        assert world.fx(cache) == 9999.0

    def test_a_shorter_validity_takes_effect_at_once(self, world: World) -> None:
        before = world.file.read_bytes()
        world.publish(valid_days=7)
        assert world.file.read_bytes() != before

    def test_a_state_is_renewed_before_it_expires_and_else_stays(
        self, world: World, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        before = world.file.read_bytes()
        world.publish()
        assert world.file.read_bytes() == before

        monkeypatch.setattr(write, "datetime", clock(50))
        world.publish()
        assert world.file.read_bytes() != before
        assert world.fx(world.cache) == NEW_FX

    def test_another_key_is_refused_and_nothing_is_written(self, world: World) -> None:
        before = world.file.read_bytes()
        with pytest.raises(RegistryError, match=r"was signed by SHA256.*name that key, or remove"):
            world.publish(key="eve")
        assert world.file.read_bytes() == before

    def test_what_an_attacker_put_into_the_folder_is_not_signed(self, world: World) -> None:
        world.serve("foreign")
        world.file.write_bytes((world.folder / "unsigned" / PUBLISHED_FILE).read_bytes())
        world.edit(
            lambda whole: whole["manifest"].update(cameras=manifest(world.folder / "foreign")["cameras"])
        )
        world.publish()
        assert world.fx(world.cache) == NEW_FX

    def test_a_key_that_cannot_sign_is_one_line(self, world: World, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("SSH_ASKPASS_REQUIRE", "never")
        (world.folder / "none").write_text("-----BEGIN NOTHING-----")
        for name in ("none", "gone"):
            world.keys[name] = world.folder / name
            with pytest.raises(
                RegistryError, match="nothing was written: ssh-keygen does not sign with"
            ) as raised:
                world.publish(key=name)
            assert "\n" not in str(raised.value)

    @pytest.mark.thorough
    @pytest.mark.parametrize("kind", ["ed25519", "ecdsa", "rsa"])
    def test_a_key_of_any_usual_kind_serves(self, world: World, kind: str) -> None:
        world.keys[kind] = make_key(world.folder / kind, kind=kind)
        published(world.folder / "fleet", world.folder / f"by-{kind}", world.key(kind))
        world.serve(f"by-{kind}")
        world.accept(kind)
        assert world.fx(Cache(world.folder / f"cache-{kind}")) == NEW_FX

    def test_a_damaged_manifest_is_written_again(self, world: World) -> None:
        world.file.write_bytes(b"{")
        world.publish()
        assert world.fx(world.cache) == NEW_FX


def test_what_is_trusted_is_trusted_at_its_address_alone(world: World) -> None:
    world.serve("foreign")
    with serving(world.served) as other:
        found = Published(other.url, cache=world.cache).index_for(KEY).resolve(KEY)
    assert found is not None
    assert found.calibration.intrinsics.fx == 9999.0
