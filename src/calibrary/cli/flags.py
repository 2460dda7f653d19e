"""Flags of a command from the signature of the job that it calls.

>>> def shrink(images: Sequence[Folder], *, factor: Annotated[float, Meta(gt=0, le=1)] = 0.5, force: bool = False):
...     '''Make images smaller.
...
...     Args:
...         images: images, or folders of them.
...         factor: new width divided by the old one.
...         force: replace existing files.
...     '''
>>> add_flags(parser, shrink, positional={"images": "IMAGE"})
>>> call(shrink, parser.parse_args(["flight", "--factor", "0.25"]))

The signature is the one declaration of a flag:

* a parameter is a flag of that name, its default is the default, its line under ``Args:`` is the help;
* the annotation gives the accepted values: ``Literal`` the words, ``Annotated[float, Meta(ge=…, le=…)]`` the bounds,
  ``bool`` a switch, ``bool | Literal`` one that may have a word, ``Sequence[T]`` a flag that may be given several
  times, ``Literal | Sequence[T]`` a word or values
  with commas between, ``Mapping[str, str]`` NAME=VALUE;
  ``Meta(title="DIR")`` names the value in the help text (:mod:`calibrary.arguments` has the usual ones), and a unit at
  the end of a parameter's name does so by itself;
* a parameter that is a struct (:class:`~calibrary.arguments.Reading`, :class:`~calibrary.known_camera.CameraKey`, …) is
  a group of flags, one for each field, with the lines under ``Attributes:`` as help and the first line as its title.

A command adds only what a signature cannot state: which parameters are positional, the groups of the help text, another
spelling, what excludes what. **A new flag is a new parameter of the job with its line under Args:**, nothing else.

This module loads no heavy library: a job's package must declare its parameters with types that load none either.
"""

from __future__ import annotations

import argparse
import inspect
import math
import re
import types
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import date
from functools import cache, partial
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

from calibrary.image_size import ImageSize

T = TypeVar("T")

UNSHOWN: Final[tuple[object, ...]] = (
    None,
    False,
    "",
    (),
    inspect.Parameter.empty,
    msgspec.NODEFAULT,
    msgspec.UNSET,
)
"""Defaults that the help text does not print."""

SUPPLIED: Final = ("progress",)
"""Parameters that a command supplies by itself."""

UNITS: Final = {
    name: name.upper() for name in ("mm", "px", "m", "deg", "pct", "mib", "s", "ms", "minutes", "months")
}


class _Flag(NamedTuple):
    """One parameter of a job, or one field of a struct that is a parameter."""

    name: str
    hint: Any
    default: Any
    text: str
    group: str | None


class _Value(NamedTuple):
    """How argparse reads the values of an annotation."""

    settings: Mapping[str, Any]
    repeats: bool = False


def add_flags(  # noqa: PLR0913  one for each thing that a signature cannot say
    parser: argparse.ArgumentParser,
    job: Callable[..., Any],
    *,
    positional: Mapping[str, str] | None = None,
    groups: Mapping[str, Sequence[str]] | None = None,
    spelled: Mapping[str, str | tuple[str, ...]] | None = None,
    exclusive: Sequence[Sequence[str]] = (),
    without: Collection[str] = (),
    required: Collection[str] = (),
    optional: Collection[str] = (),
    listed: Collection[str] = (),
    bare: Mapping[str, str] | None = None,
) -> None:
    """Declare a flag for every parameter of a job.

    Args:
        parser: of the command.
        job: the function; a method if the command supplies its object.
        positional: names of the values in the help text, by parameter, in order. If two could take several values,
            only the last does, for the command line cannot tell where those of the first end.
        groups: parameters by the title of their group in the help text; the others come first, without a title, and
            the fields of a struct in the struct's own group.
        spelled: flags of parameters that are not spelled like them, with aliases after the first.
        exclusive: sets of parameters of which one at most may be given.
        without: parameters, or fields of structs, that the command supplies by itself.
        required: parameters with a default that the command line requires all the same.
        optional: parameters that may be left out, because the command then calls another job.
        listed: parameters of several values, whose flag takes them all: ``--fields``, ``--fields K distortion``.
        bare: parameters whose flag may stand without a value, and the value that it then has.
    """
    positional, spelled, bare = positional or {}, spelled or {}, bare or {}
    first = {name: said if isinstance(said, str) else said[0] for name, said in spelled.items()}
    called = {**positional, **first}
    flags = {one.name: one for one in _flags(job, called, frozenset({*SUPPLIED, *without}))}
    flags |= {name: flags[name]._replace(default=None) for name in optional}
    titles = {name: title for title, names in (groups or {}).items() for name in names}
    named = (positional, spelled, titles, required, listed, bare, *exclusive)
    if unknown := {name for names in named for name in names} - set(flags):
        raise TypeError(f"{job.__qualname__} has no parameter {', '.join(sorted(unknown))}")
    several = [name for name in positional if _value(flags[name]).repeats]
    for name, shown in positional.items():
        _add_positional(parser, flags.pop(name), shown, repeats=name in several[-1:])
    among: dict[str, argparse._MutuallyExclusiveGroup] = {}
    for flag in sorted(flags.values(), key=lambda one: _order(one, titles)):
        if any(flag.name == action.dest for action in parser._actions):
            continue  # two jobs of one command, or two structs, share it
        place: argparse._ActionsContainer = help_group(parser, titles.get(flag.name, flag.group))
        for names in exclusive:
            if flag.name in names:
                if names[0] not in among:  # an empty group would break the help text
                    among[names[0]] = place.add_mutually_exclusive_group()
                place = among[names[0]]
        said = spelled.get(flag.name, ())
        strings = [said] if isinstance(said, str) else list(said) or [_spelled(flag.name)]
        settings = _settings(flag, required=flag.name in required)
        if flag.name in listed:
            settings |= {"action": "extend", "nargs": "*"}
        if flag.name in bare:
            meant = bare[flag.name]
            settings |= {"nargs": "?", "const": meant, "help": f"{settings['help']} (alone: {meant})"}
        _completed(place.add_argument(*strings, dest=flag.name, **settings), flag)


