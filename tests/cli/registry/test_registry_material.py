"""What contradicts, and what changes an approved K materially: by each command that brings a K into a registry."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from calibrary.jobs.fleet import Fleet
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.validation import Finding
from tests.cli.registry.direct import put, put_bytes
from tests.cli.registry.fleets import CAMERA, P4R, commit_of, held, looked_at, printed, run, xml
from tests.jobs.survey.test_known import LISTED, ODD, entry
from tests.registry.entries import an_entry

REFERENCES: dict[str, tuple[Entry, tuple[Entry, ...], str]] = {
    "catalogue": (entry(36_612.5, {"focal_mm": 8.8}), (), "against-catalogue"),
    "sensor": (entry(24 / 6.2 * 4608, LISTED), (), "against-sensor"),
    "relatives": (
        entry(33_000.0, ODD, serial="aa" * 8),
        (entry(3300.0, ODD, serial="bb" * 8),),
        "against-relatives",
    ),
    "last approved": (entry(3410.0, ODD), (entry(3300.0, ODD),), "against-last-approved"),
}


def proposed(fleet: Path, wrong: Entry) -> tuple[Finding, ...]:
    """As ``add``, ``import`` and ``onboard`` do."""
    return Fleet(fleet).propose_entries(wrong).proposals.findings


def approved(fleet: Path, wrong: Entry) -> tuple[Finding, ...]:
    draft = replace(wrong, status=Status.DRAFT)
    put_bytes(fleet, {wrong.path: entry_yaml(draft)})
    return Fleet(fleet).propose_approval([wrong.id]).proposals.findings


def ranged(fleet: Path, wrong: Entry) -> tuple[Finding, ...]:
    put(fleet, wrong)
    return Fleet(fleet).check("HEAD~1..HEAD").findings


WAYS: dict[str, Callable[[Path, Entry], tuple[Finding, ...]]] = {
    "proposed": proposed,
    "approved": approved,
    "checked": ranged,
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("reference", REFERENCES)
def test_a_contradiction_is_an_error_whoever_it_is_of_and_however_it_comes(
    fleet: Path, reference: str, way: str
) -> None:
    wrong, there, rule = REFERENCES[reference]
    put(fleet, an_entry(model="Another"), *there)
    found = WAYS[way](fleet, wrong)
    [printed] = [one for one in found if one.rule == rule and one.place == wrong.path]
    assert printed.severity.value == "error"
    assert printed.remedy is not None
    assert "--force --reason" in printed.remedy


class TestMaterialChanges:
    """fx within all limits, and yet the map moves: the principal point is 20 px from where it was."""

    @pytest.fixture(autouse=True)
    def moved(self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
        run(capsys, "add", xml(tmp_path / "a.xml"), *CAMERA, "--yes", "--approve")
        assert held(fleet).entry.status is Status.APPROVED
        return xml(tmp_path / "b.xml", f=3675.0, cx=15.5)

    def test_a_proposal_says_by_how_much_and_is_written(
        self, fleet: Path, moved: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        done = printed(capsys, "registry-change-1", "add", moved, *CAMERA, "--yes")
        [shown] = [one for one in done["findings"] if one["rule"] == "material-change"]
        assert (shown["severity"], done["commit"]) == ("warning", commit_of(fleet))
        assert shown["measured"] > shown["limit"]
        assert "px at most over the frame, from 100 m" in shown["message"]
        assert "on the ground" in shown["message"]

    def test_it_is_put_to_use_only_with_a_reason(
        self, fleet: Path, moved: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = held(fleet).oid
        assert run(capsys, "add", moved, *CAMERA, "--yes", "--approve")[0] != 0
        run(capsys, "add", moved, *CAMERA, "--yes")
        code, _, errors = run(capsys, "approve", *looked_at(fleet, P4R))
        assert code != 0
        assert "nothing was written" in errors
        assert "say why with --reason TEXT" in errors
        assert held(fleet).oid == before
        assert run(capsys, "approve", *looked_at(fleet, P4R), "--reason", "dropped and measured")[0] == 0
        assert held(fleet).oid != before

    def test_a_range_of_commits_says_so_too(self, moved: Path, capsys: pytest.CaptureFixture[str]) -> None:
        run(capsys, "add", moved, *CAMERA, "--yes", "--approve", "--reason", "measured again")
        found = printed(capsys, "registry-check-1", "check", "HEAD~1..HEAD")
        assert [one["rule"] for one in found["findings"]] == ["material-change"]
        assert found["verdict"] == "good"

    def test_a_difference_that_no_map_shows_is_none(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        done = printed(
            capsys, "registry-change-1", "add", xml(tmp_path / "c.xml", f=3660.6), *CAMERA, "--yes"
        )
        assert done["findings"] == []
