"""What COLMAP reads of a model with rigs and frames: python colmap_rig.py MODEL

Its rigs (cameras, the first of which is the reference), its frames (names of images by frame), and the pose of each image as it
follows from the frame and the rig, rows of a 3x4 matrix.
"""

import json
import sys

import pycolmap

model = pycolmap.Reconstruction(sys.argv[1])
json.dump(
    {
        "rigs": [
            [rig.ref_sensor_id.id, sorted(sensor.id for sensor in rig.non_ref_sensors)] for rig in model.rigs.values()
        ],
        "frames": [
            sorted(model.images[data.id].name for data in frame.image_ids) for _, frame in sorted(model.frames.items())
        ],
        "poses": {image.name: image.cam_from_world().matrix().tolist() for image in model.images.values()},
        "registered": model.num_reg_images(),
    },
    sys.stdout,
)
