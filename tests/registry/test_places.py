"""Which registry a command uses."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from calibrary.errors import RegistryError, UsageError
from calibrary.registry.places import default_place, is_published, one_registry, registries
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]

PUBLIC = "https://example.com:8443/cameras"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder without a registry, and nothing that names one."""
    monkeypatch.delenv("CALIBRARY_REGISTRY")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def variable(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("CALIBRARY_REGISTRY", text)


def test_each_step_goes_before_the_next(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert registries() == ()
    default_place().mkdir(parents=True)
    assert registries() == (default_place(),)
    below = here / "fleet/cameras/dji"
    below.mkdir(parents=True)
    (here / "fleet/registry.yaml").touch()
    (here / "registry.yaml").touch()
    monkeypatch.chdir(below)
    assert registries() == (here / "fleet",)
    variable(monkeypatch, f"/a b/c; {PUBLIC};")
    assert registries() == ("/a b/c", PUBLIC)
    assert registries(["a", PUBLIC]) == ("a", PUBLIC)
    assert registries("a") == ("a",)


def test_none_stops_the_search(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "registry.yaml").touch()
    assert registries("none") == ()
    assert registries("./none") == ("./none",)
    variable(monkeypatch, "none")
    assert registries() == ()
    assert registries("a") == ("a",)
    with pytest.raises(UsageError, match="none goes alone"):
        registries(["none", "a"])
    with pytest.raises(RegistryError, match="no registry"):
        one_registry()


def test_a_folder_that_is_gone_has_none_above_it(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "gone").mkdir()
    monkeypatch.chdir(here / "gone")
    shutil.rmtree(here / "gone")
    assert registries() == ()


def test_one_registry_is_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    assert one_registry("a") == one_registry(["a"]) == Path("a")
    with pytest.raises(UsageError, match="needs one registry"):
        one_registry(["a", "b"])
    with pytest.raises(UsageError, match="expected the folder of a registry"):
        one_registry(PUBLIC)
    variable(monkeypatch, f"{PUBLIC}; a; b")
    assert one_registry() == Path("a")
    variable(monkeypatch, PUBLIC)
    with pytest.raises(RegistryError, match="expected the folder of a registry"):
        one_registry()


@pytest.mark.parametrize("needed", [True, False])
def test_it_is_an_error_only_where_one_is_needed(needed: bool) -> None:
    if needed:
        with pytest.raises(RegistryError, match="'calibrary registry init' makes one"):
            registries(needed=True)
    else:
        assert registries() == ()


@pytest.mark.parametrize(
    ("text", "expected"),
    [(PUBLIC, True), ("HTTP://localhost", True), ("https", False), ("./http://x", False)],
)
def test_an_address_is_of_the_web(text: str, expected: bool) -> None:
    assert is_published(text) is expected
