"""Flags from signatures: what a job's parameters say is what the command line takes."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from datetime import date
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, Struct

from calibrary.arguments import Folder, PolicyLike, Text
from calibrary.cli.commands import Parser
from calibrary.cli.flags import add_flags, call
from calibrary.image_size import ImageSize
from calibrary.policy import FLEET
from calibrary.progress import Progress


class Weather(Struct, frozen=True, kw_only=True):
    """How the weather was. Nobody is to blame.

    Attributes:
        sky: what the sky showed.
        wind_m: metres the wind moved the aircraft, unlike ``sky``.
        dry: whether no rain fell.
    """

    sky: Text | None = None
    wind_m: Annotated[float, Meta(ge=0)] = 0.5
    dry: bool = False


def fly(
    folders: Folder | Sequence[Folder],
    *,
    keep: Literal["all", "none"] | Annotated[float, Meta(ge=0, le=1)] = "all",
    views: Annotated[int, Meta(gt=2)] | None = None,
    size: ImageSize | None = None,
    day: date | None = None,
    tags: Sequence[str] = (),
    set: Mapping[str, str] | None = None,  # noqa: A002  as a caller would spell it
    policy: PolicyLike = FLEET,
    force: bool = False,
    weather: Weather | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Fly.

    Args:
        folders: where the images are.
        keep: how much is kept; see ``views``.
        views: number of views
            that are wanted.
        size: of the images, 100 % of it.
        day: of the flight.
        tags: for searching.
        set: an answer.
        policy: the limits.
        force: do it all the same.
        weather: how it was.
        progress: called with (done, total, what).

    Raises:
        InputError: never.
    """
    return {name: value for name, value in locals().items() if name != "progress"}


def parser(**settings: Any) -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="fly", exit_on_error=False)
    add_flags(made, fly, positional={"folders": "DIR"}, **settings)
    return made


def given(*argv: str) -> dict[str, Any]:
    result: dict[str, Any] = call(fly, parser().parse_args(argv))
    return result


def test_what_is_not_given_is_the_jobs_default() -> None:
    assert given("a", "b") == {**fly(["a", "b"])}


@pytest.mark.parametrize(
    ("argv", "name", "value"),
    [
        (["--keep", "none"], "keep", "none"),
        (["--keep", "0.25"], "keep", 0.25),
        (["--views", "3"], "views", 3),
        (["--size", "5472x3648"], "size", (5472, 3648)),
        (["--day", "2026-05-01"], "day", date(2026, 5, 1)),
        (["--tags", "a", "--tags", "b"], "tags", ["a", "b"]),
        (["--set", "a=1", "--set", "b=2"], "set", {"a": "1", "b": "2"}),
        (["--policy", "source"], "policy", "source"),
        (["--force"], "force", True),
        (["--sky", "blue", "--dry"], "weather", Weather(sky="blue", dry=True)),
        (["--wind-m", "0"], "weather", Weather(wind_m=0.0)),
    ],
)
def test_a_flag_is_read_as_its_parameter_is_annotated(argv: list[str], name: str, value: object) -> None:
    assert given("a", *argv)[name] == value


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--keep", "2"], "'2': expected a number from 0 to 1"),
        (["--keep", "most"], "'most': expected a number from 0 to 1"),
        (["--views", "2"], "'2': expected a whole number more than 2"),
        (["--views", "3.5"], "'3.5': expected a whole number more than 2"),
        (["--wind-m", "nan"], "'nan': expected a number from 0"),
        (["--size", "5472"], "'5472': expected WxH in whole pixels, such as 5472x3648"),
        (["--day", "May"], "'May': expected a day such as 2026-05-01"),
        (["--set", "a"], "'a': expected NAME=VALUE"),
    ],
)
def test_a_value_that_its_annotation_does_not_admit_is_refused(argv: list[str], said: str) -> None:
    with pytest.raises(argparse.ArgumentError, match=said.replace("(", r"\(")):
        given("a", *argv)


