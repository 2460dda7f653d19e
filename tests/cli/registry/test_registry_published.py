"""``--registry https://…`` of resolve, extract and check, alone and in layers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.cli.main import main
from calibrary.schemas import require
from tests.cli.registry.conftest import Filled
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import P4R, commit_of, printed, run
from tests.jobs.extract.fleet import picture
from tests.registry.entries import an_entry
from tests.registry.published.publications import UNIT, commit, published
from tests.registry.published.server import Server, serving

TAGS: dict[str, Any] = {"make": "DJI", "model": "FC6310R"}
"""Without a focal length the images themselves have no K."""

UNKNOWN = an_entry(model="FC9999", focal_mm=None, fx=3600.0, distortion=None)
"""Of a camera that the catalogue does not have."""


def enter_two(fleet: Path) -> None:
    put(fleet, an_entry(focal_mm=None), UNKNOWN)


@pytest.fixture
def public(fleet: Path, tmp_path: Path, filled: Filled) -> Iterator[Server]:
    """The registry on the web; no variable means it."""
    filled(fleet, enter_two)
    published(fleet, tmp_path / "out")
    with serving(tmp_path / "out") as server:
        yield server


def test_an_image_is_resolved_over_http(
    public: Server, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = picture(tmp_path / "a.jpg", **TAGS)
    answer = printed(capsys, "resolution-1", "resolve", image, "--registry", public.url)
    assert answer["calibration"]["intrinsics"]["fx"] == 3661.25
    assert (answer["registry"], answer["commit"]) == (public.url, commit_of(fleet))
    assert [(layer["kind"], layer["name"]) for layer in answer["layers"]] == [
        ("published", public.url),
        ("catalogue", "catalogue"),
    ]
    assert (answer["entry"]["path"], answer["entry"]["status"]) == (f"cameras/{P4R}.yaml", "approved")
    code, out, err = run(capsys, "resolve", P4R, "--registry", public.url)
    assert (code, err) == (0, "")
    assert f"cameras/{P4R}.yaml" in out


@pytest.mark.parametrize("word", ["dji/fc6310r", P4R, "DJI/FC6310R", f"{P4R[:16]}"])
def test_a_key_is_make_and_model_with_or_without_its_variant(
    public: Server, capsys: pytest.CaptureFixture[str], word: str
) -> None:
    answer = printed(capsys, "resolution-1", "resolve", word, "--registry", public.url)
    assert answer["entry"]["id"] == P4R


def test_a_unit_is_found_by_make_model_and_serial_number(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(model="FC9999", focal_mm=None, serial=UNIT))
    published(fleet, tmp_path / "out")
    place = ("--registry", tmp_path / "out")
    assert "a unit by --make, --model and --serial" in run(capsys, "resolve", "dji/fc9999", *place)[2]
    asked = ("--make", "DJI", "--model", "FC9999", "--serial", "0V2LG3H0")
    answer = printed(capsys, "resolution-1", "resolve", *asked, *place)
    assert answer["entry"]["id"].startswith(f"dji/fc9999/sn-{UNIT}/")


@pytest.mark.parametrize("word", ["fc6310r", "dji/fc9"])
def test_what_a_published_registry_cannot_be_asked_is_one_line(
    public: Server, capsys: pytest.CaptureFixture[str], word: str
) -> None:
    code, _, err = run(capsys, "resolve", word, "--registry", public.url)
    assert code == 4
    assert "by make and model, as in dji/fc6310r" in err
    assert err.count("\n") == 1


def test_the_variable_may_name_several(
    public: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commit(tmp_path / "ours", an_entry(focal_mm=None, fx=3500.0, distortion=None))
    monkeypatch.setenv("CALIBRARY_REGISTRY", f"{tmp_path / 'ours'};{public.url}")
    answer = printed(capsys, "resolution-1", "resolve", P4R)
    assert answer["calibration"]["intrinsics"]["fx"] == 3500.0
    assert "another K: fx = 3661.2 px in cameras/dji/fc6310r/5472x3648.yaml" in answer["disagreements"][0]
    assert "has another K" in run(capsys, "resolve", P4R)[2]
    # What needs a folder takes the first one.
    assert len(printed(capsys, "entry-listing-1", "list")["entries"]) == 1
    monkeypatch.setenv("CALIBRARY_REGISTRY", public.url)
    code, _, err = run(capsys, "list")
    assert (code, "expected the folder of a registry" in err) == (4, True)


def test_a_command_that_needs_a_folder_says_so(public: Server, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "list", "--registry", public.url)
    assert (code, "expected the folder of a registry" in " ".join(err.split())) == (2, True)


@pytest.mark.usefixtures("public")
def test_a_key_that_ends_in_a_focal_length_is_not_taken_for_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["diff", f"{P4R}+f12.29", P4R, "--registry", str(tmp_path / "out")])
    said = " ".join(capsys.readouterr().err.split())
    assert (code, "a published registry is read by" in said) == (2, True)


def extract(folder: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, Any, str]:
    """The exit code, the report and the complaints of ``calibrary extract``."""
    capsys.readouterr()
    code = main(["extract", str(folder), "--dry-run", "--json", *arguments])
    said = capsys.readouterr()
    document = json.loads(said.out) if said.out else None
    if document is not None:
        require(document, "report-1")
    return code, document, said.err


class TestExtract:
    @pytest.fixture
    def flight(self, tmp_path: Path) -> Path:
        return picture(tmp_path / "flight/a.jpg", **TAGS).parent

    def test_k_is_the_published_one_and_the_report_says_whose(
        self, public: Server, flight: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        code, report, _ = extract(flight, capsys, "--registry", public.url)
        assert code == 0
        [camera] = report["cameras"]
        assert camera["calibration"]["intrinsics"]["fx"] == 3661.25
        assert camera["calibration"]["provenance"]["source"] == f"{public.url} cameras/{P4R}.yaml"

    def test_layers_are_asked_in_their_order_and_disagreements_are_warnings(
        self, public: Server, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        commit(tmp_path / "ours", an_entry(model="FC9999", focal_mm=None, fx=3450.0, distortion=None))
        picture(flight / "a.jpg", make="DJI", model="FC9999")
        code, report, _ = extract(
            flight, capsys, "--registry", str(tmp_path / "ours"), "--registry", public.url
        )
        assert code == 0
        assert report["cameras"][0]["calibration"]["intrinsics"]["fx"] == 3450.0
        assert any(f"{public.url} has another K" in warning for warning in report["warnings"])

    def test_offline_the_cache_answers_and_the_report_says_how_old_it_is(
        self, public: Server, flight: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert extract(flight, capsys, "--registry", public.url)[0] == 0
        (public.folder / "calibrary-manifest.json").write_text("<html>log in</html>")
        code, report, _ = extract(flight, capsys, "--registry", public.url)
        assert code == 0
        assert any("the copy in the cache of" in warning for warning in report["warnings"])

    @pytest.mark.parametrize(
        ("arguments", "code", "printed"),
        [
            (["--registry", "http://example.com/x"], 4, "expected https:"),
            (["--registry", "{url}", "--locked", "x.lock"], 4, "a lock is of one registry on this machine"),
            (["--registry", "{url}none/"], 4, "no published registry here"),
        ],
    )
    def test_what_cannot_be_read_is_one_line_with_its_exit_code(
        self,
        public: Server,
        flight: Path,
        capsys: pytest.CaptureFixture[str],
        arguments: list[str],
        code: int,
        printed: str,
    ) -> None:
        got, _, said = extract(flight, capsys, *(text.format(url=public.url) for text in arguments))
        assert (got, said.count("\n")) == (code, 1)
        assert printed in said

    def test_check_holds_a_k_against_the_published_one(
        self, public: Server, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        for fx, code in ((3661.25, 0), (3900.0, 1)):
            K = np.array([[fx, 0, 2731.5], [0, fx - 2.5, 1831.25], [0, 0, 1.0]])
            np.save(tmp_path / "K.npy", K)
            arguments = ["check", str(flight), str(tmp_path / "K.npy"), "--registry", public.url]
            assert main(arguments) == code
        assert "is off by" in capsys.readouterr().out
