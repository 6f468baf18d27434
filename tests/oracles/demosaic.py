"""Colour from a Bayer mosaic by OpenCV: the filters of Malvar, He and Cutler (ICASSP 2004, figure 2) convolved with the
whole mosaic and taken where the pixel has the colour, and OpenCV's own bilinear conversion.

usage: demosaic.py MOSAIC WIDTH ORDER    writes `filtered` and `converted` beside MOSAIC: float32, red green blue
"""

import os
import sys

import cv2
import numpy as np

file, width, order = sys.argv[1], int(sys.argv[2]), sys.argv[3]
mosaic = np.fromfile(file, np.uint8).reshape(-1, width)
folder = os.path.dirname(file)

# Figure 2 of the paper, in eighths.
green = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]])
in_row = np.array([[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]])
opposite = np.array([[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]])


def convolved(kernel):
    return cv2.filter2D(mosaic.astype(np.float64), -1, kernel / 8, borderType=cv2.BORDER_REFLECT_101)


at_green, row, column, across = (convolved(k) for k in (green, in_row, in_row.T, opposite))
rgb = np.zeros((*mosaic.shape, 3))
for y in range(2):
    for x in range(2):
        here = slice(y, None, 2), slice(x, None, 2)
        own, beside, below = order[2 * y + x], order[2 * y + 1 - x], order[2 * (1 - y) + x]
        for channel, colour in enumerate("rgb"):
            if colour == own:
                values = mosaic
            elif colour == "g":
                values = at_green
            elif own == "g":
                values = row if colour == beside else column
            else:
                values = across
            rgb[(*here, channel)] = values[here]
rgb.astype(np.float32).tofile(os.path.join(folder, "filtered"))

code = getattr(cv2, f"COLOR_Bayer{order.upper()}2RGB")
cv2.cvtColor(mosaic, code).astype(np.float32).tofile(os.path.join(folder, "converted"))
