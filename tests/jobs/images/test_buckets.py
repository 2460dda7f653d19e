"""Images in a bucket of a real S3 server on this machine."""

from __future__ import annotations

import io
import json
import os
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.extract.report import encode
from calibrary.jobs.extract.run import run
from calibrary.jobs.images import buckets, ranged
from calibrary.jobs.images.buckets import bucket, options
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.ranged import FIRST, StoreError
from calibrary.records import to_json
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture
from tests.jobs.images.servers import moto

PLAIN = {"client_options": {"allow_http": True}}
SECRET = "geheimes-passwort"  # noqa: S105  of a server of our own


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    pytest.importorskip("obstore")
    pytest.importorskip("moto")
    with moto() as url:
        yield url


@pytest.fixture(scope="module")
def flight(server: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    for number in range(9):
        tags = P4R if number % 3 else NOBODY
        picture(folder / f"100/{number:02}.jpg", dewarp=DEWARP if number % 2 else None, **tags)
    (folder / "100/broken.jpg").write_bytes(b"no image")
    made = urllib.request.Request(f"{server}/box", method="PUT")  # noqa: S310  http
    urllib.request.urlopen(made).close()  # noqa: S310  http
    for path in folder.rglob("*.jpg"):
        put(server, f"fleet/{path.relative_to(folder).as_posix()}", path.read_bytes())
    for name in ("fleet/notes.txt", "fleet/.thumbs/a.jpg", "fleets/other.jpg"):
        put(server, name, b"no image")
    return folder


def put(server: str, key: str, data: bytes) -> None:
    from_url = pytest.importorskip("obstore.store").from_url
    keys = {"access_key_id": "a", "secret_access_key": "b", "region": "us-east-1"}
    store = from_url("s3://box", endpoint=server, client_options={"allow_http": True}, **keys)
    store.put(key, data)


@pytest.fixture(autouse=True)
def environment(server: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Credentials and address as the AWS programs take them."""
    for name, value in {
        "AWS_ENDPOINT_URL": server,
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "AKIAGEHEIM",
        "AWS_SECRET_ACCESS_KEY": SECRET,
    }.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(ranged, "WAITS_S", (0.0,))
    bucket.cache_clear()
    yield
    bucket.cache_clear()


def test_a_prefix_is_a_folder_and_its_report_that_of_the_same_files_here(flight: Path) -> None:
    far, near = run("s3://box/fleet/"), gate(flight, recursive=True)
    assert encode(to_json(far)) == encode(to_json(near))
    assert far.images == 10


@pytest.mark.usefixtures("flight")
def test_one_object_or_a_list_of_them_is_read() -> None:
    assert run("s3://box/fleet/100/01.jpg").images == 1
    lines = ["s3://box/fleet/100/01.jpg", "s3://box/fleet/", "s3://box/fleet/100/01.jpg"]
    outcome = run(lines=lines)
    assert outcome.images == 10
    assert outcome.judged[0].camera.names[0].startswith("s3://box/fleet/100/")


@pytest.mark.usefixtures("flight")
def test_the_command_reads_a_bucket(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["extract", "s3://box/fleet/", "--dry-run", "--json"]) == 1
    printed = capsys.readouterr()
    report = json.loads(printed.out)
    assert (report["images"], [row["file"] for row in report["rejected"]]) == (10, ["100/broken.jpg"])
    assert SECRET not in printed.out + printed.err
    assert "AKIA" not in printed.out + printed.err


@pytest.mark.usefixtures("flight")
def test_what_is_not_there_is_told() -> None:
    outcome = run(lines=["s3://box/fleet/100/77.jpg", "s3://box/fleet/100/01.jpg"])
    assert [(row.name, row.reason) for row in outcome.rejected] == [
        ("s3://box/fleet/100/77.jpg", "is not there (404)")
    ]
    with pytest.raises(InputError, match=r"contains no images \(.*\)$"):
        run("s3://box/nothing/")
    with pytest.raises(InputError, match="cannot be listed"):
        Listing(["s3://no-such-bucket/fleet/"], recursive=True)


@pytest.mark.usefixtures("flight")
def test_an_object_that_was_changed_is_not_mixed_with_what_it_was(server: str) -> None:
    put(server, "long.jpg", bytes(1 << 18))
    store = bucket("s3", "box")
    first = store.first("long.jpg", FIRST)
    assert (len(first.data), first.size) == (FIRST, 1 << 18)
    assert store.part("long.jpg", FIRST, FIRST + 10, first.version) == bytes(10)
    put(server, "long.jpg", b"\1" * (1 << 18))
    with pytest.raises(StoreError, match="changed while"):
        store.part("long.jpg", FIRST, FIRST + 10, first.version)


def test_a_store_that_does_not_answer_is_told_without_its_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://user:geheim@127.0.0.1:9")
    outcome = run("s3://box/a.jpg")
    [row] = outcome.rejected
    assert row.reason == "the store's server cannot be reached"
    assert "geheim" not in row.reason
    assert {"s3", "gs", "az"} <= buckets.OBSTORE


def test_a_zip_file_in_a_bucket_is_read_like_its_folder(server: str, flight: Path) -> None:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for path in sorted(flight.rglob("*.jpg")):
            archive.write(path, path.relative_to(flight))
    put(server, "zipped/day.zip", made.getvalue())
    far, near = run("s3://box/zipped/day.zip"), gate(flight, recursive=True)
    assert encode(to_json(far)) == encode(to_json(near))


@pytest.fixture
def aws_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """No keys in the environment, and profiles in files."""
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "credentials"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "config"))
    (tmp_path / "credentials").write_text(
        f"[default]\naws_access_key_id = AKIADEFAULT\naws_secret_access_key = {SECRET}\n"
        f"[survey]\naws_access_key_id = AKIASURVEY\naws_secret_access_key = a%b{SECRET}\naws_session_token = t\n"
    )
    (tmp_path / "config").write_text(
        "[default]\nregion = eu-west-1\n[profile survey]\nregion = us-east-1\nendpoint_url = http://127.0.0.1:9\n"
        "[profile single-sign-on]\nsso_session = corp\n"
    )
    return tmp_path


@pytest.mark.usefixtures("aws_files")
def test_a_profile_gives_the_keys_that_the_environment_lacks(
    server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert options() == {
        "access_key_id": "AKIADEFAULT",
        "secret_access_key": SECRET,
        "region": "eu-west-1",
        **PLAIN,
    }
    monkeypatch.setenv("AWS_PROFILE", "survey")
    # The endpoint of the profile leads nowhere; that of the environment comes before it.
    assert options() == {
        "access_key_id": "AKIASURVEY",
        "secret_access_key": f"a%b{SECRET}",
        "session_token": "t",
        "region": "us-east-1",
        **PLAIN,
    }
    assert "AWS_ENDPOINT_URL" in os.environ
    put(server, "profile/notes.txt", b"of a profile")
    assert bucket("s3", "box").first("profile/notes.txt", 4).data == b"of a"
    # Keys in the environment come before the profile's; region and address are looked for by themselves.
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "AKIAGEHEIM")
    assert options() == {"region": "us-east-1", **PLAIN}
    monkeypatch.delenv("AWS_ENDPOINT_URL")
    assert options() == {"region": "us-east-1", "endpoint": "http://127.0.0.1:9", **PLAIN}
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", "https://store.example")
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    assert options() == {}


@pytest.mark.parametrize("name", ["single-sign-on", "not-there"])
@pytest.mark.usefixtures("aws_files")
def test_a_profile_without_keys_is_told_with_what_exports_them(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AWS_PROFILE", name)
    assert main(["extract", "s3://box/fleet/", "--dry-run"]) == 3
    told = " ".join(capsys.readouterr().err.split())
    assert f"aws configure export-credentials --profile {name} --format env" in told


def test_files_of_profiles_that_are_none_are_named(aws_files: Path) -> None:
    (aws_files / "credentials").write_text("no section\n")
    with pytest.raises(StoreError, match="credentials cannot be read as a file of AWS profiles"):
        options()
