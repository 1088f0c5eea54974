"""Processes that do what they are told line by line, and say of each how many seconds it took."""

import subprocess
import sys

# megabytes that the process has held at most so far
PEAK = """
def peak():
    line = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024.0

"""


class Worker:
    """A process that runs the code; it prints a line when it is ready, and one for each line that it is sent."""

    def __init__(self, code: str, *arguments: str) -> None:
        command = [sys.executable, "-c", code, *arguments]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.answer()

    def begin(self, job: str = "") -> None:
        """Sends a line."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{job}\n")
        self.process.stdin.flush()

    def answer(self) -> str:
        """The next line that it says."""
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def seconds(self) -> float:
        """Waits for what was begun."""
        return float(self.answer())

    def end(self) -> None:
        """Ends it when what it does is done."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait(30)
        self.process.stdout.close()