def _order(flag: _Flag, titles: Mapping[str, str]) -> tuple[int, int]:
    """Parameters without a group come first, then the groups as the command lists them, then those of structs."""
    if flag.name in titles:
        return 1, list(titles).index(flag.name)
    return (0 if flag.group is None else 2), 0


def call(
    job: Callable[..., T], arguments: argparse.Namespace, always: Collection[str] = (), **given: Any
) -> T:
    """Call a job with what the user gave; ``given`` has the parameters that the command supplies.

    A parameter that the user did not give is left to the job's default; a struct that is ``always`` passed has its own.
    """
    said = {}
    for name, hint in _hints(job, frozenset({*SUPPLIED, *given})).items():
        struct = _struct(hint)
        value = (
            _struct_value(struct, arguments) if struct is not None else _given_value(arguments, name, hint)
        )
        if value is None and struct is not None and name in always:
            value = struct()
        if value is not None:
            said[name] = value
    return job(**said, **given)


def image_size(text: str) -> ImageSize:
    """Parse "5472x3648" to (width, height)."""
    width, _, height = text.lower().replace("×", "x").partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) > 0 and int(height) > 0):
        raise argparse.ArgumentTypeError(f"{text!r}: expected WxH in whole pixels, such as 5472x3648")
    return int(width), int(height)


def _struct_value(struct: type[msgspec.Struct], arguments: argparse.Namespace) -> msgspec.Struct | None:
    """The struct with what the user gave; None if nothing was given."""
    hints = get_type_hints(struct, include_extras=True)
    found = {name: _given_value(arguments, name, hints[name]) for name in struct.__struct_fields__}
    given = {name: value for name, value in found.items() if value is not None and value is not False}
    return struct(**given) if given else None


def _given_value(arguments: argparse.Namespace, name: str, hint: Any) -> Any:
    """What the user gave for a parameter; None for nothing."""
    value = getattr(arguments, name, None)
    return dict(value) if value is not None and get_origin(_bare(hint)) is Mapping else value


def _add_positional(parser: argparse.ArgumentParser, flag: _Flag, shown: str, *, repeats: bool) -> None:
    value, is_required = _value(flag), flag.default is inspect.Parameter.empty
    settings: dict[str, Any] = {
        key: given for key, given in value.settings.items() if key not in {"metavar", "action"}
    }
    if repeats:
        settings["nargs"] = "+" if is_required else "*"
    elif not is_required:
        settings["nargs"] = "?"
    _completed(parser.add_argument(flag.name, metavar=shown, help=_help(flag), **settings), flag)


def _completed(action: argparse.Action, flag: _Flag) -> None:
    """Note which parameter an argument is, and for shell completion whether it is a path or one of some words."""
    action.parameter = flag.name  # type: ignore[attr-defined]  # argparse keeps what it does not know
    parts = _leaves(flag.hint)
    if Path in parts:
        action.completes_path = True  # type: ignore[attr-defined]  # argparse keeps what it does not know
    if action.choices is None and (words := [one for one in parts if isinstance(one, str)]):
        action.completes_words = words  # type: ignore[attr-defined]


