"""A registry that is open to everyone, from the catalogue; and what editors and other programs check its files with."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator
from referencing import Registry as Schemas
from referencing import Resource

from calibrary.calibration import Grade
from calibrary.cli.main import main
from calibrary.registry.configuration import parse_configuration
from calibrary.registry.entry import Status
from calibrary.registry.registry import Registry
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import run
from tests.house.project import ROOT
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git

BASE = "https://cameras.example.com/fleet"


@pytest.fixture(scope="module")
def starter(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("starter") / "camera-calibrations"
    with pytest.MonkeyPatch.context() as patch:
        for who in ("AUTHOR", "COMMITTER"):
            patch.setenv(f"GIT_{who}_NAME", "Ada")
            patch.setenv(f"GIT_{who}_EMAIL", "ada@example.com")
        assert main(["registry", "init", "--starter", str(place), "--yes"]) == 0
    return place


def associated(registry: Path) -> Iterator[tuple[Path, Path]]:
    """Each file that VS Code's settings give a schema, and that schema."""
    settings = json.loads((registry / ".vscode/settings.json").read_text())["yaml.schemas"]
    for schema, patterns in settings.items():
        for pattern in [patterns] if isinstance(patterns, str) else patterns:
            yield from ((path, registry / schema) for path in registry.glob(pattern))


def test_every_entry_is_a_proposal_for_a_model_and_states_no_uncertainty(starter: Path) -> None:
    snapshot = Registry.open(starter).snapshot()
    assert [*snapshot.entries()] == []
    proposals = [*snapshot.proposals()]
    # As docs/registry.md says; one more camera in the catalogue changes both.
    assert f"({len(proposals)} entries)" in (ROOT / "docs/registry.md").read_text()
    for stored in proposals:
        calibration = stored.entry.calibration
        assert (stored.entry.status, calibration.grade) == (Status.DRAFT, Grade.DERIVED)
        assert calibration.quality is None
        assert calibration.distortion is None
        assert calibration.provenance.kind == "catalogue"
        assert calibration.notes, "it names its sources"


def test_what_it_proposes_is_approved_by_another_person(starter: Path) -> None:
    rule = parse_configuration((starter / "registry.yaml").read_bytes()).approvals
    assert rule is not None
    assert rule.not_author


def test_it_has_the_text_of_its_licence_and_rules_of_review(starter: Path) -> None:
    assert "Apache License" in (starter / "LICENSE").read_text()[:200]
    assert "derived from the catalogue of calibrary" in (starter / "NOTICE").read_text()
    readme, rules = ((starter / name).read_text() for name in ("README.md", "CONTRIBUTING.md"))
    for name in ("LICENSE", "NOTICE", "CONTRIBUTING.md"):
        assert f"[{name}]({name})" in readme
    assert "## An entry" in readme
    assert "registry export KEY --public" in rules
    assert git(starter, "status", "--porcelain") == ""


def test_pushed_to_a_server_it_is_good(
    starter: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "--quiet", "--bare", "--initial-branch=main", "hub.git")
    git(starter, "push", "--quiet", str(tmp_path / "hub.git"), "HEAD:main")
    code, told, _ = run(capsys, "check", "--registry", tmp_path / "hub.git")
    assert code == 0
    assert "0 errors, 0 warnings" in told


def test_an_editor_checks_every_file_with_the_schemas_in_the_registry(starter: Path) -> None:
    checked = 0
    for path, schema in associated(starter):
        validator = Draft202012Validator(json.loads(schema.read_bytes()))
        document = yaml.safe_load(path.read_text())
        assert [error.message for error in validator.iter_errors(document)] == []
        broken = {**document, "fz": 1.0}
        assert path.name == "registry.yaml" or not validator.is_valid(broken)
        checked += 1
    files = [*starter.glob("proposals/**/*.yaml"), starter / "registry.yaml"]
    assert checked == len(files)
    first = (starter / "registry.yaml").read_text().splitlines()[0]
    named = first.removeprefix("# yaml-language-server: $schema=")
    assert (starter / named).is_file()


def test_a_starter_is_no_copy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["registry", "init", str(tmp_path / "new"), "--starter", "--remote", str(tmp_path)]) == 2
    assert "give one of them" in capsys.readouterr().err


def test_published_schemas_are_urls_of_the_site_that_serves_them(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(), an_entry(model="Other"))
    out = tmp_path / "out"
    assert run(capsys, "publish", out, "--base-url", f"{BASE}/", "--site")[0] == 0
    fetched: list[str] = []

    def served(url: str) -> Resource[Any]:
        fetched.append(url)
        return Resource.from_contents(json.loads((out / url.removeprefix(f"{BASE}/")).read_bytes()))

    made: Any = Schemas  # mypy does not see what attrs takes
    schemas = made(retrieve=served)
    kinds = {
        "published-camera-1": [*out.glob("models/**/*.json")],
        "entry-1": [*out.glob("entries/**/*.json")],
    }
    for name, paths in kinds.items():
        url = f"{BASE}/schemas/{name}.schema.json"
        assert served(url).id() == url
        validator = Draft202012Validator({"$ref": url}, registry=schemas)
        assert paths
        for path in paths:
            assert [error.message for error in validator.iter_errors(json.loads(path.read_bytes()))] == []
    assert f"{BASE}/schemas/calibration-1.schema.json" in fetched
    texts = [path.read_text() for path in (out / "schemas").iterdir()]
    assert not any("urn:calibrary" in text for text in texts)
    # Again: nothing is new, and the pages beside it take the folder for what it is.
    assert "0 files written" in " ".join(run(capsys, "publish", out, "--base-url", BASE)[1].split())


def test_a_base_url_that_is_none_is_refused(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    code, _, told = run(capsys, "publish", tmp_path / "out", "--base-url", "cameras.example.com")
    assert (code, "https://HOST/PATH/" in told) == (3, True)
    assert not (tmp_path / "out").exists()
