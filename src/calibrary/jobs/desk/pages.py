"""The desk's pages: each asks a job and shows what it says, with the command that says the same in a terminal."""

from __future__ import annotations

import shlex
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import date
from importlib import resources
from pathlib import Path, PurePosixPath
from typing import Final
from urllib.parse import parse_qsl, quote, urlencode

import numpy as np
from msgspec import Struct
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from calibrary.calibration import Calibration, CameraKey
from calibrary.catalogue import search_catalogue
from calibrary.errors import (
    AmbiguousCameraError,
    CalibraryError,
    InputError,
    RegistryError,
    UnknownCameraError,
)
from calibrary.jobs.desk import boards, comparing, flights, onboarding
from calibrary.jobs.desk.flights import Drop
from calibrary.jobs.desk.guard import Keys
from calibrary.jobs.desk.review import decided, decision, proposal, queue, retirement_form
from calibrary.jobs.desk.running import REPORT, SAME, desk_page, running
from calibrary.jobs.desk.work import PATIENCE_S, Job, Jobs
from calibrary.jobs.extract.targets import colmap_flags
from calibrary.jobs.fleet import Fleet
from calibrary.jobs.resolve.run import FleetAnswer
from calibrary.jobs.resolve.told import told as told_answer
from calibrary.jobs.resolve.told import use_blocks, use_said
from calibrary.jobs.site.camera_page import (
    STATUSES,
    Download,
    camera_page,
    download_blocks,
    downloads,
    files_of,
    step_page,
    steps,
)
from calibrary.jobs.site.folder import INDEX, Place
from calibrary.known_camera import KnownCamera
from calibrary.pages import Frame, render_page, served_policy
from calibrary.pages.wording import cut_table, visible
from calibrary.records import replace
from calibrary.registry.history import of_path
from calibrary.registry.paths import PROPOSED, ROOT, SUFFIX, id_of
from calibrary.registry.snapshot import Snapshot
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Code,
    Column,
    Details,
    Field,
    Form,
    Link,
    Note,
    Section,
    Tone,
    View,
)

WAYS: Final = (
    Link("Look up", "/"),
    Link("Check a flight", "/flight"),
    Link("Onboard", "/onboard"),
    Link("Boards", "/boards"),
    Link("Compare", "/compare"),
    Link("Review", "/review"),
)
WRITING_S: Final = 30.0
"""Time for a decision, of which a signature by a key that asks somebody takes most."""
SYNCING_S: Final = 180.0
SCRIPT: Final = "/desk.js"
MOST_ENTRIES: Final = 200
PROGRAMS: Final = {
    "COLMAP": "colmap_text",
    "ODM and WebODM": "odm_cameras",
    "OpenSfM": "opensfm",
    "Metashape": "agisoft_xml",
    "Pix4D": "pix4d_cam",
    "RealityScan": "realitycapture_csv",
    "OpenCV": "opencv_storage",
    "ROS": "ros_camera_info",
    "nerfstudio": "transforms_json",
}
"""Format that each program reads."""
IMAGES: Final = 2
"""Most files of a form; what is more is dropped, and read by its ranges."""


class Asked(Struct, frozen=True, kw_only=True):
    """What a request asks: the parts of its address, its fields, and where the desk and the page that answers are."""

    path: Mapping[str, str]
    fields: Mapping[str, object]
    is_form: bool = False
    home: str = ""
    at: str = ""

    @property
    def texts(self) -> dict[str, str]:
        """The fields that are texts and not empty, without the spaces around them; not the proof of a form."""
        found = {name: text.strip() for name, text in self.fields.items() if isinstance(text, str)}
        return {name: text for name, text in found.items() if text and name != "token"}

    def text(self, name: str) -> str:
        """A field of these; empty if it is not there."""
        return self.texts.get(name, "")

    def day(self, name: str) -> date | None:
        """A day; None if none is stated.

        Raises:
            InputError: it is none.
        """
        text = self.text(name)
        try:
            return date.fromisoformat(text) if text else None
        except ValueError:
            raise InputError(f"{text!r:.40} is no day; expected one such as 2026-05-01") from None


