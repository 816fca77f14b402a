"""The processes of one training: small values that they exchange, and one end for all of them.

JAX's collectives wait for ever for a process that hangs, and its own service ends the others by an abort with
a stack trace. Here every process holds a connection to process 0: one that closes, or over which nothing
comes for `SILENCE` seconds, ends all processes with one sentence. So do `STUCK` seconds without a step.
"""

import json
import os
import selectors
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NoReturn

SILENCE = 60.0  # seconds without a word after which a process counts as hanging
BEAT = 2.0  # seconds between two words
LEAVING = 1.0  # seconds that process 0 waits for the others when all end
STUCK = 1800.0  # seconds without a step after which all end: a process may live and yet wait for ever
LOST = 75  # exit code (EX_TEMPFAIL of sysexits.h): another process ended, the same command goes on
_GOES_ON = "the same command for all processes goes on from the last checkpoint"


def end_process(code: int, sentence: str) -> NoReturn:
    """End this process at once, whatever its main thread waits for."""
    with suppress(OSError):
        os.write(2, f"error: {sentence}\n".encode())
    os._exit(code)


class Peers:
    """The other processes, seen from process `index` of `count`.

    `links` are connected sockets: of process 0 to all others, of the others to process 0. `end` is given the
    exit code and the sentence when another process has ended or hangs.
    """

    def __init__(
        self,
        index: int,
        count: int,
        links: Mapping[int, socket.socket],
        *,
        end: Callable[[int, str], Any] = end_process,
        silence: float = SILENCE,
        beat: float = BEAT,
        stuck: float = STUCK,
    ) -> None:
        self.index, self.count = index, count
        self._links, self._end = dict(links), end
        self._silence, self._beat, self._stuck = silence, beat, stuck
        self._stepped: float | None = None  # when the last step was made, while another is to come
        self._state = threading.Condition(threading.RLock())
        self._given: dict[int, dict[int, Any]] = {}  # of process 0: round -> process -> value
        self._rounds: dict[int, list[Any]] = {}  # round -> the values of all
        self._round, self._over, self._parting = 0, False, False
        self._ending, self._ended = False, threading.Event()
        self._thread = threading.Thread(target=self._watch, name="peers", daemon=True)
        self._thread.start()

    def exchange(self, value: Any) -> list[Any]:
        """Return the values (of JSON) of all processes in order, once all have called this as often."""
        self._round += 1
        if self.index == 0:
            self._give(0, self._round, value)
        else:
            self._send(0, ["value", self._round, value])
        with self._state:
            self._state.wait_for(lambda: self._round in self._rounds)
            return self._rounds.pop(self._round)

    def made_step(self, *, more: bool) -> None:
        """Note that a step was made; with `more` the next has to come in time."""
        self._stepped = time.monotonic() if more else None

    def close(self) -> None:
        """Part in peace: no process minds any more that another one ends."""
        self._parting = True
        self.exchange(None)
        self._over = True
        self._thread.join()
        for link in self._links.values():
            if self.index == 0:  # closed with words unread, it would take the last ones back
                link.settimeout(5.0)
                while _received(link):
                    pass
            link.close()

    def end_all(self, code: int, sentence: str) -> None:
        """Tell all processes to end with `code` and that sentence, and end this one.

        Does nothing after a parting in peace. While another thread ends this process, it waits for that.
        """
        with self._state:  # one end, with one sentence, for each process
            first, self._over = not self._over, True
            self._ending = self._ending or first
        if not first:
            if self._ending:
                self._ended.wait()
            return
        for process in self._links:
            self._send(process, ["end", code, sentence])
        if self.index == 0:  # JAX's service lives here: it ends last, or JAX of the others complains of that
            self._see_off()
        self._end(code, sentence)
        self._ended.set()

    def _see_off(self) -> None:
        """Wait for the others to end, for `LEAVING` seconds at most."""
        last = time.monotonic() + LEAVING
        for link in self._links.values():
            with suppress(OSError):
                while (left := last - time.monotonic()) > 0:
                    link.settimeout(left)
                    if not link.recv(2**16):
                        break

    def _give(self, process: int, number: int, value: Any) -> None:
        with self._state:
            given = self._given.setdefault(number, {})
            given[process] = value
            if len(given) < self.count:
                return
            values = [self._given[number][i] for i in range(self.count)]
            del self._given[number]
            self._rounds[number] = values
            self._over = self._over or self._parting  # from now on all may end
            self._state.notify_all()
        for other in self._links:
            self._send(other, ["values", number, values])

    def _send(self, process: int, message: list[Any]) -> None:
        with suppress(OSError), self._state:  # a closed connection is noticed where it is read
            self._links[process].sendall(json.dumps(message).encode() + b"\n")

    def _watch(self) -> None:
        heard = dict.fromkeys(self._links, time.monotonic())
        buffers, said = dict.fromkeys(self._links, b""), 0.0
        with selectors.DefaultSelector() as selector:
            for process, link in self._links.items():
                selector.register(link, selectors.EVENT_READ, process)
            while not self._over:
                for key, _ in selector.select(timeout=self._beat / 4):
                    process = key.data
                    data = _received(key.fileobj)
                    heard[process] = time.monotonic()
                    *lines, buffers[process] = (buffers[process] + data).split(b"\n")
                    for line in lines:
                        self._understand(process, json.loads(line))
                    if not data:
                        self._lost(process, "has ended")
                now, stepped = time.monotonic(), self._stepped
                if stepped is not None and now - stepped > self._stuck:
                    what = f"no step was made for {self._stuck / 60:.3g} minutes"
                    self.end_all(LOST, f"{what}, so all processes end; {_GOES_ON}.")
                for process, last in heard.items():
                    if now - last > self._silence:
                        self._lost(process, f"has said nothing for {self._silence:g} s")
                if now - said > self._beat:
                    said = now
                    for process in heard:
                        self._send(process, ["beat"])

    def _understand(self, process: int, message: list[Any]) -> None:
        """Do what a message asks for."""
        match message:
            case ["value", number, value]:
                self._give(process, number, value)
            case ["values", number, values]:
                with self._state:
                    self._rounds[number] = values
                    self._over = self._over or self._parting
                    self._state.notify_all()
            case ["end", code, sentence]:
                self.end_all(code, sentence)

    def _lost(self, process: int, what: str) -> None:
        self.end_all(LOST, f"process {process} of {self.count} {what}, so all end; {_GOES_ON}.")