def test_the_help_is_the_parameters_line_with_flags_for_parameters_and_the_default() -> None:
    text = " ".join(parser().format_help().split())
    assert "--keep all|none|X how much is kept; see --views (default: all)" in text
    assert "--views N number of views that are wanted" in text
    assert "--size WxH of the images, 100 % of it" in text
    assert "--policy fleet|source|FILE the limits (default: fleet)" in text
    assert "how the weather was: --sky TEXT what the sky showed --wind-m M metres the wind moved" in text
    assert "unlike --sky (default: 0.5)" in text
    assert "progress" not in text


def test_a_command_may_group_spell_leave_out_and_require() -> None:
    made = parser(
        groups={"what": ("views", "keep")},
        spelled={"tags": ("--tag", "-t")},
        without=["dry", "policy"],
        required=["size"],
    )
    text = " ".join(made.format_help().split())
    assert "what: --views N" in text
    assert "see --views" in text
    assert "see --count" in parser(spelled={"views": ("--count", "-n")}).format_help()
    assert "--dry" not in text
    assert "--policy" not in text
    assert call(fly, made.parse_args(["a", "--size", "4x3", "-t", "x"]), policy="source")["tags"] == ["x"]
    with pytest.raises((SystemExit, argparse.ArgumentError)):
        made.parse_args(["a"])


def test_parameters_that_exclude_one_another_are_refused_together() -> None:
    with pytest.raises(argparse.ArgumentError, match="not allowed with argument --views"):
        parser(exclusive=[("views", "size")]).parse_args(["a", "--views", "3", "--size", "4x3"])


def test_a_parameter_that_the_docstring_does_not_explain_is_an_error_of_ours() -> None:
    def silent(*, loud: bool = False) -> None:
        """Say nothing of it."""

    with pytest.raises(TypeError, match="says nothing of loud"):
        add_flags(argparse.ArgumentParser(), silent)


def test_a_name_that_is_no_parameter_is_an_error_of_ours() -> None:
    with pytest.raises(TypeError, match="no parameter wings"):
        add_flags(argparse.ArgumentParser(), fly, groups={"what": ["wings"]})


def test_of_two_positional_parameters_that_take_several_values_only_the_last_does() -> None:
    def check(images: Folder | Sequence[Folder], files: Sequence[Folder] = ()) -> dict[str, Any]:
        """Check.

        Args:
            images: of a flight.
            files: to be checked.
        """
        return {"images": images, "files": files}

    made = argparse.ArgumentParser()
    add_flags(made, check, positional={"images": "DIR", "files": "FILE"})
    assert call(check, made.parse_args(["a", "b", "c"])) == {"images": "a", "files": ["b", "c"]}


@pytest.mark.parametrize("words", ["a b --day 2026-05-01", "a --day 2026-05-01 b", "--day 2026-05-01 a b"])
def test_what_may_be_left_out_may_stand_after_a_flag(words: str) -> None:
    def check(images: Folder, file: Folder | None = None, *, day: date | None = None) -> None:
        """Check.

        Args:
            images: of a flight.
            file: to be checked.
            day: of the flight.
        """

    made = Parser()
    add_flags(made, check, positional={"images": "DIR", "file": "FILE"})
    found = made.parse_args(words.split())
    assert (found.images, found.file, found.day) == ("a", "b", date(2026, 5, 1))
    assert made.parse_args(["a", "--day", "2026-05-01"]).file is None


def test_a_flag_may_take_all_its_values_or_none() -> None:
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_flags(parser, fly, positional={"folders": "DIR"}, listed=("tags",))
    for words, taken in ((["a"], None), (["a", "--tags"], []), (["a", "--tags", "b", "c"], ["b", "c"])):
        assert parser.parse_args(words).tags == taken


class Machine(Struct, frozen=True):
    """What flies."""

    name: str

    @classmethod
    def named(cls, called: str = "nobody") -> Machine:
        """Name one.

        Args:
            called: its name.
        """
        return cls(called)

    def greet(self, words: Sequence[str]) -> str:
        """Greet it.

        Args:
            words: what is said.
        """
        return " ".join([*words, self.name])


def test_a_method_is_a_job_too() -> None:
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_flags(parser, Machine.named)
    add_flags(parser, Machine.greet, positional={"words": "WORD"})
    arguments = parser.parse_args(["good", "day", "--called", "P4R"])
    assert call(call(Machine.named, arguments).greet, arguments) == "good day P4R"