def _leaves(hint: Any) -> list[Any]:
    """The types and words of an annotation."""
    inner = get_args(hint)
    if hasattr(hint, "__metadata__"):
        return _leaves(inner[0])
    return [leaf for part in inner for leaf in _leaves(part)] if inner else [hint]


def _settings(flag: _Flag, *, required: bool) -> dict[str, Any]:
    if flag.hint is bool:
        if flag.default is True:
            raise TypeError(f"{flag.name}: a switch is off by default; name it for what it does when given")
        return {"action": "store_true", "help": _help(flag)}
    needed = required or flag.default in {inspect.Parameter.empty, msgspec.NODEFAULT}
    # The default stays the job's: None means "not given", so that another default of the job cannot be overruled.
    return {**_value(flag).settings, "default": None, "help": _help(flag), "required": needed}


def _help(flag: _Flag) -> str:
    shown = getattr(flag.default, "name", flag.default)
    if shown in UNSHOWN or "default" in flag.text or flag.hint is bool:
        return flag.text.replace("%", "%%")
    text = "x".join(map(str, shown)) if isinstance(shown, tuple) else f"{shown}"
    return f"{flag.text} (default: {text})".replace("%", "%%")


def _spelled(name: str) -> str:
    return "--" + name.strip("_").replace("_", "-")


def help_group(parser: argparse.ArgumentParser, title: str | None) -> argparse._ActionsContainer:
    """Return the group of flags with a title, made if there is none yet; the parser for no title."""
    if title is None:
        return parser
    for group in parser._action_groups:
        if group.title == title:
            return group
    return parser.add_argument_group(title)


@cache
def _hints(job: Callable[..., Any], without: frozenset[str]) -> dict[str, Any]:
    """The annotations of the parameters but some; that of the result, which may load much, is left alone."""
    function = inspect.unwrap(getattr(job, "__func__", job))
    names = [name for name in inspect.signature(function).parameters if name not in {"self", "cls"}]
    stated = {name: function.__annotations__[name] for name in names if name not in without}
    return get_type_hints(
        types.SimpleNamespace(__annotations__=stated), function.__globals__, include_extras=True
    )


def _flags(job: Callable[..., Any], called: Mapping[str, str], without: frozenset[str]) -> Iterator[_Flag]:
    """The flags of a job; ``called`` are the words for parameters that are not spelled like their flags."""
    told, parameters = _help_texts(inspect.getdoc(job), "Args", called), inspect.signature(job).parameters
    for name, hint in _hints(job, without).items():
        struct = _struct(hint)
        if struct is None:
            if name not in told:
                raise TypeError(f"{job.__qualname__} says nothing of {name} under Args:")
            yield _Flag(name, _bare(hint), parameters[name].default, told[name], None)
            continue
        title = (inspect.getdoc(struct) or "").partition("\n")[0].partition(". ")[0].rstrip(".")
        fields, said = (
            get_type_hints(struct, include_extras=True),
            _help_texts(inspect.getdoc(struct), "Attributes", called),
        )
        for field in msgspec.structs.fields(struct):
            if field.name not in without:
                default = (
                    field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
                )
                group = title[:1].lower() + title[1:]
                yield _Flag(field.name, _bare(fields[field.name]), default, said[field.name], group)


def _help_texts(doc: str | None, section: str, called: Mapping[str, str]) -> dict[str, str]:
    """The sentences of a Google docstring's section, as help texts: without mark-up, with flags for parameters."""
    body = (doc or "").partition(f"{section}:\n")[2].partition("\n\n")[0]
    found = re.findall(r"^ {4}(\w+(?:, \w+)*): (.+(?:\n {8}.+)*)", body, re.MULTILINE)
    texts = {name: " ".join(text.split()).rstrip(".") for names, text in found for name in names.split(", ")}

    def shown(mark: re.Match[str]) -> str:
        return called.get(mark[1], _spelled(mark[1])) if mark[1] in texts else mark[1]

    plain = {name: re.sub(r":\w+:`~?\.?([^`]+)`", r"\1", text) for name, text in texts.items()}
    return {name: re.sub(r"``(\w[^`]*)``", shown, text).replace("``", "") for name, text in plain.items()}


def _bare(hint: Any) -> Any:
    """An annotation without None: what is given if anything is."""
    if not (isinstance(hint, types.UnionType) or get_origin(hint) is Union):
        return hint
    parts = [part for part in get_args(hint) if part is not type(None)]
    return parts[0] if len(parts) == 1 else Union[tuple(parts)]  # noqa: UP007  of parts that are known now


