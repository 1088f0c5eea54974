"""The errors a user meets, each one clear sentence."""


class SceneError(ValueError):
    """The scene or the request is wrong: what, where and what is allowed."""


class AccuracyError(ArithmeticError):
    """The solver's own residuals are too large to vouch for the answer."""


class AccuracyWarning(UserWarning):
    """The answer is there and not as good as was asked for."""


class LongSolveWarning(UserWarning):
    """A solve will take more than 20 seconds: how long, what takes it, and what to change."""


class MissingExtraError(ImportError):
    """An optional dependency is not installed; the message names the extra that brings it."""

    def __init__(self, purpose: str, extra: str) -> None:
        super().__init__(f"{purpose} needs the extra '{extra}': pip install 'vrte[{extra}]'")
        self.purpose, self.extra = purpose, extra

    def __reduce__(self) -> tuple[type["MissingExtraError"], tuple[str, str]]:
        # by its two arguments: an exception is otherwise rebuilt from its message alone
        return type(self), (self.purpose, self.extra)


class DeviceError(RuntimeError):
    """No OpenCL device is there, the one there is cannot do it, or it was lost on the way."""


class SweepError(RuntimeError):
    """A sweep cannot go on: another process is at it, its cluster is lost, or a chunk brings its workers down."""


for _error in list(globals().values()):
    if isinstance(_error, type):
        _error.__module__ = "vrte"  # where users find it, and what a traceback names
