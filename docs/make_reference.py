"""The manual's pages that are made from the code, at each build: commands, policies, schemas, catalogue, Python.

They are written below ``docs/reference`` and not kept in git: a flag that is added is in the next manual by itself.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, Final

import calibrary
import calibrary.jobs
from calibrary.catalogue import load_catalogue
from calibrary.cli.main import EPILOG, build_parser, leaves
from calibrary.jobs.extract.targets import TARGETS
from calibrary.known_camera import KnownCamera
from calibrary.policy import POLICIES, Policy
from calibrary.records import fields_json
from calibrary.records.schema import descriptions

__all__ = ["documents", "man_pages", "write_pages"]

SCHEMAS: Final = Path(__file__).parents[1] / "schemas"
MADE: Final = "\n<!-- Made from the code by docs/make_reference.py. -->\n"


def documents() -> dict[str, str]:
    """Every generated page by its path below ``docs``."""
    pages = {
        "reference/commands/index.md": _commands_index(),
        "reference/exit-codes.md": _exit_codes(),
        "reference/hand-off.md": _hand_off(),
        "reference/policies.md": _policies(),
        **_catalogue(),
        "reference/python.md": _python(),
        "reference/python-jobs.md": _python_jobs(),
        "reference/schemas/index.md": _schemas_index(),
    }
    pages |= {f"reference/commands/{_slug(leaf)}.md": _command(leaf) for leaf in leaves(build_parser())}
    pages |= {f"reference/schemas/{name}.md": _schema(document) for name, document in _schema_files().items()}
    return {path: text + MADE for path, text in pages.items()}


def write_pages(folder: Path) -> None:
    """Write the pages that changed, and remove those whose subject is gone."""
    made = documents()
    for below in ("reference/catalogue", "reference/commands", "reference/schemas"):
        for old in (folder / below).glob("*.md"):
            if old.relative_to(folder).as_posix() not in made:
                old.unlink()
    for path, text in made.items():
        file = folder / path
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")


def man_pages(author: str) -> list[tuple[str, str, str, str, int]]:
    """Sphinx's ``man_pages``: a page a command, in section 1."""
    overview = ("reference/commands/index", "calibrary", "the right K for every camera of a fleet", author, 1)
    return [
        overview,
        *(
            (f"reference/commands/{_slug(leaf)}", _slug(leaf), _first_line(leaf), author, 1)
            for leaf in leaves(build_parser())
        ),
    ]


def plain(text: str) -> str:
    """Text in which Markdown finds nothing to do."""
    return re.sub(r"([\\`*_{}\[\]<>|#~$])", r"\\\1", text)


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return (
        "\n".join("| " + " | ".join(cell.replace("\n", " ") for cell in line) + " |" for line in lines) + "\n"
    )


def _slug(leaf: argparse.ArgumentParser) -> str:
    return leaf.prog.replace(" ", "-")


def _first_line(leaf: argparse.ArgumentParser) -> str:
    return (leaf.description or "").strip().split("\n", 1)[0].rstrip(".")


def _commands_index() -> str:
    every = list(leaves(build_parser()))
    rows = [(f"[`{leaf.prog}`]({_slug(leaf)}.md)", plain(_first_line(leaf))) for leaf in every]
    listed = "\n".join(_slug(leaf) for leaf in every)
    return (
        "# Commands\n\nEvery command with all its arguments, as `--help` prints them. "
        "[Exit codes](../exit-codes.md) are the same for all.\n\n"
        + _table(("command", "what it does"), rows)
        + f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
    )


def _command(leaf: argparse.ArgumentParser) -> str:
    formatter = argparse.HelpFormatter(prog=leaf.prog, width=80)
    formatter.add_usage(leaf.usage, leaf._actions, leaf._mutually_exclusive_groups)
    usage = formatter.format_help().rstrip()
    parts = [f"# {leaf.prog}\n\n{plain((leaf.description or '').strip())}\n\n```text\n{usage}\n```\n"]
    for group in leaf._action_groups:
        actions = [a for a in group._group_actions if a.help is not argparse.SUPPRESS]
        if not actions:
            continue
        parts.append(f"## {(group.title or '').capitalize()}\n")
        if group.description:
            parts.append(f"{plain(group.description)}\n")
        parts += [_argument(leaf, action) for action in actions]
    if leaf.epilog:
        examples = leaf.epilog.strip().removeprefix("examples:").strip("\n")
        parts.append(f"## Examples\n\n```text\n{examples}\n```\n")
    return "\n".join(parts)


