"""Stages of the compiled core done on a device: they take the same arrays, by the same names."""

import time
from collections.abc import Callable
from functools import wraps
from types import SimpleNamespace
from typing import Any

from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.cl.session import Session

Stage = Callable[[Session, ThreadTeam, Any], None]


def stand_in_for(core: Callable[..., Any]) -> Callable[[Stage], Callable[..., Any]]:
    """Makes of a function of a session, a crew and the arguments of a stage of `_core` a stage that is called as that
    one behind the session, and checks and allocates as that one does; its time is the first thread's."""

    def decorate(stage: Stage) -> Callable[..., Any]:
        @wraps(stage)
        def call(session: Session, crew: ThreadTeam, **named: Any) -> Any:
            start = time.perf_counter()
            found = core.allocate(named) if hasattr(core, "allocate") else {}
            with session.lock:
                stage(session, crew, SimpleNamespace(**named | found))
            crew.seconds[0] += time.perf_counter() - start
            return _core.result_of(found)

        return call

    return decorate
