"""Reads an MCAP file with the package `mcap` of PyPI, checks every chunk's sum, and prints what is in it as JSON.

Of a file that was closed the summary is read, too, and must say the same.
"""
import json
import sys

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

path = sys.argv[1]
counts, last, schemas, channels, is_closed = {}, {}, {}, {}, True
with open(path, "rb") as file:
    try:
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
                last[channel.topic] = max(last.get(channel.topic, 0), record.log_time)
                if channel.message_encoding == "json":
                    message = json.loads(record.data)
                    schema = json.loads(schemas[channel.schema_id].data)
                    missing = set(schema["properties"]) - set(message)
                    assert not missing, f"{channel.topic}: no {missing}"
    except (EndOfFile, InvalidMagic, EOFError):
        is_closed = False
if is_closed:
    with open(path, "rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        told = {summary.channels[channel].topic: count for channel, count in summary.statistics.channel_message_counts.items()}
        assert told == counts, f"{told} is told, {counts} are there"
        read = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
        assert read == sum(counts.values()), f"{read} by the index, {counts} are there"
print(json.dumps({"is_closed": is_closed, "counts": counts, "last_ns": last}))
