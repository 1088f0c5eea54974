"""What the answers of a tab's warm processes have in common: how they are given up, and refused in a sentence."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError

TOLD = SceneError, AccuracyError, DeviceError, MissingExtraError, OSError  # errors that are sentences by themselves


@dataclass(frozen=True)
class Refused:
    """Why there is no answer, in a sentence."""

    number: int
    message: str


class NewerError(Exception):
    """There is a newer question."""


def explain_failure(work: Callable[[], None], folder: Path) -> str:
    """Does some work; what goes wrong with it as a sentence, "" where nothing does. `NewerError` goes on.

    >>> explain_failure(lambda: None, Path())
    ''
    """
    try:
        work()
    except NewerError:
        raise
    except TOLD as error:
        return put_in_one_line(str(error).replace(f"{folder}{os.sep}", ""), 1000)  # where it lies is nobody's business
    except MemoryError:
        return "not enough memory for this scene: smaller particles need less"
    except Exception as error:  # never seen; a page must not wait for ever
        return put_in_one_line(f"{type(error).__name__}: {error}", 1000)
    return ""