def _argument(leaf: argparse.ArgumentParser, action: argparse.Action) -> str:
    formatter = leaf._get_formatter()
    called = formatter._format_action_invocation(action)
    said = formatter._expand_help(action) if action.help else ""
    return f"`{called}`\n: {plain(said)}\n"


def _exit_codes() -> str:
    rows = [(code, plain(said)) for code, said in re.findall(r"(?m)^  (\d+)  (.*)$", EPILOG)]
    rows += [
        ("70", "a bug; `CALIBRARY_DEBUG=1` shows where"),
        ("130", "interrupted with Ctrl-C; no file is half written"),
        ("141", "the reader of the output has ended, as in `calibrary … | head`"),
        ("143", "terminated (SIGTERM)"),
    ]
    return (
        "# Exit codes\n\nThe exit codes are the same for every command. The page of a [command](commands/index.md) "
        "states what 0 and 1 mean for it.\n\n"
        + _table(("exit code", "meaning"), rows)
        + "\nResults go to standard output, progress and errors to standard error, so that `--json` can be piped.\n"
    )


def _hand_off() -> str:
    rows = [
        (
            f"`{program}`",
            ", ".join(f"`{name.replace('*', '<camera>')}`" for name in one.reads),
            one.several.replace("``", "`"),
        )
        for program, one in TARGETS.items()
    ]
    return (
        "# Hand-off\n\n`calibrary extract --to PROGRAM` writes what the program reads, for the cameras with a valid K. "
        "[Verdicts](../verdicts.md#what-a-solver-gets) explains what it may do with each.\n\n"
        + _table(("program", "files", "several cameras"), rows)
    )


def _policies() -> str:
    said = descriptions(Policy)
    documents_of = {name: fields_json(policy) for name, policy in POLICIES.items()}
    rows = [
        (
            f"`{field}`",
            *(f"`{json.dumps(documents_of[name][field])}`" for name in POLICIES),
            plain(said.get(field, "")),
        )
        for field in documents_of["fleet"]
        if field not in ("name", "schema")
    ]
    return (
        "# Policies\n\nA policy is a set of limits that K is checked against. `--policy` takes one of the two "
        "that ship with calibrary, or a YAML file that states what differs:\n\n"
        "```yaml\nschema: calibrary/policy-1\nname: survey\nbase: fleet\ndrift_rms_px: 0.3\n```\n\n"
        "Numbers are fractions unless the name says px. [Rules](rules.md) explains what the limits are used for.\n\n"
        + _table(("limit", *POLICIES, "meaning"), rows)
        + "\nThe schema of the file is [policy-1](schemas/policy-1.md).\n"
    )


def _catalogue() -> dict[str, str]:
    """The list of the catalogue, and a page a camera: the manual's search knows titles best."""
    cameras = load_catalogue()
    makers = sorted({known.make for known in cameras}, key=str.casefold)
    parts = [
        f"# Catalogue\n\n{len(cameras)} cameras by {len(makers)} makers, as the data sheets, the makers' tags and "
        "public databases state them; the page of each names them. The catalogue describes types of camera, not the "
        "calibration of a unit. A dash means that no source states it."
    ]
    pages: dict[str, str] = {}
    for make in makers:
        rows: list[tuple[str, ...]] = []
        for names in dict.fromkeys(known.names for known in cameras if known.make == make):
            its = [known for known in cameras if (known.make, known.names) == (make, names)]
            name = re.sub(r"\W+", "-", f"{make} {names[0]} {its[0].sub_camera or ''}".casefold()).strip("-")
            pages[f"reference/catalogue/{name}.md"] = _camera_page(make, its)
            rows += [(f"[{first}](catalogue/{name}.md)", *others) for first, *others in map(_camera, its)]
        parts += [f"## {plain(make)}", _table(SHOWN, rows)]
    return {"reference/catalogue.md": "\n\n".join(parts), **pages}


