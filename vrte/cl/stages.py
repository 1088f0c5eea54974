"""Stages of the compiled core done on a device: they take the same arrays, by the same names."""

import inspect
import time
from collections.abc import Callable
from functools import wraps
from types import SimpleNamespace
from typing import Any

from vrte.basics.running import ThreadTeam
from vrte.cl.session import Session

Stage = Callable[[Session, ThreadTeam, Any], None]


def stand_in_for(core: Callable[..., Any]) -> Callable[[Stage], Callable[..., None]]:
    """Makes of a function of a session, a crew and the arguments of a stage of `_core` a stage that is called as that
    one behind the session; its time is the first thread's."""
    signature = inspect.signature(core)

    def decorate(stage: Stage) -> Callable[..., None]:
        @wraps(stage)
        def call(session: Session, crew: ThreadTeam, **named: Any) -> None:
            start = time.perf_counter()
            signature.bind(crew, **named)  # the same names, or a TypeError
            with session.lock:
                stage(session, crew, SimpleNamespace(**named))
            crew.seconds[0] += time.perf_counter() - start

        return call

    return decorate