Made = Callable[[Asked], View | Response]
Command = Callable[[Path, Path, Mapping[str, str]], tuple[list[str], str]]
"""Makes the words of a command, and a title, from the registry, a folder for results and the fields of a form."""
COMMANDS: Final[Mapping[str, Command]] = {
    "flight": flights.command,
    "onboard": onboarding.command,
    "boards": boards.command,
}
"""What is done with files that are dropped."""
RESULTS: Final[Mapping[str, Callable[[Job, str, Drop | None], View]]] = {
    "extract": flights.checked,
    "onboard": onboarding.decided,
    "calibrate": boards.solved,
}
"""Pages of commands that are over, by their first word."""


class Pages:
    """The pages of one registry.

    Attributes:
        app: answers requests that the guard lets through.
    """

    def __init__(self, registry: Path, keys: Keys, scratch: Path) -> None:
        self._place, self._keys, self._scratch = registry, keys, scratch
        self._jobs, self._drops = Jobs(scratch), dict[str, Drop]()
        self._frame = Frame(ways=WAYS, script=SCRIPT, token=keys.form)
        self.app = Starlette(
            routes=[
                self._route("/", self._look_up),
                self._route("/look", self._look_at, "POST"),
                self._route("/k/{format}", self._file_of_answer),
                self._route("/cameras/{stem:path}.html", self._camera),
                self._route("/changes/{stem:path}/{name}.html", self._change),
                self._route("/files/{stem:path}/{name}", self._file),
                self._route("/flight", lambda _: flights.questions()),
                self._route("/flight", self._begin(flights.command), "POST"),
                self._route("/onboard", lambda _: onboarding.questions()),
                self._route("/onboard", self._begin(onboarding.command), "POST"),
                self._route("/boards", lambda _: boards.questions()),
                self._route("/boards", self._begin(boards.command), "POST"),
                self._route("/boards/print", self._board),
                self._route("/boards/watch", self._begin(boards.watching), "POST"),
                self._route("/propose", self._propose, "POST"),
                self._raw("/{job}/drop", self._begin_drop),
                self._raw("/{job}/drop/{id}", self._drop),
                self._raw("/{job}/drop/{id}/end", self._end_drop),
                self._raw("/{job}/drop/{id}/stop", self._forget_drop),
                self._route("/job/{id}", self._job),
                self._route("/job/{id}/state", self._state),
                self._route("/job/{id}/stop", self._stop, "POST"),
                self._route("/job/{id}/all.zip", self._archive),
                self._route(f"/job/{{id}}/{REPORT}", self._report),
                self._route("/compare", self._compare, "GET", "POST"),
                self._route("/compare/since", self._begin(comparing.since), "POST"),
                self._route("/compare/flights", self._begin(comparing.through_flights), "POST"),
                self._route("/review", self._review),
                self._route("/review/one", self._proposal),
                self._route("/decide", self._decide, "POST"),
                self._route("/sync", self._sync, "POST"),
                self._route(f"/{INDEX}", lambda _: RedirectResponse("/")),
                self._route(SCRIPT, _script),
            ],
            exception_handlers={404: self._nothing, 500: self._bug},
        )

    def warm(self) -> None:
        """Read the registry, and load what its first page and that of a camera need."""
        # What fails here fails again for the page, which says so; or the desk is being closed.
        with suppress(Exception):
            self._shown(self._look_up, Asked(path={}, fields={}))
            stem = next(iter(self._fleet.snapshot.paths)).removeprefix(ROOT).removesuffix(SUFFIX)
            self._shown(self._camera, Asked(path={"stem": stem}, fields={}))

    def close(self) -> None:
        """End what still runs."""
        self._jobs.close()

    async def _nothing(self, _: Request, __: Exception) -> Response:
        return self._page(_problem("The desk has no page of this address."), 404)

    async def _bug(self, _: Request, error: Exception) -> Response:
        told = f"This is a bug: {type(error).__name__}: {error}. Nothing was half written."
        return self._page(_problem(told), 500)

    def _route(self, address: str, make: Made, *methods: str) -> Route:
        async def answered(request: Request) -> Response:
            if request.method != "POST":
                return await self._answer(make, request, request.query_params)
            async with request.form(max_files=IMAGES, max_fields=50) as form:
                token = form.get("token")
                is_proven = "desk_token" in request.scope or (
                    isinstance(token, str) and Keys.fits(token, self._keys.form)
                )
                if not is_proven:
                    return self._page(_problem("This page is of an earlier desk; open it again."), 403)
                return await self._answer(make, request, form)

        endpoint: Callable[[Request], Awaitable[Response]] = answered
        return Route(address, endpoint, methods=[*methods] or ["GET"])

    def _raw(self, address: str, make: Callable[[Mapping[str, str], bytes], object]) -> Route:
        """What the page's script sends, which proves itself by a header, and gets JSON."""

        async def answered(request: Request) -> Response:
            if "desk_token" not in request.scope:
                told = "This needs the page's script. Without it, state the path of the folder instead."
                return self._page(_problem(told), 400)
            body = await request.body()
            try:
                made = await run_in_threadpool(make, request.path_params, body)
            except CalibraryError as error:
                return PlainTextResponse(str(error), 400)
            return JSONResponse(made)

        endpoint: Callable[[Request], Awaitable[Response]] = answered
        return Route(address, endpoint, methods=["POST"])

    async def _answer(self, make: Made, request: Request, fields: Mapping[str, object]) -> Response:
        home, is_form = str(request.base_url), request.method == "POST"
        asked = Asked(
            path=request.path_params, fields=fields, is_form=is_form, home=home, at=request.url.path
        )
        return await run_in_threadpool(self._shown, make, asked)

    def _shown(self, make: Made, asked: Asked) -> Response:
        try:
            made = make(asked)
        except CalibraryError as error:
            return self._page(
                _problem(str(error)), 409 if isinstance(error, RegistryError) else 400, at=asked.at
            )
        return self._page(made, at=asked.at) if isinstance(made, View) else made

    def _page(self, page: View, code: int = 200, *, at: str = "") -> Response:
        headers = {"content-security-policy": served_policy()}
        return HTMLResponse(render_page(page, frame=self._frame, at=at), code, headers=headers)

    @property
    def _fleet(self) -> Fleet:
        """The registry as it is now; a page is of one state."""
        return Fleet(self._place)

    def _command(self, *words: str) -> Code:
        """The command that does the same, of this registry."""
        text = shlex.join(["calibrary", *words, "--registry", str(self._place)])
        return Code(text=text, label=SAME)

    def _about(self, fleet: Fleet) -> str:
        return f"The registry {self._place.name}, at commit {(fleet.commit or '')[:12]}."

    def _look_up(self, asked: Asked) -> View:
        fleet, words, stated = self._fleet, asked.text("q"), _stated(asked)
        answers: list[Section] = []
        if words or stated != CameraKey():
            answers = [*self._found(fleet, words, stated, asked.day("on"))]
        listing = fleet.listing(words.split())
        rows = [
            (
                Link(stored.id, f"/{_place(stored.path).page}"),
                Badge(stored.entry.status.value, STATUSES[stored.entry.status]),
                f"{stored.entry.calibration.intrinsics.fx:.2f}",
                stored.entry.label or "–",
                stored.entry.calibration.grade.value,
            )
            for stored in listing.entries
        ]
        columns = (
            Column("camera"),
            Column("status"),
            Column("fx (px)", numeric=True),
            Column("label"),
            Column("grade"),
        )
        blocks: list[Block] = [*(Note(text=str(one), tone=Tone.BAD) for one in listing.unreadable)]
        if rows:
            caption = "Cameras with these words in their name or label" if words else "Every camera"
            blocks += cut_table(
                caption, columns, rows, most=MOST_ENTRIES, rest="the registry; more words find them"
            )
        elif words and (known := search_catalogue(words)):
            answers.append(_known(known))
        elif not answers:
            blocks += ["The registry contains no camera yet.", Link("Onboard what came with one", "/onboard")]
        return desk_page(
            title="Which K do I use?",
            lead=self._about(fleet),
            sections=(
                *answers,
                Section(title="Which camera?", blocks=tuple(_questions(words, asked.text("on")))),
                *((Section(title="Cameras", blocks=tuple(blocks)),) if blocks else ()),
            ),
        )

    def _found(self, fleet: Fleet, words: str, stated: CameraKey, day: date | None) -> Iterator[Section]:
        """The answer to words or a stated camera, or why there is not one."""
        try:
            answer = fleet.resolve(words or None, stated=stated, on=day)
        except (UnknownCameraError, AmbiguousCameraError) as error:
            # Words that are no KEY may still be part of the name of one camera.
            [*fits] = fleet.listing(words.split()).chosen.paths if words else ()
            if len(fits) != 1:
                action = "look at those below" if fits else None
                yield Section(
                    title="Not one camera", blocks=(Note(text=str(error), action=action, tone=Tone.CAUTION),)
                )
                return
            words = id_of(fits[0])
            answer = fleet.resolve(words, stated=stated, on=day)
        asked = [words] if words else [*_flags(stated)]
        yield self._answered(answer, ("registry", "resolve", *asked, "--on", answer.on.isoformat()))

    def _answered(self, answer: FleetAnswer, command: tuple[str, ...]) -> Section:
        K, entry = answer.calibration, answer.entry
        section, *near = told_answer(answer).sections
        blocks: list[Block] = [*section.blocks]
        if answer.allowed is not None and K is not None:
            blocks.append(use_said(answer.allowed))
        if K is None:
            blocks += near
        if entry is not None:
            blocks.append(Link(f"All of {entry.id}", f"/{_place(entry.path).page}"))
        if K is not None:
            query = urlencode({**_query(answer.camera), "on": answer.on.isoformat()})
            programs = (*_for_programs(files_of(K), query), *_program_flags(K))
            blocks += [
                Link("The address of this answer, to send on", f"/?{query}"),
                Section(title="For a program", blocks=programs),
            ]
        return replace(section, blocks=(*blocks, self._command(*command)))

    @contextmanager
    def _sent(self, asked: Asked, *names: str) -> Iterator[tuple[dict[str, Path], dict[str, str]]]:
        """The files of a form and what they are called, by the field, for as long as they are read.

        Raises:
            InputError: what is wrong with one, by its own name.
        """
        folder, files, called = Path(tempfile.mkdtemp(dir=self._scratch)), dict[str, Path](), dict[str, str]()
        try:
            for name in names:
                given = asked.fields.get(name)
                if isinstance(given, UploadFile) and given.filename:
                    called[name] = visible(given.filename, 100)
                    # Of a name that anybody can choose only the suffix counts.
                    files[name] = folder / f"{name}{PurePosixPath(given.filename).suffix[:6]}"
                    with files[name].open("wb") as file:
                        shutil.copyfileobj(given.file, file)
            yield files, called
        except CalibraryError as error:
            text = str(error)
            for name, path in files.items():
                text = text.replace(str(path), called[name])
            raise InputError(text) from None
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _look_at(self, asked: Asked) -> View:
        """The answer to one image."""
        fleet = self._fleet
        with self._sent(asked, "image") as (files, called):
            if not files:
                raise InputError("no image was chosen; choose one of the camera's, or drop it there")
            answer, name = fleet.resolve(files["image"]), called["image"]
        found = self._answered(answer, ("registry", "show", name))
        return desk_page(
            title=f"Which K for {name}?",
            lead=f"{answer.camera}, by {answer.known_by}. {self._about(fleet)}",
            sections=(found, Section(title="Another", blocks=tuple(_questions("", "")))),
        )

    def _compare(self, asked: Asked) -> View | Response:
        texts = asked.texts
        if not asked.is_form and "altitude_m" not in texts and not (texts.get("a") and texts.get("b")):
            return comparing.questions(texts)
        try:
            with self._sent(asked, "file_a", "file_b") as (files, called):
                if not files and asked.is_form:
                    return RedirectResponse(f"/compare?{urlencode(texts)}", 303)
                return comparing.compared(self._fleet, self._place, texts, files, called)
        except CalibraryError as error:
            return self._page(comparing.questions(texts, str(error)), 400)

    def _begin(self, command: Command) -> Made:
        """Starts a command that a form asks for, on a path or on what was dropped before."""

        def begun(asked: Asked) -> Response:
            return RedirectResponse(self._started(command, asked.texts), 303)

        return begun

    def _started(self, command: Command, texts: dict[str, str], id_: str | None = None) -> str:
        """Start a command; the address of its page."""
        kept = texts.get("kept")
        drop = self._dropped(kept) if kept else None
        if drop is not None:
            texts["place"] = str(drop.folder)
        id_, folder = (id_, self._jobs.folder_of(id_)) if id_ is not None else self._jobs.folder()
        words, title = command(self._place, folder, texts)
        if drop is not None:
            self._drops[id_], title = drop, title.replace(str(drop.folder), "dropped files")
        started = self._jobs.start(words, title, (id_, folder), at_once="watch" in words[:2])
        return f"/job/{started}"

    def _board(self, asked: Asked) -> Response:
        with tempfile.TemporaryDirectory(dir=self._scratch) as folder:
            path = boards.printed(Path(folder), asked.texts)
            return _attached(path.name, path.read_bytes())

    def _propose(self, asked: Asked) -> Response:
        """Do what a dry run showed."""
        looked = asked.text("job")
        job = self._jobs.get(looked)
        if not job.documents:
            raise InputError("there is nothing to confirm; look at it first")
        id_, folder = self._jobs.folder()
        if looked in self._drops:
            self._drops[id_] = self._drops[looked]
        proposing = boards.proposing if job.words[0] == "calibrate" else onboarding.proposing
        words = proposing(job, folder, asked.texts)
        return RedirectResponse(f"/job/{self._jobs.start(words, job.title, (id_, folder))}", 303)

    def _begin_drop(self, _: Mapping[str, str], body: bytes) -> object:
        id_, folder = self._jobs.folder()
        many, __, whole = body.decode("ascii", "replace").partition(" ")
        self._drops[id_] = Drop(folder, int(many) if many.isdecimal() else 0, whole=whole == "true")
        return {"id": id_}

    def _dropped(self, id_: str) -> Drop:
        if id_ not in self._drops:
            raise InputError("this drop ended with the desk that began it; drop the files again")
        return self._drops[id_]

    def _drop(self, path: Mapping[str, str], body: bytes) -> object:
        drop = self._dropped(path["id"])
        return {"more": drop.take(body), "done": drop.done}

    def _end_drop(self, path: Mapping[str, str], body: bytes) -> object:
        if path["job"] not in COMMANDS:
            raise InputError("what was sent is not what the desk's page sends; reload it")
        texts = dict(parse_qsl(body.decode("utf-8", "replace")))
        return {"page": self._started(COMMANDS[path["job"]], texts | {"kept": path["id"]}, path["id"])}

    def _forget_drop(self, path: Mapping[str, str], _: bytes) -> object:
        drop = self._dropped(path["id"])
        if path["id"] not in self._jobs:
            del self._drops[path["id"]]
            shutil.rmtree(drop.folder.parent, ignore_errors=True)
        return {}

    def _job(self, asked: Asked) -> View:
        id_ = asked.path["id"]
        job, address = self._jobs.get(id_), f"/job/{id_}"
        if job.code is None:
            return running(job, address, boards.so_far(job))
        return RESULTS.get(job.words[0], comparing.reported)(job, address, self._drops.get(id_))

    def _state(self, asked: Asked) -> Response:
        job = self._jobs.get(asked.path["id"])
        done, total, what = job.progress
        found = {"over": job.code is not None, "done": done, "total": total, "what": what}
        return JSONResponse({**found, "news": len(job.documents)})

    def _stop(self, asked: Asked) -> Response:
        job = self._jobs.get(asked.path["id"])
        job.cancel()
        job.wait(PATIENCE_S)
        return RedirectResponse(f"/job/{asked.path['id']}", 303)

    def _report(self, asked: Asked) -> Response:
        file = self._jobs.get(asked.path["id"]).folder / REPORT
        if not file.is_file():
            raise InputError("this has no report")
        # It is a page that stands alone, with a policy of its own in its head.
        return HTMLResponse(file.read_bytes(), headers={"content-security-policy": "frame-ancestors 'none'"})

    def _archive(self, asked: Asked) -> Response:
        headers = {"content-disposition": "attachment; filename=flight.zip"}
        return Response(
            flights.archive(self._jobs.get(asked.path["id"]).folder),
            media_type="application/zip",
            headers=headers,
        )

    def _review(self, asked: Asked) -> View:
        return queue(self._fleet, self._after(asked))

    def _proposal(self, asked: Asked) -> View:
        return proposal(self._fleet, asked.text("key"), self._after(asked))

    def _after(self, asked: Asked) -> tuple[Section, ...]:
        """What came of the decision that led here."""
        return (decided(self._jobs.get(asked.text("after"))),) if asked.text("after") else ()

    def _decide(self, asked: Asked) -> Response:
        fleet, what, key, branch = self._fleet, *(asked.text(name) for name in ("what", "key", "branch"))
        place = _place(fleet.snapshot.get(key).path).page if what == "retire" else None
        shown = f"{key}@{branch}" if branch else f"{key}{PROPOSED}"
        back = f"/{place}?" if place else f"/review/one?{urlencode({'key': shown})}&"
        command = decision(
            what,
            key,
            asked.text("digest"),
            branch=branch,
            reason=asked.text("reason"),
            start=asked.day("start"),
            force=bool(asked.text("force")),
        )
        title = f"{what.capitalize()} {key}"
        done = self._jobs.write([*command, "--registry", str(self._place)], title, WRITING_S)
        is_done = self._jobs.get(done).code == 0 and place is None
        return RedirectResponse(f"/review?after={done}" if is_done else f"{back}after={done}", 303)

    def _sync(self, _: Asked) -> Response:
        words = ["registry", "sync", "--registry", str(self._place)]
        done = self._jobs.write(words, "The exchange with the remote", SYNCING_S)
        return RedirectResponse(f"/review?after={done}", 303)

    def _file_of_answer(self, asked: Asked) -> Response:
        answer = self._fleet.resolve(None, stated=_stated(asked), on=asked.day("on"))
        files = files_of(answer.calibration) if answer.calibration is not None else ()
        return _download(next((one for one in files if one.format == asked.path["format"]), None))

    def _camera(self, asked: Asked) -> View:
        fleet = self._fleet
        snapshot, path = fleet.snapshot, _path(fleet.snapshot, asked.path["stem"])
        stored, id_ = snapshot.get(id_of(path)), id_of(path)
        revisions = of_path(fleet.registry.repo, snapshot.commit or "", path)
        K = stored.entry.calibration
        with np.errstate(all="ignore"):
            page = camera_page(
                stored.entry,
                id_=id_,
                place=_place(path),
                revisions=revisions,
                changes=steps(id_, revisions, snapshot.policy),
                files=downloads(stored.entry, snapshot.read(path)),
                approvals=stored.standing.approvals if stored.standing is not None else (),
                is_proposed=stored.proposal is not None,
            )
        good_for: tuple[Block, ...] = ("It is not in use, so no program gets it from the registry.",)
        decide: tuple[Section, ...] = ()
        if stored.is_pending:
            good_for = (f"It is {snapshot.only_proposed(stored.path).lacks}.",)
        if stored.entry.is_usable:
            good_for = (*use_blocks(fleet.use_of(stored)), *_program_flags(K))
            decide = (Section(title="Decide", blocks=(retirement_form(id_, stored.oid or ""),)),)
        compare = Link("Compare it with another state of it, or a file", f"/compare?{urlencode({'b': id_})}")
        command = self._command("registry", "show", id_)
        use = Section(title="What it is good for", blocks=(*good_for, compare, command))
        first, *others = page.sections
        return replace(page, sections=(*self._after(asked), first, use, *decide, *others))

    def _change(self, asked: Asked) -> View:
        fleet = self._fleet
        path = _path(fleet.snapshot, asked.path["stem"])
        revisions = of_path(fleet.registry.repo, fleet.commit or "", path)
        with np.errstate(all="ignore"):
            for step in steps(id_of(path), revisions, fleet.snapshot.policy):
                if step.name == asked.path["name"]:
                    return step_page(step, id_=id_of(path), place=_place(path))
        raise InputError("there is no such change of this entry; its page lists them")

    def _file(self, asked: Asked) -> Response:
        snapshot = self._fleet.snapshot
        path = _path(snapshot, asked.path["stem"])
        files = downloads(snapshot.get(id_of(path)).entry, snapshot.read(path))
        return _download(next((one for one in files if one.name == asked.path["name"]), None))