def _struct(hint: Any) -> type[msgspec.Struct] | None:
    """The struct that an annotation admits, unless it names a plain value by ``Meta(title=…)``."""
    bare = _bare(hint)
    parts = get_args(bare) if get_origin(bare) is Union else (bare,)
    for part in parts:
        if isinstance(part, type) and issubclass(part, msgspec.Struct):
            return part
    return None


def _value(flag: _Flag) -> _Value:
    shown = UNITS.get(flag.name.rpartition("_")[2]) if "_" in flag.name else None
    value = _of(flag.hint)
    if shown and not value.repeats and value.settings.get("metavar") in {"N", "X"}:
        return _Value({**value.settings, "metavar": shown})
    return value


def _of(hint: Any) -> _Value:  # noqa: PLR0911  one return for each kind of annotation
    hint, meta = (get_args(hint)[0], hint.__metadata__[0]) if hasattr(hint, "__metadata__") else (hint, None)
    title = meta.title if meta is not None else None
    if get_origin(hint) is Literal:
        return _Value({"choices": get_args(hint)})
    if hint == ImageSize:
        return _Value({"type": image_size, "metavar": "WxH"})
    if hint is date:
        return _Value({"type": day, "metavar": "DATE"})
    if hint in {int, float}:
        metavar = title or {int: "N", float: "X"}[hint]
        return _Value({"type": partial(_number, hint, meta or msgspec.Meta()), "metavar": metavar})
    if get_origin(hint) in {Sequence, tuple, Collection}:
        inner = _of(_bare(get_args(hint)[0])).settings
        return _Value({**inner, "action": "append", **({"metavar": title} if title else {})}, repeats=True)
    if get_origin(hint) is Mapping:
        return _Value({"action": "append", "type": _pair, "metavar": title or "NAME=VALUE"}, repeats=True)
    if isinstance(hint, types.UnionType) or get_origin(hint) is Union:
        return _any_of(get_args(hint), title)
    if hasattr(hint, "parse"):  # a type that reads itself from text, such as a range of firmware
        return _Value({"type": partial(_parsed, hint), "metavar": title or "TEXT"})
    return _Value(
        {"type": hint if hint is Path else str, "metavar": title or ("FILE" if hint is Path else "NAME")}
    )


def _any_of(parts: Sequence[Any], title: str | None) -> _Value:
    """Words or another value; several values or one of them; text or what it names."""
    words = [word for part in parts if get_origin(part) is Literal for word in get_args(part)]
    rest = [part for part in parts if get_origin(part) is not Literal]
    if words and rest == [bool]:
        return _Value({"nargs": "?", "const": True, "choices": words})
    for part in rest:
        if get_origin(part) in {Sequence, tuple} and part != ImageSize:
            inner = _of(part).settings
            if not words:
                return _of(part)
            shown = title or "|".join([*words, f"{inner['metavar']},…"])
            several = partial(_several, inner["type"])
            return _Value({"type": partial(_word_or, words, several), "metavar": shown})
    if not words:
        return _Value(
            {"type": str, "metavar": title or "NAME"} if str in rest else dict(_of(rest[0]).settings)
        )
    inner = _of(rest[0]).settings
    shown = title or "|".join([*words, str(inner["metavar"])])
    return _Value({"type": partial(_word_or, words, inner["type"]), "metavar": shown})


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"{text!r}: expected NAME=VALUE")
    return name, value


def _word_or(words: Sequence[str], otherwise: Callable[[str], Any], text: str) -> Any:
    return text if text in words else otherwise(text)


def _several(each: Callable[[str], Any], text: str) -> tuple[Any, ...]:
    return tuple(dict.fromkeys(each(part) for part in text.split(",")))


def _parsed(kind: Any, text: str) -> Any:
    from calibrary.errors import InputError

    try:
        return kind.parse(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from None


def day(text: str) -> date:
    """Parse "2026-05-01"."""
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a day such as 2026-05-01") from None


def _number(kind: type, meta: msgspec.Meta, text: str) -> Any:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    low, high = (meta.ge if meta.ge is not None else meta.gt), (meta.le if meta.le is not None else meta.lt)
    inside = (
        math.isfinite(value)
        and (meta.ge is None or value >= meta.ge)
        and (meta.gt is None or value > meta.gt)
        and (meta.le is None or value <= meta.le)
        and (meta.lt is None or value < meta.lt)
    )
    if not inside or (kind is int and value % 1):
        what = "a whole number" if kind is int else "a number"
        more = " more than" if meta.gt is not None else " from" if low is not None else ""
        bounds = f"{more} {low:g}" if low is not None else ""
        bounds += f"{' to' if low is not None else ' up to'} {high:g}" if high is not None else ""
        raise argparse.ArgumentTypeError(f"{text!r}: expected {what}{bounds}")
    return kind(value)
