"""A year of a fleet, by the commands alone: what a registry has to hold for those who fly, measure and answer for it.

Twelve cameras, six of them units of one model; two colleagues, each with a clone; a bare server between them: git's own
over https on this machine, or a folder where openssl or git's http-backend is not installed. Each function
below is a part of the year and goes on where the one before it ended.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.registry.registry import Registry
from tests.cli.registry.fleets import looked_at, xml
from tests.jobs.extract.fleet import picture
from tests.registry.git.backend import is_here, serving_git
from tests.registry.git.repositories import git, seclude
from tests.registry.published.server import serving

UNITS = {f"P4R-{n:02d}": f"0V2LG3H{n:02d}" for n in range(1, 7)}
"""Serial numbers of the units of one model, by what people call them."""
OTHERS = {f"Survey {n}": (4000 + 8 * n, 3000) for n in range(1, 7)}
"""The other cameras, one of each model, and their image sizes."""
P4R = ("--make", "DJI", "--model", "FC6310R")


class Colleague:
    """A person with a clone of the registry, who types commands."""

    def __init__(
        self, name: str, clone: Path, capsys: pytest.CaptureFixture[str], patch: pytest.MonkeyPatch
    ) -> None:
        self.name, self.clone = name, clone
        self._capsys, self._patch = capsys, patch

    def __call__(self, *words: str | Path, code: int = 0) -> str:
        """What a command of the registry says on both streams, its lines joined."""
        for role in ("AUTHOR", "COMMITTER"):
            self._patch.setenv(f"GIT_{role}_NAME", self.name)
            self._patch.setenv(f"GIT_{role}_EMAIL", f"{self.name.lower()}@example.com")
        self._patch.setenv("CALIBRARY_REGISTRY", str(self.clone))
        self._capsys.readouterr()
        got = main(["registry", *map(str, words)])
        said = self._capsys.readouterr()
        assert got == code, (words, said)
        return " ".join((said.out + said.err).split())

    def printed(self, *words: str | Path, code: int = 0) -> Any:
        """The document that a command prints."""
        said = self(*words, "--json", code=code)
        return json.loads(said[said.index("{") :])

    def fx(self, image: str | Path, *more: str) -> float:
        """The focal length that the registry gives for an image or a KEY."""
        found: float = self.printed("resolve", image, *more)["calibration"]["intrinsics"]["fx"]
        return found

    def approve(self, *keys: str) -> None:
        """Approve what was looked at."""
        self("approve", *looked_at(self.clone, *keys), "--reason", "looked at")

    def share(self) -> None:
        """Take what the other has done, and give one's own."""
        self("sync")