def _questions(words: str, day: str) -> Iterator[Block]:
    yield Form(
        to="/",
        button="Look up",
        is_question=True,
        fields=(
            Field(
                name="q",
                label="Camera",
                value=words,
                hint="a part of its name, its label or serial number, or the path of an image",
            ),
            Field(name="on", label="Day of the images", type="date", value=day),
        ),
    )
    yield Form(
        to="/look",
        button="Look up this image",
        fields=(
            Field(name="image", label="Or one image, chosen or dropped here", type="file", required=True),
        ),
    )


def _known(cameras: Sequence[KnownCamera]) -> Section:
    """What the catalogue knows of cameras without an entry."""
    rows = [
        (
            f"{one.make} {one.title}",
            ", ".join(one.models),
            "×".join(map(str, one.native_size or ())) or "–",
            f"{one.focal_mm:g}" if one.focal_mm else "–",
            f"{one.fx_over_w * one.native_size[0]:.0f}" if one.fx_over_w and one.native_size else "–",
        )
        for one in cameras
    ]
    columns = (
        Column("camera"),
        Column("EXIF Model"),
        Column("image (px)", numeric=True),
        Column("focal length (mm)", numeric=True),
        Column("fx about (px)", numeric=True),
    )
    told = "These types are known, but no unit of them has a K in this registry. Onboard one, or check its images."
    return Section(
        title="In the catalogue",
        blocks=(told, *cut_table("Types of camera", columns, rows, most=MOST_ENTRIES, rest="the catalogue")),
    )


