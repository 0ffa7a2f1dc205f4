"""Logs as somebody else might write them: a log's messages, changed, by the library's own writer."""

import struct

import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer


def messages_of(log):
    """Topics and contents of a log's messages, in order."""
    with log.open("rb") as file:
        return [(channel.topic, message.data) for _, channel, message in make_reader(file).iter_messages()]


def write(path, messages, compression=CompressionType.ZSTD):
    """Write messages, whatever they hold."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start("cfpg", "somebody else's")
        channels = {}
        for number, (topic, content) in enumerate(messages):
            if topic not in channels:
                schema = writer.register_schema(topic, "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], number, content, number)
        writer.finish()
    return path


def with_chunk(path, start, data, size, compression="zstd"):
    """Write a log that begins with its start and goes on with one packed chunk that claims a size."""
    write(path, [("/start", start)])
    whole = path.read_bytes()
    end = whole.index(b"\x0f" + struct.pack("<Q", 4))  # of the data section
    body = struct.pack("<QQQI", 0, 0, size, 0)
    body += struct.pack("<I", len(compression)) + compression.encode() + struct.pack("<Q", len(data)) + data
    path.write_bytes(whole[:end] + b"\x06" + struct.pack("<Q", len(body)) + body + whole[end:])
    return path


def packed_zeros(size):
    """So many zeros, as zstd packs them: a few bytes for each hundred thousand."""
    packer = zstandard.ZstdCompressor().compressobj(size=size)
    block = bytes(1 << 20)
    return b"".join(packer.compress(block) for _ in range(size >> 20)) + packer.flush()
