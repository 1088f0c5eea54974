"""The errors a user meets, each one clear sentence."""

import sys
import warnings
from importlib import import_module
from typing import Any

NO_MEMORY = "failed to map segment", "annot allocate memory"  # what loaders of libraries say
Place = tuple[str | int, ...]  # keys of tables and places in lists, these from 0 on: ("layer", 0, "thickness")


class SceneError(ValueError):
    """The scene or the request is wrong: what, where and what is allowed, in one sentence.

    It is a ValueError. ``place`` says where, as data, so that nobody has to read the sentence for it; what is put in
    front of the sentence, the name of a file, leaves the place as it is.

    Parameters
    ----------
    message : str
        The sentence; what cannot be printed in it, a line break among them, becomes a space.
    *place : str or int
        The argument of a call, "mu_i", or the way to a key of a scene file, "layer", 0, "thickness", which the sentence
        calls layer[1].thickness; nothing where it is nothing in particular.

    Examples
    --------
    >>> import vrte
    >>> try:
    ...     vrte.Lambertian(2.0)
    ... except vrte.SceneError as error:
    ...     print(error, error.place)
    base: albedo must be between 0 and 1, not 2.0 ('albedo',)
    """

    def __init__(self, message: str, *place: str | int) -> None:
        if not message.isprintable():
            message = "".join(sign if sign.isprintable() else " " for sign in message)
        super().__init__(message)
        self.place: Place = place

    @classmethod
    def of(cls, name: str, words: str) -> "SceneError":
        """The error of one argument; ``name`` may say before a colon whose it is: "layer: albedo"."""
        return cls(f"{name} {words}", name.rpartition(": ")[2])

    def behind(self, words: object) -> "SceneError":
        """The same error, of the same place, behind words: the name of a file, a wavelength."""
        return SceneError(f"{words}: {self}", *self.place)


class AccuracyError(ArithmeticError):
    """The solver's own residuals are too large to verify the answer; there is none.

    It is an ArithmeticError: another ``algorithm``, more ``nodes`` or a less extreme scene may help.
    """


class AccuracyWarning(UserWarning):
    """The answer is there and not as good as was asked for; the text says how good it is."""


class FittedRangeWarning(UserWarning):
    """A formula that was fitted to measurements is used beyond them: where, and what is done there."""


class IndistinguishableWarning(UserWarning):
    """A fit cannot tell two numbers apart, or one from its data at all: which, and what would help."""


class MisfitWarning(UserWarning):
    """The model of a fit does not fit the data: how far off, in what pattern, and how its errors grow by that."""


class UnitsWarning(UserWarning):
    """Numbers that look as if they were in other units, or of another sign, than they are taken for."""


class LongSolveWarning(UserWarning):
    """A solve will take more than 20 seconds: how long, what takes it, and what to change.

    The warning comes before the work begins; ``time_limit_s`` refuses what would take longer still.
    """


class MissingExtraError(ImportError):
    """An optional dependency is not installed, or cannot be loaded; the message names the extra that brings it.

    It is an ImportError.

    Parameters
    ----------
    purpose : str
        What needs it.
    extra : str
        Name of the extra: pip install 'vrte[extra]'.
    reason : str, optional
        Why it cannot be loaded, where it is installed.
    """

    def __init__(self, purpose: str, extra: str, reason: str = "") -> None:
        words = f", which is installed and cannot be loaded: {reason}" if reason else f": pip install 'vrte[{extra}]'"
        super().__init__(f"{purpose} needs the extra '{extra}'{words}")
        self.purpose, self.extra, self.reason = purpose, extra, reason

    def __reduce__(self) -> tuple[type["MissingExtraError"], tuple[str, str, str]]:
        # by its arguments: an exception is otherwise rebuilt from its message alone
        return type(self), (self.purpose, self.extra, self.reason)


def import_extra(module: str, purpose: str, extra: str) -> Any:
    """A module that an extra brings. Raises MissingExtraError."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(purpose, extra) from error
    except ImportError as error:
        reason = " ".join(str(error).split())[:200]
        if any(words in reason for words in NO_MEMORY):
            reason += " (there is too little memory, or a limit of it)"
        raise MissingExtraError(purpose, extra, reason) from error


class DeviceError(RuntimeError):
    """No OpenCL device is there, the one there is cannot do it, or it was lost on the way.

    It is a RuntimeError; ``backend="openmp"`` takes the processor.
    """


class SweepError(RuntimeError):
    """A sweep cannot go on: another process is at it, its cluster is lost, or a chunk brings its workers down.

    It is a RuntimeError; the same sweep, called again, goes on with the chunks that are left.
    """


def warn_user(message: str, category: type[Warning]) -> None:
    """Warns at the line outside of vrte from which all this was called."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("vrte."):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


for _error in list(globals().values()):
    if isinstance(_error, type) and issubclass(_error, Exception | Warning):
        _error.__module__ = "vrte"  # where users find it, and what a traceback names
