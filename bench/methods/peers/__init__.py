"""Codes of others that pip installs (extra "bench"), asked for the same light: further curves of the report.

Nothing of them is imported before it is asked.
"""

import importlib
import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from bench.methods.peers import codes
from bench.methods.peers.asked import Asked
from bench.methods.peers.codes import Solve
from bench.study import hash_files
from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import MissingExtraError

Result = TypeVar("Result")


class PeerError(Exception):
    """A peer failed on what it was thought to take, or gave no number."""


@dataclass(frozen=True)
class Peer:
    """A code, by the name of its package; ``lacks``: what its curve tells of what it does not find; ``prepare``: what
    other scenes of as many layers share, done; what it returns does the rest, and is timed; whether it takes
    polarization, and albedo 1."""

    name: str
    lacks: str
    streams: tuple[int, ...]
    prepare: Callable[[Asked, int], Solve]
    polarization: bool = False
    conservative: bool = True

    def check(self, asked: Asked) -> None:
        """Raises SceneError for what it does not take."""
        asked.check(self.name, self.polarization, self.conservative)

    @property
    def is_installed(self) -> bool:
        """Whether it can be imported."""
        return importlib.util.find_spec(self.name) is not None

    @property
    def made_by(self) -> str:
        """Its version and what asks it: another gives other rows."""
        return f"{version(self.name)} {hash_sources()}"


UP_TO_64 = (4, 8, 16, 32, 64)
PEERS = {
    peer.name: peer
    for peer in (
        Peer("nanodisort", "", (*UP_TO_64, 128), codes.prepare_nanodisort),
        Peer("PythonicDISORT", "", UP_TO_64, codes.prepare_pythonic_disort, conservative=False),
        Peer("sasktran2", " (light up, no V)", UP_TO_64, codes.prepare_sasktran2, polarization=True),
    )
}


def prepare_solve(name: str, asked: Asked, streams: int) -> Solve:
    """What answers, each call anew. Raises SceneError for what the peer does not take, PeerError where it fails,
    MissingExtraError where it is not installed."""
    peer = PEERS[name]
    peer.check(asked)
    import_peer(name)
    solve = guard_call(name, lambda: peer.prepare(asked, streams))
    return lambda: guard_call(name, solve)


def guard_call(name: str, call: Callable[[], Result]) -> Result:
    """A call of a peer; whatever it raises is a PeerError, and what it warns of is measured anyway."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return call()
    except Exception as error:
        raise PeerError(f"{name}: {put_in_one_line(f'{type(error).__name__}: {error}', 200)}") from error


def import_peer(name: str) -> Any:
    """The module of a peer. Raises MissingExtraError where it is not installed."""
    if not PEERS[name].is_installed:
        raise MissingExtraError(f"the comparison with {name}", "bench")
    return importlib.import_module(name)


def list_installed() -> tuple[Peer, ...]:
    """Those that can be asked."""
    return tuple(peer for peer in PEERS.values() if peer.is_installed)


def describe_peers() -> str:
    """Which other codes are drawn, in their versions, and which could be."""
    here = ", ".join(f"{peer.name} {version(peer.name)}" for peer in list_installed())
    absent = ", ".join(peer.name for peer in PEERS.values() if not peer.is_installed)
    texts = [f"other codes: {here or 'none'}", f"not installed: {absent} (pip install 'vrte[bench]')" if absent else ""]
    return "; ".join(text for text in texts if text)


@cache
def hash_sources() -> str:
    """A fingerprint of these files."""
    return hash_files(Path(__file__).parent.glob("*.py"))[:16]
