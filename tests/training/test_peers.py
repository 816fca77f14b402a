"""Processes of one training: what they exchange, and how one's end becomes everybody's."""

import socket
import threading
from collections.abc import Callable
from typing import Any

import pytest

from garment_jax.training.peers import LOST, Peers, connect


class Group:
    """Process 0 with `count - 1` others, all in this process; what would end them is noted."""

    def __init__(self, count: int, silence: float = 30.0) -> None:
        pairs = {i: socket.socketpair() for i in range(1, count)}
        self.ends: dict[int, tuple[int, str]] = {}
        self.ended = threading.Condition()
        links = [{i: first for i, (first, _) in pairs.items()}, *({0: other} for _, other in pairs.values())]
        self.members = [
            Peers(i, count, links[i], end=self._noted(i), silence=silence, beat=0.05) for i in range(count)
        ]

    def _noted(self, process: int) -> Callable[[int, str], None]:
        def note(code: int, sentence: str) -> None:
            with self.ended:
                self.ends[process] = code, sentence
                self.ended.notify_all()

        return note

    def all_do(self, act: Callable[[Peers], Any]) -> list[Any]:
        """What `act` returns for each member, all at once."""
        results: dict[int, Any] = {}
        threads = [
            threading.Thread(target=lambda peer=peer: results.update({peer.index: act(peer)}))
            for peer in self.members
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10)
        return [results[i] for i in range(len(self.members))]

    def wait_for_ends(self, *processes: int) -> None:
        with self.ended:
            assert self.ended.wait_for(lambda: set(processes) <= set(self.ends), timeout=10), self.ends

    def cut(self, process: int) -> None:
        """As the system does with the connections of a process that is killed."""
        self.stop(process)
        for link in self.members[process]._links.values():
            link.shutdown(socket.SHUT_RDWR)

    def stop(self, process: int) -> None:
        """Its threads stand still, its connections stay."""
        self.members[process]._over = True
        self.members[process]._thread.join()

    def __enter__(self) -> "Group":
        return self

    def __exit__(self, *_: object) -> None:
        for peer in self.members:
            self.stop(peer.index)
            for link in peer._links.values():
                link.close()


def test_values_come_back_in_the_order_of_processes() -> None:
    with Group(3) as group:
        for number in range(3):
            values = [number, 10 + number, 20 + number]
            assert group.all_do(lambda peer, n=number: peer.exchange(10 * peer.index + n)) == [values] * 3
        group.all_do(lambda peer: peer.close())
        assert not group.ends


def test_an_end_without_a_word_ends_the_others_with_one_sentence() -> None:
    with Group(3) as group:
        group.cut(2)
        group.wait_for_ends(0, 1)
        sentence = (
            "process 2 of 3 has ended, so all end; the same command for all processes goes on from the last "
            "checkpoint."
        )
        assert group.ends == {0: (LOST, sentence), 1: (LOST, sentence)}


def test_a_silent_process_ends_the_others() -> None:
    with Group(3, silence=0.3) as group:
        group.stop(1)
        group.wait_for_ends(0, 2)
        assert group.ends[0][1].startswith("process 1 of 3 has said nothing for 0.3 s, so all end; ")
        assert group.ends[0] == group.ends[2]


def test_no_step_for_long_ends_all() -> None:
    with Group(2) as group:
        for peer in group.members:
            peer._stuck = 0.3
            peer.made_step(more=True)
        group.members[1].made_step(more=False)
        group.wait_for_ends(0, 1)
        assert group.ends[0][1].startswith("no step was made for 0.005 minutes, so all processes end; ")


def test_the_end_of_process_0_is_seen_by_all() -> None:
    with Group(3) as group:
        group.cut(0)
        group.wait_for_ends(1, 2)
        assert {code for code, _ in group.ends.values()} == {LOST}
        assert group.ends[1][1].startswith("process 0 of 3 has ended")


def test_a_refusal_of_one_is_said_by_all() -> None:
    with Group(3) as group:
        group.members[1].end_all(2, "process 1 on there: no clips.")
        group.wait_for_ends(0, 1, 2)
        assert set(group.ends.values()) == {(2, "process 1 on there: no clips.")}


def test_the_main_thread_says_nothing_while_another_thread_ends_its_process() -> None:
    with Group(2) as group:
        note, may_end, went_on = group.members[1]._end, threading.Event(), threading.Event()

        def end_slowly(code: int, sentence: str) -> None:
            may_end.wait(10)
            note(code, sentence)

        group.members[1]._end = end_slowly
        group.members[0].end_all(2, "no clips.")

        def main() -> None:
            while not group.members[1]._ending:  # until the watching thread has read that sentence
                may_end.wait(0.01)
            group.members[1].end_all(2, "process 1 on there: no clips.")
            went_on.set()

        thread = threading.Thread(target=main)
        thread.start()
        assert not went_on.wait(0.5)
        may_end.set()
        assert went_on.wait(10)
        thread.join()
    assert group.ends == {0: (2, "no clips."), 1: (2, "no clips.")}


def test_process_0_ends_after_the_others() -> None:
    with Group(3) as group:
        order: list[int] = []
        for peer in group.members:
            (link, *_) = peer._links.values()

            def end(_code: int, _sentence: str, peer: Peers = peer, link: socket.socket = link) -> None:
                order.append(peer.index)
                if peer.index:
                    link.shutdown(socket.SHUT_RDWR)  # as the system does with an ended process

            peer._end = end
        group.members[0].end_all(2, "no clips.")
        assert order[-1] == 0
        assert sorted(order) == [0, 1, 2]


def test_processes_meet_and_strangers_are_left_out() -> None:
    given, known = threading.Event(), [b""]

    def from_first(value: bytes) -> bytes:
        known[0] = value
        given.set()
        with socket.create_connection(("localhost", int.from_bytes(value[:4], "big"))) as stranger:
            stranger.sendall(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
        return value

    def to_other(_value: bytes) -> bytes:
        assert given.wait(10)
        return known[0]

    group: dict[int, Peers] = {}
    threads = [
        threading.Thread(target=lambda: group.update({0: connect(0, 2, "localhost", from_first)})),
        threading.Thread(target=lambda: group.update({1: connect(1, 2, "localhost", to_other)})),
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    found: list[Any] = []
    other = threading.Thread(target=lambda: found.append(group[1].exchange("b")))
    other.start()
    assert group[0].exchange("a") == ["a", "b"]
    other.join(10)
    assert found == [["a", "b"]]
    for peer in group.values():
        thread = threading.Thread(target=peer.close)
        thread.start()
    thread.join(10)


def test_an_address_that_nobody_answers_is_a_sentence() -> None:
    with socket.create_server(("localhost", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(OSError, match=f"process 1 does not reach process 0 at localhost:{port} "):
        connect(1, 2, "localhost", lambda _: port.to_bytes(4, "big") + bytes(16))
