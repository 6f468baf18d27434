"""What erfgs writes for the tools of others, in the libraries of others; answers are JSON, bytes of messages go to files.

bridge.py foxglove FILE FOLDER   every message of an MCAP file, by the library of MCAP with its own decoder of Protobuf, which knows nothing
                                 but the schemas in the file, and by Foxglove's own classes; pictures by OpenCV
bridge.py rosbag2 BAG FOLDER     every message of a bag of ROS 2, by rosbags, with the definitions in the bag
"""

import json
import sys
from pathlib import Path


class Folder:
    """Takes bytes, and gives the name of the file that they are in."""

    def __init__(self, folder):
        self.folder, self.count = folder, 0

    def put(self, data):
        self.count += 1
        path = self.folder / f"{self.count:06}.bin"
        path.write_bytes(bytes(data))
        return path.name


def decoded(data, folder):
    """A picture: its shape, bytes of a sample, and its pixels as red, green and blue or grey."""
    import cv2
    import numpy as np

    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert pixels is not None, "OpenCV reads no picture"
    if pixels.ndim == 3:
        pixels = pixels[:, :, ::-1]
    return {"shape": list(pixels.shape), "depth": pixels.dtype.itemsize, "pixels": folder.put(pixels.tobytes())}


def nanoseconds(stamp):
    return stamp.seconds * 1_000_000_000 + stamp.nanos


def foxglove(path, folder):
    from google.protobuf import descriptor_pb2, descriptor_pool
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

    own = {kind.DESCRIPTOR.full_name: kind for kind in (CameraCalibration, CompressedImage, FrameTransforms)}
    folder, found = Folder(folder), {}
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        for schema in summary.schemas.values():
            assert schema.encoding == "protobuf", schema.encoding
            # What is imported comes before; nothing is taken from elsewhere, and nothing is there that protobuf does not know.
            pool, files = descriptor_pool.DescriptorPool(), descriptor_pb2.FileDescriptorSet.FromString(schema.data)
            assert files.SerializeToString() == schema.data
            for one in files.file:
                pool.Add(one)
            ours, theirs = pool.FindMessageTypeByName(schema.name), own[schema.name].DESCRIPTOR
            compare(ours, theirs)
        last = 0
        for schema, channel, message, ours in reader.iter_decoded_messages(log_time_order=False):
            theirs = own[schema.name].FromString(message.data)
            assert str(ours) == str(theirs), "the schema in the file reads it as Foxglove's own does"
            assert channel.message_encoding == "protobuf" and message.publish_time == message.log_time
            assert message.log_time >= last - 100_000_000, "messages are nearly in the order of their times"
            last = max(last, message.log_time)
            one = {"log": message.log_time, "sequence": message.sequence}
            if schema.name == "foxglove.CompressedImage":
                one |= {"stamp": nanoseconds(ours.timestamp), "frame": ours.frame_id, "format": ours.format}
                one |= decoded(ours.data, folder) | {"bytes": folder.put(ours.data)}
            elif schema.name == "foxglove.CameraCalibration":
                one |= {"stamp": nanoseconds(ours.timestamp), "frame": ours.frame_id, "size": [ours.width, ours.height]}
                one |= {"model": ours.distortion_model, **{name: list(getattr(ours, name)) for name in "DKRP"}}
            else:
                one["transforms"] = [
                    {
                        "stamp": nanoseconds(each.timestamp),
                        "frames": [each.parent_frame_id, each.child_frame_id],
                        "translation": [getattr(each.translation, axis) for axis in "xyz"],
                        "rotation": [getattr(each.rotation, axis) for axis in "xyzw"],
                    }
                    for each in ours.transforms
                ]
            found.setdefault(channel.topic, []).append(one)
        assert summary.statistics.message_count == sum(map(len, found.values()))
    return found


def compare(ours, theirs):
    """Each of our fields is theirs, by number and type."""
    for field in ours.fields:
        other = theirs.fields_by_number[field.number]
        assert (field.name, field.type) == (other.name, other.type), (field.name, other.name)
        assert field.is_repeated == other.is_repeated, field.name
        if field.message_type:
            compare(field.message_type, other.message_type)


def rosbag2(path, folder):
    import numpy as np
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    # Those of the standard are rosbags' own, so that ours are held against them.
    store, folder, found = get_typestore(Stores.ROS2_HUMBLE), Folder(folder), {}
    with Reader(path) as bag:
        counts = {}
        for connection in bag.connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            for name, fields in types.items():
                if name in store.fielddefs:
                    assert store.fielddefs[name] == fields, f"{name} is another"
                else:
                    store.register({name: fields})
            qos = connection.ext.offered_qos_profiles
            counts[connection.topic] = [connection.msgtype, connection.msgcount, [profile.durability.name for profile in qos]]
        span = [bag.start_time, bag.end_time]
        for connection, log, data in bag.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            assert store.serialize_cdr(message, connection.msgtype) == data, "it serialises to the same bytes"
            one = {"log": log}
            if hasattr(message, "header"):
                one |= {"stamp": message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec, "frame": message.header.frame_id}
            for name in ("height", "width", "encoding", "step", "seq", "is_bigendian", "distortion_model", "format"):
                if hasattr(message, name):
                    one[name] = getattr(message, name)
            for name in "dkrp":
                if isinstance(getattr(message, name, None), np.ndarray):
                    one[name] = getattr(message, name).tolist()
            for name in ("data", "events"):
                if hasattr(message, name):
                    one["bytes"] = folder.put(getattr(message, name).tobytes())
            if connection.msgtype.endswith("CompressedImage"):
                one |= decoded(message.data.tobytes(), folder)
            if hasattr(message, "transforms"):
                one["transforms"] = [
                    {
                        "frames": [each.header.frame_id, each.child_frame_id],
                        "translation": [getattr(each.transform.translation, axis) for axis in "xyz"],
                        "rotation": [getattr(each.transform.rotation, axis) for axis in "xyzw"],
                    }
                    for each in message.transforms
                ]
            found.setdefault(connection.topic, []).append(one)
        assert bag.message_count == sum(map(len, found.values()))
    return {"topics": counts, "span": span, "messages": found}


def main():
    command, path, folder = sys.argv[1:]
    json.dump({"foxglove": foxglove, "rosbag2": rosbag2}[command](Path(path), Path(folder)), sys.stdout)


if __name__ == "__main__":
    main()
