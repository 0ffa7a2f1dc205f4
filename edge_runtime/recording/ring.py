"""Memory that the loop's process and its logger's share: records from one to the other without a system call.

After the processor slept, the first system call costs the loop as much as all else that a tick's record
takes. One process writes, the other reads, and neither waits. Two cursors count the bytes written and read
since the beginning; each is moved by one side alone, after the bytes that it stands for. The memory outlives
a writer that is killed for as long as its reader lives.
"""

import mmap
import os
import time
from collections.abc import Iterator
from typing import Final

RING_BYTES: Final = 1 << 21
"""About 1,900 ticks of a team of four: 19 s at 100 Hz in which a logger may be held up."""
SETTLING_S: Final = 1e-3
"""Some processors show another's stores in any order, but all of them much sooner than this."""
_WORD: Final = 8
_HEAD: Final = 64
_WRITTEN, _READ = 0, 1


def open_ring_memory(size: int = RING_BYTES) -> int:
    """Return the descriptor of new memory for a ring of ``size`` bytes, to be shared with a child.

    Raises:
        OSError: if the system gives none.
    """
    descriptor = os.memfd_create("cfpg-log")
    os.ftruncate(descriptor, _HEAD + size)
    return descriptor


class Ring:
    """One side's view of the memory behind ``descriptor``, which may be closed then.

    A record takes a word for its length and as many as hold it. All pages are there from the start: none is
    first touched by the loop, or counted as growth.

    Raises:
        OSError: if the system cannot map it.
    """

    def __init__(self, descriptor: int) -> None:
        self._memory = mmap.mmap(descriptor, 0, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        self._end = len(self._memory)
        self._size = self._end - _HEAD
        self._words = memoryview(self._memory).cast("Q")
        self._written, self._limit = self._words[_WRITTEN], 0

    def put(self, record: bytes | bytearray) -> bool:
        """Write a record if there is room for all of it, else nothing; returns whether there was."""
        before, count = self._written, len(record)
        after = before + _WORD + (count + _WORD - 1 & -_WORD)
        if after > self._limit:
            self._limit = self._words[_READ] + self._size
            if after > self._limit:
                return False
        place = _HEAD + before % self._size
        self._words[place // _WORD] = count
        start = place + _WORD
        if start + count <= self._end:
            self._memory[start : start + count] = record
        else:
            left = self._end - start
            self._memory[start:] = record[:left]
            self._memory[_HEAD : _HEAD + count - left] = record[left:]
        self._words[_WRITTEN] = self._written = after
        return True

    def unread(self) -> Iterator[memoryview]:
        """Yield the records that have not been taken."""
        return _records(self._content())

    def take(self) -> Iterator[memoryview]:
        """Yield the records that came since the last time; their room is free before the first is yielded."""
        content = self._content()
        self._words[_READ] += len(content)
        return _records(content)

    def close(self) -> None:
        """Give this side's view back."""
        self._words.release()
        self._memory.close()

    def _content(self) -> memoryview:
        read, written = self._words[_READ], self._words[_WRITTEN]
        time.sleep(SETTLING_S)
        start, count = _HEAD + read % self._size, written - read
        content = self._memory[start : start + count]
        return memoryview(content + self._memory[_HEAD : _HEAD + count - len(content)])


def _records(content: memoryview) -> Iterator[memoryview]:
    words, start = content.cast("Q"), 0
    while start < len(content):
        count, start = words[start // _WORD], start + _WORD
        yield content[start : start + count]
        start += count + _WORD - 1 & -_WORD