def _for_programs(files: Sequence[Download], query: str) -> Iterator[Block]:
    def way(file: Download, _: str = "") -> str:
        return f"/k/{quote(file.format)}?{query}"

    held = {file.format: file for file in files if file.name is not None}
    yield Bullets(tuple(Link(program, way(held[name])) for program, name in PROGRAMS.items() if name in held))
    yield Details(
        summary="Every format, and how exactly each contains it", blocks=tuple(download_blocks(files, way))
    )


def _program_flags(calibration: Calibration) -> Iterator[Block]:
    try:
        text = colmap_flags(calibration.to_colmap())
    except CalibraryError:
        return
    yield Code(text=text, label="The flags of colmap feature_extractor")


def _place(path: str) -> Place:
    return Place.of(path, proper=True)


def _path(snapshot: Snapshot, stem: str) -> str:
    """The entry whose page has this address.

    Raises:
        UnknownCameraError: there is none.
    """
    path = f"{ROOT}{stem}{SUFFIX}"
    if path in snapshot.paths:
        return path
    found = next((one for one in snapshot.paths if _place(one).stem == stem), None)
    if found is None:
        raise UnknownCameraError(f"{stem}: no such camera in the registry; look it up by a part of its name")
    return found


def _query(camera: CameraKey) -> dict[str, str]:
    """A camera as fields of an address."""
    stated = {name: getattr(camera, name) for name in CameraKey.__struct_fields__}
    return {
        name: "{}x{}".format(*value) if name == "image_size" else str(value)
        for name, value in stated.items()
        if value is not None
    }