SHOWN: Final = ("camera", "EXIF Model", "sub-camera", "lens", "image px", "pitch µm", "focal mm", "fx / W")


def _camera_page(make: str, cameras: Sequence[KnownCamera]) -> str:
    name = cameras[0].title if len(cameras) == 1 else cameras[0].title.split(", ")[0]
    models = f" ({', '.join(cameras[0].models)})" if cameras[0].models else ""
    parts = [
        # The manual's search leaves out digits, but takes an entry of the index if half of it was typed.
        f"---\norphan: true\n---\n\n```{{index}} single: {' '.join(name.split()[:2])}\n```\n",
        f"# {plain(f'{name}{models}')}\n",
        f"What the [catalogue](../catalogue.md) knows of this camera by {plain(make)}, before it is calibrated. "
        f"The same in a terminal: `calibrary catalogue {shlex.quote(cameras[0].names[0])}`. Next: [is the K of its "
        "images right?](../../tutorials/check-a-flight.md), or [keep a K of each unit](../../tutorials/keep-a-"
        "registry.md).\n",
        _table(SHOWN, [_camera(known) for known in cameras]),
    ]
    for known in cameras:
        said = [("conflict", text) for text in known.conflicts] + [("note", text) for text in known.notes]
        rows = [(name, plain(text)) for name, text in (*known.sources, *said)]
        parts.append(
            f"## {plain(known.title)}: where its numbers are from\n\n{_table(('value', 'source'), rows)}"
        )
    return "\n".join(parts)


def _camera(known: KnownCamera) -> tuple[str, ...]:
    size = "×".join(map(str, known.native_size)) if known.native_size else "–"
    zoom = known.zoom_mm
    focal = f"{zoom[0]:g}–{zoom[1]:g}" if zoom else _number(known.focal_mm)
    return (
        plain(f"{known.make} {known.title}" if not known.title.startswith(known.make) else known.title),
        plain(", ".join(known.models) or "–"),
        plain(known.sub_camera or ", ".join(known.bands) or "–"),
        plain(known.lens or "–"),
        size,
        _number(known.pitch_um),
        focal,
        _number(known.fx_over_w),
    )


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:g}"


def _python() -> str:
    homes: Mapping[str, tuple[str, ...]] = calibrary._HOMES
    parts = [
        "# Python: the package\n\nThe public names are on `calibrary` itself and are loaded when they are first "
        "used. Functions that fewer callers need are in [the packages of `calibrary.jobs`](python-jobs.md). "
        "Errors are subclasses of `CalibraryError`.\n"
    ]
    functions, classes = [], []
    for module, names in homes.items():
        for name in names:
            value = getattr(import_module(module), name)
            if inspect.isclass(value):
                classes.append(name)
            elif callable(value):
                functions.append(name)
    parts.append("## Functions\n")
    parts += [f"```{{eval-rst}}\n.. autofunction:: calibrary.{name}\n```\n" for name in sorted(functions)]
    parts.append("## Types\n")
    parts += [
        f"```{{eval-rst}}\n.. autoclass:: calibrary.{name}\n   :members:\n```\n" for name in sorted(classes)
    ]
    return "\n".join(parts)


def _python_jobs() -> str:
    parts = [
        "# Python: the jobs\n\nThe commands call these functions, one module for each job. They return values and "
        "raise errors; none prints. Another page lists what is "
        "[public on `calibrary` itself](python.md).\n"
    ]
    for module in _faces():
        said = (inspect.getdoc(module) or "").replace("``", "`")
        said = re.sub(r":[a-z]+:`~?([^`]*)`", r"`\1`", said)
        said = re.sub(
            r"((?:^(?:>>>|\.\.\.).*\n?)(?:.+\n?)*)", r"```python\n\1\n```\n", said, flags=re.MULTILINE
        )
        parts.append(f"## {module.__name__}\n\n{said}\n")
        for public in module.__all__:
            if public in calibrary.__all__:
                continue
            value = getattr(module, public)
            if inspect.isclass(value) and value.__module__ == module.__name__:
                parts.append(
                    f"```{{eval-rst}}\n.. autoclass:: {module.__name__}.{public}\n   :members:\n```\n"
                )
            elif inspect.isfunction(value):
                parts.append(f"```{{eval-rst}}\n.. autofunction:: {module.__name__}.{public}\n```\n")
    return "\n".join(parts)


