"""Object tracking by motion: a drop-in for OpenCV's trackers built on Horn–Schunck optical flow."""
