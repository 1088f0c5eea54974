"""Arrays that were costly to make, remembered by what they were made of, up to so many bytes in all."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable

from vrte.basics.arrays import Array

MOST_BYTES = 96e6  # of one store
LARGEST_SHARE = 0.1  # of it that one entry may take: larger ones are made anew each time


class Remembered:
    """A store of read-only arrays, the least recently used of which go first; safe in threads."""

    def __init__(self, most_bytes: float = MOST_BYTES) -> None:
        self.most_bytes, self.bytes = most_bytes, 0
        self._entries: OrderedDict[Hashable, tuple[Array, ...]] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, key: Hashable, make: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
        """The arrays of a key, made where they are not there; nobody may change them."""
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key]
        made = make()
        for part in made:
            part.flags.writeable = False
        size = sum(part.nbytes for part in made)
        if size > LARGEST_SHARE * self.most_bytes:
            return made
        with self._lock:
            if key not in self._entries:
                self.bytes += size
            self._entries[key] = made
            while self.bytes > self.most_bytes:
                self.bytes -= sum(part.nbytes for part in self._entries.popitem(last=False)[1])
        return made
