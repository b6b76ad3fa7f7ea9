"""The protocol of UM-Bridge over HTTP, with bounds on time and size that the package's own client lacks."""

import importlib
import json
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any
from urllib.parse import urlsplit

from calib.errors import CalibError, nearest

PROTOCOL_VERSION = 1.0  # of UM-Bridge
CONNECTION_TIMEOUT = 10.0  # s, until the server takes a connection
METADATA_TIMEOUT = 30.0  # s, until it answers what it has
RETRY_INTERVAL = 0.5  # s, between attempts to reach a server that is away
MAX_ANSWER_BYTES = 200_000_000  # of one answer
ANSWER_CHUNK_BYTES = 1_000_000  # read at a time
MAX_QUOTED_CHARACTERS = 200  # of an answer, in a reason
PYTHON_NUMBER = re.compile(r"\b(nan|inf)\b")  # the package's server writes Python's numbers, not JSON's
JSON_NUMBERS = {"nan": "NaN", "inf": "Infinity"}


class EvaluationFailed(Exception):
    """An evaluation without a result: the status and the reason of its record."""

    def __init__(self, status: str, reason: str):
        super().__init__(reason)
        self.status = status
        self.reason = reason


def requests() -> ModuleType:
    """Return the package requests, which the extra `calib[umbridge]` brings.

    Raises
    ------
    CalibError : it is not installed
    """
    try:
        return importlib.import_module("requests")
    except ImportError as error:
        raise CalibError(
            f"the simulator 'umbridge' needs the package requests, which does not import ({error}); "
            'install it: pip install "calib[umbridge]"'
        ) from error


@dataclass(frozen=True)
class Client:
    """A model on a server.

    Attributes
    ----------
    url : of the server
    model : its name there
    timeout : until an evaluation is answered, None for no limit  [s]
    wait : for a server that cannot be reached  [s]
    """

    url: str
    model: str
    timeout: float | None
    wait: float

    def __post_init__(self) -> None:
        for name, text in (("url", self.url), ("model", self.model)):
            if not isinstance(text, str):
                raise CalibError(f"{name}: expected a text, got {text!r}")
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise CalibError(f"url: expected one such as 'http://localhost:4242', got {self.url!r}")
        if parts.username or parts.password:
            raise CalibError("url: a user name or password would be written into the results; drop it from the URL")

    def check(self) -> None:
        """Check that the server is there, knows the model, and evaluates it.

        Raises
        ------
        CalibError : it is not, or does not
        """
        try:
            info = self._answer("Info", None, METADATA_TIMEOUT)
            known = info.get("models") if isinstance(info, dict) else None
            if not isinstance(known, list) or info.get("protocolVersion") != PROTOCOL_VERSION:
                raise CalibError(f"url: {self.url} answers, but not as UM-Bridge {PROTOCOL_VERSION} does: {_cut(info)}")
            if self.model not in known:
                raise CalibError(
                    f"model: the server at {self.url} has no model {self.model!r}{nearest(self.model, known)}; "
                    f"it has {', '.join(map(str, known))}"
                )
            support = self._answer("ModelInfo", {"name": self.model}, METADATA_TIMEOUT).get("support", {})
        except EvaluationFailed as failure:
            raise CalibError(
                f"url: no answer from the UM-Bridge server at {self.url} ({failure.reason}); start it, or mend the URL"
            ) from failure
        if not support.get("Evaluate", False):
            raise CalibError(f"model: {self.model!r} at {self.url} cannot be evaluated; choose another model")

    def input_sizes(self, config: dict[str, Any]) -> list[int]:
        """Sizes of the input vectors.

        Raises
        ------
        EvaluationFailed : the server does not tell
        """
        answer = self._patient("InputSizes", {"name": self.model, "config": config}, METADATA_TIMEOUT)
        return list(answer.get("inputSizes", []))

    def evaluate(self, inputs: Sequence[Sequence[float]], config: dict[str, Any]) -> list[list[float]]:
        """Output vectors of the model.

        Raises
        ------
        EvaluationFailed : with the status "no server", "server timeout", "http error", "model error" or "bad answer"
        """
        request = {"name": self.model, "input": [list(block) for block in inputs], "config": config}
        answer = self._patient("Evaluate", request, self.timeout)
        outputs = answer.get("output") if isinstance(answer, dict) else None
        if not isinstance(outputs, list) or not all(isinstance(block, list) for block in outputs):
            raise EvaluationFailed("bad answer", f"expected output vectors, got {_cut(answer)}")
        return outputs

    def _patient(self, what: str, content: dict[str, Any], timeout: float | None) -> Any:
        """Answer of a server that may be away for a while."""
        until = time.monotonic() + self.wait
        while True:
            try:
                return self._answer(what, content, timeout)
            except EvaluationFailed as failure:
                if failure.status != "no server" or time.monotonic() >= until:
                    raise
                time.sleep(RETRY_INTERVAL)

    def _answer(self, what: str, content: dict[str, Any] | None, timeout: float | None) -> Any:
        package = requests()
        method = "GET" if content is None else "POST"
        try:
            with package.request(
                method, f"{self.url.rstrip('/')}/{what}", json=content, timeout=(CONNECTION_TIMEOUT, timeout),
                allow_redirects=False, stream=True,
            ) as response:  # fmt: skip
                status, body = response.status_code, _body(response)
        except package.exceptions.ReadTimeout as error:
            raise EvaluationFailed("server timeout", f"{what} took longer than {timeout} s") from error
        except (package.exceptions.ConnectionError, package.exceptions.ChunkedEncodingError) as error:
            raise EvaluationFailed("no server", f"{self.url} cannot be reached, or died: {_cut(error)}") from error
        except package.exceptions.RequestException as error:
            raise EvaluationFailed("http error", f"{what}: {_cut(error)}") from error
        answer = _read(body)
        if isinstance(answer, dict) and isinstance(fault := answer.get("error"), dict):
            raise EvaluationFailed("model error", f"{fault.get('type')}: {_cut(fault.get('message'))}")
        if status != 200:
            raise EvaluationFailed("http error", f"{what} is answered with HTTP status {status}: {_cut(body)}")
        if not isinstance(answer, dict):
            raise EvaluationFailed("bad answer", f"{what} is answered with what is no JSON object: {_cut(body)}")
        return answer


def _body(response: Any) -> str:
    """Text of an answer, of a bounded size."""
    content = bytearray()
    for chunk in response.iter_content(ANSWER_CHUNK_BYTES):
        content += chunk
        if len(content) > MAX_ANSWER_BYTES:
            raise EvaluationFailed("bad answer", f"an answer of more than {MAX_ANSWER_BYTES:.3g} bytes")
    return content.decode(errors="replace")


def _read(body: str) -> Any:
    """What an answer says in JSON; None where it is none."""
    for text in (body, PYTHON_NUMBER.sub(lambda match: JSON_NUMBERS[match[0]], body)):
        try:
            return json.loads(text)
        except (ValueError, RecursionError):
            continue
    return None


def _cut(text: object) -> str:
    return " ".join(str(text).split())[:MAX_QUOTED_CHARACTERS]
