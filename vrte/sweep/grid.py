"""How a grid of scenes is cut into chunks: boxes of neighbours, each a chunk of the table on disk."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

LARGEST_CHUNK = 32e6  # bytes of results that a chunk holds, unless asked for
MOST_AT_ONCE, PIECES = 64, 32  # scenes of a chunk, and chunks of a sweep that workers can share


@dataclass(frozen=True)
class Grid:
    """``shape`` of the sweep and of a ``box``: a chunk, smaller where the shape ends."""

    shape: tuple[int, ...]
    box: tuple[int, ...]

    @property
    def boxes(self) -> tuple[int, ...]:
        """How many there are along each dimension."""
        return tuple(-(-length // side) for length, side in zip(self.shape, self.box, strict=True))

    @property
    def chunks(self) -> int:
        return math.prod(self.boxes)

    def slices(self, chunk: int) -> tuple[slice, ...]:
        """Where in the table a chunk lies.

        >>> Grid((2, 5), (1, 3)).slices(3)
        (slice(1, 2, None), slice(3, 5, None))
        """
        corner = np.unravel_index(chunk, self.boxes)
        starts = [int(place) * side for place, side in zip(corner, self.box, strict=True)]
        ends = zip(starts, self.box, self.shape, strict=True)
        return tuple(slice(start, min(start + side, length)) for start, side, length in ends)

    def extent(self, chunk: int) -> tuple[int, ...]:
        """The shape of a chunk."""
        return tuple(part.stop - part.start for part in self.slices(chunk))

    def places(self, chunk: int) -> Iterator[tuple[int, ...]]:
        """Its scenes, the last dimension fastest."""
        return itertools.product(*(range(part.start, part.stop) for part in self.slices(chunk)))


def cut_grid(shape: tuple[int, ...], most: int) -> Grid:
    """Boxes of at most ``most`` scenes, whole along the last dimensions, evenly cut along the one before.

    >>> cut_grid((3, 10), 4).box, cut_grid((3, 10), 20).box
    ((1, 4), (2, 10))
    """
    box = [1] * len(shape)
    room = most
    for place in reversed(range(len(shape))):
        pieces = -(-shape[place] // max(1, room))
        box[place] = -(-shape[place] // pieces)
        room //= shape[place]
    return Grid(shape, tuple(box))


def choose_chunk_size(count: int, bytes_of_a_scene: int) -> int:
    """How many are good: enough chunks to share, none too large, and not a file for each of very many scenes.

    >>> choose_chunk_size(200, 1000), choose_chunk_size(1_000_000, 1000), choose_chunk_size(1_000_000, 20_000_000)
    (7, 64, 1)
    """
    by_memory = int(LARGEST_CHUNK // bytes_of_a_scene)
    return max(1, min(MOST_AT_ONCE, -(-count // PIECES), by_memory))
