"""Columns of the shapes that were asked for last, so that each is formed once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["ColumnStore"]

# memory that kept columns may take, bytes: a dozen causes on three minutes at 1 kHz
_MEMORY = 5e7

_Key = tuple[int, tuple[tuple[str, float], ...]]


@dataclass(slots=True)
class ColumnStore:
    """Columns of causes at shapes; those not asked for the longest go first.

    Parameters
    ----------
    entries : OrderedDict
        Cause and columns by the cause's identity and its shape.
    size : int
        Memory of all columns, bytes.
    """

    entries: OrderedDict[_Key, tuple[Cause, FloatArray]] = field(default_factory=OrderedDict)
    size: int = 0

    def columns(
        self, cause: Cause, shape: Mapping[str, float], form: Callable[[], FloatArray]
    ) -> FloatArray:
        """Return the columns of a cause at a shape, formed where they are not kept.

        Parameters
        ----------
        cause : Cause
            Cause.
        shape : mapping of str to float
            Shape parameters.
        form : callable
            Forms the columns.

        Returns
        -------
        ndarray, shape (n, n_linear)
            Not writeable.
        """
        # the entry holds the cause, so that its identity is not given to another one meanwhile
        key = (id(cause), tuple(sorted(shape.items())))
        entry = self.entries.get(key)
        if entry is not None:
            self.entries.move_to_end(key)
            return entry[1]
        columns = form()
        columns.flags.writeable = False
        self.entries[key] = (cause, columns)
        self.size += columns.nbytes
        while self.size > _MEMORY and len(self.entries) > 1:
            _, (_, gone) = self.entries.popitem(last=False)
            self.size -= gone.nbytes
        return columns
