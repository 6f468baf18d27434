"""Files of erfgs in the readers of others, and files of others for erfgs; answers are JSON.

exchange.py session FILE FOLDER   the records of a session, by the library of MCAP and its decoder of ROS 2 messages,
                                  as Foxglove decodes them; payloads go to FOLDER, a file for each topic
exchange.py aedat4 FILE...        what is in AEDAT 4 files, by iniVation's dv-processing
exchange.py raw FILE...           the events of RAW files, by every library that reads their encoding
exchange.py write FOLDER          AEDAT 4 files by dv-processing, one for each compression, and what is in them
"""

import json
import sys
from pathlib import Path

PACKET = "erfgs_msgs/msg/Packet"
NUMBERS = ["sequence", "host_ns", "kernel_ns", "kernel_sequence", "flags"]
TYPES = {"integer": int, "number": (int, float), "string": str, "array": list, "object": dict}


def conforms(value, schema, where):
    """Holds a message against its schema, which is of the kind that Foxglove takes: one type for each property, objects
    with properties (none: any keys), arrays with items."""
    kind = TYPES[schema["type"]]
    assert isinstance(value, kind) and not isinstance(value, bool), f"{where} is {value!r}, not of type {schema['type']}"
    assert value in schema.get("enum", [value]), f"{where} is {value!r}"
    if isinstance(value, list):
        for entry in value:
            conforms(entry, schema["items"], where)
    if isinstance(value, dict) and (properties := schema["properties"]):
        for key, entry in value.items():
            assert key in properties, f"{where} has a property {key} that its schema lacks"
            conforms(entry, properties[key], f"{where}.{key}")


def session(path, folder):
    from mcap.reader import NonSeekingReader, make_reader
    from mcap_ros2.decoder import DecoderFactory

    found = {"packets": {}, "json": {}, "descriptions": {}, "attachments": [], "metadata": {}}
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        header, summary = reader.get_header(), reader.get_summary()
        counts = summary.statistics
        found["header"] = [header.profile, header.library]
        found["counts"] = [counts.message_count, counts.channel_count, counts.attachment_count, counts.metadata_count]
        for record in reader.iter_attachments():
            found["attachments"].append([record.name, record.media_type, record.data.decode()])
        for record in reader.iter_metadata():
            found["metadata"][record.name] = record.metadata
        for channel in summary.channels.values():
            found["descriptions"][channel.topic] = json.loads(channel.metadata.get("erfgs.description", "null"))
        index = [(chunk.message_start_time, chunk.message_end_time) for chunk in summary.chunk_indexes]
        assert len(index) > 3, "the session has several chunks"
        for schema, channel, message in reader.iter_messages():
            if channel.message_encoding == "json":
                value = json.loads(message.data)
                conforms(value, json.loads(schema.data), channel.topic)
                assert (schema.encoding, schema.name) == ("jsonschema", json.loads(schema.data)["title"])
                found["json"].setdefault(channel.topic, []).append(value)
        for schema, channel, message, packet in reader.iter_decoded_messages(topics=list(topics(summary, PACKET))):
            assert (schema.name, schema.encoding, channel.message_encoding) == (PACKET, "ros2msg", "cdr")
            row = [getattr(packet, name) for name in NUMBERS]
            row += [len(packet.data), message.log_time, message.publish_time, message.sequence]
            found["packets"].setdefault(channel.topic, []).append(row)
            with open(folder / channel.topic.replace("/", "_"), "ab") as out:
                out.write(bytes(packet.data))
    # The same once more from the first byte to the last, without the index.
    with open(path, "rb") as file:
        reader = NonSeekingReader(file, validate_crcs=True)
        messages = sum(1 for _ in reader.iter_messages())
        assert messages == counts.message_count, f"{messages} messages from the start on"
    assert sum(map(len, [*found["packets"].values(), *found["json"].values()])) == messages
    return found


def topics(summary, schema):
    return (channel.topic for channel in summary.channels.values() if summary.schemas[channel.schema_id].name == schema)


def batches(take):
    while (batch := take()) is not None:
        yield batch


def columns(t, x, y, on):
    return {"t": t.tolist(), "x": x.tolist(), "y": y.tolist(), "on": on.astype(int).tolist()}