def _faces() -> list[Any]:
    """The packages that show a job."""
    jobs = [import_module(f"calibrary.jobs.{one.name}") for one in iter_modules(calibrary.jobs.__path__)]
    return [one for one in jobs if hasattr(one, "__all__")]


def _schema_files() -> dict[str, dict[str, Any]]:
    return {
        file.name.removesuffix(".schema.json"): json.loads(file.read_text(encoding="utf-8"))
        for file in sorted(SCHEMAS.glob("*.schema.json"))
    }


def _schemas_index() -> str:
    files = _schema_files()
    rows = [(f"[`{name}`]({name}.md)", plain(document.get("title", ""))) for name, document in files.items()]
    return (
        "# JSON documents\n\nThese are the documents that `--json` prints and the files that calibrary writes. Each "
        "has a JSON Schema (2020-12) in the folder `calibrary/schemas` of the package, and names it: "
        '`"schema": "calibrary/report-1"`. The number at the end changes when a reader of the old form '
        "would misread the new one.\n\n" + _table(("schema", "document"), rows)
    )


def _schema(document: Mapping[str, Any]) -> str:
    name = document["$id"].rpartition(":")[2]
    # Forty entries in the navigation of every page would help nobody: the index has them.
    parts = ["---\norphan: true\n---\n"]
    file = f"{name}.schema.json"
    title = plain(document.get("title", ""))
    parts.append(f"# {name}\n\n{title}. {{download}}`{file} <../../../schemas/{file}>`\n")
    parts.append(_fields(document, name))
    for part, body in document.get("$defs", {}).items():
        parts.append(
            f"(schema-{name}-{part.lower()})=\n\n## {part}\n\n{plain(body.get('title', ''))}\n\n{_fields(body, name)}"
        )
    return "\n".join(parts)


def _fields(body: Mapping[str, Any], schema: str) -> str:
    if "enum" in body:
        return "One of " + ", ".join(f"`{json.dumps(one)}`" for one in body["enum"]) + ".\n"
    properties = body.get("properties")
    if not properties:
        return f"{_kind(body, schema)}\n"
    always = set(body.get("required", ()))
    rows = [
        (
            f"`{name}`",
            _kind(field, schema),
            "always" if name in always else "may be absent",
            plain(field.get("description", "")),
        )
        for name, field in properties.items()
    ]
    return _table(("field", "type", "", "meaning"), rows)


def _kind(field: Mapping[str, Any], schema: str) -> str:
    """The type of a field in words, with links to the parts that it is made of."""
    if "$ref" in field:
        home, _, part = field["$ref"].partition("#/$defs/")
        home = home.rpartition(":")[2] or schema
        return f"[{part or home}](#schema-{home}-{part.lower()})" if part else f"[{home}]({home}.md)"
    for word, joiner in (("anyOf", " or "), ("oneOf", " or ")):
        if word in field:
            return joiner.join(dict.fromkeys(_kind(one, schema) for one in field[word]))
    if "const" in field:
        return f"`{json.dumps(field['const'])}`"
    if "enum" in field:
        return " or ".join(f"`{json.dumps(one)}`" for one in field["enum"])
    kinds = field.get("type", "any value")
    kinds = [kinds] if isinstance(kinds, str) else kinds
    return " or ".join(_simple(kind, field, schema) for kind in kinds)


def _simple(kind: str, field: Mapping[str, Any], schema: str) -> str:
    if kind != "array":
        return kind
    items = field.get("items")
    return f"list of {_kind(items, schema)}" if isinstance(items, dict) else "list"


if __name__ == "__main__":
    write_pages(Path(__file__).parent)