@pytest.fixture
def year(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder in which all of it happens."""
    folder = tmp_path_factory.mktemp("year")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        yield folder


@pytest.fixture
def server(year: Path) -> Iterator[str]:
    """The address of the registry that both share."""
    git(year, "init", "--quiet", "--bare", "--initial-branch=main", "server.git")
    git(year / "server.git", "config", "http.receivepack", "true")
    if not is_here():
        yield (year / "server.git").as_uri()
        return
    with serving_git(year, year / "server.pem") as address:
        git(year, "config", "--global", "http.sslCAInfo", str(year / "server.pem"))
        yield f"{address}server.git"


@pytest.fixture
def ada(year: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Colleague:
    """The keeper, who measures lenses."""
    return Colleague("Ada", year / "ada", capsys, monkeypatch)


@pytest.fixture
def ben(year: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Colleague:
    """A pilot, who approves what Ada has measured."""
    return Colleague("Ben", year / "ben", capsys, monkeypatch)


def flown(year: Path, flight: str, unit: str, day: str) -> Path:
    """An image of a unit, taken on a day; the camera writes no K into it."""
    name = f"{unit}_{day.replace(':', '')}.jpg"
    return picture(
        year / flight / name,
        make="DJI",
        model="FC6310R",
        body_serial=UNITS[unit],
        date_time=f"{day} 12:00:00",
    )


def january_the_fleet_is_registered_and_shared(
    year: Path, server: str, ada: Colleague, ben: Colleague
) -> None:
    ada("init", ada.clone)
    rules = ada.clone / "registry.yaml"
    rules.write_text(f'{rules.read_text()}approvals: {{by: ["Ben"]}}\n')
    git(ada.clone, "commit", "--quiet", "-am", "Ben approves")
    ada("approve", "registry.yaml", "--digest", git(ada.clone, "rev-parse", "HEAD:registry.yaml"))
    for n, (label, serial) in enumerate(UNITS.items()):
        file = xml(year / f"{label}.xml", f=3650.0 + n)
        ada("add", file, *P4R, "--serial", serial, "--label", label, "--date", "2025-01-10", "--yes")
    for n, (model, size) in enumerate(OTHERS.items()):
        file = xml(year / f"{model}.xml", f=3000.0 + n, size=size)
        ada("add", file, "--make", "Example", "--model", model, "--date", "2025-01-11", "--yes")
    ada("sync", server)
    ben("init", ben.clone, "--remote", server)
    # One approves all of the fleet in one commit.
    snapshot = Registry.open(ben.clone).snapshot()
    keys = [stored.id for stored in snapshot.proposals()]
    assert len(keys) == 12
    assert "not among those who approve" in ada("approve", *looked_at(ada.clone, keys[0]), code=4)
    ben.approve(*keys)
    ben("sync")
    ada("sync")
    assert "good: 12 entries" in ada("check")
    assert {one["approved"][0]["by"] for one in [ada.printed("show", keys[0])]} == {"Ben"}


def march_each_unit_flies_with_its_own_k(year: Path, ada: Colleague) -> None:
    for n, unit in enumerate(UNITS):
        assert ada.fx(flown(year, "march", unit, "2025:03:05")) == 3650.0 + n
    assert "P4R-03" in ada("list", "P4R-03")
    assert ada.fx("P4R-03") == 3652.0


def april_a_wrong_k_is_stopped(year: Path, ada: Colleague) -> None:
    # The focal length of an image of another size, typed in for this one.
    wrong = xml(year / "wrong.xml", f=36_500.0)
    said = ada("add", wrong, *P4R, "--serial", UNITS["P4R-02"], "--yes", code=1)
    assert "nothing was written" in said
    assert ada.fx("P4R-02") == 3651.0


def may_what_is_proposed_is_not_flown_with(year: Path, ada: Colleague, ben: Colleague) -> None:
    ada(
        "add",
        xml(year / "new.xml", f=3671.5),
        *P4R,
        "--serial",
        UNITS["P4R-01"],
        "--valid-from",
        "2025-05-20",
        "--date",
        "2025-05-18",
        "--yes",
    )
    ada.share()
    ben("sync")
    may = flown(year, "may", "P4R-01", "2025:05:25")
    for colleague in (ada, ben):
        answer = colleague.printed("resolve", may)
        assert answer["calibration"]["intrinsics"]["fx"] == 3650.0
        assert "pending" in colleague("list", "P4R-01")
    ben.approve(ben.printed("show", "P4R-01")["id"])
    ben.share()
    ada("sync")
    assert ada.fx(may) == 3671.5


def june_a_firmware_changes_the_image_and_both_of_them_work_at_once(
    year: Path, ada: Colleague, ben: Colleague
) -> None:
    # Ada measures two units for the new firmware, while Ben labels and tags; neither overwrites the other.
    for label, f in (("P4R-03", 3655.5), ("P4R-04", 3656.5)):
        file = xml(year / f"{label}-fw.xml", f=f)
        ada(
            "add",
            file,
            *P4R,
            "--serial",
            UNITS[label],
            "--firmware-range",
            "02.00..",
            "--date",
            "2025-06-10",
            "--label",
            label,
            "--yes",
        )
    ben("set", "example/survey 1", "+north", "--yes")
    ben("sync")
    ada.share()
    ben("sync")
    proposed = [one.id for one in Registry.open(ben.clone).snapshot().proposals()]
    assert len(proposed) == 2
    ben.approve(*proposed)
    ben.share()
    ada("sync")
    serial = UNITS["P4R-03"]
    known = ("--make", "DJI", "--model", "FC6310R", "--serial", serial, "--image-size", "5472x3648")
    for firmware, fx in (("01.09", 3652.0), ("02.01", 3655.5)):
        answer = ada.printed("resolve", *known, "--firmware", firmware)
        assert answer["calibration"]["intrinsics"]["fx"] == fx
    assert "good" in ada("check", "HEAD~3..HEAD")


def july_a_refused_push_brings_the_server_s_own_words(year: Path, ada: Colleague, ben: Colleague) -> None:
    hook = year / "server.git/hooks/pre-receive"
    hook.parent.mkdir(exist_ok=True)
    hook.write_text("#!/bin/sh\necho 'closed for the inventory until Monday' >&2\nexit 1\n")
    hook.chmod(0o755)
    before = git(year / "server.git", "rev-parse", "main")
    ben("set", "example/survey 2", "+south", "--yes")
    assert "closed for the inventory until Monday" in ben("sync", code=4)
    assert git(year / "server.git", "rev-parse", "main") == before
    hook.unlink()
    ben("sync")
    ada("sync")
    assert Registry.open(ada.clone).commit() == Registry.open(ben.clone).commit()


def august_a_crashed_unit_is_retired_and_says_why(year: Path, ada: Colleague, ben: Colleague) -> None:
    ben("retire", ben.printed("show", "P4R-06")["id"], "--reason", "crashed into the quarry")
    ben.share()
    ada("sync")
    said = ada("audit", flown(year, "august", "P4R-06", "2025:08:03").parent, code=1)
    assert "crashed into the quarry" in said
    ada("resolve", year / "august" / "P4R-06_20250803.jpg", code=4)


def december_last_springs_flight_gets_last_springs_k(year: Path, ada: Colleague) -> None:
    assert ada.fx(year / "march" / "P4R-01_20250305.jpg") == 3650.0
    assert ada.fx(year / "may" / "P4R-01_20250525.jpg") == 3671.5
    # A run is repeated on what it rested on, whatever is approved since.
    flight = flown(year, "lab", "P4R-02", "2025:12:01").parent
    ada("lock", flight, "--out", year / "run.lock")
    ada("add", xml(year / "again.xml", f=3661.0), *P4R, "--serial", UNITS["P4R-02"], "--yes")
    run = [
        "extract",
        str(flight),
        "--registry",
        str(ada.clone),
        "--locked",
        str(year / "run.lock"),
        "--dry-run",
    ]
    assert main([*run, "--quiet"]) == 0


def the_nightly_audit_tells_only_what_has_to_be_done(year: Path, ada: Colleague) -> None:
    # As cron starts it: no terminal, an exit code, a document.
    findings = ada.printed("audit", year / "march", code=1)["findings"]
    # What flew is in order but for the unit that is retired; the rest did not fly in March, and one K waits.
    assert {one["rule"] for one in findings} == {"retired in use", "not flown", "another K proposed"}


def machines_ask_over_http_and_get_the_same_answers(year: Path, ada: Colleague) -> None:
    ada("publish", year / "public")
    with serving(year / "public") as server:
        for image, fx in (("march/P4R-02_20250305.jpg", 3651.0), ("may/P4R-01_20250525.jpg", 3671.5)):
            assert ada.fx(year / image, "--registry", server.url) == fx


def the_year_is_told_by_git(ada: Colleague, ben: Colleague) -> None:
    ada.share()
    ben("sync")
    story = ada.printed("log", ada.printed("show", "P4R-01")["id"])["revisions"]
    assert [one["author"] for one in story[:2]] == ["Ben", "Ben"]
    assert git(ada.clone, "fsck", "--full") == ""
    assert Registry.open(ada.clone).commit() == Registry.open(ben.clone).commit()


YEAR = (
    january_the_fleet_is_registered_and_shared,
    march_each_unit_flies_with_its_own_k,
    april_a_wrong_k_is_stopped,
    may_what_is_proposed_is_not_flown_with,
    june_a_firmware_changes_the_image_and_both_of_them_work_at_once,
    july_a_refused_push_brings_the_server_s_own_words,
    august_a_crashed_unit_is_retired_and_says_why,
    december_last_springs_flight_gets_last_springs_k,
    the_nightly_audit_tells_only_what_has_to_be_done,
    machines_ask_over_http_and_get_the_same_answers,
    the_year_is_told_by_git,
)


@pytest.mark.thorough
def test_a_year_of_a_fleet(year: Path, server: str, ada: Colleague, ben: Colleague) -> None:
    """One test, because each part goes on where the one before it ended, and tests are shared out among workers."""
    people: dict[str, Any] = {"year": year, "server": server, "ada": ada, "ben": ben}
    for part in YEAR:
        part(**{name: people[name] for name in signature(part).parameters})
