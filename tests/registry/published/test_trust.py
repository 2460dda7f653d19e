"""What readers of a published registry accept: attacks and accidents on the server, on the way and at the keeper's."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone, tzinfo
from pathlib import Path
from types import SimpleNamespace

import pytest
import tuf.ngclient._internal.trusted_metadata_set as client
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)
from securesystemslib.signer import Signature
from tuf.api.metadata import Metadata, Root

from calibrary.calibration import CameraKey
from calibrary.errors import RegistryError
from calibrary.registry.published import metadata as lists
from calibrary.registry.published import trust
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.read import Published
from tests.registry.entries import an_entry
from tests.registry.published.publications import commit, metadata, nobodys_git, published
from tests.registry.published.server import Answer, Server, serving

__all__ = ["nobodys_git"]

KEY = CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648))
OLD_FX, NEW_FX = 3650.0, 3661.25


def make_key(file: Path) -> Path:
    """A private key of ssh, with its public one beside it."""
    key = Ed25519PrivateKey.generate()
    file.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption()))
    public = key.public_key().public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH)
    file.with_suffix(".pub").write_bytes(public)
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

    def key(self, name: str) -> Path:
        """Somebody's key."""
        if name not in self.keys:
            self.keys[name] = make_key(self.folder / name)
        return self.keys[name]

    def publish(
        self,
        *roots: str,
        key: str | None = "ada",
        threshold: int | None = None,
        only: bool = False,
        **days: int,
    ) -> None:
        """Publish the newer state again."""
        own = self.key(key) if key is not None else None
        published(
            self.folder / "fleet",
            self.served,
            own,
            *map(self.key, roots),
            threshold=threshold,
            only=only,
            **days,
        )

    def serve(self, other: str) -> None:
        """Serve another folder in place of this one."""
        shutil.rmtree(self.served)
        shutil.copytree(self.folder / other, self.served)

    def accept(self, name: str, options: str = "") -> None:
        """Accept somebody's signatures alone."""
        public = self.key(name).with_suffix(".pub").read_text()
        self.signers = self.folder / "signers"
        self.signers.write_text(f"# ours\n{name}@example.com {options} {public}\n")

    def edit(self, role: str, change: Callable[[dict[str, object]], object]) -> None:
        """Change metadata without a key."""
        file = metadata(self.served, role)
        document = json.loads(file.read_bytes())
        change(document)
        file.write_text(json.dumps(document))

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
    commit(folder / "fleet", an_entry(focal_mm=None, fx=OLD_FX))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lists, "datetime", clock(-180))
        published(folder / "fleet", folder / "expired", ada)
        patch.setattr(lists, "datetime", clock(-1))
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
def world(made: Path, tmp_path: Path) -> Iterator[World]:
    folder = tmp_path / "world"
    shutil.copytree(made, folder)
    shutil.copytree(folder / "newer", folder / "served")
    with serving(folder / "served") as server:
        found = World(folder, server, Cache(tmp_path / "seen"))
        found.keys = {"ada": folder / "ada", "eve": folder / "eve"}
        assert found.fx(found.cache) == NEW_FX
        yield found


def sign_by_eve(world: World, role: str) -> None:
    """Replace a signature by another key's."""
    foreign = json.loads(metadata(world.folder / "foreign", role).read_bytes())
    world.edit(role, lambda document: document.update(signatures=foreign["signatures"]))


def steps(*acts: Callable[[World], object]) -> Callable[[World], None]:
    def act(world: World) -> None:
        for one in acts:
            one(world)

    return act


def strip(role: str) -> Callable[[World], None]:
    return lambda world: world.edit(role, lambda document: document.update(signatures=[]))


def old_content(role: str) -> Callable[[World], None]:
    """The old content of a role under the name of the new one."""

    def act(world: World) -> None:
        metadata(world.served, role).write_bytes(metadata(world.folder / "older", role).read_bytes())

    return act


def old_list(world: World) -> None:
    """The old content of the list with the camera under its new name."""
    for file in (world.served / "metadata").glob("*.bin-*.json"):
        for old in (world.folder / "older/metadata").glob(f"*.{file.name.partition('.')[2]}"):
            file.write_bytes(old.read_bytes())


def forge_root(world: World, *, version: int = 2, threshold: int = 1) -> None:
    """A next root that only an attacker signed."""
    shutil.rmtree(world.folder / "forged", ignore_errors=True)
    published(world.folder / "foreign-fleet", world.folder / "forged", world.key("eve"), threshold=threshold)
    document = json.loads((world.folder / "forged/metadata/1.root.json").read_bytes())
    document["signed"]["version"] = version
    (world.served / "metadata/2.root.json").write_text(json.dumps(document))


