"""Where OpenCV sees points: python opencv.py FOLDER '[[x, y, z], ...]'"""
import glob
import json
import sys

import cv2
import numpy as np

points = np.array(json.loads(sys.argv[2]))
answer = []
for path in sorted(glob.glob(sys.argv[1] + "/*.yaml")):
    file = cv2.FileStorage(path, cv2.FILE_STORAGE_READ)
    matrix, distortion, rotation, translation = (
        file.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients", "R", "T"))
    turn = cv2.Rodrigues(rotation)[0]
    if file.getNode("distortion_model").string() == "equidistant":
        seen, _ = cv2.fisheye.projectPoints(points[:, None], turn, translation, matrix, distortion)
    else:
        seen, _ = cv2.projectPoints(points, turn, translation, matrix, distortion)
    answer.append(seen.reshape(-1, 2).tolist())
print(json.dumps(answer))
