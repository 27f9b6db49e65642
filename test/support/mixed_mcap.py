"""Files of mcap as people hand them over: ROS beside JSON, attachments, any compression."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import get_typestore, Stores

TYPES = get_typestore(Stores.ROS2_JAZZY)
TEXT = 'std_msgs/msg/String'
SECOND = 1_000_000_000
Ros = tuple[str, str, int, bytes]  # topic, type, time of recording [ns], CDR
SOME = [
    ('/words', TEXT, number * SECOND, bytes(TYPES.serialize_cdr(TYPES.types[TEXT](text), TEXT)))
    for number, text in enumerate((f'{number:0300}' for number in range(100)), start=1)
]


def write_mixed(
    path: Path,
    messages: Iterable[Ros] = SOME,
    *,
    compression: CompressionType = CompressionType.NONE,
    profile: str = 'ros2',
    chunk_size: int = 4096,
    **options: Any,
) -> Path:
    """Write messages of ROS 2 with everything else that mcap can hold between them."""
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=chunk_size, compression=compression, **options)
        writer.start(profile, library='recorder of somebody')
        schema = writer.register_schema('Pose', 'jsonschema', b'{"type": "object"}')
        json = writer.register_channel('/poses', 'json', schema, {'made by': 'a browser'})
        bare = writer.register_channel('/bytes', 'application/octet-stream', 0)
        writer.register_channel('/silent', 'json', schema)
        writer.add_metadata('place', {'room': 'kitchen', 'weather': 'rain'})
        channels: dict[str, int] = {}
        for number, (topic, kind, log_ns, data) in enumerate(messages):
            if topic not in channels:
                channels[topic] = register_ros2(writer, topic, kind)
            writer.add_message(channels[topic], log_ns, data, log_ns - 5, number)
            if number % 10 == 0:
                writer.add_message(json, log_ns, b'{"x": 1}', log_ns, number)
                writer.add_message(bare, log_ns, bytes(range(50)), log_ns)
            if number == 30:
                writer.add_attachment(1, 2, 'photo.jpg', 'image/jpeg', bytes(5000))
        writer.finish()
    return path


def register_ros2(writer: Writer, topic: str, kind: str) -> int:
    """Register a channel as rosbag2 does."""
    text, _ = TYPES.generate_msgdef(kind, ros_version=2)
    schema = writer.register_schema(kind, 'ros2msg', text.encode())
    metadata = {'offered_qos_profiles': '', 'topic_type_hash': TYPES.hash_rihs01(kind)}
    return writer.register_channel(topic, 'cdr', schema, metadata)


def content(path: Path) -> dict[str, Any]:
    """Return all that a whole file holds, by the names of things, with nothing of its layout."""
    with path.open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        return {
            'messages': [
                (
                    channel.topic,
                    channel.message_encoding,
                    tuple(channel.metadata.items()),
                    (schema.name, schema.encoding, schema.data) if schema else None,
                    (message.log_time, message.publish_time, message.sequence, message.data),
                )
                for schema, channel, message in reader.iter_messages()
            ],
            'channels': sorted(item.topic for item in summary.channels.values()),
            'schemas': sorted(item.name for item in summary.schemas.values()),
            'attachments': list(reader.iter_attachments()),
            'metadata': list(reader.iter_metadata()),
            'header': reader.get_header(),
        }


def chunk_offsets(path: Path) -> list[int]:
    """Return where the chunks of a file begin."""
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [item.chunk_start_offset for item in summary.chunk_indexes]
