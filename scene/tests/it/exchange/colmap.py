"""Where COLMAP sees points: python colmap.py MODEL '[[x, y, z], ...]'"""
import json
import sys

import numpy as np
import pycolmap

model = pycolmap.Reconstruction(sys.argv[1])
points = np.array(json.loads(sys.argv[2]))
images = sorted(model.images.values(), key=lambda image: image.name)
print(json.dumps([[np.ravel(image.project_point(point)).tolist() for point in points] for image in images]))
