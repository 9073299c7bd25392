"""Writes pictures, PNG, and counts their pixels that are not the background, magenta."""

import sys

import numpy as np
from PIL import Image


def write(path, rgb):
    """Writes colours of 8 bits, rows from the top."""
    Image.fromarray(np.ascontiguousarray(rgb, dtype=np.uint8)).save(path)


def count(path):
    """Counts the pixels of a picture that are not magenta, within what rounding may change."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return int((np.abs(pixels - (255, 0, 255)).sum(axis=2) > 6).sum())


if __name__ == "__main__":
    print(count(sys.argv[1]))
