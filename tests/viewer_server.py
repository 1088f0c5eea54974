"""A viewer's server for tests: started, and ended as Ctrl-C ends it."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]


@contextmanager
def viewer(*options: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """A server on a free port; it must end by itself when it is interrupted. The address has the token."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    process = subprocess.Popen(
        [sys.executable, "-m", "vrte.cli", "view", "--no-browser", "--port", "0", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=environment,
    )
    assert process.stdout is not None
    try:
        found = re.search(r"http://127\.0\.0\.1:\d+/\?token=[\w-]+", process.stdout.readline())
        assert found, process.communicate()[1]
        yield found[0], process
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)
        process.send_signal(signal.SIGINT)  # an impatient second one, which must leave no trace
        said, complained = process.communicate(timeout=20)
        assert (process.returncode, said, complained) == (0, "vrte view: ended\n", ""), complained
    finally:
        process.kill()
        process.communicate()
