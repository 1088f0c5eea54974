"""Which LLVM Mitsuba's variants llvm_* compile with: Dr.Jit takes one that may end the process."""

import os
import re
import sys
from pathlib import Path

NAMED = "DRJIT_LIBLLVM_PATH"  # read when Mitsuba is first imported
OLDEST = 17  # 14 is refused by Dr.Jit 1.5; 15 ends the process, since it lacks the minimum that Dr.Jit asks for


def prepare_llvm() -> bool:
    """Names the newest LLVM of Linux's usual folders, where the user names none; whether there is one that works. On
    other systems Dr.Jit looks for one itself."""
    if NAMED in os.environ or sys.platform != "linux":
        return True
    found = [path for folder in ("*", "*/lib", ".") for path in Path("/usr/lib").glob(f"{folder}/libLLVM*.so*")]
    numbers = [(re.search(r"LLVM(?:-|\.so\.)(\d+)", path.name), str(path)) for path in found]
    version, path = max([(int(number[1]), path) for number, path in numbers if number], default=(0, ""))
    if version < OLDEST:
        return False
    os.environ[NAMED] = path
    return True
