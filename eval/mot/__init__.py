"""Trackers of several objects: run without a rectangle, scored for where and for who."""
