"""Several registries, some of them published, and the catalogue below: who answers, and what is mentioned."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date
from pathlib import Path

import pytest

from calibrary.calibration import CameraKey, Grade
from calibrary.catalogue import load_catalogue, shipped_with
from calibrary.errors import RegistryError
from calibrary.jobs.layers import LayerKind, Layers, distinctive_words, open_layers
from calibrary.known_camera import match_key
from calibrary.records import replace
from calibrary.registry.entry import Status, Validity
from calibrary.registry.places import PUBLISHED_FILE
from tests.registry.entries import an_entry
from tests.registry.git.repositories import nobodys_git
from tests.registry.published.publications import commit, published
from tests.registry.published.server import Server, serving

__all__ = ["nobodys_git"]

P4R = CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648))
OURS, THEIRS = an_entry(focal_mm=None, fx=3650.0), an_entry(focal_mm=None, fx=3660.0)
UNIT = replace(P4R, serial="ab" * 8)


@pytest.fixture
def public(tmp_path: Path) -> Iterator[Server]:
    """A public registry with the P4R and a camera that the company does not have."""
    commit(tmp_path / "public", THEIRS, an_entry(model="FC9999", focal_mm=None, fx=3000.0))
    published(tmp_path / "public", tmp_path / "out")
    with serving(tmp_path / "out") as server:
        yield server


@pytest.fixture
def company(tmp_path: Path) -> Path:
    commit(tmp_path / "company", OURS)
    return tmp_path / "company"


def fx(layers: Layers, key: CameraKey = P4R) -> float | None:
    found = layers.resolve(key)
    return found.calibration.intrinsics.fx if found is not None else None


def test_the_first_that_answers_is_used_in_the_order_in_which_they_are_named(
    company: Path, public: Server
) -> None:
    assert fx(open_layers([company, public.url])) == 3650.0
    assert fx(open_layers([public.url, company])) == 3660.0
    assert fx(open_layers([company, public.url]), replace(P4R, model="FC9999")) == 3000.0


def test_the_answer_names_its_layer_commit_and_order(company: Path, public: Server) -> None:
    layers = open_layers([company, public.url])
    for key, name in ((P4R, str(company)), (replace(P4R, model="FC9999"), public.url)):
        found = layers.resolve(key)
        assert found is not None
        assert found.layer == name
        layer = layers.layer_of(found)
        assert layer.commit is not None
        title = "company" if name == str(company) else name
        assert f"registry {title} at commit {layer.commit[:12]}" in found.why
        assert found.calibration.provenance.source == f"{title} {found.path}"
        assert layer.report().kind is (LayerKind.GIT if name == str(company) else LayerKind.PUBLISHED)


def test_a_lower_layer_does_not_override_even_with_the_unit_s_own_k(company: Path, tmp_path: Path) -> None:
    commit(tmp_path / "lower", an_entry(focal_mm=None, fx=3655.0, serial=UNIT.serial))
    assert fx(open_layers([company, tmp_path / "lower"]), UNIT) == 3650.0


def test_a_draft_or_an_entry_that_is_not_valid_leaves_it_to_the_next_layer(
    tmp_path: Path, public: Server
) -> None:
    until = Validity(last=date(2025, 12, 31))
    commit(tmp_path / "old", an_entry(focal_mm=None, fx=3600.0, validity=until))
    commit(tmp_path / "drafts", an_entry(focal_mm=None, fx=3600.0, status=Status.DRAFT))
    for name in ("old", "drafts"):
        found = open_layers([tmp_path / name, public.url]).resolve(P4R, on=date(2026, 5, 5))
        assert found is not None
        assert found.calibration.intrinsics.fx == 3660.0


class TestDisagreement:
    @pytest.mark.parametrize(("fx", "is_told"), [(3755.0, False), (3765.0, True), (3535.0, True)])
    def test_a_k_outside_the_tolerance_of_both_is_mentioned(
        self, company: Path, tmp_path: Path, fx: float, is_told: bool
    ) -> None:
        commit(tmp_path / "lower", an_entry(focal_mm=None, fx=fx))
        found = open_layers([company, tmp_path / "lower"]).resolve(P4R)
        assert found is not None
        assert found.calibration.intrinsics.fx == 3650.0
        printed = "".join(found.disagreements)
        assert (f"lower has another K: fx = {fx:.1f} px in {OURS.path}" in printed) is is_told

    def test_k_is_compared_at_the_size_of_the_image(self, company: Path, tmp_path: Path) -> None:
        half = an_entry(focal_mm=None, fx=1825.0, size=(2736, 1824))
        commit(tmp_path / "lower", half)
        found = open_layers([company, tmp_path / "lower"]).resolve(P4R)
        assert found is not None
        assert found.disagreements == ()

    def test_the_catalogue_disagrees_too(self, tmp_path: Path) -> None:
        commit(tmp_path / "fleet", an_entry(focal_mm=None, fx=4650.0))
        found = open_layers([tmp_path / "fleet"], catalogue=True).resolve(P4R)
        assert found is not None
        [printed] = found.disagreements
        assert printed.startswith("catalogue has another K: fx = ")
        assert "px in catalogue/dji/fc6310r/5472x3648, " in printed


class TestUnreachable:
    def test_a_lower_layer_that_cannot_be_read_is_mentioned_once_and_not_tried_again(
        self, company: Path, public: Server
    ) -> None:
        (public.folder / PUBLISHED_FILE).unlink()
        layers = open_layers([company, public.url])
        for _ in range(3):
            found = layers.resolve(P4R)
            assert found is not None
            assert "could not be compared: " in found.disagreements[0]
        assert PUBLISHED_FILE in public.paths

    def test_a_higher_layer_that_cannot_be_read_is_an_error(self, company: Path, public: Server) -> None:
        (public.folder / PUBLISHED_FILE).unlink()
        with pytest.raises(RegistryError, match="the server answers 404"):
            open_layers([public.url, company]).resolve(P4R)

    def test_one_that_answers_from_the_cache_says_how_old_it_is(self, public: Server) -> None:
        assert fx(open_layers([public.url])) == 3660.0
        (public.folder / PUBLISHED_FILE).write_text("<html>")
        layers = open_layers([public.url])
        assert fx(layers) == 3660.0
        assert "the copy in the cache of" in layers.warnings[0]

    def test_a_folder_that_is_none_is_an_error_before_anything_is_asked(self, company: Path) -> None:
        with pytest.raises(RegistryError, match="no such folder"):
            open_layers([company, company / "nothing"])
        with pytest.raises(RegistryError, match="expected https:"):
            open_layers([company, "http://example.com/"])


class TestCatalogue:
    def test_it_answers_for_cameras_that_no_registry_has(self, tmp_path: Path) -> None:
        commit(tmp_path / "fleet", an_entry(model="OTHER"))
        layers = open_layers([tmp_path / "fleet"], catalogue=True)
        found = layers.resolve(P4R)
        assert found is not None
        assert (found.layer, found.calibration.grade) == ("catalogue", Grade.DERIVED)
        assert found.calibration.provenance.kind == "catalogue"
        assert "no registry has an entry of this camera" in found.why
        assert found.why.endswith("from the catalogue that ships with calibrary")
        assert open_layers([tmp_path / "fleet"]).resolve(P4R) is None

    def test_it_says_that_a_published_registry_may_have_the_unit(self, public: Server) -> None:
        found = open_layers([public.url], catalogue=True).resolve(CameraKey(make="DJI", model="FC330"))
        assert found is not None
        assert (
            "a published registry finds the entry of a unit by its serial number alone: --serial" in found.why
        )

    @pytest.mark.parametrize("status", [Status.DRAFT, Status.RETIRED])
    def test_it_does_not_where_a_person_has_to_decide(self, tmp_path: Path, status: Status) -> None:
        commit(tmp_path / "fleet", an_entry(focal_mm=None, status=status))
        layers = open_layers([tmp_path / "fleet"], catalogue=True)
        assert layers.resolve(P4R) is None
        assert [one.path for one in layers.near(P4R)] == [OURS.path]

    def test_it_does_not_where_several_of_its_cameras_may_be_meant(self, company: Path) -> None:
        layers = open_layers([company], catalogue=True)
        assert layers.resolve(CameraKey(make="DJI", model="M3T")) is None


class TestWhichAreMeant:
    def test_a_revision_is_of_one_registry_in_git(self, company: Path, public: Server) -> None:
        for places in ([public.url], [company, company]):
            with pytest.raises(RegistryError, match="one registry in git"):
                open_layers(places, at="main")


def test_every_camera_of_the_catalogue_is_found_by_each_of_its_names() -> None:
    for camera in load_catalogue():
        for model in camera.models:
            for name in (model, model.upper(), model.replace("×", "x")):
                words = distinctive_words(match_key(name))
                assert camera in shipped_with(words), name
