"""Events, stations and waveforms of FDSN web services, within limits of time and size.

obspy's client knows the services' names and how a request is written; what it would leave open
is bounded here: each answer comes complete, within its time and size, or not at all.
References: FDSN web service specifications, https://www.fdsn.org/webservices/.
"""

import io
import queue
import re
import threading
import time
import urllib.error
import urllib.request
import warnings
from http.client import HTTPException
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from obspy import read_events, read_inventory
from obspy.clients.fdsn import Client
from obspy.clients.fdsn.header import URL_MAPPINGS
from obspy.core.event import Event

from archfrag.errors import InputError

_PIECE = 2**16
_ENCODINGS = {b"utf-8", b"us-ascii", b"iso-8859-1"}
_ENCODING = re.compile(rb"<\?xml[^>]*?\sencoding\s*=\s*[\"']([^\"']*)")
_NOTHING = dict.fromkeys((204, 404), ("no data", "holds nothing that was asked for"))
_MEANING = _NOTHING | {
    413: ("too large", "more was asked for than the service gives at once"),
    **dict.fromkeys((401, 403), ("unusable", "the data are not open to all")),
}


class Limits(NamedTuple):
    """What one answer may take: `seconds` from request to last byte, and `megabytes`."""

    seconds: float = 60.0
    megabytes: float = 100.0


class Refusal(Exception):
    """Why something could not be had.

    `kind` is ``no data``, ``too large``, ``timeout``, ``service`` or ``unusable``; after
    ``timeout`` and ``service`` another attempt may help.
    """

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind
        self.passing = kind in ("timeout", "service")


class _SameServer(urllib.request.HTTPRedirectHandler):
    """Follows an answer that points elsewhere on the same server only."""

    def redirect_request(
        self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str
    ) -> Any:
        if urlsplit(newurl)[:2] != urlsplit(req.full_url)[:2]:
            place, other = req.full_url.split("/query")[0], newurl.split("/query")[0][:100]
            raise Refusal("unusable", f"{place}: points to another server, {other}; name that one")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


