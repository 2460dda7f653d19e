"""Dependencies: each has its reason in CONTRIBUTING.md and its version in the lock file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from importlib.metadata import packages_distributions

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from calibrary.extras import LIBRARIES
from tests.house.project import ROOT

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
EXTRAS: dict[str, list[str]] = PYPROJECT["project"]["optional-dependencies"]
WANTED = [
    Requirement(line)
    for line in (
        *PYPROJECT["build-system"]["requires"],
        *PYPROJECT["project"]["dependencies"],
        *PYPROJECT["dependency-groups"]["dev"],
        *(line for lines in EXTRAS.values() for line in lines if not line.startswith("calibrary[")),
    )
]
LOCK = (ROOT / "requirements-dev.lock").read_text()
PYTHONS = ("3.11.0", "3.12.0", "3.13.0", "3.14.0")


def reasons() -> dict[str, str]:
    """What CONTRIBUTING.md says of each dependency: ``* **name**: reason``."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    return {
        canonicalize_name(name): why for name, why in re.findall(r"(?m)^\* \*\*([\w-]+)\*\*: (.+)$", text)
    }


def locked(python: str) -> dict[str, str]:
    """The version of each package that the lock file gives to a Python."""
    environment = {"python_version": python.rpartition(".")[0], "python_full_version": python}
    pins = [Requirement(line) for line in re.findall(r"(?m)^([\w-]+==[^\\\n]+?) *\\?$", LOCK)]
    here = [pin for pin in pins if pin.marker is None or pin.marker.evaluate(environment)]
    versions: dict[str, str] = {pin.name: str(pin.specifier).removeprefix("==") for pin in here}
    assert len(versions) == len(here), "a package is pinned twice"
    return versions


def test_each_dependency_has_its_reason_and_each_reason_its_dependency() -> None:
    assert set(reasons()) == {canonicalize_name(wanted.name) for wanted in WANTED}


@pytest.mark.parametrize("name", sorted(reasons()))
def test_a_reason_is_a_sentence(name: str) -> None:
    assert len(reasons()[name].split()) >= 5
    assert reasons()[name].endswith(".")


@pytest.mark.parametrize("python", PYTHONS)
def test_the_lock_file_gives_each_python_what_pyproject_wants(python: str) -> None:
    versions = locked(python)
    missed = [
        str(wanted)
        for wanted in WANTED
        if not wanted.specifier.contains(versions[canonicalize_name(wanted.name)])
    ]
    assert missed == [], "run `make lock`"


def test_the_lock_file_names_no_package_index() -> None:
    assert "://" not in LOCK
    assert re.findall(r"(?m)^-", LOCK) == []


def test_all_brings_every_extra_but_the_opencv_that_would_replace_a_users_own() -> None:
    (everything,) = (Requirement(line) for line in EXTRAS["all"])
    assert everything.extras == EXTRAS.keys() - {"all", "opencv"}


def test_no_extra_but_opencv_brings_an_opencv() -> None:
    """Pip would put it over the variant that a user has."""
    naming = {extra for extra, lines in EXTRAS.items() if any("opencv" in Requirement(x).name for x in lines)}
    assert naming == {"opencv"}


@pytest.fixture(scope="module")
def installed() -> Mapping[str, list[str]]:
    """The distributions that each module here is of."""
    return packages_distributions()


@pytest.mark.parametrize("module", LIBRARIES)
def test_each_optional_library_is_in_the_extras_that_its_message_names(
    installed: Mapping[str, list[str]], module: str
) -> None:
    brought = {
        canonicalize_name(Requirement(line).name)
        for extra in LIBRARIES[module].extras
        for line in EXTRAS[extra]
    }
    distributions = {canonicalize_name(name) for name in installed[module]}
    assert brought & distributions


def test_every_pin_carries_a_hash() -> None:
    pins = re.split(r"(?m)^(?=[a-z])", LOCK)[1:]
    assert [pin.splitlines()[0] for pin in pins if "--hash=sha256:" not in pin] == []