def _received(link: Any) -> bytes:
    try:
        return link.recv(2**16)
    except OSError:
        return b""


def connect(index: int, count: int, host: str, share: Callable[[bytes], bytes]) -> Peers:
    """Return the other processes, connected by way of process 0 on `host`.

    `share` gives all processes the bytes that process 0 hands it. Raises `OSError` where they do not meet.
    """
    if index == 0:
        with _server() as server:
            token = share(server.getsockname()[1].to_bytes(4, "big") + os.urandom(16))
            return Peers(0, count, _met(server, count, token))
    token = share(bytes(20))
    port = int.from_bytes(token[:4], "big")
    try:
        link = socket.create_connection((host, port), timeout=SILENCE)
    except OSError as error:
        raise OSError(
            f"process {index} does not reach process 0 at {host}:{port} ({error.strerror or error}); let the "
            "machines reach each other's ports."
        ) from error
    link.settimeout(None)
    link.sendall(token + index.to_bytes(4, "big"))
    return Peers(index, count, {0: link})


def _server() -> socket.socket:
    if socket.has_dualstack_ipv6():
        return socket.create_server(("", 0), family=socket.AF_INET6, dualstack_ipv6=True)
    return socket.create_server(("", 0))


def _met(server: socket.socket, count: int, token: bytes) -> dict[int, socket.socket]:
    """Return the connections of all other processes; strangers, who do not know the token, are left out."""
    links: dict[int, socket.socket] = {}
    server.settimeout(SILENCE)
    while len(links) < count - 1:
        try:
            link, _ = server.accept()
            link.settimeout(SILENCE)
            said = link.recv(len(token) + 4, socket.MSG_WAITALL)
        except OSError as error:
            missing = sorted(set(range(1, count)) - set(links))
            raise OSError(f"process {missing[0]} of {count} did not come; start all again.") from error
        if said[:-4] != token:
            link.close()
            continue
        link.settimeout(None)
        links[int.from_bytes(said[-4:], "big")] = link
    return links