def tamper(top: str) -> Callable[[World], None]:
    def act(world: World) -> None:
        for file in (world.served / top).rglob("*.json"):
            file.write_bytes(file.read_bytes().replace(b"3661.25", b"9999.99").replace(b"3648", b"3649"))

    return act


def answer(path: str, body: bytes) -> Callable[[World], None]:
    return lambda world: world.server.faults.update({path: [Answer(200, body)] * 8})


def remove(role: str) -> Callable[[World], None]:
    return lambda world: metadata(world.served, role).unlink()


DOWN = "is not signed by the keys"
STAMP = "metadata/timestamp.json"

SEEN: dict[str, tuple[Callable[[World], object], str | float]] = {
    "nothing": (lambda _: None, NEW_FX),
    "everything goes back": (lambda world: world.serve("older"), "older than what was read"),
    "the timestamp goes back": (old_content("timestamp"), "older than what was read"),
    "an expired state comes back": (lambda world: world.serve("expired"), "older than what was read"),
    "the state without a key is served": (lambda world: world.serve("unsigned"), DOWN),
    "a foreign registry": (lambda world: world.serve("foreign"), DOWN),
    "the timestamp has no signature": (strip("timestamp"), DOWN),
    "the timestamp is signed by another": (lambda world: sign_by_eve(world, "timestamp"), DOWN),
    "the timestamp was changed": (
        lambda world: world.edit("timestamp", lambda document: document["signed"].update(version=1 << 40)),  # type: ignore[attr-defined]
        DOWN,
    ),
    "the next root is an attacker's": (forge_root, DOWN),
    "the next root leaves versions out": (
        lambda world: forge_root(world, version=5),
        DOWN,
    ),
    "the timestamp is endless": (answer(STAMP, b"{" + b" " * (50 << 20)), "longer than"),
    "the timestamp is nested deeply": (answer(STAMP, b'{"signed":' * 1600), "damaged"),
    "the keeper publishes again": (lambda world: world.publish(), NEW_FX),
    "the keeper lost the folder": (
        steps(lambda world: shutil.rmtree(world.served), lambda world: world.publish()),
        NEW_FX,
    ),
    "another key for every day, by the root's": (
        lambda world: world.publish("ada", key="ci"),
        NEW_FX,
    ),
    "the root's key handed over, then removed": (
        steps(
            lambda world: world.publish("ada", "bo", key="ci"), lambda world: world.publish("bo", key="ci")
        ),
        NEW_FX,
    ),
    "two keys of three for a root": (
        steps(
            lambda world: world.publish("ada", "bo", "cy", key="ci", threshold=2),
            lambda world: world.publish("bo", "cy", key="next"),
        ),
        NEW_FX,
    ),
}
"""What happens after a reader has seen the newer state, and what he gets: K, or the reason why not."""

