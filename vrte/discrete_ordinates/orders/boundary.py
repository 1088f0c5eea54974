"""What lies above the layers of a problem: nothing, or an interface that is a condition at their top."""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray, record


@record
class Top:
    """An interface above the layers, in the scaled and flipped frame: row (order,), of `reflection` (row, block, b, b),
    which light coming up goes down again by, S x S along each node or n x n; sent (order, n_rhs, n): light on the nodes
    that it makes of beams, which then meet no layer; of no orders where they go through. Rows and orders by number."""

    row: IntArray
    reflection: Array
    sent: Array

    def arguments_of(self, orders: IntArray) -> dict[str, Any]:
        """What the core takes of it: nothing where nothing lies above, no light where beams go through."""
        if not self.row.size:
            return {}
        sent = {"sent": self.sent[orders]} if self.sent.size else {}
        return {"top_row": self.row[orders], "top": self.reflection} | sent


OPEN = Top(np.zeros(0, np.int32), np.zeros((1, 1, 1, 1)), np.zeros((0, 1, 1)))  # nothing above the layers