class Service(Client):
    """A data centre, by a name that obspy knows or an address: obspy's client within limits."""

    def __init__(self, name: str, limits: Limits) -> None:
        addressed = name.lower().startswith(("http://", "https://"))
        if name.upper() not in URL_MAPPINGS and not addressed:
            known = f"an address (https://...) and {', '.join(sorted(URL_MAPPINGS))}"
            raise InputError(f"{name!r} is no data service that is known; allowed are {known}")
        self.label, self._limits = name, limits
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # on names that change
                super().__init__(name, timeout=limits.seconds, _discover_services=False)
        except ValueError:
            raise InputError(f"{name!r} is not the address of a data service") from None
        self._url_opener = urllib.request.build_opener(_SameServer)

    def event(self, id: str) -> tuple[bytes, Event]:
        """QuakeML of an identifier, and its event."""
        what = f"the answer for event {id}"
        content, quakes = self._parsed("get_events", what, "QuakeML", eventid=id)
        if not quakes:
            raise Refusal("no data", f"{self.label}: holds no event {id}")
        if not quakes[0].origins:
            raise Refusal("unusable", f"{self.label}: {what} has no origin")
        return content, quakes[0]

    def stations(self, what: str, **query: Any) -> tuple[bytes, Any]:
        """StationXML of what is asked for, and its inventory."""
        return self._parsed("get_stations", what, "StationXML", **query)

    def waveforms(self, **query: Any) -> bytes:
        """MiniSEED as the service holds it; nothing of it is interpreted."""
        body = io.BytesIO()
        self.get_waveforms(filename=body, **query)
        return body.getvalue()

    def _parsed(self, method: str, what: str, language: str, **query: Any) -> tuple[bytes, Any]:
        """An answer; what is not of that language or declares entities is refused."""
        body = io.BytesIO()
        getattr(self, method)(filename=body, **query)
        text, place = body.getvalue(), f"{self.label}: {what}"
        stated = _ENCODING.match(text.lower())
        foreign = stated is not None and stated[1] not in _ENCODINGS
        if b"<!DOCTYPE" in text or b"\0" in text[:64] or foreign:
            raise Refusal("unusable", f"{place} is not plain {language}")
        body.seek(0)
        read = read_events if language == "QuakeML" else read_inventory
        try:
            return text, read(body, format=language.upper())
        except Exception:
            hint = f"is {self.label} the address of an FDSN service?"
            raise Refusal("unusable", f"{place} is not {language}; {hint}") from None

    def _download(self, url: str, *_: Any, **__: Any) -> io.BytesIO:
        """Body of an answer with status 200, where obspy's client downloads one."""
        place, seconds = url.split("/query")[0], self._limits.seconds
        late = Refusal("timeout", f"{place}: no complete answer within {seconds:g} s")
        answers: queue.SimpleQueue[bytes | Exception] = queue.SimpleQueue()

        def ask() -> None:
            try:
                answers.put(self._answer(url, place, late))
            except Exception as error:
                answers.put(error)

        # The time is for names, headers and body together: urllib has it for each wait.
        threading.Thread(target=ask, daemon=True).start()
        try:
            answer = answers.get(timeout=seconds)
        except queue.Empty:
            raise late from None
        if isinstance(answer, Exception):
            raise answer
        return io.BytesIO(answer)

    def _answer(self, url: str, place: str, late: Refusal) -> bytes:
        request = urllib.request.Request(url, headers=self.request_headers)
        seconds = self._limits.seconds
        end = time.monotonic() + seconds
        try:
            with self._url_opener.open(request, timeout=seconds) as response:
                status, body = response.status, self._body(response, place, end, late)
        except urllib.error.HTTPError as error:
            with error:
                raise _refused(place, error) from None
        except (OSError, HTTPException) as error:
            reason = getattr(error, "reason", error)
            if isinstance(reason, TimeoutError):
                raise late from None
            words = getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
            raise Refusal("service", f"{place}: the service cannot be reached ({words})") from None
        if status in _NOTHING or not body:
            raise Refusal("no data", f"{place}: {_NOTHING[404][1]}")
        return body

    def _body(self, response: Any, place: str, end: float, late: Refusal) -> bytes:
        most = int(self._limits.megabytes * 1e6)
        stated = response.headers.get("Content-Length") or "0"
        if not stated.isdecimal():
            raise Refusal(
                "service", f"{place}: states {stated[:20]!r} as the length of its answer"
            )
        announced = int(stated)
        body = bytearray()
        while len(body) <= most and announced <= most:
            if time.monotonic() > end:
                raise late
            piece = response.read1(_PIECE)
            body += piece
            if not piece and len(body) < announced:
                reason = f"the answer broke off after {len(body)} of {announced} bytes"
                raise Refusal("service", f"{place}: {reason}")
            if not piece:
                return bytes(body)
        reason = f"the answer is larger than the {self._limits.megabytes:g} MB allowed"
        raise Refusal("too large", f"{place}: {reason}")


def _refused(place: str, error: urllib.error.HTTPError) -> Refusal:
    """What a status means, with the first words of the service's own text."""
    try:
        text = " ".join(error.read1(500).decode("utf-8", "replace").split())
    except (OSError, HTTPException):
        text = ""
    text = ("" if text.startswith("<") else text[:120]) or str(error.reason or "")
    passing = error.code == 429 or error.code >= 500
    kind, reason = _MEANING.get(error.code) or (
        ("service", f"the service answers with error {error.code}") if passing
        else ("unusable", f"the service refuses the request, error {error.code}")
    )  # fmt: skip
    detail = f" ({text})" if text and kind in ("service", "unusable") else ""
    return Refusal(kind, f"{place}: {reason}{detail}")