FRESH: dict[str, tuple[Callable[[World], object], str | float]] = {
    "trust on first use": (lambda _: None, NEW_FX),
    "a state that has expired": (lambda world: world.serve("expired"), "has expired"),
    "the snapshot goes back": (old_content("snapshot"), "older than what|damaged"),
    "a list goes back": (old_list, "older than what|damaged"),
    "the snapshot is missing": (remove("snapshot"), "snapshot.json: the server answers 404"),
    "the snapshot has no signature": (strip("snapshot"), DOWN),
    "the targets have no signature": (strip("targets"), DOWN),
    "the root has no signature": (strip("root"), DOWN),
    "the snapshot is signed by another": (lambda world: sign_by_eve(world, "snapshot"), DOWN),
    "the targets are signed by another": (lambda world: sign_by_eve(world, "targets"), DOWN),
    "a camera's file was changed": (tamper("models"), "damaged on the server or on the way"),
    "an entry was changed": (tamper("entries"), "damaged on the server or on the way"),
    "the accepted signer": (lambda world: world.accept("ada"), NEW_FX),
    "the accepted signer, for publications": (
        lambda world: world.accept("ada", 'namespaces="git,calibrary-published"'),
        NEW_FX,
    ),
    "the accepted signer, for something else": (
        lambda world: world.accept("ada", 'namespaces="git"'),
        "not signed by a key in",
    ),
    "a signer who is not accepted": (lambda world: world.accept("eve"), "not signed by a key in"),
    "no key where signers are named": (
        steps(lambda world: world.accept("ada"), lambda world: world.serve("unsigned")),
        "not signed by a key in",
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


def test_without_a_key_nobody_goes_back_either(world: World, tmp_path: Path) -> None:
    world.serve("unsigned")
    cache = Cache(tmp_path / "fresh")
    assert world.fx(cache) == NEW_FX
    world.serve("unsigned-older")
    check(world, cache, "older than what was read")


def test_who_begins_to_sign_takes_his_readers_along_and_not_back(world: World, tmp_path: Path) -> None:
    world.serve("unsigned")
    cache = Cache(tmp_path / "fresh")
    assert world.fx(cache) == NEW_FX
    world.publish()
    assert world.fx(cache) == NEW_FX
    with pytest.raises(RegistryError, match="was signed before"):
        world.publish(key=None)
    world.serve("unsigned")
    check(world, cache, DOWN)


def test_a_copy_on_a_stick_is_held_to_the_same_rules(world: World, tmp_path: Path) -> None:
    for folder, expected in (("newer", NEW_FX), ("expired", "has expired"), ("older", OLD_FX)):
        stick = tmp_path / "stick"
        shutil.rmtree(stick, ignore_errors=True)
        shutil.copytree(world.folder / folder, stick)
        world.server.url = str(stick)
        check(world, Cache(tmp_path / folder), expected)
    check(world, Cache(tmp_path / "newer"), "older than what was read")


def test_offline_the_last_state_serves_until_it_expires(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    world.server.faults = dict.fromkeys(("metadata/2.root.json", STAMP), [Answer(503)] * 8)
    assert world.fx(world.cache) == NEW_FX

    monkeypatch.setattr(client, "datetime", SimpleNamespace(datetime=clock(91), timezone=timezone))
    check(world, world.cache, "has expired")


def forge(world: World, how: str) -> None:
    """A registry of an attacker that claims an accepted key without having its private half."""
    document = json.loads(metadata(world.folder / "foreign", "root").read_bytes())
    ada = json.loads(metadata(world.folder / "newer", "root").read_bytes())["signed"]
    [own], [known] = (one["roles"]["root"]["keyids"] for one in (document["signed"], ada))
    if how == "listed beside":
        document["signed"]["roles"]["root"]["keyids"].append(known)
        document["signed"]["keys"][known] = ada["keys"][known]
    else:
        document["signed"]["keys"][known] = document["signed"]["keys"].pop(own)
        for role in document["signed"]["roles"].values():
            role["keyids"] = [known]
    root: Metadata[Root] = Metadata(Root.from_dict(document["signed"]))
    eve = lists.signers(lists.Signing(key=world.key("eve"))).online
    signature = root.sign(eve)
    if how != "listed beside":
        root.signatures = {known: Signature(known, signature.signature)}
    world.serve("foreign")
    (world.served / "metadata/1.root.json").write_bytes(root.to_bytes())


@pytest.mark.parametrize("how", ["listed beside", "by its id"])
def test_an_accepted_key_that_is_only_named_has_not_signed(world: World, tmp_path: Path, how: str) -> None:
    world.accept("ada")
    forge(world, how)
    check(world, Cache(tmp_path / "fresh"), "not signed by a key in")


def test_who_was_refused_for_his_signers_is_not_trusted_afterwards(world: World, tmp_path: Path) -> None:
    cache = Cache(tmp_path / "fresh")
    world.serve("foreign")
    world.accept("ada")
    check(world, cache, "not signed by a key in")
    world.serve("newer")
    assert world.fx(cache) == NEW_FX


@pytest.mark.parametrize("sizes", [(30, 5), (5, 30), (60, 40)])
def test_a_registry_may_grow_and_shrink_under_its_readers(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sizes: tuple[int, int]
) -> None:
    monkeypatch.setattr(lists, "BIN", 1)
    fleet, cache = tmp_path / "fleet", Cache(tmp_path / "fresh")
    for size, more in zip(sizes, (0, 1), strict=True):
        there = {one.relative_to(fleet).as_posix() for one in fleet.glob("cameras/**/*.yaml")}
        models = [
            an_entry(focal_mm=None, fx=NEW_FX),
            *(an_entry(model=f"M {at}") for at in range(size + more)),
        ]
        gone = dict.fromkeys(there - {one.path for one in models})
        commit(fleet, *models, raw=gone)
        published(fleet, world.served, world.key("ada"))
        assert world.fx(cache) == NEW_FX


def test_a_reader_whose_timestamp_comes_from_a_cache_on_the_way_is_served(
    world: World, tmp_path: Path
) -> None:
    stamp = (world.served / STAMP).read_bytes()
    commit(world.folder / "fleet", an_entry(focal_mm=None, fx=3662.5), an_entry(model="NEW"))
    world.publish()
    world.server.faults[STAMP] = [Answer(200, stamp)] * 8
    registry = Published(world.server.url, cache=Cache(tmp_path / "fresh"))
    assert registry.state.entries == 1


def test_a_first_root_that_was_cut_short_names_what_to_remove(world: World) -> None:
    kept = world.cache.trusted(world.server.url) / "first.json"
    kept.write_bytes(kept.read_bytes()[:100])
    check(world, world.cache, f"{kept.parent}, and .* trusted anew")


def test_a_cache_that_may_not_be_written_still_holds_what_is_trusted(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calibrary.registry.published.trust._locked", unlocked(world))
    [warning] = Published(world.server.url, cache=world.cache).warnings
    assert "a later run would not notice" in warning
    world.serve("older")
    check(world, world.cache, "older than what was read")


def unlocked(world: World) -> Callable[[Path], object]:
    """A lock that only a temporary folder gives."""
    real = trust._locked

    def act(folder: Path) -> object:
        if world.cache.folder in folder.parents:
            raise OSError("read-only")
        return real(folder)

    return act


class TestKeeper:
    def test_the_key_that_anyone_has_is_of_no_registry_so_that_one_founded_anew_goes_on(
        self, world: World, tmp_path: Path
    ) -> None:
        world.serve("unsigned")
        cache = Cache(tmp_path / "fresh")
        assert world.fx(cache) == NEW_FX
        published(world.folder / "foreign-fleet", world.served)
        assert world.fx(cache) == 9999.0

    def test_with_its_root_keys_away_it_goes_on_until_the_root_ends(
        self, world: World, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        world.publish("safe", "ada", key="daily", only=True)
        monkeypatch.setattr(lists, "datetime", clock(300))
        world.publish(key="daily")
        root = json.loads(metadata(world.served, "root").read_bytes())["signed"]
        assert json.loads((world.served / STAMP).read_bytes())["signed"]["expires"] == root["expires"]
        monkeypatch.setattr(lists, "datetime", clock(400))
        with pytest.raises(RegistryError, match="renewed by"):
            world.publish(key="daily")

    def test_a_shorter_validity_takes_effect_at_once(self, world: World) -> None:
        before = (world.served / STAMP).read_bytes()
        world.publish(valid_days=7)
        assert (world.served / STAMP).read_bytes() != before

    def test_a_state_is_renewed_before_it_expires_and_else_stays(
        self, world: World, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        before = (world.served / STAMP).read_bytes()
        world.publish()
        assert (world.served / STAMP).read_bytes() == before

        monkeypatch.setattr(lists, "datetime", clock(50))
        world.publish()
        assert (world.served / STAMP).read_bytes() != before
        assert world.fx(world.cache) == NEW_FX

    def test_keys_are_replaced_by_those_who_may(self, world: World) -> None:
        with pytest.raises(RegistryError, match=r"1 more of ed25519 .*: name them as root keys"):
            world.publish(key="eve")
        world.publish("ada", "bo", key="ci", threshold=2)
        with pytest.raises(RegistryError, match="name more root keys"):
            world.publish("bo", key="eve", threshold=4)
        with pytest.raises(RegistryError, match="1 more of ed25519"):
            world.publish("bo", key="eve")
        world.publish("bo", "ada", key="next")
        root = json.loads(metadata(world.served, "root").read_bytes())["signed"]["roles"]["root"]
        assert (len(root["keyids"]), root["threshold"]) == (2, 2)
        world.publish(key="next")
        assert world.fx(world.cache) == NEW_FX

    def test_a_key_that_cannot_sign_is_one_line(self, world: World) -> None:
        locked = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "secret", "-f", str(world.folder / "locked")]
        if shutil.which("ssh-keygen") is not None:
            subprocess.run(locked, check=True)
        (world.folder / "none").write_text("-----BEGIN NOTHING-----")
        for name, expected in (
            ("locked", "passphrase"),
            ("none", "is not a private key"),
            ("gone", "No such"),
        ):
            world.keys[name] = world.folder / name
            with pytest.raises(RegistryError, match=expected) as raised:
                world.publish(key=name)
            assert "\n" not in str(raised.value)

    def test_a_key_that_ssh_keygen_made_serves(self, world: World) -> None:
        if shutil.which("ssh-keygen") is None:
            pytest.skip("ssh-keygen is not installed")
        for kind in ("ed25519", "ecdsa", "rsa"):
            key = world.folder / kind
            subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", "", "-f", str(key)], check=True)
            published(world.folder / "fleet", world.folder / f"by-{kind}", key)
            world.keys[kind] = key
            world.serve(f"by-{kind}")
            world.accept(kind)
            assert world.fx(Cache(world.folder / f"cache-{kind}")) == NEW_FX

    def test_a_damaged_root_is_not_replaced_by_one_that_nobody_accepts(self, world: World) -> None:
        (world.served / "metadata/1.root.json").write_bytes(b"{")
        with pytest.raises(RegistryError, match="restore it"):
            world.publish()


def test_what_is_trusted_is_trusted_at_its_address_alone(world: World) -> None:
    world.serve("foreign")
    with serving(world.served) as other:
        found = Published(other.url, cache=world.cache).index_for(KEY).resolve(KEY)
    assert found is not None
    assert found.calibration.intrinsics.fx == 9999.0
