"""Calibrates the stereo pairs of a folder with OpenCV: python opencv.py FOLDER COLUMNS ROWS SQUARE > answer.json

With a further argument: the corners that the sector-based detector finds in the folder's PNG files."""
import glob
import json
import os
import sys

import cv2
import numpy as np

folder, columns, rows, square = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
board = np.zeros((columns * rows, 3), np.float32)
board[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2) * square
enough = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-10)


def corners(path):
    grey = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    found, points = cv2.findChessboardCorners(grey, (columns, rows))
    if not found:
        return None, grey.shape[::-1]
    enough = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-4)
    return cv2.cornerSubPix(grey, points, (5, 5), (-1, -1), enough), grey.shape[::-1]


def by_sectors(path):
    """The corners that the sector-based detector finds (Duda and Frese 2018)."""
    grey = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    found, points = cv2.findChessboardCornersSB(grey, (columns, rows), flags=cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY)
    return points.reshape(-1, 1, 2) if found else None


if len(sys.argv) > 5:
    paths = sorted(glob.glob(folder + "/*.png"))
    found = [by_sectors(path) for path in paths]
    json.dump([None if points is None else points.reshape(-1, 2).tolist() for points in found], sys.stdout)
    sys.exit()

seen = {}
for path in sorted(glob.glob(folder + "/*.jpg")):
    name = os.path.basename(path)[:-4]
    camera, instant = name[:-2], name[-2:]
    points, size = corners(path)
    if points is not None:
        seen.setdefault(camera, {})[instant] = points

answer, cameras = {}, {}
for camera, views in seen.items():
    image = list(views.values())
    sectors = [points for points in (by_sectors(f"{folder}/{camera}{instant}.jpg") for instant in views) if points is not None]
    sectors_rms = cv2.calibrateCamera([board] * len(sectors), sectors, size, None, None, criteria=enough)[0]
    rms, matrix, distortion, _, _, deviations, _, _ = cv2.calibrateCameraExtended(
        [board] * len(image), image, size, None, None, criteria=enough)
    cameras[camera] = (matrix, distortion)
    answer[camera] = {
        "rms": rms,
        "sectors_rms": sectors_rms,
        "views": sorted(views),
        # fx, fy, cx, cy, k1, k2, p1, p2, k3, and their standard deviations
        "parameters": [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel().tolist()],
        "deviations": deviations.ravel().tolist()[:9],
    }
both = sorted(set(seen["left"]) & set(seen["right"]))
rms, *_, rotation, translation, _, _ = cv2.stereoCalibrate(
    [board] * len(both), [seen["left"][i] for i in both], [seen["right"][i] for i in both],
    *cameras["left"], *cameras["right"], size, flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=enough)
answer["stereo"] = {"rms": rms, "rotation": cv2.Rodrigues(rotation)[0].ravel().tolist(), "translation": translation.ravel().tolist()}
json.dump(answer, sys.stdout)