def sample(imu):
    values = [getattr(imu, kind + axis) for kind in ("accelerometer", "gyroscope", "magnetometer") for axis in "XYZ"]
    return [imu.timestamp, imu.temperature, *values]


def aedat4(path):
    import dv_processing as dv
    import numpy as np

    recording = dv.io.MonoCameraRecording(str(path))
    events = [batch.numpy() for batch in batches(recording.getNextEventBatch)]
    joined = np.concatenate(events)
    frames = [
        {
            "start": frame.timestamp,
            "exposure": round(frame.exposure.total_seconds() * 1e6),
            "source": frame.source.name,
            "type": frame.image.dtype.name,
            "shape": list(frame.image.shape),
            "pixels": frame.image.ravel().tolist(),
        }
        for frame in batches(recording.getNextFrame)
    ]
    return {
        "camera": recording.getCameraName(),
        "streams": sorted(recording.getStreamNames()),
        "sizes": [list(recording.getEventResolution()), list(recording.getFrameResolution())],
        "events": columns(*(joined[name] for name in ["timestamp", "x", "y", "polarity"])),
        "frames": frames,
        "samples": [sample(imu) for batch in batches(recording.getNextImuBatch) for imu in batch],
        "triggers": [[mark.timestamp, mark.type.value] for batch in batches(recording.getNextTriggerBatch) for mark in batch],
    }


def raw(path):
    import faery
    import numpy as np
    from expelliarmus import Wizard

    found = {}
    # Expelliarmus takes no file with edges of the trigger input, which evt3.raw has.
    if path.stem == "evt2":
        rows = Wizard(encoding="evt2").read(path)
        found["expelliarmus"] = columns(*(rows[name] for name in "txyp"))
    stream = faery.events_stream_from_file(path)
    found["size of faery"] = list(stream.dimensions())
    rows = np.concatenate(list(stream))
    found["faery"] = columns(rows["t"], rows["x"], rows["y"], rows["on"])
    return found


def write(folder):
    import dv_processing as dv
    import numpy as np

    size, count, start = (346, 260), 9000, 1_700_000_000_000_000
    n = np.arange(count)
    events = columns(start + n // 3 * 5, n * 3 % size[0], n * 7 % size[1], n % 3 == 0)
    images = [(np.arange(size[0] * size[1]) * (index + 3) % 251).astype(np.uint8).reshape(size[::-1]) for index in range(2)]
    frames = [dv.Frame(start + 2000 * at, 700 + at, 0, 0, image, dv.FrameSource.SENSOR) for at, image in enumerate(images)]
    samples = [dv.IMU(start + at * 50, 36.5, *(float(at + axis) for axis in range(9))) for at in range(40)]
    marks = [dv.Trigger(start + at * 20, dv.TriggerType(at)) for at in range(10)]
    files = {}
    for name, compression in dv.CompressionType.__members__.items():
        files[name] = f"{name}.aedat4"
        config = dv.io.MonoCameraWriter.DAVISConfig("DAVIS346_00000042", size, compression)
        writer = dv.io.MonoCameraWriter(str(folder / files[name]), config)
        store = dv.EventStore()
        for row in zip(*(events[name] for name in ("t", "x", "y", "on"))):
            store.push_back(*row)
        writer.writeEvents(store)
        for frame in frames:
            writer.writeFrame(frame)
        for imu in samples:
            writer.writeImu(imu)
        for mark in marks:
            writer.writeTrigger(mark)
        # The file ends with its writer.
        del writer
    return {
        "files": files,
        "events": events,
        "frames": [[frame.timestamp, round(frame.exposure.total_seconds() * 1e6), frame.image.ravel().tolist()] for frame in frames],
        "samples": [sample(imu) for imu in samples],
        "triggers": [[mark.timestamp, mark.type.value] for mark in marks],
    }


def main():
    command, *paths = sys.argv[1], *map(Path, sys.argv[2:])
    each = {"aedat4": aedat4, "raw": raw}.get(command)
    found = {path.name: each(path) for path in paths} if each else {"session": session, "write": write}[command](*paths)
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()
