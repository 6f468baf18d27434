"""The tags 36h11 in a picture as OpenCV reads them: python tags.py PICTURE BORDER_CELLS > answer.json"""
import json
import sys

import cv2

grey = cv2.imread(sys.argv[1], cv2.IMREAD_GRAYSCALE)
parameters = cv2.aruco.DetectorParameters()
parameters.markerBorderBits = int(sys.argv[2])
parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
found = [] if ids is None else [
    {"id": int(number), "corners": four.reshape(4, 2).tolist()} for number, four in zip(ids.ravel(), corners)]
json.dump(found, sys.stdout)
