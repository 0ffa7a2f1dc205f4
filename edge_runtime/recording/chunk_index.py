"""Where the chunks of a log file lie, kept packed until the file is closed."""

from collections.abc import Iterator

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex


class PackedIndex:
    """Stands in for the list of chunk indexes of `mcap.writer.Writer`.

    As objects they take a kilobyte a chunk; a logger that ends two chunks a second grows by a mebibyte in ten
    minutes. Packed as the file will have them they take a fifth of that.
    """

    def __init__(self) -> None:
        self._records = bytearray()

    def append(self, index: ChunkIndex) -> None:
        """Take in the index of the newest chunk."""
        builder = RecordBuilder()
        index.write(builder)
        self._records += builder.end()  # type: ignore[no-untyped-call]

    def __iter__(self) -> "Iterator[PackedIndex]":
        """Yield what writes all of them."""
        yield self

    def write(self, builder: RecordBuilder) -> None:
        """Write all records to the file's summary."""
        builder.write(self._records)