def _stated(asked: Asked) -> CameraKey:
    """The camera that an address states.

    Raises:
        InputError: a field is no number or size.
    """
    texts = {name: text for name in CameraKey.__struct_fields__ if (text := asked.text(name))}
    size, focal = texts.pop("image_size", None), texts.pop("focal_mm", None)
    try:
        width, height = (int(side) for side in size.split("x")) if size is not None else (0, 0)
        camera = CameraKey(
            **texts,
            image_size=(width, height) if size is not None else None,
            focal_mm=float(focal) if focal is not None else None,
        )
    except ValueError:
        raise InputError(
            "the address is not that of a camera: its image size is not WxH, or its focal length no number"
        ) from None
    return camera


def _flags(camera: CameraKey) -> Iterator[str]:
    for name, value in _query(camera).items():
        yield from (f"--{name.replace('_', '-')}", value)


def _download(file: Download | None) -> Response:
    if file is None or file.name is None:
        raise InputError(file.remark if file is not None else "there is no such file; the page lists them")
    return _attached(file.name, file.data)


def _attached(name: str, data: bytes) -> Response:
    disposition = f"attachment; filename*=UTF-8''{quote(name)}"
    return Response(data, media_type="application/octet-stream", headers={"content-disposition": disposition})


def _script(_: Asked) -> Response:
    text = resources.files("calibrary.jobs.desk").joinpath("desk.js").read_text(encoding="utf-8")
    return Response(text, media_type="text/javascript")


def _problem(text: str, *more: Block) -> View:
    note = Note(
        text=text, tone=Tone.BAD, action=None if more else "nothing was changed; go back and try again"
    )
    return desk_page(
        "Not done", "What was asked for could not be done.", (Section(title="Why", blocks=(note, *more)),)
    )
