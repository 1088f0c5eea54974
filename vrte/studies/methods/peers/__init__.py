"""Codes of others that pip installs (extra "bench"), asked for the same light: further curves of the report.

Nothing of them is imported before it is asked.
"""

import importlib
import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from vrte.basics.arrays import in_one_line
from vrte.basics.errors import MissingExtraError
from vrte.results.field import Field
from vrte.studies.methods.peers import nanodisort, pythonic_disort, sasktran2
from vrte.studies.methods.peers.asked import Asked

ACCURACY = 1e-12  # of nanodisort's sum over azimuthal orders
Solve = Callable[[], Field]
Result = TypeVar("Result")


class PeerError(Exception):
    """A peer failed on what it was thought to take, or gave no number."""


@dataclass(frozen=True)
class Peer:
    """A code, by the name of its package; ``lacks``: what its curve tells of what it does not find; ``prepare``: what
    other scenes of as many layers share, done; what it returns does the rest, and is timed. ``check`` raises
    SceneError."""

    name: str
    lacks: str
    streams: tuple[int, ...]
    check: Callable[[Asked], None]
    prepare: Callable[[Asked, int], Solve]

    @property
    def is_installed(self) -> bool:
        """Whether it can be imported."""
        return importlib.util.find_spec(self.name) is not None

    @property
    def made_by(self) -> str:
        """Its version and what asks it: another gives other rows."""
        return f"{version(self.name)} {sources()}"


def of_nanodisort(asked: Asked, streams: int) -> Solve:
    """All of it is done again."""
    return lambda: nanodisort.field_of(asked, nanodisort.state_of(asked, streams, ACCURACY))


def of_pythonic_disort(asked: Asked, streams: int) -> Solve:
    """All of it is done again."""
    return lambda: pythonic_disort.field_of(asked, streams)


def of_sasktran2(asked: Asked, streams: int) -> Solve:
    """The engine is kept, the atmosphere made again."""
    engine, *how = sasktran2.engine_of(asked, streams)
    return lambda: sasktran2.field_of(asked, engine, sasktran2.atmosphere_of(asked, *how))


PEERS = {
    peer.name: peer
    for peer in (
        Peer("nanodisort", "", nanodisort.STREAMS, nanodisort.check, of_nanodisort),
        Peer("PythonicDISORT", "", pythonic_disort.STREAMS, pythonic_disort.check, of_pythonic_disort),
        Peer("sasktran2", " (light up, no V)", sasktran2.STREAMS, sasktran2.check, of_sasktran2),
    )
}


def solver(name: str, asked: Asked, streams: int) -> Solve:
    """What answers, each call anew. Raises SceneError for what the peer does not take, PeerError where it fails,
    MissingExtraError where it is not installed."""
    peer = PEERS[name]
    peer.check(asked)
    imported(name)
    solve = guarded(name, lambda: peer.prepare(asked, streams))
    return lambda: guarded(name, solve)


def guarded(name: str, call: Callable[[], Result]) -> Result:
    """A call of a peer; whatever it raises is a PeerError, and what it warns of is measured anyway."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return call()
    except Exception as error:
        raise PeerError(f"{name}: {in_one_line(f'{type(error).__name__}: {error}', 200)}") from error


def imported(name: str) -> Any:
    """The module of a peer. Raises MissingExtraError where it is not installed."""
    if not PEERS[name].is_installed:
        raise MissingExtraError(f"the comparison with {name}", "bench")
    return importlib.import_module(name)


def installed() -> tuple[Peer, ...]:
    """Those that can be asked."""
    return tuple(peer for peer in PEERS.values() if peer.is_installed)


def missing() -> tuple[str, ...]:
    """Names of the others."""
    return tuple(peer.name for peer in PEERS.values() if not peer.is_installed)


def statement() -> str:
    """Which other codes are drawn, in their versions, and which could be."""
    here = ", ".join(f"{peer.name} {version(peer.name)}" for peer in installed())
    absent = ", ".join(missing())
    texts = [f"other codes: {here or 'none'}", f"not installed: {absent} (pip install 'vrte[bench]')" if absent else ""]
    return "; ".join(text for text in texts if text)


@cache
def sources() -> str:
    """A fingerprint of these files."""
    found = sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]
