"""Horn–Schunck optical flow."""
