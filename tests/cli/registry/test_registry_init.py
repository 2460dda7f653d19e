"""``registry init``: what a registry begins with, and what it leaves alone."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.distortion import MODELS
from calibrary.errors import InputError
from calibrary.policy import SOURCE
from calibrary.registry.configuration import configuration_yaml, parse_configuration
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.init import example_entry
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import StoredEntry
from calibrary.schemas import require
from calibrary.strictyaml import load_yaml
from tests.cli.registry.fleets import CAMERA, P4R, add, held, run, xml
from tests.registry.git.repositories import git

FILES = [
    ".gitattributes",
    ".github/CODEOWNERS",
    ".github/workflows/registry-check.yml",
    ".pre-commit-config.yaml",
    ".vscode/settings.json",
    "DISTORTION.md",
    "README.md",
    "events/rules/FOUNDATION",
    "registry.yaml",
    "schema/entry-1.schema.json",
    "schema/registry-1.schema.json",
]


def named(files: Iterable[str]) -> list[str]:
    """The files without the name of the first statement, which says when it was made."""
    return [
        re.sub("(events/rules/).*-found-ada_keeper-[0-9a-f]{32}.json", r"\1FOUNDATION", file)
        for file in files
    ]


def test_a_registry_begins_with_one_commit_that_says_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, _ = run(capsys, "init", tmp_path / "fleet")
    assert code == 0
    assert named(git(tmp_path / "fleet", "ls-files").splitlines()) == FILES
    assert git(tmp_path / "fleet", "log", "--format=%s") == "Create a registry of camera calibrations"
    assert git(tmp_path / "fleet", "status", "--porcelain") == ""


def test_a_registry_states_the_formulas_of_its_distortion_models(fleet: Path) -> None:
    text = (fleet / "DISTORTION.md").read_text(encoding="utf-8")
    for name, kind in MODELS.items():
        section = text.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        assert all(f"`{parameter}`" in section for parameter in kind.names())
        assert name == "none" or "```text\n" in section
    assert "DISTORTION.md has the formula" in (fleet / "registry.yaml").read_text(encoding="utf-8")


def test_this_folder_is_the_place_where_none_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["registry", "init"]) == 0
    assert (tmp_path / "registry.yaml").is_file()
    assert capsys.readouterr().err.endswith("next: calibrary registry add FILE\n")


def test_its_json_keeps_the_schema(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = run(capsys, "init", tmp_path / "fleet", "--json")
    document = json.loads(out)
    require(document, "registry-begun-1")
    assert named(document["files"]) == FILES


def test_the_readmes_example_is_an_entry_of_no_camera(fleet: Path) -> None:
    text = (fleet / "README.md").read_text()
    example = text.partition("```yaml\n")[2].partition("```")[0]
    assert parse_entry(example.encode(), "README.md") == example_entry()
    assert [*Registry.open(fleet).snapshot().entries()] == []


def test_the_workflow_runs_the_check_on_every_push_and_may_write_nothing(fleet: Path) -> None:
    text = (fleet / ".github/workflows/registry-check.yml").read_text()
    assert "calibrary registry check" in text
    assert "on: [push, pull_request]" in text
    assert "permissions:\n  contents: read\n" in text
    # A pull request is judged from its base, named by the environment and not pasted into the command.
    assert 'calibrary registry check --registry . "$BASE..HEAD"' in text
    assert "BASE: ${{ github.event.pull_request.base.sha }}" in text
    load_yaml(text.encode(), source="workflow", max_bytes=1 << 16)


def test_changes_by_hand_are_checked_and_have_an_owner(fleet: Path) -> None:
    hooks = (fleet / ".pre-commit-config.yaml").read_text()
    assert "entry: calibrary registry check --worktree" in hooks
    owners = [line for line in (fleet / ".github/CODEOWNERS").read_text().splitlines() if line[0] != "#"]
    assert owners == [f"/{name} ada@example.com" for name in ("cameras/", "registry.yaml", ".github/")]


def test_a_repository_without_a_commit_is_begun_in(tmp_path: Path) -> None:
    git(tmp_path, "init", "--quiet", "fleet")
    assert main(["registry", "init", str(tmp_path / "fleet")]) == 0
    assert named(git(tmp_path / "fleet", "ls-files").splitlines()) == FILES


def test_a_repository_of_something_else_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "--quiet", "code")
    (tmp_path / "code/main.c").write_text("int main;")
    git(tmp_path / "code", "add", "main.c")
    git(tmp_path / "code", "commit", "--quiet", "-m", "Begin")
    code, _, err = run(capsys, "init", tmp_path / "code")
    assert code == 4
    assert "a git repository of another project" in err
    assert git(tmp_path / "code", "log", "--format=%s") == "Begin"
    code, _, err = run(capsys, "list", "--registry", tmp_path / "code")
    assert code == 4
    assert "not a registry" in err


def test_a_registry_is_not_begun_twice(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "init", fleet)
    assert code == 4
    assert "there is a registry already" in err


def test_a_file_in_the_way_stays_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "README.md").write_text("mine\n")
    code, _, err = run(capsys, "init", tmp_path)
    assert code == 4
    assert "README.md exists already" in err
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]
    assert (tmp_path / "README.md").read_text() == "mine\n"


def test_a_registry_in_another_repository_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    git(tmp_path, "init", "--quiet")
    _, out, _ = run(capsys, "init", tmp_path / "fleet")
    assert ".gitignore" in out


def test_a_remote_is_copied_with_its_entries(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    code, out, _ = run(capsys, "init", "--remote", fleet)
    assert code == 0
    assert "a copy of" in out
    assert [one.id for one in Registry.open(tmp_path / "elsewhere/fleet").snapshot().entries()] == [P4R]


def test_an_empty_remote_is_begun_and_can_be_pushed_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "--quiet", "--bare", "hub.git")
    code, out, _ = run(capsys, "init", tmp_path / "fleet", "--remote", tmp_path / "hub.git")
    assert (code, "push it" in out) == (0, True)
    git(tmp_path / "fleet", "push", "--quiet", "origin", "main")
    assert named(git(tmp_path / "hub.git", "ls-tree", "-r", "--name-only", "main").splitlines()) == FILES


def test_a_remote_that_is_no_registry_leaves_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "--quiet", "code")
    git(tmp_path / "code", "commit", "--quiet", "--allow-empty", "-m", "Begin")
    code, _, err = run(capsys, "init", tmp_path / "fleet", "--remote", tmp_path / "code")
    assert (code, "not a registry" in err) == (4, True)
    assert not (tmp_path / "fleet").exists()


def test_a_bare_registry_takes_entries(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["registry", "init", "--bare", str(tmp_path / "fleet.git")]) == 0
    add(xml(tmp_path / "a.xml"), "--registry", str(tmp_path / "fleet.git"), camera=CAMERA)
    code, out, _ = run(capsys, "list", "--registry", tmp_path / "fleet.git")
    assert (code, P4R in out) == (0, True)


@pytest.mark.parametrize(
    ("before", "after", "place"),
    [
        ('schema: "calibrary/registry-1"', 'schema: "calibrary/registry-2"', "schema"),
        ("layout: 3", "layout: 4", "layout"),
        ('entries: "calibrary/entry-1"', 'entries: "calibrary/entry-9"', "entries"),
    ],
)
def test_a_newer_registry_is_refused_with_what_was_found_and_the_way_out(
    fleet: Path, before: str, after: str, place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    configuration = fleet / "registry.yaml"
    configuration.write_text(configuration.read_text().replace(before, after))
    git(fleet, "commit", "--quiet", "-am", "Move on")
    code, _, err = run(capsys, "list")
    assert code == 4
    assert f"registry.yaml: {place}: is {after.partition(': ')[2].strip(chr(34))}" in err
    assert "upgrade calibrary" in err


def test_a_registry_begun_by_hand_is_one_by_its_entries(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"))
    git(fleet, "rm", "--quiet", "registry.yaml")
    git(fleet, "commit", "--quiet", "-m", "Forget")
    assert run(capsys, "list")[0] == 0


def test_a_broken_configuration_is_reported_by_its_line(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (fleet / "registry.yaml").write_text('schema: "calibrary/registry-1"\nlayout: "one"\n')
    git(fleet, "commit", "--quiet", "-am", "Break")
    code, _, err = run(capsys, "list")
    assert (code, "registry.yaml: line 2" in err) == (0, True)
    code, out, _ = run(capsys, "check")
    assert (code, "registry.yaml: error: line 2" in out) == (1, True)


def test_the_configuration_it_writes_reads_back() -> None:
    assert isinstance(load_yaml(configuration_yaml(), source="registry.yaml"), dict)
    assert parse_configuration(configuration_yaml("source")).policy == SOURCE


def test_limits_of_its_own_are_in_the_configuration() -> None:
    text = (
        b'schema: "calibrary/registry-1"\nlayout: 3\n'
        b'policy: {schema: "calibrary/policy-1", name: "ours", principal_point_drift_max: 0.02}\n'
    )
    assert parse_configuration(text).policy.principal_point_drift_max == 0.02
    with pytest.raises(InputError):
        parse_configuration(text.replace(b"0.02", b"2"))


def test_a_registry_of_the_former_layout_is_brought_to_this_one(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"), "--approve")
    used = held(fleet)
    add(xml(tmp_path / "b.xml", 3700.0))
    waits = held(fleet, f"{P4R}@proposed")
    as_in_the_former_layout(fleet, used)
    code, _, err = run(capsys, "list")
    assert (code, "init FOLDER --migrate" in err) == (4, True)
    assert run(capsys, "init", fleet, "--migrate")[0] == 0
    assert held(fleet).entry == used.entry
    assert held(fleet, f"{P4R}@proposed").entry == waits.entry
    assert not any((fleet / former).exists() for former in ("proposals", "statements"))
    assert (run(capsys, "check")[0], git(fleet, "status", "--porcelain")) == (0, "")
    assert run(capsys, "init", fleet, "--migrate")[0] == 4


def as_in_the_former_layout(fleet: Path, used: StoredEntry) -> None:
    """A proposal beside the entry in use, each with its status, and the statements in their former folder."""
    git(fleet, "mv", "events", "statements")
    (fleet / f"proposals/{used.id}").parent.mkdir(parents=True)
    git(fleet, "mv", used.path, f"proposals/{used.path.removeprefix('cameras/')}")
    for path, data, status in (
        (used.path, entry_yaml(used.entry), "approved"),
        (f"proposals/{used.id}.yaml", None, "draft"),
    ):
        text = (data or (fleet / path).read_bytes()).decode()
        (fleet / path).parent.mkdir(parents=True, exist_ok=True)
        (fleet / path).write_text(text.replace("\ndigest:", f'\nstatus: "{status}"\ndigest:'))
    configuration = fleet / "registry.yaml"
    configuration.write_text(configuration.read_text().replace("layout: 3", "layout: 2"))
    git(fleet, "add", "--all")
    git(fleet, "commit", "--quiet", "--message=As it was")
